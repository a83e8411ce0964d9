"""What safety stages do to a duet: nothing for a minute of playing; what a board asks for."""

from pathlib import Path

import numpy as np
import pytest
from duets import played, recorded
from simulated_board import simulated

RISEN = 2.1  # [s] after which the rise at the start is over
TICK = 44 / 44100
BUNDLED = Path(__file__).parents[2] / "scores" / "library" / "duet.yaml"
# Two keys on a spring; a written hand knocks on one of them, and both strike bells.
PAIR = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 50g, K: 60N/m, Z: 1Ns/m}, k2: {like: k1}}
instruments:
  bells:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}
      n: {CEL: {M: 2g, f: 331Hz, t60: 1s}}
      b: {BUT: {between: [k1, m], K: 300N/m, gap: 1mm}}
      c: {BUT: {between: [k2, n], K: 300N/m, gap: 1mm}}
    out: {SOX: [m, n]}
gestures: {knock: 0mm@0 smooth 8mm@1/4 0mm@1/2}
players: {ada: {key: k1}, remi: {hand: live, key: k2}}
duet: [{couple: [k1, k2], REF: {K: 120N/m, Z: 0.1Ns/m}}]
parts: {ada: [{at: 1|1, play: knock, every: 1/2, times: 240}]}
"""
# A hand 30 mm away leans on a spring.
LEANING = """\
ergon: 1
keys: {k1: {M: 50g, K: 600N/m, Z: 1Ns/m}, k2: {like: k1}}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
players: {ada: {key: k1}, remi: {hand: live, key: k2}}
duet: [{couple: [k1, k2], REF: {K: 200N/m, Z: 0.1Ns/m}}]
render: {tail: 3s}
"""


def leant(folder: Path, **board: float | bool) -> tuple[np.ndarray, np.ndarray]:
    """Forces of the scene, and those that a board was asked for [N]."""
    folder.mkdir()
    path, take = folder / "score.yaml", folder / "hand.take"
    path.write_text(LEANING)
    with simulated(folder / "log.npy", lockstep=True, hand=0.03, **board) as device:
        live = ("--live", f"remi={device.url}?lockstep&wide", "--record", take)
        played(path, *live, "--audio", "null:fast", "--gain", "0dB")
        asked = device.log()["asked"]
    forces = recorded(take).forces()[:, 0]
    return forces[: len(forces) - 1], asked[: len(forces) - 1]


def test_hot_board_receives_its_continuous_force(tmp_path: Path):
    forces, asked = leant(tmp_path / "cool", continuous=1.0)
    assert forces.min() < -2
    assert asked.min() < -2
    forces, asked = leant(tmp_path / "hot", continuous=1.0, hot=True)
    assert forces.min() < -2
    assert asked.min() == -1


def test_released_board_receives_no_force(tmp_path: Path):
    forces, asked = leant(tmp_path / "lets-go", lets_go=True)
    assert forces.min() < -2
    # Every reply begins the quarter of a second anew.
    assert np.abs(asked).max() < 0.005 * np.abs(forces).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("score", "hand"),
    [
        pytest.param(BUNDLED.read_text(), {"sine": 0.006, "hertz": 1.5}, id="duet"),
        pytest.param(PAIR, {"sine": 0.006, "hertz": 3.0}, id="pair"),
    ],
)
def test_safety_stages_pass_played_forces_unchanged(
    tmp_path: Path, score: str, hand: dict[str, float]
):
    path, take = tmp_path / "score.yaml", tmp_path / "hand.take"
    for folder in ("calib", "layouts", "takes"):
        (tmp_path / folder).symlink_to(BUNDLED.parent / folder)
    path.write_text(score)
    with simulated(tmp_path / "log.npy", lockstep=True, **hand) as board:
        live = ("--live", f"remi={board.url}?lockstep&wide", "--record", take)
        played(path, *live, "--audio", "null:fast", "--gain", "0dB")
        packets = board.log()
    forces = recorded(take).forces()[:, 0]
    n = len(forces) - 1
    assert n * TICK > 30
    # The force of a tick goes out in the next, times the part that the key bears.
    first = int(RISEN / TICK)
    asked, forces = packets["asked"][first:n], forces[first:n]
    assert np.abs(forces).max() > 0.2
    pushed = forces != 0
    part = asked[pushed][0] / forces[pushed][0]
    assert 0 < part <= 1
    # But for the pulses that ask whether the motor still pushes as it is told: two of 6 ms within
    # 24 ms, at most once in 56 ms (docs/live.md).
    pulsed = np.flatnonzero(~np.isclose(asked, part * forces, rtol=1e-12, atol=0))
    pulse_tests = np.split(pulsed, np.flatnonzero(np.diff(pulsed) > 14) + 1)
    assert all(pulse_test[-1] - pulse_test[0] < 24 for pulse_test in pulse_tests if len(pulse_test))
    assert len(pulsed) <= 12 * len(pulse_tests) <= 12 * n / 56
    assert np.abs(asked - part * forces).max() <= 3.0
