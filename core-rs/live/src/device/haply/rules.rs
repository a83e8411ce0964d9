//! The guardian's rules: which force it sends, and when. They use only the times that the caller passes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::line::ForceCommand;
use crate::device::LOCKSTEP_PATIENCE;

/// Silence of the host after which the force is set to zero.
pub(super) const HOST_SILENT: Duration = Duration::from_millis(50);
/// Time without a state after a command, after which the service counts as silent and the force is set to zero. The
/// host's own limit for old positions is 20 ms: the host acts first, and fades its forces in again.
pub(super) const SERVICE_SILENT: Duration = Duration::from_millis(30);
/// Time between two zeros sent to a silent service.
const ZERO_INTERVAL: Duration = Duration::from_millis(20);
/// Silence after which the service counts as gone.
const SERVICE_GONE: Duration = LOCKSTEP_PATIENCE;

/// What the guardian has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Action {
    Nothing,
    /// Send this force.
    Send([f64; 3]),
    /// The service is gone.
    Gone,
}

pub(crate) struct Rules {
    lockstep: bool,
    /// When the last order came from the host.
    last_order: Instant,
    /// Orders that were not passed on yet: the newest one, in lockstep all.
    orders: VecDeque<ForceCommand>,
    /// Number of the latest order that was passed on.
    number: u16,
    /// In lockstep: numbers of the commands that were not answered by a state yet.
    unanswered: VecDeque<u16>,
    /// Start of the wait for a state, since the first command without one; `None`: all commands are answered.
    asked: Option<Instant>,
    /// When the latest command was sent.
    sent: Instant,
    /// Whether the latest command was a force that is not zero.
    pushes: bool,
    /// Whether the latest command was a zero that the host did not order.
    let_go: bool,
}

impl Rules {
    pub(crate) fn new(lockstep: bool, now: Instant) -> Self {
        Self {
            lockstep,
            last_order: now,
            orders: VecDeque::new(),
            // The number before the first order, which is 0.
            number: u16::MAX,
            unanswered: VecDeque::new(),
            asked: None,
            sent: now,
            pushes: false,
            let_go: false,
        }
    }

    /// Take an order of the host.
    pub(crate) fn order(&mut self, order: ForceCommand, now: Instant) {
        self.last_order = now;
        if !self.lockstep {
            self.orders.clear();
        }
        self.orders.push_back(order);
    }

    /// Take a state of the service; returns the number of the order that it answers, and whether the guardian let go.
    pub(crate) fn state(&mut self, now: Instant) -> (u16, bool) {
        if self.lockstep {
            // Every command has its own state.
            let answered_number = self.unanswered.pop_front();
            self.asked = (!self.unanswered.is_empty()).then_some(now);
            return (answered_number.unwrap_or(self.number), self.let_go);
        }
        self.unanswered.clear();
        self.asked = None;
        (self.number, self.let_go)
    }

    /// The next action; to be called until it is `Nothing`.
    pub(crate) fn due(&mut self, now: Instant) -> Action {
        if self.lockstep {
            // In lockstep the host sets the time, so nothing is late.
            return match self.orders.pop_front() {
                Some(order) => self.pass(order, now),
                None => Action::Nothing,
            };
        }
        let time_since = |at: Instant| now.saturating_duration_since(at);
        let unanswered = self.asked.map_or(Duration::ZERO, time_since);
        if unanswered >= SERVICE_GONE {
            return Action::Gone;
        }
        let service_silent = unanswered >= SERVICE_SILENT;
        if service_silent || time_since(self.last_order) >= HOST_SILENT {
            self.orders.clear();
            let repeats_zero = service_silent && time_since(self.sent) >= ZERO_INTERVAL;
            if self.pushes || repeats_zero {
                self.let_go |= self.pushes;
                return self.send([0.0; 3], now);
            }
            return Action::Nothing;
        }
        // Only one unanswered force at a time, otherwise a slow service would fall further and further behind. A zero
        // that ends a force is sent at once.
        let may_send = |order: &ForceCommand| self.asked.is_none() || (order.is_zero() && self.pushes);
        match self.orders.front().copied().filter(may_send) {
            Some(order) => {
                self.orders.clear();
                self.pass(order, now)
            }
            None => Action::Nothing,
        }
    }

    /// When `due` must be called again if no message comes.
    pub(super) fn next(&self, now: Instant) -> Instant {
        let host_deadline = self.pushes.then_some(self.last_order + HOST_SILENT);
        let service = self.asked.map(|asked| {
            let silence_instant = asked + SERVICE_SILENT;
            if self.pushes {
                silence_instant
            } else {
                silence_instant.max(self.sent + ZERO_INTERVAL)
            }
        });
        let deadlines = [host_deadline, service].into_iter().flatten();
        deadlines.fold(now + ZERO_INTERVAL, Instant::min)
    }

    /// Whether a force may still act: the latest command was a force, or no state has answered the zero yet.
    pub(super) fn may_push(&self) -> bool {
        self.pushes || self.asked.is_some()
    }

    fn pass(&mut self, order: ForceCommand, now: Instant) -> Action {
        self.number = order.number;
        self.let_go = false;
        self.send(order.force, now)
    }

    fn send(&mut self, force: [f64; 3], now: Instant) -> Action {
        self.pushes = force != [0.0; 3];
        self.sent = now;
        self.asked = self.asked.or(Some(now));
        if self.lockstep {
            self.unanswered.push_back(self.number);
        }
        Action::Send(force)
    }
}

#[cfg(test)]
mod tests;
