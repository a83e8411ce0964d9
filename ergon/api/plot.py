"""Pictures of a score: a gesture as it was asked for and as it was done, or what is struck."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import log2
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.common.report import Report

from . import score as scores
from .options import ReadOptions
from .pictures import Picture

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.hands import StagedGesture
    from ergon.scores.staging.stage import Stage
    from ergon.scores.staging.struck_notes import StruckNote
    from ergon.view.curve import Curve
    from ergon.view.roll import Bar

NOTES_NAME = "notes"  # a plot of all notes, in place of a name
_JOIN_DURATION = 0.02  # [s] drawn before a gesture: its joining curve


def plot(
    score: str | Path,
    name: str,
    options: ReadOptions | None = None,
    *,
    key: str | None = None,
    report: Report | None = None,
) -> Picture:
    """Draw a gesture, a take or a player of a score as written and as played; "notes" draws what is
    struck.

    A gesture with a `key` is played alone, on that key. Positions are in mm, times in s. Raises
    ScoreError, and ErgonError if the score has nothing of this name.
    """
    from ergon.view import roll, svg

    report = report or Report()
    loaded = scores.read(score, options, report)
    if name == NOTES_NAME:
        _, bars, plot_title = struck_bars(loaded, report)
        return Picture(roll.notes_svg(bars, title=plot_title))
    curves, plot_title = drawn_curves(loaded, name, key, report)
    return Picture(svg.plot(curves, title=plot_title, x_label="position [mm]"))


def struck_bars(loaded: Loaded, report: Report) -> tuple[Sequence[StruckNote], Sequence[Bar], str]:
    """The notes of a piece, the bars that draw them, and the title of the picture.

    Raises ScoreError, and ErgonError if nothing is struck.
    """
    from ergon.scores.staging.struck_notes import struck_notes
    from ergon.view.roll import Bar

    stage = scores.stage_piece(loaded, None, report).stage
    notes = struck_notes(stage)
    if not notes:
        raise ErgonError("no instrument is struck in this piece")
    bars = [
        Bar(note.instrument, note.begin, note.end, _midi_key(note.pitch), note.strength)
        for note in notes
    ]
    return notes, bars, f"notes of {stage.piece.title or 'a piece'}"


def _midi_key(pitch: float | None) -> float | None:
    """The key of MIDI of a pitch [Hz]."""
    return None if pitch is None else 69.0 + 12.0 * log2(pitch / 440.0)


def drawn_curves(
    loaded: Loaded, name: str | None, key: str | None, report: Report
) -> tuple[tuple[Curve, Curve], str]:
    """A gesture as it was asked for and as it was done, and the title of the picture.

    Raises ScoreError, and ErgonError if the score has nothing of this name.
    """
    from ergon.view.motion import wanted_and_actual

    piece = scores.piece_of(loaded)
    if name is None:
        known_names = _known_names(piece)
        path = loaded.inputs[0] if loaded.inputs else "this score"
        if not known_names:
            raise ErgonError(
                f"{path} has no gesture, take or player, which `ergon plot` draws; its sound "
                f"is drawn from a file: `ergon render {path}`, then `ergon plot` of it; "
                f"`ergon plot {path} notes` draws what is struck"
            )
        raise ErgonError(f"say what is to be drawn: {known_names}")
    if key is not None and key not in piece.keys:
        raise ErgonError(f"there is no key '{key}'{_nearest_name(key, piece.keys)}")
    drawable_names = [*piece.gestures, *piece.takes, *piece.players]
    if name not in drawable_names:
        raise ErgonError(f"there is no '{name}'{_nearest_name(name, drawable_names)}")
    stage, gestures = _stage_and_gestures(loaded, name, key, report)
    first_gesture = gestures[0]
    start_instant = max(0.0, min(gesture.start for gesture in gestures) - _JOIN_DURATION)
    stop_instant = max(gesture.stop for gesture in gestures)
    lever_ratio = piece.keys[first_gesture.key].reach
    curves = wanted_and_actual(
        stage.simulation,
        first_gesture.key_index,
        first_gesture.struck_mat,
        start_instant,
        stop_instant,
        lever_ratio,
    )
    instant_text = "" if key is not None else f" at {scores.where(piece, first_gesture.start)}"
    return curves, f"{name}{instant_text} on {first_gesture.key}"


def _stage_and_gestures(
    loaded: Loaded, gesture_name: str, key_name: str | None, report: Report
) -> tuple[Stage, Sequence[StagedGesture]]:
    """The stage to look at, and the gestures of it that are meant."""
    from ergon.scores.staging.recording_stages import solo

    piece = scores.piece_of(loaded)
    if key_name is None:
        stage = scores.stage_piece(loaded, None, report).stage
        if gesture_name in piece.players:
            played_gestures = [
                gesture for gesture in stage.gestures if gesture.player == gesture_name
            ]
            if not played_gestures:
                raise ErgonError(f"{gesture_name} plays nothing in this piece")
            return stage, played_gestures
        played_gestures = [gesture for gesture in stage.gestures if gesture.name == gesture_name]
        if played_gestures:
            return stage, played_gestures[:1]
    if gesture_name in piece.players:
        raise ErgonError("--key is for a gesture or a take; a player has a key of its own")
    if not piece.keys:
        raise ErgonError("this piece has no key that could play it")
    with scores.staging(lambda: loaded, report):
        solo_stage = solo(piece, gesture_name, key_name or next(iter(piece.keys)))
    return solo_stage, solo_stage.gestures


def _nearest_name(unknown_word: str, known_names: Iterable[str]) -> str:
    from ergon.notation.text.spelling import nearest

    known_names = list(known_names)
    nearest_name = nearest(unknown_word, known_names)
    hint = f"; did you mean '{nearest_name}'?" if nearest_name else ""
    return f"{hint} (there is {', '.join(known_names)})" if known_names else hint


def _known_names(piece: Piece) -> str:
    kinds = {"gestures": piece.gestures, "takes": piece.takes, "players": piece.players}
    return "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds.items() if names)
