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

fn bits(motion: &GroupMotion, sums: &[LaneSum]) -> Vec<u64> {
    let all_lanes = motion.positions.0.iter().chain(&motion.previous_positions.0);
    let all_lanes = all_lanes.chain(sums.iter().flat_map(|sum| &sum.0));
    all_lanes.map(|value| value.to_bits()).collect()
}

proptest! {
    #[test]
    fn bank_kernels_of_any_width_agree_bitwise(
        a in lanes(), b in lanes(), positions in lanes(), previous_positions in lanes(),
        weights in prop::collection::vec(lanes(), 2..4), n in 0usize..9,
    ) {
        let b = Lanes(b.0.map(|b| b.abs() / 2.0));
        let coefficients = GroupCoefficients { a, b };
        let start = GroupMotion { positions, previous_positions };
        let sums = vec![LaneSum([0.25; SUM_LANES]); 3 * n];
        let (mut motion, mut plain_sums) = (start.clone(), sums[..n].to_vec());
        // SAFETY: the plain loop needs nothing.
        unsafe { plain::run(&coefficients, &mut motion, &mut plain_sums) };
        let (mut wide, mut wide_sums) = (start.clone(), sums[..n].to_vec());
        advance_and_sum(&coefficients, &mut wide, &mut wide_sums);
        prop_assert_eq!(bits(&motion, &plain_sums), bits(&wide, &wide_sums));
        let (mut motion, mut plain_sums) = (start.clone(), sums.clone());
        // SAFETY: as above.
        unsafe { plain::sum_weighted(&coefficients, &mut motion, &weights, n, &mut plain_sums, n) };
        let (mut wide, mut wide_sums) = (start.clone(), sums.clone());
        advance_and_sum_weighted(&coefficients, &mut wide, &weights, n, &mut wide_sums, n);
        prop_assert_eq!(bits(&motion, &plain_sums), bits(&wide, &wide_sums));
        let (mut plain_motion, mut plain_observed) = (start.clone(), sums.clone());
        // SAFETY: as above.
        unsafe { plain::observe(&coefficients, &mut plain_motion, &weights, n, &mut plain_observed, n) };
        let (mut wide, mut wide_observed) = (start.clone(), sums.clone());
        advance_and_observe(&coefficients, &mut wide, &weights, n, &mut wide_observed, n);
        prop_assert_eq!(bits(&plain_motion, &plain_observed), bits(&wide, &wide_observed));
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            let (mut wide, mut wide_sums) = (start, sums);
            // SAFETY: this processor has both.
            unsafe { avx2::sum_weighted(&coefficients, &mut wide, &weights, n, &mut wide_sums, n) };
            prop_assert_eq!(bits(&motion, &plain_sums), bits(&wide, &wide_sums));
        }
    }
}
