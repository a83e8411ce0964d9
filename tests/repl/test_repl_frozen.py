"""Frozen parts in a session: they stand where the score stands, and the journal renders them."""

from __future__ import annotations

import json
import re
import subprocess
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import soundfile
from captured import Comparison, check_heard
from commands import ERGON
from patience import PATIENCE
from sessions import Stepped
from sweep import few

from ergon.cli import app
from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal
from tests.rendering.test_frozen import SCORE as SCORE_WITH_HAND

Capture = pytest.CaptureFixture[str]
# Nothing is live, the gong is struck in bars 1 to 3, and the bell can be played.
SCORE = SCORE_WITH_HAND.replace("{hand: live, key: k, standin: knock}", "{key: k}").replace(
    "every: 1, times: 3", "every: 1bar, times: 3"
)
SCORE = SCORE.replace("from: bell, to: [1, 2]", "from: bell, to: [1]")
RATE = 44_100
BAR = 4 * RATE  # frames at 60 bpm in 4/4
FADE = 960  # frames until a fade that begins on the grid has ended


@pytest.fixture
def folder(work_folder: Path) -> Path:
    (work_folder / "score.yaml").write_text(SCORE)
    freeze("gong,sky")
    return work_folder


def freeze(parts: str) -> None:
    assert app.run(["render", "score.yaml", "--freeze", parts, "-q", "-f"]) == 0


def opened(folder: Path, **more) -> Stepped:
    return Stepped(SCORE, folder, frozen=folder / "score.frozen", **more)


def gong(n_frames: int, begins: int = 0) -> np.ndarray:
    """What channel 2 hears of the gong from a frame of its file on."""
    right = soundfile.read("score.frozen/01_gong.wav", dtype="float64", always_2d=True)[0][:, 1]
    padded = np.concatenate([np.zeros(max(0, -begins)), right[max(0, begins) :]])
    padded = padded[:n_frames]
    return np.pad(padded, (0, n_frames - len(padded)))


def is_gong(sound: np.ndarray, since: int, until: int, begins: int) -> bool:
    """Whether channel 2 is the frozen gong, whose first frame stands at frame `begins`."""
    return np.array_equal(sound[since:until, 1], gong(until - since, since - begins))


def begins(stepped: Stepped) -> int:
    """The frame at which the piece that goes on has its first frame."""
    by = stepped.session.schedule.running.clock.begin_instant
    assert by is not None
    return int(np.floor(by * RATE + 0.5))


def frozen_now(stepped: Stepped) -> list[str]:
    return [part.name for part in stepped.session.schedule.running.frozen]


# --- where it stands ------------------------------------------------------------------------------


@pytest.mark.slow
def test_frozen_part_position_after_jumps_and_stop(folder: Path):
    """After `play`, a stop, a jump forward and one back, to the last bit; and in the journal."""
    with closing(opened(folder)) as stepped:
        stepped.run(0.3)
        stepped.ok("play")
        stepped.run(3.0)
        first = begins(stepped)
        stepped.ok("stop")
        stepped.run(0.5)
        stopped = stepped.engine.frame
        stepped.run(0.5)
        stepped.ok("play from 2|3")
        stepped.run(1.5)
        second = begins(stepped)
        stepped.ok("play from 1|1 now")
        stepped.run(2.0)
        third = begins(stepped)
    sound = stepped.sound
    assert is_gong(sound, 0, first, BAR * 100)  # silence
    assert np.any(sound[:, 1])
    assert is_gong(sound, first, first + 2 * RATE, first)
    assert not np.any(sound[stopped : stopped + 20_000, 1])
    second_heard = second + 6 * RATE
    assert is_gong(sound, second_heard, second_heard + RATE, second)
    assert is_gong(sound, third + FADE, third + RATE, third)
    assert np.array_equal(sound, stepped.again())
    assert frozen_now(stepped) == ["gong", "sky"]


