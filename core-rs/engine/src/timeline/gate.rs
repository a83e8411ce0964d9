//! Gates: couplings, which are links that act for a limited time, and factors of forces that glide.

use super::Timeline;
use crate::network::{Error, Network};
use crate::units::{frame, nearest_frame};

/// Couplings fade in and out over this time [s], rounded up to the grid.
pub const FADE_SECONDS: f64 = 0.02;
/// Fades and glides begin at multiples of this number of frames.
pub const GRID_FRAMES: u64 = 64;

/// A factor of the force of some links, as a function of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gate {
    /// Index of the first link and number of links: complete runs.
    pub(crate) first_link: usize,
    pub(crate) n_links: usize,
    /// Start and end of the coupling; `start` is `None` if it acts from the beginning.
    pub(super) start: Option<u64>,
    pub(super) stop: Option<u64>,
    pub(super) fade_frames: u64,
    /// A further factor of the force, which glides.
    pub(super) ramp: Option<Ramp>,
}

/// A factor that changes linearly between two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ramp {
    pub(crate) start_factor: f64,
    pub(crate) end_factor: f64,
    pub(crate) start: u64,
    pub(crate) stop: u64,
}

impl Ramp {
    /// The factor at frame `n`.
    pub(crate) fn factor(&self, n: u64) -> f64 {
        if n >= self.stop {
            return self.end_factor;
        }
        let frames_passed = n.saturating_sub(self.start) as f64;
        self.start_factor + (self.end_factor - self.start_factor) * (frames_passed / (self.stop - self.start) as f64)
    }

    /// The same event at `oversampling` times the rate.
    pub(crate) fn with_higher_rate(self, oversampling: u64) -> Self {
        Self {
            start: self.start * oversampling,
            stop: self.stop * oversampling,
            ..self
        }
    }

    /// The same event at the rate divided by `rate_divisor`.
    fn with_lower_rate(self, rate_divisor: u64) -> Self {
        let start = nearest_frame(self.start, rate_divisor);
        Self {
            start,
            stop: nearest_frame(self.stop, rate_divisor).max(start + 1),
            ..self
        }
    }
}

impl Gate {
    /// The same event at `oversampling` times the rate.
    pub(crate) fn with_higher_rate(self, oversampling: u64) -> Self {
        Self {
            start: self.start.map(|start| start * oversampling),
            stop: self.stop.map(|stop| stop * oversampling),
            fade_frames: self.fade_frames * oversampling,
            ramp: self.ramp.map(|ramp| ramp.with_higher_rate(oversampling)),
            ..self
        }
    }

    /// The same event at the rate divided by `rate_divisor`.
    pub(super) fn with_lower_rate(self, rate_divisor: u64) -> Self {
        Self {
            start: self.start.map(|start| nearest_frame(start, rate_divisor)),
            stop: self.stop.map(|stop| nearest_frame(stop, rate_divisor)),
            fade_frames: nearest_frame(self.fade_frames, rate_divisor).max(1),
            ramp: self.ramp.map(|ramp| ramp.with_lower_rate(rate_divisor)),
            ..self
        }
    }

    /// The gate on other links.
    pub(crate) fn on_links(self, first_link: usize, n_links: usize) -> Self {
        Self {
            first_link,
            n_links,
            ..self
        }
    }

    /// Indices of the links.
    pub(crate) fn links(&self) -> std::ops::Range<usize> {
        self.first_link..self.first_link + self.n_links
    }

    /// Whether its links act for a limited time; else the gate only glides.
    pub(crate) fn has_schedule(&self) -> bool {
        self.start.is_some() || self.stop.is_some()
    }

    /// Whether the force of the links glides.
    pub(crate) fn has_ramp(&self) -> bool {
        self.ramp.is_some()
    }

    /// Whether the glide ends at 0, so that the links do not act after it.
    pub(crate) fn ends_closed(&self) -> bool {
        self.ramp.is_some_and(|ramp| ramp.end_factor == 0.0)
    }

