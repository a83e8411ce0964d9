//! What passes from one island to another item by item: voices with the reports of their gestures, gates, hands, and
//! which parts are muted.

use std::collections::HashMap;

use super::Takeover;
use crate::assembly::unit::IslandPlan;
use crate::island::written_hand::voice::{VoiceTakeover, equal_gestures};
use crate::island::{Island, ItemTakeover};
use crate::simulation::side::{TakeoverSide, UnitIndex};

/// A voice of an old island: the island's unit, the island, its plan, and the index of the voice.
type OldVoice<'a> = (UnitIndex, &'a Island, &'a IslandPlan, usize);

impl Takeover {
    /// Matches voices by the MATs that they strike, and the reports of the gestures that both have.
    pub(super) fn match_voices(
        &mut self,
        old_side: &TakeoverSide<'_>,
        new_side: &TakeoverSide<'_>,
        takeover_frame: u64,
    ) {
        let mut voices_by_name: HashMap<(String, bool), Vec<OldVoice<'_>>> = HashMap::new();
        for &(old_unit, island, island_plan) in &old_side.islands {
            for (old_voice_index, voice_script) in island.script().voices.iter().enumerate() {
                let struck_name = island_plan.network.mat_name(voice_script.struck_mat);
                let voice_name = (struck_name, voice_script.is_layer);
                let voices = voices_by_name.entry(voice_name).or_default();
                voices.push((old_unit, island, island_plan, old_voice_index));
            }
        }
        for &(new_unit, island, island_plan) in &new_side.islands {
            let island_script = island.script();
            let takeover_step = island.step_at(takeover_frame);
            for (new_voice_index, voice_script) in island_script.voices.iter().enumerate() {
                let struck_name = island_plan.network.mat_name(voice_script.struck_mat);
                let voice_name = (struck_name, voice_script.is_layer);
                let Some(candidates) = voices_by_name.get_mut(&voice_name) else {
                    continue;
                };
                // A layer holds one gesture, so it is matched by that; all other gestures of a key share one voice.
                let mut matching_voice = None;
                for (candidate_index, &(old_unit, old, old_plan, old_voice_index)) in candidates.iter().enumerate() {
                    let old_voice = &old.script().voices[old_voice_index];
                    let gestures = equal_gestures(
                        (voice_script, &island_script.gestures),
                        (old_voice, &old.script().gestures),
                    );
                    if voice_script.is_layer && gestures.is_empty() {
                        continue;
                    }
                    matching_voice = Some((candidate_index, old_unit, old_plan, old_voice_index, gestures));
                    break;
                }
                let Some((candidate_index, old_unit, old_plan, old_voice_index, gesture_pairs)) = matching_voice else {
                    continue;
                };
                let old = candidates.remove(candidate_index).1.script();
                let old_voice = &old.voices[old_voice_index];
                let (new_name_of, old_name_of) = (
                    |mat| island_plan.network.mat_name(mat),
                    |mat| old_plan.network.mat_name(mat),
                );
                let (free_key, old_key) = (&voice_script.free_key, &old_voice.free_key);
                let new_and_old_mats = if free_key.is_compatible_with(old_key, new_name_of, old_name_of)
                    && (island_plan.oversampling, island_plan.frame_interval)
                        == (old_plan.oversampling, old_plan.frame_interval)
                {
                    None
                } else {
                    let old_mats = old_key.scene_mats.iter().map(|&mat| old_name_of(mat));
                    let old_members: HashMap<String, usize> = old_mats.zip(0..).collect();
                    let members = free_key.scene_mats.iter().enumerate();
                    let index_pair =
                        |(new_member, &mat): (usize, &usize)| Some((new_member, *old_members.get(&new_name_of(mat))?));
                    Some(members.filter_map(index_pair).collect())
                };
                let begun_gestures = gesture_pairs
                    .iter()
                    .filter(|index_pair| old.gestures[index_pair.0].join_frame <= takeover_step);
                for &(old_gesture, new_gesture) in begun_gestures {
                    let is_same_unit = self.same_units.contains(&(old_unit, new_unit));
                    let report = ItemTakeover::GestureReport(old_gesture, new_gesture, is_same_unit);
                    self.items.push((old_unit, new_unit, report));
                }
                let voice = VoiceTakeover {
                    old_voice: old_voice_index,
                    new_voice: new_voice_index,
                    new_and_old_mats,
                    gesture_pairs,
                };
                self.items.push((old_unit, new_unit, ItemTakeover::Voice(voice)));
            }
        }
    }

