//! Constant tables of laws between frames: the response of each law's elongation to the forces of the others.

use super::{DEVIATION_MAX, GAUSS_POINTS, GAUSS_WEIGHTS, PARTS_UNSCALED_MAX, STAGES, StageMatrix, StageValues};
use crate::island::fine::FineScript;
use crate::island::fine::basis::{Instant, POLYNOMIALS_MAX, dot};
use crate::scheme::LinkRunKind;

/// Values at the three Gauss points of a part, slopes there, and value and slope at the start of the frame: one wide
/// vector.
pub(super) type MotionWeights = [f64; 2 * STAGES + 2];

/// A frame in `n_parts` parts, which are solved one after the other.
#[derive(Clone, Debug)]
pub(super) struct FrameDivision {
    pub(super) n_parts: usize,
    /// Instants of the Gauss points   (parts·3)
    pub(super) gauss_times: Vec<f64>,
    /// Weights of the values at the instants of a frame in the value at each Gauss point   (parts·3, n)
    pub(super) interpolation: Vec<f64>,
    /// The same weights, and those in the slopes there, and in value and slope at the start of the frame, instant by
    /// instant   (parts, n)
    pub(super) motion_weights: Vec<MotionWeights>,
    /// Response of one law's elongation and rate at the Gauss points of a part to the force of another in that part
    /// (n_laws²)
    pub(super) force_responses: Vec<[StageMatrix; 2]>,
    /// Response of one law's elongation at the instants of a frame to an impulse of another at each Gauss point, for
    /// the parts after it   (n_laws², parts·3, n)
    pub(super) later_responses: Vec<f64>,
}

/// The constant data of laws.
#[derive(Clone, Debug)]
pub(in crate::island::fine) struct LawScript {
    /// Indices of the script's links that are laws.
    pub(in crate::island::fine) links: Vec<usize>,
    /// Parts of a frame: 1, 2, 4, and so on.
    pub(super) divisions: Vec<FrameDivision>,
    /// Largest deviation with which a frame is taken as a whole, relative to the largest force.
    pub(super) deviation_max: f64,
    /// Weights of the values at the instants of a frame in the value, and in the slope, at its end   (n each)
    pub(super) end_interpolation: [Vec<f64>; 2],
    /// Response of one law's elongation and rate at the end of a whole frame to the force of another   (n_laws²)
    pub(super) end_responses: Vec<[[f64; STAGES]; 2]>,
    /// Weights of a part's forces in their extrapolation to the next part's Gauss points.
    pub(super) extrapolation: StageMatrix,
    /// The same with the part before it: weights of the forces of that part, and of the last.
    pub(super) extrapolation_from_previous: StageMatrix,
    pub(super) extrapolation_from_last: StageMatrix,
    /// Weights of a part's forces in their extrapolation to both its ends.
    pub(super) end_extrapolation: [[f64; STAGES]; 2],
}

impl LawScript {
    pub(in crate::island::fine) fn new(script: &FineScript) -> Self {
        let is_law =
            |index: &usize| !matches!(script.links[*index].kind, LinkRunKind::But(_) | LinkRunKind::Dry { .. });
        let links: Vec<usize> = (0..script.links.len()).filter(is_law).collect();
        let parts_max = if links.is_empty() {
            1
        } else {
            (script.steps_min / 2).max(1)
        };
        let parts = std::iter::successors(Some(1), |parts| Some(2 * parts));
        let end_pairs: Vec<_> = (0..links.len() * links.len())
            .map(|pair| [pair / links.len(), pair % links.len()].map(|law| script.link_joints[links[law]]))
            .collect();
        let divide = |parts: usize| FrameDivision::new(script, &end_pairs, parts);
        let end_instant = Instant::new(script.basis.n_polynomials(), 1.0);
        let end_response = |ends: &[(usize, usize); 2]| {
            let mut stage_responses = [[0.0; STAGES]; 2];
            for stage in 0..STAGES {
                let start_instant = Instant::new(script.basis.n_polynomials(), GAUSS_POINTS[stage]);
                let stage_weight = GAUSS_WEIGHTS[stage] * script.rate.step();
                let [x, v] = script.elongation_response(*ends, [&start_instant, &end_instant]);
                (stage_responses[0][stage], stage_responses[1][stage]) = (stage_weight * x, stage_weight * v);
            }
            stage_responses
        };
        let part_excess = (parts_max as f64 / PARTS_UNSCALED_MAX as f64).max(1.0);
        Self {
            divisions: parts.take_while(|&parts| parts <= parts_max).map(divide).collect(),
            deviation_max: DEVIATION_MAX / (part_excess * part_excess * part_excess),
            end_interpolation: [&end_instant.values, &end_instant.slopes]
                .map(|polynomial_values| script.basis.weights(polynomial_values)),
            end_responses: end_pairs.iter().map(end_response).collect(),
            extrapolation: GAUSS_POINTS.map(|c| lagrange_weights(1.0 + c)),
            extrapolation_from_previous: GAUSS_POINTS.map(|c| two_part_weights(1.0 + c, 0)),
            extrapolation_from_last: GAUSS_POINTS.map(|c| two_part_weights(1.0 + c, 1)),
            end_extrapolation: [0.0, 1.0].map(lagrange_weights),
            links,
        }
    }
}

