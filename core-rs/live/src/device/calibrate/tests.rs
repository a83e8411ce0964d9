use super::*;
use crate::device::Emulated;
use crate::emulate::{Hand, Key, Keys};

const PERIOD: f64 = 1e-3;
static GO: AtomicBool = AtomicBool::new(false);

fn device(hand: Hand) -> Emulated {
    let key = Key::default();
    let keys = Keys::new(1, key, 1.0 / PERIOD, vec![hand]).unwrap();
    Emulated::new(keys, key)
}

/// A device with a motor of reversed polarity, and a sensor with another scale and another zero.
fn odd(device: Emulated) -> Calibrated<Emulated> {
    let axis = Axis {
        sign: -1.0,
        offset: 0.01,
        gain: 2.0,
        ..Axis::plain(device.spec())
    };
    Calibrated::new(device, vec![axis])
}

#[test]
fn a_pulse_tells_the_direction() {
    let mut straight = device(Hand::Resting);
    let pulse = Pulse::from_spec(straight.spec());
    assert_eq!(direction(&mut straight, 0, pulse, PERIOD, &GO), Ok(1.0));
    let mut wired = odd(device(Hand::Resting));
    assert_eq!(direction(&mut wired, 0, pulse, PERIOD, &GO), Ok(-1.0));
    // The calibration that was found corrects the device.
    let result = Axis {
        sign: -1.0,
        ..Axis::plain(wired.spec())
    };
    let mut right = Calibrated::new(wired, vec![result]);
    assert_eq!(direction(&mut right, 0, pulse, PERIOD, &GO), Ok(1.0));
}

#[test]
fn a_pulse_is_small() {
    let mut straight = device(Hand::Resting);
    let pulse = Pulse::from_spec(straight.spec());
    direction(&mut straight, 0, pulse, PERIOD, &GO).unwrap();
    let range = travel_ends(&mut straight, 0.1, PERIOD, &GO).unwrap()[0];
    let travel = straight.spec().pos_range[1] - straight.spec().pos_range[0];
    assert!(range[1] - range[0] < 1e-6, "at rest: {range:?}");
    assert!(range[0].abs() < 0.1 * travel, "{range:?}");
}

#[test]
fn an_axis_that_is_held_is_not_guessed() {
    let held = Hand::OnPath {
        path: vec![0.0; 100_000],
        stiffness: 5e4,
        damping: 20.0,
    };
    let mut held = device(held);
    let sensor = Spec {
        pos_lsb: 1e-3,
        ..held.spec().clone()
    };
    let pulse = Pulse::from_spec(&sensor);
    let mut coarse = Calibrated::new(&mut held, vec![]);
    coarse.spec.pos_lsb = 1e-3;
    assert_eq!(
        direction(&mut coarse, 0, pulse, PERIOD, &GO),
        Err(DirectionError::Still)
    );
}

#[test]
fn ends_give_zero_and_gain() {
    let path = (0..200).map(|i| if i < 100 { 0.01 } else { -0.03 });
    let hand = Hand::OnPath {
        path: path.collect(),
        stiffness: 2000.0,
        damping: 40.0,
    };
    let mut device = device(hand);
    let ends = travel_ends(&mut device, 0.2, PERIOD, &GO).unwrap()[0];
    assert!(
        (ends[0] + 0.03).abs() < 2e-3 && (ends[1] - 0.01).abs() < 2e-3,
        "{ends:?}"
    );
    // By the ruler, the ends are 80 mm apart: the device reports half the true distance.
    let axis = Axis::plain(device.spec()).between(ends, 0.08);
    let mut right = Calibrated::new(device, vec![axis]);
    let mut sample = Sample::default();
    right.receive(&mut sample, Instant::now()).unwrap();
    assert!(
        (sample.position[0] + 0.04).abs() < 4e-3,
        "{}",
        sample.position[0]
    );
    assert!((right.spec().pos_range[1] - 0.04).abs() < 1e-12);
}
