//! Network + Timeline + Budget → Plan: what is computed, how, and why the rest is not.
//!
//! Nothing passes between two islands, so each is computed on its own, by the cheapest method that is exact
//! enough for it. A plan is a function of its arguments alone, never of a timing.

mod body;
mod budget;
mod cells;
mod cost;
mod islands;
mod linear;
mod modes;
mod pilot;
mod ported;
mod row;
mod split;
mod truncate;

pub use budget::{Budget, Method, PITCH_UPTO};
pub use row::{Reason, Row, What};

use std::ops::Range;
use std::sync::Arc;

use crate::bank::{Oscillator, Strikes};
use crate::island::modal::Modal;
use crate::network::{Error, Network, Subset};
use crate::scheme::{Certificate, Scheme};
use crate::timeline::Timeline;
use islands::Island;
use linear::NoModes;
use split::Own;

/// Modules that touch each other, if only now and then, and what happens to them.
#[derive(Clone, Debug)]
pub(crate) struct Isle {
    pub(crate) network: Arc<Network>,
    pub(crate) timeline: Timeline,
    /// Linear bodies in it that go by their modes.
    pub(crate) bodies: Vec<Modal>,
    /// How often a frame contacts are computed while they may be closed.
    pub(crate) steps: usize,
    pub(crate) to_whole: Whole,
}

/// Local index → index in the whole; `None` where the island is the whole.
#[derive(Clone, Debug, Default)]
pub(crate) struct Whole {
    pub(crate) mats: Option<Vec<u32>>,
    pub(crate) outputs: Option<Vec<u32>>,
    pub(crate) keys: Option<Vec<u32>>,
    pub(crate) gestures: Option<Vec<u32>>,
}

/// The index in the whole of a local one.
pub(crate) fn whole(map: &Option<Vec<u32>>, local: usize) -> usize {
    map.as_ref().map_or(local, |map| map[local] as usize)
}

/// Oscillators that nothing couples.
#[derive(Clone, Debug, Default)]
pub(crate) struct BankPlan {
    pub(crate) oscillators: Vec<Oscillator>,
    pub(crate) strikes: Vec<Strikes>,
    /// The MAT that an oscillator is, and where it rests; empty where they are modes.
    pub(crate) mats: Vec<(u32, f64)>,
}

/// One thing to compute.
#[derive(Clone, Debug)]
pub(crate) enum Unit {
    Isle(Box<Isle>),
    Bank(BankPlan),
}

impl Unit {
    /// Nanoseconds a frame, by the table of costs.
    fn cost(&self) -> f64 {
        match self {
            Self::Isle(isle) => {
                let bodies = isle.bodies.iter().map(row::body_cost);
                row::stepped_cost(&isle.network, &isle.timeline) + bodies.sum::<f64>()
            }
            Self::Bank(bank) => row::bank_cost(bank),
        }
    }
}

/// What is computed, how, and why the rest is not.
#[derive(Clone, Debug)]
pub struct Plan {
    pub(crate) network: Arc<Network>,
    pub(crate) timeline_rate: crate::units::Rate,
    pub(crate) n_keys: usize,
    pub(crate) n_gestures: usize,
    pub(crate) units: Vec<Unit>,
    /// What outputs hear of modules that never move, and of where moving ones rest   (n_out)
    pub(crate) still: Vec<f64>,
    rows: Vec<Row>,
}

impl Plan {
    /// Everything stepped as written, by the CA scheme.
    ///
    /// `unchecked`: even where that diverges.
    pub fn plain(
        network: Arc<Network>,
        timeline: &Timeline,
        unchecked: bool,
    ) -> Result<Self, Error> {
        let mut plan = Self::empty(network.clone(), timeline);
        if !unchecked {
            let certificate = Scheme::new(&network, timeline.rate)?.certify(&network)?;
            plan.rows
                .push(Row::stepped(&network, timeline, certificate));
        }
        plan.units.push(Unit::Isle(Box::new(Isle {
            network,
            timeline: timeline.clone(),
            bodies: Vec::new(),
            steps: 1,
            to_whole: Whole::default(),
        })));
        Ok(plan)
    }

