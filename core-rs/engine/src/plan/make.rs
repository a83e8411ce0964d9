//! How a plan is made: the network is divided into islands, and each gets the cheapest method that is exact enough.
//!
//! An island that is one linear body becomes a bank of modes (`assembly/body`). All other islands are stepped, as
//! trials decide.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::audible::{BankBody as SolvedBank, ModeKind};
use crate::assembly::body;
use crate::assembly::budget::Budget;
use crate::assembly::cells;
use crate::assembly::choice::{Choice, IslandMethod, PinnedChoices, SteppedChoice, wrong_plan_error};
use crate::assembly::cost;
use crate::assembly::islands::islands;
use crate::assembly::mesh::MethodChoice;
use crate::assembly::ported::{self, PortedBody};
use crate::assembly::seen;
use crate::assembly::slow::RefusedSlowPart;
use crate::assembly::slow::growth::Growth;
use crate::assembly::solved_modes::{ModeCache, ModeStore};
use crate::assembly::split::{LocalTimeline, split};
use crate::assembly::unit::ComputationUnit;
use crate::body_modes::linear::NoModes;
use crate::island::bodies::BodyPlan;
use crate::network::{Error, LinkKind, Network, Run, Subset};
use crate::plan::constants::ISLAND_ALLOWANCE_SHARE_MIN;
use crate::plan::row::{self, Computation, MeasuredError, PlanRow};
use crate::plan::trial::allowance::{Allowance, allowance_of_plan};
use crate::plan::trial::horizon;
use crate::plan::trial::multirate;
use crate::plan::trial::pilot_result::{self, ChosenIsland};
use crate::plan::trial::record::TrialStore;
use crate::plan::trial::stored_modes::StoredModes;
use crate::plan::{Plan, PlanContext};
use crate::timeline::Timeline;

mod drafts;
mod offers;
mod pilots;
mod session_trials;
mod sort_islands;
mod unheard;

pub(in crate::plan) use session_trials::SessionTrial;
use sort_islands::{n_heard_modules, subset_size};

/// A plan in the making.
struct PlanBuilder<'a> {
    plan: Plan,
    budget: &'a Budget,
    pins: PinnedChoices,
    mode_cache: ModeCache<'a>,
    /// The work that the trials of all islands may take [s], and what is left of it.
    trial_seconds_max: f64,
    trial_seconds_left: f64,
    /// The part of an allowance that trials may take (0 to 1).
    allowance_share: f64,
    /// That of the present island.
    allowance: Allowance,
    /// Results of trials of earlier plans.
    trial_store: Option<&'a dyn TrialStore>,
    /// What trials of islands of a session decided, for an earlier plan and for this one.
    earlier_trials: &'a [SessionTrial],
    session_trials: RefCell<Vec<SessionTrial>>,
    /// Work that those of this plan took [s].
    session_trial_seconds: Cell<f64>,
    /// The budget of islands that no earlier plan has planned, if they are drafted.
    draft_budget: Option<&'a Budget>,
    /// Parts that are displayed, and the units that are computed only for that.
    displayed_parts: &'a [String],
    displayed_units: Vec<ComputationUnit>,
    /// Islands may be computed once in this many frames.
    frame_interval: u32,
    /// Parts that are only seen may be computed once in this many frames, if the rest of their island is heard.
    displayed_frame_interval: u32,
}

/// How an island is computed.
struct PlannedIsland {
    chosen_island: ChosenIsland,
    slow_growth: Option<Growth>,
    /// The error that its slow parts add.
    slow_error: Option<MeasuredError>,
    refused_slow_parts: Vec<RefusedSlowPart>,
    /// It has slow parts that did not ask for it: keys, or parts that are only seen.
    is_slow_by_plan: bool,
}

