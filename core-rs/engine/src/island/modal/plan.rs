//! What a plan says of a body that goes by its modes.

use std::sync::Arc;

use crate::cell::{Cell, Response};
use crate::network::Network;
use crate::units::Rate;

/// A point of a body that other modules touch.
#[derive(Clone, Debug)]
pub(crate) struct Port {
    /// The MAT in the island.
    pub(crate) mat: usize,
    /// Where it is when the body rests [m].
    pub(crate) rest: f64,
    /// How much of it each mode gives and feels   (n_modes)
    pub(crate) shape: Vec<f64>,
}

/// Strikes on one point of a body.
#[derive(Clone, Debug)]
pub(crate) struct Struck {
    /// How much of them each mode feels   (n_modes)
    pub(crate) shape: Vec<f64>,
    /// Frame, part of a frame after it, impulse [N·s]; rising.
    pub(crate) blows: Vec<(u64, f64, f64)>,
}

/// κ = (ω₀T)² of a mode that nothing draws back, to rounding: all others have 1e-8 and more.
const LOOSE: f64 = 1e-12;

/// A mode of mass 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mode {
    /// x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// What a newton of one frame moves it by the next [m].
    pub(crate) gain: f64,
    pub(crate) now: f64,
    pub(crate) before: f64,
    /// Its continuous motion; none where a strike acts in one step.
    pub(crate) cell: Option<Cell>,
}

/// Which part of which complex mode an oscillator is, and the sign with which it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ComplexPart {
    pub(crate) mode: usize,
    pub(crate) part: usize,
    pub(crate) sign: f64,
}

/// How parts of complex modes answer: a push moves each in another phase, by where it acts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Answers {
    /// How many complex modes there are.
    pub(crate) n_modes: usize,
    /// Which part of which each is   (n_modes of the body)
    pub(crate) places: Vec<ComplexPart>,
    /// To 1 N·s at each port   (n_ports, n_modes)
    pub(crate) ports: Vec<Vec<Response>>,
    /// At each point that is struck   (n_struck, n_modes)
    pub(crate) struck: Vec<Vec<Response>>,
}

/// What a plan says of a body.
#[derive(Clone, Debug)]
pub(crate) struct Modal {
    /// The body by itself, and which of its modes these are.
    pub(crate) of: Arc<Network>,
    pub(crate) kept: Vec<u32>,
    /// Its MATs that modes of one frequency were turned towards; none where they are as they were found.
    pub(crate) turned: Option<Vec<usize>>,
    pub(crate) modes: Vec<Mode>,
    pub(crate) ports: Vec<Port>,
    /// Outputs that hear it, and how much of each mode   (n_modes)
    pub(crate) heard: Vec<(u32, Vec<f64>)>,
    /// What outputs hear of where it rests.
    pub(crate) still: Vec<f64>,
    pub(crate) struck: Vec<Struck>,
    pub(crate) rate: Rate,
    /// Where the modes are parts of complex ones; they are seen by their shapes.
    pub(crate) answers: Option<Answers>,
}

impl Modal {
    /// Whether the discrete network is the truth.
    pub(crate) fn is_discrete(&self) -> bool {
        self.answers.is_none() && self.modes.first().is_some_and(|mode| mode.cell.is_none())
    }

    /// What a newton of one frame at a port moves a mode by at the next frame, and at this one [m]: as if it had come from
    /// there.
    pub(crate) fn gain(&self, port: usize, mode: usize) -> [f64; 2] {
        match &self.answers {
            Some(answers) => {
                let (own, step) = (&answers.ports[port][mode], self.rate.step());
                [own.at(step) * step, own.at(0.0) * step]
            }
            None => [self.modes[mode].gain * self.ports[port].shape[mode], 0.0],
        }
    }

    /// How a mode goes on between two frames; none where the discrete network is the truth.
    pub(crate) fn response(&self, mode: usize) -> Option<Response> {
        match &self.answers {
            Some(answers) => answers.ports.first().map(|port| port[mode]),
            None => self.modes[mode].cell.map(Response::Cell),
        }
    }