def test_session_with_frozen_parts_sounds_as_computed(folder: Path):
    listened = []
    for frozen in (None, folder / "score.frozen"):
        with closing(Stepped(SCORE, folder, frozen=frozen, journal=False)) as stepped:
            stepped.ok("play")
            stepped.run(1.0)
            stepped.ok("remi plays knock every 1")
            stepped.ok("gain sky -6dB")
            stepped.run(5.0)
            listened.append(stepped.sound)
    peak = np.max(np.abs(listened[0]))
    # What is frozen was planned by ear, a session computes contacts finer: the waveforms differ by
    # 3e-4 of the peak. A frame's shift would be 50 times that.
    assert np.max(np.abs(listened[0] - listened[1])) < 1e-3 * peak
    assert np.any(listened[0][:, 0])


def test_lines_about_others_leave_a_part_frozen(folder: Path):
    """The taps get other numbers, names change, the timeline is extended: it sounds on."""
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(0.2)
        first = begins(stepped)
        for line in (
            "remi plays knock every 1 now",
            "set bell.m.f 230Hz now",
            "new = bell/bell now",
            "route new 1 now",
            "rename sky drizzle now",
            "mute drizzle now",
        ):
            stepped.ok(line)
            stepped.run(0.4)
        stepped.run(4.0)
        sound = stepped.sound
        assert is_gong(sound, first, len(sound), first)
        assert frozen_now(stepped) == ["gong", "sky"]
    assert np.array_equal(sound, stepped.again())


# --- what thaws it --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "left"),
    few(
        [
            ("set gong.c.f 300Hz", ["sky"]),
            ("tempo 90", []),
            ("ada plays knock every 1", ["sky"]),
            ("link k gong.s.centre BUT K=900N/m gap=1mm", ["sky"]),
            ("map note 60 gong.c 1e-4Ns", ["sky"]),
            ("seed 7", []),
        ],
        [("set gong.c.f 300Hz", ["sky"]), ("tempo 90", [])],
    ),
)
def test_edit_of_frozen_part_computes_it_live(folder: Path, line: str, left: list[str]):
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(0.5)
        stepped.ok(line)
        stepped.run(6.0)
        assert frozen_now(stepped) == left
        messages = [message for message in stepped.session.messages() if "computed live" in message]
        names = "gong is computed live and starts"
        if not left:
            names = "gong, sky are computed live and start"
        assert messages == [
            f"from this line on {names} at rest, because the line changes what was frozen"
        ]
        assert np.any(stepped.sound[-RATE:, 1])  # it sounds, computed
        steps = np.abs(np.diff(stepped.sound[:, 1]))
        assert np.max(steps) < 0.2 * np.max(np.abs(stepped.sound[:, 1]))
        stepped.ok("undo")
        stepped.run(4.5)
        assert frozen_now(stepped) == left  # it sounds on as it was computed
    assert np.array_equal(stepped.sound, stepped.again())


def test_reload_without_a_frozen_part(folder: Path):
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(1.0)
        text = SCORE.replace("    - {from: sky, to: [3], gain: -20dB}\n", "")
        begin, end = text.index("  sky:\n"), text.index("gestures:")
        (folder / "score.yaml").write_text(text[:begin] + text[end:])
        stepped.ok("reload")
        stepped.run(4.5)
        assert frozen_now(stepped) == ["gong"]
        assert not any("computed" in message for message in stepped.session.messages())
    assert np.array_equal(stepped.sound, stepped.again())


# --- resume, reload, journal ----------------------------------------------------------------------


def test_resumed_session_with_frozen_parts(folder: Path):
    """What the lines before the end left frozen is frozen still, at the bar where it stands."""
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(4.5)
        stepped.ok("set sky.cells.M x1.5 now")
        stepped.run(0.2)
        assert frozen_now(stepped) == ["gong"]
    with closing(Stepped.resumed(folder / "session.jsonl")) as again:
        assert frozen_now(again) == ["gong"]
        assert again.where == "2|1"
        again.ok("play")
        again.run(2.0)
        assert is_gong(again.sound, begins(again) + BAR, len(again.sound), begins(again))
    assert np.array_equal(again.sound, again.again())


