"""A key in another process, packet by packet: what it does to the piece, and the piece to it."""

import math
from pathlib import Path

import numpy as np
import pytest
from duets import STAND_IN, command_output, played, recorded, rendered, sound
from emulators import emulator
from sweep import few

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import Stage, stage

# Forces rise for two seconds at the start: what is to be exact begins after them.
RISEN = 2.0
KEYS = """\
ergon: 1
accuracy: {{method: ca}}
{head}
keys:
  k: {{M: 50g, K: 0N/m, Z: 1Ns/m}}
  v: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, t60: 2.5s}}}}
      b: {{BUT: {{between: [k, m], K: 200N/m, gap: 1mm}}}}
    out: {{SOX: m}}
gestures: {{knock: 0mm@0 smooth 8mm@1/8 0mm@1/2}}
players: {{ada: {{key: v}}, remi: {{hand: live, key: k{tick}}}}}
{duet}
parts: {{ada: [{part}]}}
mix: {{master: {{gain: 0dB, reference: SI}}, route: [{{from: bell, to: 1, highpass: 20Hz}}]}}
render: {{tail: {tail}}}
"""


def written(tmp_path: Path, **fields: str) -> Path:
    path = tmp_path / "score.yaml"
    usual = {"head": "", "tick": "", "duet": "", "part": "{at: 2.1s, play: knock}", "tail": "500ms"}
    path.write_text(KEYS.format(**(usual | fields)))
    return path


COUPLED = "duet: [{couple: [k, v], REF: {K: 60N/m, Z: 0Ns/m}}]"


@pytest.mark.parametrize(
    ("kind", "method", "scheme"),
    few(
        [
            ("frame", "--pty", "frame:"),
            ("frame", "--udp=0", "frame+udp:"),
            ("haply", "--ws=0", "haply:"),
        ],
        1,
    ),
)
def test_remote_key_equals_key_in_network(tmp_path: Path, kind: str, method: str, scheme: str):
    """A frame a tick (R = 1): a spring from a written hand pulls the key, the key strikes a bell.

    The same once with the key as a MAT of the scene, once with it beyond a wire: bit for bit.
    """
    rate = 6000
    score = written(
        tmp_path, head=f"rates: {{audio: {rate}Hz}}", tick=f", tick: {rate}Hz", duet=COUPLED
    )
    take, listened = tmp_path / "hand.take", tmp_path / "heard.wav"
    with emulator(kind, method, "--lockstep", "--rate", f"{rate}Hz") as device:
        assert device.url.startswith(scheme)
        wide = "&wide" if kind == "frame" else ""
        live = ("--live", f"remi={device.url}{wide}", "--record", take, "--gain", "0dB")
        played(score, *live, "--audio", f"file:{listened}")
    apart = recorded(take)

    complete = staged(score)
    assert complete.live_hands == ()  # the key is a MAT: the first of the scene
    n = len(apart.positions())
    moved, out = np.zeros(n), np.zeros((1, complete.simulation.n_out))
    for i in range(n):
        moved[i] = complete.simulation.positions()[0]
        complete.simulation.process(out)
    assert np.ptp(moved) > 2e-3
    assert apart.forces().min() < -0.05 < 0.05 < apart.forces().max()
    assert np.array_equal(apart.positions()[:, 0], moved)
    full_sound = tmp_path / "whole.wav"
    render = ("render", score, "--bits", "float", "-o", full_sound)
    code, output = command_output(*render)
    assert code == 0, output
    assert np.array_equal(sound(full_sound), sound(listened))


CALIBRATION = """\
ergon: 1
M: 70g
rest: -1mm
K: 20N/m
Z: 1Ns/m
dry: 80mN
static: 120mN
static_speed: 20mm/s
"""
MODES = "modes:\n  - {M: 20g, f: 180Hz, t60: 0.2s}\n  - {M: 5g, f: 410Hz, t60: 0.1s}\n"


