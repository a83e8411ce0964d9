"""The status line: position, who plays what, and the state of machine and sound."""

from __future__ import annotations

import math

from ergon.common.terminal import clean
from ergon.repl.session_protocol import State

_BETWEEN = "  "
_WIDTH_MIN = 12  # characters that the list of players keeps


def status(state: State, width: int) -> str:
    """The state in one line of at most `width` characters.

    If there is not enough room, the list of what plays is shortened, then fields at the end are
    left out.
    """
    before = ["PANIC: type release"] if state.panicked else []
    if state.let_go and not state.panicked:
        before = ["NO FORCE: type release"]
    before += state.troubles
    # Tenths are cut off, not rounded: 4.96 is still beat 4.
    before += [f"{state.bar}|{math.floor(10 * state.beat) / 10:.1f}", f"{state.tempo:g} bpm"]
    after = [f"load {state.load:.0%}", f"late {state.late}", _level(state.level)]
    after += [f"quant {state.quant}"]
    if state.recording is not None:
        after.insert(0, f"rec {state.recording:.1f} s")
    playing = " · ".join(f"{player} {what}" for player, what in state.playing) or "—"
    least = min(len(playing), _WIDTH_MIN)
    while after and len(_BETWEEN.join([*before, "", *after])) + least > width:
        after.pop()
    room = max(width - len(_BETWEEN.join([*before, "", *after])), least)
    if len(playing) > room:
        playing = playing[: room - 1] + "…"
    return clean(_BETWEEN.join([*before, playing, *after]))[:width]


def _level(level: float) -> str:
    return f"{level:.1f} dB" if math.isfinite(level) else "silent"
