"""Journals of strangers: they name files and write none, they read nothing that is not theirs."""

from __future__ import annotations

import copy
import hashlib
import json
import os
import random
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_bell import SCORE as BELL
from sessions import EVERY, Stepped

from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import ReplayedSession, resumed_state
from ergon.repl.session.session import Session
from ergon.repl.session.version import NotTakenError
from ergon.scores.staging.refusals import StageError

KEYS = """\
ergon: 1
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
"""
SCORE = (
    BELL.replace("bell", "ring")
    .replace(KEYS.split("\n", 1)[1], "use: [keys.yaml, instruments/bell.yaml]\n")
    .replace("parts:\n  ada:\n    - {at: A, play: knock, every: 1, times: 2}", "parts:\n  ada: []")
    .replace("t60: 0.5s", "t60: 0.1s")
    .replace("to: [1, 2]}", "to: [1, 2]}, {from: bell, to: [1]}")
)
REFUSED = (JournalError, NotTakenError, StageError)
TYPED = ("save", "save other", "keep 2bar as verse", "save", "save other")


class Sandbox:
    """A folder with a score and its journal, and beside it what is none of a journal's business."""

    def __init__(self, folder: Path) -> None:
        self.inside, self.outside = folder / "inside", folder / "outside"
        for place in (self.inside, self.outside):
            place.mkdir()
            (place / "keys.yaml").write_text(KEYS)
            (place / "score.yaml").write_text(SCORE)
        (self.outside / ".bashrc").write_text("export PS1=x\n")
        (self.outside / "tool.py").write_text("print('hello')\n")
        os.mkfifo(self.outside / "pipe")
        (self.inside / "out").symlink_to(self.outside)
        (self.inside / "leads-out.yaml").symlink_to(self.outside / "new.yaml")
        (self.inside / "loop").symlink_to("loop")
        with closing(Stepped(SCORE, self.inside)) as stepped:
            for line in ("play", "ada plays knock every 1", "set ring.m.M x1.5", "set k1.M 500g"):
                stepped.ok(line)
                stepped.run(0.3)
            stepped.run(2.5)
            stepped.ok("keep 2bar as verse-1")
            stepped.ok("reload")
            for line in ("ada plays knock every 2", "set bell.hum.t60 x2", "undo", "set k1.M 450g"):
                stepped.ok(line)
            stepped.run(2.5)
        (self.inside / "verse-1.yaml").unlink()
        for path in (self.inside / "verse-1").rglob("*.yaml"):
            path.unlink()
        (self.inside / "verse-1").rmdir()
        lines = (self.inside / "session.jsonl").read_text().splitlines()
        self.events: list[dict[str, Any]] = [json.loads(line) for line in lines]
        self.opened: list[str] = []
        self.is_watched = False
        sys.addaudithook(self._audit)  # stays as long as the process; it looks where it is asked to

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.is_watched and event == "open" and isinstance(arguments[0], str | bytes):
            real = os.path.realpath(os.fsdecode(arguments[0]))
            if real.startswith((str(self.outside), "/etc/", "/dev/")):
                self.opened.append(real)

    def seen(self, folder: Path) -> dict[str, str]:
        return {
            str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and not path.is_symlink()
        }

    def clear(self) -> None:
        """As it was: what a session rightly wrote below the score's folder is taken away."""
        (self.inside / "score.yaml").write_text(SCORE)
        (self.inside / "keys.yaml").write_text(KEYS)
        for path in sorted(self.inside.rglob("*"), reverse=True):
            player_session = ("score.yaml", "keys.yaml", "session.jsonl")
            if path.is_symlink() or (path.parent == self.inside and path.name in player_session):
                continue
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink()


@pytest.fixture(scope="module")
def sandbox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sandbox]:
    folder = tmp_path_factory.mktemp("strangers")
    before = os.getcwd()
    box = Sandbox(folder)
    os.chdir(box.inside)
    yield box
    os.chdir(before)


