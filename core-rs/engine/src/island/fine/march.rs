//! A frame of contacts, step by step: from one closing or opening to the next.
//!
//! A step is a sequence of kicks by the contacts that push, with the exact linear motion of everything between them. It
//! is of order 2 or 4 (`order`) while no contact closes or opens within it; a step in which one does is repeated up to
//! that instant.

use std::f64::consts::PI;

use super::basis::Instant;
use super::laws::{LawScript, LawState};
use super::order::{ContactRates, Stages};
use super::{FineLinks, FineScript};
use crate::kernel::ExactContact;
use crate::maths::{expm1, sqrt};
use crate::network::ContactLaw;
use crate::scheme::LinkRunKind;
use crate::state::ModuleState;

/// Most steps that are tried in a frame, before a step that is stable at any length takes the rest.
const STEPS_MAX: usize = 256;
/// A resting contact that swings faster than this uses that stable step at once: half the frame rate is the highest
/// audible frequency [rad/frame].
const STEP_PHASE_MAX: f64 = PI;
/// An instant is located when a round moves it by less than this share of a step.
const CLOSING_TOLERANCE: f64 = 1e-9;
/// Most rounds to locate an instant.
const LOCATE_ROUNDS_MAX: usize = 30;
/// Instants at which a frame without pushes is searched for closing contacts.
const CLOSING_PROBES: usize = 8;
/// Most rounds over contacts that are solved together.
const ROUNDS_MAX: usize = 50;
/// Rounds end when no force changes by more than this share of it.
const FORCE_TOLERANCE: f64 = 1e-12;
/// A clamped contact whose force has ended pushes again when the force exceeds this share of its elastic and damping
/// terms.
const PUSH_AGAIN_SHARE: f64 = 1e-9;

/// A contact in this frame.
#[derive(Clone, Copy)]
struct LinkContact {
    /// Z is in N·frame/m.
    law: ContactLaw,
    ends: (usize, usize),
    side: f64,
    rest: f64,
    /// Velocity by an impulse [m/frame per N·s].
    velocity_per_impulse: f64,
}

impl LinkContact {
    /// Criterion of a pushing contact at penetration `g` [m] that closes by `v` [m/frame]: it goes on pushing while
    /// this is positive.
    fn pushing_criterion(&self, [g, v]: [f64; 2]) -> f64 {
        if self.releases_early() && g > 0.0 {
            self.law.unlimited_force(g, v)
        } else {
            g
        }
    }

    /// What changes its sign where the contact closes or opens: the penetration, or the force that is not clamped.
    fn switch_criterion(&self, [g, v]: [f64; 2], uses_depth: bool) -> f64 {
        if uses_depth { g } else { self.law.unlimited_force(g, v) }
    }

    /// Whether its force ends before it opens.
    fn releases_early(&self) -> bool {
        self.law.is_clamped && self.law.z > 0.0
    }

    /// Whether an open contact begins to push.
    fn begins_to_push(&self, [g, v]: [f64; 2]) -> bool {
        if self.releases_early() {
            let (elastic, damping_force) = (self.law.odd_elastic(g), self.law.z * v);
            g > 0.0 && elastic + damping_force > PUSH_AGAIN_SHARE * (elastic + damping_force.abs())
        } else {
            g > 0.0 && v > 0.0
        }
    }

    /// Bound on the rate at which it may swing or decay from now on [rad/frame].
    fn rate_bound(&self, [g, v]: [f64; 2], step: f64) -> f64 {
        let inverse_mass = self.velocity_per_impulse * step;
        if inverse_mass == 0.0 {
            return 0.0;
        }
        let elastic_law = self.law.elastic;
        let tangent_stiffness = if elastic_law.exponent == 1.0 || elastic_law.k == 0.0 {
            elastic_law.k
        } else {
            // At the greatest depth that its energy allows.
            elastic_law.slope(elastic_law.depth(elastic_law.energy(g.max(0.0)) + 0.5 * v * v / inverse_mass))
        };
        sqrt(tangent_stiffness * inverse_mass).max(self.law.z * inverse_mass)
    }

    /// The impulse of a kick that lasts `duration` frames at constant penetration `g`, while `v` changes by the kick
    /// itself [N·s].
    fn kick(&self, [g, v]: [f64; 2], duration: f64, step: f64) -> f64 {
        let push_force = self.law.unlimited_force(g, v);
        let decay_rate = self.velocity_per_impulse * step * self.law.z;
        if decay_rate == 0.0 {
            return push_force * duration * step;
        }
        push_force * step * -expm1(-decay_rate * duration) / decay_rate
    }
}

