"""One session by a call, a pipe, a socket and OSC, line by line and in blocks: the same journal."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from session_doors import DOORS, Door, by_osc, events
from sessions import Stepped

from ergon.repl.session import takeover
from ergon.scores.staging.stage import Stage
from tests.repl.test_repl_session import SCORE

TEXT = SCORE.replace("bpm: 120", "bpm: 240")  # a bar is a second
# Lines that are typed at one instant, and for how long the session then goes on [s]. The lines of
# a step take effect together, so that they may also be typed as a block.
STEPS: Sequence[tuple[Sequence[str], float]] = (
    (("kick = skins/tabla", "route kick 1 2", "gain kick -3dB"), 0.1),
    (("vib = bars/vibraphone notes=C2..D2", "route vib 2"), 0.1),
    (("tap = 0@0 smooth 3@1/8 smooth 0@1/4", "leo plays tap every 1"), 0.1),
    (("def fill:\n  leo plays tap every 1/2 times 4\nend", "fill at 3|1"), 0.1),
    (("play",), 0.2),
    (
        (
            "ada plays knock every 1",
            "ada do scale 0.9",
            "rain strikes vib.D2.bar.struck every 1 impulse 2mNs",
        ),
        1.0,
    ),
    (("set bell.m.K x1.3", "leo plays lean every 2"), 1.0),
    (("gain bell -6dB", "mute drum"), 0.4),
    (("ada plays nobody",), 0.1),
    (("solo bell now", "unmute now"), 0.3),
    (("couple k1 k2 K=40N/m Z=0.2Ns/m",), 1.0),
    (("undo",), 0.8),
    (("knock = 0@0 smooth 5@1/8 smooth 0@1/2", "tempo 220"), 1.2),
    (("set bell.m.f 200Hz over 1bar now",), 0.3),
    (("tempo 180 at 9|1", "rest leo at 9|1"), 0.4),
    (("damp 1s now",), 0.3),
    (("stop",), 0.2),
    (("leo plays lean every 1",), 0.1),
    (("play",), 2.0),
)


@dataclass
class Session:
    """What a session has become: its journal, its texts after each step, its sound."""

    journal: list[dict[str, Any]]
    texts: list[str] = field(default_factory=list)
    faders: list[object] = field(default_factory=list)
    sound: np.ndarray = field(default_factory=lambda: np.zeros(0))


def play(
    folder: Path, door: Door, *, in_blocks: bool = False, is_rendered: bool = False
) -> Session:
    """The session of `STEPS`, whose lines come by a door; its journal is rendered on request."""
    folder.mkdir()
    result = Session([])
    with closing(Stepped(TEXT, folder)) as stepped:
        with door(stepped, folder) as enter:
            for lines, seconds in STEPS:
                for line in ["\n".join(lines)] if in_blocks else lines:
                    enter(line)
                stepped.run(seconds)
                head = stepped.session.schedule.head
                result.texts.append(head.texts.text)
                result.faders.append(head.faders)
        stepped.close()
        result.sound, result.journal = stepped.sound, events(stepped)
        if is_rendered:
            assert np.array_equal(stepped.again(), stepped.sound)
    return result


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return play(tmp_path_factory.mktemp("typed") / "session", DOORS["call"], is_rendered=True)


def test_session_typed_by_call(typed: Session) -> None:
    answers = [
        (event["line"], event["taken"]) for event in typed.journal if event["event"] == "said"
    ]
    assert [line for line, taken in answers if not taken] == ["ada plays nobody"]
    assert len(answers) == sum(len(lines) for lines, _ in STEPS)
    assert not [event for event in typed.journal if event["event"] in ("dropped", "skip")]
    assert np.abs(typed.sound).max(axis=0).min() > 1e-6


@pytest.mark.parametrize("door", [name for name in DOORS if name != "call"])
def test_journal_of_each_input(typed: Session, tmp_path: Path, door: str) -> None:
    result = play(tmp_path / "session", DOORS[door])
    assert [event["event"] for event in result.journal] == [
        event["event"] for event in typed.journal
    ]
    # The first event has the folder of the score.
    assert result.journal[1:] == typed.journal[1:]
    assert result.texts == typed.texts
    assert np.array_equal(result.sound, typed.sound)


@pytest.mark.parametrize("door", [name for name in DOORS if name != "pipe"])
def test_blocks_equal_their_lines_by_each_input(typed: Session, tmp_path: Path, door: str) -> None:
    is_rendered = door == "call"
    result = play(tmp_path / "session", DOORS[door], in_blocks=True, is_rendered=is_rendered)
    assert result.texts == typed.texts
    assert result.faders == typed.faders
    assert _places(result) == _places(typed)
    assert np.array_equal(result.sound, typed.sound)


def _places(session: Session) -> list[tuple[int, float]]:
    """Frames and beats at which the session changed after its first `play`."""
    lines = {
        event["number"]: event["line"] for event in session.journal if event["event"] == "line"
    }
    done = [event for event in session.journal if event["event"] == "commit"]
    first = next(place for place, event in enumerate(done) if lines[event["number"]] == "play")
    return list(dict.fromkeys((event["frame"], event["beat"]) for event in done[first:]))


def test_osc_line_leaves_the_lock_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The session could hand over nothing meanwhile, so that other lines came too late."""
    is_held, staged = [], takeover.stage_spans
    with closing(Stepped(TEXT, tmp_path)) as stepped, by_osc(stepped, tmp_path) as enter:

        def look(*given: Any, **named: Any) -> Stage:
            is_held.append(stepped.session.schedule.lock._is_owned())
            return staged(*given, **named)

        monkeypatch.setattr(takeover, "stage_spans", look)
        enter("ada plays knock every 1")
        assert is_held == [False]