def written(events: list[dict[str, Any]]) -> bytes:
    return "".join(json.dumps(event) + "\n" for event in events).encode()


def played(path: Path) -> list[str]:
    """A journal rendered for a while, gone on from, and saved; what the session answered."""
    replies = []
    try:
        again = ReplayedSession(read_journal(path))
        again.process(np.zeros((min(again.n_frames, 3 * EVERY), again.n_channels)))
        replay = read_journal(path, resumes=True)
        version, clock, _ = resumed_state(replay)
        session = Session(
            version,
            lambda stage: SteppedEngine(stage, tick_frames=EVERY, highpass=None),
            margin=0.0,
            clock=clock,
            disk=replay.disk,
        )
    except REFUSED as error:
        return [str(error)]
    with closing(session):
        for line in TYPED:
            replies.append(session.submit(line).text)
    assert not [reply for reply in replies if "ergon itself" in reply], replies
    return replies


# --- what strangers write ------------------------------------------------------------------------

PATHS = [
    *("../outside/.bashrc", "../outside/tool.py", "../outside/new.yaml", "../outside/keys.yaml"),
    *("../outside/score.yaml", "out/keys.yaml", "out/new.yaml", "leads-out.yaml", "loop", "loop/a"),
    *("{out}/.bashrc", "{out}/tool.py", "{out}/keys.yaml", "{out}/score.yaml", "{out}/pipe"),
    *("/dev/zero", "/dev/full", "/etc/passwd", "/", ".", "..", "", "C:\\autoexec.bat", "C:x.yaml"),
    *("\\\\host\\share\\x.yaml", "~/.bashrc", "a\0b.yaml", "a\nb.yaml", "\ud800.yaml", "x" * 5000),
    *("a/" * 3000 + "b", "ergon:instruments/bell.yaml", "ergon:instruments/../../x.yaml"),
    *("ergon:/etc/passwd", "ergon:", "ergon:instruments/evil.py", "sub/../../outside/tool.py"),
    *("\x1b[2J.yaml", "keys.yaml/", "./keys.yaml", "keys.yaml", "score.yaml", "session.jsonl"),
    *("file:///etc/passwd", "NUL", "con.yaml", "é" * 200 + ".yaml", "-", "nowhere/at/all.yaml"),
]
NUMBERS: list[Any] = [
    *(0, -1, 1, 3, 10**9, 10**15, -(10**15), 10**400, 0.5, -0.0, 1e-300, 1e300, -1e300),
    *(float("nan"), float("inf"), float("-inf"), True, None, "1", [], {}, [[]], "\ud800"),
]
LINES = [
    *("save", "save {out}/tool.py", "save ../outside/new.yaml", "keep 1bar as score", "quit"),
    *("keep 8bar as verse-2", "py open('{out}/owned', 'w').write('x')", "load {out}/score.yaml"),
    *("reload", "record ada as solo", "panic", "set k1.M 1e999g", "tempo 1e308", "tempo 0.0001"),
    *("set k1.K -1N/m", "ada plays knock every 0", "play from 99999999|1", "x" * 100_000, "\0"),
    *(
        "damp 1e-300s",
        "knock = 0@0 throw 1e300@1",
        "hush; panic",
        "undo",
        "nudge 1",
        "set bell.hum.t60 x3",
    ),
]
TEXTS = [
    *("", "no: score", "ergon: 1", "\ud800", "a: &a [*a]", "[" * 5000, "{out}", "%YAML 9", "\0"),
    SCORE.replace("keys.yaml", "../outside/keys.yaml"),
    SCORE.replace("keys.yaml", "{out}/keys.yaml"),
    SCORE.replace("keys.yaml", "out/keys.yaml"),
    SCORE.replace("keys.yaml", "{out}/pipe"),
    SCORE.replace("gestures:", "takes: {t: {file: '{out}/x.wav'}}\ngestures:"),
    SCORE.replace("gestures:", "takes: {t: {file: ../outside/x.take}}\ngestures:"),
    SCORE.replace("render: {", "render: {file: '{out}/song.wav', "),
    SCORE.replace("A3", "A4"),
    KEYS,
]
FIELDS = {
    "score": PATHS,
    "text": TEXTS,
    "line": LINES,
    **dict.fromkeys(
        ("at", "every", "gain", "limit", "highpass", "master", "beat", "frame"), NUMBERS
    ),
    **dict.fromkeys(("number", "start", "goes", "resets", "restores", "where", "v"), NUMBERS),
    "event": ["session", "line", "commit", "late", "dropped", "saved", "end", "", None, 3, []],
}


