//! Network + Timeline → Island.

use std::sync::Arc;

use super::bodies::{self, BodyPlan};
use super::contact_peaks::ContactPeaks;
use super::delayed_ports::{PortBinding, port_bindings};
use super::energy_gain::{self, EnergyGains};
use super::energy_rise::EnergyRise;
use super::fault::MutedParts;
use super::fine::{ContactOrder, FineLinks};
use super::ledger::Ledger;
use super::live_strikes::{PendingStrikes, strike_points};
use super::origin::{initial_motion, initial_positions};
use super::real_hands::{HandState, hand_bindings};
use super::rest::RestSearch;
use super::sounds_in::sound_drives;
use super::voices::{build_voices, framed_gestures};
use super::{ErgonStream, ExcitationSources, Island, Monitors, MotionState, OnFault, Parameters, Script, State};
use crate::gesture::report::GestureReport;
use crate::guard::{Guard, StabilityLimit};
use crate::interrupt;
use crate::island::written_hand::voice::VoiceScript;
use crate::kernel::mesh_partition::MeshPartition;
use crate::kernel::thread_team::ThreadTeam;
use crate::kernel::{self, KernelScratch};
use crate::network::{Error, LinkKind, Network, Term};
use crate::scheme::{LinkRun, Scheme};
use crate::state::{ModuleState, PreviousState};
use crate::timeline::{Drive, Ergon, Timeline, strike_forces, with_first_factors, with_greatest_factors};

/// The least number of substeps at which contacts are computed finer than a frame.
pub(crate) const FINE_SUBSTEPS_MIN: usize = 2;

/// The steps of an island.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StepNumbers {
    /// Contact substeps a step while a contact may be closed; 1 if contacts push once a step.
    pub(crate) contact_substeps: usize,
    pub(crate) contact_order: ContactOrder,
    /// Steps in `frame_interval` frames.
    pub(crate) oversampling: u32,
    pub(crate) frame_interval: u32,
}

/// How a simulation is to run.
#[derive(Clone, Copy, Debug)]
pub struct SimulationOptions {
    /// Keep the ledger (it costs work for every link).
    pub keeps_ledger: bool,
    /// Keep the stream of ergons.
    pub records_ergons: bool,
    /// What to do with a part that diverges.
    pub on_fault: OnFault,
    /// Threads that share the work; the result is the same to the last bit for any number.
    pub threads: usize,
    /// Run even a network that the certificate refuses, to see when a scheme really diverges.
    pub is_unchecked: bool,
}

