"""`ergon render`, from the command line to the file."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import records
from one_bell import SCORE

from ergon.cli import app
from ergon.exchange.wave import hash_samples, read_info

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    (work_folder / "bell.yaml").write_text(SCORE)
    return work_folder


def test_render_file_format_and_summary(capsys: Capture) -> None:
    text = Path("bell.yaml").read_text(encoding="utf-8")
    text = text.replace("mix: {", "mix: {master: {normalise: -1dB}, ")
    Path("bell.yaml").write_text(text, encoding="utf-8")
    assert app.run(["render", "bell.yaml"]) == 0
    err = capsys.readouterr().err
    data, rate = soundfile.read("bell.wav")
    assert rate == 44_100
    assert data.shape[1] == 2
    assert np.abs(data).max() == pytest.approx(10 ** (-1 / 20), abs=1e-6)
    info = read_info(Path("bell.wav"))
    assert (info.title, info.format.bits) == ("One bell", 24)
    pattern = (
        r"bell\.wav: .* s, 2 channels, .* × real time, peak -1\.0 dBFS, "
        r"true peak -[01]\.\d dBTP, loudness -[0-9.]+ LUFS, gain [+-][0-9.]+ dB, "
        r"sha256 [0-9a-f]{12}\n"
    )
    assert re.fullmatch(pattern, err)


FADED = 221  # frames, 5 ms, at an edge that is cut

TWO_BELLS = """\
ergon: 1
instruments:
  low: {modules: {m: {CEL: {M: 2g, f: A3, t60: 2s}}}, out: {SOX: m}}
  high: {modules: {m: {CEL: {M: 2g, f: A4, t60: 1s}}}, out: {SOV: m}}
strikes:
  soft: {to: low.m, at: 0s, impulse: 0.1mNs}
  hard: {to: high.m, at: 1s, impulse: 5mNs}