impl FineLinks {
    /// Compute the pushes of a frame.
    pub(super) fn march(&mut self, script: &FineScript, laws: &LawScript, gates: &[f64], modules: &mut ModuleState) {
        let start_instant = self.set_instant(script, 0.0);
        let mut is_stiff = false;
        for index in 0..script.links.len() {
            let has_rested = std::mem::take(&mut self.has_rested[index]);
            self.is_pushing[index] = false;
            let Some(contact) = self.contact_at(script, gates, (index, 0.0)) else {
                continue;
            };
            let contact_state = self.contact_state(script, &contact, &start_instant);
            let is_pushing = contact.pushing_criterion(contact_state) > 0.0;
            (self.is_pushing[index], self.has_rested[index]) = (is_pushing, is_pushing);
            if is_pushing {
                modules.link_forces[script.links[index].first_link] =
                    contact.side * contact.law.unlimited_force(contact_state[0], contact_state[1]);
                is_stiff |= has_rested && contact.rate_bound(contact_state, script.rate.step()) > STEP_PHASE_MAX;
            }
        }
        if is_stiff {
            self.has_contact_closed = true;
            self.finish_implicitly(script, laws, gates, 0.0);
            return;
        }
        let (mut instant_now, mut steps_left) = (0.0, STEPS_MAX);
        while instant_now < 1.0 {
            if laws.links.is_empty() && !self.is_pushing.contains(&true) {
                match self.next_closing(script, gates, instant_now) {
                    Some((closing_instant, index)) => {
                        instant_now = closing_instant;
                        self.is_pushing[index] = true;
                    }
                    None => return,
                }
            }
            self.has_contact_closed |= self.is_pushing.contains(&true);
            if steps_left == 0 {
                self.finish_implicitly(script, laws, gates, instant_now);
                return;
            }
            instant_now = self.advance_step(script, (laws, gates), instant_now, &mut steps_left);
        }
    }

    /// The contact `index` at the instant `s` of this frame; `None` if it cannot be closed in this frame.
    fn contact_at(&self, script: &FineScript, gates: &[f64], (index, s): (usize, f64)) -> Option<LinkContact> {
        let link_run = &script.links[index];
        let LinkRunKind::But(but) = &link_run.kind else {
            return None;
        };
        let gate_opening = link_run.gate.map_or(1.0, |gate| gates[gate]);
        if !self.may_close[index] || gate_opening == 0.0 {
            return None;
        }
        let (first_joint, second_joint) = script.link_joints[index];
        let [k, z] = self.link_constants_at(index, s);
        Some(LinkContact {
            law: but.law(gate_opening * k, gate_opening * z),
            ends: (first_joint, second_joint),
            side: but.sign(),
            rest: link_run.rest,
            velocity_per_impulse: script.velocity_jump(first_joint, second_joint),
        })
    }

    /// Penetration [m] and how fast it grows [m/frame].
    fn contact_state(&self, script: &FineScript, contact: &LinkContact, instant: &Instant) -> [f64; 2] {
        let (first_joint, second_joint) = contact.ends;
        let [[x_a, v_a], [x_b, v_b]] = [first_joint, second_joint].map(|end| self.joint_motion(script, end, instant));
        [contact.side * (x_b - x_a - contact.rest), contact.side * (v_b - v_a)]
    }

    /// Push both ends of a contact [N·s].
    fn push_contact_ends(&mut self, script: &FineScript, contact: &LinkContact, impulse: f64, instant: &Instant) {
        let (first_joint, second_joint) = contact.ends;
        self.push_joint(script, first_joint, contact.side * impulse, instant);
        self.push_joint(script, second_joint, -contact.side * impulse, instant);
    }

    /// Advance from `s` by a step, or up to where a contact closes or opens in it; returns the instant reached.
    fn advance_step(
        &mut self,
        script: &FineScript,
        laws_and_gates: (&LawScript, &[f64]),
        s: f64,
        steps_left: &mut usize,
    ) -> f64 {
        let (stages, step_length) = self.choose_step(script, laws_and_gates.1, s);
        self.step_stages = stages;
        let [saved_paths, saved_sums] = &mut self.saved_paths_and_sums;
        saved_paths.copy_from_slice(&self.paths);
        saved_sums.copy_from_slice(&self.impulse_sums);
        self.save_crowded_motions(script);
        for law in &mut self.laws {
            law.save();
        }
        *steps_left -= 1;
        self.step_contacts(script, laws_and_gates, s, step_length);
        let (mut length_taken, mut switched_link) = (step_length, None);
        // Each contact is located only once in a step: two that turn at the same instant, to rounding, would alternate
        // for ever.
        self.is_instant_known.fill(false);
        while let Some(link_index) = self.first_switched(script, laws_and_gates.1, s + length_taken) {
            length_taken = self.locate_switch(script, laws_and_gates, (s, length_taken, link_index), steps_left);
            self.is_instant_known[link_index] = true;
            switched_link = Some(link_index);
        }
        if let Some(link_index) = switched_link {
            self.is_pushing[link_index] = !self.is_pushing[link_index];
            self.has_rested[link_index] &= self.is_pushing[link_index];
        }
        if s + length_taken > 1.0 - CLOSING_TOLERANCE * step_length {
            1.0
        } else {
            s + length_taken
        }
    }

