"""What a set on a stage meets: jumps, other scores, gestures for one key, Python, what sounds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from patience import until
from sessions import Stepped

from ergon.live.perform import bar_frames
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import ReplayedSession
from ergon.repl.session.running import rehearsal_piece
from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import stage
from tests.repl.test_repl_live import session_on
from tests.repl.test_repl_session import SCORE

NARROW = SCORE.replace(
    "keys:\n", "keys:\n  k0: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -1mm..1mm}\n"
)
MONO = SCORE.replace("channels: 2", "channels: 1").replace("to: [2]", "to: [1]")


@pytest.fixture
def stepped_session(tmp_path: Path) -> Iterator[Stepped]:
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        yield stepped


def test_play_from_bar_100_after_first_line(tmp_path: Path) -> None:
    with closing(session_on(tmp_path, "null")) as session:
        assert session.submit("ada plays knock every 1").taken
        assert session.submit("play from 100|1").text == "ok from 100|1"
        until(lambda: ("ada", "knock") in session.state().playing, "ada plays")
    replay = read_journal(tmp_path / "session.jsonl")
    began = next(one.frame for one in replay.commits if one.line.fields["goes"])
    again = ReplayedSession(replay)
    out = np.zeros((int(began + again.rate), again.n_channels))
    again.process(out)
    assert np.any(out[began:])  # within a second of the session's own time


def test_bar_frames_after_jump_are_ordered(stepped_session: Stepped) -> None:
    stepped_session.ok("play from 100|1")
    running = stepped_session.session.schedule.running
    result = bar_frames(
        running.stage, running.start_frame, running.start_frame + int(10 * stepped_session.rate)
    )
    assert result == sorted(set(result))
    assert len(result) >= 4
    assert result[0] >= running.start_frame


def test_load_with_other_channel_count_is_refused(stepped_session: Stepped, tmp_path: Path) -> None:
    (tmp_path / "mono.yaml").write_text(MONO)
    stepped_session.ok("play")
    reply = stepped_session.type(f"load {tmp_path / 'mono.yaml'}")
    assert not reply.taken
    assert "number of channels of a session cannot change" in reply.text
    stepped_session.run(4.0)
    assert stepped_session.session.state().bar > 1
    assert stepped_session.session.schedule.head.texts.path == str(tmp_path / "score.yaml")
    assert stepped_session.session.history.numbers == [0]


def test_change_refused_by_engine_is_dropped(
    stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ergon._core import EngineError

    def refuse(change):
        raise EngineError("no such change")

    stepped_session.ok("play")
    stepped_session.run(0.5)
    monkeypatch.setattr(stepped_session.engine, "change", refuse)
    before = stepped_session.session.schedule.head
    stepped_session.ok("seed 7 now")
    stepped_session.session.do_once()
    assert any("is dropped: no such change" in said for said in stepped_session.session.messages())
    assert stepped_session.session.schedule.head is before


def test_define_checks_gesture_on_keys_playing_it(tmp_path: Path) -> None:
    with closing(Stepped(NARROW, tmp_path)) as stepped_session:
        reply = stepped_session.ok("knock = 0@0 smooth 6@60ms smooth 0@160ms")
        assert "only k1" in reply.text
        stepped_session.ok("ada plays knock every 1 do scale 0.5")
        # Ada's key bears it as she plays it, at half its height.
        assert "only" not in stepped_session.ok("knock = 0@0 smooth 20@1/2 smooth 0@1").text
        refused = stepped_session.type("knock = 0@0 smooth 200@1/2 smooth 0@1")
        assert "outside the travel of key 'k1'" in refused.text
        assert stepped_session.session.submit("? knock").lines[0] == "knock on k1"


def test_rehearsal_of_gesture_outside_travel(tmp_path: Path) -> None:
    texts = Texts(str(tmp_path / "score.yaml"), NARROW.replace("6mm@", "600mm@"))
    piece = piece_of(texts)
    stage(rehearsal_piece(piece), planned=True)


def test_show_lists_current_and_next_gestures(stepped_session: Stepped) -> None:
    stepped_session.ok("play")
    stepped_session.ok("ada plays knock every 1 at 2|1")
    stepped_session.ok("ada plays lean every 2 at 9|1")
    stepped_session.run(stepped_session.session.schedule.head.piece.tempo_map.seconds(7.0))
    assert any(
        "knock from 2|1 until 9|1, then lean from 9|1" in x
        for x in stepped_session.ok("show").lines
    )


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("py piece.seed", "7"),
        ("py 1/0", "your Python raised ZeroDivisionError: division by zero"),
        ("py nothing", "your Python raised NameError: name 'nothing' is not defined"),
        ("py f(", "your Python raised SyntaxError"),
        ("py exit(3)", "your Python raised SystemExit: 3"),
    ],
)
def test_py_errors_shown_as_errors_of_typed_code(
    stepped_session: Stepped, line: str, text: str
) -> None:
    assert stepped_session.type(line).text.startswith(text)
