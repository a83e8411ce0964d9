//! Complex modes that an earlier plan has solved: an eigenvalue problem takes longer than its numbers to read.

use crate::assembly::solved_modes::ModeStore;
use crate::body_modes::complex_modes::{Complex, ComplexModes, Pole, Sum};
use crate::content::network_key;
use crate::network::Network;
use crate::plan::trial::record::{TrialRecord, TrialStore};

/// Complex modes in a store of records.
pub(in crate::plan) struct StoredModes<'a>(pub(in crate::plan) &'a dyn TrialStore);

impl ModeStore for StoredModes<'_> {
    fn get(&self, network: &Network, outputs: &[Sum], struck: &[usize]) -> Option<ComplexModes> {
        let record = self.0.get(&key(network, outputs, struck))?;
        modes_of(&record, (outputs.len(), struck.len()))
    }

    fn put(&self, network: &Network, outputs: &[Sum], struck: &[usize], modes: &ComplexModes) {
        if let Some(record) = record_of(modes) {
            self.0.put(&key(network, outputs, struck), record);
        }
    }
}

fn key(network: &Network, outputs: &[Sum], struck: &[usize]) -> String {
    network_key(network, format_args!("complex modes {outputs:?} {struck:?}"))
}

/// The record of modes: the kind of each, then the numbers of their poles, of their start, of what each output sees,
/// of what each blow adds, and of outputs at rest. `None` if a number is not finite.
fn record_of(modes: &ComplexModes) -> Option<TrialRecord> {
    let pole_numbers = |pole: &Pole| match *pole {
        Pole::Pair { decay, omega } => (0, [decay, omega]),
        Pole::Real { decay } => (1, [decay, 0.0]),
        Pole::Free => (2, [0.0, 0.0]),
    };
    let (kinds, poles): (Vec<u32>, Vec<Complex>) = modes.poles.iter().map(pole_numbers).unzip();
    let rows = [&poles, &modes.start].into_iter();
    let rows = rows.chain(&modes.output_shapes).chain(&modes.struck_shapes);
    let numbers = rows.flatten().flatten().chain(&modes.rest);
    let numbers: Option<Vec<_>> = numbers.map(|&x| x.is_finite().then_some(Some(x))).collect();
    Some(TrialRecord::without_trial(numbers?, vec![kinds]))
}

/// The modes in a record; `None` if it is not one of so many outputs and struck points.
fn modes_of(record: &TrialRecord, (n_out, n_struck): (usize, usize)) -> Option<ComplexModes> {
    let ([kinds], true) = (&record.counts[..], record.is_without_trial()) else {
        return None;
    };
    let n_modes = kinds.len();
    let numbers: Option<Vec<f64>> = record.numbers.iter().copied().collect();
    let numbers = numbers.filter(|numbers| numbers.len() == 2 * n_modes * (2 + n_out + n_struck) + n_out)?;
    let (shapes, rest) = numbers.split_at(numbers.len() - n_out);
    let mut pairs = shapes.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
    let mut row = || -> Vec<Complex> { pairs.by_ref().take(n_modes).collect() };
    let (pole_numbers, start) = (row(), row());
    let poles = kinds.iter().zip(pole_numbers).map(|(kind, [decay, omega])| match kind {
        0 => Some(Pole::Pair { decay, omega }),
        1 => Some(Pole::Real { decay }),
        2 => Some(Pole::Free),
        _ => None,
    });
    Some(ComplexModes {
        poles: poles.collect::<Option<_>>()?,
        start,
        output_shapes: (0..n_out).map(|_| row()).collect(),
        struck_shapes: (0..n_struck).map(|_| row()).collect(),
        rest: rest.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn record_of_modes_and_back() {
        let modes = ComplexModes {
            poles: vec![
                Pole::Free,
                Pole::Real { decay: 0.25 },
                Pole::Pair {
                    decay: 1e-3,
                    omega: 2e4,
                },
            ],
            start: vec![[0.5, -0.0], [1.0, 2.0], [3.0, 4.0]],
            output_shapes: vec![vec![[5.0, 6.0], [7.0, 8.0], [9.0, 1e-300]]],
            struck_shapes: vec![vec![[0.1, 0.2]; 3], vec![[0.3, 0.4]; 3]],
            rest: vec![0.7],
        };
        let record = record_of(&modes).unwrap();
        let read_modes = modes_of(&record, (1, 2)).unwrap();
        assert_eq!(format!("{read_modes:?}"), format!("{modes:?}"));
        for sizes in [(2, 1), (1, 1), (0, 2)] {
            assert!(modes_of(&record, sizes).is_none(), "{sizes:?}");
        }
        let foreign_record = TrialRecord { reason: None, ..record };
        assert!(modes_of(&foreign_record, (1, 2)).is_none());
    }
}