    /// Factor of the force at frame `n`: a fade by 3u² − 2u³, so that the force never jumps, times the glide.
    pub(crate) fn opening(&self, n: u64) -> f64 {
        let rise_factor = self.start.map_or(1.0, |start| self.smooth_fade(n, start));
        let fall_factor = self.stop.map_or(0.0, |stop| self.smooth_fade(n, stop));
        let openness = rise_factor - fall_factor;
        self.ramp.map_or(openness, |ramp| openness * ramp.factor(n))
    }

    /// The first frame, `n` or later, at which the factor may change, including the continuation from a replaced
    /// version.
    pub(crate) fn next_change_frame(&self, continuation: Option<&GateContinuation>, n: u64) -> u64 {
        let fade_since = continuation.map(|continuation| continuation.start_frame);
        let fade_spans = [self.start, self.stop, fade_since].into_iter().flatten();
        let fade_spans = fade_spans.map(|start| (start, start + self.fade_frames));
        let change_spans = fade_spans.chain(self.ramp.map(|ramp| (ramp.start, ramp.stop)));
        let due_frames = change_spans.filter(|span| span.1 > n).map(|span| span.0.max(n));
        due_frames.min().unwrap_or(u64::MAX)
    }

    /// The frame at which its factor has changed for the last time.
    pub(crate) fn last_change_frame(&self) -> Option<u64> {
        let fade_starts = [self.start, self.stop].into_iter().flatten();
        let fade_ends = fade_starts.map(|start| start + self.fade_frames);
        fade_ends.chain(self.ramp.map(|ramp| ramp.stop)).max()
    }

    fn smooth_fade(&self, n: u64, start: u64) -> f64 {
        let fade_share = (n.saturating_sub(start) as f64 / self.fade_frames as f64).min(1.0);
        fade_share * fade_share * (3.0 - 2.0 * fade_share)
    }
}

/// Continuation of a gate across a change of score: the factor moves from its value in the replaced version to its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GateContinuation {
    old_opening: f64,
    start_frame: u64,
}

impl GateContinuation {
    /// Continuation to `gate` from another gate's factor at frame `n`; `None` if both factors are equal.
    pub(crate) fn new(gate: &Gate, old_opening: f64, n: u64) -> Option<Self> {
        (old_opening != gate.opening(n)).then_some(Self {
            old_opening,
            start_frame: n,
        })
    }

    /// Factor of a gate at frame `n`, with its continuation, if it has one.
    pub(crate) fn opening(continuation: Option<&Self>, gate: &Gate, n: u64) -> f64 {
        let opening = gate.opening(n);
        match continuation {
            Some(continuation) if n < continuation.start_frame + gate.fade_frames => {
                let fade_share = gate.smooth_fade(n, continuation.start_frame);
                continuation.old_opening + (opening - continuation.old_opening) * fade_share
            }
            _ => opening,
        }
    }
}