def hostile(chance: random.Random, box: Sandbox) -> bytes:
    """A journal that was real, and is worse now."""
    events = copy.deepcopy(box.events)
    out = str(box.outside)

    def substituted(value: Any) -> Any:
        return value.replace("{out}", out) if isinstance(value, str) else value

    for _ in range(chance.choice((1, 1, 2, 5))):
        event = chance.choice([*events, events[0], events[0]])
        kind = chance.randrange(8)
        if kind < 4:
            known = [name for name in event if name in FIELDS]
            name = chance.choice(known or ["event"])
            event[name] = substituted(chance.choice(FIELDS[name]))
        elif kind == 4:  # texts for files anywhere
            path = substituted(chance.choice(PATHS))
            text = substituted(chance.choice([*TEXTS, "import os; os.abort()\n"]))
            event.setdefault("overlay", {})
            if isinstance(event["overlay"], dict):
                event["overlay"][path] = text
            disk = event.setdefault("disk", {})
            there = chance.choice(("keys.yaml", "score.yaml", "tool.py", ".bashrc"))
            if isinstance(disk, dict):
                disk[path] = hashlib.sha256((box.outside / there).read_bytes()).hexdigest()
        elif kind == 5:
            name = chance.choice(("overlay", "gains", "muted", "solo", "disk", *event))
            event[name] = substituted(
                chance.choice([*NUMBERS, *PATHS, {"a": {}}, {"bell": "x"}, [["x"]]])
            )
        elif kind == 6:
            events.insert(chance.randrange(len(events) + 1), copy.deepcopy(chance.choice(events)))
        else:
            events.remove(chance.choice(events)) if len(events) > 1 else None
    data = bytearray(written(events))
    for _ in range(chance.choice((0, 0, 0, 0, 0, 0, 1, 3))):
        index = chance.randrange(len(data) + 1)
        data[index : index + chance.randrange(3)] = chance.choice(
            (b"\0", b"\xff", b"\n", b"{", b"[" * 3000, b"1e999", b"NaN", b'"', b"\xed\xa0\x80")
        )
    return bytes(data[: chance.randrange(len(data))] if chance.randrange(20) == 0 else data)


def swarm(box: Sandbox, seed: int, count: int) -> tuple[int, int]:
    """So many hostile journals; how many went on, and how many saves were done."""
    chance = random.Random(seed)
    outside, path = box.seen(box.outside), box.inside / "session.jsonl"
    went_on = saves = 0
    for number in range(count):
        path.write_bytes(hostile(chance, box))
        box.is_watched = True
        try:
            replies = played(path)
        except BaseException as error:
            (box.inside.parent / "failed.jsonl").write_bytes(path.read_bytes())
            raise AssertionError(f"journal {number} of seed {seed}: {error!r}") from error
        finally:
            box.is_watched = False
        assert box.opened == [], (number, box.opened)
        assert all("\n" not in reply for reply in replies)
        assert box.seen(box.outside) == outside, number
        assert not [name for name in os.listdir(box.inside) if name.endswith(".part")]
        done = sum(reply.startswith("ok wrote") for reply in replies)
        went_on, saves = went_on + (len(replies) > 1), saves + done
        if not done:  # nothing of its own changes either
            assert (box.inside / "score.yaml").read_text() == SCORE
            assert (box.inside / "keys.yaml").read_text() == KEYS
        if "nothing to write" not in replies[0] and not replies[0].startswith("ok wrote"):
            assert (box.inside / "score.yaml").read_text() == SCORE, replies
        box.clear()
    return went_on, saves