mix: {route: [{from: low, to: 1}, {from: high, to: 2, gain: 40dB}], master: {MASTER}}
"""


@pytest.mark.parametrize("master", ["normalise: -1dB", "loudness: -12LUFS, limit: -6dB"])
def test_render_parts_and_stems_at_level_of_piece(master: str, capsys: Capture) -> None:
    Path("two.yaml").write_text(TWO_BELLS.replace("MASTER", master), encoding="utf-8")
    assert app.run(["render", "two.yaml", "--stems", "stems"]) == 0
    mix, _ = soundfile.read("two.wav")
    stems = [soundfile.read(path)[0] for path in sorted(Path("stems").glob("*.wav"))]
    np.testing.assert_allclose(sum(stems), mix, atol=2 * 2.0**-23)
    for words in (["--until", "0.75s"], ["--from", "0.5s", "--until", "1.5s"], ["--from", "1.25s"]):
        assert app.run(["render", "two.yaml", *words, "-o", "part.wav", "--force"]) == 0
        part, _ = soundfile.read("part.wav")
        start = round(44_100 * float(words[1][:-1])) if words[0] == "--from" else 0
        inner = slice(FADED, len(part) - FADED)
        np.testing.assert_array_equal(part[inner], mix[start : start + len(part)][inner])
    capsys.readouterr()


@pytest.mark.parametrize("master", ["normalise: -3dB", "loudness: -28LUFS"])
def test_play_gain_equals_render_gain(master: str, capsys: Capture) -> None:
    Path("two.yaml").write_text(TWO_BELLS.replace("MASTER", master), encoding="utf-8")
    assert app.run(["render", "two.yaml", "--json"]) == 0
    (rendered,) = [r for r in records(capsys) if r["event"] == "rendered"]
    assert app.run(["play", "two.yaml", "--audio", "file:live.wav", "--plain"]) == 0
    (gain,) = re.findall(r"gain ([+-][0-9.]+) dB, from a preflight", capsys.readouterr().err)
    assert float(gain) == pytest.approx(rendered["gain_db"], abs=0.06)


def test_render_reports_level_below_master_loudness(capsys: Capture) -> None:
    Path("two.yaml").write_text(TWO_BELLS.replace("MASTER", "loudness: -3LUFS"), encoding="utf-8")
    assert app.run(["render", "two.yaml"]) == 0
    output = capsys.readouterr().err
    assert "true peak -1.0 dBTP" in output
    assert "dB below the -3 LUFS of its master" in output
    for part in (["--until", "0.75s"], ["--from", "1.5s"]):
        assert app.run(["render", "two.yaml", *part, "-o", "part.wav", "--force"]) == 0
        assert "of its master" not in capsys.readouterr().err


def test_render_json_record(capsys: Capture) -> None:
    assert app.run(["render", "--json", "bell.yaml", "-o", "out/x.wav", "--bits", "float"]) == 0
    (record,) = [r for r in records(capsys) if r["event"] != "progress"]
    assert list(record) == [
        "v", "event", "file", "frames", "channels", "rate_hz", "wall_s", "plan_s", "x_real_time",
        "peak_dbfs", "true_peak_dbtp", "loudness_lufs", "gain_db", "sha256", "modules", "threads",
        "recalled",
    ]  # fmt: skip
    info = read_info(Path("out/x.wav"))
    assert record["event"] == "rendered"
    assert (record["file"], record["frames"]) == ("out/x.wav", info.n_frames)
    assert record["sha256"] == hash_samples(Path("out/x.wav"))
    assert info.format.bits == "float"


def test_render_bytes_with_threads_and_blocks() -> None:
    for index, more in enumerate(
        (["--threads", "1"], ["--threads", "2", "--block", "997"], ["--block", "64"])
    ):
        assert app.run(["render", "-q", "bell.yaml", "-o", f"{index}.wav", *more]) == 0
    item, two, three = (Path(f"{index}.wav").read_bytes() for index in range(3))
    assert item == two == three


def test_render_bytes_with_comment_and_other_title() -> None:
    Path("same.yaml").write_text("# by hand\n" + SCORE)
    Path("other.yaml").write_text(SCORE.replace("One bell", "Another"))
    for name in ("bell", "same", "other"):
        assert app.run(["render", "-q", f"{name}.yaml"]) == 0
    assert Path("bell.wav").read_bytes() == Path("same.wav").read_bytes()
    assert Path("bell.wav").read_bytes() != Path("other.wav").read_bytes()
    assert hash_samples(Path("bell.wav")) == hash_samples(Path("other.wav"))


def test_render_from_and_until(capsys: Capture) -> None:
    assert app.run(["render", "-q", "bell.yaml", "--bits", "float"]) == 0
    part = ["--from", "0.25s", "--until", "B-2", "-o", "part.wav"]
    assert app.run(["render", "-q", "bell.yaml", "--bits", "float", *part]) == 0
    complete, _ = soundfile.read("bell.wav", dtype="float32")
    cut, _ = soundfile.read("part.wav", dtype="float32")
    inner = slice(FADED, len(cut) - FADED)
    np.testing.assert_array_equal(cut[inner], complete[11_025 : 2 * 44_100][inner])
    assert app.run(["render", "bell.yaml", "--from", "Q"]) == 2
    assert "--from: unknown mark 'Q'" in capsys.readouterr().err
    assert app.run(["render", "bell.yaml", "--from", "40|1"]) == 2
    assert "the piece ends at" in capsys.readouterr().err


SINE = """\
ergon: 1
instruments: {a: {CEL: {M: 2g, f: 441Hz, t60: 1000s}, out: {SOX: a}}}
strikes: {s: {to: a, at: 0s, impulse: 1mNs}}
mix: {route: [{from: a, to: 1}], master: {normalise: -6dB}}
render: {bits: float, tail: 0.5s}
"""


@pytest.mark.parametrize("words", [["--from", "0.1s"], ["--from", "0.1s", "--until", "0.3s"]])
def test_render_edges_faded_where_sound_is_cut(words: list[str]) -> None:
    """What is above 4 kHz at an edge where a sine is cut, beside the sine."""
    Path("sine.yaml").write_text(SINE, encoding="utf-8")
    assert app.run(["render", "-q", "sine.yaml", "-o", "sine.wav", *words]) == 0
    sound, _ = soundfile.read("sine.wav")
    edges = [sound, sound[::-1]] if "--until" in words else [sound]
    for edge in edges:
        assert np.abs(edge[FADED : 2 * FADED]).max() > 0.4
        around = np.concatenate([np.zeros(2048), edge[:2048] * np.hanning(4096)[2048:]])
        spectrum = np.abs(np.fft.rfft(around))
        high = spectrum[int(4_000 * 4096 / 44_100) :].max()
        assert 20 * np.log10(high / spectrum.max()) < -80


def test_render_of_piece_without_length_suggests_tail(folder: Path, capsys: Capture) -> None:
    """A take that drives a module strikes nothing."""
    text = "ergon: 1\ntakes: {t: {file: t.csv}}\ninstruments:\n  a:\n"
    text += "    modules: {m: {MAS: {M: 1g}}, x: {ENX: {to: m, from: t}}}\n    out: {SOX: m}\n"
    (folder / "t.csv").write_text("t [s],x [mm]\n0,0\n0.1,1\n0.2,0\n")
    (folder / "a.yaml").write_text(f"{text}render: {{tail: 0s}}\n")
    assert app.run(["render", "a.yaml"]) == 1
    message = capsys.readouterr().err
    assert "the piece has no length" in message
    assert "render: {tail: 2s}" in message
    assert "--from" not in message
    (folder / "b.yaml").write_text(f"{text}render: {{tail: 0.2s}}\n")
    assert app.run(["render", "b.yaml"]) == 0


def test_render_at_another_rate() -> None:
    assert app.run(["render", "-q", "bell.yaml"]) == 0
    assert app.run(["render", "-q", "bell.yaml", "--rate", "48000", "-o", "48.wav"]) == 0
    first, two = read_info(Path("bell.wav")), read_info(Path("48.wav"))
    assert two.format.rate == 48_000
    assert two.n_frames / 48_000 == pytest.approx(first.n_frames / 44_100, abs=1e-4)
    assert first.score == two.score
    assert app.run(["render", "bell.yaml", "--rate", "44100.5"]) == 2


def test_render_stems_option() -> None:
    assert app.run(["render", "-q", "bell.yaml", "--stems", "parts"]) == 0
    (stem,) = Path("parts").iterdir()
    assert re.fullmatch(r"01_\w+\.wav", stem.name)
    assert read_info(stem).n_frames == read_info(Path("bell.wav")).n_frames


def test_dry_run_prints_and_writes_no_file(folder: Path, capsys: Capture) -> None:
    assert app.run(["render", "-n", "bell.yaml"]) == 0
    out = capsys.readouterr().out
    assert "2 channels" in out
    assert "stability: " in out
    assert [path.name for path in folder.iterdir()] == ["bell.yaml"]
    assert app.run(["render", "-n", "--json", "bell.yaml", "--bits", "16"]) == 0
    (record,) = records(capsys)
    assert record["disk_bytes"] == record["frames"] * 2 * 2
    assert record["margin"] > 1


def test_dry_run_accepts_scores_planned_by_modes(capsys: Capture) -> None:
    """Module by module, once a frame, this string would diverge; a plan takes its modes."""
    stiff = """\
