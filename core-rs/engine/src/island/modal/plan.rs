//! The plan of a body that is computed by its modes.

use std::sync::Arc;

use crate::body_modes::complex_modes::ComplexPart;
use crate::cell::{Cell, Response};
use crate::network::Network;
use crate::units::Rate;

/// A point of a body that other modules touch.
#[derive(Clone, Debug)]
pub(crate) struct Port {
    /// The MAT in the island.
    pub(crate) mat: usize,
    /// Its position when the body rests [m].
    pub(crate) rest_position: f64,
    /// Weight of each mode in its position, and of its force on each mode   (n_modes)
    pub(crate) shape: Vec<f64>,
}

/// Strikes on one point of a body.
#[derive(Clone, Debug)]
pub(crate) struct StruckPoint {
    /// Weight of a strike on each mode   (n_modes)
    pub(crate) shape: Vec<f64>,
    /// Frame, part of a frame after it, impulse [N·s]; rising.
    pub(crate) strikes: Vec<(u64, f64, f64)>,
}

/// κ = (ω₀T)² below which a mode has no restoring force but rounding: all others have 1e-8 and more.
const FREE_KAPPA_MAX: f64 = 1e-12;

/// A mode of mass 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mode {
    /// x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// Displacement at the next frame by 1 N during one frame [m].
    pub(crate) displacement_per_newton: f64,
    pub(crate) start_amplitude: f64,
    pub(crate) previous_amplitude: f64,
    /// Its continuous motion; `None` if a strike acts in one step.
    pub(crate) cell: Option<Cell>,
}

/// Responses of the parts of complex modes: a push moves each with a phase that depends on where it acts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ComplexResponses {
    /// Number of complex modes.
    pub(crate) n_modes: usize,
    /// The part of a complex mode that each mode is   (n_modes of the body)
    pub(crate) mode_parts: Vec<ComplexPart>,
    /// Responses to 1 N·s at each port   (n_ports, n_modes)
    pub(crate) port_responses: Vec<Vec<Response>>,
    /// Responses to 1 N·s at each point that is struck   (n_struck, n_modes)
    pub(crate) struck_responses: Vec<Vec<Response>>,
}

/// The plan of a body.
#[derive(Clone, Debug)]
pub(crate) struct Modal {
    /// The network of the body, and which of its modes these are.
    pub(crate) network: Arc<Network>,
    pub(crate) mode_numbers: Vec<u32>,
    /// MATs towards which modes of one frequency were turned; `None`: the modes are as they were found.
    pub(crate) alignment_mats: Option<Vec<usize>>,
    pub(crate) modes: Vec<Mode>,
    pub(crate) ports: Vec<Port>,
    /// Outputs that hear it, each with weights of the modes   (n_modes)
    pub(crate) outputs: Vec<(u32, Vec<f64>)>,
    /// Constant part of each of these outputs, from the rest position.
    pub(crate) rest_outputs: Vec<f64>,
    pub(crate) struck_points: Vec<StruckPoint>,
    pub(crate) rate: Rate,
    /// Responses, if the modes are parts of complex ones; ports and outputs see them by their shapes.
    pub(crate) complex_responses: Option<ComplexResponses>,
}

impl Modal {
    /// Whether the modes are those of the discrete network, and not of a continuous motion.
    pub(crate) fn is_discrete(&self) -> bool {
        self.complex_responses.is_none() && self.modes.first().is_some_and(|mode| mode.cell.is_none())
    }

    /// Displacement of a mode by 1 N during one frame at a port [m]: at the next frame, and at this one, so that the
    /// free motion from there on is that of the response.
    pub(crate) fn port_gain(&self, port: usize, mode: usize) -> [f64; 2] {
        match &self.complex_responses {
            Some(complex_responses) => {
                let (response, time_step) = (&complex_responses.port_responses[port][mode], self.rate.step());
                [
                    response.displacement(time_step) * time_step,
                    response.displacement(0.0) * time_step,
                ]
            }
            None => [
                self.modes[mode].displacement_per_newton * self.ports[port].shape[mode],
                0.0,
            ],
        }
    }

    /// The continuous motion of a mode between two frames; `None` for modes of the discrete network.
    pub(crate) fn response(&self, mode: usize) -> Option<Response> {
        match &self.complex_responses {
            Some(complex_responses) => complex_responses.port_responses.first().map(|port| port[mode]),
            None => self.modes[mode].cell.map(Response::Cell),
        }
    }

    /// The continuous motion of a mode after an impulse at a port, which contains the share of that port if the modes
    /// are complex; `None` for modes of the discrete network.
    pub(crate) fn port_response(&self, port: usize, mode: usize) -> Option<Response> {
        match &self.complex_responses {
            Some(complex_responses) => Some(complex_responses.port_responses[port][mode]),
            None => self.response(mode),
        }
    }

