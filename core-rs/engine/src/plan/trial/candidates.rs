//! The table of candidates to compute an island: methods of its bodies, steps a frame, and how finely contacts and laws
//! are computed. A candidate is assembled only if it is stable.

use crate::assembly::assemble::{Assembled, AssemblyOptions};
use crate::assembly::constants::SUBSTEPS_MAX;
use crate::assembly::mesh::MethodChoice;
use crate::integrate::MeshMethod;
use crate::island::FINE_SUBSTEPS_MIN;
use crate::network::Error;
use crate::plan::constants::OVERSAMPLING_MAX;
use crate::plan::trial::allowance::Allowance;
use crate::plan::trial::pilot_run::PilotRun;

/// Methods of meshes, each with its steps a frame.
const MESH_METHODS: [(MeshMethod, u32); 6] = [
    (MeshMethod::Ca2p, 1),
    (MeshMethod::Ca2p, 2),
    (MeshMethod::Ca2p, 4),
    (MeshMethod::Bm4, 1),
    (MeshMethod::Bm4, 2),
    (MeshMethod::Bm4, 4),
];

/// How many numbers of steps a frame candidates have: 1, 2, 4 … `OVERSAMPLING_MAX`.
const STEP_CHOICES: usize = OVERSAMPLING_MAX.ilog2() as usize + 1;

/// Which cost of an island counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::plan) enum CostRule {
    /// The mean over all frames.
    Mean,
    /// That of the busiest frames, as each block of a session has to be in time: steps cost the same at any time, what
    /// is computed between frames costs most while contacts are closed.
    Busiest,
}

/// A way to compute an island.
#[derive(Clone)]
pub(in crate::plan) struct Candidate {
    pub(in crate::plan) island: Assembled,
    /// Contact substeps a step.
    pub(in crate::plan) contact_substeps: usize,
    /// Nanoseconds a frame; what depends on the motion is an estimate until it was played.
    pub(in crate::plan) frame_ns: f64,
    /// Which of the table's methods of bodies and steps a frame it has.
    pub(in crate::plan) group_index: usize,
}

/// How a family of candidates computes its bodies, contacts and laws; its members differ in their steps alone.
#[derive(Clone, Copy, Debug)]
pub(in crate::plan) struct CandidateFamily {
    pub(in crate::plan) body_methods: MethodChoice<'static>,
    pub(in crate::plan) links_once_per_step: bool,
}

impl CandidateFamily {
    /// All contacts and laws are computed once a step.
    pub(in crate::plan) const ONCE_PER_STEP: Self = Self {
        body_methods: MethodChoice::ByBudget,
        links_once_per_step: true,
    };
    /// The families among which a reference is looked for, those of the highest order first; then the one that is needed
    /// where friction holds all that is heard, and the one for parameters that change, of which CA has order 1.
    pub(in crate::plan) const REFERENCE_FAMILIES: [Self; 5] = [
        Self::between_steps(MethodChoice::ByBudget),
        Self::between_steps(MethodChoice::All((MeshMethod::Bm4, 1))),
        Self::ONCE_PER_STEP,
        Self::between_steps(MethodChoice::Stepped),
        Self::between_steps(MethodChoice::Meshes((MeshMethod::Bm4, 1))),
    ];

    const fn between_steps(bodies: MethodChoice<'static>) -> Self {
        Self {
            body_methods: bodies,
            links_once_per_step: false,
        }
    }

    /// How a member of the family is assembled.
    pub(in crate::plan) fn options_for_steps(self, oversampling: u32) -> AssemblyOptions<'static> {
        AssemblyOptions {
            oversampling,
            body_methods: self.body_methods,
            is_single_step: self.links_once_per_step,
        }
    }
}

/// Whether contacts or laws of an island may be computed finer than once a step.
pub(in crate::plan) fn has_fine_links(island: &Assembled) -> bool {
    !island.is_single_step && (island.can_solve_laws_between_steps || island.island_plan.contact_substeps > 1)
}

/// The candidates for an island, in rising order of cost. What contacts and laws cost between frames is estimated from
/// the first run that computed them so: that of the reference, or of a candidate.
///
/// Assembling an island takes longer than playing a small one. So a candidate is assembled only once those of lower cost
/// had their turn.
pub(in crate::plan) struct Candidates<'a, F> {
    assemble: &'a F,
    link_cost: Option<LinkCost>,
    waiting_entries: Vec<WaitingEntry>,
    /// Those that had their turn.
    returned: Vec<ComputedBy>,
}

enum WaitingEntry {
    Candidate(Box<Candidate>),
    /// Candidates that are not assembled yet, and a lower bound of their cost [ns].
    Steps(GroupSteps, f64),
}

