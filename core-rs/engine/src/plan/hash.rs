//! A hash of what a plan decided: two plans of one score with the same hash give the same sound.

use crate::assembly::audible::ModeKind;
use crate::assembly::choice::Choice;
use crate::content::{Hasher, hex};
use crate::island::ContactOrder;
use crate::plan::row::{Computation, LeftOutReason, PlanRow};

/// A hash of decisions, and of the rows that they concern.
pub(in crate::plan) fn hash(choices: &[Choice], rows: &[PlanRow]) -> String {
    let mut hasher = Hasher::new();
    for row in rows {
        for part in &row.parts {
            hasher.add((part.len() as u64).to_le_bytes());
            hasher.add(part);
        }
        let computation_code: u64 = match row.computation {
            Computation::Stepped => 0,
            Computation::Oscillators => 1,
            Computation::Modes {
                kind: ModeKind::Normal, ..
            } => 2,
            Computation::Modes {
                kind: ModeKind::Complex,
                ..
            } => 7,
            Computation::Mesh(..) => 3,
            Computation::Slow { is_exact: true, .. } => 6,
            Computation::Slow { .. } => 8,
            Computation::LeftOut(LeftOutReason::Unheard) => 4,
            Computation::LeftOut(LeftOutReason::Motionless) => 5,
        };
        let numbers = [
            row.parts.len() as u64,
            row.n_mats as u64,
            row.n_links as u64,
            computation_code,
        ];
        numbers.iter().for_each(|number| hasher.add(number.to_le_bytes()));
    }
    for choice in choices {
        let (modules, oversampling, contact_substeps, body_numbers, counted_cost, contact_order) = choice.numbers();
        let numbers = [
            modules,
            oversampling as usize,
            contact_substeps,
            counted_cost.map_or(0, |ns| ns as usize + 1),
            body_numbers.len(),
        ];
        numbers
            .iter()
            .for_each(|&number| hasher.add((number as u64).to_le_bytes()));
        // Older plans stored no contact order; hashing only non-defaults keeps their hashes.
        if contact_order != ContactOrder::default().number() {
            hasher.add(u64::from(contact_order).to_le_bytes());
        }
        for body in &body_numbers {
            hasher.add((body.len() as u64).to_le_bytes());
            body.iter().for_each(|number| hasher.add(number.to_le_bytes()));
        }
    }
    hex(&hasher.finish())
}