    /// The body started against forces that act on its ports at frame 0 (n_mat of the island): as for any MAT, the
    /// position of each mode one frame earlier is shifted by ½·F·gain.
    pub(crate) fn started_against(&self, force: &[f64]) -> Self {
        let mut pushed_plan = self.clone();
        if let Some(complex_responses) = &self.complex_responses {
            let time_step = self.rate.step();
            for (port_responses, port) in complex_responses.port_responses.iter().zip(&self.ports) {
                let impulse = 0.5 * time_step * force[port.mat];
                for (mode, response) in pushed_plan.modes.iter_mut().zip(port_responses) {
                    // The response to half the impulse of a frame is subtracted from both positions.
                    mode.start_amplitude -= impulse * response.displacement(0.0);
                    mode.previous_amplitude -= impulse
                        * if mode.b == 0.0 {
                            0.0
                        } else {
                            response.displacement(-time_step)
                        };
                }
            }
            return pushed_plan;
        }
        for port in &self.ports {
            for (mode, share) in pushed_plan.modes.iter_mut().zip(&port.shape) {
                if mode.cell.is_some() {
                    mode.previous_amplitude += 0.5 * mode.displacement_per_newton * share * force[port.mat];
                }
            }
        }
        pushed_plan
    }

    /// Frequency of a mode [Hz].
    pub(crate) fn frequency(&self, mode: usize) -> f64 {
        let Mode { a, b, .. } = self.modes[mode];
        if let Some(Response::Pair { omega, .. }) = self.response(mode) {
            return omega / std::f64::consts::TAU;
        }
        if b == 0.0 {
            return 0.0;
        }
        let cosine = (a / (2.0 * b.sqrt())).clamp(-1.0, 1.0);
        let step_angle = std::f64::consts::FRAC_PI_2 - crate::maths::asin(cosine);
        match self.modes[mode].cell {
            Some(cell) => cell.frequency(),
            None => step_angle * self.rate.hertz() / std::f64::consts::TAU,
        }
    }

    /// Static displacement of a mode under 1 N [m]; `None` if it has no restoring force.
    pub(crate) fn compliance(&self, mode: usize) -> Option<f64> {
        let Mode {
            a,
            b,
            displacement_per_newton,
            ..
        } = self.modes[mode];
        let restoring_factor = 1.0 - a + b;
        (restoring_factor > FREE_KAPPA_MAX).then(|| displacement_per_newton / restoring_factor)
    }

    /// Whether another body has the same modes and shapes; its strikes may differ.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let coefficients = |mode: &Mode| (mode.a, mode.b, mode.displacement_per_newton, mode.cell);
        let port_shapes = |ports: &[Port]| -> Vec<(f64, Vec<f64>)> {
            ports
                .iter()
                .map(|port| (port.rest_position, port.shape.clone()))
                .collect()
        };
        let output_shapes =
            |modal: &Self| -> Vec<Vec<f64>> { modal.outputs.iter().map(|(_, shape)| shape.clone()).collect() };
        self.rate.hertz() == other.rate.hertz()
            && self
                .modes
                .iter()
                .map(coefficients)
                .eq(other.modes.iter().map(coefficients))
            && port_shapes(&self.ports) == port_shapes(&other.ports)
            && self.rest_outputs == other.rest_outputs
            && output_shapes(self) == output_shapes(other)
            && self
                .complex_responses
                .as_ref()
                .map(|complex_responses| &complex_responses.port_responses)
                == other
                    .complex_responses
                    .as_ref()
                    .map(|complex_responses| &complex_responses.port_responses)
    }

    /// The body with some of its modes only.
    pub(crate) fn with_modes(&self, mode_indices: &[usize]) -> Self {
        let select_modes = |shape: &[f64]| mode_indices.iter().map(|&mode| shape[mode]).collect();
        Self {
            network: self.network.clone(),
            mode_numbers: mode_indices.iter().map(|&mode| self.mode_numbers[mode]).collect(),
            alignment_mats: self.alignment_mats.clone(),
            modes: mode_indices.iter().map(|&mode| self.modes[mode]).collect(),
            ports: self
                .ports
                .iter()
                .map(|port| Port {
                    shape: select_modes(&port.shape),
                    ..*port
                })
                .collect(),
            outputs: self
                .outputs
                .iter()
                .map(|(output, shape)| (*output, select_modes(shape)))
                .collect(),
            rest_outputs: self.rest_outputs.clone(),
            struck_points: self
                .struck_points
                .iter()
                .map(|struck_point| StruckPoint {
                    shape: select_modes(&struck_point.shape),
                    strikes: struck_point.strikes.clone(),
                })
                .collect(),
            rate: self.rate,
            complex_responses: self.complex_responses.as_ref().map(|complex_responses| {
                let select_modes = |responses: &Vec<Vec<Response>>| -> Vec<Vec<Response>> {
                    let point_responses = responses.iter();
                    point_responses
                        .map(|point| mode_indices.iter().map(|&mode| point[mode]).collect())
                        .collect()
                };
                ComplexResponses {
                    n_modes: complex_responses.n_modes,
                    mode_parts: mode_indices
                        .iter()
                        .map(|&mode| complex_responses.mode_parts[mode])
                        .collect(),
                    port_responses: select_modes(&complex_responses.port_responses),
                    struck_responses: select_modes(&complex_responses.struck_responses),
                }
            }),
        }
    }

    /// Displacement of a port at the next frame by 1 N on it during one frame [m].
    pub(crate) fn port_compliance(&self, port: usize) -> f64 {
        if self.complex_responses.is_some() {
            let shape_terms = self.ports[port].shape.iter().enumerate();
            return shape_terms
                .map(|(mode, share)| share * self.port_gain(port, mode)[0])
                .sum();
        }
        let shape_terms = self.modes.iter().zip(&self.ports[port].shape);
        shape_terms
            .map(|(mode, share)| mode.displacement_per_newton * share * share)
            .sum()
    }
}
