//! The positions of all MATs of a body from the amplitudes of its modes, and the reverse.

use crate::island::modal::ComplexPart;
use crate::network::Network;
use crate::plan::passes::complex_modes::{ComplexModes, Sum};
use crate::plan::passes::modes::{Modes, Row};
use crate::units::Rate;

/// Which transform a table of mode shapes is for: it is stored in the order in which that transform reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ModalTransform {
    /// From amplitudes to positions.
    ToPositions,
    /// From positions to amplitudes.
    ToAmplitudes,
}

/// The shapes of the computed modes at every mass of a body.
#[derive(Clone, Debug)]
pub(crate) struct ModeShapes {
    /// Its MATs that move, by their index in the body's network   (n)
    pub(crate) mats: Vec<usize>,
    /// How much of each mode is in the position of each MAT   (n_modes, n) for positions, (n, n_modes) for amplitudes
    shapes: Vec<f64>,
    n_modes: usize,
    mass: Vec<f64>,
    rest: Vec<f64>,
}

impl ModeShapes {
    /// For a body, the modes `mode_numbers`, rotated towards some MATs. Takes at least as long as computing its whole spectrum.
    /// `None` if it has no modes.
    pub(crate) fn new(
        network: &Network,
        (mode_numbers, turned): (&[u32], Option<&[usize]>),
        rate: Rate,
        transform: ModalTransform,
    ) -> Option<Self> {
        let kinds = network.mats().kind.iter().enumerate();
        let moving = kinds.filter(|(_, kind)| kind.moves());
        let mats: Vec<usize> = moving.map(|(mat, _)| mat).collect();
        let rows: Vec<Row> = mats.iter().map(|&mat| vec![(mat, 1.0)]).collect();
        let mut modes = Modes::new(network, &rows, rate).ok()?;
        if let Some(towards) = turned {
            let row = |mat: &usize| mats.binary_search(mat).ok();
            let moved: Vec<usize> = towards.iter().filter_map(row).collect();
            modes.rotate(&moved, rate);
        }
        if mode_numbers
            .iter()
            .any(|&mode| mode as usize >= modes.len())
        {
            return None;
        }
        let rest = |shape: &Vec<f64>| shape.iter().zip(&modes.rest).map(|(a, b)| a * b).sum();
        let share = |mat: usize, mode: u32| modes.shapes[mat][mode as usize];
        let all = 0..mats.len();
        let shapes = match transform {
            ModalTransform::ToPositions => mode_numbers
                .iter()
                .flat_map(|&mode| all.clone().map(|mat| share(mat, mode)).collect::<Vec<_>>())
                .collect(),
            ModalTransform::ToAmplitudes => all
                .flat_map(|mat| {
                    mode_numbers
                        .iter()
                        .map(|&mode| share(mat, mode))
                        .collect::<Vec<_>>()
                })
                .collect(),
        };
        Some(Self {
            shapes,
            rest: modes.shapes.iter().map(rest).collect(),
            mass: mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            n_modes: mode_numbers.len(),
            mats,
        })
    }

    /// For a body, parts of its complex modes, for positions. Takes as long as computing them. `None` if it has none.
    pub(crate) fn complex(network: &Network, parts: &[ComplexPart], rate: Rate) -> Option<Self> {
        let kinds = network.mats().kind.iter().enumerate();
        let moving = kinds.filter(|(_, kind)| kind.moves());
        let mats: Vec<usize> = moving.map(|(mat, _)| mat).collect();
        let sums: Vec<Sum> = mats
            .iter()
            .map(|&mat| Sum::from_positions(vec![(mat, 1.0)]))
            .collect();
        let modes = ComplexModes::new(network, &sums, &[], rate).ok()?;
        if parts.iter().any(|own| own.mode >= modes.len()) {
            return None;
        }
        let share = |own: &ComplexPart, mat: usize| own.sign * modes.seen[mat][own.mode][own.part];
        let all = 0..mats.len();
        let shapes = parts
            .iter()
            .flat_map(|own| all.clone().map(|mat| share(own, mat)).collect::<Vec<_>>());
        Some(Self {
            shapes: shapes.collect(),
            rest: modes.rest.clone(),
            mass: mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            n_modes: parts.len(),
            mats,
        })
    }

    /// The shape of a mode at each of its MATs   (n); only if the table is for positions.
    pub(crate) fn shape(&self, mode: usize) -> &[f64] {
        let n = self.mats.len();
        &self.shapes[mode * n..(mode + 1) * n]
    }

    /// Where its MATs are when it rests [m]   (n)
    pub(crate) fn rest(&self) -> &[f64] {
        &self.rest
    }

    /// Positions of its MATs and their last steps [m], from amplitudes now and one frame before.
    pub(crate) fn positions(&self, now: &[f64], before: &[f64], mats: &mut [(f64, f64)]) {
        for (mat, &rest) in mats.iter_mut().zip(&self.rest) {
            *mat = (rest, 0.0);
        }
        let modes = now.iter().zip(before);
        for (shape, (now, before)) in self.shapes.chunks(self.mats.len().max(1)).zip(modes) {
            let step = now - before;
            for ((x, d), share) in mats.iter_mut().zip(shape) {
                *x += share * now;
                *d += share * step;
            }
        }
    }

    /// Amplitudes now and one frame before, from positions of its MATs and their last steps [m].
    pub(crate) fn amplitudes(&self, mats: &[(f64, f64)], now: &mut [f64], before: &mut [f64]) {
        now.fill(0.0);
        before.fill(0.0);
        let rows = self.shapes.chunks(self.n_modes.max(1));
        let mats_of_rest = self.rest.iter().zip(&self.mass);
        for (&(x, step), (row, (rest, mass))) in mats.iter().zip(rows.zip(mats_of_rest)) {
            let (x, was) = (mass * (x - rest), mass * (x - step - rest));
            for ((share, now), before) in row.iter().zip(&mut *now).zip(&mut *before) {
                *now += share * x;
                *before += share * was;
            }
        }
    }

    /// How many modes are computed.
    pub(crate) fn n_modes(&self) -> usize {
        self.n_modes
    }
}
