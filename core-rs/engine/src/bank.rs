//! A bank of independent oscillators, struck at known instants and summed into outputs.
//!
//! Each oscillator follows its own two-term recurrence, which gives exact samples of its continuous motion. Isolated
//! CELs are such oscillators, and so are the modes of a linear body.

mod script;
mod sleep;
mod takeover;

pub(crate) use takeover::are_same;

use std::ops::Range;
use std::sync::Arc;

use crate::cell::Response;
use crate::kernel::bank::{
    GroupCoefficients, GroupMotion, LANES, LaneSum, Lanes, advance_and_sum, advance_and_sum_weighted, lane_total,
};
use crate::units::Rate;
use script::{BankScript, OutputSection};
use sleep::{REST_AMPLITUDE, REST_TEST_FRAMES, rest_threshold};

/// Parameters of one oscillator.
#[derive(Clone, Debug)]
pub(crate) struct Oscillator {
    /// x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// x[0] and x[−1] [m]
    pub(crate) position: f64,
    pub(crate) previous_position: f64,
    /// Outputs with their weights, by rising index; no weight is 0.
    pub(crate) outputs: Vec<(u32, f64)>,
    /// Its blows, by rising frame.
    pub(crate) blows: Vec<Blow>,
}

/// A displacement added to x[frame + 1].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blow {
    pub(crate) frame: u64,
    pub(crate) kick: Kick,
}

/// Size of a blow.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kick {
    /// A given displacement [m].
    Displacement(f64),
    /// An ergon of mass [kg] and speed [m/s], whose impulse depends on the velocity of the oscillator; w = T²/m of the
    /// oscillator.
    Ergon { mass: f64, speed: f64, w: f64 },
}

/// Strikes shared by several oscillators: the modes of a body struck at one point.
#[derive(Clone, Debug)]
pub(crate) struct Strikes {
    /// The oscillators, by their index in the list that the bank is made from.
    pub(crate) members: Range<usize>,
    /// Response of each oscillator to a strike; empty if a strike acts in one step   (n)
    pub(crate) responses: Vec<Response>,
    /// Share of each oscillator in the strike   (n)
    pub(crate) member_shares: Vec<f64>,
    /// Displacement of a mass of 1 by a force of 1 N over one step: T², or 1 if masses are algorithmic.
    pub(crate) w: f64,
    /// Frame, fraction of a frame after it, impulse [N·s].
    pub(crate) blows: Vec<(u64, f64, f64)>,
}

/// A running bank.
#[derive(Clone, Debug)]
pub(crate) struct Bank {
    script: Arc<BankScript>,
    frame: u64,
    motions: Vec<GroupMotion>,
    /// Index of the next event of each group   (n_groups)
    next_events: Vec<usize>,
    /// Whether each group is at rest: then its output is zero   (n_groups)
    is_at_rest: Vec<bool>,
    /// Rates with the additional damping, and whether it acts   (n_groups)
    damped_coefficients: Vec<GroupCoefficients>,
    is_damped: bool,
    /// Sums of one section   (its outputs · room)
    sums: Vec<LaneSum>,
    frames_max: usize,
}

impl Bank {
    /// A bank at frame 0; `frames_max`: largest number of frames a call; `is_open`: further strikes may be added later.
    pub(crate) fn new(
        oscillators: &[Oscillator],
        strikes: Vec<Strikes>,
        rate: Rate,
        frames_max: usize,
        is_open: bool,
    ) -> Self {
        let mut member_order: Vec<usize> = (0..oscillators.len()).collect();
        let outputs = |i: usize| oscillators[i].outputs.iter().map(|&(output, _)| output);
        member_order.sort_by(|&i, &j| outputs(i).cmp(outputs(j)).then(i.cmp(&j)));
        let mut bank_script = BankScript {
            rate,
            sections: Vec::new(),
            coefficients: Vec::new(),
            weights: Vec::new(),
            scales: Vec::new(),
            events: Vec::new(),
            strikes,
            rest_threshold: 0.0,
            groups_and_lanes: vec![(0, 0); oscillators.len()],
            members: Vec::new(),
        };
        let mut motions = Vec::new();
        for same_output_members in member_order.chunk_by(|&i, &j| outputs(i).eq(outputs(j))) {
            let first_group = bank_script.coefficients.len();
            for members in same_output_members.chunks(LANES) {
                motions.push(bank_script.add_group(oscillators, members));
            }
            bank_script.sections.push(OutputSection {
                outputs: outputs(same_output_members[0]).collect(),
                groups: first_group..bank_script.coefficients.len(),
            });
        }
        bank_script.add_strikes();
        bank_script.rest_threshold = if is_open {
            REST_AMPLITUDE
        } else {
            rest_threshold(oscillators, &bank_script.strikes, rate) / bank_script.coefficients.len().max(1) as f64
        };
        let is_at_rest =
            |motion: &GroupMotion| motion.positions == Lanes::ZERO && motion.previous_positions == Lanes::ZERO;
        let n_outputs = bank_script.sections.iter().map(|section| section.outputs.len());
        Self {
            frame: 0,
            next_events: vec![0; motions.len()],
            is_at_rest: motions.iter().map(is_at_rest).collect(),
            sums: vec![LaneSum::ZERO; n_outputs.max().unwrap_or(0) * frames_max],
            frames_max,
            motions,
            damped_coefficients: bank_script.coefficients.clone(),
            is_damped: false,
            script: Arc::new(bank_script),
        }
    }

