//! Every vector type that this processor has gives the same bits as the plain loop.

use proptest::prelude::*;

use super::*;

fn lanes() -> impl Strategy<Value = Lanes> {
    prop::collection::vec(-1.9f64..1.9, LANES).prop_map(|values| {
        let mut test_lanes = Lanes::ZERO;
        test_lanes.0.copy_from_slice(&values);
        test_lanes
    })
}

fn bits(motion: &Motion, sums: &[Sum]) -> Vec<u64> {
    let all_lanes = motion.now.0.iter().chain(&motion.before.0);
    let all_lanes = all_lanes.chain(sums.iter().flat_map(|sum| &sum.0));
    all_lanes.map(|value| value.to_bits()).collect()
}

proptest! {
    #[test]
    fn bank_kernels_of_any_width_agree_bitwise(
        a in lanes(), b in lanes(), now in lanes(), before in lanes(),
        weights in prop::collection::vec(lanes(), 2..4), n in 0usize..9,
    ) {
        let b = Lanes(b.0.map(|b| b.abs() / 2.0));
        let rates = Rates { a, b };
        let start = Motion { now, before };
        let sums = vec![Sum([0.25; SUMS]); 3 * n];
        let (mut motion, mut heard) = (start.clone(), sums[..n].to_vec());
        // SAFETY: the plain loop needs nothing.
        unsafe { plain::run(&rates, &mut motion, &mut heard) };
        let (mut wide, mut wide_heard) = (start.clone(), sums[..n].to_vec());
        run(&rates, &mut wide, &mut wide_heard);
        prop_assert_eq!(bits(&motion, &heard), bits(&wide, &wide_heard));
        let (mut motion, mut heard) = (start.clone(), sums.clone());
        // SAFETY: as above.
        unsafe { plain::weighted(&rates, &mut motion, &weights, n, &mut heard, n) };
        let (mut wide, mut wide_heard) = (start.clone(), sums.clone());
        run_weighted(&rates, &mut wide, &weights, n, &mut wide_heard, n);
        prop_assert_eq!(bits(&motion, &heard), bits(&wide, &wide_heard));
        let (mut followed, mut seen) = (start.clone(), sums.clone());
        // SAFETY: as above.
        unsafe { plain::follow(&rates, &mut followed, &weights, n, &mut seen, n) };
        let (mut wide, mut wide_seen) = (start.clone(), sums.clone());
        follow(&rates, &mut wide, &weights, n, &mut wide_seen, n);
        prop_assert_eq!(bits(&followed, &seen), bits(&wide, &wide_seen));
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            let (mut wide, mut wide_heard) = (start, sums);
            // SAFETY: this processor has both.
            unsafe { avx2::weighted(&rates, &mut wide, &weights, n, &mut wide_heard, n) };
            prop_assert_eq!(bits(&motion, &heard), bits(&wide, &wide_heard));
        }
    }
}
