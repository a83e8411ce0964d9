"""A journal as it is written: under a name of its own, and on the disk soon after each line."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import IO, Any

import pytest
from one_bell import SCORE as BELL
from patience import PATIENCE, until
from sessions import Stepped

from ergon.repl.session.changes import Changes
from ergon.repl.session.engine import Change
from ergon.repl.session.journal import Journal, JournalError, read_events
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import ReplayedSession
from ergon.repl.session.running import RunningVersion
from tests.repl.test_journal_hostile import KEYS, SCORE


def test_journal_names_of_simultaneous_sessions(tmp_path: Path) -> None:
    """Four sessions in one folder: each one begins."""
    begun: list[Path] = []
    failed: list[BaseException] = []
    for round_ in range(20):
        ready = threading.Barrier(8)

        def begin(path: Path, ready: threading.Barrier) -> None:
            ready.wait()
            try:
                with closing(Journal.begin(path)) as journal:
                    begun.append(journal.path)
            except BaseException as error:
                failed.append(error)

        place = tmp_path / str(round_)
        place.mkdir()
        threads = [
            threading.Thread(target=begin, args=(place / "session.jsonl", ready)) for _ in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert failed == []
    assert len(set(begun)) == 160
    assert {path.name for path in (tmp_path / "0").iterdir()} == {
        "session.jsonl",
        *(f"session-{number}.jsonl" for number in range(2, 9)),
    }


def test_journal_append_with_slow_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = threading.Event()
    sizes: list[int] = []

    def fsync(handle: int) -> None:
        assert slow.wait(PATIENCE)
        sizes.append(os.fstat(handle).st_size)

    monkeypatch.setattr("os.fsync", fsync)
    with closing(Journal(tmp_path / "a.jsonl")) as journal:
        journal.append("line", number=1)  # returns while the disk stands still
        journal.append("line", number=2)
        written = journal.path.stat().st_size
        assert [event.get("number", int) for event in read_events(journal.path)] == [1, 2]
        slow.set()
        until(lambda: sizes and sizes[-1] == written, "two lines on the disk")
        journal.append("line", number=3)
        until(lambda: sizes[-1] > written, "the third")
    assert sizes[-1] == (tmp_path / "a.jsonl").stat().st_size


def test_journal_failure_message_after_disk_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = threading.Event()

    def fsync(handle: int) -> None:
        tried.set()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.fsync", fsync)
    journal = Journal(tmp_path / "a.jsonl")
    journal.append("line", number=1)
    assert tried.wait(PATIENCE)
    journal.close()
    assert "Input/output error" in journal.pop_failure()
    assert journal.pop_failure() == ""


class FullDisk:
    """A file on a disk that takes so many more bytes."""

    def __init__(self, file: IO[bytes], room: int) -> None:
        self.file, self.room = file, room

    def write(self, data: bytes) -> int:
        taken = min(self.room, len(data))
        if not taken:
            raise OSError(28, "No space left on device")
        self.room -= taken
        return self.file.write(data[:taken])

    def __getattr__(self, name: str) -> object:
        return getattr(self.file, name)


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Journal, FullDisk]]:
    """A journal whose disk has room for its first event, and for half of the second."""
    real, disks = Path.open, []

    def opened(path: Path, mode: str = "r", *words: Any, **fields: Any) -> Any:
        file = real(path, mode, *words, **fields)
        disks.append(FullDisk(file, 60) if mode == "xb" else file)
        return disks[-1]

    monkeypatch.setattr(Path, "open", opened)
    journal = Journal(tmp_path / "a.jsonl")
    monkeypatch.undo()
    yield journal, disks[0]
    journal.close()


def test_journal_append_on_full_disk(disk: tuple[Journal, FullDisk]) -> None:
    journal, full = disk
    for number in range(1, 5):
        journal.append("line", number=number)
    assert journal.has_failed
    assert "No space left on device; what is typed is kept" in journal.pop_failure()
    assert len(list(read_events(journal.path))) == 1  # the second line is written by half
    full.room = 1 << 20
    until(lambda: not journal.has_failed, "room for what waits")
    assert journal.pop_failure() == "the journal is written again, and lacks nothing"
    assert [event.get("number", int) for event in read_events(journal.path)] == [1, 2, 3, 4]


def test_journal_close_on_full_disk(
    disk: tuple[Journal, FullDisk],
) -> None:
    journal, _ = disk
    for number in range(1, 5):
        journal.append("line", number=number)
    journal.pop_failure()
    journal.close()
    assert journal.pop_failure() == (
        "the journal ends before its time: No space left on device; the last 3 events are lost"
    )


def test_submit_with_full_journal_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ergon.repl.session.journal._WAITING_MAX", 0)
    (tmp_path / "keys.yaml").write_text(KEYS)
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        reply = stepped.session.submit("ada plays knock every 1")
        assert (reply.taken, "make room on the disk" in reply.text) == (False, True)
        stepped.ok("panic")


def test_replay_warning_for_journal_gap(tmp_path: Path) -> None:
    (tmp_path / "keys.yaml").write_text(KEYS)
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        for line in ("play", "set ring.m.M x1.5", "set k1.M 500g"):
            stepped.ok(line)
            stepped.run(2.5)
    path = tmp_path / "session.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    assert ReplayedSession(read_journal(path)).warnings == ()
    events = [json.loads(line) for line in lines]
    last = max(event["number"] for event in events if event["event"] == "line")
    remaining = [
        line
        for line, event in zip(lines, events, strict=True)
        if event.get("number") != last and event.get("event") != "end"
    ]
    path.write_text("".join([*remaining, lines[-1]]))
    (warning,) = ReplayedSession(read_journal(path)).warnings
    n_missing = len(lines) - len(remaining) - 1
    assert f"{n_missing} events are missing" in warning
    assert "not all in it" in warning


def test_read_journal_of_irregular_and_huge_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe.jsonl")
    (tmp_path / "folder.jsonl").mkdir()
    for name in ("pipe.jsonl", "folder.jsonl"):
        with pytest.raises(JournalError, match="is not a regular file"):
            read_journal(tmp_path / name)
    with pytest.raises(JournalError, match="is not a regular file"):
        read_journal(Path("/dev/zero"))
    large = tmp_path / "large.jsonl"
    with large.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(JournalError, match="larger than the journal of a session"):
        read_journal(large)
    with large.open("wb") as file:  # a hundred megabytes in one line, which are not kept
        file.truncate(100_000_000)
    with pytest.raises(JournalError, match="line 1: this is not a session's journal"):
        read_journal(large)
    deep = tmp_path / "deep.jsonl"
    deep.write_text("[" * 1_000_000 + "\n")
    with pytest.raises(JournalError, match="line 1: this is not a session's journal"):
        read_journal(deep)


def test_replay_of_save_keep_and_py_lines(tmp_path: Path) -> None:
    """`save`, `keep` and `py` in a journal are no deeds of whoever reads it."""
    (tmp_path / "keys.yaml").write_text(KEYS)
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        stepped.ok("play")
        stepped.ok("ada plays knock every 1 now")
        stepped.run(1.0)
        with stepped.journal.open() as file:
            frame = stepped.engine.frame
            assert file.read()
        assert stepped.session.journal is not None
        for number, line in enumerate(
            ("save", "save x", "keep 1bar as y", f"py open({str(tmp_path / 'z')!r}, 'w')"), 50
        ):
            tell = stepped.session.journal.append
            tell("line", number=number, line=line, beat=1.0, start=frame, goes=None, resets=False)
            tell("commit", number=number, frame=frame, beat=1.0)
        stepped.run(1.0)
    before = sorted(tmp_path.iterdir())
    assert len(stepped.again()) == len(stepped.sound)
    assert sorted(tmp_path.iterdir()) == before


def test_journal_end_after_commit_during_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "keys.yaml").write_text(KEYS)
    stepped = Stepped(SCORE, tmp_path)
    stepped.run(0.1)
    stepped.ok("gain ring -3dB")
    monkeypatch.setattr(
        stepped.engine, "close", lambda: stepped.engine.process(int(4 * stepped.rate))
    )
    stepped.session.close()
    *_, commit, end = read_events(stepped.journal)
    assert (commit.name, end.name) == ("commit", "end")
    assert end.get("frame", int) >= commit.get("frame", int)


def test_replay_takeover_frame_with_extended_timeline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A session beside a real hand extends its timeline at other frames than its render does."""
    # The render looks for what is due every 4,096 frames, which is no whole number of ticks here.
    monkeypatch.setattr("sessions.EVERY", 48)
    live = Stepped(BELL, tmp_path)
    live.ok("play")
    live.run(30.0)
    live.ok("tempo 90 now")
    live.run(2.0)
    live.close()
    taken: list[tuple[int, int]] = []
    send = Changes.send

    def noted(changes: Changes, change: Change, group: Any, after: RunningVersion) -> None:
        taken.extend((change.frame, one.number) for one in group)
        if not group:
            taken.append((change.frame, 0))
        send(changes, change, group, after)

    monkeypatch.setattr(Changes, "send", noted)
    live.again()
    extended = [start for start, number in taken if number == 0]
    assert extended
    taken.clear()
    events = [json.loads(line) for line in live.journal.read_text().splitlines()]
    commits = [event for event in events if event["event"] == "commit"]
    assert len(commits) == 2
    commits[1]["frame"] = extended[-1]
    live.journal.write_text("".join(json.dumps(event) + "\n" for event in events))
    live.again()
    assert [start for start, number in taken if number == commits[1]["number"]] == extended[-1:]


