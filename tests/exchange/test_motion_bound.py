"""Motion files beside the simulation: each point is within the bound that the file states."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from checked import check
from motion_reader import Replica
from numpy.typing import NDArray

from ergon import _core
from ergon.api import film
from ergon.cli import app
from ergon.scores.staging.stage import stage

Floats = NDArray[np.float64]
SHARE, REST = 5e-3, 1e-6  # of a point's own amplitude, and at rest [m]
STONE = """\
ergon: 1
instruments:
  a:
    space: 3
    gravity: 9.81m/s2
    modules:
      nail: {SOL: {X0: [0, 0, 0]}}
      bob: {MAS: {M: 20g, X0: [30cm, 0, 0]}}
      rod: {RES: {between: [nail, bob], K: 3kN/m}}
      stone: {MAS: {M: 70g, X0: [1m, 0, 0]}}
    out: {x: {SOX: bob.x}, z: {SOX: bob.z}, s: {SOX: stone.z}}
mix: {channels: 3, route: [{from: a.x, to: 1}, {from: a.z, to: 2}, {from: a.s, to: 3}]}
render: {bits: float, tail: 10s}
"""
TEAR = """\
ergon: 1
instruments:
  cloth:
    space: 3
    gravity: 9.81m/s2
    modules:
      net: {CLOTH: {sides: [10, 8], M: 50g, at: [0, 0, 60cm], across: [34cm, 0, 0],
        up: [0, 0, 26cm], K: 500N/m, Z: 0.01Ns/m, shear: 80N/m, held: top, drag: 2mNs/m,
        breaks: 3mm}}
      stone: {MAS: {M: 70g, X0: [17cm, 22cm, 72cm], V0: [0, -3.5m/s, 0.5m/s]}}
      hit: {BUT: {between: [stone, net.all], K: 4kN/m, Z: 0.2Ns/m, gap: 25mm}}
    out: {threads: {SOV: [net.40.y, net.30.y]}}
render: {tail: 3s}
"""
STRING = """\
ergon: 1
accuracy: {method: ca}
instruments:
  s:
    modules:
      wire: {STRING: {masses: 16, f: 110Hz, t60: 0.2s, M: 10g, hardening: 1e6}}
    out: {SOX: wire.all}
