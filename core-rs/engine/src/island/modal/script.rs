//! The constant data of a running body: its modes in groups, as kernels take them.

use super::plan::{Modal, Mode};
use crate::kernel::bank::{GroupCoefficients, LANES, Lanes};

/// The constant data of a running body.
#[derive(Clone, Debug)]
pub(super) struct ModalScript {
    pub(super) plan: Modal,
    /// (n_groups)
    pub(super) coefficients: Vec<GroupCoefficients>,
    /// Groups with a mode above a quarter of the rate: at rest its zeros change their signs.
    pub(super) groups_with_changing_zeros: Vec<usize>,
    /// Weights of each group's modes in each row: ports first, then outputs   (n_groups, n_rows)
    pub(super) row_shapes: Vec<Vec<Lanes>>,
    /// Displacement of each group by 1 N at each port: at the next frame   (n_groups, n_ports)
    pub(super) port_gains: Vec<Vec<Lanes>>,
    /// The same at the present frame, for complex modes   (n_groups, n_ports), else empty
    pub(super) present_port_gains: Vec<Vec<Lanes>>,
    /// Displacement of each row at the next frame by 1 N at each port   (n_ports, n_rows)
    pub(super) row_displacements: Vec<Vec<f64>>,
    /// What `pushes::window_responses` says of it.
    pub(super) window_responses: Vec<f64>,
    /// By rising frame.
    pub(super) strike_steps: Vec<StrikeStep>,
}

/// A frame, the index of the struck point, the index of the blow at that point, and whether this is the second of its
/// two steps.
pub(super) type StrikeStep = (u64, usize, usize, bool);

/// One number of each mode of a group.
pub(super) fn lanes(modes: &[Mode], group: usize, value_of: impl Fn(usize) -> f64) -> Lanes {
    let mut group_lanes = Lanes::ZERO;
    let group_modes = group * LANES..modes.len().min((group + 1) * LANES);
    for (lane, mode) in group_lanes.0.iter_mut().zip(group_modes) {
        *lane = value_of(mode);
    }
    group_lanes
}

impl ModalScript {
    pub(super) fn new(plan: &Modal) -> Self {
        let modes = &plan.modes;
        let group_range = 0..modes.len().div_ceil(LANES);
        let ports = plan.ports.iter().map(|port| &port.shape);
        let row_shapes: Vec<&Vec<f64>> = ports.chain(plan.outputs.iter().map(|(_, shape)| shape)).collect();
        let port_displacements = |port: usize| {
            let row_displacement = |row: &&Vec<f64>| {
                (0..modes.len())
                    .map(|mode| row[mode] * plan.port_gain(port, mode)[0])
                    .sum()
            };
            row_shapes.iter().map(row_displacement).collect()
        };
        let group_rows = |group| {
            row_shapes
                .iter()
                .map(|row| lanes(modes, group, |mode| row[mode]))
                .collect()
        };
        let group_gains = |group, gain_index: usize| -> Vec<Lanes> {
            let ports = 0..plan.ports.len();
            ports
                .map(|port| lanes(modes, group, |mode| plan.port_gain(port, mode)[gain_index]))
                .collect()
        };
        let n_complex_groups = if plan.complex_responses.is_some() {
            group_range.len()
        } else {
            0
        };
        let is_above_quarter = |mode: &Mode| mode.a < 0.0;
        Self {
            coefficients: group_range
                .clone()
                .map(|group| GroupCoefficients {
                    a: lanes(modes, group, |mode| modes[mode].a),
                    b: lanes(modes, group, |mode| modes[mode].b),
                })
                .collect(),
            groups_with_changing_zeros: (modes.chunks(LANES).enumerate())
                .filter_map(|(group, modes)| modes.iter().any(is_above_quarter).then_some(group))
                .collect(),
            row_shapes: group_range.clone().map(group_rows).collect(),
            port_gains: group_range.map(|group| group_gains(group, 0)).collect(),
            present_port_gains: (0..n_complex_groups).map(|group| group_gains(group, 1)).collect(),
            row_displacements: (0..plan.ports.len()).map(port_displacements).collect(),
            window_responses: Vec::new(),
            strike_steps: strike_steps(plan),
            plan: plan.clone(),
        }
    }

    /// Write the effect of one blow on every mode into `kicks`.
    pub(super) fn write_kicks(&self, (_, point_index, blow_index, is_second_step): StrikeStep, kicks: &mut [Lanes]) {
        let struck_point = &self.plan.struck_points[point_index];
        let (_, frame_fraction, impulse) = struck_point.strikes[blow_index];
        let (rate, time_step) = (self.plan.rate, self.plan.rate.step());
        if let Some(complex_responses) = &self.plan.complex_responses {
            for (mode, response) in complex_responses.struck_responses[point_index].iter().enumerate() {
                let mode_kick =
                    response.split(impulse, frame_fraction, rate)[usize::from(is_second_step)] * time_step * time_step;
                kicks[mode / LANES].0[mode % LANES] = mode_kick;
            }
            return;
        }
        for (mode, mode_plan) in self.plan.modes.iter().enumerate() {
            let impulse = impulse * struck_point.shape[mode];
            let mode_kick = match mode_plan.cell {
                Some(cell) => {
                    cell.split(impulse, frame_fraction, rate)[usize::from(is_second_step)] * time_step * time_step
                }
                None => impulse * rate.hertz(),
            };
            kicks[mode / LANES].0[mode % LANES] = mode_kick;
        }
    }
}

fn strike_steps(plan: &Modal) -> Vec<StrikeStep> {
    let takes_two_steps = !plan.is_discrete();
    let mut strike_steps = Vec::new();
    for (point_index, struck_point) in plan.struck_points.iter().enumerate() {
        for (blow_index, &(frame, _, _)) in struck_point.strikes.iter().enumerate() {
            strike_steps.push((frame, point_index, blow_index, false));
            if takes_two_steps {
                strike_steps.push((frame + 1, point_index, blow_index, true));
            }
        }
    }
    strike_steps.sort_by_key(|strike_step| strike_step.0);
    strike_steps
}
