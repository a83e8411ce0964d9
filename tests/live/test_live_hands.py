"""Keys in real hands: what stands in for them, and what a recording of them renders to."""

from pathlib import Path

import numpy as np
import pytest

from ergon import _core
from ergon.scores.gesture.takes import read
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

TAKES = Path(__file__).parents[2] / "scores/library/takes"
SCORE = """\
ergon: 1
keys:
  k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m{reach}}}
  v: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, t60: 2.5s}}}}
      b: {{BUT: {{between: [k, m], K: 900N/m, gap: 1mm}}}}
      c: {{BUT: {{between: [v, m], K: 900N/m, gap: 1mm}}}}
    out: {{SOX: m}}
gestures: {{knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}}
takes: {{t: {{file: {takes}/hand-point-1.csv}}}}
players: {{ada: {{key: v}}, remi: {{hand: live, key: k, standin: t}}{more}}}
parts: {{ada: [{{at: 2|1, play: knock, every: 1, times: 4}}]{part}}}
render: {{tail: 1s}}
"""


def piece(part: str = "", more: str = "", reach: str = "") -> Piece:
    text = SCORE.format(takes=TAKES, part=part, more=more, reach=reach)
    loaded = load("s.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def rendered(simulation: _core.Simulation, n_frames: int) -> np.ndarray:
    out = np.zeros((n_frames, simulation.n_out))
    simulation.process(out)
    return out[:, 0]


def test_standin_of_take_by_ticks():
    (hand,) = stage(piece(), planned=True).live_hands
    assert (hand.player, hand.tick_frames, hand.reach) == ("remi", 44, 1.0)
    take = read(TAKES / "hand-point-1.csv")
    spline = _core.Take(take.t, take.x)
    t = np.arange(len(hand.standin_path)) * hand.tick_frames / 44100.0
    inside = t < spline.duration - 1e-3
    asked = np.array([spline.evaluate(t[0] + when)[0] for when in t[inside]])
    # The key joins the take from where it rests; from then on it is where the hand was.
    late = t[inside] > 0.1
    assert np.max(np.abs(hand.standin_path[inside] - asked)[late]) < 1e-8


def test_standin_of_written_part_by_free_key():
    mine = ", remi: [{at: 1|1, play: knock}]"
    assert (
        stage(piece(mine)).live_hands == ()
    )  # nobody is said to be there: a virtual hand plays it
    (hand,) = stage(piece(mine), real_hands={"remi": None}).live_hands
    position = round(60 / 60 / 8 * 44100 / 44)  # an eighth of a beat at 60 a minute
    assert hand.standin_path[position] == pytest.approx(6e-3, abs=5e-5)


@pytest.mark.parametrize("planned", [False, True])
def test_live_hand_render_equals_performance(planned: bool):
    """Tick by tick as a performance goes, and at once as a render does."""
    rng = np.random.default_rng(7)
    ticks = 3e-3 - 3e-3 * np.cos(np.arange(900) / 60) + rng.normal(0, 1e-5, 900)
    live = stage(piece(), planned=planned, real_hands={"remi": None})
    (hand,) = live.live_hands
    played, forces = [], []
    for x in ticks:
        live.simulation.hold(hand.index, x)
        played.append(rendered(live.simulation, hand.tick_frames))
        forces.append(live.simulation.hand_force(hand.index))
    assert min(forces) < -0.5
    again = stage(piece(), planned=planned, real_hands={"remi": ticks})
    assert np.array_equal(rendered(again.simulation, 900 * 44), np.concatenate(played))


def test_live_hand_behind_lever_scaled_travel():
    ticks = np.full(40, 4e-3)
    plain = stage(piece(), real_hands={"remi": ticks})
    lever = stage(piece(reach=", reach: 2"), real_hands={"remi": ticks / 2})
    a, b = (rendered(one.simulation, 40 * 44) for one in (plain, lever))
    assert np.array_equal(a, b)


def test_live_hand_key_with_second_player_is_refused():
    with pytest.raises(StageError, match="plays key 'k' too, which the real hand of 'remi' moves"):
        stage(
            piece(", bo: [{at: 1|1, play: knock}]", ", bo: {key: k}"),
            real_hands={"remi": None},
        )
