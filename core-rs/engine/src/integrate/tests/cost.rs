//! Cost of a frame on the gong: `cargo test --release -p ergon-engine --lib integrate::tests::cost -- --ignored --nocapture`.

use std::time::Instant;

use super::*;

#[test]
#[ignore = "a timing"]
fn of_a_frame() {
    let mut reference = f64::NAN;
    for (q, t60) in [(1e13, Some(2.0)), (1e13, None), (0.0, Some(2.0))] {
        let network = hex(q, t60);
        for way in Way::ALL {
            if way == Way::Trapezoid && q != 0.0 {
                continue;
            }
            let frames = if way == Way::Ieq { 2000 } else { 10_000 };
            let mut best = f64::INFINITY;
            for _ in 0..5 {
                let mut it = by(&network, way, 1);
                it.step(&[(165, 2.0 / 331.0)]);
                let start = Instant::now();
                for _ in 0..frames {
                    it.step(&[]);
                }
                best = best.min(start.elapsed().as_secs_f64() / f64::from(frames));
                assert!(it.sound());
            }
            if way == Way::Ca {
                reference = best;
            }
            eprintln!(
                "q {q:.0e} t60 {t60:?} {way:?}: {:.0} ns a frame, {:.2} of CA",
                1e9 * best,
                best / reference
            );
        }
    }
}