    /// Contact `index` closes or opens within a step of `h` from `s`: repeat the step up to that instant; returns its
    /// length.
    fn locate_switch(
        &mut self,
        script: &FineScript,
        laws_and_gates: (&LawScript, &[f64]),
        (s, h, index): (f64, f64, usize),
        steps_left: &mut usize,
    ) -> f64 {
        let Some(contact) = self.contact_at(script, laws_and_gates.1, (index, s)) else {
            return h;
        };
        let contact_state_at = |fine: &mut Self, s: f64| {
            let instant = fine.set_instant(script, s);
            let contact = fine.contact_at(script, laws_and_gates.1, (index, s)).unwrap_or(contact);
            (contact, fine.contact_state(script, &contact, &instant))
        };
        let end_state = contact_state_at(self, s + h);
        self.restore_step();
        let start_state = contact_state_at(self, s);
        let mut uses_depth = !contact.releases_early() || (!self.is_pushing[index] && start_state.1[0] <= 0.0);
        let signs_differ = |uses_depth: bool| {
            let [start_criterion, end_criterion] = [start_state, end_state]
                .map(|(contact, contact_state)| contact.switch_criterion(contact_state, uses_depth));
            (start_criterion > 0.0) != (end_criterion > 0.0)
        };
        // It may open and approach again within the step: its force is then positive at both ends.
        uses_depth |= !signs_differ(uses_depth);
        if !signs_differ(uses_depth) {
            return 0.0; // it had first_switched before `s`
        }
        let criterion =
            |(contact, contact_state): (LinkContact, [f64; 2])| contact.switch_criterion(contact_state, uses_depth);
        let (mut length_taken, mut contact_state) = (h, end_state.1);
        let (mut low_end, mut high_end) = ((0.0, criterion(start_state)), (h, criterion(end_state)));
        for _ in 0..LOCATE_ROUNDS_MAX {
            // Newton's step if the criterion is the gap, whose slope is known.
            let newton_length = length_taken - contact_state[0] / contact_state[1];
            let secant_length = low_end.0 - low_end.1 * (high_end.0 - low_end.0) / (high_end.1 - low_end.1);
            let is_inside = newton_length > low_end.0 && newton_length < high_end.0;
            let next_length = if uses_depth && is_inside {
                newton_length
            } else {
                secant_length
            };
            let length_change = (next_length - length_taken).abs();
            length_taken = next_length;
            self.restore_step();
            *steps_left = steps_left.saturating_sub(1);
            self.step_contacts(script, laws_and_gates, s, length_taken);
            if length_change <= CLOSING_TOLERANCE * h || *steps_left == 0 {
                break;
            }
            let reached_state = contact_state_at(self, s + length_taken);
            contact_state = reached_state.1;
            let reached_criterion = criterion(reached_state);
            // Halving the value at the end that stays keeps the secant from approaching from one side only.
            if (reached_criterion > 0.0) == (low_end.1 > 0.0) {
                (low_end, high_end.1) = ((length_taken, reached_criterion), 0.5 * high_end.1);
            } else {
                (high_end, low_end.1) = ((length_taken, reached_criterion), 0.5 * low_end.1);
            }
        }
        length_taken
    }

    /// Undo the last step.
    fn restore_step(&mut self) {
        self.paths.copy_from_slice(&self.saved_paths_and_sums[0]);
        self.impulse_sums.copy_from_slice(&self.saved_paths_and_sums[1]);
        self.restore_crowded_motions();
        self.laws.iter_mut().for_each(LawState::restore);
    }

    /// Stages and length of the step from `s`.
    fn choose_step(&mut self, script: &FineScript, gates: &[f64], s: f64) -> (Stages, f64) {
        let time_step = script.rate.step();
        let instant = self.set_instant(script, s);
        let mut rates = ContactRates::default();
        for index in (0..script.links.len()).filter(|&index| self.is_pushing[index]) {
            if let Some(contact) = self.contact_at(script, gates, (index, s)) {
                rates.add(contact.rate_bound(self.contact_state(script, &contact, &instant), time_step));
            }
        }
        let (stages, least_steps) = script.contact_order.stages(script.steps_min as f64, rates);
        let frame_left = 1.0 - s;
        (stages, frame_left / (frame_left * least_steps).ceil().max(1.0))
    }

