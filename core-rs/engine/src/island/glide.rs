//! MATs whose parameters glide, and links whose K and Z are led, frame by frame.

use super::fine::FineLinks;
use crate::cell::CellRatios;
use crate::maths::{asin, log, sin, sqrt};
use crate::network::{Error, Network};
use crate::scheme::{LinkRun, Scheme, Spring};
use crate::timeline::{Lead, MatParameters, Timeline, next_change};

/// Largest sin²(θ/2) of an oscillation whose amplitude is corrected: nearer to the Nyquist frequency no recurrence
/// holds an amplitude.
const SINE_SQUARE_MAX: f64 = 0.99;

/// 1/M, κ, ζ and the stiffness of the tie of a MAT in one frame.
type MatCoefficients = [f64; 4];

/// A MAT whose parameters glide.
#[derive(Clone, Debug)]
pub(super) struct GlidingMat {
    mat: usize,
    /// Frames in rising order, each with the index in `coefficients` of the parameters there.
    points: Vec<(u64, usize)>,
    coefficients: Vec<MatCoefficients>,
    /// ln(θ/sin θ) of each, where θ is the angle of a step   (as `coefficients`)
    amplitude_corrections: Vec<f64>,
}

impl GlidingMat {
    /// The parameters of frame `n`.
    fn coefficients_at_frame(&self, n: u64) -> MatCoefficients {
        let next_point = self.points.partition_point(|&(frame, _)| frame <= n);
        let coefficients_at = |point: usize| self.coefficients[self.points[point].1];
        if next_point == 0 {
            return coefficients_at(0);
        }
        let (start_frame, index_before) = self.points[next_point - 1];
        let Some(&(stop_frame, index_after)) = self.points.get(next_point) else {
            return coefficients_at(next_point - 1);
        };
        if index_before == index_after {
            return coefficients_at(next_point);
        }
        let frame_share = (n - start_frame) as f64 / (stop_frame - start_frame) as f64;
        let (start_coefficients, stop_coefficients) = (coefficients_at(next_point - 1), coefficients_at(next_point));
        let [w, kappa, zeta, tie_stiffness] = std::array::from_fn(|i| {
            start_coefficients[i] + (stop_coefficients[i] - start_coefficients[i]) * frame_share
        });
        // A continuous oscillation whose frequency ω changes slowly keeps ω times its squared amplitude; the samples of
        // this recurrence keep sin θ times it. The poles are moved outwards by the difference.
        let correction = (self.amplitude_corrections[index_after] - self.amplitude_corrections[index_before])
            / (stop_frame - start_frame) as f64;
        [
            w,
            kappa + 0.5 * correction * (zeta - kappa),
            zeta + (1.0 - zeta) * correction,
            tie_stiffness,
        ]
    }

    /// The first frame, `n` or later, at which the parameters may change.
    pub(super) fn next_change_frame(&self, n: u64) -> u64 {
        next_change(&self.points, n)
    }
}

impl LedLinks {
    /// The first frame, `n` or later, at which K and Z may change.
    pub(super) fn next_change_frame(&self, n: u64) -> u64 {
        self.lead.next_change_frame(n)
    }
}

/// The glides of an island.
pub(super) fn build_glides(network: &Network, timeline: &Timeline, scheme: &Scheme) -> Result<Vec<GlidingMat>, Error> {
    let (mut glides, mut parameters_by_glide): (Vec<GlidingMat>, Vec<Vec<Option<MatParameters>>>) =
        (Vec::new(), Vec::new());
    for glide in &timeline.glides {
        let mut distinct_parameters: Vec<Option<MatParameters>> = Vec::new();
        let mut points = Vec::with_capacity(glide.points.len());
        for &(frame, point_parameters) in glide.points.iter() {
            let parameter_index = distinct_parameters
                .iter()
                .position(|parameters| *parameters == point_parameters);
            let parameter_index = parameter_index.unwrap_or_else(|| {
                distinct_parameters.push(point_parameters);
                distinct_parameters.len() - 1
            });
            points.push((frame, parameter_index));
        }
        glides.push(GlidingMat {
            mat: glide.mat,
            points,
            coefficients: Vec::with_capacity(distinct_parameters.len()),
            amplitude_corrections: Vec::with_capacity(distinct_parameters.len()),
        });
        parameters_by_glide.push(distinct_parameters);
    }
    let mut errors = Vec::new();
    // One scheme gives each MAT one set of parameters, so every round computes the next set of each glide.
    for round in 0..parameters_by_glide.iter().map(Vec::len).max().unwrap_or(0) {
        let glides_of_round = || parameters_of_round(&parameters_by_glide, round);
        let mut round_network = network.clone();
        for (glide_index, glide_parameters) in glides_of_round() {
            if let Some(parameters) = glide_parameters {
                round_network.set_tie(glides[glide_index].mat, parameters);
            }
        }
        let scheme_of_round = match Scheme::new(&round_network, timeline.rate) {
            Ok(other) => other,
            Err(error) => {
                errors.push(error);
                continue;
            }
        };
        for (glide_index, glide_parameters) in glides_of_round() {
            let scheme = if glide_parameters.is_some() {
                &scheme_of_round
            } else {
                scheme
            };
            let glide = &mut glides[glide_index];
            let mat = glide.mat;
            let (kappa, zeta) = (scheme.kappa[mat], scheme.zeta[mat]);
            let part = network.mats().part[mat] as usize;
            let is_discrete = network.parts().get(part).is_some_and(|part| part.ca_rate.is_some());
            let correction = if is_discrete {
                0.0
            } else {
                amplitude_correction(CellRatios { kappa, zeta })
            };
            glide.amplitude_corrections.push(correction);
            glide
                .coefficients
                .push([scheme.w[mat], kappa, zeta, scheme.tie_stiffness[mat]]);
        }
    }
    if let Some(combined_error) = Error::combined(errors) {
        return Err(combined_error);
    }
    Ok(glides)
}

