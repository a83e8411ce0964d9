"""Parts that are computed before and read while the rest is played."""

import contextlib
import json
import re
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import soundfile
from sweep import crossed, few

from ergon import _core
from ergon.api import score as scores
from ergon.api.options import AccuracyOptions
from ergon.cli import app
from ergon.exchange import frozen as exchange
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging import stage as staging
from ergon.scores.staging.reach import freeze_obstacles
from tests.cli.test_cli_emulate import GESTURE, emulator

Capture = pytest.CaptureFixture[str]
SCORE = """\
ergon: 1
title: Gong and bell
keys:
  k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  g: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}
      b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
  gong:
    modules:
      wall: {SOL: {}}
      s: {STRING: {masses: 24, f: 110Hz, t60: 3s, M: 4g}}
      c: {CEL: {M: 3g, f: 331Hz, t60: 1s}}
      b: {BUT: {between: [g, s.centre], K: 900N/m, gap: 1mm}}
      t: {REF: {between: [s.3, c], K: 40N/m}}
      h: {REF: {between: [c, wall], K: 10N/m}}
    out: {left: {SOX: s.5}, right: {SOX: c}, felt: {SOF: t}}
  sky:
    modules: {cells: {BANK: {count: 40, M: 1g, f: 200Hz..4kHz, t60: 1s}}}
    out: {SOX: cells.all}
strikes:
  rain: {to: sky.cells.all, at: 1|1, for: 2, rate: 2Hz, impulse: 1e-6Ns..1e-4Ns}
gestures: {knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}
players:
  remi: {hand: live, key: k, standin: knock}
  ada: {key: g}
parts:
  ada: [{at: 1|1, play: knock, every: 1, times: 3}]
mix:
  channels: 3
  route:
    - {from: gong.left, to: [1], gain: -3dB}
    - {from: bell, to: [1, 2], highpass: 20Hz}
    - {from: gong.right, to: [2, 3]}
    - {from: sky, to: [3], gain: -20dB}
    - {from: gong.felt, to: [1], gain: -40dB}
render: {tail: 1s}
"""


def piece(old: str = "", new: str = "") -> Piece:
    assert old in SCORE
    loaded = load("s.yaml", text=SCORE.replace(old, new, 1) if old else SCORE)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


@pytest.fixture
def folder(work_folder: Path) -> Path:
    (work_folder / "s.yaml").write_text(SCORE)
    return work_folder


def frozen(parts: str = "gong", *more: str) -> dict:
    assert app.run(["render", "s.yaml", "--freeze", parts, "-q", *more]) == 0
    return json.loads(Path("s.frozen/frozen.json").read_text())


def played(name: str, *more: str) -> np.ndarray:
    asked = ["play", "s.yaml", "--audio", f"file:{name}", "--gain", "50dB", "--plain", "-q"]
    assert app.run([*asked, *more]) == 0
    return soundfile.read(name, dtype="float32", always_2d=True)[0]


BANKS = """\
ergon: 1
instruments:
  few: {BANK: {count: 40, f: 100Hz..2kHz, t60: 0.3s, M: 1g}, out: {SOX: few.all}}
  string: {STRING: {masses: 30, f: 110Hz, t60: 1s, M: 5g}, out: {SOX: string.4}}
  sky: {BANK: {count: 9000, f: 50Hz..9kHz, t60: 0.3s..2s, M: 1g}, out: {SOX: sky.all}}
  dust: {BANK: {count: 300, f: 2kHz..9kHz, t60: 0.1s, M: 1g}, out: {SOX: dust.all}}
strikes:
  a: {to: few.all, at: 1|1, impulse: 1uNs}
  b: {to: string.3, at: 1|1, impulse: 1mNs}
  c: {to: sky.all, at: 1|1, for: 200ms, rate: 20Hz, impulse: 1uNs..9uNs}
  d: {to: dust.all, at: 1|1, for: 200ms, rate: 20Hz, impulse: 1uNs..9uNs}
"""


@pytest.mark.parametrize(("alone", "threads"), crossed(["sky", "dust"], [1, 2]))
def test_large_bank_sounds_same_alone(alone: str, threads: int) -> None:
    loaded = load("s.yaml", text=BANKS)
    assert loaded.piece is not None, loaded.diagnostics
    sounds = []
    for silent in ([], sorted({"few", "string", "sky", "dust"} - {alone})):
        options = AccuracyOptions()
        stage = scores.stage_piece(loaded, options, threads=threads, silent=silent).stage
        frames = np.zeros((13_000, stage.simulation.n_out))
        stage.simulation.process(frames)
        sounds.append(frames[:, stage.listening.taps(alone)])
    complete, part = sounds
    assert np.abs(complete).max() > 0.0
    np.testing.assert_array_equal(complete, part)