pub(super) fn make_plan(
    network: Arc<Network>,
    timeline: &Timeline,
    budget: &Budget,
    pins: Option<Vec<Choice>>,
    context: PlanContext<'_>,
) -> Result<Plan, Error> {
    let all_islands = islands(&network, timeline);
    let mode_store = context.trial_store.map(StoredModes);
    let mut builder = PlanBuilder {
        pins: PinnedChoices::new(pins),
        mode_cache: ModeCache::new(context.earlier_plan.map(|earlier_plan| &earlier_plan.solved_modes))
            .with_store(mode_store.as_ref().map(|store| store as &dyn ModeStore)),
        ..PlanBuilder::new(&network, timeline, budget).in_context(context, n_heard_modules(&all_islands))
    };
    let sorted_islands = builder.sort_islands(all_islands, timeline);
    let refusals = builder.plan_islands(
        sorted_islands.refusals,
        (sorted_islands.subsets, sorted_islands.n_islands),
        timeline,
    );
    if let Some(refusals) = Error::combined(refusals) {
        return Err(refusals);
    }
    builder.pins.check_all_used()?;
    builder.plan.session_trials = builder.take_session_trials();
    builder.plan.solved_modes = builder.mode_cache.into_solved();
    (builder.plan.trial_seconds, builder.plan.trial_seconds_max) = (
        builder.trial_seconds_max - builder.trial_seconds_left,
        builder.trial_seconds_max,
    );
    let (mut final_plan, displayed_units) = (builder.plan, builder.displayed_units);
    final_plan.n_heard_units = final_plan.units.len();
    final_plan.motionless_mats.sort_unstable();
    if !sorted_islands.displayed_unheard.is_empty() {
        let displayed_plan =
            unheard::plan_displayed_islands(&network, timeline, budget, context, sorted_islands.displayed_unheard)?;
        final_plan.units.extend(displayed_plan.units);
        final_plan.displayed_rows = displayed_plan.rows;
    }
    final_plan.units.extend(displayed_units);
    Ok(final_plan)
}

impl<'a> PlanBuilder<'a> {
    /// A builder that has no allowance for trials and no earlier results.
    fn new(network: &Arc<Network>, timeline: &Timeline, budget: &'a Budget) -> Self {
        Self {
            plan: Plan::empty(network.clone(), timeline),
            budget,
            pins: PinnedChoices::new(None),
            trial_seconds_max: 0.0,
            trial_seconds_left: 0.0,
            allowance_share: 1.0,
            allowance: Allowance::with_seconds(0.0),
            mode_cache: ModeCache::new(None),
            trial_store: None,
            earlier_trials: &[],
            session_trials: RefCell::default(),
            session_trial_seconds: Cell::default(),
            draft_budget: None,
            displayed_parts: &[],
            displayed_units: Vec::new(),
            frame_interval: 1,
            displayed_frame_interval: 1,
        }
    }

    /// The same with what is known, and with its share of the allowance of a plan of `n_modules`.
    fn in_context(self, context: PlanContext<'a>, n_modules: usize) -> Self {
        let allowance_share = context
            .draft
            .map_or(context.allowance_share, |draft| draft.allowance_share);
        let work_max = allowance_of_plan(n_modules, allowance_share);
        Self {
            allowance_share,
            trial_seconds_max: work_max,
            trial_seconds_left: work_max,
            draft_budget: context.draft.map(|draft| draft.budget),
            trial_store: context.trial_store,
            earlier_trials: context
                .earlier_plan
                .map_or(&[], |earlier_plan| &earlier_plan.session_trials),
            displayed_parts: context.displayed_parts,
            displayed_frame_interval: context.displayed_frame_interval,
            ..self
        }
    }

    /// Plans islands; returns their errors after those in `errors`.
    fn plan_islands(
        &mut self,
        mut errors: Vec<Error>,
        (subsets, n_islands): (Vec<Subset>, usize),
        timeline: &Timeline,
    ) -> Vec<Error> {
        let n_modules = subsets[..n_islands].iter().map(subset_size).sum();
        for (index, (subset, island_timeline)) in split(subsets, timeline).into_iter().enumerate() {
            let unit_result = if index < n_islands {
                match timeline.is_open {
                    true => self.begin_session_allowance(subset_size(&subset)),
                    false => self.begin_allowance(subset_size(&subset), n_modules),
                }
                let island_result = self.island_from_store(subset, island_timeline);
                self.trial_seconds_left -= self.allowance.spent_seconds();
                island_result
            } else {
                self.plan_cells(&subset, &island_timeline)
            };
            if let Err(error) = unit_result {
                // From here no trials: there is no plan any more, but the remaining islands are checked for further
                // errors.
                self.trial_seconds_left = 0.0;
                errors.push(error);
            }
        }
        errors
    }

    /// Gives an island its part of the plan's allowance: one that is hard to plan leaves enough to the others. What it
    /// gets depends on no other island, as long as the plan's allowance is not spent.
    fn begin_allowance(&mut self, n_modules: usize, n_total: usize) {
        let size_share = n_modules as f64 / n_total as f64;
        let island_work = self.trial_seconds_max * size_share.max(ISLAND_ALLOWANCE_SHARE_MIN);
        self.allowance = Allowance::with_seconds(island_work.min(self.trial_seconds_left));
    }

