//! The loops chosen for this processor give the same bits as the same sums computed one after the other.

use std::hint::black_box;

use proptest::prelude::*;

use super::mats::{move_all, move_equal, move_equal_from, move_from};
use super::pull::add_link_forces_wide;
use super::runs::{EndMotions, set_hardening_forces, set_spring_forces};
use super::taps::lane_sum;
use crate::law::Law;

fn numbers(n: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-3.0f64..3.0, n)
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

proptest! {
    #[test]
    fn masses_kernel_equals_plain_loop(
        (w, kappa, zeta, rest, force, x, d) in (0usize..70).prop_flat_map(|n| {
            let some = || numbers(n);
            (some(), some(), some(), some(), some(), some(), some())
        }),
    ) {
        let (mut moved, mut steps) = (x.clone(), d.clone());
        prop_assert!(move_all([&w, &kappa, &zeta, &rest], &force, &mut moved, &mut steps));
        for i in 0..x.len() {
            let step = black_box(force[i] * w[i]) - black_box(kappa[i] * (x[i] - rest[i]));
            let step = black_box(step) - black_box(zeta[i] * d[i]);
            let step = d[i] + black_box(step);
            prop_assert_eq!(steps[i].to_bits(), step.to_bits());
            prop_assert_eq!(moved[i].to_bits(), (x[i] + black_box(step)).to_bits());
        }
    }

    #[test]
    fn masses_kernel_with_equal_masses(
        (force, x, d) in (0usize..70).prop_flat_map(|n| (numbers(n), numbers(n), numbers(n))),
        one in prop::array::uniform4(-3.0f64..3.0),
    ) {
        let each = one.map(|one| vec![one; x.len()]);
        let each: [&[f64]; 4] = std::array::from_fn(|i| &each[i][..]);
        let (mut moved, mut steps) = (x.clone(), d.clone());
        move_all(each, &force, &mut moved, &mut steps);
        let truth = (bits(&moved), bits(&steps));
        let from = [&x[..], &d[..]];
        type Way<'a> = &'a dyn Fn(&mut [f64], &mut [f64]) -> bool;
        let ways: [Way<'_>; 3] = [
            &|moved, steps| move_equal(one, &force, moved, steps),
            &|moved, steps| move_from(each, &force, from, moved, steps),
            &|moved, steps| move_equal_from(one, &force, from, moved, steps),
        ];
        for way in ways {
            let (mut moved, mut steps) = (x.clone(), d.clone());
            prop_assert!(way(&mut moved, &mut steps));
            prop_assert_eq!(&(bits(&moved), bits(&steps)), &truth);
        }
    }

    /// A MAT that is at end a and at end b adds the force of end a first, whatever the distance between the ends.
    #[test]
    fn pulls_kernel_equals_plain_loop(
        f in (0usize..70).prop_flat_map(numbers),
        start in numbers(160),
        (a, b) in (0usize..90, 0usize..90),
    ) {
        let mut plain = start.clone();
        for (i, f) in f.iter().enumerate() {
            plain[a + i] = black_box(plain[a + i] + f);
        }
        for (i, f) in f.iter().enumerate() {
            plain[b + i] = black_box(plain[b + i] - f);
        }
        let mut force = start;
        add_link_forces_wide(&f, &mut force, a, b);
        prop_assert_eq!(bits(&force), bits(&plain));
    }

    #[test]
    fn links_kernel_equals_plain_loop(
        (xa, xb, da, db) in (0usize..70)
            .prop_flat_map(|n| (numbers(n), numbers(n), numbers(n), numbers(n))),
        (k, q, z, rest) in (0.0f64..1e4, 0.0f64..1e8, -1.0f64..10.0, -0.1f64..0.1),
    ) {
        let n = xa.len();
        let ends = EndMotions { xa: &xa, xb: &xb, da: &da, db: &db };
        let mut forces = vec![0.0; n];
        set_spring_forces(k, z, rest, &ends, &mut forces);
        for i in 0..n {
            let stretch = black_box(xb[i] - xa[i]) - rest;
            let force = black_box(k * stretch) + black_box(z * black_box(db[i] - da[i]));
            prop_assert_eq!(forces[i].to_bits(), force.to_bits());
        }
        // A damping of 0 equals no damping.
        let law = Law::hardening(k, q, z.max(0.0)).expect("a law");
        set_hardening_forces(law.hardening_spring().expect("it hardens"), 44_100.0, rest, &ends, &mut forces);
        let e: Vec<f64> = (0..n).map(|i| xb[i] - xa[i] - rest).collect();
        let v: Vec<f64> = (0..n).map(|i| (db[i] - da[i]) * 44_100.0).collect();
        let mut by_expression = vec![0.0; n];
        law.eval_run(&e, &v, &mut by_expression, &mut law.scratch());
        prop_assert_eq!(bits(&forces), bits(&by_expression));
    }

    #[test]
    fn lanes(values in (0usize..70).prop_flat_map(numbers)) {
        let mut lanes = [0.0; 8];
        for (i, value) in values.iter().enumerate() {
            lanes[i % 8] = black_box(lanes[i % 8] + value);
        }
        let [a, b, c, d, e, f, g, h] = lanes;
        let sum = ((a + e) + (c + g)) + ((b + f) + (d + h));
        prop_assert_eq!(lane_sum(&values).to_bits(), sum.to_bits());
    }
}