@pytest.mark.parametrize("more", few(["", "presliding: 4kN/m\n", MODES], [MODES]))
def test_emulated_calibrated_key_equals_score_key(tmp_path: Path, more: str):
    """As above, with dry friction, modes and a rest: the whole score, sample for sample.

    A key with links of its own meets one link of the scene, for forces are added up in one order.
    """
    rate = 6000
    (tmp_path / "key.yaml").write_text(CALIBRATION + more)
    score = written(
        tmp_path, head=f"rates: {{audio: {rate}Hz}}", tick=f", tick: {rate}Hz", duet=COUPLED
    )
    text = score.read_text().replace("{M: 50g, K: 0N/m, Z: 1Ns/m}", "{calib: key.yaml}")
    # The other key begins beside it, so that nothing moves before the gesture.
    text = text.replace("Z: 1.2Ns/m}", "Z: 1.2Ns/m, rest: -1mm, X0: -1mm}")
    if more:
        text = text.replace("between: [k, m]", "between: [v, m]")
    score.write_text(text)
    take, listened = tmp_path / "hand.take", tmp_path / "heard.wav"
    calib = ("--calib", str(tmp_path / "key.yaml"))
    with emulator("frame", "--pty", "--lockstep", "--rate", f"{rate}Hz", *calib) as device:
        live = ("--live", f"remi={device.url}&wide", "--record", take, "--gain", "0dB")
        played(score, *live, "--audio", f"file:{listened}")
    apart = recorded(take).positions()[:, 0]

    complete = staged(score)
    n = len(apart)
    moved, out = np.zeros(n), np.zeros((1, complete.simulation.n_out))
    for i in range(n):
        moved[i] = complete.simulation.positions()[0]
        complete.simulation.process(out)
    assert np.ptp(moved) > 2e-3
    assert np.array_equal(apart, moved), np.abs(apart - moved).max()
    full_sound = tmp_path / "whole.wav"
    code, output = command_output("render", score, "--bits", "float", "-o", full_sound)
    assert code == 0, output
    assert np.array_equal(sound(full_sound), sound(listened))


def staged(score: Path, **how: object) -> Stage:
    piece = load(score).piece
    assert piece is not None
    return stage(piece, **how)


@pytest.mark.parametrize(
    ("arguments", "options"),
    few(
        [
            (("firefader", "--pty"), ""),
            (("frame", "--pty"), "&wide"),
            (("frame", "--udp", "0"), "&wide"),
            (("frame", "--udp", "0"), ""),
            (("haply", "--ws", "0"), ""),
        ],
        1,
    ),
)
def test_lockstep_devices_play_as_rendered(
    tmp_path: Path, arguments: tuple[str, ...], options: str
):
    """44 frames a tick: what came, put into the scheme offline, gives the same sound and force."""
    score, take, listened = written(tmp_path, head=""), tmp_path / "h.take", tmp_path / "heard.wav"
    hand = ("--gesture", "0mm@0 hold 0mm@2.1 smooth 8mm@2.2 0mm@2.4", "--hand", "900N/m")
    with emulator(*arguments, "--lockstep", *hand) as device:
        live = ("--live", f"remi={device.url}{options}", "--record", take, "--gain", "60dB")
        played(score, *live, "--audio", f"file:{listened}")
    forces = recorded(take)
    assert np.ptp(forces.positions()) > 4e-3
    assert forces.forces().min() < -0.3
    assert not (forces.flags() & STAND_IN).any()
    expected = rendered(score, take)
    assert np.abs(expected).max() > 1e-3
    assert np.array_equal(expected, sound(listened))
    again = staged(score, real_hands={"remi": forces.positions()[:, 0]})
    out = np.zeros((44, again.simulation.n_out))
    for tick, force in enumerate(forces.forces()[:, 0]):
        again.simulation.process(out)
        assert again.simulation.hand_force(0) == force, tick


def test_lockstep_force_moves_key_in_next_tick(tmp_path: Path):
    """The key, followed by its own equation from what was sent to it: one tick, no more."""
    rate = 44100 / 44
    score = written(tmp_path, duet=COUPLED)
    take = tmp_path / "hand.take"
    with emulator("frame", "--udp", "0", "--lockstep") as device:
        live = ("--live", f"remi={device.url}&wide", "--record", take)
        played(score, *live, "--audio", "null:fast")
    hand_forces = recorded(take)
    x, forces = hand_forces.positions()[:, 0], hand_forces.forces()[:, 0]
    pushed = np.flatnonzero(forces)
    assert pushed[0] > RISEN * rate
    moved = np.flatnonzero(np.diff(x)) + 1
    assert moved[0] == pushed[0] + 1
    position = d = 0.0
    for n in range(len(x) - 1):
        assert x[n] == pytest.approx(position, rel=1e-9, abs=1e-15)
        d = math.exp(-1 / 0.05 / rate) * d + forces[n] / 0.05 / rate**2
        position += d


# --- two keys, two hands ----------------------------------------------------------------------

