"""A hand that plays a bundled duet for a minute: no safety stage changes any force it feels."""

from pathlib import Path

import numpy as np
import pytest
from duets import played, recorded
from simulated_board import simulated

RISEN = 2.1  # [s] after which the rise at the start is over
TICK = 44 / 44100
LIBRARY = Path(__file__).parent.parent / "scores" / "library"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("score", "hand"),
    [
        ("duet", {"sine": 0.006, "hertz": 1.5}),
        ("two-keys", {"sine": 0.004, "hertz": 3.0}),
    ],
)
def test_what_is_played_passes_unchanged(tmp_path: Path, score: str, hand: dict[str, float]):
    path, take = LIBRARY / f"{score}.yaml", tmp_path / "hand.take"
    if score == "two-keys":  # both of its hands are written
        path = tmp_path / path.name
        text = (LIBRARY / path.name).read_text()
        path.write_text(text.replace("remi: {key: k2}", "remi: {hand: live, key: k2}"))
    with simulated(tmp_path / "log.npy", lockstep=True, **hand) as board:
        live = ("--live", f"remi={board.url}?lockstep&wide", "--record", take)
        played(path, *live, "--audio", "null:fast", "--gain", "0dB")
        packets = board.log()
    felt = recorded(take).forces()[:, 0]
    n = len(felt) - 1
    assert n * TICK > 30
    # The force of a tick goes out in the next, times the part that the stiffness of the loop allows.
    first = int(RISEN / TICK)
    asked, felt = packets["asked"][first:n], felt[first:n]
    assert np.abs(felt).max() > 0.2
    pushed = felt != 0
    part = asked[pushed][0] / felt[pushed][0]
    assert 0 < part <= 1
    assert np.allclose(asked, part * felt, rtol=1e-12, atol=0)
