"""Troubles of a performance, in a few words each, for status lines and for OSC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon import _core


def gap_count(status: _core.Status) -> int:
    """Number of gaps in the sound: the ring ran empty, or the clock of the sound was held up."""
    return status.underruns + status.xruns


def troubles(
    status: _core.Status, players: Sequence[str], recording_trouble: str | None, *, is_endless: bool
) -> tuple[str, ...]:
    """The present troubles and those that have occurred, the gravest first.

    `recording_trouble` says why hands cannot be recorded at present. A performance that
    `is_endless` should not end by itself.
    """
    return tuple(_trouble_sentences(status, players, recording_trouble, is_endless))


def _trouble_sentences(
    status: _core.Status, players: Sequence[str], recording_trouble: str | None, is_endless: bool
) -> Iterator[str]:
    if status.done and is_endless:
        yield "ENGINE ENDED"
    elif not status.alive and status.ticks and not status.done:
        yield "NO SOUND OUTPUT"
    if recording_trouble:
        yield f"HANDS NOT RECORDED ({recording_trouble})"
    for player, hand in zip(players, status.hands, strict=False):
        if hand.hot:
            yield f"{player} MOTOR HOT"
        if hand.tripped:
            yield f"{player} tripped"
        if hand.let_go:
            yield f"{player} forces dropped by device {hand.let_go}"
        if hand.stalls:
            yield f"{player} host stalls {hand.stalls}"
    if count := gap_count(status):
        yield f"gaps {count}"
    if status.input_gaps:
        yield f"input gaps {status.input_gaps}"
    if status.lost:
        yield f"clock resets {status.lost}"
