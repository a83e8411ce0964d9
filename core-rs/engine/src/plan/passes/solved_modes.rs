//! Modes that a plan has computed, so that the plan of the next version need not compute them again.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use crate::network::Network;
use crate::plan::constants::SOLVE;
use crate::plan::passes::complex_modes::{ComplexModes, Sum};
use crate::plan::passes::linear::NoModes;
use crate::plan::passes::modes::{Modes, Row};
use crate::units::Rate;

/// The modes of one body, with the rows that have been asked for.
#[derive(Debug)]
pub(in crate::plan) struct Solved {
    network: Network,
    rate: Rate,
    rows: Vec<Row>,
    modes: Modes,
}

/// The complex modes of one body, which are the same at every rate, or why it has none.
struct SolvedComplex {
    network: Network,
    outputs: Vec<Sum>,
    struck: Vec<usize>,
    modes: Result<Arc<ComplexModes>, NoModes>,
}

/// Bodies known from an earlier plan, and those that the present plan has solved.
#[derive(Default)]
pub(in crate::plan) struct Memo<'a> {
    known: &'a [Arc<Solved>],
    solved: RefCell<Vec<Arc<Solved>>>,
    complex: RefCell<Vec<SolvedComplex>>,
    /// Bodies whose solution has been counted for this island. A solution known from elsewhere counts too, so that the
    /// work of an island does not depend on others.
    counted: RefCell<Vec<Network>>,
    /// Work of solutions that has not been taken yet [s].
    work: Cell<f64>,
}

impl<'a> Memo<'a> {
    pub(in crate::plan) fn new(known: &'a [Arc<Solved>]) -> Self {
        Self {
            known,
            solved: RefCell::default(),
            complex: RefCell::default(),
            counted: RefCell::default(),
            work: Cell::default(),
        }
    }

    /// The solved bodies, for the next plan.
    pub(in crate::plan) fn into_solved(self) -> Vec<Arc<Solved>> {
        self.solved.into_inner()
    }

    /// Begins another island.
    pub(in crate::plan) fn begin(&self) {
        self.counted.borrow_mut().clear();
        self.work.set(0.0);
    }

    fn count(&self, network: &Network, n_modes: usize) {
        let mut counted = self.counted.borrow_mut();
        if !counted.iter().any(|own| own.is_same_from_start(network)) {
            counted.push(network.clone());
            let n = n_modes as f64;
            self.work.set(self.work.get() + SOLVE * n * n * n);
        }
    }

    /// Work of solutions since the last call [s].
    pub(in crate::plan) fn take_work(&self) -> f64 {
        self.work.take()
    }

    /// The same as [`Modes::new`], bit for bit, since each row is transformed by itself.
    pub(in crate::plan) fn modes(
        &self,
        network: &Network,
        rows: &[Row],
        rate: Rate,
    ) -> Result<Modes, NoModes> {
        // Modes depend on the rate only if the discrete network is the reference.
        let is_ours = |solved: &&Arc<Solved>| {
            (!solved.modes.is_discrete || solved.rate.hertz() == rate.hertz())
                && solved.network.is_same_from_start(network)
        };
        let solved_here = self.solved.borrow().iter().find(is_ours).cloned();
        let known = solved_here.or_else(|| self.known.iter().find(is_ours).cloned());
        let place = |solved: &Solved, row: &Row| {
            solved
                .rows
                .iter()
                .position(|place_of_row| place_of_row == row)
        };
        if let Some(solved) = &known {
            let places: Option<Vec<usize>> = rows.iter().map(|row| place(solved, row)).collect();
            if let Some(places) = places {
                self.count(network, solved.modes.len());
                self.keep(solved.clone());
                return Ok(solved.modes.seen_by(&places));
            }
        }
        // Rows that were asked for once will be asked for again.
        let mut all = rows.to_vec();
        if let Some(solved) = &known {
            let others = solved.rows.iter().filter(|row| !rows.contains(row));
            all.extend(others.cloned());
        }
        let modes = Modes::new(network, &all, rate)?;
        self.count(network, modes.len());
        let places: Vec<usize> = (0..rows.len()).collect();
        let place_of_row = modes.seen_by(&places);
        self.keep(Arc::new(Solved {
            network: network.clone(),
            rate,
            rows: all,
            modes,
        }));
        Ok(place_of_row)
    }

    /// The same as [`ComplexModes::new`], computed once for all rates at which an island is tried.
    pub(in crate::plan) fn complex(
        &self,
        network: &Network,
        outputs: &[Sum],
        struck: &[usize],
        rate: Rate,
    ) -> Result<Arc<ComplexModes>, NoModes> {
        let mut all = self.complex.borrow_mut();
        let is_ours = |solved: &&SolvedComplex| {
            solved.outputs == outputs
                && solved.struck == struck
                && solved.network.is_same_from_start(network)
        };
        let modes = match all.iter().find(is_ours) {
            Some(solved) => solved.modes.clone()?,
            None => {
                let modes = ComplexModes::new(network, outputs, struck, rate).map(Arc::new);
                all.push(SolvedComplex {
                    network: network.clone(),
                    outputs: outputs.to_vec(),
                    struck: struck.to_vec(),
                    modes: modes.clone(),
                });
                modes?
            }
        };
        match modes.unfit(rate) {
            Some(why) => Err(why),
            None => Ok(modes),
        }
    }

    fn keep(&self, solved: Arc<Solved>) {
        let mut memory = self.solved.borrow_mut();
        memory.retain(|other| !solved.network.is_same_from_start(&other.network));
        memory.push(solved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memo_modes_are_solved_once_for_all_rates() {
        let mut network = Network::default();
        let mut last = network.mas("m0", 1e-3, 0.0, 0.0).unwrap();
        for i in 1..8 {
            let next = network.mas(&format!("m{i}"), 1e-3, 0.0, 0.0).unwrap();
            let name = format!("r{i}");
            network.spring(&name, last, next, 1e3, 0.0, 0.0).unwrap();
            last = next;
        }
        let memo = Memo::new(&[]);
        let solve = |hertz: f64| {
            let rate = Rate::new(hertz).unwrap();
            let modes = memo.modes(&network, &[vec![(last, 1.0)]], rate);
            (modes.unwrap().lambda, memo.take_work())
        };
        let (first, work) = solve(44_100.0);
        assert!(work > 0.0);
        assert_eq!(solve(88_200.0), (first.clone(), 0.0));
        memo.begin();
        assert_eq!(
            solve(44_100.0),
            (first, work),
            "another island's work is its own"
        );
    }
}
