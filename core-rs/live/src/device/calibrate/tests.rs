use super::*;
use crate::device::EmulatedDevice;
use crate::emulate::{EmulatedHand, EmulatedKeys, KeyConstants};

const PERIOD: f64 = 1e-3;
static GO: AtomicBool = AtomicBool::new(false);

fn device(hand: EmulatedHand) -> EmulatedDevice {
    let plain_key = KeyConstants::default();
    let emulated_keys = EmulatedKeys::new(1, plain_key, 1.0 / PERIOD, vec![hand]).unwrap();
    EmulatedDevice::new(emulated_keys, plain_key)
}

/// A device with a motor of reversed polarity, and a sensor with another scale and another zero.
fn odd(device: EmulatedDevice) -> CalibratedDevice<EmulatedDevice> {
    let odd_axis = AxisCalibration {
        sign: -1.0,
        offset: 0.01,
        gain: 2.0,
        ..AxisCalibration::without_corrections(device.spec())
    };
    CalibratedDevice::new(device, vec![odd_axis])
}

fn direction<D: Device>(device: &mut D) -> Result<f64, DirectionError> {
    let pulse = TestPulse::from_spec(device.spec());
    find_directions(device, &[0], pulse, PERIOD, &GO).unwrap()[0]
}

#[test]
fn direction_of_straight_and_reversed_motors() {
    let mut straight = device(EmulatedHand::Resting);
    assert_eq!(direction(&mut straight), Ok(1.0));
    let mut reversed = odd(device(EmulatedHand::Resting));
    assert_eq!(direction(&mut reversed), Ok(-1.0));
    // The calibration that was found corrects the device.
    let measured_axis = AxisCalibration {
        sign: -1.0,
        ..AxisCalibration::without_corrections(reversed.spec())
    };
    let mut corrected = CalibratedDevice::new(reversed, vec![measured_axis]);
    assert_eq!(direction(&mut corrected), Ok(1.0));
}

#[test]
fn pulse_moves_a_key_slightly() {
    let mut straight = device(EmulatedHand::Resting);
    let pulse = TestPulse::from_spec(straight.spec());
    find_directions(&mut straight, &[0], pulse, PERIOD, &GO).unwrap();
    let rest_range = travel_ends(&mut straight, 0.1, PERIOD, &GO).unwrap()[0];
    let key_travel = straight.spec().pos_range[1] - straight.spec().pos_range[0];
    assert!(rest_range[1] - rest_range[0] < 1e-6, "at rest: {rest_range:?}");
    assert!(rest_range[0].abs() < 0.1 * key_travel, "{rest_range:?}");
}

#[test]
fn directions_of_a_held_axis_are_unknown() {
    let held = EmulatedHand::OnPath {
        path: vec![0.0; 100_000],
        stiffness: 5e4,
        damping: 20.0,
    };
    let mut held = device(held);
    let coarse_spec = DeviceSpec {
        pos_lsb: 1e-3,
        ..held.spec().clone()
    };
    let pulse = TestPulse::from_spec(&coarse_spec);
    let mut coarse_device = CalibratedDevice::new(&mut held, vec![]);
    coarse_device.spec.pos_lsb = 1e-3;
    assert_eq!(
        find_directions(&mut coarse_device, &[0], pulse, PERIOD, &GO),
        Ok(vec![Err(DirectionError::NoMotion)])
    );
}

#[test]
fn travel_ends_give_offset_and_gain() {
    let hand_path = (0..200).map(|i| if i < 100 { 0.01 } else { -0.03 });
    let path_hand = EmulatedHand::OnPath {
        path: hand_path.collect(),
        stiffness: 2000.0,
        damping: 40.0,
    };
    let mut device = device(path_hand);
    let axis_ends = travel_ends(&mut device, 0.2, PERIOD, &GO).unwrap()[0];
    assert!(
        (axis_ends[0] + 0.03).abs() < 2e-3 && (axis_ends[1] - 0.01).abs() < 2e-3,
        "{axis_ends:?}"
    );
    // By the ruler, the ends are 80 mm apart: the device reports half the true distance.
    let scaled_axis = AxisCalibration::without_corrections(device.spec()).from_ends(axis_ends, 0.08);
    let mut corrected = CalibratedDevice::new(device, vec![scaled_axis]);
    let mut sample = DeviceSample::default();
    corrected.receive(&mut sample, Instant::now()).unwrap();
    assert!((sample.position[0] + 0.04).abs() < 4e-3, "{}", sample.position[0]);
    assert!((corrected.spec().pos_range[1] - 0.04).abs() < 1e-12);
}

/// A device that counts the ticks in which it is asked.
struct Counted<D>(D, usize);

impl<D: Device> Device for Counted<D> {
    fn spec(&self) -> &DeviceSpec {
        self.0.spec()
    }

    fn send(&mut self, force: &SafeForce) -> Result<(), DeviceLoss> {
        self.1 += 1;
        self.0.send(force)
    }

    fn receive(&mut self, into: &mut DeviceSample, deadline: Instant) -> Result<bool, DeviceLoss> {
        self.0.receive(into, deadline)
    }

    fn in_lockstep(&self) -> bool {
        self.0.in_lockstep()
    }

    fn zero(&mut self) {
        self.0.zero();
    }

    fn stats(&self) -> WireStats {
        self.0.stats()
    }
}

/// Twelve keys, the third held by a hand and the fifth with a reversed motor, take no longer than one: below 5 s.
#[test]
fn directions_of_twelve_axes_together() {
    const AXES: usize = 12;
    let plain_key = KeyConstants::default();
    let mut hands = vec![EmulatedHand::Resting; AXES];
    hands[2] = EmulatedHand::OnPath {
        path: vec![0.0; 100_000],
        stiffness: 5e4,
        damping: 20.0,
    };
    let twelve_keys = EmulatedKeys::new(AXES, plain_key, 1.0 / PERIOD, hands).unwrap();
    let emulated = EmulatedDevice::new(twelve_keys, plain_key);
    let mut axes = vec![AxisCalibration::without_corrections(emulated.spec()); AXES];
    axes[4].sign = -1.0;
    let mut counted = Counted(CalibratedDevice::new(emulated, axes), 0);
    counted.0.spec.pos_lsb = 1e-4;
    let pulse = TestPulse::from_spec(counted.spec());
    let axis_numbers: Vec<usize> = (0..AXES).collect();
    let axis_signs = find_directions(&mut counted, &axis_numbers, pulse, PERIOD, &GO).unwrap();
    for (axis, sign) in axis_signs.into_iter().enumerate() {
        let expected = match axis {
            2 => Err(DirectionError::NoMotion),
            4 => Ok(-1.0),
            _ => Ok(1.0),
        };
        assert_eq!(sign, expected, "axis {axis}");
    }
    assert!(counted.1 as f64 * PERIOD < 5.0, "{} ticks", counted.1);
}
