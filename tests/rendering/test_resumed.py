"""Renders that recall what earlier ones computed: the samples of a render from scratch."""

import hashlib
import signal
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import random_scores
from patience import PATIENCE
from sweep import few

import ergon
from ergon.api.options import RenderOptions
from ergon.exchange.stretch_store import Stretch, StretchStore
from ergon.rendering import resumed, stretches

# Every kind of body, method, contact and hand; a later event can be put in without moving another.
SCENES = {
    "modes": ("", "wire.s.3", "STRING: {masses: 24, M: 4g, f: D4, t60: 2s}", "s.17", "s.5"),
    "hardening": (
        "",
        "wire.p.0",
        "PLATE: {shape: hex, radius: 2, M: 50g, f: 900Hz, t60: 1s, hardening: 1e10N/m3}",
        "p.centre",
        "p.1",
    ),
    **{
        method: (
            f"{{method: {method}}}",
            "wire.p.0",
            "PLATE: {shape: hex, radius: 2, M: 50g, f: 900Hz, t60: 1s, hardening: 1e8N/m3}",
            "p.centre",
            "p.1",
        )
        for method in ("ca", "ca2p", "bm4", "ieq")
    },
    "exact": ("{error: -60dB}", "wire.m", "CEL: {M: 2g, f: 440Hz, t60: 0.5s}", "m", "m"),
}
SCORE = """\
ergon: 1
accuracy: {accuracy}
keys: {{k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
instruments:
  wire:
    modules:
      {name}: {{{body}}}
      b: {{BUT: {{between: [k1, {port}], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}}}
      h: {{MAS: {{M: 1g}}}}
      n: {{LNL: {{between: [h, {port}], law: "k*d + q*d**3", k: 200N/m, q: 4e7N/m3}}}}
    out: {{x: {{SOX: {heard}}}, v: {{SOV: {port}}}}}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
  toss: 0mm@0 throw 5mm@1/8 smooth 0mm@1/4
  shake: 0mm@0 smooth 0.3mm@1/16 smooth 0mm@1/8
players: {{ada: {{key: k1}}}}
parts:
  ada:
    - {{at: 1|1, play: knock, every: 1, times: 3}}
    - {{at: 1|2.5, play: shake, layer: true}}
    - {{at: 1|4, play: toss, ergons: particle}}
    - {{at: 2|1, play: {last}}}
strikes:
  a: {{to: [{struck}], at: 0.1s, impulse: 1mNs}}
  c: {{to: [{struck}], at: {late}s, impulse: 3mNs}}
render: {{tail: 0.3s, bits: float}}
"""


def text(scene: str, last: str = "knock", late: float = 3.9) -> str:
    accuracy, struck, body, listened, port = SCENES[scene]
    return SCORE.format(
        accuracy=accuracy or "{error: -50dB}",
        name=struck.split(".")[1],
        body=body,
        port=port,
        heard=listened,
        struck=struck,
        last=last,
        late=late,
    )


class Counted:
    """The counts of each render, by its simulation."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.all: list[resumed.ResumedSimulation] = []
        plain = resumed.ResumedSimulation.__init__

        def init(own: resumed.ResumedSimulation, *of: object) -> None:
            plain(own, *of)  # type: ignore[arg-type]
            self.all.append(own)

        monkeypatch.setattr(resumed.ResumedSimulation, "__init__", init)

    @property
    def recalled(self) -> list[int]:
        return [own.n_recalled for own in self.all]


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Counted:
    """Stretches of 4,096 frames, of islands of any cost, in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", 4096)
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(stretches, "_NS_PER_SAMPLE", 0.0)
    return Counted(monkeypatch)


def sound(score: str, monkeypatch: pytest.MonkeyPatch, *, saved: bool, **options: object) -> str:
    Path("a.yaml").write_text(score)
    monkeypatch.setenv("ERGON_CACHE", "on" if saved else "plans")
    frames = ergon.render("a.yaml", RenderOptions(**options)).frames  # type: ignore[arg-type]
    return hashlib.sha256(frames.tobytes()).hexdigest()