# --- equality -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parts", "start"),
    few(product(["gong,sky", "gong", "bell-less"], [(), ("--from", "1|2.3")]), 1),
)
def test_frozen_and_live_parts_equal_full_play(folder: Path, start: tuple[str, ...], parts: str):
    """Bit for bit: high-passes and sums go over all parts at once, in their own order."""
    if parts == "bell-less":  # everything that is heard is frozen
        text = SCORE.replace("    - {from: bell, to: [1, 2], highpass: 20Hz}\n", "")
        Path("s.yaml").write_text(text)
        parts = "sky,gong"
    complete = played("whole.wav", *start)
    frozen(parts)
    again = played("again.wav", "--frozen", "s.frozen", *start)
    assert 0.05 < np.max(np.abs(complete)) <= 1.0
    assert all(np.any(complete[:, channel]) for channel in range(3))
    assert np.array_equal(complete, again)


def test_cells_of_two_parts_go_silent_separately(folder: Path):
    """Isolated cells share a bank, which says what is too faint to be heard."""
    text = SCORE.replace("      t: {REF: {between: [s.3, c], K: 40N/m}}\n", "")
    text = text.replace("      h: {REF: {between: [c, wall], K: 10N/m}}\n", "")
    text = text.replace(", felt: {SOF: t}", "").replace(
        "    - {from: gong.felt, to: [1], gain: -40dB}\n", ""
    )
    text = text.replace("strikes:\n", "strikes:\n  one: {to: gong.c, at: 1|1, impulse: 1e-4Ns}\n")
    Path("s.yaml").write_text(text)
    complete = played("whole.wav")
    frozen("sky")
    again = played("again.wav", "--frozen", "s.frozen")
    assert np.max(np.abs(complete)) > 0.05
    assert np.max(np.abs(complete - again)) <= 2.0**-24


def test_frozen_stem_equals_part_outputs(folder: Path):
    text = frozen("gong")
    (stem,) = text["stems"]
    result, rate = soundfile.read(f"s.frozen/{stem['file']}", dtype="float64")
    complete = staging.stage(piece(), planned=True)
    frames = np.zeros((complete.n_frames, complete.simulation.n_out))
    complete.simulation.process(frames)
    assert (rate, stem["outputs"]) == (44100, [0, 2, 4])
    assert np.array_equal(result[: complete.n_frames], frames[:, stem["outputs"]])
    # A real hand's stand-in ends with a tick: the piece is that much longer.
    real = staging.stage(piece("times: 3}", "times: 1}"), real_hands={"remi": None})
    virtual = staging.stage(piece("times: 3}", "times: 1}"))
    assert 0 <= real.n_frames - virtual.n_frames < len(result) - complete.n_frames
    assert text["score"] == digest_of(piece())


def test_frozen_parts_not_computed():
    rest = staging.stage(piece(), planned=True, silent=["gong", "sky"])
    assert rest.plan is not None
    rows = rest.plan.rows()
    assert {part for row in rows if row.what != "unheard" for part in row.parts} == {"k", "bell"}
    # The key g, a string of 24 and a cell; forty cells.
    assert [row.n_mat for row in rows if row.what == "unheard"] == [26, 40]
    assert rest.simulation.n_out == staging.stage(piece(), planned=True).simulation.n_out


def test_frozen_bytes_with_any_threads(folder: Path):
    frozen("gong,sky", "--threads", "1")
    before = {path.name: path.read_bytes() for path in Path("s.frozen").iterdir()}
    frozen("gong,sky", "--threads", "2")
    assert before == {path.name: path.read_bytes() for path in Path("s.frozen").iterdir()}
    assert sorted(before) == ["01_gong.wav", "02_sky.wav", "frozen.json"]


def test_preflight_gain_includes_frozen_parts(folder: Path, capsys: Capture):
    text = SCORE.replace("mix:\n", "mix:\n  master: {normalise: -1dB}\n")
    Path("s.yaml").write_text(text, encoding="utf-8")
    frozen("gong,sky")
    gains = []
    for more in ([], ["--frozen", "s.frozen"]):
        name = f"{len(more)}.wav"
        assert app.run(["play", "s.yaml", "--audio", f"file:{name}", "--plain", *more]) == 0
        gains += re.findall(r"gain ([+-][0-9.]+ dB)", capsys.readouterr().err)
    assert len(gains) == 2
    assert gains[0] == gains[1]


# --- what can be felt -----------------------------------------------------------------------------


def test_ties_of_parts_without_live_links_empty():
    assert freeze_obstacles(piece(), ["gong"], ["remi"]) == []
    assert freeze_obstacles(piece(), ["gong", "sky"], ["remi"]) == []
    # A fixed point ends an island.
    wall = "      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}"
    walled = piece(wall, f"{wall}\n      w: {{REF: {{between: [m, gong.wall], K: 9N/m}}}}")
    assert freeze_obstacles(walled, ["gong"], ["remi"]) == []


