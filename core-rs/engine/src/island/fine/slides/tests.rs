//! Dry friction between frames, against closed forms.

use std::f64::consts::PI;
use std::sync::Arc;

use crate::island::{ContactOrder, Island, OnFault, SimulationOptions, StepNumbers};
use crate::kernel::thread_team::ThreadTeam;
use crate::maths::cos;
use crate::network::Dry;
use crate::network::{Network, Term, Tie};
use crate::timeline::Timeline;
use crate::units::Rate;

const RATE: f64 = 44_100.0;
const LISTEN: Term = Term::Position {
    first: 0,
    len: 1,
    weight: 1.0,
};

/// Friction at a level [N] that does not depend on the velocity.
fn plain(level: f64) -> Dry {
    Dry {
        level,
        static_level: level,
        speed: 1.0,
    }
}

/// Positions of the first MAT of a network, frame by frame [m].
fn played(network: &Network, (rate, steps): (f64, usize), n_frames: usize) -> Vec<f64> {
    let timeline = Timeline::new(Rate::new(rate).unwrap());
    let options = SimulationOptions {
        keeps_ledger: false,
        records_ergons: false,
        on_fault: OnFault::Stop,
        threads: 1,
        is_unchecked: false,
    };
    let step_numbers = StepNumbers {
        contact_substeps: steps,
        contact_order: ContactOrder::Fourth,
        oversampling: 1,
        frame_interval: 1,
    };
    let mut island = Island::new(Arc::new(network.clone()), &timeline, &[], step_numbers, options).unwrap();
    let mut listened = vec![0.0; n_frames];
    island
        .process(&mut listened, n_frames, &mut ThreadTeam::alone())
        .unwrap();
    listened
}

#[test]
fn sliding_block_swings_about_shifted_centres() {
    let (m, f, x0) = (0.05, 1331.9, 1.26e-3);
    let omega = 2.0 * PI * f;
    for ratio in [0.507, 0.12, 0.031] {
        let friction_level = ratio * m * omega * omega * x0;
        let mut network = Network::new();
        network.part("s", None);
        let ground_tie = Tie::Tuned { f, t60: None };
        let block = network.cel("m", m, ground_tie, 0.0, x0, 0.0).unwrap();
        let ground = network.sol("w", 0.0).unwrap();
        network.dry("l", ground, block, plain(friction_level)).unwrap();
        network.listen("o", vec![LISTEN]).unwrap();
        let listened = played(&network, (RATE, 2), 400);
        let centre_shift = friction_level / (m * omega * omega);
        let exact_position = |frame: usize| {
            let swing_phase = omega * frame as f64 / RATE;
            let mut half_swing = (swing_phase / PI) as usize;
            // The amplitude falls by 2·shift with each half swing, until the block is held where it turns.
            let turns_at = |half_swing: usize| {
                let swing_sign = if half_swing.is_multiple_of(2) { 1.0 } else { -1.0 };
                swing_sign * (x0 - 2.0 * centre_shift * half_swing as f64)
            };
            let last_swing = (0..)
                .find(|&half_swing| turns_at(half_swing).abs() <= centre_shift)
                .unwrap();
            if half_swing >= last_swing {
                return turns_at(last_swing);
            }
            let swing_centre = if half_swing.is_multiple_of(2) {
                centre_shift
            } else {
                -centre_shift
            };
            let start_offset = turns_at(half_swing) - swing_centre;
            half_swing = half_swing.min(last_swing);
            swing_centre + start_offset * cos(swing_phase - half_swing as f64 * PI)
        };
        for (frame, x) in listened.iter().enumerate() {
            let position_error = (x - exact_position(frame)).abs();
            assert!(
                position_error < 1e-9 * x0,
                "{ratio} {frame}: {x} {}",
                exact_position(frame)
            );
        }
    }
}

#[test]
fn sticking_block_rests_to_the_last_bit() {
    let mut network = Network::new();
    network.part("s", None);
    let ground_tie = Tie::Tuned {
        f: 90.47,
        t60: Some(2.507),
    };
    let x0 = -1.038e-4;
    let block = network.cel("m", 0.01532, ground_tie, 0.0, x0, 0.0).unwrap();
    let ground = network.sol("g", 0.0).unwrap();
    network.dry("l", ground, block, plain(0.80275)).unwrap();
    network.listen("o", vec![LISTEN]).unwrap();
    for finer in [1, 2, 8] {
        let fineness = (RATE * finer as f64, 2 * finer);
        for (frame, x) in played(&network, fineness, 2000).into_iter().enumerate() {
            assert!(x == x0, "{finer} {frame}: {x:e}");
        }
    }
}
