//! Network + Timeline → Island.

use std::sync::Arc;

use super::contact_peaks::ContactPeaks;
use super::energy_gain::{self, Gains};
use super::energy_rise::Rise;
use super::fault::Mutes;
use super::fine::Fine;
use super::inside::{self, BodyPlan};
use super::ledger::Ledger;
use super::live_strikes::strike_points;
use super::real_hands::{HandState, hand_bindings};
use super::rest::Rest;
use super::sounds_in::sound_drives;
use super::written_hand::framed::FramedGesture;
use super::{Island, OnFault, Script, State, Stream};
use crate::gesture::report::Report;
use crate::gesture::script::Touch;
use crate::guard::{Guard, Limit};
use crate::interrupt;
use crate::island::written_hand::free::{FreeKey, FreeMotion};
use crate::island::written_hand::voice::{Voice, VoiceScript};
use crate::kernel::mesh_partition::MeshPartition;
use crate::kernel::thread_team::ThreadTeam;
use crate::kernel::{self, Laws};
use crate::network::{Error, Network, Term};
use crate::scheme::{Run, Scheme};
use crate::start::backward_steps;
use crate::state::{Body, PreviousState};
use crate::timeline::{Drive, DriveKind, Key, Timeline, first, greatest, pushes};
use crate::units::Rate;
use crate::units::frame;

/// The least number of substeps at which contacts are computed finer than a frame.
const FINE: usize = 2;

/// How a simulation is to run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Keep the ledger (it costs work for every link).
    pub ledger: bool,
    /// Keep the stream of ergons.
    pub record: bool,
    /// What to do with a part that diverges.
    pub on_fault: OnFault,
    /// Threads that share the work; the result is the same to the last bit for any number.
    pub threads: usize,
    /// Run even a network that the certificate refuses, to see when a scheme really diverges.
    pub unchecked: bool,
}

