//! Modes that a plan has computed, so that the plan of the next version need not compute them again.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use crate::assembly::cost_table::Costs;
use crate::body_modes::complex_modes::{ComplexModes, Sum};
use crate::body_modes::linear::NoModes;
use crate::body_modes::normal_modes::{Modes, Row};
use crate::network::Network;
use crate::units::Rate;

/// The modes of one body, with the rows that have been asked for.
#[derive(Debug)]
pub(crate) struct SolvedBody {
    network: Network,
    rate: Rate,
    rows: Vec<Row>,
    modes: Modes,
}

/// The complex modes of one body, which are the same at every rate, or why it has none.
#[derive(Debug)]
struct SolvedComplex {
    network: Network,
    outputs: Vec<Sum>,
    struck_mats: Vec<usize>,
    modes: Result<Arc<ComplexModes>, NoModes>,
}

/// The bodies that a plan has solved.
#[derive(Clone, Debug, Default)]
pub(crate) struct SolvedModes {
    normal: Vec<Arc<SolvedBody>>,
    complex: Vec<Arc<SolvedComplex>>,
}

/// Where complex modes are kept from one plan to the next, of a network that some outputs hear and that is struck at
/// some MATs.
pub(crate) trait ModeStore {
    /// The modes that were kept.
    fn get(&self, network: &Network, outputs: &[Sum], struck: &[usize]) -> Option<ComplexModes>;

    /// Keep modes.
    fn put(&self, network: &Network, outputs: &[Sum], struck: &[usize], modes: &ComplexModes);
}

/// Bodies known from an earlier plan, and those that the present plan has solved.
pub(crate) struct ModeCache<'a> {
    earlier_modes: Option<&'a SolvedModes>,
    solved_modes: RefCell<SolvedModes>,
    /// Where complex modes are kept from one plan to the next.
    store: Option<&'a dyn ModeStore>,
    /// Bodies whose solution has been counted for this island. A solution known from elsewhere counts too, so that the
    /// work of an island does not depend on others.
    counted_networks: RefCell<Vec<Network>>,
    /// Work of solutions that has not been taken yet [s].
    pending_seconds: Cell<f64>,
}

impl<'a> ModeCache<'a> {
    /// `earlier`: what an earlier plan has solved.
    pub(crate) fn new(earlier: Option<&'a SolvedModes>) -> Self {
        Self {
            earlier_modes: earlier,
            solved_modes: RefCell::default(),
            store: None,
            counted_networks: RefCell::default(),
            pending_seconds: Cell::default(),
        }
    }

    /// The same, with complex modes from a store.
    pub(crate) fn with_store(self, store: Option<&'a dyn ModeStore>) -> Self {
        Self { store, ..self }
    }

    /// The solved bodies, for the next plan.
    pub(crate) fn into_solved(self) -> SolvedModes {
        self.solved_modes.into_inner()
    }

    /// Begins another island.
    pub(crate) fn begin_island(&self) {
        self.counted_networks.borrow_mut().clear();
        self.pending_seconds.set(0.0);
    }

    fn count_solution(&self, network: &Network, n_modes: usize) {
        let mut counted = self.counted_networks.borrow_mut();
        if !counted
            .iter()
            .any(|counted_network| counted_network.is_same_from_start(network))
        {
            counted.push(network.clone());
            let mode_count = n_modes as f64;
            self.pending_seconds.set(
                self.pending_seconds.get()
                    + 1e-9 * Costs::nanoseconds("mode_solution") * mode_count * mode_count * mode_count,
            );
        }
    }

    /// Work of solutions since the last call [s].
    pub(crate) fn take_seconds(&self) -> f64 {
        self.pending_seconds.take()
    }

