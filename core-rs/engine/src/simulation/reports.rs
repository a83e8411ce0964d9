//! What a simulation reports: gestures, ergons, energy, muted parts, finer frames, created energy.

use super::Simulation;
use super::group::RunningUnit;
use crate::assembly::cost;
use crate::assembly::unit::{ComputationUnit, to_network_index};
use crate::gesture::report::GestureReport;
use crate::island::{Energy, ErgonRecord, FramedErgon, Island};

impl Simulation {
    /// Reports of all gestures, in the timeline's order.
    pub fn reports(&self) -> Vec<GestureReport> {
        let mut all_reports = vec![GestureReport::default(); self.plan.n_gestures];
        for (island, island_plan) in self.islands() {
            for (local, report) in island.reports().iter().enumerate() {
                let mut report = *report;
                report.pushed_by_mat = report
                    .pushed_by_mat
                    .map(|mat| to_network_index(&island_plan.network_indices.mats, mat));
                all_reports[to_network_index(&island_plan.network_indices.gestures, local)] = report;
            }
        }
        all_reports
    }

    /// Records of the ergons since the last call, by rising frame.
    pub fn take_ergons(&mut self) -> Vec<ErgonRecord> {
        let mut framed_ergons = Vec::new();
        let running_units = self.groups.iter_mut().flat_map(|group| &mut group.units);
        for (running_unit, unit) in running_units.zip(&self.plan.units) {
            let (RunningUnit::Island(island), ComputationUnit::IslandPlan(island_plan)) = (running_unit, unit) else {
                continue;
            };
            let island_ergons = island.take_ergons().into_iter();
            framed_ergons.extend(island_ergons.map(|record| FramedErgon {
                record: ErgonRecord {
                    mat: to_network_index(&island_plan.network_indices.mats, record.record.mat as usize) as u32,
                    ..record.record
                },
                frame: island.scene_frame_at(record.frame),
            }));
        }
        // Sorted by the frame of the strike; ergons of one frame stay in the order of the islands.
        framed_ergons.sort_by_key(|ergon| ergon.frame);
        framed_ergons.into_iter().map(|ergon| ergon.record).collect()
    }

    /// The energy ledger; `None` if it is not kept, or if the plan computes anything in a bank of oscillators.
    ///
    /// ```
    /// # use std::sync::Arc;
    /// # use ergon_engine::network::{Term, Tie};
    /// # use ergon_engine::{Network, Rate, Timeline};
    /// # let mut network = Network::new();
    /// # let bell = network.cel("bell", 0.002, Tie::Tuned { f: 440.0, t60: Some(1.0) }, 0.0, 0.0, 0.0)?;
    /// # network.listen("bell", vec![Term::Position { first: bell, len: 1, weight: 1.0 }])?;
    /// # let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// # timeline.strike(&network, bell, 0.0, 1e-3, None, 0)?;
    /// # let network = Arc::new(network);
    /// use ergon_engine::{OnFault, SimulationOptions, Simulation};
    ///
    /// let options = SimulationOptions { keeps_ledger: true, records_ergons: false,
    /// on_fault: OnFault::Stop, threads: 1, is_unchecked: false };
    /// let mut simulation = Simulation::new(network, &timeline, options)?;
    /// simulation.skip(1000)?;
    /// let energy = simulation.energy().expect("the ledger is kept");
    /// assert!(energy.injected > 0.0 && energy.stored > 0.0 && energy.lost > 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn energy(&self) -> Option<Energy> {
        let is_bank_unit = |(unit, _): (&RunningUnit, &ComputationUnit)| matches!(unit, RunningUnit::Bank(_));
        if self.units().any(is_bank_unit) {
            return None;
        }
        let mut energies = self.islands().map(|(island, _)| island.energy());
        let first_energy = energies.next()??;
        energies.try_fold(first_energy, |sum, energy| Some(sum + energy?))
    }

    /// Names of the muted parts, with the frame at which each was muted.
    pub fn muted_parts(&self) -> Vec<(String, u64)> {
        let islands = self.islands();
        islands.flat_map(|(island, _)| island.muted_parts()).collect()
    }

    /// Number of island steps so far that were skipped because the island was at rest. A snapshot keeps its own count.
    pub fn steps_at_rest(&self) -> u64 {
        self.islands().map(|(island, _)| island.skipped_steps()).sum()
    }

    /// Work so far whose amount depends on the motion, by the table of costs: that of contacts and laws between frames,
    /// and that of exact contacts beyond one solution a step [s].
    pub fn counted_work(&self) -> f64 {
        let islands = self.islands();
        let island_costs = islands.flat_map(|(island, _)| cost::counted_ns(island));
        1e-9 * island_costs.sum::<f64>()
    }

    /// Number of muted parts; does not allocate.
    pub fn n_muted(&self) -> usize {
        self.islands().map(|(island, _)| island.n_muted_parts()).sum()
    }

    /// Parts whose links stiffened so much that frames were computed in finer steps: name, number of such frames, and
    /// the largest number of steps a frame.
    pub fn finer_parts(&self) -> Vec<(String, u64, u32)> {
        let mut finer_parts: Vec<(String, u64, u32)> = Vec::new();
        for (part, frames, finest) in self.islands().flat_map(|(island, _)| island.finer_parts()) {
            match finer_parts.iter_mut().find(|other| other.0 == part) {
                Some(other) => (other.1, other.2) = (other.1.max(frames), other.2.max(finest)),
                None => finer_parts.push((part.to_owned(), frames, finest)),
            }
        }
        finer_parts
    }

    /// Links and meshes that created more energy than a hundredth of what the system held: name, frame, and a sentence.
    pub fn energy_gains(&self) -> Vec<(String, u64, String)> {
        let gains_of = |island: &Island| {
            let step_rate = self.rate() * island.steps_per_frame();
            let named_gains = island.energy_gains().map(move |(module, gain)| {
                let sentence = gain.sentence(&module, gain.step as f64 / step_rate);
                (module, island.scene_frame_at(gain.step), sentence)
            });
            named_gains.collect::<Vec<_>>()
        };
        self.islands().flat_map(|(island, _)| gains_of(island)).collect()
    }

    /// The most energy that one link or mesh has created, as a share of the energy that was there.
    pub fn created_share(&self) -> f64 {
        let islands = self.islands();
        islands.map(|(island, _)| island.created_share()).fold(0.0, f64::max)
    }

    /// Number of links and meshes that created energy; does not allocate.
    pub fn n_energy_gains(&self) -> usize {
        self.islands().map(|(island, _)| island.n_energy_gains()).sum()
    }

    /// Number of meshes with frames computed in finer steps; does not allocate.
    pub fn n_finer(&self) -> usize {
        let islands = self.islands();
        islands.map(|(island, _)| island.finer_parts().count()).sum()
    }
}