    /// Isolated CELs.
    fn plan_cells(&mut self, subset: &Subset, island_timeline: &LocalTimeline) -> Result<(), Error> {
        let cell_banks = cells::oscillator_banks(subset, &island_timeline.timeline, &mut self.plan.output_offsets)?;
        let mut cell_rows = row::cells(&self.plan.network, &cell_banks, &island_timeline.timeline);
        let refused_slow = multirate::refuse_all(subset, "its poles need none");
        cell_rows
            .iter_mut()
            .for_each(|row| row.rate_refusal = rate_refusals(&refused_slow, row));
        self.plan.rows.extend(cell_rows);
        self.plan.refused_rates.extend(refused_slow);
        self.plan
            .units
            .extend(cell_banks.into_iter().map(ComputationUnit::Bank));
        Ok(())
    }

    /// Plans an island: as a bank of modes if it has them, else stepped.
    fn plan_island(&mut self, subset: Subset, island_timeline: LocalTimeline) -> Result<(), Error> {
        self.mode_cache.begin_island();
        let module_count = subset_size(&subset);
        let island_pin = self.pins.next_for_island(module_count)?;
        let (pinned_modes, pinned_steps) = match island_pin.as_ref().map(|island_pin| &island_pin.method) {
            None => (None, None),
            Some(IslandMethod::Bank(modes)) => (Some(&modes[..]), None),
            Some(IslandMethod::Stepped(stepped)) => (None, Some(stepped)),
        };
        let mut modes_refusal = None;
        if self.budget.allows_modes() && pinned_steps.is_none() {
            let bank_result = body::bank(
                &subset,
                &island_timeline.timeline,
                self.budget,
                pinned_modes,
                &self.mode_cache,
            );
            self.allowance.spend_unchecked(self.mode_cache.take_seconds());
            match bank_result {
                Ok(mut solved_bank) => {
                    set_bank_origin(&mut solved_bank, &subset, &island_timeline);
                    self.displayed_units.extend(self.unheard_modes_bank(
                        &subset,
                        &island_timeline,
                        &solved_bank.bank.computed_modes,
                    ));
                    for (&output, rest) in subset.outputs.iter().zip(&solved_bank.rest_outputs) {
                        self.plan.output_offsets[output as usize] += rest;
                    }
                    self.plan.choices.push(Choice {
                        n_modules: module_count,
                        method: IslandMethod::Bank(solved_bank.computed_modes.numbers()),
                    });
                    let mut bank_row = PlanRow::modal(&subset, &solved_bank, &island_timeline.timeline);
                    let refused_slow = multirate::refuse_all(&subset, "its modes need none");
                    bank_row.rate_refusal = rate_refusals(&refused_slow, &bank_row);
                    self.plan.refused_rates.extend(refused_slow);
                    self.plan.rows.push(bank_row);
                    self.plan.units.push(ComputationUnit::Bank(solved_bank.bank));
                    return Ok(());
                }
                Err(reason) => modes_refusal = Some(reason),
            }
        }
        if pinned_modes.is_some() {
            return Err(wrong_plan_error());
        }
        if self.frame_interval > 1 {
            return self.plan_at_lower_rate(&subset, &island_timeline, module_count, modes_refusal);
        }
        self.plan_stepped(&subset, &island_timeline, module_count, pinned_steps, modes_refusal)
    }

    /// If the body is displayed: a bank of its moving modes that no output hears.
    fn unheard_modes_bank(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        computed_modes: &[u32],
    ) -> Option<ComputationUnit> {
        if !seen::has_displayed_part(&subset.network.moving_parts(), self.displayed_parts) {
            return None;
        }
        let probed_subset = seen::with_probe_output(subset.clone(), &subset.mats).ok()?;
        let empty_cache = ModeCache::new(None);
        let solve_bank = |chosen_modes| {
            body::bank(
                &probed_subset,
                &island_timeline.timeline,
                self.budget,
                chosen_modes,
                &empty_cache,
            )
            .ok()
        };
        let mut silent_numbers = solve_bank(None)?.computed_modes.numbers();
        silent_numbers.retain(|mode| computed_modes.binary_search(mode).is_err());
        if silent_numbers.is_empty() {
            return None;
        }
        let mut solved_bank = solve_bank(Some(&silent_numbers))?;
        set_bank_origin(&mut solved_bank, subset, island_timeline);
        Some(ComputationUnit::Bank(solved_bank.bank))
    }

