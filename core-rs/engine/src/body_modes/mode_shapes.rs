//! The positions of all MATs of a body from the amplitudes of its modes, and the reverse.

use crate::body_modes::complex_modes::ComplexPart;
use crate::body_modes::complex_modes::{ComplexModes, Sum};
use crate::body_modes::normal_modes::{Modes, Row};
use crate::network::Network;
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
    /// For a body, the modes `mode_numbers`, rotated towards some MATs. Takes at least as long as computing its whole
    /// spectrum.
    /// `None` if it has no modes.
    pub(crate) fn new(
        network: &Network,
        (mode_numbers, rotation_mats): (&[u32], Option<&[usize]>),
        rate: Rate,
        transform: ModalTransform,
    ) -> Option<Self> {
        let mat_kinds = network.mats().kind.iter().enumerate();
        let moving_mats = mat_kinds.filter(|(_, kind)| kind.moves());
        let mats: Vec<usize> = moving_mats.map(|(mat, _)| mat).collect();
        let mat_rows: Vec<Row> = mats.iter().map(|&mat| vec![(mat, 1.0)]).collect();
        let mut body_modes = Modes::new(network, &mat_rows, rate).ok()?;
        if let Some(direction_mats) = rotation_mats {
            let row_of_mat = |mat: &usize| mats.binary_search(mat).ok();
            let rotation_rows: Vec<usize> = direction_mats.iter().filter_map(row_of_mat).collect();
            body_modes.rotate(&rotation_rows, rate);
        }
        if mode_numbers.iter().any(|&mode| mode as usize >= body_modes.len()) {
            return None;
        }
        let rest_position = |shape: &Vec<f64>| shape.iter().zip(&body_modes.rest).map(|(a, b)| a * b).sum();
        let mode_share = |row: usize, mode: u32| body_modes.shapes[row][mode as usize];
        let mat_indices = 0..mats.len();
        let shapes = match transform {
            ModalTransform::ToPositions => mode_numbers
                .iter()
                .flat_map(|&mode| mat_indices.clone().map(|mat| mode_share(mat, mode)).collect::<Vec<_>>())
                .collect(),
            ModalTransform::ToAmplitudes => mat_indices
                .flat_map(|mat| {
                    mode_numbers
                        .iter()
                        .map(|&mode| mode_share(mat, mode))
                        .collect::<Vec<_>>()
                })
                .collect(),
        };
        Some(Self {
            shapes,
            rest: body_modes.shapes.iter().map(rest_position).collect(),
            mass: mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            n_modes: mode_numbers.len(),
            mats,
        })
    }

    /// For a body, parts of its complex modes, for positions. Takes as long as computing them. `None` if it has none.
    pub(crate) fn complex(network: &Network, parts: &[ComplexPart], rate: Rate) -> Option<Self> {
        let mat_kinds = network.mats().kind.iter().enumerate();
        let moving_mats = mat_kinds.filter(|(_, kind)| kind.moves());
        let mats: Vec<usize> = moving_mats.map(|(mat, _)| mat).collect();
        let mat_sums: Vec<Sum> = mats.iter().map(|&mat| Sum::from_positions(vec![(mat, 1.0)])).collect();
        let body_modes = ComplexModes::new(network, &mat_sums, &[], rate).ok()?;
        if parts.iter().any(|part| part.mode >= body_modes.len()) {
            return None;
        }
        let part_share =
            |part: &ComplexPart, mat: usize| part.sign * body_modes.output_shapes[mat][part.mode][part.sequence];
        let mat_indices = 0..mats.len();
        let shapes = parts
            .iter()
            .flat_map(|part| mat_indices.clone().map(|mat| part_share(part, mat)).collect::<Vec<_>>());
        Some(Self {
            shapes: shapes.collect(),
            rest: body_modes.rest.clone(),
            mass: mats.iter().map(|&mat| network.mats().m[mat]).collect(),
            n_modes: parts.len(),
            mats,
        })
    }

    /// The shape of a mode at each of its MATs   (n); only if the table is for positions.
    pub(crate) fn shape(&self, mode: usize) -> &[f64] {
        let mat_count = self.mats.len();
        &self.shapes[mode * mat_count..(mode + 1) * mat_count]
    }

    /// Where its MATs are when it rests [m]   (n)
    pub(crate) fn rest(&self) -> &[f64] {
        &self.rest
    }

    /// Positions of its MATs and their last steps [m], from amplitudes now and one frame before.
    pub(crate) fn positions(&self, now: &[f64], before: &[f64], motions: &mut [(f64, f64)]) {
        for (motion, &rest) in motions.iter_mut().zip(&self.rest) {
            *motion = (rest, 0.0);
        }
        let amplitude_pairs = now.iter().zip(before);
        for (shape, (now, before)) in self.shapes.chunks(self.mats.len().max(1)).zip(amplitude_pairs) {
            let amplitude_step = now - before;
            for ((x, d), share) in motions.iter_mut().zip(shape) {
                *x += share * now;
                *d += share * amplitude_step;
            }
        }
    }

    /// Amplitudes now and one frame before, from positions of its MATs and their last steps [m].
    pub(crate) fn amplitudes(&self, motions: &[(f64, f64)], now: &mut [f64], before: &mut [f64]) {
        now.fill(0.0);
        before.fill(0.0);
        let shape_rows = self.shapes.chunks(self.n_modes.max(1));
        let rest_masses = self.rest.iter().zip(&self.mass);
        for (&(x, step), (row, (rest, mass))) in motions.iter().zip(shape_rows.zip(rest_masses)) {
            let (weighted_now, weighted_before) = (mass * (x - rest), mass * (x - step - rest));
            for ((share, now), before) in row.iter().zip(&mut *now).zip(&mut *before) {
                *now += share * weighted_now;
                *before += share * weighted_before;
            }
        }
    }

    /// How many modes are computed.
    pub(crate) fn n_modes(&self) -> usize {
        self.n_modes
    }
}
