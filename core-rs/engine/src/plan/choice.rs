//! What a plan decided, so that it can be decided the same again.

use std::collections::VecDeque;

use sha2::{Digest, Sha256};

use super::row::{Reason, Row, What};
use crate::network::Error;

/// What was decided for one island.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Modules of the island: a plan of another score has others.
    pub modules: usize,
    /// How often a frame the island is stepped.
    pub times: u32,
    /// How often a step contacts are computed; 0: the island is a bank of modes.
    pub steps: usize,
    /// The modes that are computed of each body; of one that goes by another method, which, and its steps.
    pub kept: Vec<Vec<u32>>,
}

impl Choice {
    pub(super) fn is_bank(&self) -> bool {
        self.steps == 0
    }
}

/// Decisions that were made before; empty where none were.
pub(super) struct Pins(Option<VecDeque<Choice>>);

impl Pins {
    pub(super) fn new(pins: Option<Vec<Choice>>) -> Self {
        Self(pins.map(VecDeque::from))
    }

    /// What was decided for the next island.
    pub(super) fn next(&mut self, modules: usize) -> Result<Option<Choice>, Error> {
        let Some(pins) = &mut self.0 else {
            return Ok(None);
        };
        match pins.pop_front() {
            Some(choice) if choice.modules == modules => Ok(Some(choice)),
            _ => Err(another()),
        }
    }

    /// That is all there were.
    pub(super) fn end(&self) -> Result<(), Error> {
        match &self.0 {
            Some(left) if !left.is_empty() => Err(another()),
            _ => Ok(()),
        }
    }
}

pub(super) fn another() -> Error {
    Error::Refused {
        module: "plan".to_owned(),
        message: "it was made for another score, or by another version: make it anew".to_owned(),
    }
}

/// A hash of decisions, and of what they are about.
pub(super) fn hash(choices: &[Choice], rows: &[Row]) -> String {
    let mut sha = Sha256::new();
    for row in rows {
        for part in &row.parts {
            sha.update((part.len() as u64).to_le_bytes());
            sha.update(part);
        }
        let what: u64 = match row.what {
            What::Stepped => 0,
            What::Oscillators => 1,
            What::Modes { .. } => 2,
            What::Mesh(..) => 3,
            What::Slow(_) => 6,
            What::LeftOut(Reason::Unheard) => 4,
            What::LeftOut(Reason::Still) => 5,
        };
        let numbers = [
            row.parts.len() as u64,
            row.mats as u64,
            row.links as u64,
            what,
        ];
        numbers
            .iter()
            .for_each(|number| sha.update(number.to_le_bytes()));
    }
    for choice in choices {
        let times = choice.times as usize;
        let numbers = [choice.modules, times, choice.steps, choice.kept.len()];
        numbers
            .iter()
            .for_each(|&number| sha.update((number as u64).to_le_bytes()));
        for kept in &choice.kept {
            sha.update((kept.len() as u64).to_le_bytes());
            kept.iter().for_each(|mode| sha.update(mode.to_le_bytes()));
        }
    }
    sha.finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}
