//! The numbers of a body's complex modes from positions and steps of its masses.
//!
//! A mode of the left eigenvector l, normed, with the pole λ has the number z = λ·l·M·x + l·(C·x + M·v) for
//! displacements x and velocities v: l·M·v is what impulses M·v add to it, and l·M·x what they add to its integral
//! (Tisseur and Meerbergen, The Quadratic Eigenvalue Problem, 2001). Velocities are found from steps in rounds:
//! each takes away what the step of the motion found so far differs from the step that is known.

use crate::body_modes::complex_modes::{BackwardStep, Complex, ComplexModes, ComplexPart, Pole, Sum};
use crate::body_modes::linear::{Damper, Linear};
use crate::body_modes::mode_shapes::ModeShapes;
use crate::network::Network;
use crate::units::Rate;

/// Rounds of the velocities. The error of a mode falls by 1 − sin(θ)/θ in each, θ its angle in a frame: after eight it
/// is below −80 dB up to 14 kHz at 44.1 kHz. Modes above half the rate, which steps do not show, grow by 1.2 at most.
const ROUNDS: usize = 8;

/// Largest decay in a step that counts in a round: a stronger one would make the rounds diverge.
const SOUGHT_DECAY_MAX: f64 = 0.5;

/// A table from the motions of masses to the parts of complex modes.
#[derive(Clone, Debug)]
pub(crate) struct StateProjection {
    /// From parts to positions.
    shapes: ModeShapes,
    parts: Vec<ComplexPart>,
    /// A step backwards of each mode: while velocities are sought, and in the end   (n_modes)
    backward_steps: [Vec<BackwardStep>; 2],
    poles: Vec<Pole>,
    /// What 1 N·s at each mass adds to each mode   (n_mat, n_modes)
    impulse_responses: Vec<Vec<Complex>>,
    dampers: Vec<Damper>,
    masses: Vec<f64>,
    time_step: f64,
    scratch: Scratch,
}

/// Working memory, so that a projection allocates nothing.
#[derive(Clone, Debug)]
struct Scratch {
    /// Displacements [m], velocities [m/s] and C·x [N·s/m·m]   (n_mat)
    displacements: Vec<f64>,
    velocities: Vec<f64>,
    damping_forces: Vec<f64>,
    /// Positions and steps of the motion that was found [m]   (n_mat)
    motions: Vec<(f64, f64)>,
    /// l·M·x, and the number of each mode   (n_modes)
    integrals: Vec<Complex>,
    numbers: Vec<Complex>,
}

impl StateProjection {
    /// For a body, some parts of its complex modes. Takes as long as computing them. `None` if it has none.
    pub(crate) fn new(network: &Network, parts: &[ComplexPart], rate: Rate) -> Option<Self> {
        let shapes = ModeShapes::complex(network, parts, rate)?;
        let body_modes = ComplexModes::new(network, &[] as &[Sum], &shapes.mats, rate).ok()?;
        let linear_body = Linear::new(network, rate).ok()?;
        if linear_body.free != shapes.mats || linear_body.proportion.is_some() {
            return None;
        }
        let (time_step, n_mat, n_modes) = (rate.step(), shapes.mats.len(), body_modes.len());
        let poles: Vec<Pole> = body_modes.poles.iter().map(|pole| pole.resolvable_at(rate)).collect();
        Some(Self {
            parts: parts.to_vec(),
            backward_steps: [
                poles
                    .iter()
                    .map(|pole| sought_pole(*pole, time_step).backward_step(time_step))
                    .collect(),
                poles.iter().map(|pole| pole.backward_step(time_step)).collect(),
            ],
            poles,
            impulse_responses: body_modes.struck_shapes,
            dampers: linear_body.dampers,
            masses: shapes.mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            time_step,
            shapes,
            scratch: Scratch {
                displacements: vec![0.0; n_mat],
                velocities: vec![0.0; n_mat],
                damping_forces: vec![0.0; n_mat],
                motions: vec![(0.0, 0.0); n_mat],
                integrals: vec![[0.0; 2]; n_modes],
                numbers: vec![[0.0; 2]; n_modes],
            },
        })
    }

    /// Its masses, by their index in the body's network   (n_mat)
    pub(crate) fn mats(&self) -> &[usize] {
        &self.shapes.mats
    }

    /// Number of parts.
    pub(crate) fn n_parts(&self) -> usize {
        self.parts.len()
    }

