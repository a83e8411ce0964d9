//! Particle ergons: real MAS that hit the key through a BUT whose contact lasts two steps, K = 2μ.

use crate::scheme::Scheme;
use crate::state::ModuleState;

/// Speed of approach [m/s]: fixed, so that the mass carries the impulse and the speed stays far above
/// any key's (error of the impulse below 1e-6 for velocity steps from 1e-5 to 0.5 m/s).
pub(crate) const APPROACH_SPEED: f64 = 1000.0;
/// Most particles near the key at once: a contact lasts two steps, and dense ergons come every step.
const PARTICLES_MAX: usize = 4;
/// A particle this far out never returns [m]: it leaves at 23 mm a step.
const EXIT_DISTANCE: f64 = 1e-3;

/// A particle near the key.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Particle {
    /// Penetration into the key (rising: towards it) [m], in the particle's own direction.
    position: f64,
    last_step: f64,
    /// 1/M of the particle [m/N], and stiffness of its contact [N/m]; 0: no particle.
    w: f64,
    k: f64,
    /// +1: comes from below and pushes up.
    sign: f64,
}

crate::archive::state!(Particle {
    position,
    last_step,
    w,
    k,
    sign
});

/// The particles of one voice.
#[derive(Clone, Debug, Default)]
pub(crate) struct Particles([Particle; PARTICLES_MAX]);

crate::archive::state!(Particles { 0 });

impl Particles {
    /// Step the particles that touch `mat` and push it; forget those that have left.
    pub(crate) fn step(&mut self, modules: &mut ModuleState, mat: usize) {
        for particle in &mut self.0 {
            if particle.k > 0.0 {
                let penetration = particle.sign * (particle.position - modules.x[mat]);
                let push_force = if penetration > 0.0 {
                    particle.k * penetration
                } else {
                    0.0
                };
                modules.push(mat, particle.sign * push_force);
                particle.last_step -= particle.sign * push_force * particle.w;
                particle.position += particle.last_step;
                if penetration < -EXIT_DISTANCE {
                    particle.k = 0.0;
                }
            }
        }
    }

    /// Whether no particle is near.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.iter().all(|particle| particle.k == 0.0)
    }

    /// Launch a particle whose contact gives impulse `force`·T now: it flew in freely and touched one step ago. Returns
    /// its mass [kg] and velocity [m/s]; `None` if no particle of that speed can carry that impulse, or too many are
    /// near.
    pub(crate) fn launch(
        &mut self,
        scheme: &Scheme,
        modules: &mut ModuleState,
        mat: usize,
        force: f64,
    ) -> Option<(f64, f64)> {
        let time_step = 1.0 / scheme.rate;
        let sign = force.signum();
        let approach_speed = sign * APPROACH_SPEED;
        // Penetration after one step of approach, the key moving as it did.
        let approach_depth = (approach_speed * time_step - modules.d[mat]) * sign;
        // force = K·penetration with K = 2μ, and 1/μ = w + w_key.
        let mu = 0.5 * force.abs() / approach_depth;
        let w = 1.0 / mu - scheme.w[mat];
        let free_slot = self.0.iter_mut().find(|particle| particle.k == 0.0)?;
        if w <= 0.0 || approach_depth <= 0.0 {
            return None;
        }
        *free_slot = Particle {
            position: modules.x[mat] + sign * approach_depth,
            last_step: approach_speed * time_step,
            w,
            k: 2.0 * mu,
            sign,
        };
        let push_force = free_slot.k * approach_depth;
        modules.push(mat, sign * push_force);
        free_slot.last_step -= sign * push_force * free_slot.w;
        free_slot.position += free_slot.last_step;
        Some((time_step * time_step / w, approach_speed))
    }
}