    /// One step of the contacts that push, and of all laws.
    fn step_contacts(&mut self, script: &FineScript, laws_and_gates: (&LawScript, &[f64]), s: f64, h: f64) {
        // Half of the motion of bristles comes before all else, and half after it.
        self.slide_bristles(
            script,
            laws_and_gates,
            (&Instant::new(script.basis.n_polynomials(), s), 0.5 * h),
        );
        let mut stage_time = 0.0;
        let stages = self.step_stages;
        for (stage, [kick, drift]) in stages.iter().enumerate() {
            let is_reversed = 2 * stage > stages.len();
            self.apply_kicks(script, laws_and_gates, (s + stage_time * h, kick * h), is_reversed);
            stage_time += drift;
        }
        self.apply_kicks(script, laws_and_gates, (s + h, stages[0][0] * h), true);
        self.slide_bristles(
            script,
            laws_and_gates,
            (&Instant::new(script.basis.n_polynomials(), s + h), 0.5 * h),
        );
    }

    /// Kicks of all contacts that push, and of all laws. If they change velocities on which losses depend, half of each
    /// kick is given in one order and half in the reverse order: then the whole is symmetric.
    fn apply_kicks(
        &mut self,
        script: &FineScript,
        laws_and_gates: (&LawScript, &[f64]),
        (s, duration): (f64, f64),
        is_reversed: bool,
    ) {
        let instant = self.set_instant(script, s);
        // In a step of one stage the last kick, in reverse order, makes up for the first.
        if script.is_coupled && self.step_stages.len() > 1 && self.is_order_sensitive(laws_and_gates.0) {
            self.kick_in_order(script, laws_and_gates, (&instant, 0.5 * duration), false);
            self.kick_in_order(script, laws_and_gates, (&instant, 0.5 * duration), true);
        } else {
            self.kick_in_order(script, laws_and_gates, (&instant, duration), is_reversed);
        }
    }

    /// Whether the order of kicks matters: several act, and at least one depends on a velocity.
    fn is_order_sensitive(&self, laws: &LawScript) -> bool {
        let pushing_links = || {
            self.is_pushing
                .iter()
                .zip(&self.link_constants)
                .filter(|(pushes, _)| **pushes)
        };
        let has_loss = |[start, end]: &[[f64; 2]; 2]| start[1] != 0.0 || end[1] != 0.0;
        let n_laws = laws.links.len();
        pushing_links().count() + n_laws > 1
            && (n_laws > 0 || pushing_links().any(|(_, constants)| has_loss(constants)))
    }

    /// Kicks one after the other, or in reverse order.
    fn kick_in_order(
        &mut self,
        script: &FineScript,
        (laws, gates): (&LawScript, &[f64]),
        (instant, duration): (&Instant, f64),
        is_reversed: bool,
    ) {
        let n_links = script.links.len();
        if is_reversed {
            for law in (0..laws.links.len()).rev() {
                self.kick_law(script, (laws, gates), law, (instant, duration));
            }
        }
        for order_index in 0..n_links {
            let link_index = if is_reversed {
                n_links - 1 - order_index
            } else {
                order_index
            };
            if !self.is_pushing[link_index] {
                continue;
            }
            let Some(contact) = self.contact_at(script, gates, (link_index, instant.s)) else {
                continue;
            };
            self.work.evaluations += 1;
            let impulse = contact.kick(
                self.contact_state(script, &contact, instant),
                duration,
                script.rate.step(),
            );
            self.push_contact_ends(script, &contact, impulse, instant);
        }
        if !is_reversed {
            for law in 0..laws.links.len() {
                self.kick_law(script, (laws, gates), law, (instant, duration));
            }
        }
    }

    /// A contact that stops or begins to push at `s`, and was not located in this step.
    fn first_switched(&mut self, script: &FineScript, gates: &[f64], s: f64) -> Option<usize> {
        let instant = self.set_instant(script, s);
        let unlocated_links = (0..script.links.len()).filter(|&index| !self.is_instant_known[index]);
        unlocated_links.into_iter().find(|&index| {
            self.contact_at(script, gates, (index, s)).is_some_and(|contact| {
                let contact_state = self.contact_state(script, &contact, &instant);
                if self.is_pushing[index] {
                    contact.pushing_criterion(contact_state) < 0.0
                } else {
                    contact.begins_to_push(contact_state)
                }
            })
        })
    }