impl Island {
    /// A network at frame 0 of its timeline.
    pub(crate) fn new(
        network: Arc<Network>,
        timeline: &Timeline,
        bodies: &[BodyPlan],
        (steps, oversampling, every): (usize, u32, u32),
        options: Options,
    ) -> Result<Self, Error> {
        if options.ledger && timeline.hands().next().is_some() {
            return Err(Error::Refused {
                module: "ledger".to_owned(),
                message: "no energy ledger can be kept where a real hand plays, because its energy is not \
                          measured"
                    .to_owned(),
            });
        }
        let mut scheme = Scheme::new(&network, timeline.rate)?;
        gate(&mut scheme, timeline);
        let mut links = if steps < FINE {
            Vec::new()
        } else {
            scheme.take_fine(&timeline.steered())
        };
        let acts = |first: usize| interrupt::each(&links).all(|run| run.first != first);
        let begun = match &timeline.leads[..] {
            [] if network.following_masses().is_empty() => None,
            leads => {
                let begun = first(&network, leads)?;
                let begun = begun.with_masses_at(&positions(&network, timeline, &timeline.drives));
                let mut scheme = Scheme::new(&begun, timeline.rate)?;
                gate(&mut scheme, timeline);
                Some((begun, scheme))
            }
        };
        let (at_first, own) = match &begun {
            Some((begun, scheme)) => (begun, scheme),
            None => (&*network, &scheme),
        };
        let mut body = start(at_first, own, timeline, &timeline.drives, &acts);
        let plans = bodies;
        let mut bodies = join(plans, at_first, timeline, &mut body, &acts)?;
        for run in &mut links {
            interrupt::poll();
            let mut leads = timeline.leads.iter();
            if leads.any(|lead| lead.links().contains(&run.first)) {
                run.set_loose();
            }
        }
        kernel::proxies::join(&scheme, &mut body); // bodies have moved their ports
        let fine = fine(links, &scheme, &network, &mut bodies, steps, timeline);
        let gestures = framed(timeline);
        let (scripts, voices) = build_voices(&network, timeline, &gestures, plans)?;
        let ports: Vec<usize> = plans.iter().flat_map(BodyPlan::ports).collect();
        let guard = if options.unchecked || timeline.is_unguarded {
            None // the run has to show when it really diverges
        } else if timeline.leads.is_empty() {
            Guard::new(&scheme, &network, Limit::CA, &ports)?.map(Box::new)
        } else {
            let stiffest = greatest(&network, &timeline.leads)?;
            let mut most = Scheme::new(&stiffest, timeline.rate)?;
            if fine.is_some() {
                most.take_fine(&timeline.steered());
            }
            Guard::new(&most, &stiffest, Limit::CA, &ports)?.map(Box::new)
        };
        body.previous = guard.as_ref().map(|_| PreviousState::new(scheme.n_mat()));
        let mut springs = energy_gain::hardening_springs(&scheme);
        if !options.ledger {
            fuse(&mut scheme, &network, &scripts, timeline);
        }
        let is_led = |link: usize| {
            timeline
                .leads
                .iter()
                .any(|lead| lead.links().contains(&link))
        };
        let gains = if options.unchecked {
            None // the run has to show what really happens
        } else {
            springs.retain(|run| scheme.runs.iter().all(|own| own.first != run.first));
            Gains::new(&scheme, &springs, is_led)
        };
        // A force does work all the time, a constant one too, although no event falls on the island then.
        let is_pushed = timeline.drives.iter().any(Drive::pushes);
        let is_watched = !options.unchecked && timeline.glides.is_empty() && !is_pushed;
        let rise = is_watched
            .then(|| Rise::new(&network, &scheme, &bodies, fine.as_ref(), timeline.rate))
            .flatten();
        let led = super::glide::bind_leads(&mut scheme, &network, timeline);
        let glides = super::glide::glides(&network, timeline, &scheme)?;
        let mut laws = Laws::new(&scheme);
        laws.mesh_partition =
            MeshPartition::for_threads(&scheme.fused, scheme.n_mat(), options.threads);
        bodies
            .iter_mut()
            .for_each(|body| body.share(options.threads));
        // A contact that is computed finely is added to the CEL's own motion, so the CEL still counts as alone.
        let touches = |mat| fine.as_ref().map_or(0, |fine| fine.touches(mat));
        let pushes = pushes(&network, timeline, |mat| {
            network.degree(mat) == touches(mat)
        });
        let ergons = timeline.ergons.iter();
        let mut ergons: Vec<_> = ergons
            .map(|ergon| (timeline.frame(ergon.at), *ergon))
            .collect();
        ergons.sort_by_key(|(frame, _)| *frame);
        let changes = !glides.is_empty() || !led.is_empty() || network.follows();
        let gliding = changes.then(|| {
            let mut gliding = scheme.changing();
            super::glide::apply_following_masses(&scheme, &mut gliding, &body.x);
            gliding
        });
        let ledger = options.ledger.then(|| {
            let scheme = gliding.as_deref().unwrap_or(&scheme);
            Ledger::new(scheme, &timeline.gates, &mut body)
        });
        let hand_bindings = hand_bindings(&timeline.drives);
        let strike_points = strike_points(&timeline.drives);
        let (sound_drives, played) = sound_drives(&timeline.drives);
        let state = State {
            frame: 0,
            voices,
            reports: vec![Report::default(); timeline.gestures.len()],
            pushed: 0,
            ergons: 0,
            gates: vec![0.0; timeline.gates.len()],
            gates_next: vec![0.0; timeline.gates.len()],
            gate_continuations: vec![None; timeline.gates.len()],
            layers: vec![0.0; timeline.keys.len()],
            targets: Vec::new(),
            laws,
            stream: Stream::new(options.record),
            touches: ContactPeaks::default(),
            unheard: vec![0.0; scheme.n_out()],
            bodies,
            fine,
            hand_states: vec![HandState::default(); hand_bindings.len()],
            impulses: vec![0.0; strike_points.len()],
            played,
            ledger,
            mutes: Mutes::new(&scheme),
            guard,
            gains,
            rise,
            damped: 1.0,
            scheme: gliding,
            body,
        };
        let script = Script {
            scheme,
            gestures,
            voices: scripts,
            pushes,
            ergons,
            gates: timeline.gates.clone(),
            drives: timeline.drives.clone(),
            glides,
            led,
            hand_bindings,
            strike_points,
            sound_drives,
            on_fault: options.on_fault,
        };
        let mut simulation = Self {
            network,
            rest: Rest::new(script.scheme.n_out()),
            quiet: None,
            script: Arc::new(script),
            state,
            oversampling,
            every,
        };
        simulation.reserve();
        simulation.begin_again();
        Ok(simulation)
    }
}

