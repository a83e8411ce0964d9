//! Stability of an island with slow parts: its motion from kick to kick as a linear map, and how much that grows. A
//! kick is the pull of a slow part's own springs, once every macrostep.
//!
//! Contacts are taken once as open and once as closed, laws by their slopes at rest. A small island has all eigenvalues
//! computed; a large one is simulated for a while from a motion that excites everything.

use nalgebra::DMatrix;

use crate::assembly::constants::{
    COMMON_FRAMES_MAX, DENSE_STATE_MAX, GROWTH_TOLERANCE, TRIAL_KICKS, TRIAL_WORK_MAX, UNIT_CIRCLE_TOLERANCE,
};
use crate::assembly::cost_table::Costs;
use crate::assembly::unit::IslandPlan;
use crate::interrupt;
use crate::island::bodies::BodyPlan;
use crate::island::modal::Modal;
use crate::island::slow::{RunningSlow, Slow};
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::ModuleState;

/// Work that a frame adds to the counter of interruptions, for each number of the state.
const INTERRUPT_STEPS_PER_NUMBER: usize = 4;

/// How much an island grows from kick to kick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Growth {
    /// Largest magnitude of an eigenvalue, for one kick; 0 if none is known.
    pub(crate) growth_per_kick: f64,
    /// The island was only simulated for a while, or part of it was left out.
    pub(crate) is_estimated: bool,
    /// It grows only where contacts are closed.
    pub(crate) is_from_contacts: bool,
    /// Work of the test [s].
    pub(crate) test_seconds: f64,
}

impl Growth {
    pub(crate) fn is_stable(self) -> bool {
        self.growth_per_kick
            <= 1.0
                + if self.is_estimated {
                    GROWTH_TOLERANCE
                } else {
                    UNIT_CIRCLE_TOLERANCE
                }
    }
}

/// How much an island grows, the worse of contacts open and closed; `None` if the test would take too long.
pub(crate) fn growth(island_plan: &IslandPlan) -> Option<Growth> {
    let mut growth = Growth {
        growth_per_kick: 0.0,
        is_estimated: false,
        is_from_contacts: false,
        test_seconds: 0.0,
    };
    for are_contacts_closed in [false, true] {
        let Some(mut linear_map) = KickMap::new(island_plan, are_contacts_closed) else {
            growth.is_estimated = true;
            continue;
        };
        let is_dense = linear_map.len() <= DENSE_STATE_MAX && linear_map.eigenvalue_seconds() <= TRIAL_WORK_MAX;
        let trial_work = if is_dense {
            linear_map.eigenvalue_seconds()
        } else {
            linear_map.simulation_seconds()
        };
        if trial_work > TRIAL_WORK_MAX {
            return None;
        }
        let radius = if is_dense {
            linear_map.spectral_radius()
        } else {
            linear_map.simulated_growth()
        };
        let was_stable = growth.is_stable();
        growth.growth_per_kick = growth.growth_per_kick.max(radius);
        growth.is_estimated |= !is_dense || linear_map.is_partial;
        growth.is_from_contacts = are_contacts_closed && was_stable && !growth.is_stable();
        growth.test_seconds += trial_work;
    }
    Some(growth)
}

/// A linear link: its ends, stiffness and viscosity.
struct LinearLink {
    a: usize,
    b: usize,
    k: f64,
    z: f64,
}

/// The modes of a body, and their state one frame before.
struct ModalState<'a> {
    modal: &'a Modal,
    amplitudes: Vec<f64>,
    previous_amplitudes: Vec<f64>,
}

/// The map from one common kick to the next, and the state that it acts on.
struct KickMap<'a> {
    scheme: Scheme,
    links: Vec<LinearLink>,
    modules: ModuleState,
    /// MATs that the scheme steps.
    stepped_mats: Vec<usize>,
    slow_bodies: Vec<RunningSlow>,
    modes: Vec<ModalState<'a>>,
    /// Frames from one common kick of all slow parts to the next.
    period_frames: u64,
    /// Kicks of the quickest slow part in these frames.
    kicks_per_period: f64,
    /// Some body is replaced by the masses of its ports.
    is_partial: bool,
}

