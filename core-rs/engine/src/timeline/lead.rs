//! Links whose K and Z go through points, given as factors of the values in the network.

use std::ops::Range;
use std::sync::Arc;

use super::Timeline;
use crate::network::{Contact, Error, LinkKind, Network, Run};
use crate::units::nearest_frame;

/// Factors of K and of Z.
pub type Factors = [f64; 2];

/// The factors of K and Z of some links as a function of the frame, linear between points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lead {
    /// Index of the first link and number of links: complete runs.
    pub(crate) first_link: usize,
    pub(crate) n_links: usize,
    /// Frames on the grid, rising, and the factors there; factors are constant before the first point and after the
    /// last.
    points: Arc<[(u64, Factors)]>,
}

impl Lead {
    /// The factors at frame `n` plus the fraction `part` of a frame.
    pub(crate) fn factors(&self, n: u64, part: f64) -> Factors {
        self.factors_from(n, part, &mut 0)
    }

    /// The same; `next_index` is the point after the frame asked for before, and becomes that after `n`.
    pub(crate) fn factors_from(&self, n: u64, part: f64, next_index: &mut usize) -> Factors {
        let is_after = |index: usize| self.points.get(index).is_none_or(|&(frame, _)| frame > n);
        let is_next = |index: usize| index > 0 && self.points[index - 1].0 <= n && is_after(index);
        if *next_index > self.points.len() || !is_next(*next_index) {
            *next_index = self.points.partition_point(|&(frame, _)| frame <= n);
        }
        let Some(&(start_frame, start_factors)) = next_index.checked_sub(1).and_then(|last| self.points.get(last))
        else {
            return self.points[0].1;
        };
        let Some(&(stop_frame, stop_factors)) = self.points.get(*next_index) else {
            return start_factors;
        };
        let passed_share = ((n - start_frame) as f64 + part) / (stop_frame - start_frame) as f64;
        std::array::from_fn(|i| start_factors[i] + (stop_factors[i] - start_factors[i]) * passed_share)
    }

    /// Whether its factors are those of another lead at all times.
    pub(crate) fn has_factors_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.points, &other.points) || self.points == other.points
    }

    /// The frames on the grid and the factors there.
    pub(super) fn points(&self) -> &[(u64, Factors)] {
        &self.points
    }

    /// The first frame, `n` or later, at which the factors may change.
    pub(crate) fn next_change_frame(&self, n: u64) -> u64 {
        next_change(&self.points, n)
    }

    /// The frame at which its factors have changed for the last time; `None` if they never change.
    pub(crate) fn last_change_frame(&self) -> Option<u64> {
        let mut changes = self.points.windows(2).rev();
        let last_change = changes.find(|pair| pair[0].1 != pair[1].1)?;
        Some(last_change[1].0)
    }

    /// The greatest factor of K and the greatest of Z.
    fn factors_max(&self) -> Factors {
        let point_factors = self.points.iter().map(|&(_, factors)| factors);
        point_factors.fold([0.0; 2], |largest_yet, factors| {
            std::array::from_fn(|i| f64::max(largest_yet[i], factors[i]))
        })
    }

    /// The same event at `oversampling` times the rate.
    pub(super) fn with_higher_rate(&self, oversampling: u64) -> Self {
        let slow_points = self.points.iter();
        Self {
            points: slow_points
                .map(|&(frame, factors)| (frame * oversampling, factors))
                .collect(),
            ..*self
        }
    }

    /// The same event at the rate divided by `rate_divisor`.
    pub(super) fn with_lower_rate(&self, rate_divisor: u64) -> Self {
        Self {
            points: points_at_lower_rate(&self.points, rate_divisor),
            ..*self
        }
    }

    /// The same event on other links.
    pub(crate) fn on_links(&self, first_link: usize, n_links: usize) -> Self {
        Self {
            first_link,
            n_links,
            points: self.points.clone(),
        }
    }

    /// Indices of the links.
    pub(crate) fn links(&self) -> Range<usize> {
        self.first_link..self.first_link + self.n_links
    }
}

/// The network with each led link at its greatest K and Z. If this network is stable, the led one is stable at all
/// times.
///
/// # Errors
/// If a law is not finite with them.
pub(crate) fn with_greatest_factors(network: &Network, leads: &[Lead]) -> Result<Network, Error> {
    let mut stiffest = network.clone();
    for lead in leads {
        stiffest.scale_links(lead.links(), lead.factors_max())?;
    }
    Ok(stiffest)
}

/// The network with each led link as it is at frame 0.
///
/// # Errors
/// As [`with_greatest_factors`].
pub(crate) fn with_first_factors(network: &Network, leads: &[Lead]) -> Result<Network, Error> {
    let mut start_network = network.clone();
    for lead in leads {
        start_network.scale_links(lead.links(), lead.factors(0, 0.0))?;
    }
    Ok(start_network)
}