/// How a candidate computes, and at what cost.
#[derive(PartialEq)]
struct ComputedBy {
    cost_bits: u64,
    contact_substeps: usize,
    oversampling: u32,
    mesh_methods: Vec<Option<(MeshMethod, u32)>>,
}

/// Steps a frame of one family of candidates.
#[derive(Clone, Copy)]
struct GroupSteps {
    /// The position of its methods of bodies among all.
    methods_index: usize,
    family: CandidateFamily,
    steps: u32,
}

impl<'a, F: Fn(AssemblyOptions<'_>) -> Result<Assembled, Error>> Candidates<'a, F> {
    /// All candidates, or only those whose contacts and laws are computed once a step.
    pub(in crate::plan) fn new(assemble: &'a F, reference: (&Candidate, &PilotRun), is_once_a_step_only: bool) -> Self {
        let contact_choices: &[bool] = if is_once_a_step_only { &[true] } else { &[true, false] };
        let mesh_choices = MESH_METHODS.into_iter().map(MethodChoice::Meshes);
        let other_choices = [MethodChoice::ByBudget, MethodChoice::Stepped];
        let waiting_steps = |(methods_index, body_methods): (usize, MethodChoice<'static>)| {
            // Meshes cost more than steps of CA.
            let cost_min = match body_methods {
                MethodChoice::ByBudget => 0.0,
                _ => reference.0.island.stepped_ns,
            };
            contact_choices.iter().map(move |&is_once_a_step| {
                let family = CandidateFamily {
                    body_methods,
                    links_once_per_step: is_once_a_step,
                };
                let group_steps = GroupSteps {
                    methods_index,
                    family,
                    steps: 1,
                };
                WaitingEntry::Steps(group_steps, cost_min)
            })
        };
        Self {
            assemble,
            link_cost: LinkCost::measured(reference.0, reference.1),
            waiting_entries: (other_choices.into_iter().chain(mesh_choices).enumerate())
                .flat_map(waiting_steps)
                .collect(),
            returned: Vec::new(),
        }
    }

    /// Estimate the cost of candidates that wait from the run of one that had its turn.
    pub(in crate::plan) fn add_played(&mut self, candidate: &Candidate, run: &PilotRun) {
        if self.link_cost.is_none()
            && let Some(link_cost) = LinkCost::measured(candidate, run)
        {
            self.link_cost = Some(link_cost);
            for entry in &mut self.waiting_entries {
                if let WaitingEntry::Candidate(waiting_candidate) = entry {
                    waiting_candidate.estimate_cost(link_cost);
                }
            }
        }
    }

    /// The next candidate, if there is one that costs less than `cost_limit` [ns].
    pub(in crate::plan) fn next_below(&mut self, cost_limit: f64) -> Option<Candidate> {
        loop {
            let turn_order = |index: usize| self.waiting_entries[index].turn_order();
            let first_index = (0..self.waiting_entries.len()).min_by(|&i, &j| {
                let (order_of_i, order_of_j) = (turn_order(i), turn_order(j));
                order_of_i
                    .0
                    .total_cmp(&order_of_j.0)
                    .then(order_of_i.1.cmp(&order_of_j.1))
            })?;
            if turn_order(first_index).0 >= cost_limit {
                return None;
            }
            match self.waiting_entries.swap_remove(first_index) {
                WaitingEntry::Steps(group_steps, _) => self.assemble_steps(group_steps),
                WaitingEntry::Candidate(candidate) => {
                    let computed_by = candidate.computed_by();
                    if !self.returned.contains(&computed_by) {
                        self.returned.push(computed_by);
                        return Some(*candidate);
                    }
                }
            }
        }
    }

    /// Assembles the candidates of these steps. More steps cost more, unless the budget chooses the methods of meshes:
    /// it may then choose a simpler one.
    fn assemble_steps(&mut self, group_steps: GroupSteps) {
        let GroupSteps {
            methods_index,
            family,
            steps,
        } = group_steps;
        let mut cost_min = 0.0;
        if let Ok(island) = (self.assemble)(family.options_for_steps(steps)) {
            let candidates = substeps_to_try(&island).into_iter().map(|substeps| Candidate {
                group_index: methods_index * STEP_CHOICES + steps.ilog2() as usize,
                ..Candidate::new(island.clone(), substeps, self.link_cost)
            });
            let first_waiting = self.waiting_entries.len();
            self.waiting_entries
                .extend(candidates.map(|candidate| WaitingEntry::Candidate(Box::new(candidate))));
            let is_chosen_by_budget = matches!(family.body_methods, MethodChoice::ByBudget);
            if !is_chosen_by_budget || island.mesh_methods().iter().all(Option::is_none) {
                cost_min = self.waiting_entries[first_waiting].turn_order().0;
            }
        }
        if 2 * steps <= OVERSAMPLING_MAX {
            let more_steps = GroupSteps {
                steps: 2 * steps,
                ..group_steps
            };
            self.waiting_entries.push(WaitingEntry::Steps(more_steps, cost_min));
        }
    }
}