@pytest.mark.parametrize(
    ("part", "old", "new", "links"),
    [
        ("bell", "", "", ["bell.b"]),
        # By way of the bell.
        (
            "gong",
            "    out: {left",
            "      x: {REF: {between: [c, bell.m], K: 5N/m}}\n    out: {left",
            ["gong.x", "bell.b"],
        ),
        # The key that plays it feels the live key.
        (
            "gong",
            "parts:\n",
            "duet:\n  - {couple: [k, g], REF: {K: 30N/m}, at: 1|2, until: 1|3}\nparts:\n",
            ["gong.b", "the coupling of k and g"],
        ),
    ],
)
def test_freeze_of_part_linked_to_hand_is_refused(part: str, old: str, new: str, links: list[str]):
    result = piece(old, new)
    (tie,) = freeze_obstacles(result, [part], ["remi"])
    assert (tie.player, tie.key) == ("remi", "k")
    assert [link.name for link in tie.links] == links
    text = (SCORE.replace(old, new, 1) if old else SCORE).splitlines()
    lines = [text[link.place.line - 1] for link in tie.links]
    assert all("between" in line or "couple" in line for line in lines)
    assert f"cannot be frozen: remi can feel it through {tie.links[0].name} (s.yaml:" in str(tie)


def test_freeze_of_one_linked_part_is_refused():
    tied = piece(
        "    out: {left", "      x: {REF: {between: [c, sky.cells.7], K: 5N/m}}\n    out: {left"
    )
    (tie,) = freeze_obstacles(tied, ["gong"], ["remi"])
    assert re.fullmatch(
        r"gong cannot be frozen without sky: gong\.x \(s\.yaml:\d+:\d+\) connects them", str(tie)
    )
    assert freeze_obstacles(tied, ["sky", "gong"], ["remi"]) == []


def test_freeze_of_output_on_live_module_is_refused():
    """The bell is live, so what also hears it cannot be frozen."""
    listened = piece("right: {SOX: c}", "right: {SOX: bell.m}")
    (tie,) = freeze_obstacles(listened, ["gong"], ["remi"])
    assert [link.name for link in tie.links] == ["bell.b"]
    (tie,) = freeze_obstacles(listened, ["gong"], [])
    assert str(tie) == "gong cannot be frozen without bell: both listen to one module"


