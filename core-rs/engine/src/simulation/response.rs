//! Response of a network to a hand that is displaced for one tick, tick by tick.

use std::sync::Arc;

use super::{OnFault, Options, Simulation};
use crate::network::{Error, ReachableNetwork};
use crate::plan::Plan;
use crate::scheme::Scheme;
use crate::timeline::{HandWay, Timeline};
use crate::units::Rate;

/// Displacement of the hand [m]. A network with closed contacts is linear: any value far above rounding will do.
const DISPLACEMENT: f64 = 1e-3;
/// The response is followed until its end is this small, relative to its largest force after the first two ticks.
const DECAYED: f64 = 1e-4;
/// Largest amount of work for that [MATs × ticks].
const WORK_MAX: usize = 1 << 17;
/// Largest number of steps a frame, for a closed network that is too stiff for one.
const OVERSAMPLING_MAX: u32 = 64;

impl ReachableNetwork {
    /// Force against the hand [N/m] in each tick of `every` frames, after a displacement of 1 m that lasts one tick.
    /// `ticks`: the smallest and the largest number of ticks; between the two, the response is followed as long as it
    /// rings.
    ///
    /// `None` if the network with all contacts closed diverges, even in steps as fine as are allowed.
    ///
    /// # Errors
    /// If the hand's MAT does not move, or a tick cannot have this length.
    pub fn response(
        &self,
        rate: Rate,
        every: u32,
        ticks: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        let response = self.response_in_steps(rate, every, 1, ticks)?;
        if response.is_some() || self.is_discrete() {
            return Ok(response);
        }
        // A performance computes frames that are too stiff in finer steps as well.
        match Scheme::new(&self.network, rate)?.certify(&self.network) {
            Err(Error::Unstable { oversampling, .. }) if oversampling <= OVERSAMPLING_MAX => {
                self.response_in_steps(rate, every, oversampling, ticks)
            }
            _ => Ok(None),
        }
    }

    /// Whether the network is defined at its rate (algorithmic parts), so that finer steps would change it.
    fn is_discrete(&self) -> bool {
        let parts = self.network.parts();
        let mat_parts = &self.network.mats().part;
        mat_parts.iter().any(|&part| {
            parts
                .get(part as usize)
                .is_some_and(|part| part.ca_rate.is_some())
        })
    }

    fn response_in_steps(
        &self,
        rate: Rate,
        every: u32,
        steps: u32,
        ticks: [usize; 2],
    ) -> Result<Option<Vec<f64>>, Error> {
        let refused = |message: String| Error::Refused {
            module: self.network.mat_name(self.mat),
            message,
        };
        let network = Arc::new(self.network.clone());
        let rate = Rate::new(rate.hertz() * f64::from(steps))
            .map_err(|error| refused(error.to_string()))?;
        let mut timeline = Timeline::new(rate);
        // The path begins at 0: the hand is at rest before its displacement.
        let path = [0.0, DISPLACEMENT, 0.0];
        timeline
            .hand(&network, self.mat, every * steps, HandWay::Line, &path)
            .map_err(|error| refused(error.to_string()))?;
        let options = Options {
            ledger: false,
            record: false,
            on_fault: OnFault::Mute,
            threads: 1,
            unchecked: true,
        };
        let plan = Plan::plain(network, &timeline, true)?;
        let mut simulation = Simulation::planned(Arc::new(plan), options)?;
        let frames = u64::from(every * steps);
        let [least, ticks_max] = ticks;
        let ticks_max = ticks_max
            .min(WORK_MAX / self.network.n_mat().max(1))
            .max(least);
        let mut response = Vec::with_capacity(ticks_max);
        // Faults are muted.
        let _ = simulation.skip(frames);
        while response.len() < least || (response.len() < ticks_max && rings(&response)) {
            for _ in 0..least.min(ticks_max - response.len()) {
                let _ = simulation.skip(frames);
                response.push(-simulation.hand_force(0) / DISPLACEMENT);
            }
        }
        let is_whole = simulation.n_muted() == 0 && response.iter().all(|force| force.is_finite());
        Ok(is_whole.then_some(response))
    }
}

