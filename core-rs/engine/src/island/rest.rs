//! The beginning of an island that nothing has moved yet: blocks that would leave it as it is are not computed.
//!
//! A step is a function of the state and of what is due at it. So where nothing is due, and blocks leave the state and
//! what is heard the same to the last bit, all that follow do, up to the first event.

use super::inside::BodyPlan;
use super::{Fault, Island, gain};
use crate::kernel::thread_team::ThreadTeam;
use crate::timeline::{Drive, Source, Timeline};

/// Blocks that have to agree: looks at gains are between some of them.
const ALIKE: u64 = 4;
/// An island that has not come to rest by then is played.
const TRIES: u64 = 16;
/// Bodies are followed ahead, and strikes fall between frames: events are met in steps that are computed [steps].
const MARGIN: u64 = 4 * gain::BLOCK;

/// What is known of an island at rest.
pub(crate) struct Rest {
    /// The step before which nothing is due.
    until: u64,
    /// Frames of a block.
    block: usize,
    /// What the last block left, and how many before it left the same.
    left: Vec<u8>,
    heard: Vec<f64>,
    work: [u64; 2],
    alike: u64,
    tries: u64,
}

impl Rest {
    /// Of an island at frame 0 that is played in blocks of so many frames.
    pub(crate) fn new(
        island: &Island,
        timeline: &Timeline,
        bodies: &[BodyPlan],
        block: usize,
    ) -> Self {
        let is_constant = |drive: &Drive| matches!(drive.source, Source::Constant(_));
        let is_still = timeline.leads.is_empty()
            && timeline.glides.is_empty()
            && timeline.gates.is_empty()
            && timeline.drives.iter().all(is_constant)
            && island.is_storable()
            && (block as u64 * ALIKE).is_multiple_of(gain::BLOCK);
        let script = &island.script;
        let gestures = script.gestures.iter();
        let gestures = gestures.map(|own| own.join_from.min(own.first));
        let pushes = script.pushes.iter().map(|push| push.frame);
        let ergons = script.ergons.iter().map(|(frame, _)| *frame);
        let inside = bodies.iter().map(|body| body.first_strike() as u64);
        let due = gestures.chain(pushes).chain(ergons).chain(inside).min();
        Self {
            until: due
                .filter(|_| is_still)
                .map_or(0, |due| due.saturating_sub(MARGIN)),
            block,
            left: Vec::new(),
            heard: Vec::new(),
            work: [0; 2],
            alike: 0,
            tries: 0,
        }
    }

    /// Play on as `island.process` does, to the last bit and with the same work counted.
    pub(crate) fn process(
        &mut self,
        island: &mut Island,
        out: &mut [f64],
        n_frames: usize,
    ) -> Result<(), Fault> {
        let steps = n_frames as u64 * u64::from(island.oversampling);
        if n_frames != self.block || island.state.frame + steps > self.until {
            self.end();
        }
        if self.until == 0 {
            return island.process(out, n_frames, &mut ThreadTeam::alone());
        }
        if self.alike == ALIKE {
            out.copy_from_slice(&self.heard);
            island.state.frame += steps;
            island.add_fine_work(self.work);
            return Ok(());
        }
        let before = island.fine_products();
        let end = island.process(out, n_frames, &mut ThreadTeam::alone());
        let after = island.fine_products();
        let work = [after[0] - before[0], after[1] - before[1]];
        let left = island.without_clocks();
        let is_same = left == self.left && work == self.work && same_bits(out, &self.heard);
        self.alike = if is_same { self.alike + 1 } else { 0 };
        (self.left, self.work) = (left, work);
        self.heard.clear();
        self.heard.extend_from_slice(out);
        self.tries += 1;
        if end.is_err() || (self.tries == TRIES && self.alike < ALIKE) {
            self.end();
        }
        end
    }

    /// Whether blocks are passed over now.
    #[cfg(test)]
    pub(crate) fn is_known(&self) -> bool {
        self.until > 0 && self.alike == ALIKE
    }

    /// From here on every block is computed.
    pub(crate) fn end(&mut self) {
        self.until = 0;
    }
}

impl Island {
    /// Its state but for the frame, and for the work that contacts took.
    fn without_clocks(&mut self) -> Vec<u8> {
        let frame = std::mem::take(&mut self.state.frame);
        let work = self.fine_products();
        self.set_fine_work([0; 2]);
        let bytes = self.write_state();
        self.state.frame = frame;
        self.set_fine_work(work);
        bytes
    }

    /// Work of contacts so far: instants, and products.
    fn fine_products(&self) -> [u64; 2] {
        let work = self.fine_work();
        [work.instants, work.products]
    }

    fn set_fine_work(&mut self, [instants, products]: [u64; 2]) {
        if let Some(fine) = &mut self.state.fine {
            (fine.work.instants, fine.work.products) = (instants, products);
        }
    }

    fn add_fine_work(&mut self, [instants, products]: [u64; 2]) {
        let work = self.fine_products();
        self.set_fine_work([work[0] + instants, work[1] + products]);
    }
}

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    let bits = |x: &f64| x.to_bits();
    a.iter().map(bits).eq(b.iter().map(bits))
}