    /// Matches delayed ports by their names.
    fn match_ports(&mut self, old_side: &TakeoverSide<'_>, new_side: &TakeoverSide<'_>) {
        let mut old_ports: HashMap<String, (UnitIndex, usize)> = HashMap::new();
        for &(old_unit, island, island_plan) in &old_side.islands {
            for (index, binding) in island.script().port_bindings.iter().enumerate() {
                old_ports.insert(island_plan.network.mat_name(binding.port_mat), (old_unit, index));
            }
        }
        for &(new_unit, island, island_plan) in &new_side.islands {
            for (index, binding) in island.script().port_bindings.iter().enumerate() {
                let port_name = island_plan.network.mat_name(binding.port_mat);
                if let Some(&(old_unit, old_index)) = old_ports.get(&port_name) {
                    self.items
                        .push((old_unit, new_unit, ItemTakeover::Port(old_index, index)));
                }
            }
        }
    }

    /// Matches gates by their links, hands by their MATs, and, in islands that are the same, the parts that may be
    /// muted.
    pub(super) fn match_gates_hands_and_parts(&mut self, old_side: &TakeoverSide<'_>, new_side: &TakeoverSide<'_>) {
        let mut old_gates = HashMap::new();
        let mut old_hands: HashMap<String, Vec<(UnitIndex, usize)>> = HashMap::new();
        for &(old_unit, island, island_plan) in &old_side.islands {
            for (gate, gate_script) in island.script().gates.iter().enumerate() {
                old_gates.insert(island_plan.network.link_name(gate_script.first_link), (old_unit, gate));
            }
            // A hand that several islands touch has a binding in each of them.
            for (hand, binding) in island.script().hand_bindings.iter().enumerate() {
                let match_name = island_plan.network.mat_name(binding.mat());
                old_hands.entry(match_name).or_default().push((old_unit, hand));
            }
        }
        let old_unit_with_link = |match_name: &str| {
            let unit_with_link = |(unit, island_plan): (UnitIndex, &IslandPlan)| {
                let network_runs = island_plan.network.runs().iter();
                let mut link_names = network_runs.map(|run| island_plan.network.link_name(run.first));
                link_names.any(|link_name| link_name == match_name).then_some(unit)
            };
            let mut side_islands = old_side
                .islands
                .iter()
                .map(|&(unit, _, island_plan)| (unit, island_plan));
            side_islands.find_map(unit_with_link)
        };
        let unit_origins: HashMap<UnitIndex, UnitIndex> = self
            .same_units
            .iter()
            .map(|&(old_unit, new_unit)| (new_unit, old_unit))
            .collect();
        for &(new_unit, island, island_plan) in &new_side.islands {
            let island_script = island.script();
            for (gate, gate_script) in island_script.gates.iter().enumerate() {
                let match_name = island_plan.network.link_name(gate_script.first_link);
                if let Some(&(old_unit, old_index)) = old_gates.get(&match_name) {
                    let passed_item = ItemTakeover::Gate(Some(old_index), gate);
                    self.items.push((old_unit, new_unit, passed_item));
                } else if let Some(old_unit) = old_unit_with_link(&match_name) {
                    self.items.push((old_unit, new_unit, ItemTakeover::Gate(None, gate)));
                }
            }
            for (hand, binding) in island_script.hand_bindings.iter().enumerate() {
                let Some(old_bindings) = old_hands.get(&island_plan.network.mat_name(binding.mat())) else {
                    continue;
                };
                let same_binding = old_bindings
                    .iter()
                    .find(|(old_unit, _)| unit_origins.get(&new_unit) == Some(old_unit));
                if let Some(&(old_unit, old_index)) = same_binding.or(old_bindings.first()) {
                    self.items
                        .push((old_unit, new_unit, ItemTakeover::Hand(old_index, hand)));
                }
            }
        }
        self.match_ports(old_side, new_side);
        for &(old_unit, new_unit) in &self.same_units.clone() {
            let network_of = |side: &TakeoverSide<'_>, unit: UnitIndex| {
                let mut side_islands = side.islands.iter();
                side_islands
                    .find(|island| island.0 == unit)
                    .map(|island| island.2.network.clone())
            };
            let (Some(new_network), Some(old_network)) =
                (network_of(new_side, new_unit), network_of(old_side, old_unit))
            else {
                continue;
            };
            let mut part_pairs: Vec<(u32, u32)> = {
                let (new_parts, old_parts) = (&new_network.mats().part, &old_network.mats().part);
                old_parts.iter().copied().zip(new_parts.iter().copied()).collect()
            };
            part_pairs.sort_unstable();
            part_pairs.dedup();
            for (old_part, new_part) in part_pairs {
                let passed_item = ItemTakeover::MutedPart(old_part as usize, new_part as usize);
                self.items.push((old_unit, new_unit, passed_item));
            }
        }
    }
}
