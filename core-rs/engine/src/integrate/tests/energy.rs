//! What each method keeps, and what it survives.

use super::*;

/// Largest change of a method's energy after its first frames, relative; +∞ where it went unsound.
fn drift(mut it: Integrator, frames: usize) -> f64 {
    it.step(&[]);
    let start = it.energy();
    let mut most = 0.0_f64;
    for _ in 0..frames {
        it.step(&[]);
        if !it.sound() {
            return f64::INFINITY;
        }
        most = most.max((it.energy() / start - 1.0).abs());
    }
    most
}

#[test]
fn linear_bodies_keep_their_energy_to_rounding() {
    let network = row(20, 2e5, 0.0, 0.0);
    for way in Way::ALL {
        let drift = drift(by(&network, way, 1), 4000);
        eprintln!("linear {way:?} drift {drift:.2e}");
    }
}

/// Links so hard that CA is thrown off at once: IEQ keeps its energy.
#[test]
fn a_hard_cubic_chain() {
    for q in [1e12, 1e13, 1e14, 1e16] {
        let network = row(20, 2e5, q, 0.0);
        for way in [Way::Ca, Way::Ca2p, Way::Bm4, Way::Ieq] {
            let drift = drift(by(&network, way, 1), 4000);
            eprintln!("cubic q={q:.0e} {way:?} drift {drift:.2e}");
        }
    }
}

/// Springs far beyond what the rate carries.
#[test]
fn stiff_springs() {
    for k in [1e6, 1e7, 1e9] {
        for q in [0.0, 1e14] {
            let network = row(20, k, q, 0.0);
            for way in [Way::Ieq, Way::Trapezoid] {
                if way == Way::Trapezoid && q != 0.0 {
                    continue;
                }
                let drift = drift(by(&network, way, 1), 4000);
                eprintln!("stiff k={k:.0e} q={q:.0e} {way:?} drift {drift:.2e}");
            }
        }
    }
}
