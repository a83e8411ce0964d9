//! Groups of a bank that have faded away are no longer computed.

use super::{Bank, Kick, Oscillator, Script, Strikes};
use crate::kernel::bank::{LANES, Lanes};
use crate::units::Rate;

/// Every so many frames, counted from the beginning, groups that have faded away fall asleep.
pub(super) const SLEEP: u64 = 4_096;
/// All sleepers together are so far below the hardest blow [dB]: below the rounding of 24 bits.
const ASLEEP: f64 = -160.0;
/// Where nobody knows how hard the hardest will be, so small that no score hears it: the width of a nucleus [m].
pub(super) const NOTHING: f64 = 1e-15;

impl Bank {
    /// Put a group that has faded away to sleep: it cannot grow by itself.
    pub(super) fn rest(&mut self, script: &Script, group: usize) {
        if self.still[group] {
            return;
        }
        let (rates, motion) = (&script.rates[group], &mut self.motions[group]);
        let amplitude = |lane: usize| {
            let (a, b) = (rates.a.0[lane], rates.b.0[lane]);
            amplitude(a, b, motion.now.0[lane], motion.before.0[lane])
        };
        let moves: f64 = (0..LANES).map(amplitude).sum();
        if moves < script.faint {
            (motion.now, motion.before) = (Lanes::ZERO, Lanes::ZERO);
            self.still[group] = true;
        }
    }
}

/// How far an oscillator still swings at most, from two positions (b = r², a = 2r·cos θ); for ever, where it
/// creeps: that is not bounded here.
fn amplitude(a: f64, b: f64, now: f64, before: f64) -> f64 {
    if now == 0.0 && before == 0.0 {
        return 0.0;
    }
    let sine = 1.0 - a * a / (4.0 * b);
    if sine > 0.0 {
        ((now * now + b * before * before - a * now * before) / sine).sqrt()
    } else {
        f64::INFINITY
    }
}

/// What all sleepers may move together: far below the hardest blow that is heard.
pub(super) fn faint(oscillators: &[Oscillator], strikes: &[Strikes], rate: Rate) -> f64 {
    // Where one output hears it the lanes hold what it hears.
    let scale = |own: &Oscillator| match own.heard[..] {
        [(_, weight)] => weight.abs(),
        _ => 1.0,
    };
    let own = oscillators.iter().map(|own| {
        let blows = own.blows.iter().map(|blow| match blow.kick {
            Kick::By(x) => x.abs(),
            Kick::Ergon { .. } => 0.0,
        });
        let start = Some(amplitude(own.a, own.b, own.now, own.before)).filter(|x| x.is_finite());
        blows.fold(start.unwrap_or(0.0), f64::max) * scale(own)
    });
    let shared = strikes.iter().flat_map(|strikes| {
        let impulses = strikes.blows.iter().map(|(_, _, impulse)| impulse.abs());
        let unit = impulses.fold(0.0, f64::max) * rate.hertz() * strikes.w;
        let among = oscillators[strikes.among.clone()].iter();
        let shares = among.zip(&strikes.share);
        shares.map(move |(own, share)| unit * share.abs() * scale(own))
    });
    own.chain(shared).fold(0.0, f64::max) * crate::maths::decibels(ASLEEP)
}