/// Sets the gate of each run that a gate opens; a gate covers whole runs, however they were cut.
fn gate(scheme: &mut Scheme, timeline: &Timeline) {
    for (index, gate) in timeline.gates.iter().enumerate() {
        let runs = scheme.runs.iter_mut().chain(&mut scheme.exact);
        for run in runs.filter(|run| gate.links().contains(&run.first)) {
            run.gate = Some(index);
        }
    }
}

/// Where every MAT is at frame 0, and the step that led there.
fn start(
    network: &Network,
    scheme: &Scheme,
    timeline: &Timeline,
    drives: &[Drive],
    acts: &dyn Fn(usize) -> bool,
) -> Body {
    let pushes: Vec<_> = drives
        .iter()
        .filter(|drive| drive.kind == DriveKind::Force)
        .map(|drive| (drive.mat, drive.value(0, scheme.rate)))
        .collect();
    let x = positions(network, timeline, drives);
    let d = backward_steps(network, timeline, scheme, &x, &pushes, acts);
    Body::new(scheme, x, d)
}

/// Where every MAT is at frame 0 [m], (n_mat).
fn positions(network: &Network, timeline: &Timeline, drives: &[Drive]) -> Vec<f64> {
    let mut x = network.mats().x0.clone();
    for drive in drives
        .iter()
        // The position of a real hand is not yet known: its key begins where the network has it.
        .filter(|drive| drive.kind == DriveKind::Position && drive.hand().is_none())
    {
        x[drive.mat] = drive.value(0, timeline.rate.hertz());
    }
    for proxy in network.proxies() {
        x[proxy.mat] = proxy.sum(|mat| x[mat], |mat| x[mat]);
    }
    x
}

/// Fuses springs into one pass, except those that are led and those whose forces are heard or reported by a gesture.
fn fuse(scheme: &mut Scheme, network: &Network, scripts: &[VoiceScript], timeline: &Timeline) {
    let mut is_excluded = vec![false; network.n_lia()];
    for term in network.outputs().iter().flat_map(|output| &output.terms) {
        if let Term::Force { first, len, .. } = *term {
            is_excluded[first..first + len].fill(true);
        }
    }
    for &(link, _) in scripts.iter().flat_map(|script| &script.outer_links) {
        is_excluded[link] = true;
    }
    for lead in &timeline.leads {
        is_excluded[lead.links()].fill(true);
    }
    scheme.fuse(|link| is_excluded[link]);
}

/// Contacts and laws that are computed finer than a frame.
fn fine(
    links: Vec<Run>,
    scheme: &Scheme,
    network: &Network,
    bodies: &mut [inside::RunningBody],
    steps: usize,
    timeline: &Timeline,
) -> Option<Fine> {
    if links.is_empty() {
        return None;
    }
    let fine = Fine::new(links, network, scheme, bodies, steps, timeline);
    for modal in bodies.iter_mut().filter_map(inside::RunningBody::modal_mut) {
        modal.make_tables(fine.instants());
    }
    Some(fine)
}