    /// No more than is heard and moved, each island by the cheapest method within the budget.
    pub fn new(network: Arc<Network>, timeline: &Timeline, budget: &Budget) -> Result<Self, Error> {
        let mut plan = Self::empty(network.clone(), timeline);
        let (mut cells, mut isles) = (Vec::new(), Vec::new());
        for island in islands::islands(&network, timeline) {
            match (island.is_heard, island.is_moved) {
                (false, _) => plan.drop(&island, Reason::Unheard),
                (true, false) => {
                    plan.rest(&island)?;
                    plan.drop(&island, Reason::Still);
                }
                (true, true)
                    if budget.takes_modes()
                        && cells::is_loose(&network, &island, timeline.rate) =>
                {
                    cells.extend(island.mats);
                }
                (true, true) => {
                    isles.push(network.subset(&island.mats, &island.guests, &island.links));
                }
            }
        }
        if !cells.is_empty() {
            isles.push(network.subset(&cells, &[], &[]));
        }
        let n_isles = isles.len() - usize::from(!cells.is_empty());
        for (at, (subset, own)) in split::split(isles, timeline).into_iter().enumerate() {
            if at == n_isles {
                plan.cells(subset, own)?;
            } else {
                plan.island(subset, own, budget)?;
            }
        }
        Ok(plan)
    }

    /// The units in at most `most` groups of about the same cost, one after the other.
    pub(crate) fn groups(&self, most: usize) -> Vec<Range<usize>> {
        let costs: Vec<f64> = self.units.iter().map(Unit::cost).collect();
        let fair = costs.iter().sum::<f64>() / most as f64;
        let (mut groups, mut first, mut sum) = (Vec::new(), 0, 0.0);
        for (at, cost) in costs.iter().enumerate() {
            sum += cost;
            if sum >= fair && groups.len() + 1 < most {
                groups.push(first..at + 1);
                (first, sum) = (at + 1, 0.0);
            }
        }
        if first < costs.len() {
            groups.push(first..costs.len());
        }
        groups
    }

    fn empty(network: Arc<Network>, timeline: &Timeline) -> Self {
        Self {
            timeline_rate: timeline.rate,
            n_keys: timeline.keys.len(),
            n_gestures: timeline.gestures.len(),
            still: vec![0.0; network.outputs().len()],
            rows: Vec::new(),
            network,
            units: Vec::new(),
        }
    }

    /// What it does, part by part.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// An island that is not computed: counted with the others of its part.
    fn drop(&mut self, island: &Island, reason: Reason) {
        let row = Row::left_out(&self.network, island, reason);
        if row.mats + row.links == 0 {
            return; // points that hold nothing
        }
        let alike = |known: &&mut Row| known.what == row.what && known.parts == row.parts;
        match self.rows.iter_mut().find(alike) {
            Some(known) => {
                known.mats += row.mats;
                known.links += row.links;
            }
            None => self.rows.push(row),
        }
    }

    /// Add what is heard of modules that never move.
    fn rest(&mut self, island: &Island) -> Result<(), Error> {
        let subset = self
            .network
            .subset(&island.mats, &island.guests, &island.links);
        let scheme = Scheme::new(&subset.network, self.timeline_rate)?;
        let mut heard = vec![0.0; subset.outputs.len()];
        crate::island::at_rest(&subset.network, &scheme, &mut heard);
        for (&output, heard) in subset.outputs.iter().zip(heard) {
            self.still[output as usize] += heard;
        }
        Ok(())
    }

    /// Isolated CELs.
    fn cells(&mut self, subset: Subset, own: Own) -> Result<(), Error> {
        let banks = cells::oscillators(&subset, &own.timeline, &mut self.still)?;
        self.rows
            .extend(row::cells(&self.network, &banks, &own.timeline));
        self.units.extend(banks.into_iter().map(Unit::Bank));
        Ok(())
    }

    /// An island: by its modes where it has them, else stepped.
    fn island(&mut self, subset: Subset, own: Own, budget: &Budget) -> Result<(), Error> {
        let why = if budget.takes_modes() {
            match body::bank(&subset, &own.timeline, budget) {
                Ok(found) => {
                    for (&output, rest) in subset.outputs.iter().zip(&found.rest) {
                        self.still[output as usize] += rest;
                    }
                    self.rows.push(Row::modal(&subset, &found, &own.timeline));
                    self.units.push(Unit::Bank(found.bank));
                    return Ok(());
                }
                Err(why) => Some(why),
            }
        } else {
            None
        };
        self.stepped(subset, own, budget, why)
    }

