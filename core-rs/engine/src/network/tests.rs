use super::*;
use crate::generator::{self, Ends};

fn string(network: &mut Network, name: &str, masses: usize) -> usize {
    let topology = generator::string(masses, Ends::Fixed, 0.0).unwrap();
    network.mesh(name, &topology, 1e-2, 110.0, Some(2.0), 0.0).unwrap()
}

#[test]
fn names_of_parts_and_modules_as_written() {
    let mut network = Network::new();
    network.part("bell", None);
    let bell_mat = network.mas("m", 1.0, 0.0, 0.0).unwrap();
    network.part("harp", None);
    let string = string(&mut network, "string", 5);
    // A generator that is the whole part has the name of the part.
    network.part("sky", None);
    let sky_string = self::string(&mut network, "", 4);
    let sky_link = network.spring("", bell_mat, sky_string, 1.0, 0.0, 0.0).unwrap();
    assert_eq!(network.mat_name(bell_mat), "bell.m");
    assert_eq!(network.mat_name(string + 3), "harp.string.3");
    assert_eq!(network.mat_name(string + 5), "harp.string.end.0");
    assert_eq!(network.mat_name(sky_string + 1), "sky.1");
    assert_eq!(network.link_name(0), "harp.string.link.0");
    assert_eq!(network.link_name(sky_link), "sky");
    assert_eq!(network.mat_name(10_000), "#10000");
    assert_eq!(network.link_name(10_000), "#10000");
    assert_eq!((network.count(string), network.centre(string)), (5, string + 2));
    assert_eq!((network.count(bell_mat), network.centre(bell_mat)), (1, bell_mat));
    assert_eq!(network.count(10_000), 0);
    assert_eq!(
        network.run_of(sky_link).map(|run| (run.first, run.len)),
        Some((sky_link, 1))
    );
    assert!(network.run_of(sky_link + 1).is_none());
}

#[test]
fn part_continued_after_another_part() {
    let mut network = Network::new();
    for (part, module) in [("a", "m"), ("b", "m"), ("a", "n")] {
        network.part(part, None);
        network.mas(module, 1.0, 0.0, 0.0).unwrap();
    }
    assert_eq!(network.mats().part, [0, 1, 0]);
    assert_eq!(network.mat_name(2), "a.n");
}

/// Modules without a part get one with an empty name, so that every MAT has a part.
#[test]
fn module_without_a_part_has_an_unnamed_part() {
    let mut network = Network::new();
    assert!(network.parts().is_empty());
    network.mas("m", 1.0, 0.0, 0.0).unwrap();
    assert_eq!((network.parts().len(), network.mat_name(0).as_str()), (1, "m"));
    assert_eq!(network.subset_of_part(0, &[]).network.n_mat(), 1);
}

#[test]
fn part_alone_keeps_its_inner_links() {
    let rate = Rate::new(44_100.0).unwrap();
    let mut network = Network::new();
    network.part("other", None);
    network.mas("m", 3.0, 0.0, 0.0).unwrap();
    network.part("key", Some(rate));
    let first_mat = string(&mut network, "s", 4);
    let inner_link = network.spring("in", first_mat, first_mat + 2, 0.1, 0.2, 0.3).unwrap();
    network.spring("out", 0, first_mat, 1.0, 0.0, 0.0).unwrap();
    network.part("join", None);
    network
        .spring("by", first_mat + 1, first_mat + 3, 5.0, 0.0, 0.0)
        .unwrap();
    let key_subset = network.subset_of_part(1, &[]);
    assert_eq!(key_subset.mats, (1..=6).collect::<Vec<_>>());
    let key_network = key_subset.network;
    assert_eq!(key_network.mat_name(3), "key.s.3");
    // Five links of the string, `in` and `by`; `out` leads to another part.
    assert_eq!((key_network.n_mat(), key_network.n_lia()), (6, 7));
    let link_run = |link| key_network.run_of(link).unwrap();
    let run_rates: Vec<_> = (0..7)
        .map(|link| key_network.parts()[link_run(link).part].ca_rate)
        .collect();
    assert_eq!(run_rates[..6], [Some(rate); 6]);
    assert_eq!(run_rates[6], None, "a physical link stays one");
    let inner_run = link_run(5);
    assert_eq!((inner_run.k, inner_run.z, inner_run.rest), (0.1, 0.2, 0.3));
    assert_eq!((inner_run.a, inner_run.b), (0, 2));
    assert_eq!(network.link_name(inner_link), "key.in");
    let degrees: Vec<u32> = (0..6).map(|i| key_network.degree(i)).collect();
    assert_eq!(degrees, [3, 3, 3, 3, 1, 1]);
}

#[test]
fn network_with_bad_numbers_or_ends_is_refused() {
    let mut network = Network::new();
    network.part("p", None);
    let mas_index = network.mas("a", 1.0, 0.0, 0.0).unwrap();
    let sol_index = network.sol("b", 0.0).unwrap();
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        assert!(network.mas("x", bad, 0.0, 0.0).is_err());
    }
    for bad in [f64::NAN, f64::NEG_INFINITY] {
        assert!(network.mas("x", 1.0, bad, 0.0).is_err());
        assert!(
            network.set_initial_motion(mas_index, bad, 0.0).is_err()
                && network.set_initial_motion(mas_index, 0.0, bad).is_err()
        );
        assert!(network.spring("x", mas_index, sol_index, bad, 0.0, 0.0).is_err());
        assert!(network.spring("x", mas_index, sol_index, 1.0, 0.0, bad).is_err());
    }
    assert!(network.spring("x", mas_index, mas_index, 1.0, 0.0, 0.0).is_err());
    assert!(network.spring("x", mas_index, 2, 1.0, 0.0, 0.0).is_err());
    assert_eq!((network.n_mat(), network.n_lia()), (2, 0), "nothing of it stays");
}

#[test]
fn listen_to_missing_masses_is_refused() {
    let mut network = Network::new();
    network.mas("a", 1.0, 0.0, 0.0).unwrap();
    let position_term = |first, len, weight| vec![Term::Position { first, len, weight }];
    assert!(network.listen("o", position_term(0, 1, 1.0)).is_ok());
    assert!(network.listen("o", vec![]).is_ok(), "silence");
    for (first, len) in [(0, 2), (1, 1), (usize::MAX, 1), (1, usize::MAX)] {
        assert!(
            network.listen("o", position_term(first, len, 1.0)).is_err(),
            "{first} {len}"
        );
    }
    assert!(network.listen("o", position_term(0, 1, f64::NAN)).is_err());
    let (first, len, weight) = (0, 1, 1.0);
    assert!(network.listen("o", vec![Term::Force { first, len, weight }]).is_err());
}
