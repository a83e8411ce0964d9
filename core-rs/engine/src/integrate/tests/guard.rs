//! Links that stiffen until a method would diverge: the guard continues in finer steps.

use super::*;
use crate::network::LinkKind;

const FRAMES: usize = 1100;
const CENTRE: usize = 165;
const EACH: f64 = 1.0 / 331.0;

/// Energy of all links, and kinetic energy of masses from the step of one frame [J].
fn energies(network: &Network, x: &[f64], before: &[f64]) -> [f64; 2] {
    let links = network.runs().iter().flat_map(|run| {
        let LinkKind::Lnl(law) = &run.kind else {
            panic!("a mesh that hardens");
        };
        (0..run.len).map(move |i| law.potential(x[run.b + i] - x[run.a + i]))
    });
    let masses = network.mats().m.iter().zip(x.iter().zip(before));
    let kinetic = masses.map(|(m, (x, before))| {
        let v = (x - before) * HERTZ;
        0.5 * m * v * v
    });
    [links.sum(), kinetic.sum()]
}

/// No losses, strikes up to 32 times as hard as CA alone withstands. Neither the potential nor the kinetic energy
/// exceeds the total by much (the velocity is a mean over a frame, which lowers the kinetic energy), and at the end the
/// total is what was put in.
#[test]
fn undamped_gong_keeps_its_energy_with_finer_frames() {
    let network = hex(1e13, None);
    for method in [MeshMethod::Ca, MeshMethod::Ca2p] {
        for v in [32.0, 64.0, 128.0, 256.0] {
            let put_in = 0.5 * EACH * v * v;
            let mut it = by(&network, method, 1);
            it.step(&[(CENTRE, v * EACH)], &mut ThreadTeam::alone());
            let (mut before, mut sum) = (it.positions().to_vec(), 0.0);
            for n in 0..4 * FRAMES {
                it.step(&[], &mut ThreadTeam::alone());
                assert!(it.sound(), "{method:?} {v}");
                let both = energies(&network, it.positions(), &before);
                assert!(
                    both.iter().all(|one| *one < 1.2 * put_in),
                    "{method:?} {v} {n} {both:?}"
                );
                if n >= 3 * FRAMES {
                    sum += (both[0] + both[1]) / FRAMES as f64;
                }
                before.copy_from_slice(it.positions());
            }
            assert!(
                it.finer_frames()
                    .is_some_and(|finer_frames| finer_frames.steps_max >= 2),
                "{method:?} {v}"
            );
            assert!(
                (0.8..1.1).contains(&(sum / put_in)),
                "{method:?} {v} {}",
                sum / put_in
            );
        }
    }
}

/// If all frames of CA are computed in eight finer steps, they equal CA at eight times the rate up to rounding errors,
/// which grow.
#[test]
fn eight_finer_steps_equal_eight_times_the_rate() {
    let network = hex_of(10, 60.0, 1e13, Some(2.0));
    let strike = [(0, CENTRE, 256.0 * EACH)];
    let truth = play(by(&network, MeshMethod::Ca, 8), 60, &strike);
    let error = decibels(&play(by(&network, MeshMethod::Ca, 1), 60, &strike), &truth);
    assert!(error < -250.0, "{error}");
}

#[test]
fn finer_frames_of_a_gong_do_not_allocate() {
    let network = hex(1e13, Some(2.0));
    for method in [MeshMethod::Ca, MeshMethod::Ca2p] {
        let mut it = by(&network, method, 1);
        it.step(&[(CENTRE, 64.0 * EACH)], &mut ThreadTeam::alone());
        reset_violation_count();
        assert_no_alloc(|| (0..200).for_each(|_| it.step(&[], &mut ThreadTeam::alone())));
        assert_eq!(violation_count(), 0, "{method:?}");
        assert!(
            it.finer_frames()
                .is_some_and(|finer_frames| finer_frames.frames > 100)
        );
    }
}