    /// Started against forces that act on its ports at frame 0 (n_mat of the island): as any MAT, each mode
    /// comes from ½·F·gain further back.
    pub(crate) fn pushed(&self, force: &[f64]) -> Self {
        let mut own = self.clone();
        if let Some(answers) = &self.answers {
            let step = self.rate.step();
            for (answers, port) in answers.ports.iter().zip(&self.ports) {
                let impulse = 0.5 * step * force[port.mat];
                for (mode, answer) in own.modes.iter_mut().zip(answers) {
                    // As if it had been pushed half as long from the other side.
                    mode.now -= impulse * answer.at(0.0);
                    mode.before -= impulse * if mode.b == 0.0 { 0.0 } else { answer.at(-step) };
                }
            }
            return own;
        }
        for port in &self.ports {
            for (mode, share) in own.modes.iter_mut().zip(&port.shape) {
                if mode.cell.is_some() {
                    mode.before += 0.5 * mode.gain * share * force[port.mat];
                }
            }
        }
        own
    }

    /// Frequency of a mode [Hz], as its recurrence turns.
    pub(crate) fn frequency(&self, mode: usize) -> f64 {
        let Mode { a, b, .. } = self.modes[mode];
        if let Some(Response::Pair { omega, .. }) = self.response(mode) {
            return omega / std::f64::consts::TAU;
        }
        if b == 0.0 {
            return 0.0;
        }
        let cosine = (a / (2.0 * b.sqrt())).clamp(-1.0, 1.0);
        let angle = std::f64::consts::FRAC_PI_2 - crate::maths::asin(cosine);
        match self.modes[mode].cell {
            Some(cell) => cell.frequency(),
            None => angle * self.rate.hertz() / std::f64::consts::TAU,
        }
    }

    /// What a newton for ever moves a mode by [m]; none where nothing draws it back.
    pub(crate) fn compliance(&self, mode: usize) -> Option<f64> {
        let Mode { a, b, gain, .. } = self.modes[mode];
        let drawn = 1.0 - a + b;
        (drawn > LOOSE).then(|| gain / drawn)
    }

    /// Whether it has the same modes, seen alike: what strikes it may differ.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let numbers = |mode: &Mode| (mode.a, mode.b, mode.gain, mode.cell);
        let ports = |ports: &[Port]| -> Vec<(f64, Vec<f64>)> {
            ports
                .iter()
                .map(|port| (port.rest, port.shape.clone()))
                .collect()
        };
        let shapes = |modal: &Self| -> Vec<Vec<f64>> {
            modal.heard.iter().map(|(_, shape)| shape.clone()).collect()
        };
        self.rate.hertz() == other.rate.hertz()
            && self
                .modes
                .iter()
                .map(numbers)
                .eq(other.modes.iter().map(numbers))
            && ports(&self.ports) == ports(&other.ports)
            && self.still == other.still
            && shapes(self) == shapes(other)
            && self.answers.as_ref().map(|own| &own.ports)
                == other.answers.as_ref().map(|own| &own.ports)
    }

    /// With some of the modes only.
    pub(crate) fn only(&self, kept: &[usize]) -> Self {
        let some = |shape: &[f64]| kept.iter().map(|&mode| shape[mode]).collect();
        Self {
            of: self.of.clone(),
            kept: kept.iter().map(|&mode| self.kept[mode]).collect(),
            turned: self.turned.clone(),
            modes: kept.iter().map(|&mode| self.modes[mode]).collect(),
            ports: self
                .ports
                .iter()
                .map(|port| Port {
                    shape: some(&port.shape),
                    ..*port
                })
                .collect(),
            heard: self
                .heard
                .iter()
                .map(|(output, shape)| (*output, some(shape)))
                .collect(),
            still: self.still.clone(),
            struck: self
                .struck
                .iter()
                .map(|struck| Struck {
                    shape: some(&struck.shape),
                    blows: struck.blows.clone(),
                })
                .collect(),
            rate: self.rate,
            answers: self.answers.as_ref().map(|answers| {
                let some = |all: &Vec<Vec<Response>>| -> Vec<Vec<Response>> {
                    let points = all.iter();
                    points
                        .map(|point| kept.iter().map(|&mode| point[mode]).collect())
                        .collect()
                };
                Answers {
                    n_modes: answers.n_modes,
                    places: kept.iter().map(|&mode| answers.places[mode]).collect(),
                    ports: some(&answers.ports),
                    struck: some(&answers.struck),
                }
            }),
        }
    }

    /// What a newton of one frame at a port moves the port itself by the next [m].
    pub(crate) fn give(&self, port: usize) -> f64 {
        if self.answers.is_some() {
            let terms = self.ports[port].shape.iter().enumerate();
            return terms
                .map(|(mode, share)| share * self.gain(port, mode)[0])
                .sum();
        }
        let terms = self.modes.iter().zip(&self.ports[port].shape);
        terms.map(|(mode, share)| mode.gain * share * share).sum()
    }
}
