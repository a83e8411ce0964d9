"""What a line of a session may compute is limited, and it can be dropped; the music goes on."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
from patience import PATIENCE
from sessions import Stepped

from ergon._core import StoppedError, Work
from ergon.notation.text.memory import Memory
from ergon.repl.session import computing
from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
rates: {audio: 2000kHz}
keys: {k: {M: 400g, f: 90kHz, travel: -9mm..9mm}}
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: 200Hz, t60: 1s}}, b: {BUT: {between: [k, m], K: 900N/m}}}
    out: {SOX: m}
gestures: {knock: 0mm@0 1mm@1/8 0mm@1/4, far: 0mm@0s throw 1mm@80000s}
players: {ada: {key: k}}
parts: {ada: []}
"""


@pytest.fixture
def stepped(tmp_path):
    stepped = Stepped(SCORE, tmp_path, keeps=False)
    yield stepped
    stepped.close()


def test_line_above_step_limit_is_refused(stepped, monkeypatch):
    stepped.ok("play")
    text = stepped.session.schedule.head.texts.text
    monkeypatch.setattr(computing, "LINE_STEPS", 0)
    monkeypatch.setattr(computing, "FILES_STEPS", 30_000_000)
    reply = stepped.type("ada plays knock")
    assert not reply.taken
    assert "takes more than 0 million steps to compute" in reply.text
    assert "nothing has changed" in reply.text
    assert "`reload`, which has 30 million" in reply.text
    assert stepped.session.schedule.head.texts.text == text
    assert not stepped.session.schedule.waiting
    frame = stepped.engine.frame
    stepped.run(0.001)
    assert stepped.engine.frame == frame + 2000  # it goes on
    monkeypatch.setattr(computing, "LINE_STEPS", 1 << 60)
    stepped.ok("ada plays knock")


def test_reload_has_the_step_limit_for_files(stepped, monkeypatch):
    monkeypatch.setattr(computing, "LINE_STEPS", 0)
    stepped.ok("reload")
    stepped.ok("play")
    monkeypatch.setattr(computing, "FILES_STEPS", 0)
    reply = stepped.type("reload")
    assert not reply.taken
    assert "more than 0 million steps" in reply.text


def test_line_step_count_is_reproducible(tmp_path):
    """The least limit that suffices is found by halving, twice."""

    def least(folder) -> int:
        texts = Texts(str(folder / "s.yaml"), SCORE)
        low, high = 0, 1 << 40
        while high - low > 1:
            middle = (low + high) // 2
            try:
                with Work(middle):
                    stage(piece_of(replace(texts, memory=Memory())), planned=True, store=None)
            except StoppedError:
                low = middle
            else:
                high = middle
        return high

    first = least(tmp_path)
    assert 0 < first < 1 << 40
    assert least(tmp_path) == first


@pytest.mark.parametrize("how", ["cancel", "panic"])
def test_cancel_and_panic_while_line_is_computed(stepped, monkeypatch, how):
    monkeypatch.setattr(computing, "LINE_STEPS", 1 << 60)
    stepped.ok("play")
    text = stepped.session.schedule.head.texts.text
    begun = threading.Event()
    from ergon.scores.staging import travel

    rehearsed = travel._rehearsed_range

    def rehearse_begun(*of):
        begun.set()
        return rehearsed(*of)

    monkeypatch.setattr(travel, "_rehearsed_range", rehearse_begun)
    replies = []
    thread = threading.Thread(target=lambda: replies.append(stepped.type("ada plays far")))
    thread.start()
    assert begun.wait(PATIENCE)  # it would take hours
    getattr(stepped.session, how)()
    thread.join(PATIENCE)
    assert [reply.text for reply in replies] == ["cancelled; nothing has changed"]
    assert not replies[0].taken
    if how == "cancel":
        assert stepped.session.schedule.head.texts.text == text
        assert not stepped.session.cancel()  # nothing is computed now
