//! Runs of one island: a run that is asked for again is not played again.

use std::cell::RefCell;
use std::rc::Rc;

use crate::assembly::unit::IslandPlan;
use crate::integrate::MeshMethod;
use crate::island::StepNumbers;
use crate::island::bodies::BodyPlan;
use crate::plan::trial::allowance::{Allowance, TrialError};
use crate::plan::trial::pilot_run::{Excerpt, PilotRun, frame_cost_seconds, play_while};

/// Most samples of sound that are kept.
const SAMPLES_MAX: usize = 1 << 24;

/// What distinguishes one way to play an island from others.
#[derive(Clone, PartialEq)]
struct RunKey {
    /// The cost of a frame, bit for bit: it differs between ways that compute outputs or events differently.
    frame_cost_bits: u64,
    steps: StepNumbers,
    bodies: Vec<BodyKey>,
}

/// How one body of an island is computed.
#[derive(Clone, PartialEq)]
struct BodyKey {
    /// The method of a mesh, and its steps a frame.
    method: Option<(MeshMethod, u32)>,
    ports: Vec<usize>,
}

/// Runs of one excerpt of an island.
pub(in crate::plan) struct RunCache {
    excerpt: Excerpt,
    stored_runs: RefCell<Vec<(RunKey, Rc<PilotRun>)>>,
}

impl RunCache {
    /// Begins without any run.
    pub(in crate::plan) fn new(excerpt: Excerpt) -> Self {
        Self {
            excerpt,
            stored_runs: RefCell::default(),
        }
    }

    /// The excerpt that the runs play.
    pub(in crate::plan) fn excerpt(&self) -> Excerpt {
        self.excerpt
    }

    fn store_run(&self, (island_plan, contact_substeps): (&IslandPlan, usize), run: &Rc<PilotRun>) {
        let mut stored_runs = self.stored_runs.borrow_mut();
        let sample_count: usize = stored_runs.iter().map(|(_, run)| run.sound.len()).sum();
        if sample_count + run.sound.len() <= SAMPLES_MAX {
            stored_runs.push((run_key(island_plan, contact_substeps), run.clone()));
        }
    }

    /// Returns the run of an island, and plays it if that has not been done.
    ///
    /// # Errors
    ///
    /// Those of [`play_while`].
    pub(in crate::plan) fn play(
        &self,
        requested_plan: (&IslandPlan, usize),
        allowance: &Allowance,
    ) -> Result<Rc<PilotRun>, TrialError> {
        let full_run = self.play_while(requested_plan, allowance, |_, _| true)?;
        Ok(full_run.unwrap_or_else(|| unreachable!("nothing ends it")))
    }

    /// The same, but stops as soon as `should_continue`, given the frames played and their sound, is false; `None` if
    /// it was stopped.
    ///
    /// # Errors
    ///
    /// Those of [`play_while`].
    pub(in crate::plan) fn play_while(
        &self,
        (island_plan, contact_substeps): (&IslandPlan, usize),
        allowance: &Allowance,
        should_continue: impl FnMut(usize, &[f64]) -> bool,
    ) -> Result<Option<Rc<PilotRun>>, TrialError> {
        let requested_key = run_key(island_plan, contact_substeps);
        let known_run =
            |played_entry: &(RunKey, Rc<PilotRun>)| (played_entry.0 == requested_key).then(|| played_entry.1.clone());
        if let Some(run) = self.stored_runs.borrow().iter().find_map(known_run) {
            return Ok(Some(run));
        }
        let requested_plan = (island_plan, contact_substeps);
        let run = play_while(requested_plan, self.excerpt, allowance, should_continue)?.map(Rc::new);
        if let Some(run) = &run {
            self.store_run(requested_plan, run);
        }
        Ok(run)
    }
}

fn run_key(island_plan: &IslandPlan, contact_substeps: usize) -> RunKey {
    let body_key = |body: &BodyPlan| BodyKey {
        method: body.mesh_method(),
        ports: body.ports(),
    };
    RunKey {
        frame_cost_bits: frame_cost_seconds(island_plan).to_bits(),
        steps: island_plan.step_numbers(contact_substeps),
        bodies: island_plan.bodies.iter().map(body_key).collect(),
    }
}