    /// Plans an island that is stepped: bodies by methods of their own, the rest module by module, at the oversampling
    /// that the budget asks for.
    fn plan_stepped(
        &mut self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        module_count: usize,
        earlier_choice: Option<&SteppedChoice>,
        earlier_refusal: Option<NoModes>,
    ) -> Result<(), Error> {
        ported::check_supported(&subset.network, &island_timeline.timeline, self.budget)?;
        let n_refused = self.allowance.n_refused_trials();
        let planned_island = match self.choose_stepping(subset, island_timeline, earlier_choice) {
            Ok(planned_island) if earlier_choice.is_none() => {
                let planned_island = self.drop_unhelpful_rates(subset, island_timeline, planned_island);
                self.offer_slow_parts(subset, island_timeline, planned_island)
            }
            Err(error) => match earlier_choice.and_then(|pin| self.planned_by_pin(subset, island_timeline, pin)) {
                Some(planned_island) => planned_island,
                None => return Err(error),
            },
            Ok(planned_island) => planned_island,
        };
        let PlannedIsland {
            chosen_island:
                ChosenIsland {
                    island,
                    measured_error: error,
                    has_diverged,
                },
            slow_growth: growth,
            slow_error,
            refused_slow_parts: refused_slow,
            is_slow_by_plan,
            ..
        } = planned_island;
        check_method(self.budget, subset, &island)?;
        let is_discrete_reference = island.is_discrete_reference();
        let first_row = self.plan.rows.len();
        let (plan, timeline) = (&island.island_plan, &island_timeline.timeline);
        let harder_time = error.and_then(|error| horizon::harder_event_time(plan, timeline, error.duration_seconds));
        let unchecked_from_seconds = error.and_then(|error| horizon::unchecked_from(&island.island_plan, error));
        let Assembled {
            island_plan,
            bodies,
            certificate,
            modes_refusal,
            ..
        } = island;
        self.plan.choices.push(Choice {
            n_modules: module_count,
            method: IslandMethod::Stepped(SteppedChoice {
                oversampling: island_plan.oversampling,
                contact_substeps: island_plan.contact_substeps,
                contact_order: island_plan.contact_order,
                counted_cost: island_plan.counted_cost,
                bodies: bodies.iter().map(PortedBody::choice).collect(),
            }),
        });
        let port_count: usize = bodies.iter().map(|body| body.plan.ports().len()).sum();
        if island_plan.network.n_mat() > port_count {
            let mut report_row = PlanRow::stepped(&island_plan, certificate);
            report_row.n_mats -= port_count;
            (report_row.oversampling, report_row.error) = (island_plan.oversampling, error);
            let modes_refusal = earlier_refusal.filter(|_| bodies.is_empty()).or(modes_refusal);
            report_row.modes_refusal = modes_refusal.map(|no_modes| no_modes.as_str().to_owned());
            self.plan.rows.push(report_row);
        }
        // The cost of the rest beside bodies has a row of its own, or is added to the row of the first body.
        let mut hub_cost = if self.plan.rows.len() == first_row {
            cost::work_per_second(island_plan.hub_step_ns(), &island_plan.timeline)
        } else {
            0.0
        };
        for body in &bodies {
            let mut report_row = PlanRow::ported(body, &island_plan.timeline);
            report_row.work_per_second += std::mem::take(&mut hub_cost);
            (report_row.oversampling, report_row.error) = (island_plan.oversampling, error);
            if let (Computation::Slow { .. }, Some(growth)) = (report_row.computation, growth) {
                report_row.error = slow_error;
                report_row.stability = Some(multirate::stability_with_growth(growth, certificate.guarantee));
                report_row.kick_growth_factor = (growth.growth_per_kick > 0.0).then_some(growth.growth_per_kick);
                report_row.is_slow_by_plan = is_slow_by_plan;
            }
            self.plan.rows.push(report_row);
        }
        let is_cut_short = self.allowance.n_refused_trials() > n_refused;
        for report_row in &mut self.plan.rows[first_row..] {
            report_row.is_discrete_reference = is_discrete_reference;
            report_row.trials_cut_short = is_cut_short;
            report_row.has_diverged = has_diverged;
            report_row.harder_event_time = harder_time;
            report_row.unchecked_from_seconds = unchecked_from_seconds;
            report_row.rate_refusal = rate_refusals(&refused_slow, report_row);
        }
        self.plan.refused_rates.extend(refused_slow);
        self.plan.units.push(ComputationUnit::IslandPlan(Box::new(island_plan)));
        Ok(())
    }

    /// An island assembled within the budget; the work of solving its bodies is taken from the allowance.
    fn assemble_island(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        options: AssemblyOptions<'_>,
        pin: Option<&SteppedChoice>,
    ) -> Result<Assembled, Error> {
        let island = Assembled::new(subset, island_timeline, self.budget, options, pin, &self.mode_cache);
        self.allowance.spend_unchecked(self.mode_cache.take_seconds());
        island
    }

