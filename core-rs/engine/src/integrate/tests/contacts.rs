//! A hammer on a string, with plain contacts.

use super::*;
use crate::network::But;

const FRAMES: usize = 300;
const HAMMER: f64 = 8e-3;

/// A string of 20 masses of 1 g, hit from below by a mass of 8 g at 3 m/s.
fn struck(k: f64, exponent: f64, z: f64) -> Network {
    let mut network = row(20, 5e4, 0.0, 0.0);
    for i in 0..20 {
        network.set_initial_motion(i, 0.0, 0.0).expect("a start");
    }
    let hammer_mat = network.mas("hammer", HAMMER, -3e-4, 3.0).expect("a mass");
    let hammer_contact = But {
        exponent,
        ..But::plain(k, z, 0.0)
    };
    network.but("felt", hammer_mat, 8, hammer_contact).expect("a contact");
    network
}

const WAYS: [MeshMethod; 4] = [MeshMethod::Ca, MeshMethod::Ca2p, MeshMethod::Bm4, MeshMethod::Ieq];

fn errors(network: &Network) -> [f64; 4] {
    let fine_path = play(by(network, MeshMethod::Bm4, 128), FRAMES, &[]);
    WAYS.map(|way| error_db(&play(by(network, way, 1), FRAMES, &[]), &fine_path))
}

/// κ = K(1/m + 1/m)T², from soft to too stiff for any explicit step. CA, CA2P, BM4 and IEQ reach
/// -45, -74, -90, -46 | -32, -32, -51, -29 | -9, -24, -31, -20 | fail, fail, -7, -21 | fail, fail, fail, -21 dB.
#[test]
fn contact_errors_by_stiffness_and_method() {
    let position = |kappa: f64| {
        let contact_stiffness = kappa * HERTZ * HERTZ / (1.0 / HAMMER + 1e3);
        errors(&struck(contact_stiffness, 1.0, 0.0))
    };
    let [ca, ca2p, bm4, ieq] = position(0.06);
    assert!(ca < -44.0 && ca2p < -73.0 && bm4 < -89.0 && ieq < -45.0);
    for kappa in [0.94, 3.7] {
        let [ca, ca2p, bm4, ieq] = position(kappa);
        assert!(bm4 < ca2p - 6.0 && ca2p < ca + 1.0 && ieq < -19.0);
    }
    let [ca, ca2p, bm4, ieq] = position(62.0);
    assert!(ca > 0.0 && ca2p > 0.0 && bm4 < -6.0 && ieq < -19.0);
    let [ca, ca2p, bm4, ieq] = position(6e3);
    assert!(ca > 0.0 && ca2p > 0.0 && bm4 > 0.0 && ieq < -19.0);
}

#[test]
fn power_law_contacts_by_method() {
    for (z, limit) in [(0.0, [-63.0, -80.0, -160.0, -63.0]), (5.0, [-50.0; 4])] {
        let network = struck(3e8, 2.5, z);
        let errors = errors(&network);
        let are_small = errors.iter().zip(limit).all(|(error, limit)| *error < limit);
        assert!(are_small, "{errors:?}");
        let mut integrator = by(&network, MeshMethod::Ieq, 1);
        integrator.step(&[], &mut ThreadTeam::alone());
        let start_energy = integrator.energy();
        let mut last_energy = start_energy;
        for _ in 0..3000 {
            integrator.step(&[], &mut ThreadTeam::alone());
            assert!(integrator.energy() <= last_energy * (1.0 + 1e-14));
            last_energy = integrator.energy();
        }
        let energy_left = last_energy / start_energy;
        assert!(
            if z == 0.0 {
                (energy_left - 1.0).abs() < 1e-13
            } else {
                energy_left < 0.7
            },
            "{energy_left}"
        );
    }
}
