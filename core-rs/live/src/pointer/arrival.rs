//! How positions arrive: the gaps between them, how long each was under way, and the delay that each would have needed.

/// Width of a bin [s], and number of bins; longer times are in the last.
const BIN_SECONDS: f64 = 0.25e-3;
const N_BINS: usize = 1_024;

/// Counts of times in bins.
#[derive(Debug)]
struct TimeHistogram(Box<[u32]>);

impl Default for TimeHistogram {
    fn default() -> Self {
        Self(vec![0; N_BINS].into())
    }
}

impl TimeHistogram {
    fn count(&mut self, seconds: f64) {
        let bin_index = (seconds.max(0.0) / BIN_SECONDS) as usize;
        self.0[bin_index.min(N_BINS - 1)] += 1;
    }

    /// The upper edge of the bin that holds the quantile `probability` [s]; 0 if nothing was counted.
    fn quantile(&self, probability: f64) -> f64 {
        let total_count: u64 = self.0.iter().map(|&n| u64::from(n)).sum();
        let wanted_rank = ((probability * total_count as f64).ceil() as u64).max(1);
        let mut count_sum = 0;
        let bin_index = self.0.iter().position(|&n| {
            count_sum += u64::from(n);
            count_sum >= wanted_rank
        });
        bin_index.map_or(0.0, |bin_index| BIN_SECONDS * (bin_index + 1) as f64)
    }
}

/// Times of positions on their way [s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ArrivalTimes {
    /// From one time stamp to the next, while the pointer moves.
    pub interval: f64,
    /// From the time stamp to the arrival.
    pub transit: f64,
    /// From the time stamp before to the arrival: with a delay of this length the path did not wait.
    pub needed_delay: f64,
}

/// What arrived.
#[derive(Debug, Default)]
pub(super) struct ArrivalHistograms {
    intervals: TimeHistogram,
    transits: TimeHistogram,
    needed_delays: TimeHistogram,
}

impl ArrivalHistograms {
    /// A position of the instant `time` [s] arrived at `arrival_time` [s], the one before was of `previous_time` [s].
    pub(super) fn count(&mut self, previous_time: f64, time: f64, arrival_time: f64) {
        self.intervals.count(time - previous_time);
        self.transits.count(arrival_time - time);
        self.needed_delays.count(arrival_time - previous_time);
    }

    /// The quantile `probability` of each time, to 0.25 ms upwards.
    pub(super) fn quantile(&self, probability: f64) -> ArrivalTimes {
        ArrivalTimes {
            interval: self.intervals.quantile(probability),
            transit: self.transits.quantile(probability),
            needed_delay: self.needed_delays.quantile(probability),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_arrivals() {
        let mut arrivals = ArrivalHistograms::default();
        assert_eq!(arrivals.quantile(0.5), ArrivalTimes::default());
        for n in 1..=100 {
            let event_time = 8e-3 * f64::from(n);
            // The last ten are under way for 5 ms, the others for 1.1 ms.
            let travel_time = if n > 90 { 5e-3 } else { 1.1e-3 };
            arrivals.count(event_time - 8.1e-3, event_time, event_time + travel_time);
        }
        let [median, longest] = [0.5, 1.0].map(|part| arrivals.quantile(part));
        assert!((median.transit - 1.25e-3).abs() < 1e-12, "{median:?}");
        assert!((median.interval - 8.25e-3).abs() < 1e-12, "{median:?}");
        assert!((longest.needed_delay - 13.25e-3).abs() < 1e-12, "{longest:?}");
        arrivals.count(0.0, 0.05, 9.0);
        assert!((arrivals.quantile(1.0).transit - 0.256).abs() < 1e-12);
    }
}
