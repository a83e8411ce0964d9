"""Changes which parameters glide, follow patterns or swing, from a beat on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from ergon.common.changed import changed_part
from ergon.notation.clock.meter import SAME
from ergon.notation.tables import quantities
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.lists import entry_path, without_entry
from ergon.scores.edits.matter import TRANSPOSE, quantity_text
from ergon.scores.edits.positions import ENDLESS_POSITION, endless_end, position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading import automatable
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Piece

# The value of a parameter of a module (part, module) of a piece on a beat, with automation applied.
ValueAtBeat = Callable[[Piece, tuple[str, str], str, float], float]


def automate(
    score_texts: Texts,
    piece: Piece,
    target_path: str,
    from_beat: float,
    automation_kind: str,
    automation_fields: Mapping[str, str],
) -> Texts:
    """Let a parameter follow a pattern (`set`) or swing (`lfo`) from a beat on.

    Replaces earlier automation of the parameter; without an end in `automation_fields` it continues
    for ever. Raises EditError.
    """
    fields: dict[str, edit.Tree] = {
        automation_kind: target_path,
        **automation_fields,
        "at": position_text(piece, from_beat),
    }
    if not fields.keys() & {"times", "until"}:
        fields["until"] = endless_end(piece, from_beat)
    # Add the new entry before others are removed: a list that never becomes empty keeps its style.
    score_texts = score_texts.append(("automation",), edit.flow(fields))
    score_texts, _ = _with_automation_ended(score_texts, piece, from_beat, target_path)
    return score_texts


def glide(
    score_texts: Texts,
    piece: Piece,
    target_path: str,
    from_beat: float,
    new_value: str,
    glide_fields: Mapping[str, str],
    value_on: ValueAtBeat,
) -> Texts:
    """Let a parameter glide to a value, `over` a length, and stay there.

    `x1.5` is a factor of the value that it has on that beat. Raises EditError.
    """
    module_path, _, parameter = target_path.rpartition(".")
    check_can_glide(piece, target_path)
    if new_value.startswith("x") and _entry_indices(score_texts, piece, target_path):
        part, module, _ = _modules_of_path(piece, module_path)[0]
        if module.kind != "BANK":
            current_value = value_on(piece, (part, module.name), parameter, from_beat)
            new_value = value_text(
                piece, target_path, quantities.factor(new_value) * current_value, value_on
            )
    automation_entry: dict[str, edit.Tree] = {
        "set": target_path,
        "to": new_value,
        **glide_fields,
        "at": position_text(piece, from_beat),
    }
    score_texts = score_texts.append(("automation",), edit.flow(automation_entry))
    return _with_automation_ended(score_texts, piece, from_beat, target_path)[0]


def value_text(piece: Piece, target_path: str, value: float, value_on: ValueAtBeat) -> str:
    """A value of a parameter as a score writes it; for all notes of an instrument, of which `value`
    is that of the first, the factor of their values without automation.
    """
    module_path, _, parameter = target_path.rpartition(".")
    part_name, part_module, _ = _modules_of_path(piece, module_path)[0]
    if part_module.kind == "BANK":
        return f"x{value:.12g}"
    if automatable.named_module(module_path, piece.keys, piece.instruments) is not None:
        return quantity_text(value, parameter, is_ca=False)
    unautomated_piece = replace(piece, automation=(), strikes=())
    return (
        f"x{value / value_on(unautomated_piece, (part_name, part_module.name), parameter, 0.0)!r}"
    )


def check_can_glide(piece: Piece, target_path: str) -> None:
    """Raise EditError if a parameter cannot glide."""
    module_path, _, parameter_name = target_path.rpartition(".")
    parameter_name = "f" if parameter_name == TRANSPOSE else parameter_name
    named_modules = _modules_of_path(piece, module_path)
    if not named_modules:
        raise EditError(
            f"{target_path} cannot change gradually; leave out `over` to set it at once"
        )
    _, module, is_ca = named_modules[0]
    if refusal_text := automatable.refusal(module, parameter_name, is_ca=is_ca):
        raise EditError(f"{module_path} {refusal_text}; leave out `over` to set it at once")


def _modules_of_path(piece: Piece, module_path: str) -> list[automatable.Automatable]:
    return automatable.named_modules(module_path, piece.keys, piece.instruments, piece.families)


def end_automation(score_texts: Texts, piece: Piece, target_path: str, from_beat: float) -> Texts:
    """Give a parameter its own value from a beat on. Raises EditError if no automation changes
    it.
    """
    score_texts, ended_count = _with_automation_ended(score_texts, piece, from_beat, target_path)
    if not ended_count:
        beat_text = piece.tempo_map.written(from_beat)
        raise EditError(
            f"no pattern and no lfo controls {target_path} at {beat_text}, so there is nothing "
            "to end"
        )
    return score_texts


def end_if_automated(texts: Texts, piece: Piece, target: str, beat: float) -> Texts:
    """End the automation of a parameter, if there is any."""
    return _with_automation_ended(texts, piece, beat, target)[0]


def end_endless(score_texts: Texts, piece: Piece, from_beat: float) -> Texts:
    """End endless automation at a beat, for a score that is saved."""
    for automation_index, entry in enumerate(piece.automation):
        if entry.until is not None and ENDLESS_POSITION.fullmatch(entry.until.text) is not None:
            end_position = position_text(
                piece, max(from_beat, piece.tempo_map.resolve(entry.at) + 1.0)
            )
            score_texts = score_texts.put(
                (*entry_path(score_texts, "automation", automation_index), "until"), end_position
            )
    return score_texts


def end_all(score_texts: Texts, piece: Piece, from_beat: float) -> Texts:
    """Give every parameter its own value from a beat on."""
    for automation_index in reversed(range(len(piece.automation))):
        if is_automated_from(piece, piece.automation[automation_index], from_beat):
            score_texts = _with_entry_ended(score_texts, piece, from_beat, automation_index)
    return score_texts


def is_automated_from(piece: Piece, entry: Automation, beat: float) -> bool:
    """Whether automation changes its parameter on a beat, or later."""
    return automation_end(piece, entry) > beat + SAME


def automation_end(piece: Piece, automation_entry: Automation) -> float:
    """The beat on which automation ends; infinite if it does not end."""
    end_beat = (
        math.inf
        if automation_entry.until is None
        else piece.tempo_map.resolve(automation_entry.until)
    )
    if automation_entry.pattern is None:
        return end_beat
    place_beats = automation_entry.place_beats(piece.tempo_map, piece.seed)
    return min(end_beat, place_beats.beat(len(place_beats)))


def _with_automation_ended(
    score_texts: Texts, piece: Piece, from_beat: float, target: str
) -> tuple[Texts, int]:
    tempo, ended_count = piece.tempo_map, 0
    for automation_index in reversed(_entry_indices(score_texts, piece, target)):
        entry = piece.automation[automation_index]
        has_ended = entry.until is not None and tempo.resolve(entry.until) <= from_beat + SAME
        if not (has_ended and tempo.resolve(entry.at) < from_beat - SAME):
            score_texts, ended_count = (
                _with_entry_ended(score_texts, piece, from_beat, automation_index),
                ended_count + 1,
            )
    return score_texts, ended_count


def _entry_indices(score_texts: Texts, piece: Piece, target_path: str) -> Sequence[int]:
    """The numbers of the automation entries of a parameter."""
    with score_texts.memory.lock:
        indices_by_target: dict[tuple[str, str], list[int]]
        old_automation, indices_by_target = score_texts.memory.held(
            "automation by target", None
        ) or ((), {})
        if changed_range := changed_part(old_automation, piece.automation):
            first_changed = changed_range.start  # those behind it are counted anew
            indices_by_target = {
                target_and_parameter: [index for index in indices if index < first_changed]
                for target_and_parameter, indices in indices_by_target.items()
            }
            for index, entry in enumerate(piece.automation[first_changed:], first_changed):
                target_and_parameter = entry.target.text, entry.parameter
                indices_by_target.setdefault(target_and_parameter, []).append(index)
        score_texts.memory.hold("automation by target", None, (piece.automation, indices_by_target))
    module_path, _, parameter = target_path.rpartition(".")
    indices: Sequence[int] = indices_by_target.get((module_path, parameter), ())
    return indices


def _with_entry_ended(
    score_texts: Texts, piece: Piece, from_beat: float, automation_index: int
) -> Texts:
    """End automation on a beat, or remove it if it would begin then or later."""
    if piece.tempo_map.resolve(piece.automation[automation_index].at) >= from_beat - SAME:
        return without_entry(score_texts, "automation", automation_index)
    return score_texts.put(
        (*entry_path(score_texts, "automation", automation_index), "until"),
        position_text(piece, from_beat),
    )