    /// Amplitudes of the parts now and one frame before, from positions of the masses and their last steps [m].
    pub(crate) fn amplitudes(&mut self, motions: &[(f64, f64)], now: &mut [f64], before: &mut [f64]) {
        let Scratch {
            displacements,
            velocities,
            damping_forces,
            motions: motions_reached,
            integrals,
            numbers,
        } = &mut self.scratch;
        for (((displacement, velocity), (x, step)), rest) in displacements
            .iter_mut()
            .zip(&mut *velocities)
            .zip(motions)
            .zip(self.shapes.rest())
        {
            (*displacement, *velocity) = (x - rest, step / self.time_step);
        }
        damping_forces.fill(0.0);
        for damper in &self.dampers {
            let [a, b] = damper.ends.map(|end| end.map_or(0.0, |end| displacements[end]));
            for (end, sign) in damper.ends.iter().zip([1.0, -1.0]) {
                if let Some(end) = *end {
                    damping_forces[end] += sign * damper.z * (a - b);
                }
            }
        }
        let masses = &self.masses;
        add_impulses(
            &self.impulse_responses,
            |mat| masses[mat] * displacements[mat],
            integrals,
        );
        for round in 0..=ROUNDS {
            let impulse = |mat: usize| damping_forces[mat] + masses[mat] * velocities[mat];
            add_impulses(&self.impulse_responses, impulse, numbers);
            for ((number, integral), pole) in numbers.iter_mut().zip(&*integrals).zip(&self.poles) {
                let change = time_derivative(*pole, *integral);
                *number = [number[0] + change[0], number[1] + change[1]];
            }
            let backward_steps = &self.backward_steps[usize::from(round == ROUNDS)];
            let values = now.iter_mut().zip(&mut *before);
            for ((now, before), part) in values.zip(&self.parts) {
                let number = numbers[part.mode];
                *now = number[part.sequence];
                *before = backward_steps[part.mode].apply(number)[part.sequence];
            }
            if round == ROUNDS {
                return;
            }
            self.shapes.positions(now, before, motions_reached);
            let steps = motions_reached.iter().zip(motions);
            for (velocity, ((_, step_reached), (_, step))) in velocities.iter_mut().zip(steps) {
                *velocity -= (step_reached - step) / self.time_step;
            }
        }
    }
}

/// The sum of what impulses add to each mode.
fn add_impulses(responses: &[Vec<Complex>], impulse_at: impl Fn(usize) -> f64, sums: &mut [Complex]) {
    sums.fill([0.0; 2]);
    for (mat, row) in responses.iter().enumerate() {
        let impulse = impulse_at(mat);
        for (sum, response) in sums.iter_mut().zip(row) {
            *sum = [sum[0] + impulse * response[0], sum[1] + impulse * response[1]];
        }
    }
}

/// ż of a mode that moves freely.
fn time_derivative(pole: Pole, [x, y]: Complex) -> Complex {
    match pole {
        Pole::Pair { decay, omega } => [-decay * x - omega * y, omega * x - decay * y],
        Pole::Real { decay } => [-decay * x, 0.0],
        Pole::Free => [y, 0.0],
    }
}

/// The pole with a decay that counts in a round.
fn sought_pole(pole: Pole, time_step: f64) -> Pole {
    match pole {
        Pole::Pair { decay, omega } => Pole::Pair {
            decay: decay.min(SOUGHT_DECAY_MAX / time_step),
            omega,
        },
        _ => pole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain that nothing holds, with other damping in each link: one pair of its modes does not oscillate.
    fn chain() -> Network {
        let mut network = Network::default();
        let masses = [
            (1e-3, 1e-4, 0.3),
            (2e-3, -2e-4, 0.0),
            (5e-4, 0.0, -0.2),
            (1e-3, 3e-4, 0.1),
        ];
        let mats: Vec<usize> = (masses.iter().enumerate())
            .map(|(i, &(m, x0, v0))| network.mas(&format!("m{i}"), m, x0, v0).unwrap())
            .collect();
        for (i, (k, z)) in [(4e4, 0.0), (1e5, 0.3), (1e3, 20.0)].into_iter().enumerate() {
            network
                .spring(&format!("r{i}"), mats[i], mats[i + 1], k, z, 0.0)
                .unwrap();
        }
        network
    }

    fn parts_of(modes: &ComplexModes) -> Vec<ComplexPart> {
        let signs = |pole: &Pole| match pole {
            Pole::Pair { .. } => vec![1.0, -1.0],
            Pole::Real { .. } => vec![1.0],
            Pole::Free => vec![1.0, 1.0],
        };
        let new_part = |mode: usize, part: usize, sign: f64| ComplexPart {
            mode,
            sequence: part,
            sign,
        };
        let modes = modes.poles.iter().enumerate();
        modes
            .flat_map(|(mode, pole)| {
                signs(pole)
                    .into_iter()
                    .enumerate()
                    .map(move |(part, sign)| new_part(mode, part, sign))
            })
            .collect()
    }

    #[test]
    fn projection_of_the_start_of_a_free_chain() {
        let (network, rate) = (chain(), Rate::new(44_100.0).unwrap());
        let modes = ComplexModes::new(&network, &[], &[], rate).unwrap();
        let parts = parts_of(&modes);
        let mut projection = StateProjection::new(&network, &parts, rate).unwrap();
        let start = &modes.start;
        let now: Vec<f64> = parts.iter().map(|part| start[part.mode][part.sequence]).collect();
        let number_before = |part: &ComplexPart| {
            modes.poles[part.mode]
                .backward_step(rate.step())
                .apply(start[part.mode])
        };
        let before: Vec<f64> = parts.iter().map(|part| number_before(part)[part.sequence]).collect();
        let mut motions = vec![(0.0, 0.0); 4];
        projection.shapes.positions(&now, &before, &mut motions);
        for ((x, _), x0) in motions.iter().zip(&network.mats().x0) {
            assert!((x - x0).abs() <= 1e-12, "the parts begin at X0: {x} {x0}");
        }
        let (mut now_again, mut before_again) = (vec![0.0; parts.len()], vec![0.0; parts.len()]);
        projection.amplitudes(&motions, &mut now_again, &mut before_again);
        let largest = now.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        for (part, (number, number_again)) in parts.iter().zip(now.iter().zip(&now_again)) {
            let error = (number - number_again).abs() / largest;
            assert!(
                error <= 1e-7,
                "{:?} {part:?}: {number} {number_again}",
                modes.poles[part.mode]
            );
        }
    }
}
