//! A delay by a whole number of frames.

/// A delay line; its output is silent until the first sample has passed through it.
#[derive(Clone, Debug)]
pub(super) struct Delay {
    past: Vec<f64>,
    at: usize,
}

impl Delay {
    /// A delay by `frames`, at least 1.
    pub(super) fn new(frames: usize) -> Self {
        Self {
            past: vec![0.0; frames.max(1)],
            at: 0,
        }
    }

    /// Frames by which it delays.
    pub(super) fn length(&self) -> usize {
        self.past.len()
    }

    /// The sample that leaves the line now; call [`Delay::push`] after it.
    #[inline]
    pub(super) fn oldest(&self) -> f64 {
        self.past[self.at]
    }

    /// Put in the newest sample.
    #[inline]
    pub(super) fn push(&mut self, x: f64) {
        self.past[self.at] = x;
        self.at += 1;
        if self.at == self.past.len() {
            self.at = 0;
        }
    }

    /// Continue with the newest samples of another line, as many as fit. Allocates nothing.
    pub(super) fn take_over(&mut self, old: &Self) {
        let (own, their) = (self.past.len(), old.past.len());
        self.at = 0;
        for back in 1..=own {
            self.past[own - back] = if back <= their {
                old.past[(old.at + their - back) % their]
            } else {
                0.0
            };
        }
    }

    /// Energy of the samples in the line: the sum of their squares.
    #[cfg(test)]
    pub(super) fn energy(&self) -> f64 {
        self.past.iter().map(|x| x * x).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(delay: &mut Delay, from: i32, to: i32) -> Vec<f64> {
        let mut next = |x: f64| {
            let oldest = delay.oldest();
            delay.push(x);
            oldest
        };
        (from..to).map(|i| next(f64::from(i))).collect()
    }

    #[test]
    fn gives_back_later() {
        let mut delay = Delay::new(3);
        assert_eq!(through(&mut delay, 1, 7), [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn another_goes_on_with_the_newest() {
        let mut old = Delay::new(5);
        through(&mut old, 1, 13); // holds 8 … 12
        let mut same = Delay::new(5);
        same.take_over(&old);
        assert_eq!(through(&mut same, 0, 5), [8.0, 9.0, 10.0, 11.0, 12.0]);
        let mut shorter = Delay::new(2);
        shorter.take_over(&old);
        assert_eq!(through(&mut shorter, 0, 2), [11.0, 12.0]);
        let mut longer = Delay::new(7);
        longer.take_over(&old);
        assert_eq!(
            through(&mut longer, 0, 7),
            [0.0, 0.0, 8.0, 9.0, 10.0, 11.0, 12.0]
        );
    }
}
