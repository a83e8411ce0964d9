"""`ergon take`: recordings listed, told, cut and exchanged."""

import json
from pathlib import Path

import motion_files
import numpy as np
import pytest
import soundfile
from commands import records
from recordings import EVENTS, Axis, chunk, end, event, header, row, rows

from ergon import _core
from ergon.cli import app
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read

Capture = pytest.CaptureFixture[str]
HANDS = (("remi", "k2"), ("ada", "k1"))
ABOUT = '{"day": "2026-11-20", "score": {"path": "duet.yaml", "sha256": "ab12"}}'


def hand(tick: int) -> tuple[Axis, Axis]:
    x = 4e-3 * np.sin(tick / 200)
    return Axis(float(x), 2.0 * x, 0.25, 1, tick * 1000), Axis(-float(x), 0.1, 0.0, 17, 5)


def data(first: int = 1000, n: int = 2000) -> bytes:
    """Two hands at 1 kHz for two seconds, in chunks of a quarter second, one event in each."""
    parts = [header(HANDS, 44000.0, 44, ABOUT)]
    for begin in range(first, first + n, 250):
        parts.append(rows(*(row(t, *hand(t)) for t in range(begin, begin + 250))))
        parts.append(chunk(EVENTS, event(begin, '{"late": 1}')))
    return b"".join([*parts, end()])


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    (work_folder / "hand.take").write_bytes(data())
    return work_folder


