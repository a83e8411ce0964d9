"""The output of `?`, `show` and `scope`: curves, lines of the score, who plays what."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.live.display import decibels_of
from ergon.notation.text.document import Mapping
from ergon.notation.text.spelling import nearest
from ergon.repl.language.amounts import TUNING
from ergon.repl.session.rehearsing import rehearsal_stage
from ergon.repl.session.tuning_lines import tuning_lines
from ergon.repl.session.version import NotTakenError
from ergon.scores.edits import entries
from ergon.scores.edits.matter import quantity_text
from ergon.scores.edits.positions import ENDLESS_POSITION
from ergon.scores.gesture import space_path
from ergon.scores.reading import automatable
from ergon.scores.staging.automating import value_on_beat
from ergon.scores.staging.live import leading_positions
from ergon.scores.staging.parameter_values import AutomatedModule

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.instruments.model import Module
    from ergon.notation.clock.positions import Position
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.strike_levels import StrikeLevels
    from ergon.repl.session.version import Faders, Version
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.piece import Piece, Strikes, TempoEntry
    from ergon.scores.reading.playing import Play

_LEAD_IN = 0.02  # [s] drawn before a gesture: its joining curve
_WIDTH_MAX, _PICTURE_HEIGHT = 100, 16  # characters
_POINTS_SHOWN = 4  # of a curve in each character: two in each dot
_TRACE_SECONDS, _TRACE_TICKS_MIN = 2.0, 20  # [s] of a movement that are drawn; ticks at least
_LINES_MAX = 40  # lines of a definition
_STRUCK_NAMES_MAX = 4  # modules of strikes that are named
_SECTIONS = (
    "parts",
    "gestures",
    "phrases",
    "takes",
    "keys",
    "instruments",
    "players",
    "marks",
    "strikes",
    "blocks",
)


def draw_name(
    version: Version, gesture_name: str, sounding_piece: Piece, beat_now: float
) -> list[str]:
    """The written and the played curve of a gesture or take; for any other name, the result of
    `definition_lines`.

    The piece that is `sounding_piece` is at beat `beat_now`.
    """
    from ergon.view.braille import plot
    from ergon.view.motion import wanted_and_actual

    piece = version.piece
    axis_names = space_path.played_names(gesture_name, piece.gestures)
    if gesture_name not in piece.gestures and axis_names:
        return [
            line
            for axis_name in axis_names
            for line in draw_name(version, axis_name, sounding_piece, beat_now)
        ]
    if gesture_name not in piece.gestures and gesture_name not in piece.takes:
        return definition_lines(version, gesture_name, sounding_piece, beat_now)
    if not piece.keys:
        raise NotTakenError("a gesture is drawn on a key, and this score has none")
    rehearsal = rehearsal_stage(piece, gesture_name)
    assert rehearsal is not None  # there is a key
    first_gesture = rehearsal.gestures[0]
    start_instant, stop_instant = max(0.0, first_gesture.start - _LEAD_IN), first_gesture.stop
    reach = piece.keys[first_gesture.key].reach
    plot_width = min(shutil.get_terminal_size().columns, _WIDTH_MAX)
    curves = wanted_and_actual(
        rehearsal.simulation,
        first_gesture.key_index,
        first_gesture.struck_mat,
        start_instant,
        stop_instant,
        reach,
        _POINTS_SHOWN * plot_width,
    )
    text = plot(curves, width=plot_width, height=_PICTURE_HEIGHT, x_label="position [mm]")
    return [f"{gesture_name} on {first_gesture.key}", *text.splitlines()]


def draw_trace(
    running: RunningVersion,
    trace_frame: int,
    player_name: str,
    tick_frames: int,
    hands_recording: Path | None,
    *,
    height: int = _PICTURE_HEIGHT,
) -> list[str]:
    """Draw where a player's key was in the last seconds.

    The path of a real hand is read from the recording `hands_recording`, in ticks of `tick_frames`
    frames; for any other player it is the path of its part, without the effect of what the key
    touches. Raises NotTakenError.
    """
    from ergon.view.braille import plot
    from ergon.view.curve import Curve

    piece, rate = running.version.piece, running.stage.rate
    if player_name not in piece.players:
        suggestion = nearest(player_name, piece.players)
        raise NotTakenError(
            f"'{player_name}' is not a player",
            None if suggestion is None else f"scope {suggestion}",
        )
    player_key = piece.players[player_name].key
    last_tick = trace_frame // tick_frames
    ticks = range(max(0, last_tick - int(_TRACE_SECONDS * rate) // tick_frames), last_tick)
    is_real = hands_recording is not None and any(
        hand.player == player_name for hand in running.stage.live_hands
    )
    if len(ticks) < _TRACE_TICKS_MIN:
        raise NotTakenError(f"{player_name} has not moved yet, so there is nothing to draw")
    if is_real and hands_recording is not None:
        path = _recorded_positions(hands_recording, player_name, ticks)
    else:
        path, _ = leading_positions(piece, player_name, running.spans, tick_frames, ticks)
    plot_width = min(shutil.get_terminal_size().columns, _WIDTH_MAX)
    point_step = max(1, len(path) // (_POINTS_SHOWN * plot_width))
    instants = [
        (number - len(path)) * tick_frames / rate for number in range(0, len(path), point_step)
    ]
    curve = Curve(player_name, instants, [1e3 * float(position) for position in path[::point_step]])
    plot_text = plot([curve], width=plot_width, height=height, x_label="position [mm]")
    mover_text = "its hand" if is_real else "as its part moves it"
    headline = (
        f"{player_name} on {player_key}, the last {len(path) * tick_frames / rate:.1f} s, "
        f"{mover_text}"
    )
    return [headline, *plot_text.splitlines()]


def _recorded_positions(
    hands_recording: Path, player_name: str, ticks: range
) -> NDArray[np.float64]:
    """Positions of a real hand (n_ticks,) [m], as far as the recording is on the disk."""
    from ergon import _core

    try:
        recording = _core.read_recording(hands_recording, (ticks.start, ticks.stop))
    except (_core.EngineError, OSError) as error:
        raise NotTakenError(f"the recording of hands cannot be read: {error}") from None
    axis_index = next(
        (index for index, (name, _) in enumerate(recording.axes) if name == player_name), None
    )
    if axis_index is None or len(recording.ticks()) < _TRACE_TICKS_MIN:
        raise NotTakenError(f"nothing of {player_name} is recorded yet")
    return recording.positions()[:, axis_index]


def definition_lines(
    version: Version, defined_name: str, sounding_piece: Piece, beat_now: float
) -> list[str]:
    """The lines of the score that define a name, with their numbers.

    A parameter (`bell.m.f`) is shown with its value at beat `beat_now` of the piece that is
    `sounding_piece`, which waiting lines have not changed yet.
    """
    if defined_name == TUNING:
        with contextlib.suppress(NotTakenError):  # a gesture may have this name
            return _lines_of_score(version.texts, defined_name)
        return list(tuning_lines(version.piece))
    module_path, _, parameter_name = defined_name.rpartition(".")
    named_module = (
        automatable.named_module(module_path, sounding_piece.keys, sounding_piece.instruments)
        if module_path
        else None
    )
    if named_module is None:
        return _lines_of_score(version.texts, defined_name)
    part_name, module, is_ca = named_module
    shown_value, is_automated = _value_at_beat(
        sounding_piece, (part_name, module.name), module, parameter_name, beat_now
    )
    shown_lines = []
    if shown_value is not None:
        place_text = f" at {sounding_piece.tempo_map.written(beat_now)}, by its automation"
        amount = quantity_text(float(f"{shown_value:.6g}"), parameter_name, is_ca=is_ca)
        shown_lines.append(f"{defined_name}: {amount}{place_text if is_automated else ''}")
    with contextlib.suppress(NotTakenError):  # the name is defined in a file that the score uses
        shown_lines += _lines_of_score(version.texts, part_name)
    return shown_lines or _lines_of_score(version.texts, defined_name)


def _value_at_beat(
    piece: Piece,
    module_place: tuple[str, str],
    written_module: Module,
    parameter_name: str,
    beat_now: float,
) -> tuple[float | None, bool]:
    """The value of a parameter at a beat, or None if it is not one number; and whether it is
    automated.
    """
    for entry in piece.automation:
        if module_place in entry.modules and entry.parameter == parameter_name:
            return value_on_beat(piece, module_place, parameter_name, beat_now), True
    field_value = {**written_module.fields.get("constants", {}), **written_module.fields}.get(
        parameter_name
    )
    if not isinstance(field_value, float) and written_module.kind in (
        "CEL",
        "BANK",
    ):  # f of K, K of f
        automated_module = AutomatedModule.from_piece(piece, module_place)
        field_value = (
            None
            if automated_module is None
            else automated_module.written_values.get(parameter_name)
        )
    return (field_value, False) if isinstance(field_value, float) else (None, False)


def _tempo_row(tempo_entry: TempoEntry) -> str:
    if tempo_entry.tempos:
        count = len(tempo_entry.tempos)
        return f"1|1: {count:,} tempo{'s' if count > 1 else ''} of a MIDI file"
    words = [f"{tempo_entry.bpm} bpm"] if tempo_entry.bpm else []
    words += [str(tempo_entry.meter)] if tempo_entry.meter else []
    return f"{tempo_entry.at.text}: {', '.join(words)}"


def playing_lines(
    version: Version, gestures_in_flight: Sequence[tuple[str, str]], beat_now: float
) -> list[str]:
    """What each player plays at beat `beat_now`, and what follows; then the strikes that go on, and
    the instruments with a level of their own.

    `gestures_in_flight` are the gestures in flight: (player, gesture).
    """
    piece = version.piece
    playing_rows = [_tempo_row(entry) for entry in piece.tempo]
    playing_rows += [] if piece.tuning is None else [f"tuning: {piece.tuning.words()}"]
    playing_rows += [
        f"tuning of {name}: {tuning.words()}" for name, tuning in piece.tunings.items()
    ]
    for player in piece.players.values():
        placed_entries = entries.placed_entries(version.texts, piece, player.name)
        sounding_names = [
            played_name for name, played_name in gestures_in_flight if name == player.name
        ]
        begun_entries = [placed for placed in placed_entries if placed.begin_beat <= beat_now]
        ongoing_entries = [
            placed for placed in begun_entries if placed.is_continuing(beat_now, piece)
        ]
        # An entry that begins nothing more may still have its last occurrence in flight.
        shown_names = {name for placed in ongoing_entries for name in placed.play.names}
        for shown_name in dict.fromkeys(sounding_names):
            ongoing_entries += [
                placed
                for placed in begun_entries
                if shown_name in placed.play.names and shown_name not in shown_names
            ][-1:]
        later_entries = sorted(
            (placed for placed in placed_entries if placed.begin_beat > beat_now),
            key=lambda placed: placed.begin_beat,
        )
        words = [_entry_text(placed.play) for placed in ongoing_entries] or ["nothing"]
        words += [f"then {_entry_text(placed.play)}" for placed in later_entries[:1]]
        playing_rows.append(f"{player.name} ({player.hand}, {player.key}): {', '.join(words)}")
    levels = version.strike_levels
    for strikes in piece.strikes:
        if _continues_after(strikes, piece, beat_now):
            level_words = _level_words(levels, levels.level_key(strikes.name))
            playing_rows.append(", ".join([_striking_text(strikes), *level_words]))
    for name in (*piece.instruments, *piece.families):
        if level_words := _level_words(version.faders, name):
            playing_rows.append(f"{name} (instrument): {', '.join(level_words)}")
    playing_rows += [f"{name}: {rule.trigger.text}" for name, rule in version.rules.items()]
    return playing_rows


def _level_words(levels: Faders | StrikeLevels, level_key: str) -> list[str]:
    """What mute, solo and gain make of strikes or an instrument; empty if nothing."""
    level_words = ["muted"] if level_key in levels.muted else []
    level_words += ["solo"] if level_key in levels.solo else []
    gain = levels.gains.get(level_key, 1.0)
    level = "silent" if gain == 0.0 else f"{decibels_of(gain):.3g} dB"
    return level_words if gain == 1.0 else [*level_words, level]


def _continues_after(strikes: Strikes, piece: Piece, beat_now: float) -> bool:
    stop_beat = strikes.stop_beat(piece.tempo_map)
    return stop_beat is None or stop_beat > beat_now


def _striking_text(strikes: Strikes) -> str:
    struck_names = [*dict.fromkeys(target.text for target in strikes.to)]
    struck_names = struck_names or [*dict.fromkeys(hit.struck_text for hit in strikes.hits)]
    ellipsis = ", …" if len(struck_names) > _STRUCK_NAMES_MAX else ""
    struck_text = f"{', '.join(struck_names[:_STRUCK_NAMES_MAX])}{ellipsis}"
    if (rhythm := strikes.rhythm) is not None:
        do_text = f" do {rhythm.do}" if rhythm.do else ""
        struck_text = f'"{" ".join(rhythm.text.split())}"{do_text}'
    return (
        f"{strikes.name} (strikes): {struck_text} from "
        f"{strikes.at.text}{_until_text(strikes.until)}"
    )


def _entry_text(play: Play) -> str:
    return f"{play.played_text} from {play.at.text}{_until_text(play.until)}"


def _until_text(position: Position | None) -> str:
    """` until 9|1`; empty for what goes on to the end."""
    is_endless = position is None or ENDLESS_POSITION.fullmatch(position.text)
    return "" if position is None or is_endless else f" until {position.text}"


def _lines_of_score(score_texts: Texts, defined_name: str) -> list[str]:
    defined_names: list[str] = []
    for file in (score_texts.path, *score_texts.overlay):
        document = score_texts.document(file)
        if not isinstance(document.root, Mapping):
            continue
        for section in _SECTIONS:
            section_node = document.root.get(section)
            if not isinstance(section_node, Mapping):
                continue
            defined_names += section_node.entries
            if defined_name in section_node.entries:
                first_node, last_node = section_node.entries[defined_name]
                # A block of YAML reaches to the next entry: blank lines at its end are not part of
                # it.
                text_end = last_node.start + len(
                    document.text[last_node.start : last_node.end].rstrip()
                )
                first_row = document.row(first_node.start)
                last_row = document.row(max(text_end - 1, last_node.start))
                line_numbers: Sequence[int] = range(
                    first_row + 1, min(last_row + 2, first_row + 1 + _LINES_MAX)
                )
                return [f"{number:5} {document.line(number)}" for number in line_numbers]
    suggestion = nearest(defined_name, defined_names)
    raise NotTakenError(
        f"'{defined_name}' is not defined in this score",
        None if suggestion is None else f"show {suggestion}",
    )
