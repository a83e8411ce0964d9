"""Commands that read scores: check, compile, plot, export, info."""

import os
import re
import subprocess
import sys
from pathlib import Path

import mido
import numpy as np
import pytest
from commands import ERGON, records
from one_bell import SCORE

from ergon.cli import app
from ergon.exchange.wave import hash_samples

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    (work_folder / "bell.yaml").write_text(SCORE)
    return work_folder


# --- check --------------------------------------------------------------------------------------


def test_check_of_a_good_score(capsys: Capture) -> None:
    assert app.run(["check", "bell.yaml"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "bell.yaml: no mistakes\n"
    assert app.run(["check", "-q", "bell.yaml"]) == 0
    assert capsys.readouterr() == ("", "")


def test_check_prints_mistakes_with_places(folder: Path, capsys: Capture) -> None:
    Path("bad.yaml").write_text(SCORE.replace("smooth 6mm", "smoth 6mm"))
    assert app.run(["check", "bad.yaml", "bell.yaml"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "bad.yaml:16:16: error[E204]" in err
    assert "^^^^^ did you mean 'smooth'?" in err
    assert err.endswith("bad.yaml: 1 error\nbell.yaml: no mistakes\nerror: 1 of 2 scores\n")


def test_check_json_and_github_formats(capsys: Capture) -> None:
    Path("bad.yaml").write_text(SCORE.replace("smooth 6mm", "smoth 6mm"))
    assert app.run(["check", "--json", "bad.yaml"]) == 1
    (record,) = records(capsys)
    want = {"v": 1, "event": "error", "code": "E204", "line": 16, "column": 16}
    assert want.items() <= record.items()
    assert record["suggestion"] == "smooth"
    assert app.run(["check", "--format", "github", "bad.yaml"]) == 1
    assert capsys.readouterr().out.startswith("::error file=bad.yaml,line=16,col=16")
    assert app.run(["check", "-q", "--format", "concise", "bad.yaml"]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_check_of_score_from_stdin() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [*ERGON, "check", "-"],
        input=SCORE.replace("play: knock", "play: knokc"),
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 1
    assert "-:22:" in done.stderr
    assert "did you mean 'knock'?" in done.stderr
    assert "\x1b" not in done.stderr


def test_check_of_missing_file(capsys: Capture) -> None:
    assert app.run(["check", "nowhere.yaml"]) == 1
    assert "nowhere.yaml" in capsys.readouterr().err


def followed(capsys: Capture) -> list[dict]:
    return [record for record in records(capsys) if record["event"] == "followed"]


def test_check_simulate_reports_gesture_following(capsys: Capture) -> None:
    assert app.run(["check", "--simulate", "bell.yaml"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"ada knock.* on k1: followed within .*m rms, worst .*m at \d+\|[\d.]+", out)
    assert app.run(["check", "--simulate", "--json", "bell.yaml"]) == 0
    (record,) = followed(capsys)
    assert (record["player"], record["gesture"], record["key"]) == ("ada", "knock", "k1")
    assert record["worst_m"] >= record["rms_m"] >= 0


def test_check_simulate_of_layered_gesture(folder: Path, capsys: Capture) -> None:
    score = SCORE.replace("every: 1, times: 2", "layer: true")
    assert score != SCORE
    (folder / "layer.yaml").write_text(score)
    assert app.run(["check", "--simulate", "layer.yaml"]) == 0
    assert "ada knock on k1: a layer, added to the gesture that runs\n" in capsys.readouterr().out
    assert app.run(["check", "--simulate", "--json", "layer.yaml"]) == 0
    (record,) = followed(capsys)
    assert record["ergons"] > 0
    assert record["is_layer"]
    assert record["worst_at"] is record["worst_at_s"] is None


def test_simulate_reports_a_gesture_cut_before_its_first_ergon(
    folder: Path, capsys: Capture
) -> None:
    cut = SCORE.replace(
        "play: knock, every: 1, times: 2}", "play: lean}\n    - {at: A, play: knock}"
    )
    (folder / "cut.yaml").write_text(cut)
    assert app.run(["check", "--simulate", "cut.yaml"]) == 0
    assert (
        "ada lean on k1: ended by the next gesture before its first ergon\n"
        in capsys.readouterr().out
    )


def test_simulate_reports_tracked_strokes_as_followed_exactly(
    folder: Path, capsys: Capture
) -> None:
    (folder / "exact.yaml").write_text(SCORE.replace("times: 2", "times: 2, touch: tracked"))
    assert app.run(["check", "--simulate", "exact.yaml"]) == 0
    assert re.search(r"ada knock ×2 on k1: followed (exactly|within)", capsys.readouterr().out)


def test_check_simulate_swings_and_contacts(folder: Path, capsys: Capture) -> None:
    assert app.run(["check", "--simulate", "--json", "bell.yaml"]) == 0
    rows = records(capsys)
    key = next(r for r in rows if r["event"] == "swing" and r["mass"] == "k1")
    assert key["low_m"] < 0 < key["high_m"] < 0.02
    contact = next(r for r in rows if r["event"] == "contact")
    assert (contact["striker"], contact["closed"] > 0) == ("k1", True)
    assert contact["first_s"] > 0
    assert contact["deepest_m"] > 0


def test_check_simulate_warns_of_open_contact(folder: Path, capsys: Capture) -> None:
    assert "gap: 1mm" in SCORE
    (folder / "far.yaml").write_text(SCORE.replace("gap: 1mm", "gap: 14mm"))
    assert app.run(["check", "--simulate", "far.yaml"]) == 0
    output = capsys.readouterr()
    assert "warning[W320] contact" in output.err
    missed = re.search(r"k1 comes within ([\d.]+) mm of touching", output.err)
    reached = re.search(r"^k1: from .* to ([\d.]+) mm", output.out, re.MULTILINE)
    assert missed
    assert reached
    assert float(missed[1]) + float(reached[1]) == pytest.approx(14.0, abs=0.05)
    assert app.run(["render", "far.yaml", "-o", "far.wav"]) == 0
    printed = capsys.readouterr().err
    assert "warning[W324] the file is silent" in printed
    assert "`ergon check --simulate` says what moves and what touches" in printed


def test_check_simulate_warns_of_swapped_contact_ends(folder: Path, capsys: Capture) -> None:
    assert "between: [k1, m]" in SCORE
    (folder / "swapped.yaml").write_text(SCORE.replace("between: [k1, m]", "between: [m, k1]"))
    assert app.run(["check", "--simulate", "swapped.yaml"]) == 0
    message = capsys.readouterr()
    assert "its ends may be swapped: as `between: [k1, m]` it closes" in message.err
    deep = re.search(r"it closes, ([\d.]+) mm deep in this motion", message.err)
    reached = re.search(r"^k1: from .* to ([\d.]+) mm", message.out, re.MULTILINE)
    assert deep
    assert reached
    assert float(deep[1]) + 1.0 == pytest.approx(float(reached[1]), abs=0.05)  # the gap is 1 mm
    (folder / "far.yaml").write_text(SCORE.replace("gap: 1mm", "gap: 14mm"))
    assert app.run(["check", "--simulate", "far.yaml"]) == 0
    assert "swapped" not in capsys.readouterr().err


def test_plot_of_score_without_gestures_is_refused(folder: Path, capsys: Capture) -> None:
    (folder / "still.yaml").write_text("ergon: 1\n")
    assert app.run(["plot", "still.yaml"]) == 2
    message = capsys.readouterr().err
    assert "still.yaml has no gesture, take or player, which `ergon plot` draws" in message
    assert "`ergon render still.yaml`" in message


# --- compile ------------------------------------------------------------------------------------


def test_compile_prints_the_stream(capsys: Capture) -> None:
    assert app.run(["compile", "bell.yaml"]) == 0
    head, columns, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("# ergon stream 1, made by ergon, 44100 Hz, score ")
    assert columns.split(",") == [
        "time [s]", "struck", "sign", "mass [kg]", "speed [m/s]", "impulse [N·s]", "source",
    ]  # fmt: skip
    assert rows
    assert re.search(r"bell\.yaml:\d+:\d+$", rows[0])
    assert app.run(["compile", "--json", "bell.yaml"]) == 0
    about, first, *_ = records(capsys)
    assert (about["event"], about["v"]) == ("stream", 1)
    assert first["struck"].startswith("k1")


def test_compile_output_file_and_foreign_file(capsys: Capture) -> None:
    assert app.run(["compile", "bell.yaml", "-o", "e.csv"]) == 0
    assert app.run(["compile", "bell.yaml", "-o", "e.csv"]) == 0
    Path("notes.csv").write_text("mine\n")
    assert app.run(["compile", "bell.yaml", "-o", "notes.csv"]) == 2
    assert Path("notes.csv").read_text() == "mine\n"
    assert "notes.csv exists, and ergon has no record" in capsys.readouterr().err


# --- plot, export, info -------------------------------------------------------------------------


def test_plot_in_the_terminal_and_as_svg(capsys: Capture) -> None:
    assert app.run(["plot", "bell.yaml", "knock", "--width", "60", "--height", "12"]) == 0
    out = capsys.readouterr().out
    title, *lines = out.splitlines()
    assert title == "knock at 1|1 on k1"
    assert len(lines) == 12
    assert "asked" in lines[0]
    assert "done" in lines[0]
    assert app.run(["plot", "bell.yaml", "knock", "--svg", "k.svg"]) == 0
    assert "made by ergon" in Path("k.svg").read_text()
    assert app.run(["plot", "-q", "bell.yaml", "ada", "--svg", "k.svg"]) == 0


def test_plot_of_an_unplayed_gesture(capsys: Capture) -> None:
    assert app.run(["plot", "bell.yaml", "lean", "--key", "k1"]) == 0
    assert capsys.readouterr().out.startswith("lean on k1")


def test_plot_suggests_misspelt_names(capsys: Capture) -> None:
    assert app.run(["plot", "bell.yaml", "knokc"]) == 2
    assert "did you mean 'knock'?" in capsys.readouterr().err
    assert app.run(["plot", "bell.yaml"]) == 2
    assert "gestures: knock, lean" in capsys.readouterr().err
    assert app.run(["plot", "bell.yaml", "knock", "--key", "k2"]) == 2
    assert "there is no key 'k2' (there is k1)" in capsys.readouterr().err


def test_plot_of_a_sound(capsys: Capture) -> None:
    assert app.run(["render", "-q", "bell.yaml"]) == 0
    assert app.run(["plot", "bell.wav"]) == 0
    assert "highest" in capsys.readouterr().out
    assert app.run(["plot", "bell.wav", "--svg", "bell.svg"]) == 0
    assert "frequency [Hz]" in Path("bell.svg").read_text()


def test_export_command_files(capsys: Capture) -> None:
    assert app.run(["export", "bell.yaml", "-o", "daw"]) == 0
    assert {path.name for path in Path("daw").iterdir()} == {
        "tempo.mid", "marks.csv", "mix.wav", "stems", "project.rpp",
    }  # fmt: skip
    rows = Path("daw/marks.csv").read_text().splitlines()
    assert rows[2:] == ["A,1|1,0.000000", "B,2|3,3.000000"]
    midi = mido.MidiFile("daw/tempo.mid")
    tempos = [m.tempo for m in midi.tracks[0] if m.type == "set_tempo"]
    assert tempos[0] == 500_000
    assert len(tempos) > 10
    assert [m.text for m in midi.tracks[0] if m.type == "marker"] == ["A", "B"]
    assert app.run(["render", "-q", "bell.yaml", "--stems", "stems"]) == 0
    assert hash_samples(Path("daw/mix.wav")) == hash_samples(Path("bell.wav"))
    stems = [path.name for path in Path("stems").iterdir()]
    assert stems
    for name in stems:
        assert hash_samples(Path("daw/stems", name)) == hash_samples(Path("stems", name))
    assert app.run(["export", "-q", "bell.yaml", "-o", "daw", "--no-stems"]) == 0


def test_export_without_unrepresentable_tempo_map(capsys: Capture) -> None:
    Path("slow.yaml").write_text("""\
ergon: 1
tempo: {at: 0, bpm: 2}
instruments: {cell: {CEL: {M: 1g, f: A4, t60: 0.2s}, out: {SOX: cell}}}
strikes: {s: {to: cell, at: 0, impulse: 1mNs}}
render: {tail: 1s}
""")
    assert app.run(["export", "slow.yaml", "-o", "slow"]) == 0
    assert {path.name for path in Path("slow").iterdir()} == {"marks.csv", "mix.wav", "stems"}
    warning = " ".join(capsys.readouterr().err.split())
    assert "a quarter note lasts 30 s there" in warning
    assert "tempo.mid and slow/project.rpp are left out" in warning


def test_info_of_a_render_and_its_score(capsys: Capture) -> None:
    assert app.run(["render", "-q", "bell.yaml"]) == 0
    assert app.run(["info", "bell.wav"]) == 0
    out = capsys.readouterr().out
    assert "2 channels, 44100 Hz, 24 bits, RIFF" in out
    assert hash_samples(Path("bell.wav")) in out
    assert app.run(["info", "bell.wav", "--score", "bell.yaml"]) == 0
    Path("bell.yaml").write_text(SCORE.replace("6mm", "7mm"))
    assert app.run(["info", "bell.wav", "--score", "bell.yaml"]) == 1
    assert "another score" in capsys.readouterr().err


def test_info_of_a_take(capsys: Capture) -> None:
    rows = "\n".join(f"{n / 30:.4f},{n % 7}" for n in range(61))
    Path("hand.csv").write_text(f"# a hand\nt [s],x [mm]\n{rows}\n")
    assert app.run(["info", "hand.csv"]) == 0
    out = capsys.readouterr().out
    assert "61 samples, 2 s, 30 Hz" in out
    assert "x [mm]: 0 … 6" in out
    np.savez("hand.npz", t=np.arange(5) / 10, x=np.arange(5.0))
    assert app.run(["info", "--json", "hand.npz"]) == 0
    (record,) = records(capsys)
    assert record["samples"] == 5
    assert record["rate_hz"] == pytest.approx(10)


@pytest.mark.parametrize("name", ["x.csv", "x.npz", "x.wav"])
def test_info_of_garbage(name: str, capsys: Capture) -> None:
    Path(name).write_bytes(b"\0\1\2 garbage, really\n\xff")
    assert app.run(["info", name]) == 2
    assert "internal" not in capsys.readouterr().err


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_info_of_take_with_time_units(folder: Path, capsys: Capture, separator: str) -> None:
    rows = [("t [ms]", "tip [mm]"), ("0", "1"), ("5", "2"), ("10", "4")]
    (folder / "ms.csv").write_text("".join(f"{separator.join(row)}\n" for row in rows))
    assert app.run(["info", "--json", "ms.csv"]) == 0
    (record,) = records(capsys)
    assert record["duration_s"] == pytest.approx(0.01)
    assert record["rate_hz"] == pytest.approx(200)
    assert record["channels"] == [{"name": "tip [mm]", "low": 1, "high": 4, "not_finite": 0}]


def test_take_without_times_needs_rate(folder: Path, capsys: Capture) -> None:
    (folder / "bare.csv").write_text("x [mm]\n0\n2\n0\n")
    score = SCORE.replace("play: knock, every: 1, times: 2", "play: hand")
    for take, code in (("file: bare.csv", 1), ("file: bare.csv, rate: 10Hz", 0)):
        (folder / "hand.yaml").write_text(f"{score}takes: {{hand: {{{take}}}}}\n")
        assert app.run(["check", "--json", "hand.yaml"]) == code
    assert "rate: 1kHz" in records(capsys)[0]["message"]


def test_info_of_a_score(capsys: Capture) -> None:
    assert app.run(["info", "bell.yaml"]) == 0
    out = capsys.readouterr().out
    assert "One bell" in out
    assert "gestures: knock, lean" in out
    assert app.run(["info", "--json", "bell.yaml"]) == 0
    (record,) = records(capsys)
    assert record["marks"] == ["A", "B"]
