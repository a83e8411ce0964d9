//! How a plan is made: the network is divided into islands, and each gets the cheapest method that is exact enough.
//!
//! An island that is one linear body becomes a bank of modes (`passes/body`). All other islands are stepped, as trials
//! decide.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::interrupt;
use crate::island::inside::BodyPlan;
use crate::network::{Error, LinkKind, Network, Run, Subset};
use crate::plan::budget::Budget;
use crate::plan::choice::{Choice, IslandMethod, Pins, SteppedChoice, wrong_plan_error};
use crate::plan::cost;
use crate::plan::passes::assemble::{Assembled, How};
use crate::plan::passes::audible::{Body as Found, ModeKind};
use crate::plan::passes::body;
use crate::plan::passes::cells;
use crate::plan::passes::islands::{IslandMembers, islands};
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::mesh::MethodChoice;
use crate::plan::passes::ported::{self, PortedBody as Body};
use crate::plan::passes::seen;
use crate::plan::passes::slow::RefusedSlow;
use crate::plan::passes::solved_modes::Memo;
use crate::plan::passes::split::{OwnTimeline, split};
use crate::plan::report::row::{self, Computed, Measured, Reason, Row};
use crate::plan::trial::allowance::Allowance;
use crate::plan::trial::horizon;
use crate::plan::trial::macrostep::Growth;
use crate::plan::trial::multirate;
use crate::plan::trial::pilot_result::{self, ChosenIsland};
use crate::plan::trial::record::TrialStore;
use crate::plan::{Known, Plan, Unit};
use crate::scheme::Scheme;
use crate::timeline::Timeline;

mod offers;
mod pilots;
mod unheard;

/// A plan in the making.
struct Maker<'a> {
    plan: Plan,
    budget: &'a Budget,
    pins: Pins,
    memo: Memo<'a>,
    allowance: Allowance,
    /// Results of trials of earlier plans.
    store: Option<&'a dyn TrialStore>,
    /// Parts that are displayed, and the units that are computed only for that.
    seen: &'a [String],
    seen_units: Vec<Unit>,
    /// Islands may be computed once in this many frames.
    every: u32,
    /// Parts that are only seen may be computed once in this many frames, if the rest of their island is heard.
    seen_every: u32,
}

/// How an island is computed.
struct Solved {
    chosen: ChosenIsland,
    growth: Option<Growth>,
    /// The error that its slow parts add.
    slow_error: Option<Measured>,
    refused_slow: Vec<RefusedSlow>,
    /// It has slow parts that did not ask for it: keys, or parts that are only seen.
    is_offered: bool,
}