/// Bodies with their ports in the island, started against the forces that the ports feel at frame 0.
fn join(
    bodies: &[BodyPlan],
    network: &Network,
    timeline: &Timeline,
    body: &mut Body,
    acts: &dyn Fn(usize) -> bool,
) -> Result<Vec<inside::RunningBody>, Error> {
    if bodies.is_empty() {
        return Ok(Vec::new());
    }
    body.inner = vec![0.0; body.x.len()];
    let force = crate::start::forces(network, timeline, &body.x, &[], acts);
    let start = |inside: &BodyPlan| {
        let playing = inside.start(&force, body)?;
        playing.place(body);
        Ok(playing)
    };
    bodies.iter().map(start).collect()
}

/// Writes the outputs of a network at rest at its initial positions into `heard` (n_out).
pub(crate) fn at_rest(network: &Network, scheme: &Scheme, heard: &mut [f64]) {
    let x = network.mats().x0.clone();
    let mut body = Body::new(scheme, x.clone(), vec![0.0; x.len()]);
    // An output may hear the force of a contact that presses at rest.
    kernel::links(
        scheme,
        &[],
        &mut body,
        &mut Laws::new(scheme),
        &mut ThreadTeam::alone(),
    );
    kernel::proxies::divide(scheme, &mut body);
    kernel::contacts(scheme, &[], &[], &mut body);
    kernel::tap(scheme, &body, heard);
}

/// Links that join a MAT to other parts, each with the MAT at its other end.
fn outer_links(network: &Network, mat: usize) -> Vec<(usize, usize)> {
    let part = &network.mats().part;
    let mut found = Vec::new();
    for run in network.runs() {
        if run.pairwise().is_some() {
            let links = (0..run.len).flat_map(|i| run.pairs(i).map(move |pair| (i, pair)));
            for (i, (a, b)) in links.filter(|&(_, (a, b))| a == mat || b == mat) {
                found.push((run.first + i, if a == mat { b } else { a }));
            }
            continue;
        }
        for axis in 0..run.n_axes() {
            let (a, b) = run.pair(0, axis);
            for (end, other) in [(a, b), (b, a)] {
                if let Some(i) = mat.checked_sub(end).filter(|i| *i < run.len) {
                    found.push((run.first + i, other + i));
                }
            }
        }
    }
    found.retain(|&(_, other)| part[other] != part[mat]);
    found
}

/// The gestures of a timeline at its rate.
fn framed(timeline: &Timeline) -> Vec<FramedGesture> {
    let (rate, oversampling) = (timeline.rate.hertz(), timeline.oversampling);
    let gestures = timeline.gestures.iter();
    gestures
        .map(|gesture| FramedGesture::new(gesture, rate, oversampling))
        .collect()
}

/// The voices of all keys: one for the successive gestures of a key, and one for each gesture with `layer`.
fn build_voices(
    network: &Network,
    timeline: &Timeline,
    gestures: &[FramedGesture],
    bodies: &[BodyPlan],
) -> Result<(Vec<VoiceScript>, Vec<Voice>), Error> {
    let mut scripts = Vec::new();
    let mut voices = Vec::new();
    for (key, known) in timeline.keys.iter().enumerate() {
        let (free, motion) = free_key(network, timeline, known, bodies)?;
        let mut own: Vec<usize> = (0..gestures.len())
            .filter(|&i| gestures[i].gesture.key == key)
            .collect();
        let start = |i: usize| gestures[i].gesture.start;
        own.sort_by(|&i, &j| start(i).total_cmp(&start(j)));
        for &i in &own {
            check_playable(&gestures[i], &free, known, timeline.rate)?;
        }
        let (layers, line): (Vec<usize>, Vec<usize>) = own
            .into_iter()
            .partition(|&i| gestures[i].gesture.manner.layer);
        let script = VoiceScript {
            key,
            struck: known.struck,
            free,
            gestures: line,
            layer: false,
            outer_links: outer_links(network, known.struck),
        };
        voices.push(Voice::new(&script, motion));
        scripts.push(script.clone());
        for gesture in layers {
            let layer = VoiceScript {
                free: script.free.deviation(),
                gestures: vec![gesture],
                layer: true,
                ..script.clone()
            };
            voices.push(Voice::new(&layer, layer.free.at_rest()));
            scripts.push(layer);
        }
    }
    Ok((scripts, voices))
}

