//! Hashes of all that the sound of a bank up to a frame depends on, wherever its outputs are in the score.

use std::collections::BTreeSet;

use super::{Sink, digest, hex};
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
        let mut hash_sink = Sink::new();
        hash_sink.add(rate.hertz().to_le_bytes());
        hash_sink.add([u8::from(bank.is_open)]);
        for oscillator in &bank.oscillators {
            for number in [
                oscillator.a,
                oscillator.b,
                oscillator.position,
                oscillator.previous_position,
            ] {
                hash_sink.add(number.to_le_bytes());
            }
            hash_sink.add((oscillator.outputs.len() as u64).to_le_bytes());
            for (output, weight) in &oscillator.outputs {
                let output_rank = outputs.partition_point(|other| other < output);
                hash_sink.add((output_rank as u64).to_le_bytes());
                hash_sink.add(weight.to_le_bytes());
            }
        }
        for strike in &bank.strikes {
            let (members, responses) = (&strike.members, &strike.responses);
            let (member_shares, w) = (&strike.member_shares, strike.w);
            hash_sink.add(digest(format_args!(
                "{members:?} {responses:?} {member_shares:?} {w:?}"
            )));
        }
        Self {
            static_hash: hash_sink.finish(),
            outputs,
        }
    }

    /// A hash of all that the bank depends on up to frame `until` (64 hex digits); `previous_key` is that hash up to
    /// frame `start_frame`, empty at 0.
    pub(crate) fn key(&self, bank: &BankPlan, (start_frame, until): (u64, u64), previous_key: &str) -> String {
        let is_in_span = |frame: u64| frame <= until && (start_frame == 0 || frame > start_frame);
        let mut hash_sink = Sink::new();
        hash_sink.add(previous_key);
        hash_sink.add(self.static_hash);
        hash_sink.add(until.to_le_bytes());
        for (index, oscillator) in bank.oscillators.iter().enumerate() {
            for blow in oscillator.blows.iter().filter(|blow| is_in_span(blow.frame)) {
                hash_sink.add((index as u64).to_le_bytes());
                hash_sink.add(blow.frame.to_le_bytes());
                let kick_numbers = match blow.kick {
                    Kick::Displacement(step) => [step, f64::NAN, f64::NAN],
                    Kick::Ergon { mass, speed, w } => [mass, speed, w],
                };
                kick_numbers.iter().for_each(|x| hash_sink.add(x.to_le_bytes()));
            }
        }
        for (index, strikes) in bank.strikes.iter().enumerate() {
            for (frame, frame_fraction, impulse) in strikes.blows.iter().filter(|blow| is_in_span(blow.0)) {
                hash_sink.add((index as u64).to_le_bytes());
                hash_sink.add(frame.to_le_bytes());
                hash_sink.add(frame_fraction.to_le_bytes());
                hash_sink.add(impulse.to_le_bytes());
            }
        }
        hex(&hash_sink.finish())
    }
}
