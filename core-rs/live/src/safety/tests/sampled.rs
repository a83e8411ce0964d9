//! A key that is simulated in this process, exactly and with a known delay; it records the true work of its motor.

use std::collections::VecDeque;
use std::time::Instant;

use crate::safety::SafeForce;
use crate::safety::contract::{Device, DeviceLoss, DeviceSample, DeviceSpec, Unit};

/// Moving mass that the device reports [kg].
pub(super) const MASS: f64 = 0.05;
/// End of the travel on either side [m].
const END: f64 = 0.05;

/// The parameters of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup {
    /// Period of the ticks [s].
    pub(super) period: f64,
    /// True moving mass [kg].
    pub(super) mass: f64,
    /// Friction of the key [N·s/m].
    pub(super) friction: f64,
    /// Delay of a force [ticks], besides the exchange of a device outside lockstep.
    pub(super) delay: usize,
    /// Whether the device reports its delay and its mass.
    pub(super) tells: bool,
    /// Whether a reply shows the effect of its own force; outside lockstep it shows that of the previous force.
    pub(super) lockstep: bool,
    /// Spring and damper of the hand that holds it [N/m, N·s/m].
    pub(super) hand: Option<[f64; 2]>,
    /// Amplitude and frequency of the hand's motion [m, Hz].
    pub(super) sine: [f64; 2],
    /// Step of the position sensor [m].
    pub(super) step: f64,
}

pub(super) struct Sampled {
    setup: Setup,
    spec: DeviceSpec,
    /// exp(A·period) for position, velocity and a constant force.
    flow: [[f64; 3]; 3],
    pub(super) x: f64,
    pub(super) v: f64,
    /// Forces that do not act yet, because of the delay.
    late: VecDeque<f64>,
    shown: f64,
    ticks: u32,
    /// Work of the motor on the key since the beginning [J].
    pub(super) work: f64,
}

impl Sampled {
    pub(super) fn new(setup: Setup) -> Self {
        let [k, b] = setup.hand.unwrap_or_default();
        let b = b + setup.friction;
        Self {
            spec: DeviceSpec {
                dof: 1,
                unit: Unit::Metre,
                pos_lsb: setup.step,
                pos_range: [-END, END],
                force_max_continuous: 20.0,
                force_max_peak: 20.0,
                force_lsb: 0.0,
                rate_nominal: None,
                loop_delay_s: setup.tells.then_some(setup.delay as f64 * setup.period),
                inertia: setup.tells.then_some(MASS),
                damping: Some(setup.friction),
                is_touch_gated: false,
                can_lockstep: true,
                can_send_wide: true,
            },
            flow: exp([
                [0.0, setup.period, 0.0],
                [
                    -k / setup.mass * setup.period,
                    -b / setup.mass * setup.period,
                    setup.period / setup.mass,
                ],
                [0.0; 3],
            ]),
            x: 1e-3,
            v: 0.0,
            late: VecDeque::from(vec![0.0; setup.delay]),
            shown: 0.0,
            ticks: 0,
            work: 0.0,
            setup,
        }
    }

    fn show(&mut self) {
        let sensor_step = self.setup.step;
        self.shown = if sensor_step > 0.0 {
            (self.x / sensor_step).round() * sensor_step
        } else {
            self.x
        };
    }
}

impl Device for Sampled {
    fn spec(&self) -> &DeviceSpec {
        &self.spec
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        if !self.setup.lockstep {
            self.show();
        }
        self.late.push_back(force.newtons()[0]);
        let motor_force = self.late.pop_front().unwrap_or(0.0);
        let [amplitude, hertz] = self.setup.sine;
        let time_now = f64::from(self.ticks) * self.setup.period;
        let hand_position = amplitude * libm::sin(std::f64::consts::TAU * hertz * time_now);
        let grip_force = self.setup.hand.map_or(0.0, |[k, _]| k * hand_position);
        self.ticks += 1;
        let state_before = [self.x, self.v, motor_force + grip_force];
        let [x, v, _] = self
            .flow
            .map(|row| row.iter().zip(state_before).map(|(a, s)| a * s).sum::<f64>());
        let is_within = x.abs() <= END;
        (self.x, self.v) = (x.clamp(-END, END), if is_within { v } else { 0.0 });
        self.work += motor_force * (self.x - state_before[0]);
        if self.setup.lockstep {
            self.show();
        }
        Ok(())
    }

    fn receive(&mut self, into: &mut DeviceSample, _: Instant) -> Result<bool, DeviceLoss> {
        into.position[0] = self.shown;
        Ok(true)
    }

    fn in_lockstep(&self) -> bool {
        self.setup.lockstep
    }

    fn zero(&mut self) {}
}

/// Exponential of a matrix, by its series and repeated squaring.
fn exp(a: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    const SQUARED: u32 = 12;
    let matrix_product = |a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]| -> [[f64; 3]; 3] {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    };
    let scaled_matrix = a.map(|row| row.map(|x| x / f64::from(1 << SQUARED)));
    let mut exponential: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let mut series_term = exponential;
    for n in 1..8 {
        series_term = matrix_product(&series_term, &scaled_matrix).map(|row| row.map(|x| x / f64::from(n)));
        for i in 0..3 {
            for j in 0..3 {
                exponential[i][j] += series_term[i][j];
            }
        }
    }
    for _ in 0..SQUARED {
        exponential = matrix_product(&exponential, &exponential);
    }
    exponential
}
