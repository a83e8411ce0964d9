"""A key whose motor is late, in the piece and beyond a wire: the same samples."""

from pathlib import Path

import numpy as np
from checked import check
from duets import command_output, played, recorded, sound
from emulators import emulator

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 6000
RISEN = 2 * RATE  # forces rise until then
CALIBRATION = "ergon: 1\nM: 400g\nK: 60N/m\nZ: 1.2Ns/m\ndelay: 0.5ms\n"
SCORE = """\
ergon: 1
accuracy: {method: ca}
rates: {audio: 6000Hz}
keys:
  k: {calib: key.yaml}
  v: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}
      b: {BUT: {between: [k, m], K: 200N/m, gap: 0.2mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 8mm@1/8 0mm@1/2}
players: {ada: {key: v}, remi: {hand: live, key: k, tick: 6000Hz}}
duet: [{couple: [k, v], REF: {K: 60N/m, Z: 0Ns/m}}]
parts: {ada: [{at: 2.1s, play: knock}]}
mix: {master: {gain: 0dB, reference: SI}, route: [{from: bell, to: 1, highpass: 20Hz}]}
render: {tail: 500ms}
"""


def rendered(score: Path, name: str) -> np.ndarray:
    code, words = command_output("render", score, "--bits", "float", "-o", name)
    assert code == 0, words
    return sound(Path(name))


def test_delayed_key_in_a_render_and_on_an_emulated_device(work_folder: Path):
    """A spring pulls the key against a bell; by the device its force is late beyond a wire.

    Compared up to the first pulse test, which the performance adds to the force.
    """
    Path("key.yaml").write_text(CALIBRATION)
    score = Path("score.yaml")
    score.write_text(SCORE)
    calib = ("--calib", "key.yaml")
    with emulator("frame", "--pty", "--lockstep", "--rate", f"{RATE}Hz", *calib) as device:
        live = ("--live", f"remi={device.url}&wide", "--record", "hand.take", "--gain", "0dB")
        played(score, *live, "--audio", "file:heard.wav")
    take = recorded(Path("hand.take"))
    asked = np.abs(take.forces()[:-1, 0] - take.sent()[1:, 0]) > 1e-5
    n = int(np.argmax(asked[RISEN:])) + RISEN
    apart = take.positions()[:n, 0]

    loaded = load(str(score))
    assert loaded.piece is not None
    complete = stage(loaded.piece)
    moved, out = np.zeros(n), np.zeros((1, complete.simulation.n_out))
    for i in range(n):
        moved[i] = complete.simulation.positions()[0]
        complete.simulation.process(out)
    assert np.ptp(moved) > 5e-4
    assert np.abs(apart - moved).max() < 1e-12
    late, listened = rendered(score, "late.wav")[:n], sound(Path("heard.wav"))[:n]
    assert np.abs(listened).max() > 1e-6
    assert np.abs(late - listened).max() < 1e-6 * np.abs(listened).max()
    score.write_text(SCORE.replace("{calib: key.yaml}", "{calib: key.yaml, delay: 0s}"))
    assert (
        np.abs(rendered(score, "at-once.wav")[:n] - listened).max() > 0.01 * np.abs(listened).max()
    )


def test_delay_of_real_key_comes_from_device():
    loaded = check(SCORE.replace("{calib: key.yaml}", "{M: 400g, K: 60N/m, delay: 2ms}"))
    assert loaded.piece is not None
    by_hand = stage(loaded.piece, real_hands={"remi": None})
    assert not by_hand.built_network.assembly.ports
    assert stage(loaded.piece).built_network.assembly.ports
