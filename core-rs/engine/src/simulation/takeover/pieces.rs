//! What passes from one island to another item by item: voices with the reports of their gestures, gates, hands, and
//! which parts are muted.

use std::collections::HashMap;

use super::Takeover;
use crate::island::written_hand::voice::{VoiceTakeover, shared};
use crate::island::{Island, ItemTakeover};
use crate::plan::IslandPlan;
use crate::simulation::side::{Side, UnitIndex};

/// A voice of an old island: the island's place, the island, its plan, and the index of the voice.
type Known<'a> = (UnitIndex, &'a Island, &'a IslandPlan, usize);

impl Takeover {
    /// Matches voices by the MATs that they strike, and the reports of the gestures that both have.
    pub(super) fn voices(&mut self, there: &Side<'_>, here: &Side<'_>, n: u64) {
        let mut by_name: HashMap<(String, bool), Vec<Known<'_>>> = HashMap::new();
        for &(from, island, island_plan) in &there.islands {
            for (voice, voice_script) in island.script().voices.iter().enumerate() {
                let name = (
                    island_plan.network.mat_name(voice_script.struck),
                    voice_script.layer,
                );
                by_name
                    .entry(name)
                    .or_default()
                    .push((from, island, island_plan, voice));
            }
        }
        for &(to, island, island_plan) in &here.islands {
            let script = island.script();
            let limit = island.step_at(n);
            for (voice, voice_script) in script.voices.iter().enumerate() {
                let name = (
                    island_plan.network.mat_name(voice_script.struck),
                    voice_script.layer,
                );
                let Some(candidates) = by_name.get_mut(&name) else {
                    continue;
                };
                // A layer holds one gesture, so it is matched by that; all other gestures of a key share one voice.
                let mut same = None;
                for (index, &(from, old, other, there)) in candidates.iter().enumerate() {
                    let their = &old.script().voices[there];
                    let gestures = shared(
                        (voice_script, &script.gestures),
                        (their, &old.script().gestures),
                    );
                    if voice_script.layer && gestures.is_empty() {
                        continue;
                    }
                    same = Some((index, from, other, there, gestures));
                    break;
                }
                let Some((index, from, other, there, gestures)) = same else {
                    continue;
                };
                let old = candidates.remove(index).1.script();
                let their = &old.voices[there];
                let (name, other_name) = (
                    |mat| island_plan.network.mat_name(mat),
                    |mat| other.network.mat_name(mat),
                );
                let mats = if voice_script.free.is_like(&their.free, name, other_name)
                    && (island_plan.oversampling, island_plan.every)
                        == (other.oversampling, other.every)
                {
                    None
                } else {
                    let known: HashMap<String, usize> = their
                        .free
                        .members
                        .iter()
                        .map(|&mat| other_name(mat))
                        .zip(0..)
                        .collect();
                    let members = voice_script.free.members.iter().enumerate();
                    let pair = |(to, &mat): (usize, &usize)| Some((to, *known.get(&name(mat))?));
                    Some(members.filter_map(pair).collect())
                };
                let begun = gestures
                    .iter()
                    .filter(|pair| old.gestures[pair.0].join_from <= limit);
                for &(there, here) in begun {
                    let is_same = self.units.contains(&(from, to));
                    self.items
                        .push((from, to, ItemTakeover::Report(there, here, is_same)));
                }
                let voice = VoiceTakeover {
                    from: there,
                    to: voice,
                    mats,
                    gestures,
                };
                self.items.push((from, to, ItemTakeover::Voice(voice)));
            }
        }
    }

    /// Matches delayed ports by their names.
    fn ports(&mut self, there: &Side<'_>, here: &Side<'_>) {
        let mut known: HashMap<String, (UnitIndex, usize)> = HashMap::new();
        for &(from, island, island_plan) in &there.islands {
            for (index, binding) in island.script().port_bindings.iter().enumerate() {
                known.insert(island_plan.network.mat_name(binding.port), (from, index));
            }
        }
        for &(to, island, island_plan) in &here.islands {
            for (index, binding) in island.script().port_bindings.iter().enumerate() {
                let name = island_plan.network.mat_name(binding.port);
                if let Some(&(from, before)) = known.get(&name) {
                    self.items
                        .push((from, to, ItemTakeover::Port(before, index)));
                }
            }
        }
    }

    /// Matches gates by their links, hands by their MATs, and, in islands that are the same, the parts that may be
    /// muted.
    pub(super) fn holds(&mut self, there: &Side<'_>, here: &Side<'_>) {
        let mut gates = HashMap::new();
        let mut hands: HashMap<String, Vec<(UnitIndex, usize)>> = HashMap::new();
        for &(from, island, island_plan) in &there.islands {
            for (gate, gate_script) in island.script().gates.iter().enumerate() {
                gates.insert(
                    island_plan.network.link_name(gate_script.link),
                    (from, gate),
                );
            }
            // A hand that several islands touch has a binding in each of them.
            for (hand, gate_script) in island.script().hand_bindings.iter().enumerate() {
                let name = island_plan.network.mat_name(gate_script.mat());
                hands.entry(name).or_default().push((from, hand));
            }
        }
        let has_link = |name: &str| {
            let gate_of = |(unit, island_plan): (UnitIndex, &IslandPlan)| {
                let runs = island_plan.network.runs().iter();
                let mut names = runs.map(|run| island_plan.network.link_name(run.first));
                names.any(|gate_script| gate_script == name).then_some(unit)
            };
            let mut all = there
                .islands
                .iter()
                .map(|&(unit, _, island_plan)| (unit, island_plan));
            all.find_map(gate_of)
        };
        let same: HashMap<UnitIndex, UnitIndex> =
            self.units.iter().map(|&(from, to)| (to, from)).collect();
        for &(to, island, island_plan) in &here.islands {
            let script = island.script();
            for (gate, gate_script) in script.gates.iter().enumerate() {
                let name = island_plan.network.link_name(gate_script.link);
                if let Some(&(from, before)) = gates.get(&name) {
                    let item = ItemTakeover::Gate(Some(before), gate);
                    self.items.push((from, to, item));
                } else if let Some(from) = has_link(&name) {
                    self.items.push((from, to, ItemTakeover::Gate(None, gate)));
                }
            }
            for (hand, gate_script) in script.hand_bindings.iter().enumerate() {
                let Some(known) = hands.get(&island_plan.network.mat_name(gate_script.mat()))
                else {
                    continue;
                };
                let ours = known.iter().find(|(from, _)| same.get(&to) == Some(from));
                if let Some(&(from, before)) = ours.or(known.first()) {
                    self.items
                        .push((from, to, ItemTakeover::Hand(before, hand)));
                }
            }
        }
        self.ports(there, here);
        for &(from, to) in &self.units.clone() {
            let island = |side: &Side<'_>, unit: UnitIndex| {
                let mut all = side.islands.iter();
                all.find(|island| island.0 == unit)
                    .map(|island| island.2.network.clone())
            };
            let (Some(gate_script), Some(their)) = (island(here, to), island(there, from)) else {
                continue;
            };
            let mut parts: Vec<(u32, u32)> = {
                let (gate_script, their) = (&gate_script.mats().part, &their.mats().part);
                their
                    .iter()
                    .copied()
                    .zip(gate_script.iter().copied())
                    .collect()
            };
            parts.sort_unstable();
            parts.dedup();
            for (there, gate_script) in parts {
                let item = ItemTakeover::Part(there as usize, gate_script as usize);
                self.items.push((from, to, item));
            }
        }
    }
}
