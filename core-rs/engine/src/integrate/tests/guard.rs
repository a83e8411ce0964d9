//! Links that stiffen until a method would diverge: the guard continues in finer steps.

use super::*;
use crate::network::LinkKind;

const FRAMES: usize = 1100;
const CENTRE: usize = 165;
const EACH: f64 = 1.0 / 331.0;

/// Energy of all links, and kinetic energy of masses from the step of one frame [J].
fn energies(network: &Network, x: &[f64], before: &[f64]) -> [f64; 2] {
    let link_energies = network.runs().iter().flat_map(|run| {
        let LinkKind::Lnl(link_law) = &run.kind else {
            panic!("a mesh that hardens");
        };
        (0..run.len).map(move |i| link_law.potential(x[run.b + i] - x[run.a + i]))
    });
    let moving_masses = network.mats().m.iter().zip(x.iter().zip(before));
    let kinetic = moving_masses.map(|(m, (x, before))| {
        let velocity = (x - before) * HERTZ;
        0.5 * m * velocity * velocity
    });
    [link_energies.sum(), kinetic.sum()]
}

/// No losses, strikes up to 32 times as hard as CA alone withstands. Neither the potential nor the kinetic energy
/// exceeds the total by much (the velocity is a mean over a frame, which lowers the kinetic energy), and at the end the
/// total is what was put in.
#[test]
fn undamped_gong_keeps_its_energy_with_finer_frames() {
    let network = hex(1e13, None);
    for method in [MeshMethod::Ca, MeshMethod::Ca2p] {
        for v in [32.0, 64.0, 128.0, 256.0] {
            let struck_energy = 0.5 * EACH * v * v;
            let mut integrator = by(&network, method, 1);
            integrator.step(&[(CENTRE, v * EACH)], &mut ThreadTeam::alone());
            let (mut positions_before, mut mean_energy) = (integrator.positions().to_vec(), 0.0);
            for n in 0..4 * FRAMES {
                integrator.step(&[], &mut ThreadTeam::alone());
                assert!(integrator.is_bounded(), "{method:?} {v}");
                let frame_energies = energies(&network, integrator.positions(), &positions_before);
                assert!(
                    frame_energies.iter().all(|one| *one < 1.2 * struck_energy),
                    "{method:?} {v} {n} {frame_energies:?}"
                );
                if n >= 3 * FRAMES {
                    mean_energy += (frame_energies[0] + frame_energies[1]) / FRAMES as f64;
                }
                positions_before.copy_from_slice(integrator.positions());
            }
            assert!(
                integrator
                    .finer_frames()
                    .is_some_and(|finer_frames| finer_frames.steps_max >= 2),
                "{method:?} {v}"
            );
            assert!(
                (0.8..1.1).contains(&(mean_energy / struck_energy)),
                "{method:?} {v} {}",
                mean_energy / struck_energy
            );
        }
    }
}

/// If all frames of CA are computed in eight finer steps, they equal CA at eight times the rate up to rounding errors,
/// which grow.
#[test]
fn eight_finer_steps_equal_eight_times_the_rate() {
    let network = hex_of(10, 60.0, 1e13, Some(2.0));
    let centre_strike = [(0, CENTRE, 256.0 * EACH)];
    let fine_path = play(by(&network, MeshMethod::Ca, 8), 60, &centre_strike);
    let finer_error = error_db(&play(by(&network, MeshMethod::Ca, 1), 60, &centre_strike), &fine_path);
    assert!(finer_error < -250.0, "{finer_error}");
}

#[test]
fn finer_frames_of_a_gong_do_not_allocate() {
    let network = hex(1e13, Some(2.0));
    for method in [MeshMethod::Ca, MeshMethod::Ca2p] {
        let mut integrator = by(&network, method, 1);
        integrator.step(&[(CENTRE, 64.0 * EACH)], &mut ThreadTeam::alone());
        reset_violation_count();
        assert_no_alloc(|| (0..200).for_each(|_| integrator.step(&[], &mut ThreadTeam::alone())));
        assert_eq!(violation_count(), 0, "{method:?}");
        assert!(
            integrator
                .finer_frames()
                .is_some_and(|finer_frames| finer_frames.frames > 100)
        );
    }
}
