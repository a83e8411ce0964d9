"""Small lines that must not guess: `rest`, `tap`; and what `scope` and `meters` show."""

from __future__ import annotations

from pathlib import Path

import pytest
from sessions import Stepped
from tests.repl.test_repl_session import SCORE


@pytest.fixture
def own(tmp_path: Path) -> Stepped:
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    return stepped


def test_rest_names_who_may_rest(own: Stepped):
    said = own.type("rest")
    assert not said.taken
    assert "rest ada, rest leo or rest all" in said.text


def test_two_taps_set_the_tempo(own: Stepped, monkeypatch: pytest.MonkeyPatch):
    now = iter([10.0, 10.5])
    monkeypatch.setattr("ergon.repl.session.session_commands.time.monotonic", lambda: next(now))
    assert own.ok("tap").text == "tap 1: one more sets the tempo"
    own.ok("tap")
    assert own.session.commits.head.piece.tempo_map.bpm(100.0) == 120.0


def test_scope_draws_where_the_key_has_been(own: Stepped):
    own.ok("ada plays knock every 1 now")
    own.run(2.2)
    head, *drawing = own.ok("scope ada").lines
    assert "ada on k1" in head
    assert "last 2.0 s" in head
    assert len(drawing) > 5
    own.ok("rest ada now")
    own.run(0.5)
    assert "ada on k1" in own.ok("scope ada").lines[0], "a key also moves where nothing plays"
    refused = own.type("scope nobody")
    assert not refused.taken