    /// Decides how an island is computed, with those of its slow parts slow that may be.
    fn choose_stepping(
        &self,
        subset: &Subset,
        island_timeline: &LocalTimeline,
        pin: Option<&SteppedChoice>,
    ) -> Result<PlannedIsland, Error> {
        let (mut subset, mut refused_slow) = multirate::without_refused_slow(subset, island_timeline, self.budget);
        let (chosen_island, growth) = loop {
            let assemble = |options: AssemblyOptions<'_>| self.assemble_island(&subset, island_timeline, options, pin);
            // An island that is unstable at once is not worth a pilot.
            let has_slow_parts = subset.network.has_slow_parts();
            let first_assembly =
                has_slow_parts.then(|| assemble(AssemblyOptions::between_steps(1, MethodChoice::ByBudget)));
            let mut growth_result = match first_assembly {
                Some(Ok(island)) => multirate::certify_growth(&island, &self.allowance),
                _ => Ok(None),
            };
            if growth_result.is_ok() {
                let chosen_island = match pin {
                    Some(pin) => pilot_result::with_earlier_choice(
                        assemble(AssemblyOptions::between_steps(pin.oversampling, MethodChoice::ByBudget))?,
                        pin,
                    )
                    .ok_or_else(wrong_plan_error)?,
                    None if island_timeline.timeline.is_open && !matches!(self.budget, Budget::Method(_)) => {
                        self.choose_for_session(&subset, island_timeline, &assemble)?
                    }
                    None => self.choose_by_pilot(&subset, island_timeline, &assemble)?,
                };
                // At a higher oversampling the island has to be certified again.
                if chosen_island.island.island_plan.oversampling > 1 {
                    growth_result = multirate::certify_growth(&chosen_island.island, &self.allowance);
                }
                if let Ok(growth) = growth_result {
                    break (chosen_island, growth);
                }
            }
            if let Err(slow_reason) = growth_result {
                let newly_refused = multirate::refuse_all(&subset, &slow_reason);
                subset = multirate::without_slow(&subset, &newly_refused);
                refused_slow.extend(newly_refused);
            }
        };
        let slow_error = match growth {
            Some(_) if pin.is_none() && !island_timeline.timeline.is_open => {
                let trial_context = (&self.mode_cache, &self.allowance, self.trial_store);
                multirate::slow_error(
                    &subset,
                    island_timeline,
                    self.budget,
                    &chosen_island.island,
                    trial_context,
                )?
            }
            _ => None,
        };
        Ok(PlannedIsland {
            chosen_island,
            slow_growth: growth,
            slow_error,
            refused_slow_parts: refused_slow,
            is_slow_by_plan: false,
        })
    }
}

/// Notes on a bank which body it is of, and which of its modes.
fn set_bank_origin(solved_bank: &mut SolvedBank, subset: &Subset, island_timeline: &LocalTimeline) {
    solved_bank.bank.is_open = island_timeline.timeline.is_open;
    solved_bank.bank.computed_modes = solved_bank.computed_modes.numbers();
    // A takeover needs normal modes.
    let is_normal = solved_bank.kind == ModeKind::Normal;
    solved_bank.bank.body = is_normal.then(|| Arc::new(subset.network.clone()));
}

/// Refuses an island with a law that the method asked for by name would leave to CA.
fn check_method(budget: &Budget, subset: &Subset, island: &Assembled) -> Result<(), Error> {
    let Budget::Method(method) = budget else {
        return Ok(());
    };
    let is_mesh_body = |body: &BodyPlan| matches!(body, BodyPlan::Mesh(_));
    let is_law_link = |run: &&Run| {
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
    let law_run = subset.network.runs().iter().find(is_law_link);
    match (method.mesh_method(), law_run) {
        (Some(mesh_method), Some(run)) if !island.island_plan.bodies.iter().any(is_mesh_body) => Err(Error::Refused {
            module: subset.network.link_name(run.first),
            message: format!(
                "the method {} cannot compute this link: an output hears its force, it ends on a key or a driven \
                     mass, or the method lacks its law; write `method: ca`, or an `error` such as -60dB instead",
                mesh_method.properties().name
            ),
        }),
        _ => Ok(()),
    }
}

/// Why parts of a row that ask for a rate of their own are computed at every frame.
fn rate_refusals(refused_slow: &[RefusedSlowPart], row: &PlanRow) -> Option<String> {
    let row_refusals = refused_slow.iter().filter(|(part, _)| row.parts.contains(part));
    let reason_texts: Vec<String> = row_refusals.map(|(part, reason)| format!("{part}: {reason}")).collect();
    (!reason_texts.is_empty()).then(|| reason_texts.join("; "))
}
