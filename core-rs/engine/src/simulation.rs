//! A plan that plays: its islands side by side, their sounds added up in a fixed order.
//!
//! While it steps in one thread it does not allocate (but for a recorded stream of ergons), lock, fail or
//! panic. The bytes depend on neither the number of threads nor the size of blocks.

use std::sync::Arc;

use crate::bank::Bank;
use crate::gesture::script::Report;
use crate::island::{Island, Taken};
use crate::network::{Error, Network};
use crate::plan::{Isle, Plan, Unit, whole};
use crate::timeline::Timeline;

pub use crate::island::{Energy, Fault, OnFault, Options, Record};

/// Frames that an island goes on alone before its sound is added: its state stays in the cache.
const STRETCH: usize = 256;

/// A network that plays.
#[derive(Clone, Debug)]
pub struct Simulation {
    plan: Arc<Plan>,
    /// In the order of the plan's units.
    units: Vec<Playing>,
    frame: u64,
    /// One island's sound   (STRETCH · its n_out)
    sound: Vec<f64>,
}

/// A unit of a plan that plays.
#[derive(Clone, Debug)]
enum Playing {
    Island(Box<Island>),
    Bank(Bank),
}

/// A moment of a simulation, to come back to.
#[derive(Clone, Debug)]
pub struct Snapshot(Box<Simulation>);

impl Simulation {
    /// Everything stepped as written, at frame 0 of its timeline.
    pub fn new(
        network: Arc<Network>,
        timeline: &Timeline,
        options: Options,
    ) -> Result<Self, Error> {
        Self::planned(Arc::new(Plan::plain(network, timeline)?), options)
    }

    /// What a plan computes, at frame 0.
    pub fn planned(plan: Arc<Plan>, options: Options) -> Result<Self, Error> {
        let mut most = 0;
        let mut units = Vec::with_capacity(plan.units.len());
        for unit in &plan.units {
            units.push(match unit {
                Unit::Isle(isle) => {
                    let island =
                        Island::new(isle.network.clone(), &isle.timeline, &isle.bodies, options)?;
                    most = most.max(island.n_out());
                    Playing::Island(Box::new(island))
                }
                Unit::Bank(bank) => Playing::Bank(Bank::new(
                    &bank.oscillators,
                    bank.strikes.clone(),
                    plan.timeline_rate,
                    STRETCH,
                )),
            });
        }
        Ok(Self {
            plan,
            units,
            frame: 0,
            sound: vec![0.0; most * STRETCH],
        })
    }

    /// The islands that are stepped, each with what it is in the whole.
    fn islands(&self) -> impl Iterator<Item = (&Island, &Isle)> {
        self.units
            .iter()
            .zip(&self.plan.units)
            .filter_map(|pair| match pair {
                (Playing::Island(island), Unit::Isle(isle)) => Some((&**island, &**isle)),
                _ => None,
            })
    }

    /// Number of outputs.
    pub fn n_out(&self) -> usize {
        self.plan.network.outputs().len()
    }

    /// Frames done.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Frames a second [Hz].
    pub fn rate(&self) -> f64 {
        self.plan.timeline_rate.hertz()
    }

    /// Fill `out` with whole frames of outputs, frame by frame, (n_frames · n_out).
    ///
    /// Fails with the first part that goes non-finite, unless faults are muted.
    pub fn process(&mut self, out: &mut [f64]) -> Result<(), Fault> {
        let n_out = self.n_out().max(1);
        flushed(|| {
            out.chunks_mut(STRETCH * n_out)
                .try_for_each(|out| self.stretch(out, out.len() / n_out))
        })
    }

    /// Go on `n_frames` frames without listening.
    pub fn skip(&mut self, n_frames: u64) -> Result<(), Fault> {
        flushed(|| {
            let mut left = n_frames;
            while left > 0 {
                let n = left.min(STRETCH as u64);
                self.stretch(&mut [], n as usize)?;
                left -= n;
            }
            Ok(())
        })
    }

    /// A stretch of every island. Of several that fault in it, the first in time is told.
    fn stretch(&mut self, out: &mut [f64], n_frames: usize) -> Result<(), Fault> {
        let n_out = self.plan.network.outputs().len();
        for frame in out.chunks_exact_mut(n_out.max(1)) {
            frame.copy_from_slice(&self.plan.still);
        }
        let mut fault: Option<Fault> = None;
        let plan = self.plan.clone();
        for (playing, unit) in self.units.iter_mut().zip(&plan.units) {
            match (playing, unit) {
                (Playing::Bank(bank), _) => bank.process(out, n_out, n_frames),
                (Playing::Island(island), Unit::Isle(isle)) => {
                    let own = island.n_out();
                    let sound = &mut self.sound[..own * n_frames];
                    if let Err(new) = island.process(sound, n_frames) {
                        let is_first = fault.as_ref().is_none_or(|old| new.frame < old.frame);
                        fault = if is_first { Some(new) } else { fault };
                    }
                    add(sound, own, isle, out, n_out);
                }
                (Playing::Island(_), Unit::Bank(_)) => {}
            }
        }
        self.frame = match &fault {
            Some(fault) => fault.frame,
            None => self.frame + n_frames as u64,
        };
        fault.map_or(Ok(()), Err)
    }