pub(super) fn make(
    network: Arc<Network>,
    timeline: &Timeline,
    budget: &Budget,
    pins: Option<Vec<Choice>>,
    known: Known<'_>,
) -> Result<Plan, Error> {
    let all_islands = islands(&network, timeline);
    let mut maker = Maker {
        pins: Pins::new(pins),
        allowance: Allowance::new(n_computed(&all_islands), known.share),
        memo: Memo::new(known.like.map_or(&[], |like| &like.solved)),
        store: known.store,
        seen: known.seen,
        seen_every: known.seen_every,
        ..Maker::new(&network, timeline, budget)
    };
    let mut refused = Vec::new();
    let mut unheard = Vec::new();
    let (mut loose, mut island_plans, mut gliding) = (Vec::new(), Vec::new(), Vec::new());
    let glides = timeline.glides.iter().map(|glide| glide.mat as u32);
    let glides: BTreeSet<u32> = glides.collect();
    for island in all_islands {
        interrupt::poll();
        let is_gliding = |mat: &u32| glides.contains(mat);
        let is_loose = || budget.takes_modes() && cells::is_loose(&network, &island, timeline.rate);
        if !island.is_moved {
            maker.plan.unmoved.extend(&island.mats);
        }
        match (island.is_heard, island.is_moved) {
            (false, is_moved) => {
                maker.report_left_out(&island, Reason::Unheard);
                if is_moved && seen::is_seen(&network, &island, known.seen) {
                    unheard.push(island);
                }
            }
            (true, false) => {
                refused.extend(maker.add_constant(&island).err());
                maker.report_left_out(&island, Reason::Still);
            }
            (true, true) if is_loose() => loose.extend(island.mats),
            // Gliding cells are stepped as one island: one island for each would take far longer.
            (true, true) if island.links.is_empty() && island.mats.iter().all(is_gliding) => {
                gliding.extend(island.mats);
            }
            (true, true) => {
                island_plans.push(network.subset(&island.mats, &island.guests, &island.links));
            }
        }
    }
    if !gliding.is_empty() {
        island_plans.push(network.subset(&gliding, &[], &[]));
    }
    let n_islands = island_plans.len();
    if !loose.is_empty() {
        island_plans.push(network.subset(&loose, &[], &[]));
    }
    for (index, (subset, island_timeline)) in split(island_plans, timeline).into_iter().enumerate()
    {
        let unit = if index < n_islands {
            maker.island(subset, island_timeline)
        } else {
            maker.cells(&subset, &island_timeline)
        };
        if let Err(error) = unit {
            // From here no trials: there is no plan any more, but the remaining islands are checked for further errors.
            maker.allowance = Allowance::new(0, 0.0);
            refused.push(error);
        }
    }
    if let Some(refused) = Error::combined(refused) {
        return Err(refused);
    }
    maker.pins.end()?;
    maker.plan.solved = maker.memo.into_solved();
    (maker.plan.trials_cost, maker.plan.trials_most) = maker.allowance.spent();
    let (mut plan, seen_units) = (maker.plan, maker.seen_units);
    plan.n_heard = plan.units.len();
    plan.unmoved.sort_unstable();
    if !unheard.is_empty() {
        let seen = unheard::plan(&network, timeline, budget, known, unheard)?;
        plan.units.extend(seen.units);
        plan.seen = seen.rows;
    }
    plan.units.extend(seen_units);
    Ok(plan)
}

/// Modules that are computed because they are heard: those that nothing plays leave the trials as they are.
fn n_computed(islands: &[IslandMembers]) -> usize {
    let computed = islands
        .iter()
        .filter(|island| island.is_heard && island.is_moved);
    computed
        .map(|island| island.mats.len() + island.links.len())
        .sum()
}

impl<'a> Maker<'a> {
    /// A maker that has no allowance for trials and no earlier results.
    fn new(network: &Arc<Network>, timeline: &Timeline, budget: &'a Budget) -> Self {
        Self {
            plan: Plan::empty(network.clone(), timeline),
            budget,
            pins: Pins::new(None),
            allowance: Allowance::new(0, 0.0),
            memo: Memo::new(&[]),
            store: None,
            seen: &[],
            seen_units: Vec::new(),
            every: 1,
            seen_every: 1,
        }
    }

    /// Reports an island that is not computed, in one row with others of its part.
    fn report_left_out(&mut self, island: &IslandMembers, reason: Reason) {
        let row = Row::left_out(&self.plan.network, island, reason);
        if row.mats + row.links == 0 {
            return; // points that hold nothing
        }
        let alike = |known: &&mut Row| known.what == row.what && known.parts == row.parts;
        match self.plan.rows.iter_mut().find(alike) {
            Some(known) => {
                known.mats += row.mats;
                known.links += row.links;
            }
            None => self.plan.rows.push(row),
        }
    }

    /// Adds what outputs hear of modules that never move.
    fn add_constant(&mut self, island: &IslandMembers) -> Result<(), Error> {
        let subset = self
            .plan
            .network
            .subset(&island.mats, &island.guests, &island.links);
        let scheme = Scheme::new(&subset.network, self.plan.timeline_rate)?;
        let mut levels = vec![0.0; subset.outputs.len()];
        crate::island::outputs_at_rest(&subset.network, &scheme, &mut levels);
        for (&output, levels) in subset.outputs.iter().zip(levels) {
            self.plan.still[output as usize] += levels;
        }
        Ok(())
    }

