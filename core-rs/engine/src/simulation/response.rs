//! Response of a network to a hand that is displaced for one tick, tick by tick.

use std::sync::Arc;

use super::{OnFault, Simulation, SimulationOptions};
use crate::network::{Error, Network, ReachableNetwork, Term};
use crate::plan::{Budget, Method, Plan};
use crate::scheme::Scheme;
use crate::timeline::{HandInterpolation, Timeline};
use crate::units::Rate;

/// Displacement of the hand [m]. A network with closed contacts is linear: any value far above rounding will do.
const DISPLACEMENT_METRES: f64 = 1e-3;
/// The response is followed until its end is this small, relative to its largest force after the first two ticks.
const DECAYED_RATIO: f64 = 1e-4;
/// Largest amount of work for that [MATs × ticks].
const MAT_TICKS_MAX: usize = 1 << 17;
/// Largest number of steps a frame, for a closed network that is too stiff for one.
const OVERSAMPLING_MAX: u32 = 64;

impl ReachableNetwork {
    /// Force against the hand [N/m] in each tick of `frames_per_tick` frames, after a displacement of 1 m that lasts
    /// one tick. `tick_limits`: the smallest and the largest number of ticks; between the two, the response is followed
    /// as long as it rings.
    ///
    /// `None` if the network with all contacts closed diverges, even in steps as fine as are allowed.
    ///
    /// # Errors
    /// If the hand's MAT does not move, or a tick cannot have this length.
    pub fn response(
        &self,
        rate: Rate,
        frames_per_tick: u32,
        tick_limits: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        if self.is_discrete() {
            return self.response_in_steps(rate, frames_per_tick, 1, tick_limits);
        }
        let response = match self.response_by_modes(rate, frames_per_tick, tick_limits)? {
            None => self.response_in_steps(rate, frames_per_tick, 1, tick_limits)?,
            result => result,
        };
        if response.is_some() {
            return Ok(response);
        }
        // A performance computes frames that are too stiff in finer steps as well.
        match Scheme::new(&self.network, rate)?.certify(&self.network) {
            Err(Error::Unstable { oversampling, .. }) if oversampling <= OVERSAMPLING_MAX => {
                self.response_in_steps(rate, frames_per_tick, oversampling, tick_limits)
            }
            _ => Ok(None),
        }
    }

    /// Whether the network is defined at its rate (algorithmic parts), so that finer steps would change it.
    fn is_discrete(&self) -> bool {
        let network_parts = self.network.parts();
        let mat_parts = &self.network.mats().part;
        mat_parts.iter().any(|&part| {
            network_parts
                .get(part as usize)
                .is_some_and(|part| part.ca_rate.is_some())
        })
    }

    /// The response with bodies by their modes, which have no largest step: closed contacts make a mesh so stiff that
    /// stepping it takes many steps a frame. `None` if no plan by modes is stable.
    fn response_by_modes(
        &self,
        rate: Rate,
        frames_per_tick: u32,
        tick_limits: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        let mut network = self.network.clone();
        // A plan computes only what is heard.
        let hand_position = Term::Position {
            first: self.mat,
            len: 1,
            weight: 1.0,
        };
        network.listen("hand", vec![hand_position])?;
        let network = Arc::new(network);
        let timeline = self.displaced_hand(&network, rate, frames_per_tick)?;
        match Plan::new(network, &timeline, &Budget::Method(Method::Modal), None) {
            Ok(plan) => self.force_in_ticks(plan, frames_per_tick, tick_limits),
            Err(_) => Ok(None),
        }
    }

    fn response_in_steps(
        &self,
        rate: Rate,
        frames_per_tick: u32,
        oversampling: u32,
        tick_limits: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        let rate = Rate::new(rate.hertz() * f64::from(oversampling)).map_err(|error| self.refusal(error))?;
        let network = Arc::new(self.network.clone());
        let timeline = self.displaced_hand(&network, rate, frames_per_tick * oversampling)?;
        let plain_plan = Plan::plain(network, &timeline, true)?;
        self.force_in_ticks(plain_plan, frames_per_tick * oversampling, tick_limits)
    }

    fn refusal(&self, reason: impl ToString) -> Error {
        Error::Refused {
            module: self.network.mat_name(self.mat),
            message: reason.to_string(),
        }
    }

    /// The hand at rest, displaced for a tick of `frames_per_tick`, and back.
    fn displaced_hand(&self, network: &Network, rate: Rate, frames_per_tick: u32) -> Result<Timeline, Error> {
        let mut timeline = Timeline::new(rate);
        // The path begins at 0: the hand is at rest before its displacement.
        let hand_path = [0.0, DISPLACEMENT_METRES, 0.0];
        timeline
            .add_hand(network, self.mat, frames_per_tick, HandInterpolation::Line, &hand_path)
            .map_err(|error| self.refusal(error))?;
        Ok(timeline)
    }

