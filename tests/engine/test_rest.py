"""Islands at rest are not computed."""

import numpy as np
import pytest

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.staging import planning
from ergon.scores.staging.preparing import prepare

STRIKE_TIME = 1.0  # [s]


def score(highest: str) -> str:
    """A body of some modes, held by a law that is computed between frames."""
    return f"""\
ergon: 1
instruments:
  body:
    modules:
      skin:
        MODES:
          M: 50g
          f: [110Hz, {highest}]
          t60: [0.4s, 0.2s]
          places: {{middle: [1, 1], air: [1, 0.5]}}
          band: {{count: 40, f: 200Hz..5kHz, t60: 0.2s, places: {{middle: 1, air: 1}}, seed: 2}}
      wall: {{SOL: {{}}}}
      law: {{LNL: {{between: [wall, skin.middle], law: q*d*d*d, q: 2e12N/m3}}}}
    out: {{SOV: skin.air}}
strikes: {{s: {{to: body.skin.middle, at: {STRIKE_TIME}s, impulse: 20mNs}}}}
"""


# 12 kHz is more than a quarter of the rate.
@pytest.mark.parametrize("highest", ["9kHz", "12kHz"])
def test_modes_beside_a_law_rest_before_a_strike(highest: str) -> None:
    piece = load("rest.yaml", text=score(highest)).piece
    assert piece is not None
    ready = prepare(piece)
    plan = planning.make_plan(ready.network, ready.timeline, Accuracy(error=-80.0)).plan
    assert any(row.contact_substeps > 1 for row in plan.rows())
    simulation = _core.Simulation(ready.network, ready.timeline, plan=plan)
    n_frames = round(STRIKE_TIME * piece.rate)
    out = np.zeros((n_frames, ready.network.n_out))
    simulation.process(out)
    assert not out.any()
    assert simulation.steps_at_rest() > 0.8 * n_frames
    simulation.process(out)
    assert np.ptp(out) > 0.0