    /// Isolated CELs.
    fn cells(&mut self, subset: &Subset, island_timeline: &OwnTimeline) -> Result<(), Error> {
        let banks = cells::oscillators(subset, &island_timeline.timeline, &mut self.plan.still)?;
        let mut rows = row::cells(&self.plan.network, &banks, &island_timeline.timeline);
        let refused_slow = multirate::refuse_all(subset, "its poles need none");
        rows.iter_mut()
            .for_each(|row| row.stays = stay_reasons(&refused_slow, row));
        self.plan.rows.extend(rows);
        self.plan.stay.extend(refused_slow);
        self.plan.units.extend(banks.into_iter().map(Unit::Bank));
        Ok(())
    }

    /// Plans an island: as a bank of modes if it has them, else stepped.
    fn island(&mut self, subset: Subset, island_timeline: OwnTimeline) -> Result<(), Error> {
        self.memo.begin();
        let modules = subset.network.n_mat() + subset.network.n_lia();
        let pin = self.pins.next(modules)?;
        let (pinned_modes, pinned_steps) = match pin.as_ref().map(|pin| &pin.method) {
            None => (None, None),
            Some(IslandMethod::Bank(modes)) => (Some(&modes[..]), None),
            Some(IslandMethod::Stepped(stepped)) => (None, Some(stepped)),
        };
        let mut why = None;
        if self.budget.takes_modes() && pinned_steps.is_none() {
            let bank = body::bank(
                &subset,
                &island_timeline.timeline,
                self.budget,
                pinned_modes,
                &self.memo,
            );
            self.allowance.spend(self.memo.take_work());
            match bank {
                Ok(mut solved_bank) => {
                    label_bank(&mut solved_bank, &subset, &island_timeline);
                    self.seen_units.extend(self.silent_modes(
                        &subset,
                        &island_timeline,
                        &solved_bank.bank.computed_modes,
                    ));
                    for (&output, rest) in subset.outputs.iter().zip(&solved_bank.rest) {
                        self.plan.still[output as usize] += rest;
                    }
                    self.plan.choices.push(Choice {
                        modules,
                        method: IslandMethod::Bank(solved_bank.computed.numbers()),
                    });
                    let mut row = Row::modal(&subset, &solved_bank, &island_timeline.timeline);
                    let refused_slow = multirate::refuse_all(&subset, "its modes need none");
                    row.stays = stay_reasons(&refused_slow, &row);
                    self.plan.stay.extend(refused_slow);
                    self.plan.rows.push(row);
                    self.plan.units.push(Unit::Bank(solved_bank.bank));
                    return Ok(());
                }
                Err(reason) => why = Some(reason),
            }
        }
        if pinned_modes.is_some() {
            return Err(wrong_plan_error());
        }
        if self.every > 1 {
            return self.plan_at_lower_rate(&subset, &island_timeline, modules, why);
        }
        self.stepped(&subset, &island_timeline, modules, pinned_steps, why)
    }

    /// If the body is displayed: a bank of its moving modes that no output hears.
    fn silent_modes(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        listened: &[u32],
    ) -> Option<Unit> {
        if !seen::is_any(&subset.network.moving_parts(), self.seen) {
            return None;
        }
        let probed = seen::with_probe_output(subset.clone(), &subset.mats).ok()?;
        let memo = Memo::new(&[]);
        let bank =
            |kept| body::bank(&probed, &island_timeline.timeline, self.budget, kept, &memo).ok();
        let mut silent = bank(None)?.computed.numbers();
        silent.retain(|mode| listened.binary_search(mode).is_err());
        if silent.is_empty() {
            return None;
        }
        let mut solved_bank = bank(Some(&silent))?;
        label_bank(&mut solved_bank, subset, island_timeline);
        Some(Unit::Bank(solved_bank.bank))
    }