impl Island {
    /// A network at frame 0 of its timeline: its scheme, its initial state, its players and its monitors.
    pub(crate) fn new(
        network: Arc<Network>,
        timeline: &Timeline,
        bodies: &[BodyPlan],
        steps: StepNumbers,
        options: SimulationOptions,
    ) -> Result<Self, Error> {
        refuse_ledger_of_hands(timeline, options)?;
        let (mut scheme, fine_runs) = island_scheme(&network, timeline, steps.contact_substeps)?;
        let mut motion = start_motion(&network, timeline, bodies, &scheme, fine_runs, steps)?;
        let gestures = framed_gestures(timeline);
        let (voice_scripts, voices) = build_voices(&network, timeline, &gestures, bodies)?;
        let guard = build_guard(&network, timeline, bodies, &scheme, &motion, options)?;
        motion.modules.previous_state = guard.as_ref().map(|_| PreviousState::new(scheme.n_mat()));
        let springs = energy_gain::hardening_springs(&scheme);
        let may_fuse = !options.keeps_ledger;
        let fused_links = may_fuse.then(|| fuse_springs(&mut scheme, &network, &voice_scripts, timeline));
        let energy_gains = build_energy_gains(timeline, &scheme, springs, options);
        let energy_rise = build_energy_rise(&network, timeline, &scheme, &motion, options);
        let led_links = super::glide::bind_leads(&mut scheme, &fused_links.unwrap_or_default(), &network, timeline);
        let glides = super::glide::build_glides(&network, timeline, &scheme)?;
        motion.scratch = build_scratch(&scheme, options);
        for running_body in &mut motion.bodies {
            running_body.prepare_team(options.threads);
        }
        let has_changing_scheme = !glides.is_empty() || !led_links.is_empty() || network.has_following();
        let changing_scheme = has_changing_scheme.then(|| {
            let mut changing_scheme = scheme.with_changing_coefficients();
            super::glide::apply_following_masses(&scheme, &mut changing_scheme, &motion.modules.x);
            changing_scheme
        });
        let ledger = options.keeps_ledger.then(|| {
            let scheme = changing_scheme.as_deref().unwrap_or(&scheme);
            Ledger::new(scheme, &timeline.gates, &mut motion.modules)
        });
        let hand_bindings = hand_bindings(&timeline.drives);
        let port_bindings = port_bindings(&timeline.drives, timeline.rate.hertz());
        let strike_points = strike_points(timeline);
        let (sound_drives, input_signals) = sound_drives(&timeline.drives);
        // A contact that is computed finely is added to the CEL's own motion, so the CEL still counts as alone.
        let fine_link_ends = |mat| motion.fine_links.as_ref().map_or(0, |links| links.link_ends_on(mat));
        let pushes = strike_forces(&network, timeline, |mat| network.degree(mat) == fine_link_ends(mat));
        let state = State {
            frame: 0,
            parameters: Parameters {
                gate_openings: vec![0.0; timeline.gates.len()],
                next_gate_openings: vec![0.0; timeline.gates.len()],
                gate_continuations: vec![None; timeline.gates.len()],
                velocity_factor: 1.0,
                changing_scheme,
                next_lead_points: vec![0; led_links.len()],
            },
            sources: ExcitationSources {
                voices,
                reports: vec![GestureReport::default(); timeline.gestures.len()],
                next_strike: 0,
                next_ergon: 0,
                layer_deviations: vec![0.0; timeline.keys.len()],
                ergon_stream: ErgonStream::new(options.records_ergons),
                hand_states: vec![HandState::default(); hand_bindings.len()],
                delayed_forces: port_bindings.iter().map(PortBinding::without_forces).collect(),
                pending_strikes: PendingStrikes::without_impulses(&strike_points),
                input_signals,
            },
            monitors: Monitors {
                contact_peaks: ContactPeaks::default(),
                muted_parts: MutedParts::new(&scheme),
                guard,
                energy_gains,
                energy_rise,
                ledger,
            },
            motion,
        };
        let script = Script {
            scheme,
            gestures,
            voices: voice_scripts,
            strike_forces: pushes,
            ergons: ergons_by_frame(timeline),
            gates: timeline.gates.clone(),
            drives: timeline.drives.clone(),
            glides,
            led_links,
            hand_bindings,
            port_bindings,
            strike_points,
            sound_drives,
            on_fault: options.on_fault,
        };
        let mut island = Self {
            network,
            rest_search: RestSearch::new(script.scheme.n_out()),
            sleep_monitor: None,
            script: Arc::new(script),
            state,
            oversampling: steps.oversampling,
            frame_interval: steps.frame_interval,
        };
        island.reserve();
        island.resume_computing();
        Ok(island)
    }
}

fn refuse_ledger_of_hands(timeline: &Timeline, options: SimulationOptions) -> Result<(), Error> {
    if !options.keeps_ledger || timeline.hands().next().is_none() {
        return Ok(());
    }
    Err(Error::Refused {
        module: "ledger".to_owned(),
        message: "no energy ledger can be kept where a real hand plays, because its energy is not \
                  measured"
            .to_owned(),
    })
}

/// The numbers of the island, and the links that are computed finer than a frame.
fn island_scheme(
    network: &Network,
    timeline: &Timeline,
    contact_substeps: usize,
) -> Result<(Scheme, Vec<LinkRun>), Error> {
    let mut scheme = Scheme::new(network, timeline.rate)?;
    assign_gates(&mut scheme, timeline);
    let fine_links = if contact_substeps < FINE_SUBSTEPS_MIN {
        Vec::new()
    } else {
        scheme.take_substepped(&timeline.determined_mats())
    };
    Ok((scheme, fine_links))
}

