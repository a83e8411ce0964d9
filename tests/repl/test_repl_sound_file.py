"""`record audio`: what is heard goes into a file beside any output, as it is rendered."""

import json
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import ERGON
from patience import until
from sessions import Stepped
from sweep import few

from ergon.repl.session.session import Session
from tests.repl.test_repl_live import session_on
from tests.repl.test_repl_session import SCORE


def _sound_messages(session: Session) -> list[str]:
    messages: list[str] = []
    until(
        lambda: any(
            "-> " in (messages.extend(session.messages()) or " ".join(messages)) for _ in [0]
        ),
        "the file is whole",
    )
    return messages


def _frames(session: Session, count: int) -> None:
    engine = session.schedule.engine
    goal = engine.frame + count
    until(lambda: engine.frame >= goal, "it plays")


@pytest.mark.parametrize("audio", few(["null", "clock"], 1))
def test_record_audio_equals_render_of_those_frames(tmp_path: Path, audio: str):
    output = audio if audio == "null" else f"clock:{tmp_path / 'output.wav'}"
    with closing(session_on(tmp_path, output)) as session:
        for line in ("play", "ada plays knock every 1 now", "leo plays lean every 1 now"):
            assert session.submit(line).taken
        _frames(session, 4_000)
        assert session.submit("record audio part").text.startswith("ok recording what is heard in")
        assert "still being recorded" in session.submit("record audio other").text
        _frames(session, 11_000)
        assert session.submit("record audio off").taken
        text = _sound_messages(session)
        assert "no sound is being recorded" in session.submit("record audio off").text
        assert "overwrites no file" in session.submit("record audio part.wav").text
    assert any(one.startswith("sound of 1.") for one in text)
    done = subprocess.run(
        [*ERGON, "render", "session.jsonl", "-o", "again.wav", "--bits", "float"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = map(json.loads, (tmp_path / "session.jsonl").read_text().splitlines())
    sound = next(row for row in rows if row["event"] == "sound")
    part, _ = soundfile.read(tmp_path / "part.wav", dtype="float32", always_2d=True)
    again, _ = soundfile.read(tmp_path / "again.wav", dtype="float32", always_2d=True)
    assert len(part) == sound["frames"] >= 11_000
    assert np.abs(part).max() > 0.01
    assert np.array_equal(part, again[sound["first"] :][: len(part)])


def test_session_close_finishes_recorded_file(tmp_path: Path):
    with closing(session_on(tmp_path, "null")) as session:
        assert session.submit("record audio all.wav").taken
        _frames(session, 2_000)
    part, _ = soundfile.read(tmp_path / "all.wav", dtype="float32", always_2d=True)
    assert len(part) >= 1_800
    rows = map(json.loads, (tmp_path / "session.jsonl").read_text().splitlines())
    (sound,) = (row for row in rows if row["event"] == "sound")
    assert sound["frames"] == len(part)
    assert sound["first"] >= 0


@pytest.mark.parametrize(
    ("file", "why"),
    [
        ("../x.wav", "a session writes only into"),
        ("/tmp/x.wav", "a session writes only into"),
        ("x.mp3", "does not end in .wav"),
        ("folder/x.wav", "a session writes only into"),
    ],
)
def test_record_audio_elsewhere_is_refused(tmp_path: Path, file: str, why: str):
    with closing(session_on(tmp_path, "null")) as session:
        reply = session.submit(f"record audio {file}")
        assert not reply.taken
        assert why in reply.text
    assert {path.suffix for path in tmp_path.iterdir()} == {".yaml", ".jsonl"}


def test_record_audio_with_a_too_long_name_is_refused(tmp_path: Path):
    with closing(session_on(tmp_path, "null")) as session:
        name = f"{'x' * 245}.wav"  # its temporary name is longer than a name can be
        reply = session.submit(f"record audio {name}")
        assert not reply.taken
        assert name in reply.text
        assert session.submit("record audio y.wav").taken


def test_record_audio_without_an_output_is_refused(tmp_path: Path):
    player_session = Stepped(SCORE, tmp_path)
    assert "`ergon render` writes a file" in player_session.type("record audio x.wav").text
    player_session.close()