    /// Positions now [m], (n_mat); NaN where the plan computes none.
    pub fn positions(&self) -> Vec<f64> {
        self.motion(|x, _| x, Island::positions)
    }

    /// Steps x[n] − x[n−1] now [m], (n_mat); NaN where the plan computes none.
    pub fn steps(&self) -> Vec<f64> {
        self.motion(|x, before| x - before, Island::steps)
    }

    fn motion(&self, own: fn(f64, f64) -> f64, of: fn(&Island) -> &[f64]) -> Vec<f64> {
        let mut all = vec![f64::NAN; self.plan.network.n_mat()];
        for (playing, unit) in self.units.iter().zip(&self.plan.units) {
            match (playing, unit) {
                (Playing::Island(island), Unit::Isle(isle)) => {
                    for (local, &value) in of(island).iter().enumerate() {
                        all[whole(&isle.to_whole.mats, local)] = value;
                    }
                }
                (Playing::Bank(bank), Unit::Bank(plan)) => {
                    for (oscillator, &(mat, rest)) in plan.mats.iter().enumerate() {
                        let (now, before) = bank.motion(oscillator);
                        all[mat as usize] = own(now + rest, before + rest);
                    }
                }
                _ => {}
            }
        }
        all
    }

    /// Where each key's gesture wants it now [m]; NaN where none runs, (n_keys,).
    pub fn asked(&self) -> Vec<f64> {
        let mut all = vec![f64::NAN; self.plan.n_keys];
        for (island, isle) in self.islands() {
            for (local, asked) in island.asked().into_iter().enumerate() {
                all[whole(&isle.to_whole.keys, local)] = asked;
            }
        }
        all
    }

    /// Name of a MAT as the composer wrote it.
    pub fn mat_name(&self, mat: usize) -> String {
        self.plan.network.mat_name(mat)
    }

    /// Reports of all gestures, in the timeline's order.
    pub fn reports(&self) -> Vec<Report> {
        let mut all = vec![Report::default(); self.plan.n_gestures];
        for (island, isle) in self.islands() {
            for (local, report) in island.reports().iter().enumerate() {
                let mut report = *report;
                report.pushed_by = report.pushed_by.map(|mat| whole(&isle.to_whole.mats, mat));
                all[whole(&isle.to_whole.gestures, local)] = report;
            }
        }
        all
    }

    /// Ergons since the last call, as they struck.
    pub fn take_ergons(&mut self) -> Vec<Record> {
        let mut all = Vec::new();
        for (playing, unit) in self.units.iter_mut().zip(&self.plan.units) {
            let (Playing::Island(island), Unit::Isle(isle)) = (playing, unit) else {
                continue;
            };
            all.extend(island.take_ergons().into_iter().map(|record| Taken {
                record: Record {
                    mat: whole(&isle.to_whole.mats, record.record.mat as usize) as u32,
                    ..record.record
                },
                ..record
            }));
        }
        // By the frame that they struck in; within it island by island.
        all.sort_by_key(|taken| taken.frame);
        all.into_iter().map(|taken| taken.record).collect()
    }

    /// The ledger, if it is kept: not by a plan that computes anything as oscillators.
    pub fn energy(&self) -> Option<Energy> {
        if self
            .units
            .iter()
            .any(|unit| matches!(unit, Playing::Bank(_)))
        {
            return None;
        }
        let mut own = self.islands().map(|(island, _)| island.energy());
        let first = own.next()??;
        own.try_fold(first, |sum, energy| Some(sum + energy?))
    }

    /// Parts put to silence, with the frame of each.
    pub fn muted(&self) -> Vec<(String, u64)> {
        self.islands()
            .flat_map(|(island, _)| island.muted())
            .collect()
    }

    /// Remember this moment.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot(Box::new(self.clone()))
    }

    /// Go back to a moment of this simulation.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        *self = (*snapshot.0).clone();
        for playing in &mut self.units {
            if let Playing::Island(island) = playing {
                island.reserve();
            }
        }
    }
}

/// Add an island's sound (n_frames · own) to the outputs that it is heard at (n_frames · n_out).
fn add(sound: &[f64], own: usize, isle: &Isle, out: &mut [f64], n_out: usize) {
    if out.is_empty() || own == 0 {
        return;
    }
    for (frame, heard) in out.chunks_exact_mut(n_out).zip(sound.chunks_exact(own)) {
        for (local, heard) in heard.iter().enumerate() {
            frame[whole(&isle.to_whole.outputs, local)] += heard;
        }
    }
}

/// Run with denormals flushed to zero: decaying networks end in them, and they are slow.
fn flushed<T>(run: impl FnOnce() -> T) -> T {
    // SAFETY: nothing inside relies on gradual underflow; the guard restores the mode on the way out.
    unsafe { no_denormals::no_denormals(run) }
}
