"""Numbers, depths and lengths in files of strangers that no reader meant: a sentence each."""

from __future__ import annotations

import json
import os
import resource
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import forked
from one_bell import SCORE

from ergon.common.structured import MalformedTextError, parse_json, parse_toml
from ergon.exchange import plan_file, sound
from ergon.exchange.layout_files import FORMS, LayoutFileError
from ergon.exchange.wave_header import NotWaveError
from ergon.live import boards
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import TakeError
from ergon.workshop.bells import resonances, stroke
from ergon.workshop.bells.stroke import NotAStrokeError
from ergon.workshop.metrology import calibration_file
from ergon.workshop.metrology.gesture import MeasurementError

DIGITS = "9" * 100_000


@pytest.mark.parametrize("parse", [parse_json, parse_toml])
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"x = {DIGITS}", "too many digits"),
        ("x = " + "[" * 100_000, "nested too deeply"),
        ("x = " + "9" * 5000, "too many digits"),
        ("a." * 30_000 + "b = 1", "more than 32 parts"),
        ("x = ", "this is not"),
        (b"\xff", "not text in UTF-8"),
    ],
)
def test_json_and_toml_errors_of_hostile_text(
    parse: Callable[[str | bytes], object], text: str | bytes, words: str
):
    if parse is parse_json:
        text = text if isinstance(text, bytes) else text.removeprefix("x = ")
        words = "line 1" if "parts" in words else words
    with pytest.raises(MalformedTextError, match=words):
        parse(text)


def test_parse_json_and_toml_of_valid_text():
    assert parse_json(b'\xef\xbb\xbf{"a": [1, 2.5, "' + b"9" * 400 + b'"]}')["a"][:2] == [1, 2.5]
    assert parse_json("9" * 308) == 10**308 - 1
    with pytest.raises(MalformedTextError, match="too many digits"):
        parse_json("9" * 309)  # no float holds it
    assert parse_toml(b'a.b.c = "frame:/dev/ttyACM0"') == {"a": {"b": {"c": "frame:/dev/ttyACM0"}}}


def test_devices_toml_must_be_small_regular_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A pipe was waited for, and /dev/zero filled the memory."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = tmp_path / "ergon" / "devices.toml"
    assert boards.device_urls() == {}
    path.parent.mkdir()
    os.mkfifo(path)
    for _ in range(2):
        with pytest.raises(boards.BoardError, match="regular"):
            boards.device_urls()
        path.unlink()
        path.symlink_to("/dev/zero")
    path.unlink()
    path.write_bytes(b"#" * (1 << 20))
    with pytest.raises(boards.BoardError, match="larger"):
        boards.device_urls()


@pytest.mark.parametrize("suffix", [".csv", ".tsv"])
@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("instant", ["nan", "inf", "1e400", "1_0"])
def test_take_table_with_non_numeric_instants(tmp_path: Path, suffix: str, row: int, instant: str):
    """Of the first row NaN was an internal error of `take info`, of a later one it was told."""
    rows = [["t [s]", "x [mm]"], ["0", "0"], ["0.1", "nan"], ["0.2", "1"]]
    rows[row + 1][0] = instant
    path = tmp_path / f"a{suffix}"
    path.write_text("\n".join(("," if suffix == ".csv" else "\t").join(cells) for cells in rows))
    with pytest.raises(TakeError, match=rf"a{suffix}:{row + 2}: '{instant}'.* is not a number"):
        summary(path)


