//! What a plan costs: work counted, times a table that ships as data.

/// Nanoseconds for each kind of work.
const TABLE: &str = include_str!("costs.txt");

/// The table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs;

impl Costs {
    /// Nanoseconds of one unit of a kind of work.
    pub(crate) fn of(kind: &str) -> f64 {
        TABLE
            .lines()
            .filter(|line| !line.starts_with('#'))
            .find_map(|line| {
                let mut words = line.split_whitespace();
                (words.next() == Some(kind)).then(|| words.next())?
            })
            .and_then(|ns| ns.parse().ok())
            .unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_a_cost() {
        for line in TABLE.lines().filter(|line| !line.starts_with('#')) {
            let kind = line.split_whitespace().next().unwrap();
            assert!(Costs::of(kind) > 0.0, "{line}");
        }
        assert_eq!(Costs::of("no such work"), 0.0);
    }
}
