//! A bank: oscillators that nothing ties to each other, struck at known instants and heard in sums.
//!
//! Each runs by its own two-term recurrence through the very samples of its continuous motion. Isolated
//! CELs are such oscillators, and so are the modes of a linear body.

mod carry;

pub(crate) use carry::are_same;

use std::ops::Range;
use std::sync::Arc;

use crate::cell::Cell;
use crate::kernel::bank::{LANES, Lanes, Motion, Rates, Sum, joined, run, run_weighted};
use crate::units::Rate;

/// One oscillator, as it is added.
#[derive(Clone, Debug)]
pub(crate) struct Oscillator {
    /// x[n+1] = a·x[n] − b·x[n−1]
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// x[0] and x[−1] [m]
    pub(crate) now: f64,
    pub(crate) before: f64,
    /// Outputs that hear it, rising, with their weights; none of them 0.
    pub(crate) heard: Vec<(u32, f64)>,
    /// What strikes it, by rising frame.
    pub(crate) blows: Vec<Blow>,
}

/// What is added to x[frame + 1].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blow {
    pub(crate) frame: u64,
    pub(crate) kick: Kick,
}

/// How much.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kick {
    /// So far [m].
    By(f64),
    /// What an ergon of a mass and speed gives, by the velocity that it meets; and T²/m of the struck.
    Ergon { mass: f64, speed: f64, w: f64 },
}

/// Strikes that many oscillators feel, each in its own measure: the modes of a body struck at a point.
#[derive(Clone, Debug)]
pub(crate) struct Strikes {
    /// Which oscillators, in the order they were added.
    pub(crate) among: Range<usize>,
    /// The continuous motion of each, of mass 1; empty where a strike acts in one step   (n)
    pub(crate) cells: Vec<Cell>,
    /// How much of it each feels   (n)
    pub(crate) share: Vec<f64>,
    /// What a newton of one step moves a mass of 1: T², or 1 where masses are algorithmic.
    pub(crate) w: f64,
    /// Frame, part of a frame after it, impulse [N·s].
    pub(crate) blows: Vec<(u64, f64, f64)>,
}

/// A blow on one lane of a group, or on all of them.
#[derive(Clone, Copy, Debug)]
struct Event {
    frame: u64,
    lanes: Target,
}

#[derive(Clone, Copy, Debug)]
enum Target {
    Lane(u32, Kick),
    /// Index of the strikes, of the blow among them; whether it is the second step of two.
    Group(u32, u32, bool),
}

/// Oscillators that the same outputs hear.
#[derive(Clone, Debug)]
struct Section {
    outputs: Vec<u32>,
    groups: Range<usize>,
}

/// What does not change of a bank.
#[derive(Clone, Debug)]
struct Script {
    rate: Rate,
    sections: Vec<Section>,
    /// (n_groups)
    rates: Vec<Rates>,
    /// Of groups in sections that several outputs hear: a weight for each output, output by output.
    weights: Vec<Vec<Lanes>>,
    /// Factor of what the lanes hold: the weight where one output hears them   (n_groups)
    scales: Vec<Lanes>,
    /// By rising frame   (n_groups)
    events: Vec<Vec<Event>>,
    strikes: Vec<Strikes>,
    /// A group that moves less than this in all falls asleep.
    faint: f64,
    /// Group and lane of each oscillator, in the order they were added.
    places: Vec<(u32, u32)>,
    /// Which oscillator each lane holds   (n_groups · LANES)
    holds: Vec<u32>,
}

/// A bank that plays.
#[derive(Clone, Debug)]
pub(crate) struct Bank {
    script: Arc<Script>,
    frame: u64,
    motions: Vec<Motion>,
    /// The next event of each group.
    next: Vec<usize>,
    /// Nothing has moved the group yet: its sound is zero.
    still: Vec<bool>,
    /// Rates while everything is damped, and whether it is   (n_groups)
    damped: Vec<Rates>,
    is_damped: bool,
    /// Sums of one section   (its outputs · room)
    sums: Vec<Sum>,
    room: usize,
}