/// ln(θ/sin θ) of an oscillation of angle θ a step; 0 if there is none, or it is too near the Nyquist frequency.
fn amplitude_correction(ratios: CellRatios) -> f64 {
    let pole_magnitude = sqrt(1.0 - ratios.zeta);
    let step_loss = ratios.zeta / (1.0 + pole_magnitude);
    let half_sine_square = (ratios.kappa - step_loss * step_loss) / (4.0 * pole_magnitude);
    if !(half_sine_square > 0.0 && half_sine_square < SINE_SQUARE_MAX) {
        return 0.0;
    }
    let theta = 2.0 * asin(sqrt(half_sine_square));
    log(theta / sin(theta))
}

/// The glides that have parameters in a round: index of the glide, and its parameters.
fn parameters_of_round(
    parameters_by_glide: &[Vec<Option<MatParameters>>],
    round: usize,
) -> impl Iterator<Item = (usize, Option<MatParameters>)> + '_ {
    let indexed_ties = parameters_by_glide.iter().enumerate();
    indexed_ties.filter_map(move |(glide_index, glide_parameters)| {
        glide_parameters
            .get(round)
            .map(|glide_parameters| (glide_index, *glide_parameters))
    })
}

/// Write the parameters of frame `n` into `frame_scheme`; muted MATs are left out.
pub(super) fn apply_glides(glides: &[GlidingMat], base_scheme: &Scheme, frame_scheme: &mut Scheme, n: u64) {
    for glide in glides.iter().filter(|glide| base_scheme.w[glide.mat] != 0.0) {
        let mat = glide.mat;
        let coefficients = glide.coefficients_at_frame(n);
        [
            frame_scheme.w[mat],
            frame_scheme.kappa[mat],
            frame_scheme.zeta[mat],
            frame_scheme.tie_stiffness[mat],
        ] = coefficients;
    }
}

/// Write 1/M of masses that follow MATs into `frame_scheme`, for MATs at `x` [m]; muted masses are left out.
pub(super) fn apply_following_masses(base_scheme: &Scheme, frame_scheme: &mut Scheme, x: &[f64]) {
    for mass in &base_scheme.following_masses {
        if frame_scheme.w[mass.mat] != 0.0 {
            frame_scheme.w[mass.mat] = base_scheme.w[mass.mat] * mass.mass_ratio(|mat| x[mat]);
        }
    }
}

/// Give the parameters of frames `n` and `n` + 1 to what is computed between them.
pub(super) fn set_fine_coefficients(glides: &[GlidingMat], base_scheme: &Scheme, fine_links: &mut FineLinks, n: u64) {
    for glide in glides.iter().filter(|glide| base_scheme.w[glide.mat] != 0.0) {
        let coefficients = [n, n + 1].map(|n| glide.coefficients_at_frame(n));
        fine_links.set_joint_constants(glide.mat, coefficients.map(|[w, kappa, zeta, _]| [w, kappa, zeta]));
    }
}

/// Links whose K and Z are led.
#[derive(Clone, Debug)]
pub(super) struct LedLinks {
    lead: Lead,
    location: RunLocation,
    /// Whether it has the factors of the one before it, as all links of a string have.
    has_previous_factors: bool,
}

/// The list of the scheme that holds their run, and its index there.
#[derive(Clone, Copy, Debug)]
enum RunLocation {
    Run(usize),
    Fused(usize),
    Exact(usize),
    /// A contact or a law that is computed finely.
    Fine,
}