impl<'a> KickMap<'a> {
    fn new(island_plan: &'a IslandPlan, are_contacts_closed: bool) -> Option<Self> {
        let scheme = Scheme::new(&island_plan.network, island_plan.timeline.rate).ok()?;
        let links = scheme
            .runs
            .iter()
            .filter_map(|run| linear_links(run, are_contacts_closed, island_plan.contact_substeps > 1))
            .flatten()
            .collect();
        let mat_count = scheme.n_mat();
        let mut modules = ModuleState::new(&scheme, vec![0.0; mat_count], vec![0.0; mat_count]);
        modules.free_port_motion = vec![0.0; mat_count];
        let mut is_port_mat = vec![false; mat_count];
        let body_plans = || island_plan.bodies.iter();
        for mat in body_plans().flat_map(BodyPlan::ports) {
            is_port_mat[mat] = true;
        }
        let linear_slow = |inside: &'a BodyPlan| match inside {
            BodyPlan::Slow(slow) if slow.is_linear() => Some(slow),
            _ => None,
        };
        let slow_plans: Vec<&Slow> = body_plans().filter_map(linear_slow).collect();
        let kick_periods: Vec<u64> = slow_plans.iter().map(|slow| slow.kick_interval.into()).collect();
        let period_frames = kick_periods.iter().copied().fold(1, lcm);
        let shortest_period = kick_periods.iter().copied().min()?;
        // A body without a linear map is replaced by the masses of its ports.
        let has_no_map = |inside: &&BodyPlan| match inside {
            BodyPlan::Mesh(_) => true,
            BodyPlan::Slow(slow) => !slow.is_linear(),
            BodyPlan::Modal(_) => false,
        };
        let is_partial = body_plans().any(|inside| has_no_map(&inside));
        for mat in body_plans().filter(has_no_map).flat_map(BodyPlan::ports) {
            is_port_mat[mat] = false;
        }
        let start_slow = |slow: &&Slow| RunningSlow::new(&slow.frame_by_frame().layer_body(), &modules);
        let running_slow: Vec<RunningSlow> = slow_plans.iter().map(start_slow).collect();
        (period_frames <= COMMON_FRAMES_MAX).then(|| Self {
            slow_bodies: running_slow,
            modes: body_plans()
                .filter_map(|inside| match inside {
                    BodyPlan::Modal(modal) => Some(ModalState {
                        amplitudes: vec![0.0; modal.modes.len()],
                        previous_amplitudes: vec![0.0; modal.modes.len()],
                        modal,
                    }),
                    _ => None,
                })
                .collect(),
            stepped_mats: (0..mat_count)
                .filter(|&i| scheme.w[i] > 0.0 && !is_port_mat[i])
                .collect(),
            kicks_per_period: period_frames as f64 / shortest_period as f64,
            is_partial,
            period_frames,
            links,
            modules,
            scheme,
        })
    }

    /// Size of the state.
    fn len(&self) -> usize {
        let slow_size: usize = self.slow_bodies.iter().map(RunningSlow::n_state).sum();
        let modes_size: usize = self.modes.iter().map(|modes| 2 * modes.amplitudes.len()).sum();
        2 * self.stepped_mats.len() + slow_size + modes_size
    }

    /// Visits each number of the state, always in the same order.
    fn visit_state(&mut self, mut visit: impl FnMut(&mut f64)) {
        for &i in &self.stepped_mats {
            visit(&mut self.modules.x[i]);
            visit(&mut self.modules.d[i]);
        }
        self.slow_bodies
            .iter_mut()
            .for_each(|slow| slow.visit_state(&mut visit));
        for modes in &mut self.modes {
            modes.amplitudes.iter_mut().for_each(&mut visit);
            modes.previous_amplitudes.iter_mut().for_each(&mut visit);
        }
    }

    /// Takes a state from one common kick to the next.
    fn apply(&mut self, state: &mut [f64]) {
        let mut state_in = state.iter();
        self.visit_state(|value| *value = *state_in.next().unwrap_or(&0.0));
        self.set_port_positions();
        for n in 0..self.period_frames {
            self.step_frame(n);
        }
        let mut state_out = state.iter_mut();
        self.visit_state(|value| {
            if let Some(state_out) = state_out.next() {
                *state_out = *value;
            }
        });
    }

    fn set_port_positions(&mut self) {
        for slow in &self.slow_bodies {
            slow.set_ports(&mut self.modules);
        }
        for modes in &self.modes {
            for port in &modes.modal.ports {
                let port_position = |q: &[f64]| q.iter().zip(&port.shape).map(|(q, s)| q * s).sum::<f64>();
                let x = port_position(&modes.amplitudes);
                self.modules.x[port.mat] = x;
                self.modules.d[port.mat] = x - port_position(&modes.previous_amplitudes);
            }
        }
    }

    fn step_frame(&mut self, n: u64) {
        let ModuleState { x, d, force, .. } = &mut self.modules;
        force.fill(0.0);
        for link in &self.links {
            let (first_end, second_end) = (link.a, link.b);
            let link_force = link.k * (x[second_end] - x[first_end]) + link.z * (d[second_end] - d[first_end]);
            force[first_end] += link_force;
            force[second_end] -= link_force;
        }
        for slow in &mut self.slow_bodies {
            slow.step(n, force);
        }
        for modes in &mut self.modes {
            let ModalState {
                modal,
                amplitudes,
                previous_amplitudes,
            } = modes;
            for (mode, mode_plan) in modal.modes.iter().enumerate() {
                let add_push =
                    |port_push: f64, port: &crate::island::modal::Port| port_push + port.shape[mode] * force[port.mat];
                let port_push = modal.ports.iter().fold(0.0, add_push);
                let next_amplitude = mode_plan.a * amplitudes[mode] - mode_plan.b * previous_amplitudes[mode]
                    + mode_plan.displacement_per_newton * port_push;
                previous_amplitudes[mode] = std::mem::replace(&mut amplitudes[mode], next_amplitude);
            }
        }
        let Scheme { w, kappa, zeta, .. } = &self.scheme;
        for &i in &self.stepped_mats {
            d[i] += force[i] * w[i] - kappa[i] * x[i] - zeta[i] * d[i];
            x[i] += d[i];
        }
        self.set_port_positions();
    }

    /// Work of one application of the map [s].
    fn period_seconds(&self) -> f64 {
        let modal_products = self
            .modes
            .iter()
            .map(|modes| modes.amplitudes.len() * modes.modal.ports.len());
        // A slow body's springs are a dense product at each kick.
        let kick_sizes = self.slow_bodies.iter().map(RunningSlow::n_state);
        let dense_products: usize = kick_sizes.map(|n| n * n / 2).sum();
        let frame_products = self.len() + 2 * self.links.len() + modal_products.sum::<usize>();
        let products =
            self.period_frames as f64 * frame_products as f64 + self.kicks_per_period * dense_products as f64;
        1e-9 * Costs::nanoseconds("number") * products
    }

    /// Work of the eigenvalues [s].
    fn eigenvalue_seconds(&self) -> f64 {
        let state_size = self.len() as f64;
        state_size * self.period_seconds()
            + 1e-9 * Costs::nanoseconds("eigenvalue") * state_size * state_size * state_size
    }

    /// Work of simulating the island for a while [s].
    fn simulation_seconds(&self) -> f64 {
        self.n_applications() as f64 * self.period_seconds()
    }

    /// Applications of the map for which a large island is simulated.
    fn n_applications(&self) -> usize {
        (TRIAL_KICKS as f64 / self.kicks_per_period).ceil().max(4.0) as usize
    }

    /// The largest magnitude of an eigenvalue, for one kick.
    fn spectral_radius(&mut self) -> f64 {
        let state_size = self.len();
        let mut map_matrix = DMatrix::zeros(state_size, state_size);
        let mut state_column = vec![0.0; state_size];
        let mut is_finite = true;
        for j in 0..state_size {
            interrupt::spend(state_size * (state_size + INTERRUPT_STEPS_PER_NUMBER * self.period_frames as usize));
            state_column.fill(0.0);
            state_column[j] = 1.0;
            self.apply(&mut state_column);
            is_finite &= state_column.iter().all(|x| x.is_finite());
            map_matrix.column_mut(j).copy_from_slice(&state_column);
        }
        if !is_finite {
            return f64::INFINITY;
        }
        let eigenvalues = map_matrix.complex_eigenvalues();
        let magnitudes = eigenvalues.iter().map(|value| {
            let (re, im) = (value.re, value.im);
            (re * re + im * im).sqrt()
        });
        let radius = magnitudes.fold(0.0, f64::max);
        crate::maths::pow(radius, 1.0 / self.kicks_per_period)
    }

    /// Growth at each kick of a motion that excites everything: from the largest energy in the second quarter of the
    /// simulated time to that in the last.
    fn simulated_growth(&mut self) -> f64 {
        self.randomise_state();
        let n_applications = self.n_applications();
        let mut quarters = [0.0_f64; 4];
        for application in 0..n_applications {
            interrupt::spend(INTERRUPT_STEPS_PER_NUMBER * self.period_frames as usize * self.len());
            self.set_port_positions();
            for n in 0..self.period_frames {
                self.step_frame(n);
            }
            let state_energy = self.energy();
            if !state_energy.is_finite() {
                return f64::INFINITY;
            }
            let quarter = &mut quarters[4 * application / n_applications];
            *quarter = quarter.max(state_energy);
        }
        if quarters[1] <= 0.0 {
            return 0.0; // all of it has come to rest
        }
        // Amplitude grows as the root of the energy; the two quarters are half the time apart.
        let kick_total = n_applications as f64 * self.kicks_per_period;
        crate::maths::pow(quarters[3] / quarters[1], 1.0 / kick_total)
    }

    /// Sets all positions to 0 and random speeds of about equal energy.
    fn randomise_state(&mut self) {
        let mut draw_count = 0_u64;
        let mut next_random = || {
            draw_count += 1;
            let random_bits = draw_count.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
            random_bits as f64 / 8_388_608.0 - 1.0
        };
        for &i in &self.stepped_mats {
            (self.modules.x[i], self.modules.d[i]) = (0.0, next_random() * self.scheme.w[i].sqrt());
        }
        for slow in &mut self.slow_bodies {
            slow.randomise(&mut next_random);
        }
        for modes in &mut self.modes {
            modes.previous_amplitudes.fill(0.0);
            for (now, mode_plan) in modes.amplitudes.iter_mut().zip(&modes.modal.modes) {
                *now = next_random() * mode_plan.displacement_per_newton.sqrt();
            }
        }
    }

    /// Approximate energy of the whole state [in units of a frame].
    fn energy(&self) -> f64 {
        let ModuleState { x, d, .. } = &self.modules;
        let Scheme { w, kappa, .. } = &self.scheme;
        let entries = self.stepped_mats.iter();
        let stepped_energy: f64 = entries.map(|&i| (d[i] * d[i] + kappa[i] * x[i] * x[i]) / w[i]).sum();
        let elongation_squared = |link: &LinearLink| (x[link.b] - x[link.a]) * (x[link.b] - x[link.a]);
        let link_energy: f64 = self.links.iter().map(|link| link.k * elongation_squared(link)).sum();
        let slow_energy: f64 = self.slow_bodies.iter().map(RunningSlow::spring_energy).sum();
        let energy_of = |modes: &ModalState<'_>| -> f64 {
            let amplitude_pairs = modes.amplitudes.iter().zip(&modes.previous_amplitudes);
            let entries = amplitude_pairs.zip(&modes.modal.modes);
            entries
                .map(|((now, before), mode_plan)| {
                    let amplitude_step = now - before;
                    (amplitude_step * amplitude_step + (1.0 - mode_plan.a + mode_plan.b) * now * now)
                        / mode_plan.displacement_per_newton
                })
                .sum()
        };
        let modes_energy: f64 = self.modes.iter().map(energy_of).sum();
        slow_energy + 0.5 * (stepped_energy + link_energy + modes_energy)
    }
}

/// A run as linear links; `None` if it is open, is computed finer than a frame, or has no linear form.
fn linear_links(
    run: &LinkRun,
    are_contacts_closed: bool,
    is_fine: bool,
) -> Option<impl Iterator<Item = LinearLink> + use<>> {
    let is_contact = matches!(run.kind, LinkRunKind::But(_));
    if is_contact && (!are_contacts_closed || (is_fine && run.can_substep())) {
        return None;
    }
    let [k, z] = run.linear_form()?; // links without one are left out of the map
    let (first_end, second_end) = (run.a, run.b);
    Some((0..run.len).map(move |i| LinearLink {
        a: first_end + i,
        b: second_end + i,
        k,
        z,
    }))
}

/// The least common multiple.
fn lcm(a: u64, b: u64) -> u64 {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x.max(1) * b
}