    /// An island frame by frame: its linear bodies by their modes, the rest as it is written.
    fn stepped(
        &mut self,
        subset: Subset,
        own: Own,
        budget: &Budget,
        why: Option<NoModes>,
    ) -> Result<(), Error> {
        let (cut, not) = ported::cut(&subset, &own.timeline, budget);
        let mut because = why.filter(|_| cut.is_none()).or(not);
        if let Some(cut) = cut {
            match self.hub(&cut.hub.network, budget) {
                Ok(found) => return self.cut(subset, own, cut, found, budget),
                Err(_) => because = Some(NoModes::Stiff),
            }
        }
        let (steps, certificate) = self.hub(&subset.network, budget)?;
        let mut row = Row::stepped(&subset.network, &own.timeline, certificate);
        row.because = because.map(|why| why.why().to_owned());
        let mut isle = Isle {
            network: Arc::new(subset.network),
            timeline: own.timeline,
            bodies: Vec::new(),
            steps,
            to_whole: Whole {
                mats: Some(subset.mats),
                outputs: Some(subset.outputs),
                keys: Some(own.keys),
                gestures: Some(own.gestures),
            },
        };
        if steps > 1
            && let Some(found) = pilot::pilot(&isle, budget)?
        {
            (isle.steps, row.error) = (found.steps, found.error);
        }
        row.steps = isle.steps;
        self.rows.push(row);
        self.units.push(Unit::Isle(Box::new(isle)));
        Ok(())
    }

    /// How often a frame the contacts of a network are computed, and whether the rest of it is stable.
    fn hub(&self, network: &Network, budget: &Budget) -> Result<(usize, Certificate), Error> {
        let mut scheme = Scheme::new(network, self.timeline_rate)?;
        let stiffest = scheme.stiffest_contact();
        let is_discrete = network.parts().iter().any(|part| part.ca_rate.is_some());
        let steps = match stiffest {
            Some(kappa) if !is_discrete => budget.steps(kappa),
            _ => 1,
        };
        if steps > 1 {
            scheme.without_contacts();
        }
        Ok((steps, scheme.certify(network)?))
    }

    /// An island whose bodies are cut out.
    fn cut(
        &mut self,
        subset: Subset,
        own: Own,
        cut: ported::Cut,
        (steps, certificate): (usize, Certificate),
        budget: &Budget,
    ) -> Result<(), Error> {
        let ported::Cut {
            mut hub,
            own: inner,
            mut bodies,
        } = cut;
        let mut isle = Isle {
            to_whole: Whole {
                mats: Some(through(&subset.mats, &hub.mats)),
                outputs: Some(subset.outputs),
                keys: Some(through(&own.keys, &inner.keys)),
                gestures: Some(through(&own.gestures, &inner.gestures)),
            },
            network: Arc::new(hub.network.clone()),
            timeline: inner.timeline,
            bodies: bodies.iter().map(|found| found.modal.clone()).collect(),
            steps,
        };
        let mut error = None;
        if let Some(found) = pilot::pilot(&isle, budget)? {
            (isle.steps, error) = (found.steps, found.error);
            for (body, kept) in bodies.iter_mut().zip(found.kept) {
                body.left_out = kept.left_out;
                body.modal = body.modal.only(&kept.modes);
                ported::loosen(&mut hub.network, &body.modal);
            }
            isle.network = Arc::new(hub.network.clone());
            isle.bodies = bodies.iter().map(|found| found.modal.clone()).collect();
        }
        let n_ports: usize = bodies.iter().map(|body| body.modal.ports.len()).sum();
        if hub.network.n_mat() > n_ports {
            let mut row = Row::stepped(&hub.network, &isle.timeline, certificate);
            row.mats -= n_ports;
            (row.steps, row.error) = (isle.steps, error);
            self.rows.push(row);
        }
        for found in &bodies {
            let mut row = Row::ported(found, &isle.timeline);
            row.error = error;
            self.rows.push(row);
        }
        self.units.push(Unit::Isle(Box::new(isle)));
        Ok(())
    }
}

/// Two maps one after the other.
fn through(first: &[u32], second: &[u32]) -> Vec<u32> {
    second.iter().map(|&at| first[at as usize]).collect()
}
