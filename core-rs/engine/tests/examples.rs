//! The results of the examples are what their comments say.
#![allow(clippy::disallowed_methods)] // a test needs no bits that are the same everywhere

#[path = "../examples/gesture.rs"]
mod gesture;
#[path = "../examples/struck_string.rs"]
mod struck_string;

#[test]
fn gesture_example_moves_its_key_along_the_path() {
    let x = gesture::path().unwrap();
    assert!((x[4410] - 6e-3).abs() < 1e-8, "{}", x[4410]); // 100 ms
    assert!(x[13_230].abs() < 1e-8, "{}", x[13_230]); // 300 ms: at rest where it began
}

#[test]
fn struck_string_example_sounds_at_its_pitch() {
    let x = struck_string::sound().unwrap();
    assert!(x[..441].iter().all(|x| *x == 0.0)); // before the strike
    // 61 springs of 50 kN/m between 60 masses of 1 g and two fixed ends: sqrt(K/M)/π·sin(π/122) = 57.95 Hz.
    let pitch = (5e4f64 / 1e-3).sqrt() / std::f64::consts::PI * (std::f64::consts::PI / 122.0).sin();
    let peak = |hertz: f64| {
        let turn = std::f64::consts::TAU * hertz / 44_100.0;
        let (c, s) = x.iter().enumerate().fold((0.0, 0.0), |(c, s), (i, x)| {
            let (sin, cos) = (turn * i as f64).sin_cos();
            (c + x * cos, s + x * sin)
        });
        f64::hypot(c, s)
    };
    assert!(peak(pitch) > 3.0 * peak(pitch * 1.5), "{pitch} Hz");
}