PAIR = """\
ergon: 1
accuracy: {{method: ca}}
keys:
  k1: {{M: 50g, K: 60N/m, Z: 1Ns/m}}
  k2: {{M: 50g, K: 60N/m, Z: 1Ns/m}}
instruments: {{bell: {{modules: {{m: {{CEL: {{M: 2g, f: 220Hz, t60: 1s}}}}}}, out: {{SOX: m}}}}}}
gestures: {{knock: 0mm@0 smooth 8mm@1/4 hold 8mm@3/4 smooth 0mm@1}}
players: {{ada: {{hand: {ada}, key: k1}}, remi: {{hand: live, key: k2}}}}
duet: [{{couple: [k1, k2], REF: {{K: {k}N/m, Z: {z}Ns/m}}}}]
parts: {{{part}}}
render: {{tail: {tail}}}
"""


def pair(folder: Path, k: float) -> np.ndarray:
    """Rows of two real keys, the first in a hand that moves it: (n_ticks, position and force)."""
    folder.mkdir(exist_ok=True)
    score, take = folder / "pair.yaml", folder / "pair.take"
    score.write_text(PAIR.format(k=k, z=k / 1000, ada="live", part="", tail="4s"))
    hand = (
        "--gesture",
        "0mm@0 hold 0mm@2.1 smooth 10mm@2.6 hold 10mm@3 smooth 0mm@3.5",
        "--hand",
        "2kN/m",
    )
    frame = ("frame", "--udp", "0", "--lockstep")
    with emulator(*frame, *hand) as first, emulator(*frame) as second:
        live = ("--live", f"ada={first.url}&wide", "--live", f"remi={second.url}&wide")
        played(score, *live, "--record", take, "--audio", "null:fast")
    both = recorded(take)
    assert [player for player, _ in both.axes] == ["ada", "remi"]
    return np.hstack([both.positions(), both.forces()])


def test_lockstep_duet_of_two_hands_by_spring(tmp_path: Path):
    rows = pair(tmp_path / "tied", 120)
    first, other, _, force = rows.T
    assert np.ptp(first) > 8e-3
    assert np.ptp(other) >= 0.8 * np.ptp(first)
    assert force.max() > 0.02
    assert np.array_equal(rows, pair(tmp_path / "again", 120)), "repeats differ"


def test_lockstep_duet_without_spring(tmp_path: Path):
    first, other, *forces = pair(tmp_path / "loose", 0).T
    assert np.ptp(first) > 8e-3
    assert not other.any()
    assert not np.any(forces)


def test_ergon_on_one_key_moves_coupled_key(tmp_path: Path):
    """A written hand on the first key; the second is real, and nobody pushes it."""
    for k in (0, 120):
        score, take = tmp_path / f"{k}.yaml", tmp_path / f"{k}.take"
        part = "ada: [{at: 2.1s, play: knock}]"
        score.write_text(PAIR.format(k=k, z=k / 1000, ada="virtual", part=part, tail="500ms"))
        with emulator("frame", "--udp", "0", "--lockstep") as device:
            live = ("--live", f"remi={device.url}&wide", "--record", take)
            played(score, *live, "--audio", "null:fast")
        forces = recorded(take)
        if k:
            assert forces.positions().max() > 4e-3
            assert forces.forces().max() > 0.02
            # Nothing leads to the bell: that is said.
            again = (rendered(score, take, doubted=True) for _ in range(2))
            assert np.array_equal(*again)
        else:
            assert not forces.positions().any()
            assert not forces.forces().any()


def test_guide_moves_real_key_along_written_part(tmp_path: Path):
    """--guide: a finger rests on the key, and the key goes where the part goes."""
    score, take = tmp_path / "led.yaml", tmp_path / "led.take"
    part = "remi: [{at: 2.2s, play: knock}]"
    score.write_text(PAIR.format(k=0, z=0, ada="virtual", part=part, tail="500ms"))
    guide = ("--guide", "remi=200N/m")
    with emulator("frame", "--udp", "0", "--lockstep") as device:
        live = ("--live", f"remi={device.url}&wide", "--record", take, "--audio", "null:fast")
        played(score, *live, *guide)
    x = recorded(take).positions()[:, 0]
    (hand,) = staged(score, real_hands={"remi": None}).live_hands
    part = hand.standin_path[: len(x)]
    assert part.max() == pytest.approx(8e-3, abs=1e-4)
    # A spring leads, a damper brakes: behind by z/K while it moves, there where the part rests.
    assert np.abs(x[: len(part)] - part).max() < 3e-3
    resting = int((2.2 + 0.7) * 44100 / 44)
    assert x[resting] == pytest.approx(part[resting], abs=2e-4)
