//! What is constant of dry friction between frames: its links, the length of its steps, and how forces change
//! velocities.

use super::{SKIPPED_SHARE, STEPS_MAX};
use crate::island::fine::FineScript;
use crate::island::fine::basis::{Instant, dot};
use crate::island::fine::laws::{GAUSS_POINTS, GAUSS_WEIGHTS, STAGES, StageMatrix, lagrange_weights};
use crate::network::Dry;
use crate::scheme::{LinkRun, LinkRunKind};

#[derive(Clone, Debug)]
pub(in crate::island::fine) struct SlideScript {
    /// Indices of the dry frictions among the script's links   (n_dry)
    pub(super) links: Vec<usize>,
    /// Friction of each link, and frames a second   (n_dry)
    pub(super) dry_laws: Vec<(Dry, f64)>,
    /// Steps without events: while every link holds or slides at a constant level, and while a level falls.
    even_steps: [EvenSteps; 2],
    /// Response of each velocity to an impulse of each link, by the time since the impulse, as coefficients of the
    /// basis [m/frame per N·s]; empty if there is none   (n_dry², n)
    pub(super) responses: Vec<Vec<f64>>,
}

/// Even steps of a frame.
#[derive(Clone, Debug)]
pub(super) struct EvenSteps {
    /// Steps of a frame.
    steps_per_frame: usize,
    /// Response of each velocity to the force of each link, at the Gauss points of such a step [m/frame per N]
    /// (n_dry²)
    pub(super) velocity_responses: Vec<StageMatrix>,
}

impl SlideScript {
    pub(super) fn new(script: &FineScript) -> Self {
        let dry_friction = |(link, run): (usize, &LinkRun)| match &run.kind {
            LinkRunKind::Dry {
                law: friction,
                velocity_factor,
            } => Some((link, (*friction, *velocity_factor))),
            _ => None,
        };
        let dry_links = script.links.iter().enumerate().filter_map(dry_friction);
        let (links, dry_laws): (Vec<usize>, Vec<(Dry, f64)>) = dry_links.unzip();
        let step_count = |(&link, &(friction, velocity_factor)): (&usize, &(Dry, f64))| {
            let (first_joint, second_joint) = script.link_joints[link];
            friction
                .with(script.links[link].z)
                .steps(velocity_factor * script.velocity_jump(first_joint, second_joint) * script.rate.step())
        };
        let step_factor = links.iter().zip(&dry_laws).map(step_count).fold(1.0, f64::max);
        let slow_steps = (script.steps_min / 2).max(1);
        let fast_steps = (slow_steps as f64 * step_factor).ceil().min(STEPS_MAX as f64 / 4.0) as usize;
        let end_pairs = links.iter().flat_map(|&to_link| {
            let from_links = links.iter();
            from_links.map(move |&from_link| [script.link_joints[to_link], script.link_joints[from_link]])
        });
        let responses: Vec<Vec<f64>> = end_pairs.map(|ends| velocity_response(script, ends)).collect();
        Self {
            even_steps: [slow_steps, fast_steps].map(|steps| EvenSteps::new(script, steps, &responses)),
            responses,
            links,
            dry_laws,
        }
    }

    /// The fast steps if `level_falls` (a link slides at a level that falls with the velocity), else the slow ones.
    pub(super) fn even_steps(&self, level_falls: bool) -> &EvenSteps {
        &self.even_steps[usize::from(level_falls)]
    }
}

impl EvenSteps {
    fn new(script: &FineScript, steps_per_frame: usize, responses: &[Vec<f64>]) -> Self {
        let integrals = ResponseIntegrals::new(script, 1.0 / steps_per_frame as f64);
        let integral = |response: &Vec<f64>| integrals.velocity_response(response);
        Self {
            steps_per_frame,
            velocity_responses: responses.iter().map(integral).collect(),
        }
    }

    /// Length of a step that starts at an instant: the rest of the frame in even steps.
    pub(super) fn length(&self, s: f64) -> f64 {
        let frame_left = 1.0 - s;
        frame_left
            / (frame_left * self.steps_per_frame as f64 - SKIPPED_SHARE)
                .ceil()
                .max(1.0)
    }

    /// Whether a step has the length of the even steps.
    pub(super) fn is_even(&self, h: f64) -> bool {
        (h * self.steps_per_frame as f64 - 1.0).abs() < SKIPPED_SHARE
    }
}

/// Response of the velocity of a link to an impulse of another one, as [`SlideScript::responses`] holds it.
fn velocity_response(script: &FineScript, ends: [(usize, usize); 2]) -> Vec<f64> {
    let n_instants = script.basis.n_polynomials();
    let start_instant = Instant::new(n_instants, 0.0);
    let velocities: Vec<f64> = (script.basis.instants.iter())
        .map(|&s| script.elongation_response(ends, [&start_instant, &Instant::new(n_instants, s)])[1])
        .collect();
    if velocities.iter().all(|value| *value == 0.0) {
        return Vec::new();
    }
    let mut response = vec![0.0; n_instants];
    script.basis.fit(&velocities, &mut response);
    response
}

/// Integrals of a response over a step, up to each of its Gauss points; by Gauss quadrature, exact to order 6.
pub(super) struct ResponseIntegrals {
    /// Time from each inner point to the outer one   (outer, inner)
    times_since: [[Instant; STAGES]; STAGES],
    /// Weight of the force at each Gauss point in that at each inner point [s]   (outer, inner, Gauss point)
    weights: [StageMatrix; STAGES],
}

impl ResponseIntegrals {
    /// Of a step of `h` frames.
    pub(super) fn new(script: &FineScript, h: f64) -> Self {
        let (n_instants, step_seconds) = (script.basis.n_polynomials(), h * script.rate.step());
        Self {
            times_since: GAUSS_POINTS.map(|outer_point| {
                GAUSS_POINTS.map(|inner_point| Instant::new(n_instants, outer_point * (1.0 - inner_point) * h))
            }),
            weights: GAUSS_POINTS.map(|outer_point| {
                std::array::from_fn(|inner| {
                    let inner_weight = GAUSS_WEIGHTS[inner] * outer_point * step_seconds;
                    lagrange_weights(GAUSS_POINTS[inner] * outer_point).map(|share| inner_weight * share)
                })
            }),
        }
    }

    /// Response of a velocity to the forces of the step, at its Gauss points [m/frame per N].
    pub(super) fn velocity_response(&self, response: &[f64]) -> StageMatrix {
        let mut integrals = StageMatrix::default();
        if response.is_empty() {
            return integrals;
        }
        for (outer, outer_integrals) in integrals.iter_mut().enumerate() {
            for (time_since, inner_weights) in self.times_since[outer].iter().zip(&self.weights[outer]) {
                let response_since = dot(response, &time_since.values);
                for (integral, weight) in outer_integrals.iter_mut().zip(inner_weights) {
                    *integral += response_since * weight;
                }
            }
        }
        integrals
    }
}
