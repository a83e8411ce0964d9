//! Hashes of all that the sound of a bank up to a frame depends on, wherever its outputs are in the score.

use std::collections::BTreeSet;

use super::{Hasher, digest, hex};
use crate::assembly::unit::BankPlan;
use crate::bank::Kick;
use crate::units::Rate;

/// A hash of a bank without its blows, and the outputs that hear it.
#[derive(Clone, Debug)]
pub(crate) struct BankContent {
    static_hash: [u8; 32],
    /// Rising indices of outputs of the scene.
    pub(crate) outputs: Vec<u32>,
}

impl BankContent {
    pub(crate) fn new(bank: &BankPlan, rate: Rate) -> Self {
        let weights = bank.oscillators.iter().flat_map(|oscillator| &oscillator.outputs);
        let outputs: BTreeSet<u32> = weights.map(|&(output, _)| output).collect();
        let outputs = Vec::from_iter(outputs);
        let mut hasher = Hasher::new();
        hasher.add(rate.hertz().to_le_bytes());
        hasher.add([u8::from(bank.is_open)]);
        for oscillator in &bank.oscillators {
            for number in [
                oscillator.a,
                oscillator.b,
                oscillator.position,
                oscillator.previous_position,
            ] {
                hasher.add(number.to_le_bytes());
            }
            hasher.add((oscillator.outputs.len() as u64).to_le_bytes());
            for (output, weight) in &oscillator.outputs {
                let output_rank = outputs.partition_point(|other| other < output);
                hasher.add((output_rank as u64).to_le_bytes());
                hasher.add(weight.to_le_bytes());
            }
        }
        for strike in &bank.strikes {
            let (members, responses) = (&strike.members, &strike.responses);
            let (member_shares, w) = (&strike.member_shares, strike.w);
            hasher.add(digest(format_args!(
                "{members:?} {responses:?} {member_shares:?} {w:?}"
            )));
        }
        Self {
            static_hash: hasher.finish(),
            outputs,
        }
    }

    /// A hash of all that the bank depends on up to frame `end_frame` (64 hex digits); `previous_hash` is that hash up
    /// to frame `start_frame`, empty at 0.
    pub(crate) fn hash_of_span(
        &self,
        bank: &BankPlan,
        (start_frame, end_frame): (u64, u64),
        previous_hash: &str,
    ) -> String {
        let is_in_span = |frame: u64| frame <= end_frame && (start_frame == 0 || frame > start_frame);
        let mut hasher = Hasher::new();
        hasher.add(previous_hash);
        hasher.add(self.static_hash);
        hasher.add(end_frame.to_le_bytes());
        for (index, oscillator) in bank.oscillators.iter().enumerate() {
            for blow in oscillator.blows.iter().filter(|blow| is_in_span(blow.frame)) {
                hasher.add((index as u64).to_le_bytes());
                hasher.add(blow.frame.to_le_bytes());
                let kick_numbers = match blow.kick {
                    Kick::Displacement(step) => [step, f64::NAN, f64::NAN],
                    Kick::Ergon { mass, speed, w } => [mass, speed, w],
                };
                kick_numbers.iter().for_each(|x| hasher.add(x.to_le_bytes()));
            }
        }
        for (index, strikes) in bank.strikes.iter().enumerate() {
            for (frame, frame_fraction, impulse) in strikes.blows.iter().filter(|blow| is_in_span(blow.0)) {
                hasher.add((index as u64).to_le_bytes());
                hasher.add(frame.to_le_bytes());
                hasher.add(frame_fraction.to_le_bytes());
                hasher.add(impulse.to_le_bytes());
            }
        }
        hex(&hasher.finish())
    }
}