/// Whether the last quarter of a response still holds a force above `DECAYED` of the largest after the first two ticks.
fn rings(response: &[f64]) -> bool {
    let greatest = |part: &[f64]| {
        part.iter()
            .fold(0.0, |greatest, x| f64::max(greatest, x.abs()))
    };
    let end = response.len() - response.len() / 4;
    response.len() > 2 && greatest(&response[end..]) > DECAYED * greatest(&response[2..])
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
        let a = network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let far = network.cel("far", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        let b = network.cel("b", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let m = network.cel("m", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        let n = network.cel("n", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        network.spring("am", a, m, 300.0, 0.1, 1e-3).unwrap();
        network.spring("ab", a, b, 500.0, 0.0, 0.0).unwrap();
        network.spring("bn", b, n, 700.0, 0.1, 0.0).unwrap();
        (network, [a, far, b, m, n])
    }

    fn response(network: &Network, mat: usize, moment: &NetworkMoment) -> Vec<f64> {
        let reached = network.reachable_network(mat, moment, 1e-3, RATE);
        let rate = Rate::new(RATE).unwrap();
        reached.response(rate, 44, [400, 4_096]).unwrap().unwrap()
    }

    #[test]
    fn reachable_network_ends_at_held_keys() {
        let (network, [a, far, b, ..]) = scene();
        let reached = network.reachable_network(a, &NetworkMoment::default(), 1e-3, RATE);
        assert_eq!(
            (
                reached.network.n_mat(),
                reached.network.n_lia(),
                reached.others
            ),
            (4, 3, 0)
        );
        let held = NetworkMoment {
            held: vec![far, b],
            ..NetworkMoment::default()
        };
        // A held key is the end of what can be reached, and the hand on it is counted.
        let reached = network.reachable_network(a, &held, 1e-3, RATE);
        assert_eq!(
            (
                reached.network.n_mat(),
                reached.network.n_lia(),
                reached.others
            ),
            (3, 2, 1)
        );
        let parted = NetworkMoment {
            without: vec![1],
            ..held
        };
        let reached = network.reachable_network(a, &parted, 1e-3, RATE);
        assert_eq!(
            (
                reached.network.n_mat(),
                reached.network.n_lia(),
                reached.others
            ),
            (2, 1, 0)
        );
    }

    /// At a moment of a glide, the network responds as one that has the numbers of that moment.
    #[test]
    fn response_at_a_moment_of_a_glide() {
        let (network, [a, _, _, m, _]) = scene();
        let moment = NetworkMoment {
            ties: vec![(m, [10.0, 0.3, 0.02])],
            factors: vec![(1, 3.0)],
            ..NetworkMoment::default()
        };
        let mut other = Network::new();
        other.part("keys", None);
        let key = other.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let tie = Tie::Physical { k: 10.0, z: 0.3 };
        let m = other.cel("m", 0.02, tie, 0.0, 0.0, 0.0).unwrap();
        let b = other.cel("b", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let n = other.cel("n", 0.01, KEY, 0.0, 0.0, 0.0).unwrap();
        other.spring("am", key, m, 300.0, 0.1, 0.0).unwrap();
        other.spring("ab", key, b, 1_500.0, 0.0, 0.0).unwrap();
        other.spring("bn", b, n, 700.0, 0.1, 0.0).unwrap();
        let (answered, expected) = (
            response(&network, a, &moment),
            response(&other, key, &NetworkMoment::default()),
        );
        for (answered, expected) in answered.iter().zip(&expected) {
            assert!((answered - expected).abs() < 1e-6 * expected.abs() + 1e-9);
        }
        assert_ne!(answered, response(&network, a, &NetworkMoment::default()));
    }

    /// The same numbers give the same bytes; a change of any number changes the bytes.
    #[test]
    fn numbers_of_networks_differ_with_any_value() {
        let (network, [a, _, b, ..]) = scene();
        let plain = NetworkMoment::default();
        let key_of = |moment: &NetworkMoment| {
            network
                .reachable_network(a, moment, 1e-3, RATE)
                .network
                .numbers()
        };
        assert_eq!(key_of(&plain), key_of(&plain));
        let softer = NetworkMoment {
            factors: vec![(2, 0.5)],
            ..NetworkMoment::default()
        };
        let held = NetworkMoment {
            held: vec![b],
            ..NetworkMoment::default()
        };
        assert_ne!(key_of(&plain), key_of(&softer));
        assert_ne!(key_of(&plain), key_of(&held));
    }

    /// With its contacts closed, this network needs finer steps than a frame.
    #[test]
    fn response_of_a_stiff_network_uses_finer_steps() {
        let mut network = Network::new();
        network.part("keys", None);
        let a = network.cel("a", 0.4, KEY, 0.0, 0.0, 0.0).unwrap();
        let m = network.cel("m", 1e-4, KEY, 0.0, 0.0, 0.0).unwrap();
        network.spring("am", a, m, 1e6, 0.0, 0.0).unwrap();
        let forces = response(&network, a, &NetworkMoment::default());
        // In the end the mass moves with the key, and only the spring of its own tie pushes back.
        let sum: f64 = forces.iter().sum();
        assert!((sum - 60.0).abs() < 10.0, "{sum}");
    }
}
