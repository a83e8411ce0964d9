"""`--drive`: a written part moves a real key through its measured model, in lockstep."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from duets import STAND_IN, command_output, played, recorded, rendered, sound
from emulators import emulator
from paced_board import paced

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

# Forces rise for two seconds at the start: the part begins after them.
SCORE = """\
ergon: 1
keys: {k: {calib: key.yaml, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}
      b: {BUT: {between: [k, m], K: 200N/m, gap: GAP}}
    out: {SOX: m}
gestures: {sway: REST@0 smooth 8mm@1/4 0mm@1/2 -3mm@3/4 3mm@7/8 REST@1}
players: {ada: {key: k}}
parts: {ada: [{at: 2.5s, play: sway sway}]}
mix: {master: {gain: 0dB, reference: SI}, route: [{from: bell, to: 1, highpass: 20Hz}]}
render: {tail: 500ms}
"""
MODE_FREQUENCY, MODE_RATIO = 180.0, 0.02
STARTED = round(2.45 * 44100 / 44)  # tick


@dataclass(frozen=True)
class RealKey:
    """Mass with its mode [kg], dry friction [N], weight [N] and delay of the motor [s]."""

    mass: float = 0.4
    dry: float = 0.05
    weight: float = 0.0
    delay: float = 0.002
    mode: float = 0.02

    def calibration(self) -> str:
        """The file that `ergon metrology` would write of it."""
        t60 = 3 * np.log(10.0) / (2 * np.pi * MODE_FREQUENCY * MODE_RATIO)
        return (
            f"ergon: 1\nM: {self.mass}kg\nK: 60N/m\nZ: 1.2Ns/m\ndry: {self.dry}N\n"
            f"weight: {self.weight}N\ndelay: {self.delay}s\n"
            f"modes:\n  - {{M: {self.mode}kg, f: {MODE_FREQUENCY}Hz, t60: {t60}s}}\n"
        )

    def emulated(self) -> tuple[str, ...]:
        """The options of `ergon emulate` that make such a key."""
        return (
            *("--mass", f"{self.mass - self.mode}kg", "--stiffness", "60N/m"),
            *("--damping", "1.2Ns/m", "--dry", f"{self.dry}N", "--weight", f"{self.weight}N"),
            *("--delay", f"{self.delay}s"),
            *("--mode", f"{self.mode}kg {MODE_FREQUENCY}Hz {MODE_RATIO}"),
        )


def driven(tmp_path: Path, measured: RealKey, real: RealKey, *hand: str, options=(), gap="14mm"):
    """Positions of a real key that its part drives by the model of the measured one, and the forces
    sent to it, tick by tick.
    """
    (tmp_path / "key.yaml").write_text(measured.calibration())
    path, take = tmp_path / "score.yaml", tmp_path / "hand.take"
    path.write_text(
        SCORE.replace("GAP", gap).replace("REST", f"{-1e3 * measured.weight / 60.0:g}mm")
    )
    take.unlink(missing_ok=True)
    device = ("frame", "--udp", "0", "--lockstep", "--force-max", "5N")
    with emulator(*device, *real.emulated(), *hand) as board:
        drive = ("--drive", f"ada={board.url}&wide", "--record", take)
        usual = ("--audio", "null:fast") if "--audio" not in options else ()
        played(path, *drive, *usual, *options)
    recording = recorded(take)
    return recording.positions()[:, 0], recording.sent()[:, 0].astype(float)


def written(tmp_path: Path) -> np.ndarray:
    """The path of the part, at each tick [m]."""
    piece = load(str(tmp_path / "score.yaml")).piece
    assert piece is not None
    (hand,) = stage(piece, real_hands={"ada": None}).live_hands
    return hand.standin_path


def error(tmp_path: Path, positions: np.ndarray) -> float:
    """Distance of the key from its written path [m rms]."""
    path = written(tmp_path)
    n = min(len(path), len(positions))
    assert n > STARTED + 2000
    assert np.ptp(path[STARTED:n]) > 10e-3
    return float(np.sqrt(np.mean((positions[STARTED:n] - path[STARTED:n]) ** 2)))


@pytest.mark.parametrize("key", [RealKey(), RealKey(weight=0.15, delay=0.0033)])
def test_driven_key_on_its_written_path(tmp_path: Path, key: RealKey):
    positions, _ = driven(tmp_path, key, key)
    assert error(tmp_path, positions) < 0.1e-3


@pytest.mark.parametrize("ratio", [0.95, 1.05])
def test_driven_key_with_wrong_mass(tmp_path: Path, ratio: float):
    positions, _ = driven(tmp_path, RealKey(), replace(RealKey(), mass=0.4 * ratio))
    assert error(tmp_path, positions) < 0.3e-3


def test_driven_key_rendered_from_its_take(tmp_path: Path):
    played_file = tmp_path / "heard.wav"
    options = ("--audio", f"file:{played_file}", "--gain", "60dB")
    driven(tmp_path, RealKey(), RealKey(mass=0.42), options=options, gap="6mm")
    assert not (recorded(tmp_path / "hand.take").flags() & STAND_IN).any()
    assert np.abs(sound(played_file)).max() > 1e-3
    assert np.array_equal(
        rendered(tmp_path / "score.yaml", tmp_path / "hand.take"), sound(played_file)
    )


def test_driven_key_detects_hand_grip(tmp_path: Path):
    """A hand as stiff as a light grip keeps the key; it is told by a force, and by little work."""
    hand = ("--gesture", "0mm@0 hold 0mm@9", "--hand", "900N/m", "--grip", "6Ns/m")
    positions, forces = driven(tmp_path, RealKey(), RealKey(), *hand)
    assert np.ptp(written(tmp_path)) > 10e-3
    assert np.abs(positions[STARTED:]).max() < 1.5e-3
    assert np.abs(forces[STARTED:]).max() > 0.3
    # Power may be 0.5 W for long, and 1 J is allowed at once (`Limits`).
    work = np.cumsum(forces[:-1] * np.diff(positions))
    seconds = np.arange(len(work)) * 44 / 44100
    assert (work <= 1.0 + 0.5 * seconds).all()
    assert np.abs(work).max() > 1e-5


def test_driven_key_after_a_hand_lets_go(tmp_path: Path):
    hand = ("--gesture", "0mm@0 hold 0mm@3", "--hand", "900N/m", "--grip", "6Ns/m")
    positions, _ = driven(tmp_path, RealKey(), RealKey(), *hand)
    path = written(tmp_path)
    n = min(len(path), len(positions))
    later = slice(round(4.1 * 44100 / 44), n)
    assert np.sqrt(np.mean((positions[later] - path[later]) ** 2)) < 1e-3


def test_drive_force_above_the_limit(tmp_path: Path):
    _, forces = driven(tmp_path, RealKey(), RealKey(), options=("--force-max", "100mN"))
    # Pulse tests of the motor take a part of what is allowed.
    assert 0.08 < np.abs(forces).max() < 0.1 + 1e-6


PACED = """\
ergon: 1
keys: {k: {calib: key.yaml, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}
      b: {BUT: {between: [k, m], K: 100N/m, gap: 40mm}}
    out: {SOX: m}
gestures: {swing: 0mm@0 (smooth 8mm@1/2 -4mm@1 0mm@3/2)*4}
players: {remi: {key: k}}
parts: {remi: [{at: 2.2s, play: swing}]}
mix: {route: [{from: bell, to: 1}]}
render: {tail: 1s}
"""
LIGHT_KEY = "ergon: 1\nM: 50g\nK: 0N/m\nZ: 1Ns/m\n"
FAULT = 3.5  # [s] of the board


@pytest.mark.parametrize(("fault", "greatest"), [({"motor": -1.0}, 0.0), ({"frozen": True}, 0.1)])
def test_drive_force_under_faults(tmp_path: Path, fault: dict[str, float], greatest: float):
    """A frozen sensor is found by forces of newtons; smaller ones stay those of the part."""
    (tmp_path / "key.yaml").write_text(LIGHT_KEY)
    (tmp_path / "score.yaml").write_text(PACED)
    with paced(stiffness=0.0, damping=0.0, since=FAULT, **fault) as board:
        board.free()
        drive = ("--drive", f"remi={board.url}", "--audio", "null:fast", "--gain", "0dB")
        output = played(tmp_path / "score.yaml", *drive)
        log = board.log()
    sound_force = np.abs(log[(log["t"] > 2.3) & (log["t"] < FAULT)]["force"]).max()
    assert sound_force > 0.03
    after = log[log["t"] >= FAULT]
    assert after["t"][-1] > FAULT + 1.5
    ended = after[after["t"] > FAULT + 1.0]
    assert np.abs(ended["force"]).max() <= greatest, output


@pytest.mark.parametrize(
    ("before", "after", "drive", "why"),
    [
        ("calib: key.yaml", "M: 50g, K: 9N/m", "remi=emul:", "the key k is not measured"),
        ("", "", "leo=emul:", "no player 'leo'"),
        ("", "", "remi=page:", "has no motor that could move a key"),
        ("parts: {remi: [{at: 2.2s, play: swing}]}", "", "remi=emul:", "has no written part"),
    ],
)
def test_drive_without_motor_or_calibration(
    tmp_path: Path, before: str, after: str, drive: str, why: str
):
    (tmp_path / "key.yaml").write_text(LIGHT_KEY)
    (tmp_path / "score.yaml").write_text(PACED.replace(before, after) if before else PACED)
    code, output = command_output(
        "play", tmp_path / "score.yaml", "--drive", drive, "--audio", "null:fast"
    )
    assert code == 2, output
    assert why in output
