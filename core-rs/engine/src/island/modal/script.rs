//! The constant data of a running body: its modes in groups, as kernels take them.

use super::plan::{Modal, Mode};
use crate::kernel::bank::{LANES, Lanes, Rates};

/// The constant data of a running body.
#[derive(Clone, Debug)]
pub(super) struct Script {
    pub(super) plan: Modal,
    /// (n_groups)
    pub(super) rates: Vec<Rates>,
    /// Weights of each group's modes in each row: ports first, then outputs   (n_groups, n_rows)
    pub(super) rows: Vec<Vec<Lanes>>,
    /// Displacement of each group by 1 N at each port: at the next frame   (n_groups, n_ports)
    pub(super) gains: Vec<Vec<Lanes>>,
    /// The same at the present frame, for complex modes   (n_groups, n_ports), else empty
    pub(super) back_gains: Vec<Vec<Lanes>>,
    /// Displacement of each row at the next frame by 1 N at each port   (n_rows, n_ports)
    pub(super) moves: Vec<Vec<f64>>,
    /// What `pushes::responses` says of it.
    pub(super) responses: Vec<f64>,
    /// By rising frame.
    pub(super) blows: Vec<Blow>,
}

/// A frame, the index of the struck point, the index of the blow at that point, and whether this is the second of its
/// two steps.
pub(super) type Blow = (u64, usize, usize, bool);

/// One number of each mode of a group.
pub(super) fn lanes(modes: &[Mode], group: usize, value_of: impl Fn(usize) -> f64) -> Lanes {
    let mut lanes = Lanes::ZERO;
    let members = group * LANES..modes.len().min((group + 1) * LANES);
    for (lane, mode) in lanes.0.iter_mut().zip(members) {
        *lane = value_of(mode);
    }
    lanes
}

impl Script {
    pub(super) fn new(plan: &Modal) -> Self {
        let modes = &plan.modes;
        let groups = 0..modes.len().div_ceil(LANES);
        let ports = plan.ports.iter().map(|port| &port.shape);
        let rows: Vec<&Vec<f64>> = ports
            .chain(plan.outputs.iter().map(|(_, shape)| shape))
            .collect();
        let moves = |row: &[f64]| {
            let by = |port| {
                (0..modes.len())
                    .map(|mode| row[mode] * plan.gain(port, mode)[0])
                    .sum()
            };
            (0..plan.ports.len()).map(by).collect()
        };
        let group_rows = |group| {
            rows.iter()
                .map(|row| lanes(modes, group, |mode| row[mode]))
                .collect()
        };
        let group_gains = |group, which: usize| -> Vec<Lanes> {
            let ports = 0..plan.ports.len();
            ports
                .map(|port| lanes(modes, group, |mode| plan.gain(port, mode)[which]))
                .collect()
        };
        let n_back = if plan.answers.is_some() {
            groups.len()
        } else {
            0
        };
        Self {
            rates: groups
                .clone()
                .map(|group| Rates {
                    a: lanes(modes, group, |mode| modes[mode].a),
                    b: lanes(modes, group, |mode| modes[mode].b),
                })
                .collect(),
            rows: groups.clone().map(group_rows).collect(),
            gains: groups.map(|group| group_gains(group, 0)).collect(),
            back_gains: (0..n_back).map(|group| group_gains(group, 1)).collect(),
            moves: rows.iter().map(|row| moves(row)).collect(),
            responses: Vec::new(),
            blows: blows(plan),
            plan: plan.clone(),
        }
    }

    /// Write the effect of one blow on every mode into `kicks`.
    pub(super) fn strike(&self, (_, strikes, blow, second): Blow, kicks: &mut [Lanes]) {
        let struck = &self.plan.struck[strikes];
        let (_, alpha, impulse) = struck.blows[blow];
        let (rate, step) = (self.plan.rate, self.plan.rate.step());
        if let Some(answers) = &self.plan.answers {
            for (mode, answer) in answers.struck[strikes].iter().enumerate() {
                let by = answer.split(impulse, alpha, rate)[usize::from(second)] * step * step;
                kicks[mode / LANES].0[mode % LANES] = by;
            }
            return;
        }
        for (mode, mode_plan) in self.plan.modes.iter().enumerate() {
            let impulse = impulse * struck.shape[mode];
            let by = match mode_plan.cell {
                Some(cell) => cell.split(impulse, alpha, rate)[usize::from(second)] * step * step,
                None => impulse * rate.hertz(),
            };
            kicks[mode / LANES].0[mode % LANES] = by;
        }
    }
}

fn blows(plan: &Modal) -> Vec<Blow> {
    let in_two = !plan.is_discrete();
    let mut blows = Vec::new();
    for (strikes, struck) in plan.struck.iter().enumerate() {
        for (blow, &(frame, _, _)) in struck.blows.iter().enumerate() {
            blows.push((frame, strikes, blow, false));
            if in_two {
                blows.push((frame + 1, strikes, blow, true));
            }
        }
    }
    blows.sort_by_key(|blow| blow.0);
    blows
}