    /// Plans an island that is stepped: bodies by methods of their own, the rest module by module, at the oversampling
    /// that the budget asks for.
    fn stepped(
        &mut self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        modules: usize,
        pin: Option<&SteppedChoice>,
        why: Option<NoModes>,
    ) -> Result<(), Error> {
        ported::check_supported(&subset.network, &island_timeline.timeline, self.budget)?;
        let n_refused = self.allowance.n_refused();
        let solved = match self.solve(subset, island_timeline, pin) {
            Ok(solved) if pin.is_none() => {
                let solved = self.without_rates(subset, island_timeline, solved);
                self.offered(subset, island_timeline, solved)
            }
            Err(error) => match pin.and_then(|pin| self.pinned_offer(subset, island_timeline, pin))
            {
                Some(solved) => solved,
                None => return Err(error),
            },
            Ok(solved) => solved,
        };
        let Solved {
            chosen:
                ChosenIsland {
                    island,
                    error,
                    diverges,
                },
            growth,
            slow_error,
            refused_slow,
            is_offered,
            ..
        } = solved;
        check_method(self.budget, subset, &island)?;
        let first_row = self.plan.rows.len();
        let harder_at = error.and_then(|error| {
            horizon::harder_event(&island.island_plan, &island_timeline.timeline, error.over)
        });
        let Assembled {
            island_plan,
            bodies,
            certificate,
            because,
            ..
        } = island;
        self.plan.choices.push(Choice {
            modules,
            method: IslandMethod::Stepped(SteppedChoice {
                oversampling: island_plan.oversampling,
                contact_substeps: island_plan.contact_substeps,
                counted_cost: island_plan.counted_cost,
                bodies: bodies.iter().map(Body::choice).collect(),
            }),
        });
        let n_ports: usize = bodies.iter().map(|body| body.inside.ports().len()).sum();
        if island_plan.network.n_mat() > n_ports {
            let mut row = Row::stepped(&island_plan, certificate);
            row.mats -= n_ports;
            (row.oversampling, row.contact_substeps, row.error) = (
                island_plan.oversampling,
                island_plan.contact_substeps,
                error,
            );
            let because = why.filter(|_| bodies.is_empty()).or(because);
            row.because = because.map(|why| why.why().to_owned());
            self.plan.rows.push(row);
        }
        // The cost of the rest beside bodies has a row of its own, or is added to the row of the first body.
        let mut hub = if self.plan.rows.len() == first_row {
            cost::seconds(island_plan.hub_cost(), &island_plan.timeline)
        } else {
            0.0
        };
        for body in &bodies {
            let mut row = Row::ported(body, &island_plan.timeline);
            row.cost += std::mem::take(&mut hub);
            (row.oversampling, row.error) = (island_plan.oversampling, error);
            if let (Computed::Slow { .. }, Some(growth)) = (row.what, growth) {
                row.error = slow_error;
                row.word = Some(multirate::guarantee(growth, certificate.word));
                row.radius = (growth.radius > 0.0).then_some(growth.radius);
                row.is_offered = is_offered;
            }
            self.plan.rows.push(row);
        }
        let is_cut_short = self.allowance.n_refused() > n_refused;
        for row in &mut self.plan.rows[first_row..] {
            row.is_cut_short = is_cut_short;
            row.diverges = diverges;
            row.harder_at = harder_at;
            row.stays = stay_reasons(&refused_slow, row);
        }
        self.plan.stay.extend(refused_slow);
        self.plan
            .units
            .push(Unit::IslandPlan(Box::new(island_plan)));
        Ok(())
    }