impl FrameDivision {
    fn new(script: &FineScript, pairs: &[[(usize, usize); 2]], parts: usize) -> Self {
        let (n_instants, part_length) = (script.basis.n_polynomials(), 1.0 / parts as f64);
        let gauss_times: Vec<f64> = (0..parts)
            .flat_map(|part| GAUSS_POINTS.map(|c| (part as f64 + c) * part_length))
            .collect();
        let gauss_instants: Vec<Instant> = gauss_times.iter().map(|&s| Instant::new(n_instants, s)).collect();
        let mut later_responses = Vec::new();
        if parts > 1 {
            let instants: Vec<Instant> = (script.basis.instants.iter())
                .map(|&s| Instant::new(n_instants, s))
                .collect();
            for &ends in pairs {
                for gauss_instant in &gauss_instants {
                    later_responses.extend(
                        instants
                            .iter()
                            .map(|end| script.elongation_response(ends, [gauss_instant, end])[0]),
                    );
                }
            }
        }
        let weights = |polynomials: fn(&Instant) -> &[f64; POLYNOMIALS_MAX]| -> Vec<Vec<f64>> {
            gauss_instants
                .iter()
                .map(|instant| script.basis.weights(polynomials(instant)))
                .collect()
        };
        let (value_weights, slope_weights) = (weights(|instant| &instant.values), weights(|instant| &instant.slopes));
        let frame_start = Instant::new(n_instants, 0.0);
        let start_weights = [&frame_start.values, &frame_start.slopes].map(|values| script.basis.weights(values));
        let motion_weights = |part: usize, instant: usize| {
            let mut motion_weights = [0.0; 2 * STAGES + 2];
            for stage in 0..STAGES {
                motion_weights[stage] = value_weights[STAGES * part + stage][instant];
                motion_weights[STAGES + stage] = slope_weights[STAGES * part + stage][instant];
            }
            (motion_weights[2 * STAGES], motion_weights[2 * STAGES + 1]) =
                (start_weights[0][instant], start_weights[1][instant]);
            motion_weights
        };
        Self {
            n_parts: parts,
            motion_weights: (0..parts * n_instants)
                .map(|index| motion_weights(index / n_instants, index % n_instants))
                .collect(),
            interpolation: value_weights.concat(),
            force_responses: pairs
                .iter()
                .map(|&ends| script.force_response(ends, part_length))
                .collect(),
            later_responses,
            gauss_times,
        }
    }
}

/// Weights of the values at the Gauss points in the value at `s` of the polynomial through them, in parts.
pub(in crate::island::fine) fn lagrange_weights(s: f64) -> [f64; STAGES] {
    lagrange(s, GAUSS_POINTS)
}

/// The same for the Gauss points of two parts, -1 to 0 and 0 to 1: the weights of the first or of the second.
fn two_part_weights(s: f64, part: usize) -> StageValues {
    let gauss_points = [-1.0, 0.0].map(|start| GAUSS_POINTS.map(|c| start + c));
    let point_weights = lagrange::<6>(
        s,
        std::array::from_fn(|point_index| gauss_points[point_index / STAGES][point_index % STAGES]),
    );
    std::array::from_fn(|stage| point_weights[part * STAGES + stage])
}

