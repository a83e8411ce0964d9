//! A mesh that is gone through finer, by forces that are found as its method finds them.

use super::mesh::{Mesh, Room};
use crate::guard::{Guard, Motion, Stage};
use crate::kernel::thread_team::ThreadTeam;

pub(super) struct Watched<'a, 'b> {
    pub(super) mesh: &'a Mesh,
    pub(super) room: &'a mut Room,
    pub(super) force: &'a mut [f64],
    pub(super) x: &'a mut [f64],
    pub(super) d: &'a mut [f64],
    pub(super) team: &'a mut ThreadTeam<'b>,
}

impl Stage for Watched<'_, '_> {
    fn pull(&mut self) {
        let motion = [&*self.x, &*self.d];
        self.mesh.total(motion, self.room, self.force, self.team);
    }

    fn motion(&mut self) -> Motion<'_> {
        Motion {
            ties: self.mesh.scheme.ties(),
            force: self.force,
            x: self.x,
            d: self.d,
        }
    }
}

impl Watched<'_, '_> {
    /// Go through a frame at whose beginning it stands, impulses given.
    pub(super) fn by(mut self, guard: &mut Guard) {
        self.pull();
        guard.finer(&mut self);
    }
}
