"""The status line: position, who plays what, and the state of machine and sound."""

from __future__ import annotations

import math

from ergon.common.terminal import clean
from ergon.repl.session_protocol import State

_FIELD_SEPARATOR = "  "
_PLAYERS_WIDTH_MIN = 12  # characters that the list of players keeps


def status(session_state: State, line_width: int) -> str:
    """The state in one line of at most `line_width` characters.

    If there is not enough room, the list of what plays is shortened, then fields at the end are
    left out.
    """
    texts_before = ["PANIC: type release"] if session_state.panicked else []
    if session_state.let_go and not session_state.panicked:
        texts_before = ["NO FORCE: type release"]
    texts_before += session_state.troubles
    # Tenths are cut off, not rounded: 4.96 is still beat 4.
    texts_before += [
        f"{session_state.bar}|{math.floor(10 * session_state.beat) / 10:.1f}",
        f"{session_state.tempo:g} bpm",
    ]
    texts_after = [
        f"load {session_state.load:.0%}",
        f"late {session_state.late}",
        _level_text(session_state.level),
    ]
    texts_after += [f"quant {session_state.quant}"]
    if session_state.recording is not None:
        texts_after.insert(0, f"rec {session_state.recording:.1f} s")
    playing_text = (
        " · ".join(f"{player} {played_name}" for player, played_name in session_state.playing)
        or "—"
    )
    width_min = min(len(playing_text), _PLAYERS_WIDTH_MIN)
    while (
        texts_after
        and len(_FIELD_SEPARATOR.join([*texts_before, "", *texts_after])) + width_min > line_width
    ):
        texts_after.pop()
    playing_width = max(
        line_width - len(_FIELD_SEPARATOR.join([*texts_before, "", *texts_after])), width_min
    )
    if len(playing_text) > playing_width:
        playing_text = playing_text[: playing_width - 1] + "…"
    return clean(_FIELD_SEPARATOR.join([*texts_before, playing_text, *texts_after]))[:line_width]


def _level_text(level: float) -> str:
    return f"{level:.1f} dB" if math.isfinite(level) else "silent"