/// Weights of the values at some points in the value at `s` of the polynomial through them.
fn lagrange<const N: usize>(s: f64, points: [f64; N]) -> [f64; N] {
    let mut point_weights = [1.0; N];
    for (point_index, weight) in point_weights.iter_mut().enumerate() {
        for other_index in (0..N).filter(|&other| other != point_index) {
            *weight *= (s - points[other_index]) / (points[point_index] - points[other_index]);
        }
    }
    point_weights
}

impl FineScript {
    /// Response of the elongation between `moved_ends`, and of its rate, to the force of a law between `pushed_ends`,
    /// at the Gauss points of a part of `h` frames.
    fn force_response(&self, [moved_ends, pushed_ends]: [(usize, usize); 2], h: f64) -> [StageMatrix; 2] {
        let n_instants = self.basis.n_polynomials();
        let mut responses = [[[0.0; STAGES]; STAGES]; 2];
        for (row, c) in GAUSS_POINTS.into_iter().enumerate() {
            let end_instant = Instant::new(n_instants, c * h);
            // Gauss quadrature over each half of the time up to this point: of order 6.
            for half_index in 0..2 {
                for (gauss_point, quadrature_weight) in GAUSS_POINTS.into_iter().zip(GAUSS_WEIGHTS) {
                    let quadrature_time = 0.5 * (half_index as f64 + gauss_point) * c;
                    let start_instant = Instant::new(n_instants, quadrature_time * h);
                    let quadrature_weight = 0.5 * quadrature_weight * c * h * self.rate.step();
                    let [x, v] = self.elongation_response([moved_ends, pushed_ends], [&start_instant, &end_instant]);
                    for (column, share) in lagrange_weights(quadrature_time).into_iter().enumerate() {
                        responses[0][row][column] += quadrature_weight * share * x;
                        responses[1][row][column] += quadrature_weight * share * v;
                    }
                }
            }
        }
        responses
    }

    /// Response of the elongation between `moved_ends` [m/N·s] and of its rate [m/frame per N·s] to an impulse of a law
    /// between
    /// `pushed_ends`.
    pub(in crate::island::fine) fn elongation_response(
        &self,
        [moved_ends, pushed_ends]: [(usize, usize); 2],
        instants: [&Instant; 2],
    ) -> [f64; 2] {
        let mut response = [0.0; 2];
        for (sign_to, moved_end) in [(-1.0, moved_ends.0), (1.0, moved_ends.1)] {
            for (sign_from, pushed_end) in [(1.0, pushed_ends.0), (-1.0, pushed_ends.1)] {
                let [x, v] = self.joint_response([pushed_end, moved_end], instants);
                response[0] += sign_to * sign_from * x;
                response[1] += sign_to * sign_from * v;
            }
        }
        response
    }

    /// Response of one joint's position [m/N·s] and velocity [m/frame per N·s] to an impulse on another.
    fn joint_response(
        &self,
        [pushed_joint, moved_joint]: [usize; 2],
        [push_instant, response_instant]: [&Instant; 2],
    ) -> [f64; 2] {
        let n_instants = self.basis.n_polynomials();
        let mut response = [0.0; 2];
        let pair_responses = &self.path_responses[pushed_joint * self.joints.len() + moved_joint];
        for (row, share) in pair_responses.chunks(n_instants).zip(&push_instant.values) {
            response[0] += share * dot(row, &response_instant.values);
            response[1] += share * dot(row, &response_instant.slopes);
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extrapolation_weights_are_exact_up_to_degree_5() {
        for power in 0..6 {
            let polynomial = |s: f64| (0..power).map(|_| s).product::<f64>();
            for s in GAUSS_POINTS.map(|c| 1.0 + c) {
                let part_sums = [(0, -1.0), (1, 0.0)]
                    .map(|(part, start)| dot(&two_part_weights(s, part), &GAUSS_POINTS.map(|c| polynomial(start + c))));
                assert!((part_sums[0] + part_sums[1] - polynomial(s)).abs() < 1e-11 * polynomial(s).max(1.0));
            }
        }
    }
}