strikes: {hit: {to: s.wire.3, at: 1.37s, impulse: 3mNs}}
render: {tail: 2s}
"""
FPS = 60.0
LIBRARY = Path(__file__).parents[2] / "scores" / "library"


def filmed(text: str, seconds: float, path: Path) -> tuple[Replica, Floats, Floats]:
    """A file written from a simulation, the instants of its frames, and where all points were
    then (n_frames, n_points) [m].
    """
    read = check(text)
    assert read.piece is not None, read.diagnostics
    prepared = stage(read.piece, planned=True, is_seen=True)
    simulation = prepared.simulation
    mats = _core.MotionLook(simulation).mats()
    recorder = film.recorder(prepared, simulation, seconds)
    truth, data = [], []
    while recorder.next <= seconds * prepared.rate:
        simulation.process(np.empty((recorder.next - simulation.frame, simulation.n_out)))
        truth.append(simulation.positions()[mats])
        recorder.look(simulation)
        data.append(recorder.take())
    path.write_bytes(b"".join([*data, recorder.finish()]))
    replica = Replica(path.read_bytes())
    return replica, np.arange(len(truth)) / FPS, np.array(truth) - replica.places[3]


def sampled(replica: Replica) -> list[int]:
    """The points whose positions are in frames."""
    parts = [part for part in replica.manifest["parts"] if part["kind"] == "sampled"]
    return [p for part in parts for p in range(part["first"], part["first"] + part["count"])]


def resting(truth: Floats) -> NDArray[np.bool_]:
    """Whether a point moves by no more than a micrometre in the second around a frame."""
    frames = range(len(truth))
    around = [truth[max(0, t - 30) : t + 31] for t in frames]
    return np.array([np.ptp(some, axis=0) <= REST for some in around])


def check_bound(replica: Replica, read: Floats, truth: Floats) -> None:
    """Both are (n_frames, n_points) [m] in the same frames."""
    # Where points rest is held in single precision.
    rounded = 2.0**-24 * np.abs(replica.places[3][sampled(replica)])
    wrong = np.maximum(0.0, np.abs(read - truth) - rounded)
    bound = replica.manifest["bound"]
    so_far = np.maximum.accumulate(truth, axis=0) - np.minimum.accumulate(truth, axis=0)
    # The second that a segment holds belongs to what the amplitude is so far.
    ahead = 0.5 * so_far[np.minimum(np.arange(len(truth)) + 60, len(truth) - 1)]
    stated = np.maximum(bound["amplitude"] * ahead, bound["least"])
    assert (wrong <= 1.0001 * stated + 1e-12 * np.abs(truth)).all()
    assert bound["amplitude"] <= SHARE
    is_resting = resting(truth)
    assert (wrong[is_resting] <= REST).all()
    assert is_resting.any()
    amplitude = 0.5 * np.ptp(truth, axis=0)
    assert (wrong <= SHARE * amplitude + bound["least"]).all()


def test_motion_of_pendulum_beside_falling_stone(work_folder: Path) -> None:
    """At 1,000 instants within and between frames, beside the sound, which is the position."""
    Path("stone.yaml").write_text(STONE)
    assert app.run(["render", "-q", "--motion", "stone.yaml", "-o", "stone.wav"]) == 0
    assert app.run(["motion", "export", "-q", "stone.motion", "-o", "stone.npz"]) == 0
    with np.load("stone.npz") as decoded:
        names, places, all_frames = (
            decoded["names"].tolist(),
            decoded["places"],
            decoded["displacement"],
        )
    sound, _ = soundfile.read("stone.wav")
    frames = np.sort(np.random.default_rng(1).integers(0, len(sound) - 1, 1000))
    file = _core.read_motion("stone.motion")
    seen = file.displacements((frames / 44_100).tolist())
    for channel, name in enumerate(("a.bob.x", "a.bob.z", "a.stone.z")):
        point = names.index(name)
        amplitude = 0.5 * float(np.ptp(sound[:, channel]))
        wrong = seen[:, point] + places[point, 3] - sound[frames, channel]
        assert np.abs(wrong).max() <= SHARE * amplitude, name
        # What is exported at the rate of the file is what its frames hold.
        there = sound[(np.arange(600) * 735), channel]
        wrong = all_frames[:600, point] + places[point, 3] - there
        assert np.abs(wrong).max() <= 3.1e-3 * amplitude, name


@pytest.mark.parametrize(("text", "seconds"), [(TEAR, 3.0), (STRING, 3.0)])
def test_motion_error_of_all_points(text: str, seconds: float, tmp_path: Path) -> None:
    replica, instants, truth = filmed(text, seconds, tmp_path / "a.motion")
    points = sampled(replica)
    assert len(points) > 10
    read = replica.displacements(instants)[:, points]
    check_bound(replica, read, truth[:, points])
    # The engine reads the same.
    engine = _core.read_motion(tmp_path / "a.motion").displacements(instants.tolist())[:, points]
    np.testing.assert_allclose(engine, read, rtol=1e-6, atol=1e-9)


def test_motion_of_resting_string(tmp_path: Path) -> None:
    replica, instants, truth = filmed(STRING, 3.0, tmp_path / "a.motion")
    points = sampled(replica)
    frames = np.sort(np.random.default_rng(2).uniform(0, 3.0 - 1 / FPS, 1000))
    read = _core.read_motion(tmp_path / "a.motion").displacements(frames.tolist())[:, points]
    assert np.abs(truth[:, points]).max() > 1e-4
    assert (read[frames < 1.37 - 1 / FPS] == 0.0).all()
    late = resting(truth[:, points]).all(axis=1)
    assert late[instants > 2.5].any()
    off = np.abs(replica.displacements(instants)[:, points] - truth[:, points])
    assert off[late].max() <= REST


# Bytes of the first 8 s of bundled pieces in format 1, which play what they played then.
SIZES = {"one-rope": 61_623}


@pytest.mark.parametrize("piece", SIZES)
def test_motion_size_beside_format_1(piece: str, work_folder: Path) -> None:
    score = str(LIBRARY / f"{piece}.yaml")
    assert app.run(["render", "-q", "--motion", "--until", "8s", "-o", "a.wav", score]) == 0
    assert Path("a.motion").stat().st_size <= 1.3 * SIZES[piece]


def test_info_states_the_bound_and_counts_points_in_space_once(
    work_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("stone.yaml").write_text(STONE)
    assert app.run(["render", "-q", "--motion", "--until", "1s", "stone.yaml", "-o", "a.wav"]) == 0
    capsys.readouterr()
    assert app.run(["info", "a.motion"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert ", 3 points, " in lines[0]
    assert (
        "bound:   sampled points are right within 0.3 % of their own amplitude, "
        "and at rest within 0.5 µm" in lines
    )
    assert lines[-1] == "  a: 3 points, sampled"
    assert app.run(["info", "--json", "a.motion"]) == 0
    record = json.loads(capsys.readouterr().out.splitlines()[0])
    assert (record["points"], record["coordinates"]) == (3, 9)
    assert record["bound"] == _core.motion_bound()


def test_motion_of_format_1_is_refused(
    work_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("old.motion").write_bytes(b"ERGM\x01\0\0\0")
    assert app.run(["info", "old.motion"]) == 2
    assert (
        "old.motion: this motion file has format 1, and this ergon reads formats 2 and 3: "
        "render the score again with --motion" in capsys.readouterr().err
    )