def test_freeze_of_an_instrument_with_notes(folder: Path, capsys: Capture):
    Path("n.yaml").write_text(
        "ergon: 1\ninstruments: {vib: {from: bars/vibraphone, notes: C4..D4}}\n"
        "strikes: {a: {to: vib, notes: C4 D4, at: 1|1, every: 1/2, times: 2}}\n"
        "render: {tail: 0.2s}\n"
    )
    assert app.run(["render", "n.yaml", "--freeze", "vib", "-q", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parts"] == ["vib.C4", "vib.C#4", "vib.D4"]
    assert app.run(["play", "n.yaml", "--frozen", "n.frozen", "--audio", "null", "-q"]) == 0
    assert app.run(["render", "n.yaml", "--freeze", "xylo", "-q"]) == 2
    assert "no instrument 'xylo'; there are vib" in capsys.readouterr().err


def test_freeze_and_frozen_options_refusals(folder: Path, capsys: Capture):
    def refused(*asked: str) -> str:
        assert app.run(list(asked)) == 2
        return capsys.readouterr().err

    text = refused("render", "s.yaml", "--freeze", "bell,gong")
    assert "remi can feel it through bell.b (s.yaml:10:7)" in text
    assert not Path("s.frozen").exists()
    assert "did you mean 'gong'" in refused("render", "s.yaml", "--freeze", "gnog")
    assert "--stems" in refused("render", "s.yaml", "--freeze", "gong", "--stems", "x")
    frozen("gong")
    # Whose hand is real is said when it is played.
    text = refused(
        "duet", "s.yaml", "--frozen", "s.frozen", "--live", "ada=frame+udp://127.0.0.1:9"
    )
    assert "ada can feel it through gong.b" in text


# --- another piece, another file ------------------------------------------------------------------


@pytest.mark.slow
def test_frozen_of_other_seed_rate_or_score_refused(folder: Path, capsys: Capture):
    def refused(*more: str) -> str:
        asked = ["play", "s.yaml", "--audio", "null", "--frozen", "s.frozen", "-q", *more]
        assert app.run(asked) == 2
        return capsys.readouterr().err

    assert "ergon render --freeze writes it" in refused()
    frozen("gong", "--seed", "3")
    assert "the parts were frozen with seed 3, and this performance has seed 0" in refused()
    frozen("gong", "--rate", "48000")
    assert "the parts were frozen at 48000 Hz, and the score has 44100 Hz" in refused()
    frozen("gong")
    stem = Path("s.frozen/01_gong.wav")
    data = bytearray(stem.read_bytes())
    data[-3] ^= 1
    stem.write_bytes(data)
    assert "its samples differ; `ergon render SCORE --freeze gong" in refused()
    stem.write_bytes(data[:-80])
    assert "is not the file that was frozen" in refused()
    stem.unlink()
    assert "01_gong.wav" in refused()
    Path("s.yaml").write_text(SCORE.replace("6mm@1/8", "5mm@1/8"))
    assert "the score has changed since" in refused()


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What stands in the manifest of the frozen gong."""
    with contextlib.chdir(tmp_path_factory.mktemp("gong")):
        Path("s.yaml").write_text(SCORE)
        return frozen("gong")


@pytest.mark.parametrize(
    "change",
    [
        {"ergon_frozen": 2},
        {"stems": 3},
        {"stems": [{"part": "gong", "file": "../s.yaml", "outputs": [0], "sha256": ""}]},
        {"stems": [{"part": "gong", "file": "a.wav", "outputs": ["x"], "sha256": ""}]},
        {"frames": None},
        {"rate": "NaN?"},
    ],
)
def test_frozen_manifests_with_hostile_values(folder: Path, manifest: dict, change: dict):
    Path("s.frozen").mkdir()
    Path("s.frozen/frozen.json").write_text(json.dumps(manifest))
    exchange.read(Path("s.frozen"))
    Path("s.frozen/frozen.json").write_text(json.dumps(manifest | change))
    with pytest.raises(exchange.NotFrozenError):
        exchange.read(Path("s.frozen"))


def test_freeze_refuses_to_overwrite_foreign_files(folder: Path, capsys: Capture):
    Path("s.frozen").mkdir()
    Path("s.frozen/01_gong.wav").write_text("mine")
    assert app.run(["render", "s.yaml", "--freeze", "gong", "-q"]) == 2
    assert Path("s.frozen/01_gong.wav").read_text() == "mine"
    assert not Path("s.frozen/frozen.json").exists()
    assert "-f overwrites it" in capsys.readouterr().err


def test_frozen_stems_with_unknown_outputs_refused(folder: Path):
    complete = staging.stage(piece(), planned=True)
    for outputs in ([], [complete.simulation.n_out]):
        with pytest.raises(_core.EngineError, match="names no output"):
            _core.Performance(
                complete.simulation,
                complete.mixer(),
                audio="null",
                frozen=[(Path("x"), 0, 9, outputs)],
            )
    with pytest.raises(_core.EngineError, match="nowhere"):
        _core.Performance(
            complete.simulation,
            complete.mixer(),
            audio="null",
            frozen=[(Path("nowhere"), 0, 9, [0])],
        )


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
def test_lockstep_duet_same_beside_frozen_parts(folder: Path):
    """A hand in another process, in lockstep: what it did, felt and heard, to the bit."""
    frozen("gong,sky")
    listened, forces = [], []
    for name, more in (("whole", ()), ("again", ("--frozen", "s.frozen"))):
        with emulator("firefader", "--lockstep", *GESTURE) as device:
            asked = ["duet", "s.yaml", "--live", f"remi={device.url}", "--record", f"{name}.take"]
            audio = ["--audio", f"file:{name}.wav", "--gain", "50dB", "-q"]
            assert app.run([*asked, *audio, *more]) == 0
        listened.append(soundfile.read(f"{name}.wav", dtype="float32")[0])
        forces.append(_core.read_recording(f"{name}.take").forces())
    assert np.max(np.abs(listened[0])) > 0.05
    assert np.min(forces[0]) < -0.1
    assert np.array_equal(*listened)
    assert np.array_equal(*forces)


def test_freeze_dry_run_states_auto_tail_length(folder: Path, capsys: Capture) -> None:
    (folder / "s.yaml").write_text(SCORE.replace("tail: 1s", "tail: auto"))
    assert app.run(["render", "s.yaml", "--freeze", "gong", "-n"]) == 0
    reply = capsys.readouterr()
    after = re.search(r"of this, (.+?) come after the last event", reply.out + reply.err)
    assert after is not None
    assert after[1] == "61 s"
    assert "`render: {tail: 10s}`" in reply.out + reply.err
    (folder / "s.yaml").write_text(SCORE)
    assert app.run(["render", "s.yaml", "--freeze", "gong", "-n"]) == 0
    reply = capsys.readouterr()
    assert "after the last event" not in reply.out + reply.err