/// A free copy of a key's part, and its motion at frame 0. Refuses a key that cannot be struck.
pub(super) fn free_key(
    network: &Network,
    timeline: &Timeline,
    key: &Key,
    bodies: &[BodyPlan],
) -> Result<(FreeKey, FreeMotion), Error> {
    let mats = network.mats();
    if !mats.kind[key.struck].moves() {
        return Err(Error::Refused {
            module: network.mat_name(key.struck),
            message: "ergons of a key can only strike a MAS or a CEL".to_owned(),
        });
    }
    let part = mats.part[key.struck] as usize;
    // Links that close by the end are left out: a gesture is written for the key as it is in the end.
    let closing = timeline.gates.iter().filter(|gate| gate.closes());
    let own = network.part_alone(part, &closing.map(|gate| gate.links()).collect::<Vec<_>>());
    let inside = |mat: usize| own.mat(mat);
    let couplings = timeline.gates.iter().filter(|gate| !gate.is_ramp());
    for link in couplings.map(|gate| gate.link) {
        let run = network.run_of(link);
        if run.is_some_and(|run| inside(run.a).is_some() && inside(run.b).is_some()) {
            return Err(Error::Refused {
                module: network.link_name(link),
                message: "a coupling cannot join two modules of one key, because gestures are computed for the key \
                          with all its links; make this link a module of the key"
                    .to_owned(),
            });
        }
    }
    let drives: Vec<Drive> = timeline
        .drives
        .iter()
        .filter(|drive| drive.own)
        .filter_map(|drive| {
            inside(drive.mat).map(|mat| Drive {
                mat,
                ..drive.clone()
            })
        })
        .collect();
    let scheme = Arc::new(Scheme::new(&own.network, timeline.rate)?);
    let body = start(
        &own.network,
        &scheme,
        &Timeline::new(timeline.rate),
        &drives,
        &|_| true,
    );
    let free = FreeKey {
        struck: inside(key.struck).unwrap_or(0),
        members: own.mats.iter().map(|&mat| mat as usize).collect(),
        slow: bodies
            .iter()
            .filter_map(|body| match body {
                BodyPlan::Slow(slow) if slow.part == part => Some(slow.alone(inside)),
                _ => None,
            })
            .collect(),
        scheme,
        drives,
    };
    let motion = free.start(body);
    Ok((free, motion))
}

/// Refuses a gesture that its key cannot play.
fn check_playable(
    gesture: &FramedGesture,
    free: &FreeKey,
    key: &Key,
    rate: Rate,
) -> Result<(), Error> {
    let manner = gesture.gesture.manner;
    let refuse = |message| {
        Err(Error::Refused {
            module: key.name.clone(),
            message,
        })
    };
    // No flight lasts longer than the gesture.
    let most = gesture.last().saturating_sub(gesture.first);
    let flight = |grain: &f64| frame(*grain, rate.hertz()).min(most);
    let is_long = |grain: &f64| free.is_past_quarter(flight(grain));
    if let Some(grain) = manner.grain.filter(is_long) {
        return refuse(format!(
            "a grain of {:.1} ms is longer than a quarter of the key's own period: between \
             ergons the key would swing back",
            1e3 * grain
        ));
    }
    if manner.layer && manner.touch == Touch::Tracked {
        return refuse("a gesture with `layer` cannot be tracked".to_owned());
    }
    Ok(())
}
