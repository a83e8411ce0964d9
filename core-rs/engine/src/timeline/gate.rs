//! Couplings: links that act only for a time.

use super::{Timeline, frame};
use crate::network::{Error, Network};

/// Couplings fade in and out over this time [s], rounded up to the grid.
pub(super) const FADE: f64 = 0.02;
/// What needs a calendar begins at multiples of this many frames.
pub const GRID: u64 = 64;

/// A link that acts only for a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gate {
    pub(crate) link: usize,
    /// `None`: open from the beginning.
    pub(super) start: Option<u64>,
    pub(super) stop: Option<u64>,
    pub(super) fade: u64,
}

impl Gate {
    /// The same at `times` the rate.
    pub(crate) fn faster(self, times: u64) -> Self {
        Self {
            start: self.start.map(|start| start * times),
            stop: self.stop.map(|stop| stop * times),
            fade: self.fade * times,
            ..self
        }
    }

    /// The same on another link.
    pub(crate) fn on(self, link: usize) -> Self {
        Self { link, ..self }
    }

    /// How far the gate is open at frame `n`: 0 to 1, by 3u² − 2u³ so that no force jumps.
    pub(crate) fn open(&self, n: u64) -> f64 {
        let risen = self.start.map_or(1.0, |start| self.ramp(n, start));
        let fallen = self.stop.map_or(0.0, |stop| self.ramp(n, stop));
        risen - fallen
    }

    fn ramp(&self, n: u64, start: u64) -> f64 {
        let u = (n.saturating_sub(start) as f64 / self.fade as f64).min(1.0);
        u * u * (3.0 - 2.0 * u)
    }
}

/// How far a gate was open when another version of a score took over: it goes on from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lean {
    from: f64,
    since: u64,
}

impl Lean {
    /// Towards `gate` from where another stood at frame `n`; `None` where that is where it stands itself.
    pub(crate) fn new(gate: &Gate, from: f64, n: u64) -> Option<Self> {
        (from != gate.open(n)).then_some(Self { from, since: n })
    }

    /// How far a gate is open at frame `n`.
    pub(crate) fn open(lean: Option<&Self>, gate: &Gate, n: u64) -> f64 {
        let own = gate.open(n);
        match lean {
            Some(lean) if n < lean.since + gate.fade => {
                let share = gate.ramp(n, lean.since);
                lean.from + (own - lean.from) * share
            }
            _ => own,
        }
    }
}

impl Timeline {
    /// Let a LIA act only from `start` to `stop` [s], with fades that begin on the grid.
    ///
    /// # Errors
    /// Unless the LIA is a single link without times yet, and `stop` comes after `start`.
    pub fn couple(
        &mut self,
        network: &Network,
        link: usize,
        start: f64,
        stop: Option<f64>,
    ) -> Result<(), Error> {
        let refuse = |message: &str| {
            Err(Error::Refused {
                module: network.link_name(link),
                message: message.to_owned(),
            })
        };
        match network.run_of(link) {
            None => return refuse("there is no such link"),
            Some(run) if run.len > 1 => {
                return refuse("a generator's own links act all the time");
            }
            Some(_) => {}
        }
        if self.gates.iter().any(|gate| gate.link == link) {
            return refuse("the link has its times already");
        }
        if !start.is_finite() || stop.is_some_and(|stop| !stop.is_finite()) {
            return refuse("a coupling begins and ends at finite instants");
        }
        if stop.is_some_and(|stop| stop <= start.max(0.0)) {
            return refuse("a coupling ends after it begins, and after 0 s");
        }
        let on_grid = |t: f64| frame(t, self.rate.hertz()).div_ceil(GRID) * GRID;
        // A coupling that is there from the beginning does not fade in.
        let start = if start <= 0.0 {
            None
        } else {
            Some(on_grid(start))
        };
        let fade = ((FADE * self.rate.hertz()) as u64).div_ceil(GRID).max(1) * GRID;
        self.gates.push(Gate {
            link,
            start,
            stop: stop.map(on_grid),
            fade,
        });
        Ok(())
    }
}
