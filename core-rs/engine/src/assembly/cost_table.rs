//! The table of costs, which ships as data.

use std::sync::LazyLock;

/// Nanoseconds of one unit of each kind of work.
const COST_TABLE: &str = include_str!("costs.txt");

/// The table of costs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs;

impl Costs {
    /// Nanoseconds of one unit of a kind of work.
    pub(crate) fn nanoseconds(kind: &str) -> f64 {
        let known_cost = COSTS.iter().find(|(name, _)| *name == kind);
        known_cost.map_or(0.0, |(_, ns)| *ns)
    }
}

/// Each kind of work and its cost, read once: trials ask for costs in every block.
static COSTS: LazyLock<Vec<(&str, f64)>> = LazyLock::new(|| {
    let lines = COST_TABLE.lines().filter(|line| !line.starts_with('#'));
    let cost = |line: &'static str| {
        let mut words = line.split_whitespace();
        Some((words.next()?, words.next()?.parse().ok()?))
    };
    lines.filter_map(cost).collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cost_table_lines_are_positive() {
        for line in COST_TABLE.lines().filter(|line| !line.starts_with('#')) {
            let work_kind = line.split_whitespace().next().unwrap();
            assert!(Costs::nanoseconds(work_kind) > 0.0, "{line}");
        }
        assert_eq!(Costs::nanoseconds("no such work"), 0.0);
    }
}
