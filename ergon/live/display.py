"""The display of a performance: position, players, keys, load and level, as lines and records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon._core import FORCE_SCALE_MIN

from .trouble import gap_count, troubles

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.force_bounds import HandForceBounds
    from ergon.scores.staging.hands import StagedGesture
    from ergon.scores.staging.stage import Stage

_METER_WIDTH = 21  # characters; odd, so that the middle is one of them
SILENT_PEAK = 1e-7  # a peak of so little is silence: -140 dB, the least level that OSC tells


@dataclass(frozen=True, slots=True)
class HandView:
    """What is shown of a real hand's key: positions [m], forces [N]."""

    player: str
    key: str
    position: float
    travel: tuple[float, float]
    force: float
    is_real: bool
    is_tripped: bool
    sent_force: float = 0.0
    force_scale: float = 1.0


@dataclass(frozen=True, slots=True)
class PerformanceView:
    """The state of a performance, as it is shown."""

    position_text: str
    gestures: tuple[tuple[str, str], ...]  # (player, what)
    keys: tuple[HandView, ...]
    load: float
    late_count: int
    gap_count: int
    peak_db: float
    troubles: tuple[str, ...] = ()
    is_panicked: bool = False


class PerformanceViewer:
    """Makes views of the performance of a stage."""

    def __init__(self, stage: Stage) -> None:
        """Watch the performance of this stage."""
        self._stage = stage
        # Sorted by start: there may be a million, and those in progress are found by bisection.
        self._gestures: list[StagedGesture] = sorted(stage.gestures, key=lambda g: g.start)

    def view(self, status: _core.Status, recording_trouble: str | None = None) -> PerformanceView:
        """The view of `status`; `recording_trouble` says why hands cannot be recorded now."""
        stage = self._stage
        elapsed_seconds = status.frame / stage.rate
        tempo_map = stage.piece.tempo_map
        key_views = tuple(
            HandView(
                hand.player,
                hand.key,
                hand_status.position,
                stage.piece.keys[hand.key].travel or (-0.015, 0.015),
                hand_status.force,
                hand_status.real,
                hand_status.tripped,
                hand_status.sent,
                hand_status.scale,
            )
            for hand, hand_status in zip(stage.live_hands, status.hands, strict=False)
        )
        peak = max(status.peaks, default=0.0)
        return PerformanceView(
            position_text=tempo_map.written(tempo_map.beats(elapsed_seconds)),
            gestures=tuple(self._latest_gestures(elapsed_seconds)),
            keys=key_views,
            load=status.load,
            late_count=status.late,
            gap_count=gap_count(status),
            peak_db=decibels_of(peak),
            troubles=troubles(
                status, [key.player for key in key_views], recording_trouble, is_endless=False
            ),
            is_panicked=status.panicked,
        )

    def _latest_gestures(self, elapsed_seconds: float) -> list[tuple[str, str]]:
        from bisect import bisect_right

        n_begun = bisect_right(self._gestures, elapsed_seconds, key=lambda gesture: gesture.start)
        latest_by_player: dict[str, str] = {}
        # The last few that began are enough: a hand plays one gesture at a time, and its layers.
        for gesture in self._gestures[max(0, n_begun - 64) : n_begun]:
            if gesture.stop > elapsed_seconds:
                latest_by_player[gesture.player] = gesture.name
        return list(latest_by_player.items())


def decibels_of(peak: float) -> float:
    """A peak in dB below full scale; -inf (silence) if it is not above `SILENT_PEAK`."""
    return 20.0 * math.log10(peak) if peak > SILENT_PEAK else -math.inf


def view_lines(view: PerformanceView, line_width: int) -> list[str]:
    """The view as lines of at most `line_width` characters, without colours."""
    playing_text = " · ".join(f"{player} {gesture}" for player, gesture in view.gestures) or "—"
    level_text = f"{view.peak_db:.1f} dB" if math.isfinite(view.peak_db) else "silent"
    troubles_text = " · ".join([f"late {view.late_count}", *view.troubles])
    if view.is_panicked:
        playing_text = f"PANIC  {playing_text}"
    lines = [
        f"{view.position_text:>9}  {playing_text}",
        f"{'':9}  load {view.load:4.0%} · {level_text} · {troubles_text}",
    ]
    lines += [_key_line(key) for key in view.keys]
    return [line[:line_width] for line in lines]


def _key_line(hand_view: HandView) -> str:
    player_and_key = f"{hand_view.player} on {hand_view.key}"
    hand_state = "tripped" if hand_view.is_tripped else "hand" if hand_view.is_real else "stand-in"
    meter = meter_of(hand_view.position, *hand_view.travel)
    force_text = f"{hand_view.force:+7.3f} N"
    if hand_view.is_real:
        force_text += f", sent {hand_view.sent_force:+7.3f} N"
        if hand_view.force_scale < 1.0:
            force_text += f" ({_percent(hand_view.force_scale)})"
    return (
        f"{'':9}  {player_and_key:16} {meter} {1e3 * hand_view.position:+7.2f} mm {force_text}  "
        f"{hand_state}"
    )