/// Where everything is at frame 0, with values that glide or follow as they are there.
fn start_motion(
    network: &Network,
    timeline: &Timeline,
    plans: &[BodyPlan],
    scheme: &Scheme,
    mut fine_runs: Vec<LinkRun>,
    steps: StepNumbers,
) -> Result<MotionState, Error> {
    let is_active = |first: usize| interrupt::polled_items(&fine_runs).all(|run| run.first_link != first);
    let led_system = match &timeline.leads[..] {
        [] if network.following_masses().is_empty() => None,
        leads => {
            let led_network = with_first_factors(network, leads)?;
            let led_network = led_network.with_masses_at(&initial_positions(network, timeline, &timeline.drives));
            let mut scheme = Scheme::new(&led_network, timeline.rate)?;
            assign_gates(&mut scheme, timeline);
            Some((led_network, scheme))
        }
    };
    let (start_network, start_scheme) = match &led_system {
        Some((led_network, led_scheme)) => (led_network, led_scheme),
        None => (network, scheme),
    };
    let mut modules = initial_motion(start_network, start_scheme, timeline, &timeline.drives, &is_active);
    let mut bodies = start_bodies(plans, start_network, timeline, &mut modules, &is_active)?;
    for run in &mut fine_runs {
        interrupt::poll();
        if is_led(timeline, run.first_link) {
            run.make_adjustable();
        }
    }
    kernel::proxies::set_from_masses(scheme, &mut modules); // bodies have moved their ports
    let fine_links = build_fine_links(fine_runs, scheme, network, &mut bodies, steps, timeline);
    Ok(MotionState {
        scratch: KernelScratch::new(scheme),
        modules,
        bodies,
        fine_links,
        targets: Vec::new(),
    })
}

fn is_led(timeline: &Timeline, link: usize) -> bool {
    let mut timeline_leads = timeline.leads.iter();
    timeline_leads.any(|lead| lead.links().contains(&link))
}

/// The guard of links that may stiffen beyond what the scheme can step.
fn build_guard(
    network: &Network,
    timeline: &Timeline,
    plans: &[BodyPlan],
    scheme: &Scheme,
    motion: &MotionState,
    options: SimulationOptions,
) -> Result<Option<Box<Guard>>, Error> {
    if options.is_unchecked || timeline.is_unguarded {
        return Ok(None); // the run has to show when it really diverges
    }
    let body_ports: Vec<usize> = plans.iter().flat_map(BodyPlan::ports).collect();
    let guard = if timeline.leads.is_empty() {
        Guard::new(scheme, network, StabilityLimit::CA, &body_ports)?
    } else {
        let stiffest_network = with_greatest_factors(network, &timeline.leads)?;
        let mut stiffest_scheme = Scheme::new(&stiffest_network, timeline.rate)?;
        if motion.fine_links.is_some() {
            stiffest_scheme.take_substepped(&timeline.determined_mats());
        }
        Guard::new(&stiffest_scheme, &stiffest_network, StabilityLimit::CA, &body_ports)?
    };
    Ok(guard.map(Box::new))
}

/// Accounts of links that may create energy; `springs` are those that were there before some were fused.
fn build_energy_gains(
    timeline: &Timeline,
    scheme: &Scheme,
    mut springs: Vec<LinkRun>,
    options: SimulationOptions,
) -> Option<Box<EnergyGains>> {
    if options.is_unchecked {
        return None; // the run has to show what really happens
    }
    springs.retain(|run| {
        scheme
            .runs
            .iter()
            .all(|scheme_run| scheme_run.first_link != run.first_link)
    });
    EnergyGains::new(scheme, &springs, |link| is_led(timeline, link))
}

/// The account of the island's whole energy.
fn build_energy_rise(
    network: &Network,
    timeline: &Timeline,
    scheme: &Scheme,
    motion: &MotionState,
    options: SimulationOptions,
) -> Option<Box<EnergyRise>> {
    // A force does work all the time, a constant one too, although no event falls on the island then.
    let is_pushed = timeline.drives.iter().any(Drive::is_force);
    if options.is_unchecked || is_pushed || !timeline.glides.is_empty() {
        return None;
    }
    let (bodies, fine_links) = (&motion.bodies, motion.fine_links.as_ref());
    EnergyRise::new(network, scheme, bodies, fine_links, timeline.rate)
}

/// Scratch memory of laws, and the partition of a mesh for several threads.
fn build_scratch(scheme: &Scheme, options: SimulationOptions) -> KernelScratch {
    let mut scratch = KernelScratch::new(scheme);
    scratch.mesh_partition = MeshPartition::for_threads(&scheme.fused_springs, scheme.n_mat(), options.threads);
    scratch
}

