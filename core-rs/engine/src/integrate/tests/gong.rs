//! Who wins on a mesh of 331 masses with links that harden.

use super::*;

const FRAMES: usize = 1100; // 25 ms
const CENTRE: usize = 165;
const EACH: f64 = 1.0 / 331.0;

#[test]
fn errors_on_a_struck_gong() {
    for (q, v) in [(1e13, 1.0), (1e13, 4.0)] {
        let network = hex(q, Some(2.0));
        let strike = [(0, CENTRE, v * EACH)];
        let truth = play(by(&network, Way::Bm4, 16), FRAMES, &strike);
        for way in [Way::Ca, Way::Ca2p, Way::Bm4, Way::Ieq] {
            let error = decibels(&play(by(&network, way, 1), FRAMES, &strike), &truth);
            eprintln!("gong q={q:.0e} v={v} {way:?} {error:.1} dB");
        }
    }
}

#[test]
fn strike_sweep() {
    let network = hex(1e13, Some(2.0));
    for way in [Way::Ca, Way::Ca2p, Way::Bm4, Way::Ieq] {
        let mut line = String::new();
        for v in [0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0] {
            let path = play(by(&network, way, 1), FRAMES, &[(0, CENTRE, v * EACH)]);
            line += if path.len() == FRAMES { " ok" } else { " --" };
        }
        eprintln!("sweep {way:?}{line}");
    }
}
