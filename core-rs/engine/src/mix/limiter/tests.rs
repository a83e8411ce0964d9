use proptest::prelude::*;

use super::*;

const RATE: f64 = 8000.0;

fn limited(x: &[f64], n_channels: usize, ceiling: f64) -> Vec<f64> {
    let mut processed = x.to_vec();
    Limiter::new(RATE, n_channels, ceiling).unwrap().process(&mut processed);
    processed
}

/// Samples of any size, as a broken instrument may send them.
fn samples() -> impl Strategy<Value = Vec<f64>> {
    let any_sample = prop_oneof![
        4 => -1.0..1.0f64,
        2 => -30.0..30.0f64,
        1 => prop::num::f64::ANY,
    ];
    prop::collection::vec(any_sample, 0..400)
}

proptest! {
    #[test]
    fn limiter_output_stays_below_the_ceiling(mut x in samples(), ceiling in 1e-3..2.0f64, n in 1usize..4) {
        x.truncate(x.len() / n * n);
        x.extend(vec![0.0; 41 * n]);
        for y in limited(&x, n, ceiling) {
            prop_assert!(y.abs() <= ceiling);
        }
    }

    #[test]
    fn limiter_in_blocks_of_any_size(x in samples(), cuts in prop::collection::vec(0usize..50, 1..60)) {
        let whole = limited(&x, 1, 0.7);
        let mut limiter = Limiter::new(RATE, 1, 0.7).unwrap();
        let (mut pieces, mut rest) = (x.clone(), 0);
        for cut in cuts.into_iter().chain([x.len()]) {
            let stop = (rest + cut).min(x.len());
            limiter.process(&mut pieces[rest..stop]);
            rest = stop;
        }
        prop_assert_eq!(bits(&whole), bits(&pieces));
    }

    #[test]
    fn limiter_below_the_ceiling_is_a_delay(mut x in prop::collection::vec(-0.5..=0.5f64, 80..300)) {
        x.truncate(x.len() / 2 * 2);
        let y = limited(&x, 2, 0.5);
        let late = 2 * Limiter::new(RATE, 2, 0.5).unwrap().latency();
        prop_assert_eq!(bits(&y[late..]), bits(&x[..x.len() - late]));
        prop_assert!(y[..late].iter().all(|&y| y == 0.0));
    }
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

/// One peak of twice the ceiling in a constant signal: the gain is read off the signal.
#[test]
fn limiter_gain_falls_straight_and_returns_exactly() {
    let latency = 40;
    let mut signal = vec![0.25; 16_000];
    signal[1000] = 2.0;
    let gain_path: Vec<f64> = limited(&signal, 1, 1.0)[latency..].iter().map(|y| y / 0.25).collect();
    let check_gain = |i: usize, wanted: f64| {
        assert!(
            (gain_path[i] - wanted).abs() < 1e-9,
            "{i}: {} is not {wanted}",
            gain_path[i]
        );
    };
    assert!(gain_path[..960].iter().all(|&g| g == 1.0), "nothing before its time");
    check_gain(960, 1.0 - 0.5 / 41.0);
    check_gain(980, 1.0 - 21.0 * 0.5 / 41.0);
    // x[1000] = 2 leaves at the ceiling.
    check_gain(1000, 4.0);
    assert!(gain_path[1000] * 0.25 <= 1.0);
    // After the hold, 1 − g falls by a factor of e in 50 ms (400 frames), once the peak has left the mean.
    let fall_ratio = (1.0 - gain_path[1500]) / (1.0 - gain_path[1100]);
    assert!((fall_ratio - maths::exp(-1.0)).abs() < 1e-9, "{fall_ratio}");
    assert!(gain_path[14_000..].iter().all(|&g| g == 1.0), "and then it is gone");
}

#[test]
fn limiter_applies_the_same_gain_to_all_channels() {
    let input_frames: Vec<f64> = (0..500).flat_map(|i| [if i == 200 { 3.0 } else { 0.1 }, 0.2]).collect();
    let output_frames = limited(&input_frames, 2, 0.9);
    for frame in output_frames.chunks(2).skip(40).filter(|frame| frame[0] < 0.5) {
        assert!((frame[1] / frame[0] - 2.0).abs() < 1e-15);
    }
}

#[test]
fn limiter_with_wrong_settings_is_refused() {
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
        assert!(matches!(Limiter::new(rate, 1, 1.0), Err(LimiterError::Rate(_))));
    }
    for ceiling in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(Limiter::new(RATE, 1, ceiling), Err(LimiterError::Ceiling(_))));
    }
    assert_eq!(Limiter::new(RATE, 5000, 1.0).unwrap_err(), LimiterError::Channels(5000));
    assert_eq!(Limiter::new(44_100.0, 1, 1.0).unwrap().latency(), 221);
}
