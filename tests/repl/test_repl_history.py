"""`undo`, `redo` and `history`: in order of effect, across `--resume`, as journals render."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

from tests.repl.test_repl_session import SCORE


@pytest.fixture
def stepped_session(tmp_path: Path) -> Iterator[Stepped]:
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        yield stepped


def renders_the_same(stepped_session: Stepped) -> None:
    stepped_session.close()
    again = stepped_session.again()
    assert np.max(np.abs(again)) > 0
    assert np.array_equal(again, stepped_session.sound[: len(again)])


def test_undo_in_order_of_effect(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    stepped_session.run(0.3)
    stepped_session.ok("ada plays knock every 1 at 3|1")
    stepped_session.ok("set bell.m.t60 2s now")
    stepped_session.run(5.0)
    stepped_session.ok("seed 3 now")
    stepped_session.run(0.3)
    assert [row[17:] for row in stepped_session.ok("history").lines] == [
        "(the score)",
        "set bell.m.t60 2s now",
        "ada plays knock every 1 at 3|1",
        "seed 3 now",
    ]
    stepped_session.ok("undo now")  # the seed
    stepped_session.run(0.3)
    assert "knock, every: 1" in stepped_session.session.schedule.head.texts.text
    assert "t60: 2s" in stepped_session.session.schedule.head.texts.text
    stepped_session.ok("undo now")  # ada, who began last
    stepped_session.run(0.3)
    assert "knock, every: 1" not in stepped_session.session.schedule.head.texts.text
    assert "t60: 2s" in stepped_session.session.schedule.head.texts.text
    stepped_session.ok("back 1 now")
    stepped_session.run(0.3)
    assert stepped_session.session.schedule.head.texts.text == SCORE
    renders_the_same(stepped_session)


def test_back_withdraws_waiting_lines(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(1.0)
    stepped_session.ok("set bell.m.t60 2s at 9|1")
    stepped_session.ok("seed 3 at 9|1")
    assert "are cancelled before they took effect" in stepped_session.ok("back 2").text
    assert not stepped_session.session.schedule.waiting
    stepped_session.ok("redo")
    assert "t60: 2s" in stepped_session.session.schedule.head.texts.text
    assert [one.beat for one in stepped_session.session.schedule.waiting] == [32.0]
    stepped_session.ok("back 2 now")
    stepped_session.run(20.0)
    assert stepped_session.session.schedule.head.texts.text == SCORE
    renders_the_same(stepped_session)


def test_history_after_resume(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    for line in ("ada plays knock every 1 now", "set bell.m.t60 2s", "gain bell -6dB", "seed 3"):
        stepped_session.ok(line)
        stepped_session.run(2.5)
    stepped_session.ok("undo")
    stepped_session.run(2.5)
    rows = stepped_session.ok("history").lines
    before = stepped_session.session.schedule.head
    stepped_session.close()
    with closing(Stepped.resumed(stepped_session.journal)) as two:
        assert two.ok("history").lines == rows
        two.ok("play")
        two.ok("undo now")  # the gain
        two.run(1.0)
        assert two.session.schedule.head.texts.text == before.texts.text
        assert two.session.schedule.head.faders.gains == {}
        two.ok("undo now")
        two.run(1.0)
        assert "t60: 2s" not in two.session.schedule.head.texts.text
        two.ok("redo now")
        two.ok("leo plays knock every 1 now")
        two.run(2.0)
        rows = two.ok("history").lines
        renders_the_same(two)
    with closing(Stepped.resumed(two.journal)) as three:
        assert three.ok("history").lines == rows
        three.ok("play")
        three.ok("back 3 now")
        three.run(1.0)
        assert three.session.schedule.head.texts.text == SCORE
        three.ok("redo now")
        three.run(2.0)
        renders_the_same(three)


def test_resume_without_line_dropped_by_panic(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    stepped_session.run(0.5)
    stepped_session.ok("ada plays knock every 1 at 9|1")
    stepped_session.ok("panic")
    stepped_session.run(0.5)
    text = stepped_session.session.schedule.head.texts.text
    stepped_session.close()
    with closing(Stepped.resumed(stepped_session.journal)) as two:
        assert two.session.schedule.head.texts.text == text


def test_play_from_keeps_waiting_lines(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    stepped_session.run(0.5)
    stepped_session.ok("seed 3 at 5|1")
    stepped_session.ok("set bell.m.t60 2s now")
    stepped_session.ok("play from 100|1")
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(12.0)
    assert not stepped_session.session.schedule.waiting
    text = stepped_session.session.schedule.head.texts.text
    assert all(typed in text for typed in ("seed: 3", "t60: 2s", "play: knock, every: 1"))
    renders_the_same(stepped_session)