const NOBODY: u32 = u32::MAX;
/// Every so many frames, counted from the beginning, groups that have faded away fall asleep.
const SLEEP: u64 = 4_096;
/// All sleepers together are so far below the hardest blow [dB]: below the rounding of 24 bits.
const ASLEEP: f64 = -160.0;
/// Where nobody knows how hard the hardest will be, so small that no score hears it: the width of a nucleus [m].
const NOTHING: f64 = 1e-15;

impl Bank {
    /// A bank at frame 0; `room`: the most frames it will be asked for at once. `is_open`: what else may strike it is
    /// not known.
    pub(crate) fn new(
        oscillators: &[Oscillator],
        strikes: Vec<Strikes>,
        rate: Rate,
        room: usize,
        is_open: bool,
    ) -> Self {
        let mut order: Vec<usize> = (0..oscillators.len()).collect();
        let outputs = |i: usize| oscillators[i].heard.iter().map(|&(output, _)| output);
        order.sort_by(|&i, &j| outputs(i).cmp(outputs(j)).then(i.cmp(&j)));
        let mut script = Script {
            rate,
            sections: Vec::new(),
            rates: Vec::new(),
            weights: Vec::new(),
            scales: Vec::new(),
            events: Vec::new(),
            strikes,
            faint: 0.0,
            places: vec![(0, 0); oscillators.len()],
            holds: Vec::new(),
        };
        let mut motions = Vec::new();
        for alike in order.chunk_by(|&i, &j| outputs(i).eq(outputs(j))) {
            let first = script.rates.len();
            for members in alike.chunks(LANES) {
                motions.push(script.group(oscillators, members));
            }
            script.sections.push(Section {
                outputs: outputs(alike[0]).collect(),
                groups: first..script.rates.len(),
            });
        }
        script.share();
        script.faint = if is_open {
            NOTHING
        } else {
            faint(oscillators, &script.strikes, rate) / script.rates.len().max(1) as f64
        };
        let still = |motion: &Motion| motion.now == Lanes::ZERO && motion.before == Lanes::ZERO;
        let most = script.sections.iter().map(|section| section.outputs.len());
        Self {
            frame: 0,
            next: vec![0; motions.len()],
            still: motions.iter().map(still).collect(),
            sums: vec![Sum::ZERO; most.max().unwrap_or(0) * room],
            room,
            motions,
            damped: script.rates.clone(),
            is_damped: false,
            script: Arc::new(script),
        }
    }

    /// Add what `n_frames` frames sound like to `out` (n_frames · n_out), and go on as many.
    pub(crate) fn process(&mut self, out: &mut [f64], n_out: usize, n_frames: usize) {
        let script = self.script.clone();
        for section in &script.sections {
            let heard = section.outputs.len();
            let room = self.room;
            self.sums[..heard * room].fill(Sum::ZERO);
            for group in section.groups.clone() {
                self.advance(&script, group, heard, n_frames);
            }
            if out.is_empty() {
                continue;
            }
            for (sums, &output) in self.sums.chunks(room).zip(&section.outputs) {
                for (frame, sum) in out.chunks_exact_mut(n_out).zip(&sums[..n_frames]) {
                    frame[output as usize] += joined(sum);
                }
            }
        }
        self.frame += n_frames as u64;
    }

    /// One group through `n_frames` frames, stopping where it is struck.
    fn advance(&mut self, script: &Script, group: usize, heard: usize, n_frames: usize) {
        let mut at = 0;
        while at < n_frames {
            let now = self.frame + at as u64;
            let event = script.events[group].get(self.next[group]);
            let until = event.map_or(n_frames, |event| {
                (event.frame.saturating_sub(self.frame) as usize).min(n_frames)
            });
            if until > at {
                let until = until.min(at + (SLEEP - now % SLEEP) as usize);
                self.run(script, group, heard, at..until);
                at = until;
                if (self.frame + at as u64).is_multiple_of(SLEEP) {
                    self.rest(script, group);
                }
                continue;
            }
            self.still[group] = false;
            let mut added = Lanes::ZERO;
            let motion = &self.motions[group];
            while let Some(event) = script.events[group]
                .get(self.next[group])
                .filter(|event| event.frame <= now)
            {
                script.add(group, motion, event, &mut added);
                self.next[group] += 1;
            }
            self.run(script, group, heard, at..at + 1);
            for (x, added) in self.motions[group].now.0.iter_mut().zip(&added.0) {
                *x += added;
            }
            at += 1;
        }
    }