@cache
def scratch_of_hardening() -> str:
    """The sound that two tests recall: from scratch, and without what is stored."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("XDG_CACHE_HOME", folder)
        return sound(text("hardening"), patch, saved=False)


@pytest.mark.parametrize("scene", few(SCENES, ("ca2p",)))
def test_edited_score_recalls_unchanged_stretches(
    scene: str, counted: Counted, monkeypatch: pytest.MonkeyPatch
):
    versions = [text(scene), text(scene, last="toss"), text(scene, late=4.1)]
    scratch = [sound(version, monkeypatch, saved=False) for version in versions]
    assert len(set(scratch)) == 3, "the edits are heard"
    plain, *edits = versions
    saved = [sound(version, monkeypatch, saved=True) for version in (plain, plain, *edits)]
    assert saved == [scratch[0], *scratch]
    first, again, *edited = counted.recalled
    assert first == 0
    assert again > 0
    # All frames of all islands before the edit, but for the stretch that it is in.
    assert all(0.5 * again < recalled < again for recalled in edited)


# A law and two contacts between frames; a cell and a stop glide away, the cell back.
BETWEEN = """\
ergon: 1
accuracy: {{error: -80dB}}
instruments:
  a:
    modules:
      s: {{SOL: {{X0: 0m}}}}
      m: {{CEL: {{M: 2g, f: 110Hz, t60: 3s, X0: 1mm}}}}
      c: {{BUT: {{between: [s, m], K: 5e4N/m, Z: 0.1Ns/m, gap: 0.1mm}}}}
      n: {{CEL: {{M: 1g, f: 300Hz, t60: 3s}}}}
      l: {{LNL: {{between: [m, n], law: "k*d + q*d**3", k: 20N/m, q: 4e7N/m3}}}}
      b: {{BUT: {{between: [s, n], K: 9e3N/m, gap: 0.2mm}}}}
    out: {{x: {{SOX: n}}, c: {{SOF: {{BUT: c}}}}}}
automation:
  - {{set: a.m.f, to: x4, at: 0.2s, over: 0.2s}}
  - {{set: a.m.f, to: x1, at: 0.5s, over: 0.2s}}
  - {{set: a.c.K, to: x8, at: 0.3s, over: 0.3s}}
strikes:
  a: {{to: [a.m], at: 0.1s, impulse: 1mNs}}
  c: {{to: [a.n], at: {late}s, impulse: 3mNs}}
render: {{tail: 0.3s, bits: float}}
"""


@pytest.mark.slow
def test_resumed_render_of_contacts_between_frames(
    counted: Counted, monkeypatch: pytest.MonkeyPatch
):
    versions = [BETWEEN.format(late=late) for late in (1.4, 1.4, 1.5)]
    scratch = [sound(version, monkeypatch, saved=False) for version in versions]
    assert scratch[0] != scratch[2]
    saved = [sound(version, monkeypatch, saved=True) for version in versions]
    assert saved == scratch
    first, again, edited = counted.recalled
    assert first == 0
    assert again > edited > 0.5 * again


@pytest.mark.slow
def test_gesture_definition_order_recalls_all(counted: Counted, monkeypatch: pytest.MonkeyPatch):
    two = """\