ergon: 1
instruments:
  wire: {modules: {s: {STRING: {masses: 40, M: 2g, f: 700Hz, t60: 1s}}}, out: {SOX: s.9}}
strikes: {a: {to: [wire.s.3], at: 0.1s, impulse: 1mNs}}
render: {tail: 0.1s}
"""
    Path("stiff.yaml").write_text(stiff)
    assert app.run(["render", "-n", "stiff.yaml"]) == 0
    assert "once a frame, it would diverge" in capsys.readouterr().out
    assert app.run(["render", "-n", "--json", "stiff.yaml"]) == 0
    (record,) = records(capsys)
    assert record["margin"] is None
    assert record["certificate"] == "proved"
    assert app.run(["render", "-q", "stiff.yaml"]) == 0


def test_render_replaces_only_files_by_ergon(capsys: Capture) -> None:
    soundfile.write("bell.wav", np.zeros(10), 44_100)
    before = Path("bell.wav").read_bytes()
    assert app.run(["render", "bell.yaml"]) == 2
    assert Path("bell.wav").read_bytes() == before
    assert "-f overwrites it" in capsys.readouterr().err
    assert app.run(["render", "-q", "-f", "bell.yaml"]) == 0
    assert app.run(["render", "-q", "bell.yaml"]) == 0
    assert read_info(Path("bell.wav")).originator == "ergon"


def test_render_to_a_pipe(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert app.run(["render", "bell.yaml", "-o", "-"]) == 0
    out, err = capfdbinary.readouterr()
    assert out[:4] == b"RIFF"
    assert err.startswith(b"stdout: ")
    assert app.run(["render", "-q", "bell.yaml"]) == 0
    assert Path("bell.wav").read_bytes() == out


def test_render_refuses_contradicting_options(capsys: Capture) -> None:
    assert app.run(["render", "--json", "bell.yaml", "-o", "-"]) == 2
    assert app.run(["render", "bell.yaml", "--channels", "65"]) == 2
    assert app.run(["render", "bell.yaml", "--watch", "-o", "-"]) == 2


def test_diverging_render_exits_4_without_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    from ergon import _core
    from ergon.rendering import render as rendering

    def diverge(*arguments: object) -> np.ndarray:
        error = _core.DivergedError("'bell.m' is not finite at 0.5 s")
        error.frame, error.module = 22_050, "bell.m"
        raise error

    monkeypatch.setattr(rendering, "_folded_mix", diverge)
    assert app.run(["render", "bell.yaml"]) == 4
    assert "bell.m" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["bell.yaml"]


def test_ctrl_c_exits_130_without_a_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ergon.rendering import render as rendering

    def interrupt(*arguments: object) -> np.ndarray:
        raise KeyboardInterrupt

    monkeypatch.setattr(rendering, "_folded_mix", interrupt)
    assert app.run(["render", "bell.yaml"]) == 130
    assert [path.name for path in folder.iterdir()] == ["bell.yaml"]


def test_silent_render_exits_1_with_strict(folder: Path, capsys: Capture) -> None:
    score = Path("still.yaml")
    text = "ergon: 1\ninstruments: {bell: {modules: {m: {CEL: {M: 2g, f: A4}}}, out: {SOX: m}}}\n"
    score.write_text(text + "render: {tail: 100ms}\n", encoding="utf-8")
    assert app.run(["render", "still.yaml"]) == 0
    output = capsys.readouterr().err
    assert "still.yaml:1:1: warning[W324] the file is silent" in output
    assert app.run(["render", "still.yaml", "--strict"]) == 1
    assert Path("still.wav").exists()
    assert app.run(["render", "bell.yaml", "--strict"]) == 0


def test_render_of_more_outputs_than_channels_is_refused(capsys: Capture) -> None:
    """Without a mix every output has a channel of its own."""
    out = ", ".join(f"o{number}: {{SOX: m}}" for number in range(65))
    text = f"{{modules: {{m: {{CEL: {{M: 2g, f: A4, X0: 1mm}}}}}}, out: {{{out}}}}}"
    Path("many.yaml").write_text(
        f"ergon: 1\ninstruments: {{bell: {text}}}\nrender: {{tail: 1ms}}\n"
    )
    assert app.run(["render", "many.yaml"]) == 2
    assert "a sound file has at most 64 channels, not 65" in capsys.readouterr().err
    assert not Path("many.wav").exists()


def test_render_of_a_part_behind_the_end_is_refused(capsys: Capture) -> None:
    text = Path("bell.yaml").read_text(encoding="utf-8")
    Path("bell.yaml").write_text(re.sub("tail: [^,}]*", "tail: auto", text), encoding="utf-8")
    assert app.run(["render", "bell.yaml", "--from", "59s", "-o", "part.wav"]) == 2
    assert "the part to render begins at 59 s, and the sound ends at" in capsys.readouterr().err
    assert not Path("part.wav").exists()


def test_render_with_all_samples_rounded_to_zero_warns(folder: Path, capsys: Capture) -> None:
    score = "ergon: 1\ninstruments: {m: {CEL: {M: 1g, f: A4, t60: 1s}, out: {SOX: m}}}\n"
    score += "strikes: {s: {to: m, at: 0, impulse: IMPULSE}}\nrender: {tail: 100ms, bits: BITS}\n"
    for impulse, bits, code, message in (
        ("0.0001uNs", 24, 1, "W324"),  # -149 dBFS
        ("0.001uNs", 24, 0, "W325"),  # -129 dBFS
        ("0.001uNs", 16, 1, "W324"),
        ("0.0001uNs", "float", 0, "W325"),
    ):
        text = score.replace("IMPULSE", impulse).replace("BITS", str(bits))
        Path("soft.yaml").write_text(text + "mix: {master: {reference: -20dB}}\n")
        assert app.run(["render", "soft.yaml", "--strict", "--force"]) == code
        assert f"warning[{message}]" in capsys.readouterr().err


def test_render_summary_level_of_each_instrument(folder: Path, capsys: Capture) -> None:
    part = "{{modules: {{m: {{CEL: {{M: 2g, f: {f}, t60: 2s, X0: {x}}}}}}}, out: {{SOX: m}}}}"
    low, high = part.format(f="A3", x="1mm"), part.format(f="A4", x="0.1mm")
    text = f"ergon: 1\ninstruments: {{low: {low}, high: {high}}}\nrender: {{tail: 1s}}\n"
    Path("two.yaml").write_text(text, encoding="utf-8")
    assert app.run(["render", "two.yaml"]) == 0
    output = capsys.readouterr().err.splitlines()
    peaks = [float(line.split("peak ")[1].split(" dB")[0]) for line in output[1:]]
    assert [line.split(":")[0] for line in output[1:]] == ["low", "high"]
    assert peaks == pytest.approx([0.0, -20.0], abs=0.11)
    assert all(line.endswith(" LUFS") for line in output[1:])
    assert app.run(["render", "--json", "two.yaml"]) == 0
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    named = [record["name"] for record in records if record["event"] == "instrument"]
    assert named == ["low", "high"]


STRUCK_HARD = """\
ergon: 1
title: Struck hard
instruments:
  gong:
    modules: {p: {PLATE: {shape: hex, radius: 4, M: 100g, f: 120Hz, t60: 1s, hardening: 1e11}}}
    out: {SOX: p.centre}
