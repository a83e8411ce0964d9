"""Bodies that nothing holds, or a nail: their modes, and how they move as a whole."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from oracle import ode
from oracle.planned import error_db, plan, render
from oracle.scene import Scene
from planned_sound import planned, played, ready
from sessions import Stepped
from sweep import few

from ergon import _core

RATE = 44100.0
N = 4410

BODIES = {
    "membrane": "shape: hex, radius: 3, f: 180Hz, t60: 0.8s, M: 60g",
    "disc": "material: bronze, shape: disc, radius: 12cm, thickness: 2mm, masses: 37",
    "no loss": "shape: square, radius: 3, f: 180Hz, M: 60g, bending: true",
}
SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: 240}}]
keys:
  k1: {{M: 300g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  gong:
    modules:
      p: {{PLATE: {{{body}}}}}
      b: {{BUT: {{between: [k1, p.centre], K: 4kN/m, Z: 0.2Ns/m, gap: 1mm}}}}
    out: {{SOX: p.9}}
gestures: {{knock: 0mm@0 smooth 5mm@30ms smooth 0mm@120ms}}
players: {{ada: {{key: k1}}}}
parts: {{ada: [{{at: 1|1, play: knock}}]}}
strikes: {{a: {{to: [gong.p.4], at: 0.15s, impulse: 2mNs}}}}
render: {{tail: 0.1s, bits: float}}
"""


@pytest.mark.parametrize("damped", few([False, True], 1))
def test_free_chain_struck_by_hammer_against_dop853(damped: bool) -> None:
    """Its modes and its flight, against DOP853; it stays -80 dB exact where it has gone 5 cm."""
    scene = Scene()
    scene.part("chain")
    mats = [scene.mas(f"m{i}", M=1e-3) for i in range(8)]
    for i, (a, b) in enumerate(pairwise(mats)):
        scene.ref(f"r{i}", a, b, K=2e4, Z=2e-3 if damped else 0.0)
    scene.part("hammer")
    head = scene.mas("h", M=4e-3, X0=-1e-3, V0=1.5)
    scene.but("b", head, mats[2], K=2e4)
    scene.listen("chain", positions=[(mats[0], 1.0), (mats[5], -1.0)])
    scene.listen("flight", positions=[(mats[7], 1.0)])
    when = np.arange(N) / RATE
    x, _ = ode.solve(scene, when, 1e-11)
    truth = np.stack([sum(w * x[:, i] for _, i, w in taps) for taps in scene.outs], axis=1)
    assert truth[-1, 1] > 0.05
    rows = plan(scene, RATE, error_db=-80.0).rows()
    assert [(row.what, row.n_mat) for row in rows] == [("stepped", 1), ("modes", 8)]
    assert error_db(render(scene, RATE, N, error_db=-80.0), truth) <= -80.0


@pytest.mark.parametrize("body", few(BODIES, ["membrane"]))
def test_free_plate_planned_by_modes(body: str) -> None:
    """Against the same module by module, by splitting of order 4 at eight times the rate."""
    text = SCORE.format(body=BODIES[body])
    _, built = planned(text, error_db=-80.0)
    assert [row.what for row in built.rows()] == ["stepped", "modes"]
    finer = [text + f"rates: {{audio: {44_100 * times}Hz}}\n" for times in (4, 8)]
    rough, fine = (
        played(one, method="bm4")[::times] for one, times in zip(finer, (4, 8), strict=True)
    )
    sound = played(text, error_db=-80.0)
    n = min(map(len, (rough, fine, sound)))
    # Speeds: it goes away by centimetres and sounds by micrometres.
    rough, fine, sound = (np.diff(one[:n], axis=0) for one in (rough, fine, sound))
    assert error_db(rough, fine) < -90.0
    assert error_db(sound, fine) <= -80.0


@pytest.mark.slow
@pytest.mark.parametrize(("masses", "in_session"), few([(37, True), (310, False)], [(37, True)]))
def test_hung_plate_planned_by_modes(masses: int, in_session: bool) -> None:
    """The nail loses otherwise than the metal, and no complex modes are at hand.

    A body that a contact touches has none in a session, and none beyond 300 masses.
    """
    text = SCORE.format(body=BODIES["disc"].replace("masses: 37", f"masses: {masses}"))
    nail = "nail: {SOL: {}}\n      hang: {REF: {between: [nail, p.5], K: 2kN/m, Z: 0.5Ns/m}}"
    text = text.replace("      b: {BUT", f"      {nail}\n      b: {{BUT")
    stage = ready(text)
    if in_session:
        stage.timeline.open()
    built = _core.Plan(stage.network, stage.timeline, error_db=-60.0)
    assert [row.what for row in built.rows()] == ["stepped", "modes"]
    simulation = _core.Simulation(stage.network, stage.timeline, plan=built)
    fine = played(text + f"rates: {{audio: {44_100 * 8}Hz}}\n", method="bm4")[::8]
    sound = np.empty((len(fine), simulation.n_out))
    simulation.process(sound)
    assert error_db(sound, fine) <= -60.0


@pytest.mark.parametrize("line", ["set gong.b.K 2kN/m", "set gong.p.f x1.1", "undo"])
def test_session_edit_continues_free_plate_motion(tmp_path: Path, line: str) -> None:
    """A session takes its motion over, its flight too."""
    text = SCORE.format(body=BODIES["membrane"])
    player_session = Stepped(text.split("strikes:")[0], tmp_path)
    player_session.ok("play")
    player_session.ok("ada plays knock every 1 now")
    player_session.run(1.5)
    before = player_session.sound[-1, 0]
    player_session.ok(line)
    player_session.run(1.5)
    steps = np.abs(np.diff(player_session.sound[:, 0]))
    assert abs(before) > 0.0
    # Nowhere a jump: from frame to frame it goes no farther than its fastest motion.
    assert steps.max() < 20.0 * np.median(steps[steps > 0.0])
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