/// The runs of a scheme that are led; from now on each has its K and Z as numbers. `fused_links`: the first link of each
/// run of fused springs.
pub(super) fn bind_leads(
    scheme: &mut Scheme,
    fused_links: &[usize],
    network: &Network,
    timeline: &Timeline,
) -> Vec<LedLinks> {
    let mut led_links: Vec<LedLinks> = Vec::new();
    for lead in &timeline.leads {
        for run in network.runs().iter().filter(|run| lead.links().contains(&run.first)) {
            let find_run = |runs: &[LinkRun]| runs.iter().position(|scheme_run| scheme_run.first_link == run.first);
            let location = if let Some(index) = find_run(&scheme.runs) {
                scheme.runs[index].make_adjustable();
                RunLocation::Run(index)
            } else if let Some(index) = fused_links.iter().position(|&first_link| first_link == run.first) {
                RunLocation::Fused(index)
            } else {
                find_run(&scheme.exact_runs).map_or(RunLocation::Fine, RunLocation::Exact)
            };
            led_links.push(LedLinks {
                lead: lead.on_links(run.first, run.len),
                location,
                has_previous_factors: false,
            });
        }
    }
    compare_factors(&mut led_links);
    led_links
}

/// Note which links have the factors of those before them.
fn compare_factors(led_links: &mut [LedLinks]) {
    for index in 0..led_links.len() {
        let previous_led = index.checked_sub(1).map(|previous| &led_links[previous]);
        led_links[index].has_previous_factors =
            previous_led.is_some_and(|previous_led| previous_led.lead.has_factors_of(&led_links[index].lead));
    }
}

/// The new index of each run of a scheme after some are removed; `None` for those.
pub(super) struct RetainedRuns {
    runs: Vec<Option<usize>>,
    fused_springs: Vec<Option<usize>>,
    exact_runs: Vec<Option<usize>>,
}

impl RetainedRuns {
    pub(super) fn new(
        scheme: &Scheme,
        keeps_run: impl Fn(&LinkRun) -> bool,
        keeps_spring: impl Fn(&Spring) -> bool,
    ) -> Self {
        Self {
            runs: new_indices(&scheme.runs, &keeps_run),
            fused_springs: new_indices(&scheme.fused_springs, keeps_spring),
            exact_runs: new_indices(&scheme.exact_runs, keeps_run),
        }
    }
}

/// The index of each item among those that are retained.
fn new_indices<T>(items: &[T], is_retained: impl Fn(&T) -> bool) -> Vec<Option<usize>> {
    let mut retained_count = 0;
    let new_index = |item: &T| {
        let stays = is_retained(item);
        retained_count += usize::from(stays);
        stays.then(|| retained_count - 1)
    };
    items.iter().map(new_index).collect()
}

/// Follow runs of a scheme to their new indices; links of removed runs are led no longer.
pub(super) fn follow_retained(led_links: &mut Vec<LedLinks>, retained: &RetainedRuns) {
    led_links.retain_mut(|led| {
        let new_location = match led.location {
            RunLocation::Run(index) => retained.runs[index].map(RunLocation::Run),
            RunLocation::Fused(index) => retained.fused_springs[index].map(RunLocation::Fused),
            RunLocation::Exact(index) => retained.exact_runs[index].map(RunLocation::Exact),
            RunLocation::Fine => Some(RunLocation::Fine),
        };
        led.location = new_location.unwrap_or(led.location);
        new_location.is_some()
    });
    compare_factors(led_links);
}

/// Write K and Z of frame `n` into `frame_scheme`; `next_points` holds where the points of each lead were found last.
pub(super) fn apply_leads(
    (led_links, next_points): (&[LedLinks], &mut Vec<usize>),
    base_scheme: &Scheme,
    frame_scheme: &mut Scheme,
    fine_links: &mut Option<FineLinks>,
    n: u64,
) {
    let mut factors = [1.0; 2];
    next_points.resize(led_links.len(), 0);
    for (led, next_point) in led_links.iter().zip(next_points) {
        let LedLinks {
            lead,
            location,
            has_previous_factors,
        } = led;
        if !has_previous_factors {
            factors = lead.factors_from(n, 0.0, next_point);
        }
        let (base_run, run_now) = match *location {
            RunLocation::Run(run_index) => (&base_scheme.runs[run_index], &mut frame_scheme.runs[run_index]),
            RunLocation::Fused(run_index) => {
                let (base_spring, [k_factor, z_factor]) = (base_scheme.fused_springs[run_index], factors);
                let k_and_z = [base_spring.k * k_factor, base_spring.z * z_factor];
                frame_scheme.fused_springs.set_k_and_z(run_index, k_and_z);
                continue;
            }
            RunLocation::Exact(run_index) => (
                &base_scheme.exact_runs[run_index],
                &mut frame_scheme.exact_runs[run_index],
            ),
            RunLocation::Fine => {
                if let Some(fine_links) = fine_links {
                    fine_links.set_link_constants(lead.first_link, [factors, lead.factors(n + 1, 0.0)]);
                }
                continue;
            }
        };
        let [k_factor, z_factor] = factors;
        (run_now.k, run_now.z) = (base_run.k * k_factor, base_run.z * z_factor);
    }
}