    fn run(&mut self, script: &Script, group: usize, heard: usize, frames: Range<usize>) {
        if self.still[group] {
            return;
        }
        let (rates, motion) = (self.damped.get(group), &mut self.motions[group]);
        let rates = rates
            .filter(|_| self.is_damped)
            .unwrap_or(&script.rates[group]);
        if heard == 1 {
            run(rates, motion, &mut self.sums[frames]);
        } else {
            let n_frames = frames.len();
            let sums = &mut self.sums[frames.start..];
            run_weighted(
                rates,
                motion,
                &script.weights[group],
                n_frames,
                sums,
                self.room,
            );
        }
    }

    /// Put a group that has faded away to sleep: it cannot grow by itself.
    fn rest(&mut self, script: &Script, group: usize) {
        if self.still[group] {
            return;
        }
        let (rates, motion) = (&script.rates[group], &mut self.motions[group]);
        let amplitude = |lane: usize| {
            let (a, b) = (rates.a.0[lane], rates.b.0[lane]);
            amplitude(a, b, motion.now.0[lane], motion.before.0[lane])
        };
        let moves: f64 = (0..LANES).map(amplitude).sum();
        if moves < script.faint {
            (motion.now, motion.before) = (Lanes::ZERO, Lanes::ZERO);
            self.still[group] = true;
        }
    }

    /// Let every oscillator fade by a factor more a frame: its poles are so many times as long.
    pub(crate) fn damp(&mut self, by: f64) {
        self.is_damped = by < 1.0;
        for (damped, rates) in self.damped.iter_mut().zip(&self.script.rates) {
            rates.faded(by, damped);
        }
    }

    /// Position of an oscillator now, and one frame ago [m].
    pub(crate) fn motion(&self, oscillator: usize) -> (f64, f64) {
        let (group, lane) = self.script.places[oscillator];
        let (group, lane) = (group as usize, lane as usize);
        let scale = self.script.scales[group].0[lane];
        let motion = &self.motions[group];
        (motion.now.0[lane] / scale, motion.before.0[lane] / scale)
    }
}

/// How far an oscillator still swings at most, from two positions (b = r², a = 2r·cos θ); for ever, where it
/// creeps: that is not bounded here.
fn amplitude(a: f64, b: f64, now: f64, before: f64) -> f64 {
    if now == 0.0 && before == 0.0 {
        return 0.0;
    }
    let sine = 1.0 - a * a / (4.0 * b);
    if sine > 0.0 {
        ((now * now + b * before * before - a * now * before) / sine).sqrt()
    } else {
        f64::INFINITY
    }
}

/// What all sleepers may move together: far below the hardest blow that is heard.
fn faint(oscillators: &[Oscillator], strikes: &[Strikes], rate: Rate) -> f64 {
    // Where one output hears it the lanes hold what it hears.
    let scale = |own: &Oscillator| match own.heard[..] {
        [(_, weight)] => weight.abs(),
        _ => 1.0,
    };
    let own = oscillators.iter().map(|own| {
        let blows = own.blows.iter().map(|blow| match blow.kick {
            Kick::By(x) => x.abs(),
            Kick::Ergon { .. } => 0.0,
        });
        let start = Some(amplitude(own.a, own.b, own.now, own.before)).filter(|x| x.is_finite());
        blows.fold(start.unwrap_or(0.0), f64::max) * scale(own)
    });
    let shared = strikes.iter().flat_map(|strikes| {
        let impulses = strikes.blows.iter().map(|(_, _, impulse)| impulse.abs());
        let unit = impulses.fold(0.0, f64::max) * rate.hertz() * strikes.w;
        let among = oscillators[strikes.among.clone()].iter();
        let shares = among.zip(&strikes.share);
        shares.map(move |(own, share)| unit * share.abs() * scale(own))
    });
    own.chain(shared).fold(0.0, f64::max) * crate::maths::decibels(ASLEEP)
}

