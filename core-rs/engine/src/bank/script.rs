//! Oscillators of a bank in groups of lanes, and the blows that each group receives.

use std::ops::Range;

use super::{Kick, Oscillator, Strikes};
use crate::kernel::bank::{GroupCoefficients, GroupMotion, LANES, Lanes};
use crate::units::Rate;

/// A blow on one lane of a group or on all lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct BankEvent {
    pub(super) frame: u64,
    pub(super) lanes: EventLanes,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum EventLanes {
    Lane(u32, Kick),
    /// Index of the strikes, index of the blow, and whether this is the second of its two steps.
    Group(u32, u32, bool),
}

/// Groups of oscillators with the same outputs.
#[derive(Clone, Debug)]
pub(super) struct OutputSection {
    pub(super) outputs: Vec<u32>,
    pub(super) groups: Range<usize>,
}

/// The constant part of a bank.
#[derive(Clone, Debug)]
pub(super) struct BankScript {
    pub(super) rate: Rate,
    pub(super) sections: Vec<OutputSection>,
    /// (n_groups)
    pub(super) coefficients: Vec<GroupCoefficients>,
    /// Weights of groups with several outputs, output by output; empty for one output   (n_groups)
    pub(super) weights: Vec<Vec<Lanes>>,
    /// Scale of the positions in the lanes: the weight if there is one output, otherwise 1   (n_groups)
    pub(super) scales: Vec<Lanes>,
    /// By rising frame   (n_groups)
    pub(super) events: Vec<Vec<BankEvent>>,
    pub(super) strikes: Vec<Strikes>,
    /// Sum of amplitudes below which a group is set to rest.
    pub(super) rest_threshold: f64,
    /// Group and lane of each oscillator, in the order of the list that the bank is made from.
    pub(super) groups_and_lanes: Vec<(u32, u32)>,
    /// The oscillator of each lane, if it has one   (n_groups · LANES)
    pub(super) members: Vec<Option<u32>>,
}

impl BankScript {
    /// Add a group of oscillators with the same outputs; returns its motion at frame 0.
    pub(super) fn add_group(&mut self, oscillators: &[Oscillator], members: &[usize]) -> GroupMotion {
        let gather_lanes = |value_of: &dyn Fn(&Oscillator) -> f64| {
            let mut gathered_lanes = Lanes::ZERO;
            for (lane, &member) in gathered_lanes.0.iter_mut().zip(members) {
                *lane = value_of(&oscillators[member]);
            }
            gathered_lanes
        };
        let group_index = self.coefficients.len();
        let n_outputs = oscillators[members[0]].outputs.len();
        // With one output, the lanes hold positions times their weights: the sum then needs no weights.
        let output_scale = |oscillator: &Oscillator| match oscillator.outputs[..] {
            [(_, weight)] => weight,
            _ => 1.0,
        };
        self.coefficients.push(GroupCoefficients {
            a: gather_lanes(&|oscillator| oscillator.a),
            b: gather_lanes(&|oscillator| oscillator.b),
        });
        let weights = if n_outputs == 1 { 0 } else { n_outputs };
        self.weights.push(
            (0..weights)
                .map(|output| gather_lanes(&|oscillator| oscillator.outputs[output].1))
                .collect(),
        );
        self.scales.push(gather_lanes(&output_scale));
        let mut group_events = Vec::new();
        for (lane, &member) in members.iter().enumerate() {
            self.groups_and_lanes[member] = (group_index as u32, lane as u32);
            for blow in &oscillators[member].blows {
                group_events.push(BankEvent {
                    frame: blow.frame,
                    lanes: EventLanes::Lane(lane as u32, blow.kick),
                });
            }
        }
        self.events.push(group_events);
        let indices = members.iter().map(|&member| Some(member as u32));
        self.members.extend(indices);
        self.members.resize(self.coefficients.len() * LANES, None);
        GroupMotion {
            positions: gather_lanes(&|oscillator| output_scale(oscillator) * oscillator.position),
            previous_positions: gather_lanes(&|oscillator| output_scale(oscillator) * oscillator.previous_position),
        }
    }

    /// Add shared strikes to the events of every group, and sort the events.
    pub(super) fn add_strikes(&mut self) {
        for (index, strikes) in self.strikes.iter().enumerate() {
            let mut struck_groups: Vec<u32> = self.groups_and_lanes[strikes.members.clone()]
                .iter()
                .map(|&(group, _)| group)
                .collect();
            struck_groups.sort_unstable();
            struck_groups.dedup();
            let split_steps: &[bool] = if strikes.responses.is_empty() {
                &[false]
            } else {
                &[false, true]
            };
            for group in struck_groups {
                for (blow, &(frame, _, _)) in strikes.blows.iter().enumerate() {
                    for &is_second_step in split_steps {
                        self.events[group as usize].push(BankEvent {
                            frame: frame + u64::from(is_second_step),
                            lanes: EventLanes::Group(index as u32, blow as u32, is_second_step),
                        });
                    }
                }
            }
        }
        for events in &mut self.events {
            events.sort_by_key(|event| event.frame);
        }
    }

    /// Add the displacements by an event to `added`; `motion`: positions of the group at the frame of the event.
    pub(super) fn add_event(&self, group: usize, motion: &GroupMotion, event: &BankEvent, added: &mut Lanes) {
        let lane_scales = &self.scales[group].0;
        match event.lanes {
            EventLanes::Lane(lane_index, Kick::Displacement(x)) => {
                let lane_index = lane_index as usize;
                added.0[lane_index] += lane_scales[lane_index] * x;
            }
            EventLanes::Lane(lane_index, Kick::Ergon { mass, speed, w }) => {
                let lane_index = lane_index as usize;
                let group_coefficients = &self.coefficients[group];
                let (position_now, position_before) =
                    (motion.positions.0[lane_index], motion.previous_positions.0[lane_index]);
                let position_next = group_coefficients.a.0[lane_index] * position_now
                    - group_coefficients.b.0[lane_index] * position_before
                    + added.0[lane_index];
                let velocity = (position_next - position_before) / lane_scales[lane_index] * (0.5 * self.rate.hertz());
                let struck_mass = self.rate.step() * self.rate.step() / w;
                let impulse = 2.0 * mass * struck_mass / (mass + struck_mass) * (speed - velocity);
                added.0[lane_index] += lane_scales[lane_index] * w * impulse * self.rate.hertz();
            }
            EventLanes::Group(strikes, blow, is_second_step) => {
                let strikes = &self.strikes[strikes as usize];
                let (_, step_fraction, impulse) = strikes.blows[blow as usize];
                let members = &self.members[group * LANES..(group + 1) * LANES];
                let oscillators = (members.iter().enumerate())
                    .filter_map(|(lane_index, member)| Some((lane_index, (*member)? as usize)));
                for (lane_index, member) in oscillators.filter(|pair| strikes.members.contains(&pair.1)) {
                    let mode_index = member - strikes.members.start;
                    let impulse = impulse * strikes.member_shares[mode_index];
                    let split_force = match strikes.responses.get(mode_index) {
                        Some(cell) => cell.split(impulse, step_fraction, self.rate)[usize::from(is_second_step)],
                        None => impulse * self.rate.hertz(),
                    };
                    added.0[lane_index] += lane_scales[lane_index] * split_force * strikes.w;
                }
            }
        }
    }
}