    /// The same as [`Modes::new`], bit for bit, since each row is transformed by itself.
    pub(crate) fn normal_modes(&self, network: &Network, rows: &[Row], rate: Rate) -> Result<Modes, NoModes> {
        // Modes depend on the rate only if the discrete network is the reference.
        let is_same_problem = |solved: &&Arc<SolvedBody>| {
            (!solved.modes.is_discrete || solved.rate.hertz() == rate.hertz())
                && solved.network.is_same_from_start(network)
        };
        let solved_in_plan = self.solved_modes.borrow().normal.iter().find(is_same_problem).cloned();
        let solved_before = || self.earlier_modes?.normal.iter().find(is_same_problem).cloned();
        let already_solved = solved_in_plan.or_else(solved_before);
        let row_index = |solved: &SolvedBody, row: &Row| solved.rows.iter().position(|solved_row| solved_row == row);
        if let Some(solved) = &already_solved {
            let row_indices: Option<Vec<usize>> = rows.iter().map(|row| row_index(solved, row)).collect();
            if let Some(row_indices) = row_indices {
                self.count_solution(network, solved.modes.len());
                self.store_solution(solved.clone());
                return Ok(solved.modes.with_rows(&row_indices));
            }
        }
        // Rows that were asked for once will be asked for again.
        let mut all_rows = rows.to_vec();
        if let Some(solved) = &already_solved {
            let other_rows = solved.rows.iter().filter(|row| !rows.contains(row));
            all_rows.extend(other_rows.cloned());
        }
        let modes = Modes::new(network, &all_rows, rate)?;
        self.count_solution(network, modes.len());
        let row_indices: Vec<usize> = (0..rows.len()).collect();
        let seen_modes = modes.with_rows(&row_indices);
        self.store_solution(Arc::new(SolvedBody {
            network: network.clone(),
            rate,
            rows: all_rows,
            modes,
        }));
        Ok(seen_modes)
    }

    /// The same as [`ComplexModes::new`], computed once for all rates at which an island is tried.
    pub(crate) fn complex_modes(
        &self,
        network: &Network,
        outputs: &[Sum],
        struck_mats: &[usize],
        rate: Rate,
    ) -> Result<Arc<ComplexModes>, NoModes> {
        let solutions = &mut self.solved_modes.borrow_mut().complex;
        let is_same_problem = |solved: &&Arc<SolvedComplex>| {
            solved.outputs == outputs && solved.struck_mats == struck_mats && solved.network.is_same_from_start(network)
        };
        let solved_before = || self.earlier_modes?.complex.iter().find(is_same_problem);
        let solved_now = solutions.iter().find(is_same_problem).cloned();
        let complex_modes = match solved_now.or_else(|| solved_before().cloned()) {
            Some(solved) => {
                let modes = solved.modes.clone();
                if !solutions.iter().any(|other| Arc::ptr_eq(other, &solved)) {
                    solutions.push(solved);
                }
                modes?
            }
            None => {
                let solve = || ComplexModes::new(network, outputs, struck_mats, rate);
                let stored_modes = self.store.and_then(|store| store.get(network, outputs, struck_mats));
                let complex_modes = stored_modes.map_or_else(
                    || {
                        let solved_modes = solve()?;
                        if let Some(store) = self.store {
                            store.put(network, outputs, struck_mats, &solved_modes);
                        }
                        Ok(solved_modes)
                    },
                    Ok,
                );
                let complex_modes = complex_modes.map(Arc::new);
                solutions.push(Arc::new(SolvedComplex {
                    network: network.clone(),
                    outputs: outputs.to_vec(),
                    struck_mats: struck_mats.to_vec(),
                    modes: complex_modes.clone(),
                }));
                complex_modes?
            }
        };
        match complex_modes.unfit_reason(rate) {
            Some(unfit_reason) => Err(unfit_reason),
            None => Ok(complex_modes),
        }
    }

    fn store_solution(&self, solved: Arc<SolvedBody>) {
        let solutions = &mut self.solved_modes.borrow_mut().normal;
        solutions.retain(|other| !solved.network.is_same_from_start(&other.network));
        solutions.push(solved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memo_modes_are_solved_once_for_all_rates() {
        let mut network = Network::default();
        let mut last_mat = network.mas("m0", 1e-3, 0.0, 0.0).unwrap();
        for i in 1..8 {
            let next_mat = network.mas(&format!("m{i}"), 1e-3, 0.0, 0.0).unwrap();
            let spring_name = format!("r{i}");
            network.spring(&spring_name, last_mat, next_mat, 1e3, 0.0, 0.0).unwrap();
            last_mat = next_mat;
        }
        let mode_cache = ModeCache::new(None);
        let solve = |hertz: f64| {
            let rate = Rate::new(hertz).unwrap();
            let cached_modes = mode_cache.normal_modes(&network, &[vec![(last_mat, 1.0)]], rate);
            (cached_modes.unwrap().lambda, mode_cache.take_seconds())
        };
        let (first_lambda, first_work) = solve(44_100.0);
        assert!(first_work > 0.0);
        assert_eq!(solve(88_200.0), (first_lambda.clone(), 0.0));
        mode_cache.begin_island();
        assert_eq!(
            solve(44_100.0),
            (first_lambda, first_work),
            "another island's work is its own"
        );
    }
}
