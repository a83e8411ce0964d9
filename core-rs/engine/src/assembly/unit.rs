//! Units of computation: islands and banks of oscillators, as they are computed.

use std::sync::Arc;

use crate::bank::{Oscillator, Strikes};
use crate::body_modes::complex_modes::ComplexPart;
use crate::island::bodies::BodyPlan;
use crate::island::{ContactOrder, FINE_SUBSTEPS_MIN, StepNumbers};
use crate::network::Network;
use crate::timeline::Timeline;

/// One island as it will be computed: modules that can touch each other, and their events.
#[derive(Clone, Debug)]
pub(crate) struct IslandPlan {
    pub(crate) network: Arc<Network>,
    pub(crate) timeline: Timeline,
    /// Its bodies that are computed by a method of their own.
    pub(crate) bodies: Vec<BodyPlan>,
    /// Contact substeps a frame while a contact may be closed.
    pub(crate) contact_substeps: usize,
    /// The order of the fewest substeps; more are of order 4.
    pub(crate) contact_order: ContactOrder,
    /// Work that depends on the motion, as a trial counted it [ns a frame]; `None`: the table estimates that of laws.
    pub(crate) counted_cost: Option<u32>,
    /// Steps of the whole island in `frame_interval` frames: its timeline runs at this multiple of the rate.
    pub(crate) oversampling: u32,
    /// 1, except for what is only seen.
    pub(crate) frame_interval: u32,
    /// Whether it is stopped when nobody hears it any more.
    pub(crate) stops_when_silent: bool,
    pub(crate) network_indices: NetworkIndices,
}

impl IslandPlan {
    /// The outputs of the scene that hear it, in its order.
    pub(crate) fn scene_outputs(&self) -> impl Iterator<Item = usize> {
        let local_outputs = 0..self.network.outputs().len();
        local_outputs.map(|local| to_network_index(&self.network_indices.outputs, local))
    }

    /// Its steps, with these contact substeps.
    pub(crate) fn step_numbers(&self, contact_substeps: usize) -> StepNumbers {
        StepNumbers {
            contact_substeps,
            contact_order: match contact_substeps {
                FINE_SUBSTEPS_MIN => self.contact_order,
                _ => ContactOrder::Fourth,
            },
            oversampling: self.oversampling,
            frame_interval: self.frame_interval,
        }
    }
}

/// Local index → index in the whole network; `None` if the island is the whole network.
#[derive(Clone, Debug, Default)]
pub(crate) struct NetworkIndices {
    pub(crate) mats: Option<Vec<u32>>,
    pub(crate) outputs: Option<Vec<u32>>,
    pub(crate) keys: Option<Vec<u32>>,
    pub(crate) gestures: Option<Vec<u32>>,
}

/// The index in the whole network of a local index.
pub(crate) fn to_network_index(map: &Option<Vec<u32>>, local: usize) -> usize {
    map.as_ref().map_or(local, |map| map[local] as usize)
}

/// Uncoupled oscillators.
#[derive(Clone, Debug, Default)]
pub(crate) struct BankPlan {
    pub(crate) oscillators: Vec<Oscillator>,
    pub(crate) strikes: Vec<Strikes>,
    /// The part that the CELs belong to, if it has banks of its own.
    pub(crate) part: Option<u32>,
    /// The MAT of each oscillator, and where it rests; empty for modes.
    pub(crate) mats_and_rests: Vec<(u32, f64)>,
    /// The body whose modes they are; `None` for MATs.
    pub(crate) body: Option<Arc<Network>>,
    /// Which modes of the body they are.
    pub(crate) computed_modes: Vec<u32>,
    /// MATs of the body towards which modes of the same frequency were turned; `None` if modes were not turned.
    pub(crate) rotation_mats: Option<Vec<usize>>,
    /// For complex modes: the body, and which part of which mode each oscillator is.
    pub(crate) complex: Option<(Arc<Network>, Vec<ComplexPart>)>,
    /// Further strikes may come that are not known yet.
    pub(crate) is_open: bool,
}

impl BankPlan {
    /// The frame up to which it gives 0, if nothing comes from outside: that of its first blow.
    pub(crate) fn silent_until_frame(&self) -> u64 {
        let is_resting = |oscillator: &Oscillator| oscillator.position == 0.0 && oscillator.previous_position == 0.0;
        if self.is_open || !self.oscillators.iter().all(is_resting) {
            return 0;
        }
        let bank_blows = self.oscillators.iter().flat_map(|oscillator| &oscillator.blows);
        let strikes = self.strikes.iter().flat_map(|strikes| &strikes.blows);
        let blow_frames = bank_blows.map(|blow| blow.frame).chain(strikes.map(|blow| blow.0));
        blow_frames.min().unwrap_or(u64::MAX)
    }
}

/// One unit of computation: an island or a bank.
#[derive(Clone, Debug)]
pub(crate) enum ComputationUnit {
    IslandPlan(Box<IslandPlan>),
    Bank(BankPlan),
}
