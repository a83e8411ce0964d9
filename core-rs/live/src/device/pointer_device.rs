//! A key that a stream of positions plays by a virtual finger: a device without a wire. Unlike [`super::Emulated`] it
//! runs by the wall's clock, unless its stream is in lockstep.

use std::sync::Arc;
use std::time::Instant;

use super::emulated::exact_spec;
use super::{Device, DeviceError, DeviceLoss, DeviceSample, DeviceSpec, DeviceUrl, WireStats};
use crate::device::MAX_AXES;
use crate::pointer::finger::{FingerMotion, PointerPull};
use crate::pointer::path::PathReader;
use crate::pointer::{self, PointerStream};
use crate::safety::SafeForce;

/// Distance of the ticks' clock from the wall's beyond which it is set anew [s], and the share of a smaller distance
/// that is corrected in a tick.
const CLOCK_ERROR_MAX: f64 = 0.02;
const CLOCK_CORRECTION_SHARE: f64 = 0.01;

/// A key under a led finger.
pub(super) struct PointerDevice {
    pointer_stream: Arc<PointerStream>,
    path: PathReader,
    motion: FingerMotion,
    spec: DeviceSpec,
    stats: WireStats,
    period: f64,
    /// End of the present tick on the clock of the lead [s].
    time: f64,
    ticks: u64,
    pointer: Option<(f64, f64)>,
    has_answered: bool,
}

impl PointerDevice {
    pub(super) fn open(url: &DeviceUrl, period: f64, is_retry: bool) -> Result<Self, DeviceError> {
        let pointer_stream = pointer::find(url.stream_name());
        let pointer_stream = pointer_stream.ok_or_else(|| url.open_error("nothing leads this key"))?;
        if is_retry && !pointer_stream.is_present() {
            return Err(url.open_error("nobody plays this key"));
        }
        let mut device = Self::new(pointer_stream, period);
        // What the pointer did meanwhile moved nothing, but it may still be down.
        if is_retry && let Some(last_position) = device.pointer_stream.discard_positions() {
            device.path.begin_at(last_position);
        }
        Ok(device)
    }

    fn new(pointer_stream: Arc<PointerStream>, period: f64) -> Self {
        let options = pointer_stream.options();
        let key_model = options.key;
        Self {
            path: PathReader::new(options.delay),
            motion: FingerMotion::new(options.finger, key_model, period),
            spec: exact_spec((1, 1.0 / period), key_model.range, (key_model.mass, key_model.damping)),
            stats: WireStats::default(),
            period,
            time: if options.in_lockstep { 0.0 } else { pointer_stream.now() },
            ticks: 0,
            pointer: None,
            has_answered: false,
            pointer_stream,
        }
    }

    /// The end of the next tick on the clock of the lead [s]: ticks are even, and follow the wall's clock slowly.
    fn next_time(&self) -> f64 {
        if self.pointer_stream.options().in_lockstep {
            return self.ticks as f64 * self.period;
        }
        let tick_time = self.time + self.period;
        let clock_offset = self.pointer_stream.now() - tick_time;
        if clock_offset.abs() > CLOCK_ERROR_MAX {
            tick_time + clock_offset
        } else {
            tick_time + CLOCK_CORRECTION_SHARE * clock_offset
        }
    }

    fn is_gone(&self) -> bool {
        !self.pointer_stream.is_present()
    }

    fn advance(&mut self, force: f64) {
        self.ticks += 1;
        self.time = self.next_time();
        let pointer_stream = &self.pointer_stream;
        let path_delay = pointer_stream.options().delay;
        let pointer_target = self.path.read(self.time - path_delay, &mut || pointer_stream.next());
        let pull = pointer_target.map(|(end_position, firmness)| PointerPull {
            // A finger that has just landed has no earlier position.
            start_position: self.pointer.map_or(end_position, |pointer| pointer.0),
            end_position,
            firmness,
        });
        self.pointer = pointer_target;
        self.motion.advance(force, pull);
        let motion = &self.motion;
        let [start_position, end_position, firmness] = pull.map_or([f64::NAN; 3], |pull| {
            [pull.start_position, pull.end_position, pull.firmness]
        });
        let tick_row = [
            start_position,
            end_position,
            firmness,
            force,
            motion.finger_position(),
            motion.key_position(),
        ];
        self.pointer_stream.trace_tick(tick_row);
        let held_or_nan = |x: f64| if motion.is_held() { x } else { f64::NAN };
        let led_points = [
            held_or_nan(motion.pointer_position()),
            held_or_nan(motion.finger_position()),
            motion.key_position(),
            motion.pointer_force(),
        ];
        self.pointer_stream.publish(led_points, self.path.n_late());
    }
}

impl Device for PointerDevice {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        if self.is_gone() {
            return Err(DeviceLoss::Closed);
        }
        self.advance(force.newtons().first().copied().unwrap_or(0.0));
        self.stats.packets_sent += 1;
        self.has_answered = false;
        Ok(())
    }

    fn receive(&mut self, sample: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        if self.is_gone() {
            return Err(DeviceLoss::Closed);
        }
        sample.is_fresh = !self.has_answered;
        self.stats.replies_received += u64::from(sample.is_fresh);
        self.has_answered = true;
        sample.position = [0.0; MAX_AXES];
        sample.position[0] = self.motion.key_position();
        sample.is_touched[0] = self.motion.is_held();
        sample.is_force_enabled[0] = true;
        (sample.is_hot, sample.has_let_go) = (false, false);
        sample.seq = self.ticks as u32;
        sample.t_dev_us = Some((self.ticks as f64 * self.period * 1e6) as u64 as u32);
        Ok(sample.is_fresh)
    }

    fn in_lockstep(&self) -> bool {
        self.pointer_stream.options().in_lockstep
    }

    /// The key advances only when a force is sent, so there is no force to end.
    fn zero(&mut self) {}

    fn stats(&self) -> WireStats {
        self.stats
    }
}
