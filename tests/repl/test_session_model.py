"""The session as a state machine: any lines, in any state, on a machine of any speed.

Time is virtual: each making takes as long as the machine draws, while the sound goes on and the
session's other threads have their turns.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from delayed_sessions import MARGIN, Delayed, delays
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from sessions import EVERY

from ergon.repl.session.line_kinds import LineKind, must_keep_order
from ergon.scores.reading.load import load
from tests.repl.test_repl_session import SCORE

_QUICK = (
    "gain bell -6dB",
    "gain chime -3dB",
    "mute drum",
    "unmute",
    "solo bell",
    "solo gong",
    "hush",
    "damp 1s",
)
_VALUES = (
    "set bell.m.t60 0.4s",
    "set drum.m.f 95Hz over 1",
    "lfo bell.m.K 0.9..1.1 period 1bar",
    "lfo bell.m.K off",
    "rest ada",
    "tempo 150",
    "tempo 100 -> 130 over 1bar",
    "gain drum -9dB\nset drum.m.t60 0.5s",
)
_STRUCTURE = (
    "ada plays knock every 1",
    "leo plays (knock lean) ~ every 1/2",
    "rain strikes drum.m euclid 3 8 impulse 0.2mNs",
    "knock = 0@0 smooth 5@1/8 smooth 0@1/2",
    "zoe takes k3 like k1",
    "zoe plays knock every 1",
    "link k3 bell.m BUT K=900N/m gap=1mm",
    "chime = bell transpose 3st\nroute chime 1",
    "set chime.m.t60 0.6s",
    "remove chime",
    "rename bell gong",
    "set gong.m.t60 0.2s",
)
_WHEN = ("", "", " now", " at {bar}|1", " at {bar}|3.5", " in 2", " in 1bar")
_OTHERS = ("play", "play from {bar}|1", "stop now", "undo", "undo now", "redo", "panic", "release")
# Makings that take this long [s], seldom longer than a bar.
_DELAYS = st.sampled_from([0.0, 0.0, 0.004, 0.02, 0.05, 0.3, 1.2, 4.0])


class SessionMachine(RuleBasedStateMachine):
    """A session, and what it must hold after any lines."""

    @initialize(pace=st.lists(_DELAYS, min_size=1, max_size=6))
    def begin(self, pace: list[float]) -> None:
        """Begin with a piece that stands; makings take the delays of `pace` in turn."""
        self.folder = Path(tempfile.mkdtemp(prefix="ergon-model-"))
        self.delayed = Delayed(SCORE, self.folder)
        self.first = self.delayed.session.schedule.head
        self.pace, self.n_made = pace, 0
        self.delayed.delay = self.next_delay
        self.submit_frames: dict[int, int] = {}  # by number of a quick line, the frame when typed
        self.story: list[str] = []
        self.stack = ExitStack()
        self.stack.enter_context(delays(lambda: self.delayed))

    def next_delay(self) -> float:
        self.n_made += 1
        return self.pace[self.n_made % len(self.pace)]

    def type(self, line: str) -> bool:
        frame, n_lines = self.delayed.engine.frame, self.delayed.session._n_lines
        reply = self.delayed.type(line)
        self.story.append(f"{frame} {line!r}: {reply.text}")
        assert "internal error" not in reply.text, self.story
        is_late = "chime" in line or "gong" in line  # it may wait for what it names
        is_new = self.delayed.session._n_lines > n_lines  # an undo may cancel lines alone
        if reply.taken and is_new and line.split()[-1] == "now" and not is_late:
            self.submit_frames[self.delayed.session._n_lines] = frame
        return reply.taken

    @rule(
        line=st.sampled_from((*_QUICK, *_VALUES, *_STRUCTURE)),
        when=st.sampled_from(_WHEN),
        bar=st.integers(1, 12),
    )
    def types_music(self, line: str, when: str, bar: int) -> None:
        """A line that changes what plays, now, at its bar, or later."""
        if "\n" in line:
            first, _, rest = line.partition("\n")
            line = f"{first}{when.format(bar=bar)}\n{rest}"
        else:
            line += when.format(bar=bar)
        self.type(line)

    @rule(line=st.sampled_from(_OTHERS), bar=st.integers(1, 12))
    def types_control(self, line: str, bar: int) -> None:
        """A line of transport, history or stops."""
        self.type(line.format(bar=bar))

    @rule(seconds=st.sampled_from([0.003, 0.05, 0.4, 1.7, 5.0]))
    def plays_on(self, seconds: float) -> None:
        """Time passes."""
        self.delayed.run(seconds)

    @rule(seconds=st.sampled_from([0.2, 3.0, 30.0]))
    def is_suspended(self, seconds: float) -> None:
        """No thread of the session has a turn, as where the program is stopped."""
        self.story.append(f"{self.delayed.engine.frame} (suspended {seconds} s)")
        self.delayed.advance(int(seconds * self.delayed.rate) // EVERY * EVERY)

    def teardown(self) -> None:
        """What holds at the end of every session."""
        if not hasattr(self, "stack"):
            return
        try:
            self.delayed.run(1.0)
            self.check_saved()
            self.check_undone()
            self.delayed.session.close()
            self.stack.close()  # a render takes no virtual time
            events = [json.loads(row) for row in self.delayed.journal.read_text().splitlines()]
            self.check_order(events)
            self.check_quick(events)
            again = self.delayed.again()
            assert np.array_equal(again, self.delayed.sound[: len(again)]), self.story
            assert len(again) == len(self.delayed.sound), self.story
        finally:
            self.stack.close()
            self.delayed.session.close()
            shutil.rmtree(self.folder, ignore_errors=True)

    def check_saved(self) -> None:
        """What is saved has no mistakes."""
        assert self.type("save kept"), self.story
        loaded = load(self.folder / "kept.yaml")
        assert loaded.piece is not None, [self.story, loaded.diagnostics]

    def check_undone(self) -> None:
        """As many undos as lines bring back the beginning."""
        for _ in range(len(self.delayed.session.history.numbers) + len(self.story)):
            if not self.type("undo now"):
                break
            self.delayed.run(0.3)
        for _ in range(40):
            if not self.delayed.session.schedule.waiting:
                break
            self.delayed.run(0.5)
        head = self.delayed.session.schedule.head
        assert head.texts.text == self.first.texts.text, self.story
        assert head.faders == self.first.faders, self.story

    def check_order(self, events: list[dict[str, Any]]) -> None:
        """Each line takes effect once, in the order of typing where the fence holds."""
        lines = {one["number"]: one for one in events if one["event"] == "line"}
        ends = [one for one in events if one["event"] in ("commit", "dropped")]
        numbers = [one["number"] for one in ends]
        assert len(numbers) == len(set(numbers)), self.story
        waiting = {one.number for one in self.delayed.session.schedule.waiting}
        sent = {n for one in self.delayed.session.schedule.changes.pending for n in _numbers(one)}
        assert set(numbers) | waiting | sent == set(lines), self.story
        done = [(one["frame"], one["number"]) for one in ends if one["event"] == "commit"]
        fenced = [(frame, lines[number]) for frame, number in done]
        starts = _starts_by_number(events)
        plays = [number for number, line in lines.items() if line["goes"] is True]
        for place, (_, later) in enumerate(fenced):
            for _, earlier in fenced[place + 1 :]:
                first, last = earlier["number"], later["number"]
                # A line at a beat follows the piece where that jumps.
                follows = _is_at_beat(earlier) and any(first < play <= last for play in plays)
                kinds = (LineKind[line["kind"].upper()] for line in (earlier, later))
                is_overtaken = first < last and not follows and must_keep_order(*kinds)
                if is_overtaken and _is_asked_before(starts[last], first, last):
                    raise AssertionError([self.story, earlier, later])
        restoring = [line["number"] for _, line in fenced if line["restores"] not in (None, -1)]
        assert restoring == sorted(restoring), self.story

    def check_quick(self, events: list[dict[str, Any]]) -> None:
        """Faders and ends that act now take effect with the next tick."""
        kinds = {item["number"]: item["kind"] for item in events if item["event"] == "line"}
        for item in events:
            number = item.get("number")
            if item["event"] == "commit" and kinds[number] in ("faders", "ends"):
                frame = self.submit_frames.get(number)
                if frame is not None:
                    assert item["frame"] <= frame + MARGIN + 2 * EVERY, [self.story, item]


def _numbers(change: Any) -> list[int]:
    return [line.number for line in change.lines]


def _starts_by_number(events: list[dict[str, Any]]) -> dict[int, dict[int, int | None]]:
    """By the number of each line, the frames of all lines when it was typed."""
    starts: dict[int, int | None] = {}
    by_number = {}
    for row in events:
        if row["event"] in ("line", "late"):
            starts[row["number"]] = row.get("start")
        if row["event"] == "line":
            by_number[row["number"]] = {**starts}
    return by_number


def _is_at_beat(line: dict[str, Any]) -> bool:
    """Whether a line names the beat on which it acts."""
    return " at " in line["line"] or " in " in line["line"]


def _is_asked_before(starts: dict[int, int | None], first: int, last: int) -> bool:
    """Whether a line was to act at no later frame than another when that was typed."""
    before, after = starts[first], starts[last]
    return before is not None and after is not None and before <= after


def machine(n_examples: int, n_steps: int) -> Any:
    case = SessionMachine.TestCase
    case.settings = settings(
        max_examples=n_examples,
        stateful_step_count=n_steps,
        derandomize=True,
        database=None,
        deadline=None,
        phases=(Phase.generate,),  # each failure tells its story; to shrink it takes minutes
        suppress_health_check=list(HealthCheck),
    )
    return case


TestSession = machine(50, 10)


@pytest.mark.slow
def test_hundred_thousand_random_sessions_in_virtual_time() -> None:
    machine(100_000, 20)("runTest").runTest()
