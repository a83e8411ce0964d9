//! A network without names and places, on which its motion does not depend: equal islands of two scores are then equal.

use super::{Network, Output, Part};

/// The parts that some networks with a common list of parts have modules of, in the order of that list.
///
/// The order of parts may decide the order of sums, but how many other parts a score has does not.
#[derive(Clone, Debug)]
pub(crate) struct PartOrder(Vec<usize>);

impl PartOrder {
    pub(crate) fn new<'a>(networks: impl IntoIterator<Item = &'a Network>) -> Self {
        let mut used_parts: Vec<usize> = Vec::new();
        for network in networks {
            let mut part_order: Vec<usize> = network.mats.part.iter().map(|&part| part as usize).collect();
            part_order.dedup(); // modules of a part are mostly adjacent
            used_parts.extend(part_order);
            used_parts.extend(network.runs.iter().map(|run| run.part));
        }
        used_parts.sort_unstable();
        used_parts.dedup();
        Self(used_parts)
    }

    /// How many of the parts are before a part.
    pub(crate) fn rank(&self, part: usize) -> usize {
        self.0.partition_point(|&ordered_part| ordered_part < part)
    }
}

impl Network {
    /// The same modules without names and positions on the bench, with parts by their rank in `order`.
    pub(crate) fn anonymous(&self, order: &PartOrder) -> Self {
        let mut anonymised = self.clone();
        anonymised.current_part = 0;
        anonymised.names = super::names::Names::default();
        let ordered_parts = order.0.iter().filter_map(|&part| self.parts.get(part));
        anonymised.parts = ordered_parts
            .map(|part| Part {
                name: String::new(),
                ..part.clone()
            })
            .collect();
        anonymised.mats.bench_position.clear();
        for part in &mut anonymised.mats.part {
            *part = order.rank(*part as usize) as u32;
        }
        for run in &mut anonymised.runs {
            run.part = order.rank(run.part);
        }
        let outputs = anonymised.outputs.into_iter();
        anonymised.outputs = outputs
            .map(|output| Output {
                name: String::new(),
                ..output
            })
            .collect();
        anonymised
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Term, Tie};

    /// A bell after `before` other parts, of which every second has a module.
    fn bell(before: &[&str], name: &str, f: f64) -> (Network, Vec<u32>) {
        let mut network = Network::new();
        let tuned_tie = Tie::Tuned { f, t60: None };
        for (index, other) in before.iter().enumerate() {
            network.part(other, None);
            if index % 2 == 0 {
                network.mas("m", 1e-3, 0.0, 0.0).unwrap();
            }
        }
        network.part(name, None);
        let hum_mat = network.cel("hum", 2e-3, tuned_tie, 0.0, 0.0, 0.0).unwrap();
        let head_mat = network.mas("head", 1e-3, 0.0, 0.0).unwrap();
        network.spring("tie", hum_mat, head_mat, 1e3, 0.0, 0.0).unwrap();
        let hum_term = Term::Position {
            first: hum_mat,
            len: 1,
            weight: 1.0,
        };
        network.listen(name, vec![hum_term]).unwrap();
        (network, vec![hum_mat as u32, head_mat as u32])
    }

    fn text(before: &[&str], name: &str, f: f64) -> String {
        let (network, bell_mats) = bell(before, name, f);
        let all_links: Vec<u32> = (0..network.n_lia() as u32).collect();
        let island = network.subset(&bell_mats, &[], &all_links).network;
        format!("{:?}", island.anonymous(&PartOrder::new([&island])))
    }

    #[test]
    fn content_without_names_and_other_parts() {
        let bell_alone = text(&[], "bell", 440.0);
        assert_eq!(text(&[], "gong", 440.0), bell_alone);
        assert_eq!(text(&["a", "b", "c"], "bell", 440.0), bell_alone);
        assert_ne!(text(&[], "bell", 441.0), bell_alone);
    }

    #[test]
    fn content_with_parts_in_order() {
        let (network, _) = bell(&["a", "b", "c"], "bell", 440.0);
        let part_order = PartOrder::new([&network]);
        assert_eq!([0, 2, 3].map(|part| part_order.rank(part)), [0, 1, 2]);
        let anonymous = network.anonymous(&part_order);
        assert_eq!(anonymous.mats.part, [0, 1, 2, 2]);
        assert_eq!(anonymous.parts.len(), 3);
    }
}
