"""Sessions on a performance: the physics thread, its file, and a key in another process."""

from __future__ import annotations

import json
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import soundfile
from captured import check_heard
from commands import ERGON, PATIENT, forked
from emulators import emulator
from patience import PATIENCE, until
from sweep import few

from ergon import _core
from ergon.api.options import SessionOptions
from ergon.api.pages import pages_of
from ergon.common.report import Report
from ergon.live.pages import Pages
from ergon.live.perform import PlaybackConfig, bar_frames
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart, read_journal
from ergon.repl.session.live import LiveEngine
from ergon.repl.session.replay import resumed_state
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from tests.repl.test_repl_session import SCORE


def session_on(
    folder: Path,
    audio: str,
    *,
    watches: bool = False,
    pages: Pages | None = None,
    text: str = SCORE,
) -> Session:
    """A session on a performance whose journal stands beside its score."""
    path = folder / "score.yaml"
    path.write_text(text, encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    journal = Journal(folder / "session.jsonl")
    session = Session(
        version,
        lambda stage: LiveEngine(stage, PlaybackConfig(audio=audio, gain=300.0, pages=pages)),
        margin=0.006,
        journal=journal,
        watches=watches,
    )
    every = session.schedule.engine.tick_frames
    opening = SessionStart(texts, 0.0, version.faders, every, 300.0, 1.0, None)
    journal.append("session", **opening.fields())
    session.run()
    return session


def ok(session: Session, line: str) -> str:
    reply = session.submit(line)
    assert reply.taken, f"{line}: {reply.text}"
    return reply.text


def go_on(session: Session, seconds: float) -> None:
    """Until the engine has computed so much more of the sound, however long that takes."""
    engine = session.schedule.engine
    end = engine.frame + int(seconds * session.schedule.rate)
    until(lambda: engine.frame >= end, "the engine goes on")


@pytest.mark.parametrize("is_seen", few([False, True], 1))
def test_journal_of_real_engine_renders_live_sound(tmp_path: Path, is_seen: bool):
    """Check 12, over the real engine; the same where pages see it."""
    listened = tmp_path / "heard.wav"
    pages = pages_of(SessionOptions(view=is_seen), Report())
    with closing(session_on(tmp_path, f"clock:{listened}", pages=pages)) as session:
        ok(session, "play")
        for line in (
            "tempo 480 now",
            "ada plays knock every 1 now",
            "leo plays lean every 2 do jitter 4ms 0.2mm",
            "knock = 0@0 smooth 5@1/8 smooth 0@1/2",
            "tempo 480 -> 400 over 4bar",
            "gain bell -6dB",
            "set bell.m.K x1.3",
            "couple k1 k2 K=40N/m Z=0.2Ns/m",
            "undo",
            "ada do scale 0.8",
            "damp 2s",
        ):
            ok(session, line)
            go_on(session, 0.4)
        go_on(session, 1.0)
        troubles = session.schedule.engine.status().troubles
    done = subprocess.run(
        [*ERGON, "render", "session.jsonl", "-o", "again.wav", "--bits", "float"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    played, _ = soundfile.read(listened, dtype="float32", always_2d=True)
    again, _ = soundfile.read(tmp_path / "again.wav", dtype="float32", always_2d=True)
    assert np.max(np.abs(again)) > 0.01
    assert check_heard(played, again, troubles).equal > 2 * 8_000


def test_play_from_bar_100(tmp_path: Path):
    """The first bars are then before the first frame."""
    with closing(session_on(tmp_path, "null")) as session:
        assert ok(session, "play from 100|1") == "ok from 100|1"
        ok(session, "ada plays knock every 1 now")
        until(lambda: ("ada", "knock") in session.state().playing, "ada plays")
        stage = session.schedule.running.stage
        second = int(stage.rate)
        frames = bar_frames(stage, second, 10 * second)
        assert frames
        assert all(second <= frame < 10 * second for frame in frames)
        tempo = stage.piece.tempo_map
        beats = [tempo.beats(frame / stage.rate) for frame in frames]
        first = round(beats[0] / 4.0)
        assert first >= 99
        assert beats == pytest.approx([4.0 * (first + i) for i in range(len(beats))], abs=1e-3)


def test_panic_silences_and_drops_waiting_lines(tmp_path: Path):
    """Check 10: F12, then release; nothing of what waited comes back."""
    with closing(session_on(tmp_path, "null")) as session:
        ok(session, "play")
        ok(session, "ada plays knock every 1/2 now")
        until(lambda: ("ada", "knock") in session.state().playing, "ada plays")
        session.panic()
        assert session.state().panicked
        schedule = session.schedule
        # A stop that comes too late for a busy engine is handed over again: until then it goes on.
        until(lambda: not (schedule.changes.pending or schedule.waiting), "the stop is made")
        until(lambda: not schedule.running.clock.is_running, "the piece stands")
        assert session.state().playing == ()
        until(lambda: session.state().level < -90.0, "silence")
        ok(session, "release")
        assert not session.state().panicked
        ok(session, "play")
        ok(session, "leo plays knock every 1/2 now")
        until(lambda: ("leo", "knock") in session.state().playing, "leo plays")
        assert "ada" not in dict(session.state().playing)


def test_watch_reloads_score_saved_in_editor(tmp_path: Path):
    with closing(session_on(tmp_path, "null", watches=True)) as session:
        ok(session, "play")
        path = tmp_path / "score.yaml"
        path.write_text(SCORE.replace("  ada: []", "  ada: [{at: 1|1, play: kock}]"))
        result: list[str] = []
        refusal = "score.yaml has changed and is not reloaded: score.yaml:"
        until(
            lambda: (
                result.extend(session.messages()) or any(one.startswith(refusal) for one in result)
            ),
            "a refusal",
        )
        path.write_text(
            SCORE.replace("  ada: []", "  ada: [{at: 1|1, play: knock, every: 1/4, times: 999}]")
        )
        until(lambda: ("ada", "knock") in session.state().playing, "ada plays")


def test_resume_from_cut_journal(tmp_path: Path):
    """Check 15: what had begun, what waited, not what was taken back or undone."""
    with closing(session_on(tmp_path, "null")) as session:
        ok(session, "play")
        ok(session, "ada plays knock every 1 now")
        until(lambda: ("ada", "knock") in session.state().playing, "ada plays")
        ok(session, "gain drum -6dB now")
        ok(session, "mute bell")
        ok(session, "leo plays lean every 2")
        ok(session, "undo")
        ok(session, "tempo 90")
        session.submit("ada plyas knock")
        head = session.schedule.head
        # A line that was being written when the power failed is no line.
        journal = (tmp_path / "session.jsonl").read_text(encoding="utf-8")
    cut = tmp_path / "cut.jsonl"
    cut.write_text(journal + '{"v": 1, "event": "li', encoding="utf-8")
    version, clock, _ = resumed_state(read_journal(cut))
    assert version.texts.text == head.texts.text
    assert version.faders == head.faders
    assert clock.begin_instant is None


@pytest.mark.parametrize(
    "text",
    ["", "no json\n", '{"v": 1, "event": "line"}\n', '{"v": 2, "event": "session"}\n', "[]\n"],
)
def test_render_and_resume_of_invalid_journal(tmp_path: Path, text: str):
    (tmp_path / "bad.jsonl").write_text(text, encoding="utf-8")
    for command in (["render", "bad.jsonl", "-o", "x.wav"], ["repl", "--resume", "bad.jsonl"]):
        done = forked(command, tmp_path)
        assert done.returncode == 2
        assert "journal" in done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "x.wav").exists()


def test_record_real_hand_and_replay_it(tmp_path: Path):
    score = SCORE.replace("  leo: {key: k2}\n", "  leo: {hand: live, key: k2}\n")
    (tmp_path / "score.yaml").write_text(score, encoding="utf-8")
    hand = ("--gesture", "0mm@0 (smooth 4mm@1 0mm@2)*300", "--hand", "900N/m")
    with emulator("frame", "--udp", "0", *hand) as key:
        command = [*PATIENT, "repl", "score.yaml", "--audio", "null", "--plain", "--strict"]
        command += ["--live", f"leo={key.url}", "--unchecked"]
        out, recording = tmp_path / "out.txt", tmp_path / "session.take"
        with (
            out.open("w") as text,
            subprocess.Popen(
                command, cwd=tmp_path, stdin=subprocess.PIPE, stdout=text, stderr=text, text=True
            ) as repl,
        ):
            assert repl.stdin is not None

            def type_and_see(line: str, answer: str) -> None:
                assert repl.stdin is not None
                repl.stdin.write(f"{line}\n")
                repl.stdin.flush()
                until(lambda: answer in out.read_text(), answer)

            def n_ticks() -> int:
                return len(_core.read_recording(recording).ticks()) if recording.exists() else 0

            type_and_see("play", "ok from")
            until(lambda: n_ticks() > 0, "the hand")
            type_and_see("record leo as solo now", "recording leo")
            begun = n_ticks()
            # The take begins a little later than the line.
            until(lambda: n_ticks() > begun + 1500, "a second of the hand")
            type_and_see("record off now", "take solo ends")
            until(lambda: "solo.take" in out.read_text(), "the take in the score")
            repl.stdin.write("ada plays solo do scale 0.5\nsave with-solo\nquit\n")
            repl.stdin.flush()
            assert repl.wait(PATIENCE) == 0, out.read_text()
    saved = (tmp_path / "with-solo.yaml").read_text(encoding="utf-8")
    assert "solo: {file: takes/solo.take, channel: leo}" in saved
    done = subprocess.run([*ERGON, "check", "with-solo.yaml"], cwd=tmp_path, check=False)
    assert done.returncode == 0


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("journal")
    path = folder / "session.jsonl"
    with closing(session_on(folder, "null")) as session:
        ok(session, "play")
        ok(session, "ada plays knock every 1 now")
        # A busy machine takes the line up again at a later frame; a journal that ends before that
        # frame never plays the line.
        until(lambda: '"commit", "number": 2' in path.read_text(encoding="utf-8"), "ada plays")
    return path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("event", "fields"),
    [
        ("session", {"every": 0}),
        ("session", {"every": "64"}),
        ("session", {"gain": float("nan")}),
        ("session", {"text": "no: score"}),
        ("session", {"overlay": 3}),
        ("line", {"line": "load /dev/zero"}),
        ("line", {"line": "ada plyas knock"}),
        ("line", {"number": "one"}),
        ("commit", {"number": 9}),
        ("commit", {"beat": float("inf")}),
        ("commit", {"frame": 10**15}),
        ("end", {"frame": 10**15}),
    ],
)
def test_render_of_hostile_journal_is_refused(
    tmp_path: Path, journal: str, event: str, fields: dict
):
    """Nobody's journal makes a render fall over, run on, or read another file."""
    path = tmp_path / "session.jsonl"
    events = [json.loads(line) for line in journal.splitlines()]
    changed = next(one for one in reversed(events) if one["event"] == event)
    changed.update(fields)
    path.write_text("".join(json.dumps(one) + "\n" for one in events), encoding="utf-8")
    done = forked(["render", "session.jsonl", "-o", "x.wav"], tmp_path)
    assert done.returncode in (1, 2), done.stderr
    assert "internal error" not in done.stderr
    assert done.stderr.strip()
    assert not (tmp_path / "x.wav").exists()