    /// Decides how an island is computed, with those of its slow parts slow that may be.
    fn solve(
        &self,
        subset: &Subset,
        island_timeline: &OwnTimeline,
        pin: Option<&SteppedChoice>,
    ) -> Result<Solved, Error> {
        let (mut subset, mut refused_slow) =
            multirate::settle(subset, island_timeline, self.budget);
        let (solved, growth) = loop {
            let assemble = |how: How<'_>| {
                let island =
                    Assembled::new(&subset, island_timeline, self.budget, how, pin, &self.memo);
                self.allowance.spend(self.memo.take_work());
                island
            };
            // An island that is unstable at once is not worth a pilot.
            let has_slow_parts = subset.network.has_slow_parts();
            let judged = has_slow_parts.then(|| assemble(How::fine(1, MethodChoice::ByBudget)));
            let mut judged = match judged {
                Some(Ok(island)) => multirate::certify(&island, &self.allowance),
                _ => Ok(None),
            };
            if judged.is_ok() {
                let solved = match pin {
                    Some(pin) => pilot_result::pinned(
                        assemble(How::fine(pin.oversampling, MethodChoice::ByBudget))?,
                        pin,
                    )
                    .ok_or_else(wrong_plan_error)?,
                    None => self.choose_by_pilot(&subset, island_timeline, &assemble)?,
                };
                // At a higher oversampling the island has to be certified again.
                if solved.island.island_plan.oversampling > 1 {
                    judged = multirate::certify(&solved.island, &self.allowance);
                }
                if let Ok(growth) = judged {
                    break (solved, growth);
                }
            }
            if let Err(why) = judged {
                let more = multirate::refuse_all(&subset, &why);
                subset = multirate::without_slow(&subset, &more);
                refused_slow.extend(more);
            }
        };
        let slow_error = match growth {
            Some(_) if pin.is_none() && !island_timeline.timeline.is_open => {
                let known = (&self.memo, &self.allowance, self.store);
                multirate::error(&subset, island_timeline, self.budget, &solved.island, known)?
            }
            _ => None,
        };
        Ok(Solved {
            chosen: solved,
            growth,
            slow_error,
            refused_slow,
            is_offered: false,
        })
    }
}

/// Notes on a bank which body it is of, and which of its modes.
fn label_bank(solved_bank: &mut Found, subset: &Subset, island_timeline: &OwnTimeline) {
    solved_bank.bank.is_open = island_timeline.timeline.is_open;
    solved_bank.bank.computed_modes = solved_bank.computed.numbers();
    // A takeover needs normal modes.
    let is_normal = solved_bank.kind == ModeKind::Normal;
    solved_bank.bank.body = is_normal.then(|| Arc::new(subset.network.clone()));
}

/// Refuses an island with a law that the method asked for by name would leave to CA.
fn check_method(budget: &Budget, subset: &Subset, island: &Assembled) -> Result<(), Error> {
    let Budget::Method(method) = budget else {
        return Ok(());
    };
    let is_mesh = |body: &BodyPlan| matches!(body, BodyPlan::Mesh(_));
    let law = |run: &&Run| {
        matches!(
            run.kind,
            LinkKind::Lnl(_)
                | LinkKind::Followed(_)
                | LinkKind::Bristle(_)
                | LinkKind::Dry(_)
                | LinkKind::Space(_)
                | LinkKind::Pairwise(_)
        )
    };
    let law_run = subset.network.runs().iter().find(law);
    match (method.mesh_method(), law_run) {
        (Some(mesh_method), Some(run)) if !island.island_plan.bodies.iter().any(is_mesh) => {
            Err(Error::Refused {
                module: subset.network.link_name(run.first),
                message: format!(
                    "the method {} cannot compute this link: an output hears its force, it ends on a key or a driven \
                     mass, or the method lacks its law; write `method: ca`, or an `error` such as -60dB instead",
                    mesh_method.facts().name
                ),
            })
        }
        _ => Ok(()),
    }
}

/// Why parts of a row that ask for a rate of their own are computed at every frame.
fn stay_reasons(refused_slow: &[RefusedSlow], row: &Row) -> Option<String> {
    let ours = refused_slow
        .iter()
        .filter(|(part, _)| row.parts.contains(part));
    let all: Vec<String> = ours.map(|(part, why)| format!("{part}: {why}")).collect();
    (!all.is_empty()).then(|| all.join("; "))
}