impl Timeline {
    /// Let a LIA act only from `start_instant` to `stop_instant` [s], with fades that begin on the grid and take 20 ms.
    ///
    /// ```
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.mas("b", 1e-3, 0.0, 0.0)?);
    /// let link = network.spring("tie", a, b, 500.0, 0.01, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// timeline.couple(&network, link, 1.0, Some(3.0))?; // it acts from 1 s to 3 s
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the LIA is not a single link, has times already, or `stop_instant` does not come after `start_instant`.
    pub fn couple(
        &mut self,
        network: &Network,
        link: usize,
        start_instant: f64,
        stop_instant: Option<f64>,
    ) -> Result<(), Error> {
        self.couple_over(network, link, start_instant, stop_instant, FADE_SECONDS)
    }

    /// As [`Timeline::couple`], with fades of another length [s], rounded up to the grid.
    ///
    /// # Errors
    /// As [`Timeline::couple`], and if a fade takes no time.
    pub fn couple_over(
        &mut self,
        network: &Network,
        link: usize,
        start_instant: f64,
        stop_instant: Option<f64>,
        fade_seconds: f64,
    ) -> Result<(), Error> {
        let refusal = |message: &str| {
            Err(Error::Refused {
                module: network.link_name(link),
                message: message.to_owned(),
            })
        };
        match network.run_of(link) {
            None => return refusal("there is no such link"),
            Some(run) if run.len > 1 => {
                return refusal("a link inside a generator cannot be switched on and off");
            }
            Some(_) => {}
        }
        let gate_index = self.gates.iter().position(|gate| gate.first_link == link);
        if gate_index.is_some_and(|index| self.gates[index].has_schedule()) {
            return refusal("the link already has a schedule");
        }
        if !(fade_seconds > 0.0 && fade_seconds.is_finite()) {
            return refusal("the time of a fade must be above 0 s");
        }
        if !start_instant.is_finite() || stop_instant.is_some_and(|instant| !instant.is_finite()) {
            return refusal("a coupling must begin and end at finite instants");
        }
        if stop_instant.is_some_and(|instant| instant <= start_instant.max(0.0)) {
            return refusal("a coupling must end after it begins, and after 0 s");
        }
        let on_grid = |t: f64| self.on_grid(t);
        // A coupling without a start does not fade in.
        let start = (start_instant > 0.0).then(|| on_grid(start_instant));
        let gate = Gate {
            first_link: link,
            n_links: 1,
            start,
            stop: stop_instant.map(on_grid),
            fade_frames: ((fade_seconds * self.rate.hertz()) as u64).div_ceil(GRID_FRAMES).max(1) * GRID_FRAMES,
            ramp: gate_index.and_then(|index| self.gates[index].ramp),
        };
        match gate_index {
            Some(index) => self.gates[index] = gate,
            None => self.gates.push(gate),
        }
        Ok(())
    }

    /// Let the force of `n` LIAs, which are whole runs, be multiplied by a factor: `start_factor` until
    /// `start_instant`, `end_factor` from `stop_instant` on [s], and linear between, on the grid. For springs this is a
    /// glide of K and Z. One law turns into another with two links in one place, of which one glides to 0 while the
    /// other glides from 0.
    ///
    /// # Errors
    /// If the LIAs are not whole runs or glide already, or `stop_instant` does not come after `start_instant`.
    pub fn glide_force(
        &mut self,
        network: &Network,
        (link, n): (usize, usize),
        (start_factor, end_factor): (f64, f64),
        (start_instant, stop_instant): (f64, f64),
    ) -> Result<(), Error> {
        let refusal = |message: &str| {
            Err(Error::Refused {
                module: network.link_name(link),
                message: message.to_owned(),
            })
        };
        let begins_row = |link: usize| network.run_of(link).is_some_and(|run| run.first == link);
        let links_end = link.saturating_add(n);
        let ends_row = links_end == network.n_lia() || begins_row(links_end);
        if n == 0 || !begins_row(link) || !ends_row {
            return refusal("this link is one of a row of links, which can glide only together; name the row");
        }
        if ![start_factor, end_factor]
            .iter()
            .all(|factor| factor.is_finite() && *factor >= 0.0)
        {
            return refusal("both factors of a glide must be 0 or more");
        }
        if !(start_instant.is_finite() && stop_instant.is_finite() && start_instant >= 0.0) {
            return refusal("a glide must begin and end at finite instants, at 0 s or later");
        }
        let (start, stop) = (self.on_grid(start_instant), self.on_grid(stop_instant));
        if stop <= start {
            return refusal("a glide must last 64 samples at least");
        }
        let faded_links = link..links_end;
        let known_gate = self
            .gates
            .iter_mut()
            .find(|gate| gate.links().any(|gate_link| faded_links.contains(&gate_link)));
        let ramp = Some(Ramp {
            start_factor,
            end_factor,
            start,
            stop,
        });
        match known_gate {
            Some(gate) if gate.ramp.is_none() && gate.links() == faded_links => gate.ramp = ramp,
            Some(_) => return refusal("the link already glides at that time"),
            None => self.gates.push(Gate {
                first_link: link,
                n_links: n,
                start: None,
                stop: None,
                fade_frames: GRID_FRAMES,
                ramp,
            }),
        }
        Ok(())
    }

    /// The first frame of the grid at or after an instant [s].
    pub(super) fn on_grid(&self, t: f64) -> u64 {
        frame(t, self.rate.hertz()).div_ceil(GRID_FRAMES) * GRID_FRAMES
    }
}
