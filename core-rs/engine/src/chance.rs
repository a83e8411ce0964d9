//! Random numbers, in which every draw has a key of its own and none depends on another.

use std::fmt::Write as _;

use rand_core::Rng;
use rand_pcg::Pcg64;
use sha2::{Digest, Sha256};

use crate::maths;

/// PCG64 (XSL-RR 128/64, O'Neill 2014) seeded by the SHA-256 digest of the text
/// `{seed}/{kind}/{name}/{member}/{occurrence}`: digest bytes 0..16 are its state, 16..32 its stream, both
/// little-endian.
///
/// The draws of two keys are independent, so a line added to a score changes no draw of another line.
///
/// ```
/// use ergon_engine::chance::Chance;
///
/// let draw = |member| Chance::new(7, "bank", "sky", member, 0).uniform(0.0, 1.0);
/// assert_eq!(draw(3), draw(3)); // a key always draws the same
/// assert_ne!(draw(3), draw(4));
/// ```
#[derive(Clone, Debug)]
pub struct Chance(Pcg64);

impl Chance {
    /// The generator for one occurrence of one member of a named thing, such as a bank.
    pub fn new(seed: i128, kind: &str, name: &str, member: u64, occurrence: u64) -> Self {
        let mut hash_key = String::with_capacity(kind.len() + name.len() + 96);
        let _ = write!(hash_key, "{seed}/{kind}/{name}/{member}/{occurrence}");
        let key_digest: [u8; 32] = Sha256::digest(hash_key.as_bytes()).into();
        let half_digest = |first_byte: usize| u128::from_le_bytes(std::array::from_fn(|i| key_digest[first_byte + i]));
        Self(Pcg64::new(half_digest(0), half_digest(16)))
    }

    /// A multiple of 2⁻⁵³ in [0, 1).
    fn unit(&mut self) -> f64 {
        const STEP: f64 = 1.0 / (1u64 << 53) as f64;
        (self.0.next_u64() >> 11) as f64 * STEP
    }

    /// A number from `low` to `high`, uniformly distributed.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A number from `low` to `high`, both above zero, uniformly distributed in its logarithm.
    pub fn logarithmic(&mut self, low: f64, high: f64) -> f64 {
        let (log_low, log_high) = (maths::log(low), maths::log(high));
        // exp(ln x) may differ from x by a bit, and the result must stay in the range.
        maths::exp(log_low + (log_high - log_low) * self.unit()).clamp(low.min(high), low.max(high))
    }

    /// A waiting time of a Poisson process: exponential, with this `mean`.
    pub fn exponential(&mut self, mean: f64) -> f64 {
        -mean * maths::log1p(-self.unit())
    }

    /// The instants [s] of a Poisson process of `rate` [Hz] in [`start`, `stop`).
    ///
    /// Draw the values that belong to an instant right after it, through [`PoissonTimes::chance`]. Then a later `stop`
    /// adds strikes and changes none.
    ///
    /// ```
    /// use ergon_engine::chance::Chance;
    ///
    /// let mut chance = Chance::new(7, "strikes", "sky", 0, 0);
    /// let times: Vec<f64> = chance.poisson_times(50.0, 0.0, 10.0).collect();
    /// assert!(times.is_sorted() && (400..600).contains(&times.len()));
    /// ```
    pub fn poisson_times(&mut self, rate: f64, start: f64, stop: f64) -> PoissonTimes<'_> {
        PoissonTimes {
            chance: self,
            rate,
            t: start,
            stop,
        }
    }
}

/// Instants of a Poisson process, in order; see [`Chance::poisson_times`].
#[derive(Debug)]
pub struct PoissonTimes<'a> {
    chance: &'a mut Chance,
    rate: f64,
    t: f64,
    stop: f64,
}

impl PoissonTimes<'_> {
    /// The generator that also draws the intervals.
    pub fn chance(&mut self) -> &mut Chance {
        self.chance
    }
}