impl Script {
    /// Add a group of oscillators that the same outputs hear; returns its motion at frame 0.
    fn group(&mut self, oscillators: &[Oscillator], members: &[usize]) -> Motion {
        let of = |pick: &dyn Fn(&Oscillator) -> f64| {
            let mut lanes = Lanes::ZERO;
            for (lane, &member) in lanes.0.iter_mut().zip(members) {
                *lane = pick(&oscillators[member]);
            }
            lanes
        };
        let group = self.rates.len();
        let n_heard = oscillators[members[0]].heard.len();
        // Where one output hears them, the lanes hold what it hears: the sum needs no weights.
        let scale = |own: &Oscillator| match own.heard[..] {
            [(_, weight)] => weight,
            _ => 1.0,
        };
        self.rates.push(Rates {
            a: of(&|own| own.a),
            b: of(&|own| own.b),
        });
        let weights = if n_heard == 1 { 0 } else { n_heard };
        self.weights.push(
            (0..weights)
                .map(|output| of(&|own| own.heard[output].1))
                .collect(),
        );
        self.scales.push(of(&scale));
        let mut events = Vec::new();
        for (lane, &member) in members.iter().enumerate() {
            self.places[member] = (group as u32, lane as u32);
            for blow in &oscillators[member].blows {
                events.push(Event {
                    frame: blow.frame,
                    lanes: Target::Lane(lane as u32, blow.kick),
                });
            }
        }
        self.events.push(events);
        let holds = members.iter().map(|&member| member as u32);
        self.holds.extend(holds);
        self.holds.resize(self.rates.len() * LANES, NOBODY);
        Motion {
            now: of(&|own| scale(own) * own.now),
            before: of(&|own| scale(own) * own.before),
        }
    }

    /// Tell every group of the strikes that all its lanes feel, and put its events in order.
    fn share(&mut self) {
        for (index, strikes) in self.strikes.iter().enumerate() {
            let mut groups: Vec<u32> = self.places[strikes.among.clone()]
                .iter()
                .map(|&(group, _)| group)
                .collect();
            groups.sort_unstable();
            groups.dedup();
            let steps: &[bool] = if strikes.cells.is_empty() {
                &[false]
            } else {
                &[false, true]
            };
            for group in groups {
                for (blow, &(frame, _, _)) in strikes.blows.iter().enumerate() {
                    for &second in steps {
                        self.events[group as usize].push(Event {
                            frame: frame + u64::from(second),
                            lanes: Target::Group(index as u32, blow as u32, second),
                        });
                    }
                }
            }
        }
        for events in &mut self.events {
            events.sort_by_key(|event| event.frame);
        }
    }

    /// What an event adds to the lanes of its group, `motion` being that of the event's frame.
    fn add(&self, group: usize, motion: &Motion, event: &Event, added: &mut Lanes) {
        let scales = &self.scales[group].0;
        match event.lanes {
            Target::Lane(lane, Kick::By(x)) => {
                let lane = lane as usize;
                added.0[lane] += scales[lane] * x;
            }
            Target::Lane(lane, Kick::Ergon { mass, speed, w }) => {
                let lane = lane as usize;
                let rates = &self.rates[group];
                let (now, before) = (motion.now.0[lane], motion.before.0[lane]);
                let next = rates.a.0[lane] * now - rates.b.0[lane] * before + added.0[lane];
                let velocity = (next - before) / scales[lane] * (0.5 * self.rate.hertz());
                let struck = self.rate.step() * self.rate.step() / w;
                let impulse = 2.0 * mass * struck / (mass + struck) * (speed - velocity);
                added.0[lane] += scales[lane] * w * impulse * self.rate.hertz();
            }
            Target::Group(strikes, blow, second) => {
                let strikes = &self.strikes[strikes as usize];
                let (_, alpha, impulse) = strikes.blows[blow as usize];
                let holds = &self.holds[group * LANES..(group + 1) * LANES];
                for (lane, &member) in holds.iter().enumerate() {
                    let member = member as usize;
                    if !strikes.among.contains(&member) {
                        continue;
                    }
                    let mode = member - strikes.among.start;
                    let impulse = impulse * strikes.share[mode];
                    let force = match strikes.cells.get(mode) {
                        Some(cell) => cell.split(impulse, alpha, self.rate)[usize::from(second)],
                        None => impulse * self.rate.hertz(),
                    };
                    added.0[lane] += scales[lane] * force * strikes.w;
                }
            }
        }
    }
}