def test_tempo_at_bar_passed_by_a_jump(
    tmp_path: Path,
) -> None:
    """It went to bar 239 before: its seconds were counted anew from the beginning."""
    live = Stepped(BELL, tmp_path)
    for line in ("play", "tempo 480 at 5|1", "play from 63|3"):
        live.ok(line)
    live.run(0.1)
    begun = live.session.state()
    assert (begun.bar, begun.beat) == (63, pytest.approx(3.6, abs=0.1))  # 480 beats a minute
    live.run(1.0)
    state = live.session.state()
    assert (state.bar, state.beat) == (65, pytest.approx(3.6, abs=0.1))
    live.close()
    again = Stepped.resumed(live.journal)
    assert again.session.state().bar == 65
    again.close()
    assert (live.again() == live.sound).all()


@pytest.mark.parametrize(
    ("waits", "takes"),
    [
        ("gain bell -6dB in 4", "rename bell chime in 1"),
        ("mute bell in 4", "rename bell chime in 1"),
        ("leo plays knock every 1 in 4", "rename knock tap in 1"),
        ("leo plays knock every 1 in 4", "remove leo in 1"),
    ],
)
def test_name_of_a_waiting_line_is_refused(tmp_path: Path, waits: str, takes: str) -> None:
    """A render reads the lines in the order in which they take effect."""
    two = BELL.replace("players:\n", "players:\n  leo: {hand: virtual, key: k2}\n").replace(
        "instruments:\n", "  k2: {like: k1}\ninstruments:\n"
    )
    live = Stepped(two, tmp_path)
    live.ok("play")
    live.run(0.5)
    live.ok(waits)
    reply = live.type(takes)
    assert not reply.taken
    assert f"after this line, the waiting line '{waits}' (due at " in reply.text
    assert "would fail" in reply.text
    live.run(4.0)
    live.ok(takes.replace(" in 1", " now"))
    live.run(0.5)
    live.close()
    assert (live.again() == live.sound).all()