@pytest.mark.parametrize("command", [["info"], ["take", "info"]])
def test_take_info_of_recording(capsys: Capture, command: list[str]) -> None:
    assert app.run([*command, "hand.take"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "hand.take: 2 s, 2,000 ticks at 1000.00 Hz (44 frames of 44000 Hz)",
        "  begins 1.000 s into the piece",
        "  remi on k2: -4 mm … 4 mm, force up to 0.008 N",
        "  ada on k1: -4 mm … 4 mm, force up to 0.1 N, limiter tripped in 2,000 ticks",
        "  8 events",
        "  day: 2026-11-20",
        "  score: duet.yaml, ab12",
        "  whole",
    ]
    assert app.run([*command, "--json", "hand.take"]) == 0
    (record,) = records(capsys)
    assert record["event"] == "take"
    assert (record["ticks"], record["first_tick"], record["duration_s"]) == (2000, 1000, 2.0)
    assert [axis["player"] for axis in record["axes"]] == ["remi", "ada"]
    assert record["about"]["score"]["path"] == "duet.yaml"
    assert (record["lost_bytes"], record["finished"]) == (0, True)


def test_take_info_of_damaged_file(folder: Path, capsys: Capture) -> None:
    (folder / "cut.take").write_bytes(data()[:-1000])
    assert app.run(["take", "info", "cut.take"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("  13558 bytes of this recording")
    (folder / "no.take").write_bytes(b"RIFF")
    assert app.run(["take", "info", "no.take"]) == 2
    assert capsys.readouterr().err == "error: no.take: this file is not a recording of hands\n"
    assert app.run(["take", "info", "nowhere.take"]) == 2
    assert "nowhere.take: No such file" in capsys.readouterr().err
    assert app.run(["take", "info", "hand.gms"]) == 2
    assert (
        "a take is a .take, .csv, .tsv, .npz, .c3d, .bvh, .trc or .sdif file"
        in capsys.readouterr().err
    )


def test_take_info_escapes_control_characters_in_names(folder: Path, capsys: Capture) -> None:
    (folder / "x.take").write_bytes(header((("\x1b[2Jada", "k\n"),)) + end())
    for command in (["info", "x.take"], ["list"]):
        assert app.run(["take", *command]) == 0
        out = capsys.readouterr().out
        assert "?[2Jada" in out
        assert "\x1b" not in out


def test_take_list_of_folder(folder: Path, capsys: Capture) -> None:
    (folder / "cut.take").write_bytes(data()[:-1000])
    (folder / "no.take").write_bytes(b"RIFF")
    (folder / "open.take").write_bytes(data()[:-17])
    (folder / "x.csv").write_text("t [s],x [mm]\n0,0\n1,0\n")
    assert app.run(["take", "list"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "cut.take: remi, ada, 1.75 s, 7 events, damaged",
        "hand.take: remi, ada, 2 s, 8 events",
        "no.take: this file is not a recording of hands",
        "open.take: remi, ada, 2 s, 8 events, never finished",
    ]
    assert app.run(["take", "list", "--json", "."]) == 0
    assert [record["file"] for record in records(capsys)][1] == "hand.take"
    (folder / "takes").mkdir()
    assert app.run(["take", "list"]) == 0
    assert capsys.readouterr() == ("", "no recordings in takes\n")
    assert app.run(["take", "list", "hand.take"]) == 2


def test_trim_keeps_rows_events_and_their_places(capsys: Capture) -> None:
    assert app.run(["take", "trim", "hand.take", "0.25s", "1.5s", "-o", "part.take"]) == 0
    out, err = capsys.readouterr()
    assert (out, err) == ("", "wrote part.take: remi, ada, 1.250 s, 1,250 ticks\n")
    result, complete = _core.read_recording("part.take"), _core.read_recording("hand.take")
    assert result.ticks().tolist() == list(range(1250, 2500))
    for column in ("positions", "forces", "sent", "flags", "clocks"):
        cut = getattr(complete, column)()[250:1500]
        assert getattr(result, column)().tobytes() == cut.tobytes()
    assert result.events == complete.events[1:6]
    assert result.about == ABOUT
    assert result.finished
    # As `trim:` of a score cuts it.
    assert (
        read(Path("part.take"), "remi").x.tolist()
        == read(Path("hand.take"), "remi").x.tolist()[250:1500]
    )


def test_trim_repairs_damaged_take(folder: Path, capsys: Capture) -> None:
    (folder / "cut.take").write_bytes(data()[:-1000])
    assert app.run(["take", "trim", "cut.take", "0s", "end", "-o", "good.take", "--json"]) == 0
    warning, wrote = records(capsys)
    assert warning["event"] == "warning"
    assert (wrote["event"], wrote["ticks"]) == ("wrote", 1750)
    assert _core.read_recording("good.take").damage is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["hand.take", "1s", "1s", "-o", "x.take"], "nothing lies between 1s and 1s"),
        (["hand.take", "5s", "9s", "-o", "x.take"], "nothing is recorded from 5s to 9s"),
        (["hand.take", "1e17s", "end", "-o", "x.take"], "nothing is recorded"),
        (["hand.take", "later", "end", "-o", "x.take"], "FROM: "),
        (["hand.take", "0s", "1kg", "-o", "x.take"], "TO: "),
        (["hand.take", "0s", "1s"], "name the file to write, by -o NEW.take"),
        (["hand.take", "0s", "1s", "-o", "x.csv"], "the name of a recording ends in .take"),
        (["hand.take", "0s", "1s", "-o", "hand.take", "-f"], "is an input"),
        (["hand.take", "0s", "1s", "-o", "other.take"], "other.take exists"),
    ],
)
def test_take_trim_refusals(folder: Path, capsys: Capture, words: list[str], message: str) -> None:
    (folder / "other.take").write_bytes(data())
    before = sorted(folder.iterdir())
    assert app.run(["take", "trim", *words]) == 2
    assert message in capsys.readouterr().err
    assert sorted(folder.iterdir()) == before
    assert (folder / "other.take").read_bytes() == (folder / "hand.take").read_bytes() == data()


def test_take_csv_export_and_import_round_trip(capsys: Capture) -> None:
    assert app.run(["take", "export", "hand.take", "-o", "x.csv"]) == 0
    head = Path("x.csv").read_text().splitlines()[:3]
    assert head[0] == "# take 1, made by ergon, 44000 Hz, ticks of 44 frames"
    assert head[1].split(",")[:4] == ["t [s]", "tick [1]", "remi [m]", "remi force [N]"]
    first = hand(1000)[0]
    assert [float(cell) for cell in head[2].split(",")[1:7]] == [1000, *first]
    take = read(Path("x.csv"), "remi")
    want = read(Path("hand.take"), "remi")
    assert (take.t.tolist(), take.x.tolist()) == (want.t.tolist(), want.x.tolist())
    command = ["take", "import", "x.csv", "-o", "y.take", "--channel", "remi", "--channel", "ada"]
    assert app.run([*command, "--audio", "44kHz", "--tick", "44"]) == 0
    back, there = _core.read_recording("y.take"), _core.read_recording("hand.take")
    assert back.ticks().tolist() == list(range(2000))
    assert back.axes == [("remi", ""), ("ada", "")]
    assert np.abs(back.positions() - there.positions()).max() < 1e-15
    assert json.loads(back.about) == {"imported": "x.csv"}


def test_take_export_csv_to_stdout(capsysbinary: pytest.CaptureFixture[bytes]) -> None:
    assert app.run(["take", "export", "hand.take", "-o", "x.csv"]) == 0
    capsysbinary.readouterr()
    assert app.run(["take", "export", "hand.take", "-o", "-"]) == 0
    assert capsysbinary.readouterr() == (Path("x.csv").read_bytes(), b"")


def test_take_export_npz(capsys: Capture) -> None:
    assert app.run(["take", "export", "hand.take", "-o", "x.npz"]) == 0
    complete = _core.read_recording("hand.take")
    with np.load("x.npz") as arrays:
        assert arrays["ada [m]"].tobytes() == complete.positions()[:, 1].tobytes()
        assert arrays["remi sent [N]"].dtype == np.float32
        assert arrays["tick [1]"].tolist() == complete.ticks().tolist()
    assert read(Path("x.npz"), "ada").x.tolist() == complete.positions()[:, 1].tolist()
    first = Path("x.npz").read_bytes()
    assert app.run(["take", "export", "hand.take", "-o", "x.npz", "-f"]) == 0
    assert Path("x.npz").read_bytes() == first


def test_take_wav_export_at_audio_rate(capsys: Capture) -> None:
    assert app.run(["take", "export", "hand.take", "-o", "x.wav"]) == 0
    samples, rate = soundfile.read("x.wav", dtype="float64")
    assert rate == 44000
    assert samples.shape == (1999 * 44 + 1, 2)
    complete = _core.read_recording("hand.take").positions()
    assert np.abs(samples[::44] - complete).max() < 3e-10  # single precision of 4 mm
    # Between the ticks too: the hand was a sine.
    middle = slice(44 * 500, 44 * 1500)
    wanted = 4e-3 * np.sin((1000 + np.arange(len(samples)) / 44) / 200)
    assert np.abs(samples[middle, 0] - wanted[middle]).max() < 1e-9


def test_take_wav_export_refuses_fractional_rate(folder: Path, capsys: Capture) -> None:
    every = rows(*(row(t, Axis(0.0)) for t in range(3)))
    (folder / "odd.take").write_bytes(header(rate=44100.5) + every + end())
    assert app.run(["take", "export", "odd.take", "-o", "x.wav"]) == 2
    assert "whole number of frames per second" in capsys.readouterr().err
    assert not Path("x.wav").exists()


def test_take_dry_runs_write_nothing(folder: Path, capsys: Capture) -> None:
    (folder / "x.csv").write_text("t [s],x [mm]\n0,0\n1,1\n2,0\n")
    before = sorted(folder.iterdir())
    for command in (
        ["trim", "hand.take", "0s", "1s", "-o", "y.take"],
        ["export", "hand.take", "-o", "y.csv"],
        ["import", "x.csv", "-o", "y.take"],
    ):
        assert app.run(["take", *command, "-n"]) == 0
        assert capsys.readouterr().err.startswith("would write y.")
    assert sorted(folder.iterdir()) == before


def test_take_import_samples_spline_at_every_tick(folder: Path, capsys: Capture) -> None:
    t = np.array([0.0, 0.031, 0.064, 0.11, 0.15, 0.2])
    x = np.array([0.0, 1.0, 3.0, 2.0, 0.5, 0.0])
    lines = [f"{a},{b}\n" for a, b in zip(t, x, strict=True)]
    (folder / "x.csv").write_text("t [s],x [mm]\n" + "".join(lines))
    assert app.run(["take", "import", "x.csv", "-o", "y.take"]) == 0
    result = _core.read_recording("y.take")
    assert (result.rate, result.frames, result.names) == (44100.0, 44, ["x"])
    take = _core.Take(t, x / 1e3)
    want = [take.evaluate(k * 44 / 44100)[0] for k in range(len(result.ticks()))]
    assert result.positions()[:, 0].tolist() == want
    assert len(want) == int(0.2 * 44100 / 44) + 1


def test_import_of_motion_capture_as_take(folder: Path, capsys: Capture) -> None:
    """A marker's axis in mm and a joint's in units of 1 cm, read as a score reads them, too."""
    places = motion_files.curve(40)
    places[20:22, 0] = np.nan
    (folder / "walk.c3d").write_bytes(motion_files.c3d(places))
    command = ["take", "import", "walk.c3d", "-o", "y.take", "--channel", "RWRI.z"]
    assert app.run([*command, "--channel", "LWRI.x", "--audio", "44kHz", "--tick", "44"]) == 0
    assert "'RWRI' is not seen in 2 frames" in capsys.readouterr().err
    result = _core.read_recording("y.take")
    assert result.names == ["RWRI.z", "LWRI.x"]
    every = result.positions()[::10, 1]
    assert np.allclose(every, (places[:, 1, 0] - places[0, 1, 0]) / 1e3, atol=1e-12)
    rows = np.zeros((30, 12))
    rows[:, 0] = np.arange(30) ** 2
    (folder / "dance.bvh").write_bytes(motion_files.bvh(rows))
    command = ["take", "import", "dance.bvh", "-o", "z.take", "--channel", "hand.x"]
    assert app.run(command) == 2
    assert "write what 1.0 means" in capsys.readouterr().err
    assert app.run([*command, "--unit", "1cm"]) == 0
    capsys.readouterr()
    assert app.run(["info", "walk.c3d"]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0] == "walk.c3d: 40 samples, 0.39 s, 100 Hz on average"
    assert output[1].startswith("  RWRI.x [m]: -0.04")
    score = "ergon: 1\nkeys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {a: {key: k}}\n"
    score += "takes: {hop: {file: dance.bvh, channel: hand.x, unit: 0.01mm}}\n"
    (folder / "s.yaml").write_text(score + "parts: {a: [{at: 1|1, play: hop}]}\n")
    assert app.run(["check", "s.yaml"]) == 0, capsys.readouterr().err
    (folder / "s.yaml").write_text(
        score.replace(", unit: 0.01mm", "") + "parts: {a: [{at: 1|1, play: hop}]}\n"
    )
    assert app.run(["check", "s.yaml"]) == 1
    assert "E310" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["x.gms", "-o", "y.take"], "GMS files are not read"),
        (["x.csv", "-o", "y.take"], "write `channel` as one of a, b"),
        (["x.csv", "-o", "y.take", "--channel", "aa"], "did you mean 'a'?"),
        (["x.csv", "-o", "y.take", "--channel", "a", "--rate", "9Hz"], "remove `rate`"),
        (["x.csv", "-o", "y.take", "--channel", "a", "--audio", "fast"], "--audio: "),
        (["long.csv", "-o", "y.take"], "longer than a recording can be"),
        (["hand.take", "-o", "y.take"], "is a recording already"),
        (["x.csv", "-o", "y.wav", "--channel", "a"], "the name of a recording ends in .take"),
        (["x.csv", "--channel", "a"], "name the file to write"),
    ],
)
def test_take_import_refusals(
    folder: Path, capsys: Capture, words: list[str], message: str
) -> None:
    (folder / "x.csv").write_text("t [s],a [mm],b [mm]\n0,0,0\n1,1,1\n2,0,0\n")
    (folder / "long.csv").write_text("t [s],a [mm]\n0,0\n1e9,1\n")
    (folder / "x.gms").write_bytes(b"FORM")
    assert app.run(["take", "import", *words]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "y.take").exists()