    /// Advance by `n_frames` frames and add the outputs to `out`, (n_frames · n_out); `column` gives the place of an
    /// output in a frame.
    pub(crate) fn process(
        &mut self,
        out: &mut [f64],
        (n_out, n_frames): (usize, usize),
        column: impl Fn(u32) -> usize,
    ) {
        let bank_script = self.script.clone();
        for section in &bank_script.sections {
            let n_outputs = section.outputs.len();
            let frames_max = self.frames_max;
            self.sums[..n_outputs * frames_max].fill(LaneSum::ZERO);
            for group in section.groups.clone() {
                self.advance(&bank_script, group, n_outputs, n_frames);
            }
            if out.is_empty() {
                continue;
            }
            for (sums, &output) in self.sums.chunks(frames_max).zip(&section.outputs) {
                let column = column(output);
                for (frame, sum) in out.chunks_exact_mut(n_out).zip(&sums[..n_frames]) {
                    frame[column] += lane_total(sum);
                }
            }
        }
        self.frame += n_frames as u64;
    }

    /// Advance one group by `n_frames` frames, with a stop at each blow.
    fn advance(&mut self, script: &BankScript, group: usize, n_outputs: usize, n_frames: usize) {
        let mut segment_start = 0;
        while segment_start < n_frames {
            let current_frame = self.frame + segment_start as u64;
            let next_event = script.events[group].get(self.next_events[group]);
            let segment_end = next_event.map_or(n_frames, |next_event| {
                (next_event.frame.saturating_sub(self.frame) as usize).min(n_frames)
            });
            if segment_end > segment_start {
                let segment_end =
                    segment_end.min(segment_start + (REST_TEST_FRAMES - current_frame % REST_TEST_FRAMES) as usize);
                self.advance_segment(script, group, n_outputs, segment_start..segment_end);
                segment_start = segment_end;
                if (self.frame + segment_start as u64).is_multiple_of(REST_TEST_FRAMES) {
                    self.rest_if_decayed(script, group);
                }
                continue;
            }
            self.is_at_rest[group] = false;
            let mut displacement = Lanes::ZERO;
            let group_motion = &self.motions[group];
            while let Some(next_event) = script.events[group]
                .get(self.next_events[group])
                .filter(|next_event| next_event.frame <= current_frame)
            {
                script.add_event(group, group_motion, next_event, &mut displacement);
                self.next_events[group] += 1;
            }
            self.advance_segment(script, group, n_outputs, segment_start..segment_start + 1);
            for (x, displacement) in self.motions[group].positions.0.iter_mut().zip(&displacement.0) {
                *x += displacement;
            }
            segment_start += 1;
        }
    }

    fn advance_segment(&mut self, script: &BankScript, group: usize, n_outputs: usize, frames: Range<usize>) {
        if self.is_at_rest[group] {
            return;
        }
        let (group_coefficients, group_motion) = (self.damped_coefficients.get(group), &mut self.motions[group]);
        let group_coefficients = group_coefficients
            .filter(|_| self.is_damped)
            .unwrap_or(&script.coefficients[group]);
        if n_outputs == 1 {
            advance_and_sum(group_coefficients, group_motion, &mut self.sums[frames]);
        } else {
            let n_frames = frames.len();
            let output_sums = &mut self.sums[frames.start..];
            advance_and_sum_weighted(
                group_coefficients,
                group_motion,
                &script.weights[group],
                n_frames,
                output_sums,
                self.frames_max,
            );
        }
    }

    /// Multiply the modulus of every pole by `decay_factor`: an additional damping.
    pub(crate) fn damp(&mut self, decay_factor: f64) {
        self.is_damped = decay_factor < 1.0;
        for (damped_coefficients, coefficients) in self.damped_coefficients.iter_mut().zip(&self.script.coefficients) {
            coefficients.scale_poles(decay_factor, damped_coefficients);
        }
    }

    /// Positions of an oscillator now and one frame before [m].
    pub(crate) fn motion(&self, oscillator: usize) -> (f64, f64) {
        let (group_index, lane_index) = self.script.groups_and_lanes[oscillator];
        let (group_index, lane_index) = (group_index as usize, lane_index as usize);
        let lane_scale = self.script.scales[group_index].0[lane_index];
        let group_motion = &self.motions[group_index];
        (
            group_motion.positions.0[lane_index] / lane_scale,
            group_motion.previous_positions.0[lane_index] / lane_scale,
        )
    }
}