impl WaitingEntry {
    /// What decides when its turn is: its cost [ns], and among equal ones the substeps and the position in the table.
    fn turn_order(&self) -> (f64, [usize; 3]) {
        match self {
            Self::Steps(_, cost_min) => (*cost_min, [0; 3]),
            Self::Candidate(candidate) => {
                let is_between_steps = usize::from(!candidate.island.is_single_step);
                let position = [candidate.contact_substeps, candidate.group_index, is_between_steps];
                (candidate.frame_ns, position)
            }
        }
    }
}

/// Contact substeps a step that are worth trying.
fn substeps_to_try(island: &Assembled) -> Vec<usize> {
    if !has_fine_links(island) {
        return vec![1];
    }
    let doublings = FINE_SUBSTEPS_MIN.ilog2()..=SUBSTEPS_MAX.ilog2();
    doublings.map(|doublings| 1 << doublings).collect()
}

/// What contacts and laws cost between frames in a run, which is in proportion to the substeps.
#[derive(Clone, Copy)]
pub(in crate::plan) struct LinkCost {
    /// Of contacts and laws alone [ns a frame].
    contacts_ns: u32,
    /// With the modes of the bodies that they touch [ns a frame].
    links_ns: u32,
    /// Substeps a frame of the run.
    substeps: f64,
}

impl LinkCost {
    /// That of a run of a candidate; `None` if it computed contacts and laws once a step.
    fn measured(candidate: &Candidate, run: &PilotRun) -> Option<Self> {
        (candidate.contact_substeps > 1).then(|| Self {
            contacts_ns: run.counted_cost.contacts_ns,
            links_ns: run.counted_cost.links_ns(),
            substeps: candidate.substeps_per_frame(),
        })
    }
}

impl Candidate {
    /// A candidate whose contacts and laws cost so much between frames, if that is known.
    pub(in crate::plan) fn new(mut island: Assembled, substeps: usize, link_cost: Option<LinkCost>) -> Self {
        island.island_plan.contact_substeps = substeps;
        let mut candidate = Self {
            frame_ns: island.island_plan.frame_ns(),
            island,
            contact_substeps: substeps,
            group_index: 0,
        };
        if let Some(link_cost) = link_cost {
            candidate.estimate_cost(link_cost);
        }
        candidate
    }

    fn estimate_cost(&mut self, link_cost: LinkCost) {
        if self.contact_substeps > 1 {
            let substeps = self.substeps_per_frame();
            let island_plan = &mut self.island.island_plan;
            let counted_ns = match island_plan.bodies.is_empty() {
                true => link_cost.contacts_ns,
                false => link_cost.links_ns,
            };
            island_plan.counted_cost = Some((f64::from(counted_ns) * substeps / link_cost.substeps) as u32);
            self.frame_ns = island_plan.frame_ns();
        }
    }

    /// Whether an allowance pays for playing `n_frames` of it, as far as its cost is known; nothing is taken.
    pub(in crate::plan) fn is_affordable(&self, allowance: &Allowance, n_frames: usize) -> bool {
        allowance.share_left(1e-9 * self.frame_ns * n_frames as f64) >= 1.0
    }

    /// Whether it differs from `other` by more substeps alone.
    pub(in crate::plan) fn is_finer_than(&self, other: &Self) -> bool {
        self.group_index == other.group_index
            && self.contact_substeps > other.contact_substeps
            && other.contact_substeps > 1
    }

    /// Substeps of contacts a frame.
    fn substeps_per_frame(&self) -> f64 {
        f64::from(self.island.island_plan.oversampling) * self.contact_substeps as f64
    }

    /// The same with the cost that its run had.
    pub(in crate::plan) fn with_counted_cost(mut self, run: &PilotRun) -> Self {
        let island_plan = &mut self.island.island_plan;
        island_plan.counted_cost = Some(run.counted_cost.total_ns());
        self.frame_ns = island_plan.frame_ns();
        self
    }

    /// What two candidates have in common that compute the same under two names.
    fn computed_by(&self) -> ComputedBy {
        ComputedBy {
            cost_bits: self.frame_ns.to_bits(),
            contact_substeps: self.contact_substeps,
            oversampling: self.island.island_plan.oversampling,
            mesh_methods: self.island.mesh_methods(),
        }
    }
}
