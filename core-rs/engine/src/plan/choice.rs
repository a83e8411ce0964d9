//! What a plan decided, so that it can be decided the same again.

use std::collections::VecDeque;

use crate::network::Error;

/// What was decided for one island.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Modules of the island: a plan of another score has others.
    pub modules: usize,
    /// How often a frame the island is stepped.
    pub oversampling: u32,
    /// How often a step contacts are computed; 0: the island is a bank of modes.
    pub contact_substeps: usize,
    /// The modes that are computed of each body; of one that goes by another method, which, and its steps.
    pub kept: Vec<Vec<u32>>,
}

impl Choice {
    pub(super) fn is_bank(&self) -> bool {
        self.contact_substeps == 0
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
        message: "it was made for another score or by another version of ergon: make it again"
            .to_owned(),
    }
}
