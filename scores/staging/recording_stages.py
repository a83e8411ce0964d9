"""Stages of pieces that the engine refuses if every module is stepped as written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ergon.notation.clock.positions import Position
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Play, Player, PlayingOptions
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import Stage, stage

if TYPE_CHECKING:
    from ergon.scores.gesture.transforms import Transform
    from ergon.scores.staging.planning import TrialStore

# Ergons are recorded at up to this multiple of the audio rate; and at up to the second if nothing
# else can record them: a second of sound then takes some minutes.
_FINE_FACTOR_MAX, _FINEST_FACTOR = 64, 4096


def stage_or_plan(piece: Piece, **stage_options: Any) -> Stage:
    """Stage every module as written, or by a plan if the engine refuses that.

    A command that needs no plan then accepts the same pieces as `render`. `stage_options` are those
    of `stage`. Raises StageError.
    """
    try:
        return stage(piece, **stage_options)
    except StageError:
        return stage(piece, planned=True, **stage_options)


def stage_recording(
    piece: Piece, *, seed: int | None = None, store: TrialStore | None = None
) -> Stage:
    """Stage a piece so that its simulation records its ergons.

    If the scheme is unstable at the audio rate but a plan can play the piece, these ways are
    tried in turn: 2, 4, 8 … 64 times the audio rate; contacts computed several times a frame;
    the simulation of the plan; and, if ergons strike inside a body of the plan, up to 4096 times
    the audio rate. Raises StageError with the mistakes of the plan if no plan plays the piece,
    as `check` does, and with those found at the audio rate if none of these ways works.
    """
    try:
        return stage(piece, seed=seed, record=True)
    except StageError as error:
        if any(
            diagnostic.code != "E309"
            for diagnostic in error.diagnostics
            if diagnostic.severity == "error"
        ):
            raise
        stage(piece, seed=seed, planned=True, store=store)
        for stage_options in _recording_options(piece, store):
            try:
                return stage(seed=seed, record=True, **stage_options)
            except StageError:
                continue
        raise


def _recording_options(piece: Piece, store: TrialStore | None) -> Iterator[dict[str, Any]]:
    """Options of `stage` that may record the ergons of a piece, in the order in which they are
    tried.
    """
    rate_factors = [2**exponent for exponent in range(1, _FINEST_FACTOR.bit_length())]
    yield from (
        {"piece": _oversampled(piece, factor)}
        for factor in rate_factors
        if factor <= _FINE_FACTOR_MAX
    )
    yield {"piece": piece, "fine_contacts": True}
    yield {"piece": piece, "planned": True, "store": store}
    yield from (
        {"piece": _oversampled(piece, factor)}
        for factor in rate_factors
        if factor > _FINE_FACTOR_MAX
    )


def _oversampled(piece: Piece, rate_factor: int) -> Piece:
    """The piece at a multiple of its audio rate; parts with a slow rate keep it."""
    return replace(
        piece,
        rate=piece.rate * rate_factor,
        keys=_with_slow_rates(piece.keys, rate_factor),
        instruments=_with_slow_rates(piece.instruments, rate_factor),
    )


def _with_slow_rates(parts: Mapping[str, Any], factor: int) -> dict[str, Any]:
    return {
        name: part if part.every == 1 else replace(part, every=part.every * factor)
        for name, part in parts.items()
    }


def solo(
    piece: Piece,
    gesture_name: str,
    key_name: str,
    transforms: tuple[Transform, ...] = (),
    playing_options: PlayingOptions | None = None,
) -> Stage:
    """One gesture or take alone on a key, at the beginning of the piece."""
    key_place = piece.keys[key_name].place
    player = Player(key_name, "virtual", key_name, None, None, None, key_place)
    gesture_or_take = piece.gestures.get(gesture_name) or piece.takes[gesture_name]
    play = Play(
        player.name,
        gesture_name,
        Position(),
        every=None,
        times=1,
        until=None,
        do=transforms,
        options=playing_options or PlayingOptions(),
        place=gesture_or_take.place,
        begin_place=gesture_or_take.place,
        until_place=None,
    )
    piece_alone = replace(
        piece, parts=(play,), starts=((0.0,),), players={player.name: player}, strikes=()
    )
    return stage_or_plan(piece_alone)