def test_take_summary_skips_hidden_values(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text("t [s],x [mm],y [mm]\n0,nan,nan\n0.1,2,nan\n0.2,1,nan\n")
    time, x, y = summary(path).columns
    assert (time.first_value, time.last_value) == (0.0, 0.2)
    assert (x.low_value, x.high_value, x.first_value, x.last_value) == (1.0, 2.0, 2.0, 1.0)
    assert y.low_value > y.high_value
    path.write_text("t [s],x [mm]\n0,1\n0,2\n")
    with pytest.raises(
        TakeError, match=r"a\.csv:3: the time 0 is not later than the time 0 of the row before"
    ):
        summary(path)


def test_take_info_json_of_hidden_values(work_folder: Path):
    """It held Infinity, which no other program reads."""
    Path("a.csv").write_text("t [s],x [mm]\n0,nan\n1,nan\n")
    done = forked(["take", "info", "--json", "a.csv"], work_folder)
    (record,) = done.stdout.splitlines()
    result = json.loads(record, parse_constant=pytest.fail)
    assert result["channels"] == [{"name": "x [mm]", "low": None, "high": None, "not_finite": 2}]


def wave(rate: int, n_frames: int = 22_000) -> bytes:
    decay = np.exp(-np.arange(n_frames) / 4000)
    data = (3000 * decay * np.sin(0.1 * np.arange(n_frames))).astype("<i2").tobytes()
    form = struct.pack("<IHHIIHH", 16, 1, 1, rate, 2 * rate & 0xFFFFFFFF, 2, 16)
    head = b"WAVEfmt " + form + b"data" + struct.pack("<I", len(data))
    return b"RIFF" + struct.pack("<I", len(head) + len(data)) + head + data


@pytest.mark.parametrize("rate", [1, 2**32 - 1])
def test_wav_with_excessive_rate_is_refused(tmp_path: Path, rate: int):
    """44 kB took 18 s."""
    (tmp_path / "a.wav").write_bytes(wave(rate))
    with pytest.raises(NotAStrokeError, match="frames a second"):
        stroke.read(tmp_path / "a.wav")
    with pytest.raises(NotWaveError, match="frames a second"):
        sound.read_info(tmp_path / "a.wav")


@pytest.mark.parametrize(("n_frames", "words"), [(2**36 - 1, "cannot hold"), (0, "how long it is")])
def test_flac_with_wrong_length_is_refused(tmp_path: Path, n_frames: int, words: str):
    path = tmp_path / "a.flac"
    soundfile.write(path, np.zeros((1000, 2)), 48_000, subtype="PCM_24")
    data = bytearray(path.read_bytes())
    data[21] = data[21] & 0xF0 | n_frames >> 32
    data[22:26] = (n_frames & 0xFFFFFFFF).to_bytes(4, "big")
    path.write_bytes(data)
    with pytest.raises(NotWaveError, match=words):
        sound.read_info(path)


def test_truncated_flac_is_refused(tmp_path: Path):
    path = tmp_path / "a.flac"
    noise = np.random.default_rng(1).normal(size=(100_000, 1)) / 8
    soundfile.write(path, noise, 48_000, subtype="PCM_16")
    path.write_bytes(path.read_bytes()[:120_000])
    assert sound.read_info(path).n_frames == 100_000
    with pytest.raises(NotWaveError, match="damaged"):
        list(sound.read_blocks(path))


def test_resonance_table_must_be_regular_file(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.txt")
    for path in (tmp_path / "pipe.txt", Path("/dev/zero")):
        with pytest.raises(OSError, match="regular"):
            resonances.read(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("M: .g\nK: 60N/m\nZ: 1Ns/m\n", "lacks M"),
        ("M: 1..2g\nK: 60N/m\nZ: 1Ns/m\n", "lacks M"),
        ("M: 1e999g\nK: 60N/m\nZ: 1Ns/m\n", "M is not a finite number"),
        ("M: 0g\nK: 60N/m\nZ: 1Ns/m\n", "M must be above 0"),
        ("M: 9g\nK: 6N/m\nZ: 1Ns/m\nmodes:\n  - {M: 1g, f: 0Hz, t60: 1s}\n", "above 0"),
        ("M: 9g\nK: 6N/m\nZ: 1Ns/m\nmodes:\n  - {M: 9g, f: 5Hz, t60: 1s}\n", "masses of the modes"),
    ],
)
def test_calibration_with_wrong_numbers_is_refused(text: str, words: str):
    with pytest.raises(MeasurementError, match=words):
        calibration_file.read(text)


@pytest.mark.parametrize("angle", [DIGITS, "1e999", "9" * 300])
def test_layout_with_wrong_angles_is_refused(angle: str):
    text = f'{{"LoudspeakerLayout": {{"Loudspeakers": [{{"Azimuth": {angle}}}]}}}}'
    with pytest.raises(LayoutFileError):
        FORMS["iem"].read(text.encode())


def test_plan_file_with_infinite_budget_is_refused(tmp_path: Path):
    """No float holds 400 digits: it was an OverflowError."""
    text = plan_file.plan_text([], "0").replace(
        '"choices"', f'"budget": {{"error": {"9" * 400}}}, "choices"'
    )
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(plan_file.NotPlanError):
        plan_file.read(tmp_path / "plan.json")


@pytest.mark.parametrize("command", ["play score.yaml", "layout noise stereo"])
def test_play_to_file_never_overwrites(work_folder: Path, command: str):
    """It was "entity already exists", with the exit code of a missing device."""
    Path("score.yaml").write_text(SCORE)
    Path("a.wav").write_bytes(b"mine")
    done = forked([*command.split(), "--audio", "file:a.wav"], work_folder)
    assert done.returncode == 2
    assert "a.wav: this file exists" in done.stderr
    assert "another name" in done.stderr
    assert Path("a.wav").read_bytes() == b"mine"


OTHER_READERS = (
    "bell {}.wav -o b.yaml",
    "bell {}.flac -o b.yaml",
    "bell {}.txt -o b.yaml",
    "fold a.wav --layout stereo --to binaural --head {}.sofa -o o.wav",
    "layout import {}.json",
    "import {}.mims -o m.yaml",
    "metrology log {}.yaml",
    "metrology fit {}.take",
    "info {}.motion",
    "view {}.motion",
    "plot {}.flac",
)


@pytest.mark.parametrize("line", OTHER_READERS)
def test_other_readers_refuse_non_files(work_folder: Path, line: str):
    """A pipe that nobody writes to, and a device without an end, which `ergon bell` waited for."""
    soundfile.write("a.wav", np.zeros((100, 2)), 48_000, subtype="PCM_24")
    suffix = Path(line.split()[1 + line.startswith(("layout", "metrology"))]).suffix
    suffix = ".sofa" if ".sofa" in line else suffix
    os.mkfifo(f"pipe{suffix}")
    Path(f"zero{suffix}").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        limits = ((resource.RLIMIT_AS, 4 << 30),)
        done = forked(line.format(name).split(), work_folder, limits=limits)
        assert done.returncode == 2
        assert f"{name}{suffix}: not a regular file" in done.stderr