def meter_of(position: float, low_end: float, high_end: float) -> str:
    """A text meter that shows x between two ends."""
    fraction = (position - low_end) / (high_end - low_end) if high_end > low_end else 0.5
    marked_cell = min(max(round(fraction * (_METER_WIDTH - 1)), 0), _METER_WIDTH - 1)
    middle = (_METER_WIDTH - 1) // 2
    cells = ["·"] * _METER_WIDTH
    cells[middle] = "+"
    cells[marked_cell] = "#"
    return "[" + "".join(cells) + "]"


def view_record(view: PerformanceView, status_frame: int) -> dict[str, object]:
    """The view as fields of a JSON line."""
    return {
        "frame": status_frame,
        "where": view.position_text,
        "playing": {player: gesture for player, gesture in view.gestures},
        "load": round(view.load, 4),
        "late": view.late_count,
        "underruns": view.gap_count,
        "troubles": list(view.troubles),
        "panic": view.is_panicked,
        "peak_dbfs": None if not math.isfinite(view.peak_db) else round(view.peak_db, 2),
        "hands": [
            {
                "player": key.player,
                "key": key.key,
                "position_m": key.position,
                "force_n": key.force,
                "sent_n": key.sent_force,
                "scale": key.force_scale,
                "real": key.is_real,
                "tripped": key.is_tripped,
            }
            for key in view.keys
        ],
    }


def force_sentence(bounds: HandForceBounds) -> str:
    """The part of the piece's force that a hand gets, in words."""
    last_scale = bounds.last_scale
    if last_scale.scale >= 1.0:
        return f"{bounds.player} gets the full force of the piece again"
    return (
        f"{bounds.player} gets {_percent(last_scale.scale)} of the force of the piece: the piece "
        "is "
        f"{last_scale.stiffness_met:,.0f} N/m stiff at this key, and its device is stable up to "
        f"{last_scale.stiffness_limit:,.0f} N/m"
    )


def stiffness_refusal(bounds: HandForceBounds) -> str:
    """Why a line is refused with which a hand's device would not be stable."""
    least_scale = bounds.least_scale
    return (
        f"with this line the piece would be {least_scale.stiffness_met:,.0f} N/m stiff at the "
        "key of "
        f"{bounds.player}, whose device is stable up to {least_scale.stiffness_limit:,.0f} N/m: "
        f"{bounds.player} would get less than {FORCE_SCALE_MIN:.0%} of the force; "
        "use a smaller K or a larger Z"
    )


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2g} %" if fraction < 0.1 else f"{100 * fraction:.0f} %"


# How a trip that ends by itself is released if it comes again.
_THIRD_TRIP = "after the third time within a minute none until `release`"


def event_sentence(
    event: _core.PerformanceEvent, players: Sequence[str], boards: Sequence[str]
) -> str:
    """An event as a sentence; empty where a player need not know of it."""
    _, event_kind, event_number = event
    board = boards[int(event_number)] if int(event_number) < len(boards) else "a device"
    player = players[int(event_number)] if int(event_number) < len(players) else "a hand"
    return {
        "gone": f"{board} is disconnected; its stand-in plays on",
        "back": f"{board} is back: its hand takes over at the next bar",
        "took over": f"{player} plays",
        "lost": f"the physics thread was stopped for {event_number:.3f} s",
        "tripped: not finite": f"{player}'s key tripped: a force or a position was not finite; "
        f"no force for half a second, {_THIRD_TRIP}",
        "tripped: speed": f"{player}'s key tripped: it was too fast; no force for half a second, "
        f"{_THIRD_TRIP}",
        "tripped: wrong way": f"{player}'s key tripped: its motor pushes in the wrong direction; "
        "no force until `release`; `ergon devices calibrate` finds the direction",
        "tripped: at stop": f"{player}'s key tripped: the piece pushes it into its stop; the "
        f"force returns 3 s after that has ended, {_THIRD_TRIP}",
        "tripped: frozen": f"{player}'s key tripped: its position does not change while the force "
        f"does; the force returns when the key has moved for 3 s, {_THIRD_TRIP}",
        "tripped: unanswered": f"{player}'s key tripped: it does not answer its motor; no force "
        "until `release`; check the motor, its supply and the sensor",
        "tripped: late": f"{player}'s key tripped: its force or its position comes too late; no "
        "force until `release`; check its cable, and close other programs on this machine",
        "tripped: outside travel": f"{player}'s key tripped: its position is outside its travel; "
        "no force until `release`; check the sensor, or find the ends by `ergon devices calibrate`",
        "tripped: jump": f"{player}'s key tripped: its position jumped as no force could move it; "
        "no force until `release`; check the sensor and its cable",
        "muted": "a part diverged or created energy, and is muted",
        "gained": "a contact or a law has made energy: it is too stiff for the time step",
        "finer": "links became too stiff for one step a frame: such frames are computed in finer "
        "steps",
    }.get(event_kind, "")