    /// The force in each tick of `frames_per_tick` as a plan computes it; `None` if something diverged.
    fn force_in_ticks(
        &self,
        plan: Plan,
        frames_per_tick: u32,
        tick_limits: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        let options = SimulationOptions {
            keeps_ledger: false,
            records_ergons: false,
            on_fault: OnFault::Mute,
            threads: 1,
            is_unchecked: true,
        };
        let mut simulation = Simulation::from_plan(Arc::new(plan), options)?;
        let frames_per_tick = u64::from(frames_per_tick);
        let [ticks_min, ticks_max] = tick_limits;
        let ticks_max = ticks_max
            .min(MAT_TICKS_MAX / self.network.n_mat().max(1))
            .max(ticks_min);
        let mut response = Vec::with_capacity(ticks_max);
        // Faults are muted.
        let _ = simulation.skip(frames_per_tick);
        while response.len() < ticks_min || (response.len() < ticks_max && is_still_ringing(&response)) {
            for _ in 0..ticks_min.min(ticks_max - response.len()) {
                let _ = simulation.skip(frames_per_tick);
                response.push(-simulation.hand_force(0) / DISPLACEMENT_METRES);
            }
        }
        let is_complete = simulation.n_muted() == 0 && response.iter().all(|force| force.is_finite());
        Ok(is_complete.then_some(response))
    }
}