def test_take_trim_refuses_existing_recording(folder: Path, capsys: Capture) -> None:
    saved = header(HANDS, about='{"by": "made by ergon"}') + end()
    (folder / "y.take").write_bytes(saved)
    for dry in ([], ["-n"]):
        assert app.run(["take", "trim", "hand.take", "0s", "1s", "-o", "y.take", *dry]) == 2
        assert "exists; -f overwrites it" in capsys.readouterr().err
    assert (folder / "y.take").read_bytes() == saved
    assert app.run(["take", "trim", "hand.take", "0s", "1s", "-o", "y.take", "-f"]) == 0
    assert (folder / "y.take").read_bytes() != saved


def test_take_suggests_misspelt_subcommand(capsys: Capture) -> None:
    assert app.run(["take", "trimm"]) == 2
    assert "Did you mean 'trim'?" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["nan", "NaN", "inf", "-inf"])
def test_take_info_names_infinite_values(word: str, capsys: Capture, tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text(f"t [s],x [mm],y [mm]\n0,0,0\n0.01,{word},1\n0.02,2,2\n0.03,{word},3\n")
    assert app.run(["take", "info", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "x [mm]: 0 … 2, from 0 to 2; 2 values are not finite, first in line 3" in shown
    assert "y [mm]: 0 … 3, from 0 to 3\n" in shown


def test_take_info_names_infinite_npz_sample(capsys: Capture, tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(4) * 0.01, x=np.array([0.0, 1.0, np.nan, 3.0]))
    assert app.run(["take", "info", str(path)]) == 0
    assert "; 1 value is not finite, first in sample 3" in capsys.readouterr().out


def test_take_info_names_frames_of_hidden_markers(capsys: Capture, tmp_path: Path):
    head = (
        "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t3\t1\tmm\n"
        "Frame#\tTime\tA\t\t\n\t\tX1\tY1\tZ1\n\n"
    )
    path = tmp_path / "a.trc"
    path.write_text(head + "1\t0.00\t1\t2\t3\n2\t0.01\tnan\tnan\tnan\n3\t0.02\t1\t2\t3\n")
    assert app.run(["take", "info", str(path)]) == 0
    assert capsys.readouterr().out.count("; not seen in 1 frame, first in frame 2") == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t [s] x [mm]\n0 1\n", "2: '0 1' in column 't [s] x [mm]' is not a number; columns are"),
        ("t [s],x [mm]\n0,1\n0.1,10%\n", "3: '10%' in column 'x [mm]' is not a number"),
        ("t [s],x [mm]\n0,1_000\n", "2: '1_000' in column 'x [mm]' is not a number"),
        ("t [s],x [mm]\n0,\N{MINUS SIGN}1\n", "2: '\N{MINUS SIGN}1' in column 'x [mm]' is not"),
    ],
)
def test_take_info_names_cell_without_number(
    text: str, message: str, capsys: Capture, tmp_path: Path
):
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    assert app.run(["take", "info", str(path)]) == 2
    assert f"a.csv:{message}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t [s],x [mm],x [mm]\n0,1,2\n0.1,2,3\n", "two columns are called 'x'"),
        ("t [s],x [in]\n0,1\n0.1,2\n", "'x [in]' has no unit of a position"),
        ("t [min],x [mm]\n0,1\n0.1,2\n", "'t [min]' has no unit of a time"),
    ],
)
def test_take_info_of_unplayable_table(text: str, message: str, capsys: Capture, tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert app.run(["take", "info", str(path)]) == 0
    assert message in capsys.readouterr().err
    with pytest.raises(TakeError):
        read(path, "x")


def test_take_info_of_npz_with_another_number_of_instants(capsys: Capture, tmp_path: Path):
    np.savez(tmp_path / "a.npz", t=np.arange(4) * 0.1, x=np.arange(5.0))
    assert app.run(["take", "info", str(tmp_path / "a.npz")]) == 0
    assert "4 instants, but 5 values of 'x': a take of it is refused" in capsys.readouterr().err