strikes:
  a: {to: [gong.p.centre], at: 0.05s, impulse: 0.5Ns}
accuracy: {method: ca}
render: {tail: 0.3s, bits: float}
"""


def test_render_reports_frames_computed_finer(folder: Path, capsys: Capture) -> None:
    (folder / "hard.yaml").write_text(STRUCK_HARD)
    (folder / "soft.yaml").write_text(STRUCK_HARD.replace("0.5Ns", "0.01Ns"))
    assert app.run(["render", "hard.yaml"]) == 0
    last = capsys.readouterr().err.splitlines()[-1]
    text = r"gong: (\d+) frames were computed finer, up to ([248]) times: .*"
    result = re.fullmatch(text, last)
    assert result is not None, last
    assert app.run(["render", "--json", "--force", "hard.yaml"]) == 0
    (record,) = [r for r in records(capsys) if r["event"] == "finer"]
    output = (record["frames"], record["most"])
    assert (record["part"], *output) == ("gong", *map(int, result.groups()))
    assert app.run(["render", "soft.yaml"]) == 0
    assert "finer" not in capsys.readouterr().err


def test_render_reports_masking_instrument(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (
        "ergon: 1\ninstruments:\n"
        "  loud: {modules: {m: {CEL: {M: 1g, f: 440Hz, t60: 2s}}}, out: {SOX: m}}\n"
        "  soft: {modules: {m: {CEL: {M: 1g, f: 550Hz, t60: 2s}}}, out: {SOX: m}}\n"
        "strikes:\n"
        "  a: {to: [loud.m], at: 0s, impulse: 1mNs}\n"
        "  b: {to: [soft.m], at: 0s, impulse: %s}\n"
        "mix: {channels: 1, route: [{from: loud, to: 1}, {from: soft, to: 1}]}\n"
        "render: {tail: 1s}\n"
    )
    for impulse, is_told in (("0.05mNs", True), ("0.5mNs", False)):
        Path("a.yaml").write_text(text % impulse)
        assert app.run(["render", "a.yaml", "-f"]) == 0
        output = "loud is 28 dB louder than every other instrument" in capsys.readouterr().err
        assert output == is_told