impl Iterator for PoissonTimes<'_> {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        // Written so that the sequence ends for a rate of zero, whose intervals are infinite or NaN.
        self.t += self.chance.exponential(1.0 / self.rate);
        (self.t < self.stop).then_some(self.t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chance(name: &str) -> Chance {
        Chance::new(20_181_110, "strikes", name, 3, 1)
    }

    /// hashlib.sha256(b"20181110/strikes/rain/3/1").digest(); then numpy.random.PCG64 with inc = stream << 1 | 1 and
    /// state = (state + inc)·multiplier + inc (mod 2**128): random_raw(3).
    #[test]
    fn chance_draws_equal_numpy() {
        let mut chance = chance("rain");
        assert_eq!([0; 3].map(|_: u64| chance.0.next_u64()), NUMPY);
    }

    const NUMPY: [u64; 3] = [
        7_927_438_067_563_779_602,
        10_989_747_340_591_375_924,
        4_031_542_238_209_528_536,
    ];

    #[test]
    fn moments() {
        let mut chance = chance("rain");
        let draw_count = 200_000;
        let mut mean_of_draws = |draw: fn(&mut Chance) -> f64| {
            (0..draw_count).map(|_| draw(&mut chance)).sum::<f64>() / f64::from(draw_count)
        };
        // Five standard errors of each mean.
        assert!((mean_of_draws(|c| c.uniform(-1.0, 3.0)) - 1.0).abs() < 5.0 * 1.155 / 447.0);
        assert!((mean_of_draws(|c| c.uniform(0.0, 1.0) * c.uniform(0.0, 1.0)) - 0.25).abs() < 3e-3);
        assert!((mean_of_draws(|c| c.exponential(0.2)) - 0.2).abs() < 5.0 * 0.2 / 447.0);
        let squared_draw = |c: &mut Chance| {
            let drawn_number = c.exponential(1.0);
            drawn_number * drawn_number
        };
        assert!((mean_of_draws(squared_draw) - 2.0).abs() < 5.0 * 4.472 / 447.0);
        let mean_logarithm = mean_of_draws(|c| maths::log(c.logarithmic(20.0, 20_000.0) / 20.0));
        assert!((mean_logarithm - 0.5 * maths::log(1000.0)).abs() < 5.0 * 1.994 / 447.0);
    }

    #[test]
    fn chance_draws_stay_in_range() {
        let mut chance = chance("rain");
        for _ in 0..100_000 {
            assert!((0.1..0.3).contains(&chance.uniform(0.1, 0.3)));
            assert!((0.1..=0.3).contains(&chance.logarithmic(0.1, 0.3)));
            assert!(chance.exponential(1.0) >= 0.0);
            assert_eq!(chance.logarithmic(0.3, 0.3), 0.3);
        }
    }

    #[test]
    fn chance_of_other_keys_differs() {
        let first_draw = |mut c: Chance| c.0.next_u64();
        let rain_draw = first_draw(chance("rain"));
        for other in [
            chance("rains"),
            Chance::new(-20_181_110, "strikes", "rain", 3, 1),
            Chance::new(20_181_110, "gesture", "rain", 3, 1),
            Chance::new(20_181_110, "strikes", "rain", 1, 3),
        ] {
            assert_ne!(first_draw(other), rain_draw);
        }
    }

    #[test]
    fn poisson_times_have_their_rate_and_equal_beginnings() {
        let rain_until = |stop: f64| {
            let mut chance = chance("rain");
            let mut drop_times = chance.poisson_times(50.0, 2.0, stop);
            let mut timed_drops = Vec::new();
            while let Some(drop_time) = drop_times.next() {
                timed_drops.push((drop_time, drop_times.chance().uniform(1.0, 2.0)));
            }
            timed_drops
        };
        let long_rain = rain_until(402.0);
        assert!(
            (long_rain.len() as f64 - 20_000.0).abs() < 5.0 * 141.5,
            "{}",
            long_rain.len()
        );
        assert!(long_rain.windows(2).all(|w| w[0].0 < w[1].0) && long_rain[0].0 >= 2.0);
        assert!(long_rain.iter().all(|drop| drop.0 < 402.0));
        let short_rain = rain_until(40.0);
        assert_eq!(short_rain[..], long_rain[..short_rain.len()]);
        assert_eq!(chance("rain").poisson_times(0.0, 0.0, 1e9).count(), 0);
    }
}
