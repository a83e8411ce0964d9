//! The guardian's rules: which force it sends, and when. They use only the times that the caller passes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::line::ForceCommand;
use crate::device::LOCKSTEP_TIMEOUT;

/// Silence of the host after which the force is set to zero.
pub(super) const HOST_SILENCE_MAX: Duration = Duration::from_millis(50);
/// Time without a state after a command, after which the service counts as silent and the force is set to zero. The
/// host's own limit for old positions is 20 ms: the host acts first, and fades its forces in again.
pub(super) const SERVICE_SILENCE_MAX: Duration = Duration::from_millis(30);
/// Time between two zeros sent to a silent service.
const ZERO_INTERVAL: Duration = Duration::from_millis(20);
/// Silence after which the service counts as gone.
const SERVICE_LOSS_TIMEOUT: Duration = LOCKSTEP_TIMEOUT;

/// What the guardian has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum GuardianAction {
    Nothing,
    /// Send this force.
    Send([f64; 3]),
    /// The service is gone.
    Gone,
}

pub(crate) struct GuardianRules {
    lockstep: bool,
    /// When the last order came from the host.
    last_order_time: Instant,
    /// Orders that were not passed on yet: the newest one, in lockstep all.
    pending_orders: VecDeque<ForceCommand>,
    /// Number of the latest order that was passed on.
    last_sent_number: u16,
    /// In lockstep: numbers of the commands that were not answered by a state yet.
    unanswered_numbers: VecDeque<u16>,
    /// Start of the wait for a state, since the first command without one; `None`: all commands are answered.
    wait_start: Option<Instant>,
    /// When the latest command was sent.
    last_sent_time: Instant,
    /// Whether the latest command was a force that is not zero.
    is_pushing: bool,
    /// Whether the latest command was a zero that the host did not order.
    let_go: bool,
}

impl GuardianRules {
    pub(crate) fn new(lockstep: bool, now: Instant) -> Self {
        Self {
            lockstep,
            last_order_time: now,
            pending_orders: VecDeque::new(),
            // The number before the first order, which is 0.
            last_sent_number: u16::MAX,
            unanswered_numbers: VecDeque::new(),
            wait_start: None,
            last_sent_time: now,
            is_pushing: false,
            let_go: false,
        }
    }

    /// Take an order of the host.
    pub(crate) fn take_order(&mut self, order: ForceCommand, now: Instant) {
        self.last_order_time = now;
        if !self.lockstep {
            self.pending_orders.clear();
        }
        self.pending_orders.push_back(order);
    }

    /// Take a state of the service; returns the number of the order that it answers, and whether the guardian let go.
    pub(crate) fn take_state(&mut self, now: Instant) -> (u16, bool) {
        if self.lockstep {
            // Every command has its own state.
            let answered_number = self.unanswered_numbers.pop_front();
            self.wait_start = (!self.unanswered_numbers.is_empty()).then_some(now);
            return (answered_number.unwrap_or(self.last_sent_number), self.let_go);
        }
        self.unanswered_numbers.clear();
        self.wait_start = None;
        (self.last_sent_number, self.let_go)
    }

    /// The next action; to be called until it is `Nothing`.
    pub(crate) fn next_action(&mut self, now: Instant) -> GuardianAction {
        if self.lockstep {
            // In lockstep the host sets the time, so nothing is late.
            return match self.pending_orders.pop_front() {
                Some(order) => self.pass_order(order, now),
                None => GuardianAction::Nothing,
            };
        }
        let time_since = |instant: Instant| now.saturating_duration_since(instant);
        let wait_time = self.wait_start.map_or(Duration::ZERO, time_since);
        if wait_time >= SERVICE_LOSS_TIMEOUT {
            return GuardianAction::Gone;
        }
        let is_service_silent = wait_time >= SERVICE_SILENCE_MAX;
        if is_service_silent || time_since(self.last_order_time) >= HOST_SILENCE_MAX {
            self.pending_orders.clear();
            let repeats_zero = is_service_silent && time_since(self.last_sent_time) >= ZERO_INTERVAL;
            if self.is_pushing || repeats_zero {
                self.let_go |= self.is_pushing;
                return self.send([0.0; 3], now);
            }
            return GuardianAction::Nothing;
        }
        // Only one unanswered force at a time, otherwise a slow service would fall further and further behind. A zero
        // that ends a force is sent at once.
        let may_send = |order: &ForceCommand| self.wait_start.is_none() || (order.is_zero() && self.is_pushing);
        match self.pending_orders.front().copied().filter(may_send) {
            Some(order) => {
                self.pending_orders.clear();
                self.pass_order(order, now)
            }
            None => GuardianAction::Nothing,
        }
    }

    /// When `next_action` must be called again if no message comes.
    pub(super) fn next_deadline(&self, now: Instant) -> Instant {
        let host_deadline = self.is_pushing.then_some(self.last_order_time + HOST_SILENCE_MAX);
        let service_deadline = self.wait_start.map(|wait_start| {
            let silence_instant = wait_start + SERVICE_SILENCE_MAX;
            if self.is_pushing {
                silence_instant
            } else {
                silence_instant.max(self.last_sent_time + ZERO_INTERVAL)
            }
        });
        let deadlines = [host_deadline, service_deadline].into_iter().flatten();
        deadlines.fold(now + ZERO_INTERVAL, Instant::min)
    }

    /// Whether a force may still act: the latest command was a force, or no state has answered the zero yet.
    pub(super) fn may_push(&self) -> bool {
        self.is_pushing || self.wait_start.is_some()
    }

    fn pass_order(&mut self, order: ForceCommand, now: Instant) -> GuardianAction {
        self.last_sent_number = order.number;
        self.let_go = false;
        self.send(order.force, now)
    }

    fn send(&mut self, force: [f64; 3], now: Instant) -> GuardianAction {
        self.is_pushing = force != [0.0; 3];
        self.last_sent_time = now;
        self.wait_start = self.wait_start.or(Some(now));
        if self.lockstep {
            self.unanswered_numbers.push_back(self.last_sent_number);
        }
        GuardianAction::Send(force)
    }
}

#[cfg(test)]
mod tests;