@pytest.fixture(scope="module")
def library() -> Iterator[None]:
    """The library that is installed is the same afterwards."""
    import ergon

    root = Path(ergon.__file__).parent

    def seen() -> dict[str, tuple[int, bytes]]:
        paths = [*root.glob("instruments/library/**/*"), *root.glob("scores/library/**/*")]
        return {str(p): (p.stat().st_mtime_ns, p.read_bytes()) for p in paths if p.is_file()}

    before = seen()
    assert len(before) > 10
    yield
    assert seen() == before


@pytest.mark.usefixtures("library")
def test_hostile_journals_write_nothing_and_read_nothing(sandbox: Sandbox) -> None:
    went_on, saves = swarm(sandbox, 1, 60)
    assert went_on > 5  # else nothing was tried
    assert saves > 5


@pytest.mark.slow
@pytest.mark.usefixtures("library")
def test_thousand_hostile_journals_write_and_read_nothing(sandbox: Sandbox) -> None:
    went_on, saves = swarm(sandbox, 2, 1000)
    assert went_on > 100
    assert saves > 100


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../outside/keys.yaml", "outside the folder"),
        ("sub/../../outside/keys.yaml", "outside the folder"),
        ("out/keys.yaml", "outside the folder"),  # through a symbolic link
        ("{out}/keys.yaml", "not relative"),
        ("C:keys.yaml", "not relative"),
        ("ergon:instruments/../../keys.yaml", "outside the folder"),
        ("ergon:instruments/evil.py", "not a file of the library"),
        ("keys.yaml\x00", "not a valid file name"),
    ],
)
def test_journal_file_name_outside_folder(sandbox: Sandbox, name: str, words: str) -> None:
    events = copy.deepcopy(sandbox.events)
    events[0]["overlay"][name.replace("{out}", str(sandbox.outside))] = KEYS
    path = sandbox.inside / "session.jsonl"
    path.write_bytes(written(events))
    with pytest.raises(JournalError, match=words):
        read_journal(path, resumes=True)


def test_replay_of_python_lines(sandbox: Sandbox) -> None:
    """Neither where a line has it, nor where a line that was typed earlier is played again."""
    target = sandbox.outside / "owned"
    events = copy.deepcopy(sandbox.events)
    typed = [event for event in events if event["event"] == "line"]
    assert len(typed) > 5
    for event in typed:
        event["line"] = f"py open({str(target)!r}, 'w').write('x')"
    path = sandbox.inside / "session.jsonl"
    path.write_bytes(written(events))
    played(path)
    assert not target.exists()


@pytest.mark.parametrize("name", ["/", ".", "..", "a/.."])
def test_read_journal_with_invalid_score_name(tmp_path: Path, name: str) -> None:
    """Otherwise its folder would be the one above the journal's, and takes there were read."""
    folder = tmp_path / "down"
    folder.mkdir()
    (tmp_path / "secret.csv").write_text("t [s],x [mm]\n0,0\n1,1\n")
    text = "ergon: 1\nkeys: {k: {M: 1kg}}\ntakes: {t: {file: secret.csv}}\n"
    event = {"v": 1, "event": "session", "score": name, "text": text, "overlay": {}, "every": 64}
    event |= {"at": 0.0, "gains": {}, "muted": [], "solo": [], "master": 1.0}
    event |= {"gain": 1.0, "limit": 1.0, "highpass": None}
    path = folder / "session.jsonl"
    path.write_text(json.dumps(event) + "\n")
    with pytest.raises(JournalError, match="is not a valid file name"):
        read_journal(path)
