//! What a plan decided, kept so that the same can be decided again.

use std::collections::VecDeque;

use crate::integrate::MeshMethod;
use crate::island::ContactOrder;
use crate::network::Error;

/// What was decided for one island.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Number of modules of the island, to detect a plan of another score.
    pub(crate) n_modules: usize,
    /// How it is computed.
    pub(crate) method: IslandMethod,
}

/// How an island is computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum IslandMethod {
    /// As a bank of these modes, rising.
    Bank(Vec<u32>),
    /// Step by step.
    Stepped(SteppedChoice),
}

/// How an island is stepped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SteppedChoice {
    /// Steps a frame of the island.
    pub(crate) oversampling: u32,
    /// Contact substeps a step.
    pub(crate) contact_substeps: usize,
    /// Their order.
    pub(crate) contact_order: ContactOrder,
    /// Work that depends on the motion, as a trial counted it [ns a frame]; `None`: not counted.
    pub(crate) counted_cost: Option<u32>,
    /// The bodies that are computed by methods of their own.
    pub(crate) bodies: Vec<BodyChoice>,
}

/// How a body of a stepped island is computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum BodyChoice {
    /// By these modes, rising.
    Modes(Vec<u32>),
    /// As a mesh by a method of its own.
    Mesh(MeshChoice),
    /// Once in `macrostep` steps of the island.
    Slow {
        /// Steps of the island, at least 1.
        macrostep: u32,
    },
}

/// By which method a mesh is stepped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MeshChoice {
    /// The method.
    pub(crate) method: MeshMethod,
    /// Steps a step of the island, at least 1.
    pub(crate) substeps: u32,
    /// The mesh is stepped although it could be computed by modes.
    pub(crate) replaces_modes: bool,
}

/// A [`Choice`] as numbers: modules, steps a frame, contact substeps a step, numbers of each body, counted cost and the
/// order of contacts. A bank is one body, with one step a frame.
pub type ChoiceNumbers = (usize, u32, usize, Vec<Vec<u32>>, Option<u32>, u32);

/// The first number of a body, which says what the others are.
mod body_kind {
    pub(super) const MODES: u32 = 0;
    pub(super) const MESH: u32 = 1;
    pub(super) const SLOW: u32 = 2;
    pub(super) const BANK: u32 = 3;
}

impl Choice {
    /// The choice as numbers that can be written and read.
    pub fn numbers(&self) -> ChoiceNumbers {
        match &self.method {
            IslandMethod::Bank(modes) => {
                let contact_order = ContactOrder::default().number();
                (
                    self.n_modules,
                    1,
                    1,
                    vec![with_kind(body_kind::BANK, modes)],
                    None,
                    contact_order,
                )
            }
            IslandMethod::Stepped(stepped) => {
                let body_numbers = stepped.bodies.iter().map(BodyChoice::numbers).collect();
                (
                    self.n_modules,
                    stepped.oversampling,
                    stepped.contact_substeps,
                    body_numbers,
                    stepped.counted_cost,
                    stepped.contact_order.number(),
                )
            }
        }
    }

    /// The choice that [`Choice::numbers`] wrote.
    ///
    /// # Errors
    /// [`Error::Refused`] if no choice has these numbers.
    pub fn from_numbers(
        (modules, oversampling, contact_substeps, bodies, counted_cost, contact_order): ChoiceNumbers,
    ) -> Result<Self, Error> {
        let method = match &bodies[..] {
            [body] if body.first() == Some(&body_kind::BANK) => IslandMethod::Bank(body[1..].to_vec()),
            bodies => IslandMethod::Stepped(SteppedChoice {
                oversampling: oversampling.max(1),
                contact_substeps: contact_substeps.max(1),
                contact_order: ContactOrder::from_number(contact_order).ok_or_else(wrong_plan_error)?,
                counted_cost,
                bodies: BodyChoice::all_from_numbers(bodies).ok_or_else(wrong_plan_error)?,
            }),
        };
        Ok(Self {
            n_modules: modules,
            method,
        })
    }
}

impl BodyChoice {
    /// The choice as numbers; the first says what the others are.
    pub(crate) fn numbers(&self) -> Vec<u32> {
        match self {
            Self::Modes(modes) => with_kind(body_kind::MODES, modes),
            Self::Mesh(mesh) => vec![
                body_kind::MESH,
                MeshMethod::ALL
                    .iter()
                    .position(|&method| method == mesh.method)
                    .unwrap_or(0) as u32,
                mesh.substeps,
                u32::from(mesh.replaces_modes),
            ],
            Self::Slow { macrostep } => vec![body_kind::SLOW, *macrostep],
        }
    }

