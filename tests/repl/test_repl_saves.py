"""`save`: all that was changed or nothing, below the score's folder, over nobody's work."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from commands import ERGON, PATIENT
from patience import PATIENCE
from sessions import EVERY, Stepped

from ergon.exchange import safe
from ergon.notation.text.files import installed_path
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import resumed_state
from ergon.repl.session.session import Session
from ergon.repl.session.version import piece_of
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from tests.repl.test_journal_hostile import KEYS, SCORE

REMARKS = "# Nothing is in here yet.\n"


@pytest.fixture
def stepped_session(tmp_path: Path) -> Iterator[Stepped]:
    (tmp_path / "keys.yaml").write_text(KEYS)
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        yield stepped


def files(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".jsonl"
    }


def gone_on(folder: Path) -> Session:
    """A session that goes on where the journal ends."""
    replay = read_journal(folder / "session.jsonl", resumes=True)
    version, clock, past = resumed_state(replay)
    return Session(
        version,
        lambda stage: SteppedEngine(stage, tick_frames=EVERY, highpass=None),
        margin=0.0,
        clock=clock,
        disk=replay.disk,
        past=past,
    )


def says_the_same(session: Session, path: Path) -> None:
    """What lies on the disk is what plays, for who reads it."""
    piece = load(path).piece
    assert piece is not None
    assert digest_of(piece) == digest_of(piece_of(session.schedule.head.texts))


def test_save_writes_only_changed_files(stepped_session: Stepped, tmp_path: Path) -> None:
    assert (
        stepped_session.ok("save").text
        == "ok nothing to write: the files already hold this version"
    )
    stamp = (tmp_path / "score.yaml").stat().st_mtime_ns
    stepped_session.ok("set k1.M 500g")
    assert stepped_session.ok("save").text == f"ok wrote {tmp_path / 'keys.yaml'}"
    assert (tmp_path / "score.yaml").stat().st_mtime_ns == stamp
    says_the_same(stepped_session.session, tmp_path / "score.yaml")
    stepped_session.ok("undo")
    stepped_session.ok("save")
    assert files(tmp_path) == {"score.yaml": SCORE, "keys.yaml": KEYS}


@pytest.mark.parametrize("edited", ["score.yaml", "keys.yaml"])
def test_save_does_not_replace_edited_files(
    stepped_session: Stepped, tmp_path: Path, edited: str
) -> None:
    stepped_session.ok("set k1.M 500g")
    stepped_session.ok("set ring.m.M 3g")
    path = tmp_path / edited
    path.write_text(path.read_text() + "# mine\n")
    before = files(tmp_path)
    reply = stepped_session.type("save")
    assert not reply.taken
    assert f"{path} was changed on the disk" in reply.text
    assert "save NAME" in reply.text
    assert files(tmp_path) == before
    stepped_session.ok("save mine")  # nothing is lost
    says_the_same(stepped_session.session, tmp_path / "mine.yaml")
    assert {name: files(tmp_path)[name] for name in before} == before
    stepped_session.ok("reload")
    stepped_session.ok("set k1.M 600g")
    stepped_session.ok("save")
    assert "M: 600g" in (tmp_path / "keys.yaml").read_text()


def test_save_in_resumed_session_over_edited_file(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("set ring.m.M 3g")
    stepped_session.close()
    with closing(gone_on(tmp_path)) as session:
        (tmp_path / "score.yaml").write_text(SCORE + "# mine\n")
        assert "was changed on the disk" in session.submit("save").text
        assert files(tmp_path)["score.yaml"] == SCORE + "# mine\n"
        (tmp_path / "score.yaml").write_text(SCORE)
        assert session.submit("save").taken
        says_the_same(session, tmp_path / "score.yaml")


def test_save_after_session_resumed_twice(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("set k1.M 500g")
    stepped_session.ok("save")
    stepped_session.ok("set k1.M 600g")
    stepped_session.close()
    for _ in range(2):
        with closing(gone_on(tmp_path)) as session:
            message = session.disk.hashes_by_name(session.schedule.head.texts)
        events = [json.loads(line) for line in stepped_session.journal.read_text().splitlines()]
        texts = session.schedule.head.texts
        overlay = {Path(name).name: text for name, text in texts.overlay.items()}
        opening = {**events[0], "text": texts.text, "disk": message}
        opening["overlay"] = {**events[0]["overlay"], "keys.yaml": overlay["keys.yaml"]}
        stepped_session.journal.write_text(json.dumps(opening) + "\n")
    with closing(gone_on(tmp_path)) as session:
        assert session.submit("save").taken
    assert "M: 600g" in (tmp_path / "keys.yaml").read_text()


def test_save_of_library_edit_writes_beside_score(stepped_session: Stepped, tmp_path: Path) -> None:
    library = installed_path("instruments/bell.yaml")
    before = library.read_bytes(), library.stat().st_mtime_ns
    stepped_session.ok("set bell.hum.t60 x0.5")
    assert str(tmp_path / "instruments" / "bell.yaml") in stepped_session.ok("save").text
    assert (library.read_bytes(), library.stat().st_mtime_ns) == before
    says_the_same(stepped_session.session, tmp_path / "score.yaml")
    stepped_session.ok("set bell.hum.t60 x0.5")
    stepped_session.ok("save")
    says_the_same(stepped_session.session, tmp_path / "score.yaml")
    stepped_session.ok("undo")
    stepped_session.ok("undo")
    stepped_session.ok("save")
    assert (tmp_path / "instruments" / "bell.yaml").read_bytes() == before[0]


def test_save_of_bundled_score_in_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = installed_path("one-gesture.yaml")
    before = shipped.read_bytes(), sorted(os.listdir(shipped.parent))
    lines = "seed 5\nsave\nkeep 1bar as one-gesture\nsave mine\nquit\n"
    done = subprocess.run(
        [*PATIENT, "repl", str(shipped), "--audio", "null", "--gain", "0dB", "--plain"],
        input=lines,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert "never changed" in done.stdout
    assert "ok wrote mine.yaml" in done.stdout
    assert (shipped.read_bytes(), sorted(os.listdir(shipped.parent))) == before
    assert load("mine.yaml").piece is not None


def test_save_under_other_name_copies_used_files(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("set k1.M 500g")
    stepped_session.ok("set bell.hum.t60 x0.5")
    stepped_session.ok("save live")
    result = files(tmp_path)
    assert result.pop("score.yaml") == SCORE
    assert result.pop("keys.yaml") == KEYS
    assert sorted(result) == ["live.yaml", "live/instruments/bell.yaml", "live/keys.yaml"]
    assert "use: [live/keys.yaml, live/instruments/bell.yaml]" in result["live.yaml"]
    says_the_same(stepped_session.session, tmp_path / "live.yaml")
    stepped_session.ok("set k1.M 600g")
    stepped_session.ok("save live")  # its own, which nobody has changed since
    says_the_same(stepped_session.session, tmp_path / "live.yaml")


@pytest.mark.parametrize("there", ["live.yaml", "live/keys.yaml"])
def test_refused_save_writes_no_file(stepped_session: Stepped, tmp_path: Path, there: str) -> None:
    stepped_session.ok("set k1.M 500g")
    (tmp_path / there).parent.mkdir(exist_ok=True)
    (tmp_path / there).write_text("made by ergon? Mine.\n")
    before = files(tmp_path)
    reply = stepped_session.type("save live")
    assert not reply.taken
    assert "already exists" in reply.text
    assert files(tmp_path) == before


def test_keep_includes_edited_key_values(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("play")
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.ok("set k1.M 500g now")
    stepped_session.run(4.0)
    stepped_session.ok("keep 1bar as verse")
    piece = load(tmp_path / "verse.yaml").piece
    assert piece is not None
    assert piece.keys["k1"].modules[0].fields["M"] == 0.5
    assert not stepped_session.type("keep 1bar as score").taken
    assert files(tmp_path)["score.yaml"] == SCORE


@pytest.mark.parametrize("fails", [1, 2])
def test_save_on_full_disk_changes_no_file(
    stepped_session: Stepped, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    stepped_session.ok("set k1.M 500g")
    stepped_session.ok("set ring.m.M 3g")
    stepped_session.ok("set bell.hum.t60 x0.5")
    count, put = 0, safe._move_to_target

    def failing(part: Path, target: Path, *, is_new: bool) -> None:
        nonlocal count
        count += 1
        if count > fails:
            raise OSError(28, "No space left on device")
        put(part, target, is_new=is_new)

    before = files(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(safe, "_move_to_target", failing)
        reply = stepped_session.type("save")
    assert "No space left" in reply.text
    assert files(tmp_path) == before
    assert not (tmp_path / "instruments").exists()
    stepped_session.ok("save")
    says_the_same(stepped_session.session, tmp_path / "score.yaml")


def test_save_refuses_links_and_paths_outside(
    stepped_session: Stepped, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    outside = tmp_path_factory.mktemp("elsewhere") / "new.yaml"
    (tmp_path / "live.yaml").symlink_to(outside)
    (tmp_path / "round.yaml").symlink_to("round.yaml")
    (tmp_path / "instruments").symlink_to(outside.parent)
    stepped_session.ok("set bell.hum.t60 x0.5")
    for line in (
        "save live",
        "save round",
        "save",
        f"save {outside}",
        "save ../x",
        "save /dev/full",
    ):
        reply = stepped_session.type(line)
        assert not reply.taken, line
        assert "ergon itself" not in reply.text
    assert list(outside.parent.iterdir()) == []


def test_save_with_used_file_of_comments_only(tmp_path: Path) -> None:
    (tmp_path / "keys.yaml").write_text(KEYS)
    (tmp_path / "later.yaml").write_text(REMARKS)
    text = SCORE.replace("use: [", "use: [later.yaml, ")
    with closing(Stepped(text, tmp_path)) as stepped:
        stepped.ok("play")
        stepped.ok("ada plays knock every 1 now")
        stepped.ok("set k1.M 500g")
        stepped.ok("save")
    assert (tmp_path / "later.yaml").read_text() == REMARKS


# --- as a stranger would have it -----------------------------------------------------------------


def resumed_by_hand(folder: Path, *words: str, lines: str = "save\nquit\n") -> str:
    done = subprocess.run(
        [*PATIENT, "repl", *words, "--audio", "null", "--gain", "0dB", "--plain"],
        cwd=folder,
        input=lines,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert "Traceback" not in done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("field", ["overlay", "score"])
def test_journal_with_foreign_paths_saves_no_file(
    stepped_session: Stepped, tmp_path: Path, field: str
) -> None:
    """What was proved: an absolute path in the first line, and `save` wrote it."""
    stepped_session.close()
    victim = tmp_path.parent / f"{tmp_path.name}-victim.py"
    victim.write_text("print('mine')\n")
    events = [json.loads(line) for line in stepped_session.journal.read_text().splitlines()]
    if field == "overlay":
        events[0]["overlay"][str(victim)] = "import os\n"
    else:
        events[0]["score"] = str(victim)
    stepped_session.journal.write_text("".join(json.dumps(event) + "\n" for event in events))
    message = resumed_by_hand(tmp_path, "--resume", "session.jsonl")
    assert victim.read_text() == "print('mine')\n"
    assert "session.jsonl, line 1: " in message
    victim.unlink()


def test_resume_with_score_in_other_folder(stepped_session: Stepped, tmp_path: Path) -> None:
    stepped_session.ok("set ring.m.M 3g")
    stepped_session.close()
    here = tmp_path / "desk"
    here.mkdir()
    stepped_session.journal.rename(here / "session.jsonl")
    score = str(tmp_path / "score.yaml")
    message = resumed_by_hand(here, "--resume", "session.jsonl")
    assert f"ergon repl {score} --resume" in message
    message = resumed_by_hand(here, score, "--resume", "session.jsonl")
    assert f"ok wrote {score}" in message
    assert "M: 3g" in (tmp_path / "score.yaml").read_text()
    rendered = subprocess.run(
        [*ERGON, "render", "session.jsonl", "-o", "x.wav"], cwd=here, capture_output=True, text=True
    )
    assert "the session played nothing" in rendered.stderr  # it was read, at least
