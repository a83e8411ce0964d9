//! A delay by a whole number of frames.

use crate::archive::{Archive, Damaged, State, state_of};

/// A delay line; its output is silent until the first sample has passed through it.
#[derive(Clone, Debug)]
pub(super) struct DelayLine {
    samples: Vec<f64>,
    write_index: usize,
    echo: Option<Echo>,
}

/// Largest number of frames over which the first samples that a longer line takes over are faded in.
const SMOOTHED_FRAMES_MAX: usize = 1024;

/// The feedback of a delay line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Delay of the feedback [frames]: from 1 to the length of the line.
    pub delay_frames: usize,
    /// Gain of the feedback, between -1 and 1.
    pub feedback_ratio: f64,
}

impl State for DelayLine {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let fields: Result<(), Damaged> = state_of!(self, archive, samples, write_index);
        fields.and(if self.write_index < self.samples.len() {
            Ok(())
        } else {
            Err(Damaged)
        })
    }
}

impl DelayLine {
    /// A delay by `frames`, at least 1.
    pub(super) fn new(frames: usize) -> Self {
        Self {
            samples: vec![0.0; frames.max(1)],
            write_index: 0,
            echo: None,
        }
    }

    /// A line with feedback: it holds w(n) = x(n) + ratio · w(n - echo), and gives w(n - frames).
    pub(super) fn with_echo(frames: usize, echo: Option<Echo>) -> Self {
        Self {
            echo,
            ..Self::new(frames)
        }
    }

    /// Its feedback.
    pub(super) fn echo(&self) -> Option<Echo> {
        self.echo
    }

    /// Put in the newest sample, and give the one that leaves the line.
    #[inline]
    pub(super) fn delay_sample(&mut self, x: f64) -> f64 {
        let oldest_sample = self.oldest();
        let echo_sample = self.echo.map_or(0.0, |echo| {
            let line_length = self.samples.len();
            let echo_index = self.write_index + line_length - echo.delay_frames;
            let echo_index = if echo_index < line_length {
                echo_index
            } else {
                echo_index - line_length
            };
            echo.feedback_ratio * self.samples[echo_index]
        });
        self.push(x + echo_sample);
        oldest_sample
    }

    /// Frames by which it delays.
    pub(super) fn length(&self) -> usize {
        self.samples.len()
    }

    /// The sample that leaves the line now; call [`Delay::push`] after it.
    #[inline]
    pub(super) fn oldest(&self) -> f64 {
        self.samples[self.write_index]
    }

    /// Put in the newest sample.
    #[inline]
    pub(super) fn push(&mut self, x: f64) {
        self.samples[self.write_index] = x;
        self.write_index += 1;
        if self.write_index == self.samples.len() {
            self.write_index = 0;
        }
    }

    /// The samples that leave the line next, no more than its length.
    pub(super) fn copy_oldest(&self, out: &mut [f64]) {
        let until_wrap = (self.samples.len() - self.write_index).min(out.len());
        let (early_part, late_part) = out.split_at_mut(until_wrap);
        early_part.copy_from_slice(&self.samples[self.write_index..self.write_index + until_wrap]);
        late_part.copy_from_slice(&self.samples[..late_part.len()]);
    }

    /// Put in the newest samples, no more than its length.
    pub(super) fn push_all(&mut self, samples: &[f64]) {
        let until_wrap = (self.samples.len() - self.write_index).min(samples.len());
        let (early_part, late_part) = samples.split_at(until_wrap);
        self.samples[self.write_index..self.write_index + until_wrap].copy_from_slice(early_part);
        self.samples[..late_part.len()].copy_from_slice(late_part);
        self.write_index = (self.write_index + samples.len()) % self.samples.len();
    }

    /// Continue with the newest samples of another line, as many as fit. Allocates nothing.
    pub(super) fn take_over(&mut self, old: &Self) {
        let (line_length, old_length) = (self.samples.len(), old.samples.len());
        self.write_index = 0;
        for samples_ago in 1..=line_length {
            self.samples[line_length - samples_ago] = if samples_ago <= old_length {
                old.samples[(old.write_index + old_length - samples_ago) % old_length]
            } else {
                0.0
            };
        }
        // Where the older samples end, feedback would repeat a step.
        if self.echo.is_some() && old_length < line_length {
            let smoothed_count = old_length.min(SMOOTHED_FRAMES_MAX);
            for (step, x) in self.samples[line_length - old_length..][..smoothed_count]
                .iter_mut()
                .enumerate()
            {
                let u = step as f64 / smoothed_count as f64;
                *x *= u * u * (3.0 - 2.0 * u);
            }
        }
    }

    /// Energy of the samples in the line: the sum of their squares.
    #[cfg(test)]
    pub(super) fn energy(&self) -> f64 {
        self.samples.iter().map(|x| x * x).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn delayed_ramp(delay: &mut DelayLine, from: i32, to: i32) -> Vec<f64> {
        let mut next = |x: f64| {
            let oldest_sample = delay.oldest();
            delay.push(x);
            oldest_sample
        };
        (from..to).map(|i| next(f64::from(i))).collect()
    }

    #[test]
    fn delay_returns_samples_later() {
        let mut delay = DelayLine::new(3);
        assert_eq!(delayed_ramp(&mut delay, 1, 7), [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn echoing_delay_falls_by_its_feedback() {
        let echo_response = |length| {
            let echo = Echo {
                delay_frames: 3,
                feedback_ratio: -0.5,
            };
            let mut echo = DelayLine::with_echo(length, Some(echo));
            let echoed_samples = (0..10).map(|i| echo.delay_sample(if i == 0 { 1.0 } else { 0.0 }));
            echoed_samples.collect::<Vec<f64>>()
        };
        let expected = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.25];
        assert_eq!(echo_response(3), expected);
        assert_eq!(echo_response(5)[2..], expected[..8], "heard two frames later");
    }

    #[test]
    fn delay_take_over_keeps_the_newest_samples() {
        let mut old_delay = DelayLine::new(5);
        delayed_ramp(&mut old_delay, 1, 13); // holds 8 … 12
        let mut equal_delay = DelayLine::new(5);
        equal_delay.take_over(&old_delay);
        assert_eq!(delayed_ramp(&mut equal_delay, 0, 5), [8.0, 9.0, 10.0, 11.0, 12.0]);
        let mut short_delay = DelayLine::new(2);
        short_delay.take_over(&old_delay);
        assert_eq!(delayed_ramp(&mut short_delay, 0, 2), [11.0, 12.0]);
        let mut long_delay = DelayLine::new(7);
        long_delay.take_over(&old_delay);
        assert_eq!(
            delayed_ramp(&mut long_delay, 0, 7),
            [0.0, 0.0, 8.0, 9.0, 10.0, 11.0, 12.0]
        );
    }
}