def test_reload_of_edited_file_with_frozen_parts(folder: Path):
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(0.5)
        path = folder / "score.yaml"
        path.write_text(SCORE.replace("f: 220Hz", "f: 221Hz"))
        stepped.ok("reload")
        stepped.run(4.5)
        assert frozen_now(stepped) == ["gong", "sky"]
        path.write_text(SCORE.replace("f: 331Hz", "f: 332Hz"))
        stepped.ok("reload")
        stepped.run(4.5)
        assert frozen_now(stepped) == ["sky"]
    assert np.array_equal(stepped.sound, stepped.again())


def test_render_with_missing_or_other_frozen_parts(folder: Path, capsys: Capture) -> None:
    with closing(opened(folder)) as stepped:
        stepped.ok("play")
        stepped.run(1.0)
    single = folder / "score.frozen"
    single.rename(folder / "away")
    capsys.readouterr()
    assert app.run(["render", "session.jsonl", "-q"]) != 0
    output = capsys.readouterr().err
    assert "score.frozen" in output
    assert "the session plays gong, sky from there" in output
    (folder / "away").rename(single)
    manifest = json.loads((single / "frozen.json").read_text())
    manifest["stems"][0]["sha256"] = "0" * 64
    (single / "frozen.json").write_text(json.dumps(manifest))
    assert app.run(["render", "session.jsonl", "-q"]) != 0
    assert "holds other frozen parts than those of this session" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("field", "value", "why"),
    few(
        [
            ("frozen", "../../../../tmp", "outside this folder and the journal's"),
            ("frozen", "", "is not the name of a folder"),
            ("frozen", 7, "wrong type"),
            ("frozen_parts", "gong", "wrong type"),
            ("frozen_parts", [7], "wrong type"),
            ("frozen_parts", [{"part": "gong"}], "missing"),
        ],
        2,
    ),
)
def test_read_journal_with_forged_frozen_fields(
    folder: Path, field: str, value: object, why: str
) -> None:
    with closing(opened(folder)) as stepped:
        stepped.run(0.1)
    path = folder / "session.jsonl"
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([json.dumps(json.loads(first) | {field: value}), *rest]))
    with pytest.raises(JournalError, match=why):
        read_journal(path)


# --- on an engine in real time --------------------------------------------------------------------


LINES = (
    "play",
    "remi plays knock every 1 now",
    "play from 2|1 now",
    "set bell.m.f 230Hz now",
    "stop now",
    "play from 1|2",
    "set gong.c.f 300Hz now",
    "play from 2|1 now",
)


def compare_with_journal(name: str, pause: float) -> Comparison:
    """A session of its own whose lines are so far apart [s], held against its journal."""
    command = [*ERGON, "repl", "score.yaml", "--frozen", "score.frozen", "--plain"]
    command += ["--audio", f"clock:{name}.wav", "--gain", "50dB", "--journal", f"{name}.jsonl"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, text=True, bufsize=1, **pipes) as repl:
        assert repl.stdin is not None
        for line in LINES:
            repl.stdin.write(f"{line}\n")
            time.sleep(pause)
        output = repl.communicate("quit\n", timeout=PATIENCE)[0]
    assert "from score.frozen: gong, sky, up to " in output
    assert "from this line on gong is computed live" in output
    done = ["render", f"{name}.jsonl", "-o", f"again-{name}.wav", "--bits", "float", "-q"]
    assert app.run(done) == 0
    played, _ = soundfile.read(f"{name}.wav", dtype="float32", always_2d=True)
    again, _ = soundfile.read(f"again-{name}.wav", dtype="float32", always_2d=True)
    return check_heard(played, again, re.findall(r"gaps [0-9]+", output))


def test_journal_of_frozen_session_renders_live_sound(folder: Path) -> None:
    """The command itself: a jump, a stop, a line that computes a part again.

    How much is heard between two lines is up to the machine: a busy one gets more time.
    """
    compared = (compare_with_journal(f"heard{times}", 0.5 * 2**times) for times in range(5))
    assert any(found.equal > RATE / 10 for found in compared)