/// Ergons by rising frame.
fn ergons_by_frame(timeline: &Timeline) -> Vec<(u64, Ergon)> {
    let timeline_ergons = timeline.ergons.iter();
    let mut timeline_ergons: Vec<_> = timeline_ergons
        .map(|ergon| (timeline.frame_of(ergon.instant), *ergon))
        .collect();
    timeline_ergons.sort_by_key(|(frame, _)| *frame);
    timeline_ergons
}

/// Sets the gate of each run that a gate opens; a gate covers whole runs, however they were cut.
fn assign_gates(scheme: &mut Scheme, timeline: &Timeline) {
    for (gate_index, gate) in timeline.gates.iter().enumerate() {
        let scheme_runs = scheme.runs.iter_mut().chain(&mut scheme.exact_runs);
        for run in scheme_runs.filter(|run| gate.links().contains(&run.first_link)) {
            run.gate = Some(gate_index);
        }
    }
}

/// Fuses springs into one pass, except those whose forces are heard or reported by a gesture; returns the first link of
/// each run. Of led links, REFs are fused where no thread team computes them: its members copy the numbers of springs.
fn fuse_springs(scheme: &mut Scheme, network: &Network, scripts: &[VoiceScript], timeline: &Timeline) -> Vec<usize> {
    let mut is_excluded = vec![false; network.n_lia()];
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        if let Term::Force {
            first: first_link,
            len: link_count,
            ..
        } = *term
        {
            is_excluded[first_link..first_link + link_count].fill(true);
        }
    }
    for &(link, _) in scripts.iter().flat_map(|script| &script.outer_links) {
        is_excluded[link] = true;
    }
    let may_have_team = MeshPartition::may_divide(scheme.n_mat());
    for lead in &timeline.leads {
        for run in network.runs().iter().filter(|run| lead.links().contains(&run.first)) {
            if may_have_team || !matches!(run.kind, LinkKind::Ref) {
                is_excluded[run.first..run.first + run.len].fill(true);
            }
        }
    }
    scheme.fuse_springs(|link| is_excluded[link])
}

/// Contacts and laws that are computed finer than a frame.
fn build_fine_links(
    fine_runs: Vec<LinkRun>,
    scheme: &Scheme,
    network: &Network,
    bodies: &mut [bodies::RunningBody],
    steps: StepNumbers,
    timeline: &Timeline,
) -> Option<FineLinks> {
    if fine_runs.is_empty() {
        return None;
    }
    let fine_links = FineLinks::new(fine_runs, network, scheme, bodies, steps, timeline);
    for modal in bodies.iter_mut().filter_map(bodies::RunningBody::modal_mut) {
        modal.make_tables(fine_links.instants());
    }
    Some(fine_links)
}

/// Bodies with their ports in the island, started against the forces that the ports feel at frame 0.
fn start_bodies(
    body_plans: &[BodyPlan],
    network: &Network,
    timeline: &Timeline,
    modules: &mut ModuleState,
    is_active: &dyn Fn(usize) -> bool,
) -> Result<Vec<bodies::RunningBody>, Error> {
    if body_plans.is_empty() {
        return Ok(Vec::new());
    }
    modules.free_port_motion = vec![0.0; modules.x.len()];
    let start_forces = crate::start::forces(network, timeline, &modules.x, &[], is_active);
    let start_body = |body_plan: &BodyPlan| {
        let running_body = body_plan.start(&start_forces, modules)?;
        running_body.set_ports(modules);
        Ok(running_body)
    };
    body_plans.iter().map(start_body).collect()
}

/// Writes the outputs of a network at rest at its initial positions into `outputs` (n_out).
pub(crate) fn outputs_at_rest(network: &Network, scheme: &Scheme, outputs: &mut [f64]) {
    let start_positions = network.mats().x0.clone();
    let mut resting_modules = ModuleState::new(scheme, start_positions.clone(), vec![0.0; start_positions.len()]);
    // An output may hear the force of a contact that presses at rest.
    kernel::compute_link_forces(
        scheme,
        &[],
        &mut resting_modules,
        &mut KernelScratch::new(scheme),
        &mut ThreadTeam::alone(),
    );
    kernel::proxies::distribute_forces(scheme, &mut resting_modules);
    kernel::solve_exact_contacts(scheme, &[], &[], &mut resting_modules);
    kernel::write_outputs(scheme, &resting_modules, outputs);
}