ergon: 1
accuracy: {error: -40dB}
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}}
instruments:
  a:
    modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 1s}}, b: {BUT: {between: [k1, m], K: 900N/m}}}
    out: {SOX: m}
  b:
    modules: {m: {CEL: {M: 2g, f: 550Hz, t60: 1s}}, b: {BUT: {between: [k2, m], K: 900N/m}}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
  lean: 0mm@0 smooth 4mm@1/4 3mm@3/8 smooth 0mm@3/4
players: {ada: {key: k1}, remi: {key: k2}}
parts: {ada: [{at: 1|1, play: %s}], remi: [{at: 1|1.5, play: knock}]}
render: {tail: 0.5s, bits: float}
"""
    sound(two % "knock", monkeypatch, saved=True)
    scratch = sound(two % "lean", monkeypatch, saved=False)
    assert sound(two % "lean", monkeypatch, saved=True) == scratch
    sound(two % "lean", monkeypatch, saved=True)
    _, edited, again = counted.recalled
    assert edited == again / 2  # all of what remi plays


def test_recall_same_with_threads_and_blocks(counted: Counted, monkeypatch: pytest.MonkeyPatch):
    score, scratch = text("hardening"), scratch_of_hardening()
    for options in ({"threads": 2}, {"block": 1000}, {"block": 10_000, "threads": 3}):
        assert sound(score, monkeypatch, saved=True, **options) == scratch
    assert counted.recalled[-2] == counted.recalled[-1] > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", few(range(60), range(2)))
def test_random_scores_recalled_equal_fresh_render(
    seed: int, counted: Counted, monkeypatch: pytest.MonkeyPatch
):
    score = random_scores.score(seed)
    try:
        scratch = sound(score, monkeypatch, saved=False)
    except ergon.ErgonError:
        pytest.skip("this score is refused")
    assert sound(score, monkeypatch, saved=True) == scratch
    assert sound(score, monkeypatch, saved=True) == scratch


KILLED = """\
import os, signal, sys
import ergon
from ergon.exchange.stretch_store import StretchStore
from ergon.rendering import resumed, stretches

stretches.STRETCH_FRAMES, resumed._WORK_SECONDS_MIN, stretches._NS_PER_SAMPLE = 4096, 0.0, 0.0
left, put = int(sys.argv[1]), StretchStore.put

def counted(*of):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return put(*of)

StretchStore.put = counted
ergon.render_to_file("a.yaml", "a.wav")
"""


@pytest.mark.parametrize("puts", few(range(1, 40), (30,)))
def test_killed_render_resumes_from_stored_stretches(
    counted: Counted, monkeypatch: pytest.MonkeyPatch, puts: int
):
    score, scratch = text("hardening"), scratch_of_hardening()
    Path("a.yaml").write_text(score)
    monkeypatch.setenv("ERGON_CACHE", "on")
    done = subprocess.run([sys.executable, "-c", KILLED, str(puts)], timeout=PATIENCE)
    assert done.returncode == -signal.SIGKILL
    assert not Path("a.wav").exists()
    assert sound(score, monkeypatch, saved=True) == scratch
    assert (counted.recalled[-1] > 0) == (puts > 1)


def test_damaged_stretch_files_ignored(tmp_path: Path):
    store = StretchStore(tmp_path)
    key = "0" * 64
    stretch = Stretch(np.arange(5.0), b"state")
    assert store.get(key) is None
    assert store.put(key, stretch.sound, stretch.state)
    known = store.get(key)
    assert known is not None
    assert known.state == b"state"
    assert known.sound.tolist() == stretch.sound.tolist()
    (path,) = tmp_path.iterdir()
    complete = path.read_bytes()
    for index in range(len(complete)):
        path.write_bytes(complete[:index])
        assert store.get(key) is None
        path.write_bytes(complete[:index] + bytes([complete[index] ^ 1]) + complete[index + 1 :])
        assert store.get(key) is None


@pytest.mark.slow
def test_unwritable_cache_folder_ignored(
    tmp_path: Path, counted: Counted, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "cache").write_text("a file where the folder would be")
    score = text("modes")
    assert sound(score, monkeypatch, saved=True) == sound(score, monkeypatch, saved=False)
    assert counted.recalled == [0]


def test_stretch_store_evicts_least_recently_used(tmp_path: Path):
    store = StretchStore(tmp_path, n_bytes_max=1000)
    for index in range(10):
        store.put(f"{index:064}", np.zeros(20), b"")
    store.remove_oldest()
    saved = [index for index in range(10) if store.get(f"{index:064}") is not None]
    assert 1 <= len(saved) <= 5