    /// The choices that these numbers say; `None` if any of them says none.
    pub(crate) fn all_from_numbers(bodies: &[Vec<u32>]) -> Option<Vec<Self>> {
        bodies.iter().map(|numbers| Self::from_numbers(numbers)).collect()
    }

    fn from_numbers(numbers: &[u32]) -> Option<Self> {
        match *numbers {
            [body_kind::MODES, ref modes @ ..] => Some(Self::Modes(modes.to_vec())),
            [body_kind::MESH, method, substeps @ 1..=u32::MAX, replaces_modes @ 0..=1] => {
                Some(Self::Mesh(MeshChoice {
                    method: *MeshMethod::ALL.get(method as usize)?,
                    substeps,
                    replaces_modes: replaces_modes == 1,
                }))
            }
            [body_kind::SLOW, macrostep @ 1..=u32::MAX] => Some(Self::Slow { macrostep }),
            _ => None,
        }
    }
}

fn with_kind(kind: u32, modes: &[u32]) -> Vec<u32> {
    [&[kind], modes].concat()
}

/// Decisions that were made before, if any.
pub(crate) struct PinnedChoices(Option<VecDeque<Choice>>);

impl PinnedChoices {
    pub(crate) fn new(choices: Option<Vec<Choice>>) -> Self {
        Self(choices.map(VecDeque::from))
    }

    /// What was decided for the next island.
    pub(crate) fn next_for_island(&mut self, n_modules: usize) -> Result<Option<Choice>, Error> {
        let Some(pin_queue) = &mut self.0 else {
            return Ok(None);
        };
        match pin_queue.pop_front() {
            Some(choice) if choice.n_modules == n_modules => Ok(Some(choice)),
            _ => Err(wrong_plan_error()),
        }
    }

    /// Checks that no decisions are left over.
    pub(crate) fn check_all_used(&self) -> Result<(), Error> {
        match &self.0 {
            Some(unused_choices) if !unused_choices.is_empty() => Err(wrong_plan_error()),
            _ => Ok(()),
        }
    }
}

pub(crate) fn wrong_plan_error() -> Error {
    Error::Refused {
        module: "plan".to_owned(),
        message: "it was made for another score or by another version of ergon: make it again".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choice_numbers_of_each_kind() {
        let mesh_choice = |replaces_modes| {
            BodyChoice::Mesh(MeshChoice {
                method: MeshMethod::Bm4,
                substeps: 4,
                replaces_modes,
            })
        };
        let stepped = |bodies| {
            IslandMethod::Stepped(SteppedChoice {
                oversampling: 2,
                contact_substeps: 2,
                contact_order: ContactOrder::Second,
                counted_cost: Some(0),
                bodies,
            })
        };
        // These two were the same numbers before the first one said which they are.
        let alike_bodies = [BodyChoice::Modes(vec![3]), BodyChoice::Slow { macrostep: 3 }];
        let bodies = [
            vec![mesh_choice(true), mesh_choice(false)],
            alike_bodies.to_vec(),
            Vec::new(),
        ];
        let bank_methods = [vec![0, 2, 9], Vec::new()].map(IslandMethod::Bank);
        for method in bodies.map(stepped).into_iter().chain(bank_methods) {
            let choice = Choice { n_modules: 7, method };
            assert_eq!(Choice::from_numbers(choice.numbers()).unwrap(), choice);
        }
    }

    #[test]
    fn choice_numbers_of_no_kind_are_refused() {
        let wrong_bodies: [&[u32]; 7] = [
            &[],
            &[4],
            &[1, 2, 2],
            &[1, 99, 1, 0],
            &[1, 2, 0, 0],
            &[2, 0],
            &[2, 1, 1],
        ];
        for body in wrong_bodies {
            let numbers = (7, 1, 1, vec![body.to_vec()], None, 4);
            assert!(Choice::from_numbers(numbers).is_err(), "{body:?}");
        }
        // A bank is one body.
        let numbers = (7, 1, 1, vec![vec![3, 0], vec![0, 1]], None, 4);
        assert!(Choice::from_numbers(numbers).is_err());
    }
}
