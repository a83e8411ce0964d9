//! What a plan decided, kept so that the same can be decided again.

use std::collections::VecDeque;

use crate::network::Error;

/// What was decided for one island.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Number of modules of the island, to detect a plan of another score.
    pub modules: usize,
    /// Steps a frame of the island.
    pub oversampling: u32,
    /// Contact substeps a step; 0: the island is a bank of modes.
    pub contact_substeps: usize,
    /// Work that depends on the motion, as a trial counted it [ns a frame]; `None`: not counted.
    pub counted_cost: Option<u32>,
    /// For each body, the modes that are computed; for a mesh its method and steps, for a slow body its macrostep.
    pub body_methods: Vec<Vec<u32>>,
}

impl Choice {
    pub(super) fn is_bank(&self) -> bool {
        self.contact_substeps == 0
    }
}

/// Decisions that were made before, if any.
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
            _ => Err(wrong_plan_error()),
        }
    }

    /// Checks that no decisions are left over.
    pub(super) fn end(&self) -> Result<(), Error> {
        match &self.0 {
            Some(left) if !left.is_empty() => Err(wrong_plan_error()),
            _ => Ok(()),
        }
    }
}

pub(super) fn wrong_plan_error() -> Error {
    Error::Refused {
        module: "plan".to_owned(),
        message: "it was made for another score or by another version of ergon: make it again"
            .to_owned(),
    }
}