/// Whether the last quarter of a response still holds a force above `DECAYED_RATIO` of the largest after the first two
/// ticks.
fn is_still_ringing(response: &[f64]) -> bool {
    let peak_force = |part: &[f64]| part.iter().fold(0.0, |greatest, x| f64::max(greatest, x.abs()));
    let tail_start = response.len() - response.len() / 4;
    response.len() > 2 && peak_force(&response[tail_start..]) > DECAYED_RATIO * peak_force(&response[2..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Network, NetworkMoment, Tie};

    const RATE: f64 = 44_100.0;
    const KEY: Tie = Tie::Physical { k: 60.0, z: 1.2 };

    /// Two keys `a` and `b` joined by a spring, each with a mass behind it, and a CEL `far` that no link joins to them.
    fn scene() -> (Network, [usize; 5]) {
        let mut network = Network::new();
        network.part("keys", None);
        let first_key = network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let far_cell = network.cel("far", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        let second_key = network.cel("b", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let first_mass = network.cel("m", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        let second_mass = network.cel("n", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        network.spring("am", first_key, first_mass, 300.0, 0.1, 1e-3).unwrap();
        network.spring("ab", first_key, second_key, 500.0, 0.0, 0.0).unwrap();
        network.spring("bn", second_key, second_mass, 700.0, 0.1, 0.0).unwrap();
        (network, [first_key, far_cell, second_key, first_mass, second_mass])
    }

    fn response(network: &Network, mat: usize, moment: &NetworkMoment) -> Vec<f64> {
        let reached = network.reachable_network(mat, moment, 1e-3, RATE);
        let sample_rate = Rate::new(RATE).unwrap();
        reached.response(sample_rate, 44, [400, 4_096]).unwrap().unwrap()
    }

    #[test]
    fn reachable_network_ends_at_held_keys() {
        let (network, [first_key, far_cell, second_key, ..]) = scene();
        let reached = network.reachable_network(first_key, &NetworkMoment::default(), 1e-3, RATE);
        assert_eq!(
            (reached.network.n_mat(), reached.network.n_lia(), reached.n_other_hands),
            (4, 3, 0)
        );
        let moment_held = NetworkMoment {
            held_mats: vec![far_cell, second_key],
            ..NetworkMoment::default()
        };
        // A held key is the end of what can be reached, and the hand on it is counted.
        let reached = network.reachable_network(first_key, &moment_held, 1e-3, RATE);
        assert_eq!(
            (reached.network.n_mat(), reached.network.n_lia(), reached.n_other_hands),
            (3, 2, 1)
        );
        let moment_parted = NetworkMoment {
            disabled_links: vec![1],
            ..moment_held
        };
        let reached = network.reachable_network(first_key, &moment_parted, 1e-3, RATE);
        assert_eq!(
            (reached.network.n_mat(), reached.network.n_lia(), reached.n_other_hands),
            (2, 1, 0)
        );
    }

    /// At a moment of a glide, the network responds as one that has the numbers of that moment.
    #[test]
    fn response_at_a_moment_of_a_glide() {
        let (network, [first_key, _, _, first_mass, _]) = scene();
        let glide_moment = NetworkMoment {
            ties: vec![(first_mass, [10.0, 0.3, 0.02])],
            link_factors: vec![(1, 3.0)],
            ..NetworkMoment::default()
        };
        let mut other_network = Network::new();
        other_network.part("keys", None);
        let other_key = other_network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let mass_tie = Tie::Physical { k: 10.0, z: 0.3 };
        let first_mass = other_network.cel("m", 0.02, mass_tie, 0.0, 0.0, 0.0).unwrap();
        let second_key = other_network.cel("b", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let second_mass = other_network.cel("n", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        other_network
            .spring("am", other_key, first_mass, 300.0, 0.1, 0.0)
            .unwrap();
        other_network
            .spring("ab", other_key, second_key, 1_500.0, 0.0, 0.0)
            .unwrap();
        other_network
            .spring("bn", second_key, second_mass, 700.0, 0.1, 0.0)
            .unwrap();
        let (answered, expected) = (
            response(&network, first_key, &glide_moment),
            response(&other_network, other_key, &NetworkMoment::default()),
        );
        for (answered, expected) in answered.iter().zip(&expected) {
            assert!((answered - expected).abs() < 1e-6 * expected.abs() + 1e-9);
        }
        assert_ne!(answered, response(&network, first_key, &NetworkMoment::default()));
    }

    /// The same numbers give the same bytes; a change of any number changes the bytes.
    #[test]
    fn numbers_of_networks_differ_with_any_value() {
        let (network, [first_key, _, second_key, ..]) = scene();
        let plain_moment = NetworkMoment::default();
        let parameter_bytes_of = |moment: &NetworkMoment| {
            network
                .reachable_network(first_key, moment, 1e-3, RATE)
                .network
                .parameter_bytes()
        };
        assert_eq!(parameter_bytes_of(&plain_moment), parameter_bytes_of(&plain_moment));
        let softer_moment = NetworkMoment {
            link_factors: vec![(2, 0.5)],
            ..NetworkMoment::default()
        };
        let held_moment = NetworkMoment {
            held_mats: vec![second_key],
            ..NetworkMoment::default()
        };
        assert_ne!(parameter_bytes_of(&plain_moment), parameter_bytes_of(&softer_moment));
        assert_ne!(parameter_bytes_of(&plain_moment), parameter_bytes_of(&held_moment));
    }

    /// A key, and behind a soft spring a row of masses that is too stiff for steps of a frame.
    fn scene_with_mesh() -> (Network, usize) {
        let mut network = Network::new();
        network.part("keys", None);
        let key = network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let mut last = network.cel("m0", 1e-3, KEY, 0.0, 0.0, 0.0).unwrap();
        network.spring("am", key, last, 600.0, 0.1, 0.0).unwrap();
        for number in 1..12 {
            let next = network.cel(&format!("m{number}"), 1e-3, KEY, 0.0, 0.0, 0.0).unwrap();
            network
                .spring(&format!("s{number}"), last, next, 2e7, 0.02, 0.0)
                .unwrap();
            last = next;
        }
        (network, key)
    }

    /// A stiff mesh behind a soft spring: modes answer as steps do that are fine enough.
    #[test]
    fn response_by_modes_equals_finer_steps() {
        let (network, first_key) = scene_with_mesh();
        let reached = network.reachable_network(first_key, &NetworkMoment::default(), 1e-3, RATE);
        let (rate, ticks) = (Rate::new(RATE).unwrap(), [400, 400]);
        assert!(reached.response_in_steps(rate, 44, 1, ticks).unwrap().is_none());
        let by_modes = reached.response_by_modes(rate, 44, ticks).unwrap().unwrap();
        let in_steps = reached.response_in_steps(rate, 44, 64, ticks).unwrap().unwrap();
        let difference: f64 = by_modes.iter().zip(&in_steps).map(|(a, b)| (a - b) * (a - b)).sum();
        let power: f64 = in_steps.iter().map(|force| force * force).sum();
        // The key moves in steps of a frame there and of a 64th of it here: in a tick of 44 frames that is 2 %.
        assert!(
            difference.sqrt() < 0.03 * power.sqrt(),
            "{} dB",
            10.0 * libm::log10(difference / power)
        );
        let force_sums = [&by_modes, &in_steps].map(|forces| forces.iter().sum::<f64>());
        assert!(
            (force_sums[0] - force_sums[1]).abs() < 1e-3 * force_sums[1].abs(),
            "{force_sums:?}"
        );
    }

    /// With its contacts closed, this network needs finer steps than a frame.
    #[test]
    fn response_of_a_stiff_network_without_a_body() {
        let mut network = Network::new();
        network.part("keys", None);
        let first_key = network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let light_mass = network.cel("m", 1e-4, KEY, 0.0, 0.0, 0.0).unwrap();
        network.spring("am", first_key, light_mass, 1e6, 0.0, 0.0).unwrap();
        let hand_forces = response(&network, first_key, &NetworkMoment::default());
        // In the end the mass moves with the key, and only the spring of its own tie pushes back.
        let force_sum: f64 = hand_forces.iter().sum();
        assert!((force_sum - 60.0).abs() < 10.0, "{force_sum}");
    }
}
