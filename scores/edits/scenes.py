"""Brings back a scene: plays the bars of a kept score repeatedly, from their beginning."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ergon.instruments.model import Instrument
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length
from ergon.notation.tables.fields import Values
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits import automation, entries, matter, parts, scene_patterns, times
from ergon.scores.edits import strikes as strikes_edits
from ergon.scores.edits.entries import Entry, PlacedEntry
from ergon.scores.edits.lists import entry_path, section_entries
from ergon.scores.edits.names import free_name
from ergon.scores.edits.positions import endless_end, position_text
from ergon.scores.edits.strikes import melody_entry
from ergon.scores.edits.texts import Texts
from ergon.scores.pattern.search import n_before
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.pattern.values import Amount
from ergon.scores.reading import automatable
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.playing import Key
from ergon.scores.reading.uses import Names

END_MARK = "end"  # the mark at which a scene begins again


@dataclass(frozen=True, slots=True)
class Scene:
    """A score whose bars are brought back, and their length [beats]."""

    texts: Texts
    piece: Piece
    beats: float

    @classmethod
    def from_texts(cls, texts: Texts, piece: Piece) -> Scene:
        """The scene of a score: up to its mark `end`, or to the bar line after its last start."""
        tempo = piece.tempo_map
        end_mark = next((mark for mark in piece.marks if mark.name == END_MARK), None)
        if end_mark is not None and (beats := tempo.resolve(end_mark.at)) > SAME:
            return cls(texts, piece, beats)
        last_start = max(
            (beat for part_starts in piece.starts for beat in (part_starts or ())[-1:]), default=0.0
        )
        bar, _ = tempo.bar_beat(last_start + SAME)
        return cls(texts, piece, tempo.bars.start(bar + 1))


def play_scene(
    score_texts: Texts,
    piece: Piece,
    scene: Scene,
    from_beat: float,
    until_beat: float | None = None,
) -> Texts:
    """Play a scene from a beat on, repeatedly until `until` or another scene; everything else ends.

    Its gestures, takes, couplings, strikes and automation are brought in. `piece` is the piece
    of `score_texts`. Raises EditError.
    """
    known_names = score_texts.load().names
    missing_player = next((name for name in scene.piece.players if name not in piece.players), None)
    if missing_player is not None and any(
        play.player == missing_player for play in scene.piece.parts
    ):
        raise EditError(f"this score has no player {missing_player}, who plays in the scene")
    for strikes in piece.strikes:
        score_texts = strikes_edits.end_strikes(score_texts, piece, strikes, from_beat)
    stop_text = (
        endless_end(piece, from_beat) if until_beat is None else position_text(piece, until_beat)
    )
    limit_beat = math.inf if until_beat is None else until_beat - SAME
    part_edits = []
    for player in piece.players:
        scene_players = scene.piece.players
        scene_lines = (
            entries.placed_entries(scene.texts, scene.piece, player)
            if player in scene_players
            else []
        )
        new_entries = [
            entry.with_fields(at=position_text(piece, from_beat + begin), until=stop_text)
            for line in scene_lines
            for begin, entry in _repeated_entries(line, scene.beats)
            if from_beat + begin < limit_beat
        ]
        part_edits.append(
            parts.part_edit_ending_at(score_texts, piece, player, from_beat, new_entries)
        )
    score_texts = entries.with_part_edits(score_texts, *part_edits)
    score_texts = _with_definitions(score_texts, known_names, scene)
    score_texts = _with_couplings(
        score_texts, piece, scene, from_beat, None if until_beat is None else stop_text
    )
    for strikes in scene.piece.strikes:
        score_texts = _with_strikes(
            score_texts, piece, scene, strikes, from_beat, limit_beat, stop_text
        )
    return _with_automation(
        score_texts, piece, scene, from_beat, limit_beat, None if until_beat is None else stop_text
    )


def released_parameters(piece: Piece, scene: Scene, release_beat: float) -> list[str]:
    """Parameters whose automation a scene ends on a beat because it does not automate them
    itself.
    """
    scene_names = {entry.name for entry in scene.piece.automation}
    automated_names = (
        entry.name
        for entry in piece.automation
        if automation.is_automated_from(piece, entry, release_beat)
    )
    return [name for name in dict.fromkeys(automated_names) if name not in scene_names]


def with_scene_tempo(
    score_texts: Texts, piece: Piece, scene: Scene, from_beat: float, ramp_length: str | None = None
) -> Texts:
    """Set the tempo to that of a scene, by a ramp `over` a length if given. Raises EditError."""
    old_bpm, bpm = piece.tempo_map.bpm(from_beat), scene.piece.tempo_map.bpm(0.0)
    if abs(old_bpm - bpm) < SAME:
        return score_texts
    if ramp_length is None:
        return times.change_tempo(score_texts, piece, from_beat, f"{bpm:.12g}")
    return times.change_tempo(
        score_texts, piece, from_beat, f"{old_bpm:.12g} -> {bpm:.12g}", ramp_length
    )


def with_scene_values(score_texts: Texts, piece: Piece, scene: Scene) -> Texts:
    """Set parameters to the values of a scene.

    The text has no glide: the version says how long the parameters glide. Raises EditError.
    """
    for target, value in _changed_parameters(piece, scene.piece):
        score_texts = matter.set_value(score_texts, piece, target, value)
    return score_texts


def has_events_from(piece: Piece, from_beat: float) -> bool:
    """Whether anything of a piece begins or ends on a beat or later; True also for a piece without
    events.
    """
    tempo = piece.tempo_map
    event_beats = [tempo.resolve(play.at) for play in piece.parts]
    event_beats += [part_starts[-1] for part_starts in piece.starts if part_starts]
    for strikes in piece.strikes:
        begin_beat = tempo.resolve(strikes.at)
        if strikes.rhythm is None:
            event_beats += [beat for beat, *_ in strikes.played_hits(piece)]
        elif strikes.until is None and strikes.span is None:
            event_beats.append(strikes.rhythm.cycle_begin(tempo, begin_beat, strikes.cycles(tempo)))
        event_beats.append(begin_beat if strikes.until is None else tempo.resolve(strikes.until))
        if strikes.span is not None:
            event_beats.append(tempo.after(begin_beat, strikes.span))
    return not event_beats or max(event_beats) >= from_beat - SAME


def _repeated_entries(
    placed_entry: PlacedEntry, scene_beats: float
) -> Iterator[tuple[float, Entry]]:
    """The entries that repeat an entry every `scene_beats`, each with its first beat."""
    repeated_entry = placed_entry.entry.with_fields(times=None, until=None)
    if isinstance(placed_entry.start_beats, PlaceBeats):
        yield from scene_patterns.repeated_entries(
            repeated_entry,
            placed_entry.start_beats,
            placed_entry.count_before(scene_beats),
            scene_beats,
        )
        return
    repeated_entry = repeated_entry.with_step(f"{scene_beats:.12g}")
    begin_beats = (
        [placed_entry.begin_beat]
        if placed_entry.start_beats is None
        else [*placed_entry.start_beats]
    )
    begin_beats = [begin for begin in begin_beats if begin < scene_beats - SAME]
    step_beats = scene_beats / len(begin_beats) if begin_beats else scene_beats
    if len(begin_beats) > 1 and all(
        abs(begin - begin_beats[0] - number * step_beats) < SAME
        for number, begin in enumerate(begin_beats)
    ):
        yield begin_beats[0], repeated_entry.with_step(f"{step_beats:.12g}")
        return
    for begin in begin_beats:
        yield begin, repeated_entry


def _with_definitions(score_texts: Texts, known_names: Names | None, scene: Scene) -> Texts:
    """Write the gestures and takes of a scene that are missing `known_names`, or that differ."""
    scene_names = scene.texts.load().names
    assert known_names is not None  # a score without a text has no scenes
    assert scene_names is not None
    for section_name in ("gestures", "takes"):
        for definition_name, scene_entry in scene_names.tables[section_name].items():
            definition = known_names.tables[section_name].get(definition_name)
            if not isinstance(scene_entry.values, Values):
                continue
            entry_node = scene_entry.values.node
            definition_tree = edit.tree(entry_node)
            if definition is None:
                if (
                    entry_node.document.file == scene.texts.path
                ):  # files that it uses are used here too
                    score_texts = score_texts.put(
                        (section_name, definition_name), edit.flow(definition_tree)
                    )
            elif (
                isinstance(definition.values, Values)
                and edit.tree(definition.values.node) != definition_tree
            ):
                path = section_name, definition.values.context.name
                score_texts = score_texts.put(
                    path, edit.flow(definition_tree), definition.values.node.document.file
                )
    return score_texts


def _changed_parameters(piece: Piece, scene_piece: Piece) -> Iterator[tuple[str, str]]:
    """The parameters that differ between two pieces, each with its value in the second."""
    part_pairs: list[tuple[Key | Instrument, Key | Instrument | None]] = [
        *((key, piece.keys.get(key.name)) for key in scene_piece.keys.values()),
        *(
            (instrument, piece.instruments.get(instrument.name))
            for instrument in scene_piece.instruments.values()
        ),
    ]
    for scene_part, score_part in part_pairs:
        score_modules = (
            {} if score_part is None else {module.name: module for module in score_part.modules}
        )
        for scene_module in scene_part.modules:
            score_module = score_modules.get(scene_module.name)
            if score_module is None or score_module.kind != scene_module.kind:
                continue
            path = ".".join(filter(None, (scene_part.name, scene_module.name)))
            for field_name, field_value in matter.number_fields(scene_module):
                if field_value != score_module.fields.get(field_name):
                    is_ca = getattr(scene_part, "ca_rate", None) is not None
                    yield (
                        f"{path}.{field_name}",
                        matter.quantity_text(field_value, field_name, is_ca=is_ca),
                    )


def _with_couplings(
    score_texts: Texts, piece: Piece, scene: Scene, from_beat: float, until_text: str | None
) -> Texts:
    """Write the couplings with which a scene begins, from a beat on; all others end there."""
    tempo = piece.tempo_map
    for coupling_index in reversed(range(len(piece.duet))):
        coupling = piece.duet[coupling_index]
        has_ended = coupling.until is not None and tempo.resolve(coupling.until) <= from_beat + SAME
        if not has_ended and tempo.resolve(coupling.at) < from_beat - SAME:
            score_texts = score_texts.put(
                (*entry_path(score_texts, "duet", coupling_index), "until"),
                position_text(piece, from_beat),
            )
    nodes = section_entries(scene.texts, "duet")
    for coupling_node, coupling in zip(nodes, scene.piece.duet, strict=True):
        if scene.piece.tempo_map.resolve(coupling.at) > SAME:
            continue
        coupling_tree = edit.tree(coupling_node)
        assert isinstance(coupling_tree, dict)
        entry_tree: dict[str, edit.Tree] = {**coupling_tree, "at": position_text(piece, from_beat)}
        entry_tree.pop("until", None)
        if until_text is not None:
            entry_tree["until"] = until_text
        score_texts = score_texts.append(("duet",), edit.flow(entry_tree))
    return score_texts


def _with_automation(
    score_texts: Texts,
    piece: Piece,
    scene: Scene,
    from_beat: float,
    limit_beat: float,
    until_text: str | None,
) -> Texts:
    """Write the automation of a scene from a beat on; all other automation ends there.

    Automation that ends within the scene acts only in its first round; the rest continues. What
    begins on the beat `limit_beat` or later is left out: another scene plays there.
    """
    nodes, tempo = section_entries(scene.texts, "automation"), scene.piece.tempo_map
    for automation_node, entry in zip(nodes, scene.piece.automation, strict=True):
        begin_beat, end_beat = (
            tempo.resolve(entry.at),
            automation.automation_end(scene.piece, entry),
        )
        module_path = entry.name.rpartition(".")[0]
        if (
            begin_beat >= scene.beats - SAME
            or from_beat + begin_beat >= limit_beat
            or automatable.named_module(module_path, piece.keys, piece.instruments) is None
        ):
            continue
        entry_tree = edit.tree(automation_node)
        assert isinstance(entry_tree, dict)
        entry_tree = {**entry_tree, "at": position_text(piece, from_beat + begin_beat)}
        is_endless = end_beat >= scene.beats - SAME or from_beat + end_beat >= limit_beat
        if is_endless and ("until" in entry_tree or until_text is not None):
            entry_tree["until"] = until_text or endless_end(piece, from_beat)
        elif "until" in entry_tree:
            entry_tree["until"] = position_text(piece, from_beat + end_beat)
        score_texts = score_texts.append(("automation",), edit.flow(entry_tree))
    # The new entries are added before others are removed: a list that never becomes empty keeps its
    # style.
    return automation.end_all(score_texts, piece, from_beat)


def _with_strikes(
    score_texts: Texts,
    piece: Piece,
    scene: Scene,
    strikes: Strikes,
    start_beat: float,
    limit_beat: float,
    end_position: str,
) -> Texts:
    """Write strikes of a scene from a beat on, under names that are free.

    Random strikes (`rate`) that do not fill the scene sound in the first round only.
    """
    tempo = scene.piece.tempo_map
    begin_beat = tempo.resolve(strikes.at)
    stop_beat = begin_beat if strikes.until is None else tempo.resolve(strikes.until)
    if strikes.span is not None:
        stop_beat = tempo.after(begin_beat, strikes.span)
    if strikes.is_melody:
        return _with_melody(
            score_texts, piece, scene, strikes, start_beat, limit_beat, end_position
        )
    node = scene.texts.section("strikes")
    entry_tree = edit.tree(node)
    assert isinstance(entry_tree, dict)
    strike_fields = entry_tree[strikes.name]
    assert isinstance(strike_fields, dict)
    # `for` is the time of one sweep, so it stays.
    bound_names = ("until", "times") if strikes.passing is not None else ("for", "until", "times")
    strike_fields = {
        name: value for name, value in strike_fields.items() if name not in bound_names
    }
    placed_fields: list[tuple[float, Mapping[str, object]]]
    if strikes.rate is not None:
        fills_scene = begin_beat < SAME and stop_beat >= scene.beats - SAME
        rate_end = start_beat + min(stop_beat, scene.beats)
        until_text = (
            end_position if fills_scene or rate_end > limit_beat else position_text(piece, rate_end)
        )
        placed_fields = (
            [(begin_beat, {**strike_fields, "until": until_text})]
            if begin_beat < scene.beats - SAME
            else []
        )
    elif strikes.pattern is not None:
        place_beats = strikes.place_beats(scene.piece)
        n_places = n_before(place_beats, scene.beats - SAME)
        notes = {name: _note_text(name, amount) for name, amount in strikes.notes.items()}
        placed_fields = [
            *scene_patterns.repeated_strikes(
                strike_fields, place_beats, n_places, scene.beats, notes
            )
        ]
    else:
        end_beat = None if strikes.until is None and strikes.span is None else stop_beat
        strike_step, times_max = strikes.every, strikes.times
        begin_beats = (
            strikes.rounds(tempo)
            if strikes.passing is not None
            else starts(
                tempo, begin_beat, Length(), every=strike_step, times=times_max, until=end_beat
            )
        )
        repeated_fields = {**strike_fields, "every": f"{scene.beats:.12g}"}
        placed_fields = [
            (beat, repeated_fields) for beat in begin_beats if beat < scene.beats - SAME
        ]
    for beat, fields in placed_fields:
        if start_beat + beat < limit_beat:
            entry_tree = {
                "until": end_position,
                **fields,
                "at": position_text(piece, start_beat + beat),
            }
            entry_tree["until"] = entry_tree.pop("until")  # last, as written by hand
            score_texts = score_texts.put(
                ("strikes", _free_section_name(score_texts, strikes.name)), edit.flow(entry_tree)
            )
    return score_texts


def _note_text(note_name: str, amount: Amount) -> str:
    """A note of a pattern as it is written by itself; notes of a scale have no names, so their
    frequency is written.
    """
    return f"{amount.value!r}Hz" if "." in note_name else note_name


def _with_melody(
    score_texts: Texts,
    piece: Piece,
    scene: Scene,
    strikes: Strikes,
    start_beat: float,
    limit_beat: float,
    end_position: str,
) -> Texts:
    """Write a melody of a scene as a phrase as long as the scene, under a free name."""
    scene_hits = strikes.played_hits(scene.piece, before_beat=scene.beats)
    timed_hits = [(beat, hit) for beat, _, hit in scene_hits]
    melody_rows = [
        melody_entry(hit, f"{beat:.12g}") for beat, hit in timed_hits if beat < scene.beats - SAME
    ]
    if not melody_rows or start_beat >= limit_beat:
        return score_texts
    phrase_name = _free_section_name(score_texts, strikes.name, "phrases")
    phrase_tree: edit.Tree = {"length": f"{scene.beats:.12g}", "entries": melody_rows}
    score_texts = score_texts.put(("phrases", phrase_name), edit.flow(phrase_tree))
    play_fields: edit.Tree = {
        "play": phrase_name,
        "at": position_text(piece, start_beat),
        "until": end_position,
    }
    return score_texts.put(
        ("strikes", _free_section_name(score_texts, strikes.name)), edit.flow(play_fields)
    )


def _free_section_name(texts: Texts, wanted_name: str, section: str = "strikes") -> str:
    """A name that is free in a section: `rain`, `rain-2`, …"""
    section_tree = edit.tree(texts.section(section))
    taken_names = section_tree if isinstance(section_tree, dict) else {}
    return free_name(wanted_name, taken_names)