/// The first frame, `n` or later, at which a value that is linear between points (frames, rising) may change.
pub(crate) fn next_change<T: PartialEq>(points: &[(u64, T)], n: u64) -> u64 {
    let point_pairs = points.windows(2);
    let mut later_changes = point_pairs.filter(|point_pair| point_pair[1].0 > n && point_pair[0].1 != point_pair[1].1);
    later_changes
        .next()
        .map_or(u64::MAX, |point_pair| point_pair[0].0.max(n))
}

/// Points (frames, rising) at the rate divided by `rate_divisor`; of points that fall on one frame the last is kept.
pub(super) fn points_at_lower_rate<T: Copy>(points: &[(u64, T)], rate_divisor: u64) -> Arc<[(u64, T)]> {
    let mut grid_points: Vec<(u64, T)> = Vec::with_capacity(points.len());
    for &(point_frame, value) in points {
        let point_frame = nearest_frame(point_frame, rate_divisor);
        if grid_points.last().is_some_and(|&(last, _)| last == point_frame) {
            grid_points.pop();
        }
        grid_points.push((point_frame, value));
    }
    grid_points.into()
}

impl Timeline {
    /// Let K and Z of `n` LIAs, which are whole runs, go through points (instants [s], rising; factors of K and of Z),
    /// linearly between them, on the grid. The q of a hardening spring does not change.
    ///
    /// ```
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.sol("b", 0.0)?);
    /// let tie = network.spring("tie", a, b, 500.0, 0.01, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// // Its K rises to 2 kN/m between 1 s and 2 s; Z stays.
    /// timeline.lead(&network, (tie, 1), &[(1.0, [1.0, 1.0]), (2.0, [4.0, 1.0])])?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the LIAs are not whole runs with K and Z in SI units, are led already, or there are no points that rise.
    pub fn lead(
        &mut self,
        network: &Network,
        (link, n): (usize, usize),
        points: &[(f64, Factors)],
    ) -> Result<(), Error> {
        let refusal = |message: &str| {
            Err(Error::Refused {
                module: network.link_name(link),
                message: message.to_owned(),
            })
        };
        let begins_row = |link: usize| network.run_of(link).is_some_and(|run| run.first == link);
        let links_end = link.saturating_add(n);
        if n == 0 || !begins_row(link) || !(links_end == network.n_lia() || begins_row(links_end)) {
            return refusal("this link is one of a row of links, which can glide only together; name the row");
        }
        let led_links = link..links_end;
        let led_runs = network.runs().iter();
        let mut led_runs = led_runs.filter(|run| led_links.contains(&run.first));
        if !led_runs.all(|run| has_stiffness(network, run)) {
            return refusal(
                "a link with a law of its own, a magic contact or a link with algorithmic values cannot glide",
            );
        }
        if self
            .leads
            .iter()
            .any(|lead| lead.links().any(|lead_link| led_links.contains(&lead_link)))
        {
            return refusal("the link already glides at that time");
        }
        let is_nonnegative = |x: &f64| x.is_finite() && *x >= 0.0;
        if !points
            .iter()
            .all(|(instant, factors)| is_nonnegative(instant) && factors.iter().all(is_nonnegative))
        {
            return refusal("a glide needs finite instants, and factors of 0 or more");
        }
        if points.is_empty() || points.windows(2).any(|pair| pair[1].0 < pair[0].0) {
            return refusal("the points of a glide must rise in time");
        }
        let mut grid_points: Vec<(u64, Factors)> = Vec::with_capacity(points.len());
        for &(instant, factors) in points {
            let grid_frame = self.on_grid(instant);
            if grid_points.last().is_some_and(|&(last, _)| last == grid_frame) {
                grid_points.pop();
            }
            grid_points.push((grid_frame, factors));
        }
        self.leads.push(Lead {
            first_link: link,
            n_links: n,
            points: grid_points.into(),
        });
        Ok(())
    }
}

/// Whether K and Z of a run can be multiplied by factors. A shared tension has neither, and does not change.
fn has_stiffness(network: &Network, run: &Run) -> bool {
    let is_ca_part = network.parts().get(run.part).is_some_and(|part| part.ca_rate.is_some());
    !is_ca_part
        && match &run.kind {
            LinkKind::Ref | LinkKind::Bristle(_) | LinkKind::Dry(_) | LinkKind::Space(_) | LinkKind::Pairwise(_) => {
                true
            }
            LinkKind::Followed(_) => false,
            LinkKind::But(but) => but.contact != Contact::Magic,
            LinkKind::Lnl(law) => law.hardening_spring().is_some() || law.is_shared(),
        }
}