    /// The first instant from `s` on at which a contact closes while none pushes, and which.
    fn next_closing(&mut self, script: &FineScript, gates: &[f64], s: f64) -> Option<(f64, usize)> {
        let mut search_start = s;
        for probe_index in 1..=CLOSING_PROBES {
            let search_end = s + (1.0 - s) * probe_index as f64 / CLOSING_PROBES as f64;
            let mut first_closing: Option<(f64, usize)> = None;
            for index in 0..script.links.len() {
                let mut is_closed_at = |s: f64| {
                    let instant = self.set_instant(script, s);
                    let contact = self.contact_at(script, gates, (index, s));
                    contact
                        .is_some_and(|contact| contact.begins_to_push(self.contact_state(script, &contact, &instant)))
                };
                if !is_closed_at(search_end) {
                    continue;
                }
                let (mut open_at, mut closed_at) = (search_start, search_end);
                // Bisection finds it to the last few bits.
                while closed_at - open_at > 1e-13 && !is_closed_at(open_at) {
                    let midpoint = 0.5 * (open_at + closed_at);
                    if is_closed_at(midpoint) {
                        closed_at = midpoint;
                    } else {
                        open_at = midpoint;
                    }
                }
                let closing_instant = if is_closed_at(open_at) { open_at } else { closed_at };
                if first_closing.is_none_or(|(earliest_instant, _)| closing_instant < earliest_instant) {
                    first_closing = Some((closing_instant, index));
                }
            }
            if first_closing.is_some() {
                return first_closing;
            }
            search_start = search_end;
        }
        None
    }

    /// The rest of a frame that would take too many steps: by the discrete gradient, stable at any step length.
    fn finish_implicitly(&mut self, script: &FineScript, laws: &LawScript, gates: &[f64], start_instant: f64) {
        let step_length = (1.0 - start_instant) / script.steps_min as f64;
        let time_step = script.rate.step();
        for step_index in 0..script.steps_min {
            let step_start = start_instant + step_index as f64 * step_length;
            let instants = [step_start, step_start + 0.5 * step_length, step_start + step_length];
            let start_instant = self.set_instant(script, instants[0]);
            for index in 0..script.links.len() {
                let link_contact = self.contact_at(script, gates, (index, instants[1]));
                self.penetrations[index] = link_contact.map_or(0.0, |link_contact| {
                    self.contact_state(script, &link_contact, &start_instant)[0]
                });
            }
            self.slide_bristles(script, (laws, gates), (&start_instant, 0.5 * step_length));
            let middle_instant = self.set_instant(script, instants[1]);
            for law in 0..laws.links.len() {
                self.kick_law(script, (laws, gates), law, (&middle_instant, step_length));
            }
            self.forces.fill(0.0);
            for _ in 0..ROUNDS_MAX {
                let mut force_change = 0.0_f64;
                for index in 0..script.links.len() {
                    let Some(link_contact) = self.contact_at(script, gates, (index, middle_instant.s)) else {
                        continue;
                    };
                    self.work.evaluations += 1;
                    let depth_before = self.penetrations[index];
                    // Remove the force of the last round.
                    let middle_instant = self.set_instant(script, instants[1]);
                    self.push_contact_ends(
                        script,
                        &link_contact,
                        -self.forces[index] * step_length * time_step,
                        &middle_instant,
                    );
                    let end_instant = self.set_instant(script, instants[2]);
                    let [free_depth, _] = self.contact_state(script, &link_contact, &end_instant);
                    let contact = ExactContact {
                        law: ContactLaw {
                            z: 2.0 * link_contact.law.z / step_length,
                            ..link_contact.law
                        },
                        beta: 0.5 * step_length * step_length * link_contact.velocity_per_impulse * time_step,
                    };
                    let contact_force = contact.push(free_depth, depth_before, depth_before.max(free_depth));
                    let middle_instant = self.set_instant(script, instants[1]);
                    self.push_contact_ends(
                        script,
                        &link_contact,
                        contact_force * step_length * time_step,
                        &middle_instant,
                    );
                    force_change = force_change
                        .max((contact_force - self.forces[index]).abs() - FORCE_TOLERANCE * contact_force.abs());
                    self.forces[index] = contact_force;
                }
                if force_change <= 0.0 {
                    break;
                }
            }
            let end_instant = self.set_instant(script, instants[2]);
            self.slide_bristles(script, (laws, gates), (&end_instant, 0.5 * step_length));
            for (has_rested, contact_force) in self.has_rested.iter_mut().zip(&self.forces) {
                *has_rested &= *contact_force != 0.0;
            }
        }
    }
}
