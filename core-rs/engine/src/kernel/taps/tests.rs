use super::*;
use crate::network::Network;
use crate::units::Rate;

fn scene(n: usize) -> (Network, ModuleState) {
    let mut network = Network::new();
    network.part("p", None);
    for i in 0..n {
        network.mas(&format!("m{i}"), 1.0, 0.0, 0.0).unwrap();
    }
    let scheme = Scheme::new(&network, Rate::new(44_100.0).unwrap()).unwrap();
    // Of very different sizes, so that any other order of summation shows in the last bits.
    let positions: Vec<f64> = (0..n)
        .map(|i| (1.0 + i as f64) / 3.0 * [1.0, -1e-9, 1e7, -1e-3][i % 4])
        .collect();
    let zero_steps = vec![0.0; n];
    (network, ModuleState::new(&scheme, positions, zero_steps))
}

/// The tree is part of the definition of a sample: eight lanes, then ((0+4)+(2+6))+((1+5)+(3+7)).
#[test]
fn sum_is_a_fixed_tree() {
    for n in [2, 7, 8, 9, 19, 64] {
        let (_, body) = scene(n);
        let lane_sum = |k: usize| body.x.iter().skip(k).step_by(8).fold(0.0, |sum, x| sum + x);
        let expected_sum = ((lane_sum(0) + lane_sum(4)) + (lane_sum(2) + lane_sum(6)))
            + ((lane_sum(1) + lane_sum(5)) + (lane_sum(3) + lane_sum(7)));
        assert_eq!(range_sum(&body.x).to_bits(), expected_sum.to_bits(), "{n}");
    }
    assert_eq!(range_sum(&[]), 0.0);
    assert_eq!(range_sum(&[-0.0]).to_bits(), (-0.0_f64).to_bits(), "one is itself");
}

#[test]
fn taps_have_signs_and_weights_of_terms() {
    let mut network = Network::new();
    network.part("p", None);
    let ground_tie = crate::network::Tie::Physical { k: 7.0, z: 0.1 };
    let cel_index = network.cel("a", 1.0, ground_tie, 0.25, 0.5, 0.0).unwrap();
    let mas_index = network.mas("b", 1.0, 2.0, 0.0).unwrap();
    let link_index = network.spring("l", cel_index, mas_index, 3.0, 0.0, 0.0).unwrap();
    let (len, first) = (1, cel_index);
    network
        .listen(
            "all",
            vec![
                Term::Position {
                    first,
                    len: 2,
                    weight: 10.0,
                },
                Term::Force {
                    first: link_index,
                    len,
                    weight: 100.0,
                },
                Term::Ground {
                    first,
                    len,
                    weight: 1000.0,
                },
            ],
        )
        .unwrap();
    let scheme = Scheme::new(&network, Rate::new(44_100.0).unwrap()).unwrap();
    let mut modules = ModuleState::new(&scheme, vec![0.5, 2.0], vec![0.0; 2]);
    modules.link_forces[link_index] = 4.5;
    let mut tap_frame = [f64::NAN];
    write_outputs(&scheme, &modules, &mut tap_frame);
    // Positions 2.5; the link pulls b by −4.5; the force on the ground is 7·(0.5 − 0.25).
    assert_eq!(tap_frame, [25.0 - 450.0 + 1750.0]);
}

/// Members that are not adjacent are summed by the same tree as adjacent ones.
#[test]
fn taps_of_scattered_members_equal_a_row() {
    let (mut network, body) = scene(40);
    let member_terms: Vec<Term> = (0..40)
        .map(|first| Term::Position {
            first,
            len: 1,
            weight: 0.5,
        })
        .collect();
    network.listen("apart", member_terms).unwrap();
    let first = Term::Position {
        first: 0,
        len: 40,
        weight: 0.5,
    };
    network.listen("row", vec![first]).unwrap();
    let scheme = Scheme::new(&network, Rate::new(44_100.0).unwrap()).unwrap();
    let mut tap_frame = [0.0; 2];
    write_outputs(&scheme, &body, &mut tap_frame);
    assert_eq!(tap_frame[0].to_bits(), tap_frame[1].to_bits());
}
