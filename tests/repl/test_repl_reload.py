"""`reload` and `--watch`: what was typed stays, what the files say comes, conflicts are named."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.watch import FileWatch
from ergon.scores.edits.texts import Texts
from tests.repl.test_repl_session import SCORE

LINES = ("ada plays knock every 1 now", "set bell.m.t60 2s now", "tempo 90 now")


@pytest.fixture
def stepped_session(tmp_path: Path) -> Iterator[Stepped]:
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        yield stepped


def edited(folder: Path, *changes: tuple[str, str]) -> None:
    path = folder / "score.yaml"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)


def renders_the_same(stepped_session: Stepped) -> None:
    stepped_session.close()
    again = stepped_session.again()
    assert np.max(np.abs(again)) > 0
    assert np.array_equal(again, stepped_session.sound[: len(again)])


LEO = ("lean: 0mm@0 smooth 3mm@1", "lean: 0mm@0 smooth 4mm@1")


def test_reload_keeps_typed_lines_to_the_bit(tmp_path: Path) -> None:
    """The file's own change is of a gesture that nobody plays."""
    listened = []
    for name, reloads in (("a", True), ("b", False)):
        folder = tmp_path / name
        folder.mkdir()
        with closing(Stepped(SCORE, folder)) as stepped_session:
            stepped_session.ok("play")
            for line in LINES:
                stepped_session.ok(line)
                stepped_session.run(1.0)
            if reloads:
                edited(folder, LEO)
                reply = stepped_session.ok("reload")
                assert "dropped" not in reply.text
            stepped_session.run(6.0)
            text = stepped_session.session.schedule.head.texts.text
            assert ("smooth 4mm@1" in text) == reloads
            assert "t60: 2s" in text
            listened.append(stepped_session.sound)
            if reloads:
                renders_the_same(stepped_session)
    assert np.any(listened[0])
    assert np.array_equal(*listened)


def test_reload_conflict_takes_value_of_file(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("play")
    stepped_session.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2 now")
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(1.0)
    before = stepped_session.session.schedule.head.texts.text
    edited(tmp_path, ("knock: 0mm@0 smooth 6mm", "knock: 0mm@0 smooth 7mm"), ("f: 90Hz", "f: 80Hz"))
    reply = stepped_session.ok("reload now")
    line = "'knock = 0@0 smooth 5@1/8 smooth 0@1/2 now'"
    assert f"gestures.knock was changed by {line} and in the file; " in reply.text
    assert "the value in the file is kept, and the line is discarded" in reply.text
    stepped_session.run(2.0)
    text = stepped_session.session.schedule.head.texts.text
    assert "smooth 7mm@1/8 smooth 0mm@1/2     # once" in text
    assert "f: 80Hz" in text
    assert "play: knock, every: 1" in text
    assert any("smooth 5@1/8" in row for row in stepped_session.ok("history").lines)
    stepped_session.ok("undo now")
    stepped_session.run(2.0)
    assert stepped_session.session.schedule.head.texts.text == before
    # What was taken back comes again with the next reload.
    assert "gestures.knock was changed by" in stepped_session.ok("reload now").text
    stepped_session.run(2.0)
    renders_the_same(stepped_session)


def test_reload_drops_lines_with_missing_gesture(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("play")
    stepped_session.ok("leo plays lean every 2 now")
    stepped_session.ok("set bell.m.t60 2s now")
    stepped_session.run(1.0)
    edited(tmp_path, ("  lean: 0mm@0 smooth 3mm@1 smooth 0mm@2\n", ""))
    reply = stepped_session.ok("reload now")
    assert "parts.leo" in reply.text
    assert "was changed by 'leo plays lean every 2 now' and in the file" in reply.text
    stepped_session.run(2.0)
    assert "t60: 2s" in stepped_session.session.schedule.head.texts.text
    renders_the_same(stepped_session)


def test_reload_waiting_for_bar_keeps_lines_before(
    stepped_session: Stepped, tmp_path: Path
) -> None:
    stepped_session.ok("play")
    stepped_session.run(0.2)
    edited(tmp_path, LEO)
    stepped_session.ok("reload at 3|1")
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(6.0)
    text = stepped_session.session.schedule.head.texts.text
    assert "smooth 4mm@1" in text
    assert "play: knock, every: 1" in text
    renders_the_same(stepped_session)


def test_reload_after_save_compares_saved_text(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("play")
    for line in LINES:
        stepped_session.ok(line)
        stepped_session.run(1.0)
    stepped_session.ok("save")
    edited(tmp_path, LEO, ("t60: 2s", "t60: 3s"))
    assert "dropped" not in stepped_session.ok("reload now").text
    stepped_session.run(2.0)
    text = stepped_session.session.schedule.head.texts.text
    assert "t60: 3s" in text
    assert "until: 999|1" in text  # ada goes on
    renders_the_same(stepped_session)


def test_reload_in_resumed_session(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("play")
    for line in LINES:
        stepped_session.ok(line)
        stepped_session.run(1.0)
    stepped_session.close()
    edited(tmp_path, LEO)
    with closing(Stepped.resumed(stepped_session.journal)) as two:
        two.ok("play")
        assert "dropped" not in two.ok("reload now").text
        two.run(2.0)
        text = two.session.schedule.head.texts.text
        assert "smooth 4mm@1" in text
        assert "t60: 2s" in text
        renders_the_same(two)


@pytest.mark.parametrize("text", ["", "[]", "nonsense", "ergon: 1\nkeys: {k: {M: x}}\n", "\0"])
def test_reload_of_invalid_score_is_refused(
    stepped_session: Stepped, tmp_path: Path, text: str
) -> None:
    stepped_session.ok("play")
    stepped_session.ok("set bell.m.t60 2s now")
    before = stepped_session.session.schedule.head
    (tmp_path / "score.yaml").write_text(text)
    reply = stepped_session.type("reload")
    assert not reply.taken
    assert "internal" not in reply.text
    assert stepped_session.session.schedule.head is before


def test_watch_follows_loaded_score(stepped_session: Stepped, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(SCORE)
    stepped_session.session.file_watch = FileWatch(Texts.read(tmp_path / "score.yaml"))
    stepped_session.ok(f"load {other}")
    os.utime(tmp_path / "score.yaml", (1, 1))
    assert not stepped_session.session.file_watch.has_changed()
    os.utime(other, (1, 1))
    assert stepped_session.session.file_watch.has_changed()


@pytest.mark.parametrize(
    "row",
    [
        None,
        {},
        {"number": 7, "score": "score.yaml", "files": {}},
        {"number": -2, "score": "score.yaml", "files": {"": [0, 9, ""]}},
        {"number": -2, "score": "score.yaml", "files": {"": "text"}},
        {"number": -2, "score": "score.yaml", "files": {"../x.yaml": [0, 0, ""]}},
        {"number": 0, "score": "score.yaml", "files": {}},
    ],
)
def test_forged_history_in_journal_is_refused(stepped_session: Stepped, row: object) -> None:
    stepped_session.close()
    first, *rest = stepped_session.journal.read_text().splitlines()
    good = {"number": 0, "score": str(stepped_session.journal.parent / "score.yaml"), "files": {}}
    fields = {**json.loads(first), "history": [row, good], "index": 1}
    stepped_session.journal.write_text("\n".join([json.dumps(fields), *rest, ""]))
    with pytest.raises(JournalError, match="line 1"):
        read_journal(stepped_session.journal)
