"""What is wrong stands in every status line: gaps, a full disk, a dead engine, hot boards."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ergon.live.display import HandView, PerformanceView, decibels_of, view_lines
from ergon.live.trouble import troubles
from ergon.repl.prompt.status import status as status_line
from ergon.repl.session_protocol import State
from ergon.repl.wire.protocol import decode_state, encode_state


@dataclass(frozen=True)
class Hand:
    hot: bool = False
    tripped: bool = False
    let_go: int = 0
    stalls: int = 0


@dataclass(frozen=True)
class Status:
    ticks: int = 100
    alive: bool = True
    done: bool = False
    underruns: int = 0
    input_gaps: int = 0
    xruns: int = 0
    lost: int = 0
    hands: list[Hand] = field(default_factory=lambda: [Hand()])


FINE = Status()


def trouble_lines(
    status: Status, recording: str | None = None, *, is_endless: bool = True
) -> list[str]:
    return list(troubles(status, ["remi"], recording, is_endless=is_endless))


def test_trouble_lines_of_each_status():
    assert trouble_lines(FINE) == []
    assert trouble_lines(replace(FINE, underruns=2, xruns=1, lost=1)) == [
        "gaps 3",
        "clock resets 1",
    ]
    assert trouble_lines(replace(FINE, input_gaps=2)) == ["input gaps 2"]
    assert trouble_lines(replace(FINE, alive=False)) == ["NO SOUND OUTPUT"]
    assert trouble_lines(replace(FINE, done=True)) == ["ENGINE ENDED"]
    assert trouble_lines(replace(FINE, done=True, alive=False), is_endless=False) == []
    assert trouble_lines(FINE, "No space left") == ["HANDS NOT RECORDED (No space left)"]
    hand = Hand(hot=True, tripped=True, let_go=2, stalls=1)
    assert trouble_lines(replace(FINE, hands=[hand])) == [
        "remi MOTOR HOT",
        "remi tripped",
        "remi forces dropped by device 2",
        "remi host stalls 1",
    ]


def test_status_line_with_troubles_first():
    state = State(3, 1.0, 120.0, playing=(("ada", "knock"),), troubles=("gaps 3", "remi HOT"))
    assert status_line(state, 80).startswith("gaps 3  remi HOT  3|1.0")
    assert decode_state(encode_state(state)) == state


def test_view_lines_with_troubles_and_sent_force():
    hand = HandView("remi", "k2", 0.0, (-0.01, 0.01), 0.45, True, False, 0.037, 0.083)
    view = PerformanceView("1|1", (), (hand,), 0.1, 0, 3, -12.0, ("gaps 3",), True)
    where, counts, key = view_lines(view, 200)
    assert "PANIC" in where
    assert "gaps 3" in counts
    assert "+0.450 N, sent  +0.037 N (8.3 %)" in key


def test_decibels_of_inaudible_level_minus_infinity():
    assert decibels_of(1.0) == 0.0
    assert decibels_of(1e-43) == float("-inf")
    assert decibels_of(0.0) == float("-inf")
