"""`ergon.take_stats`: what hands did in a recording, against closed forms."""

from pathlib import Path

import numpy as np
import pytest
from recordings import Axis, end, header, row, rows

import ergon
from ergon.scores.gesture.take_file import TakeError

F, SIZE, Z, N = 2.0, 5e-3, 1.5, 5000
W = 2 * np.pi * F


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    """A hand that goes to and fro in a viscous fluid, and one that rests; 60 rows are missing."""
    every = []
    for tick in range(100, 100 + N):
        if 2000 <= tick < 2060:
            continue
        t = (tick - 100) * 1e-3
        x, v = SIZE * np.sin(W * t), SIZE * W * np.cos(W * t)
        fresh = int(tick % 10 != 3)
        hand = Axis(float(x), float(-Z * v), float(-0.5 * Z * v), fresh)
        every.append(row(tick, hand, Axis(0.001)))
    data = [header((("remi", "k2"), ("ada", "k1")), 44000.0, 44)]
    data += [rows(*every[i : i + 250]) for i in range(0, len(every), 250)]
    (work_folder / "hand.take").write_bytes(b"".join([*data, end()]))
    return work_folder


def test_take_stats_of_hand_in_viscous_fluid():
    remi, ada = ergon.take_stats("hand.take")
    assert (remi.hand, remi.n_ticks, remi.n_lost) == ("remi", N - 60, 60)
    assert remi.n_held == 494
    assert remi.movement is not None
    assert remi.movement.duration == pytest.approx((N - 1) * 1e-3)
    assert remi.movement.speed_peak == pytest.approx(SIZE * W, rel=2e-3)
    assert remi.movement.reversals.size == 20
    force = remi.force
    assert force is not None
    assert force.peak == pytest.approx(Z * SIZE * W, rel=1e-6)
    assert force.sent == pytest.approx(0.5 * Z * SIZE * W, rel=1e-6)
    # ∫ Z v² dt over ten periods; nothing comes back from a damper. (A gap is gone through at once.)
    assert force.given == pytest.approx(Z * SIZE**2 * W**2 * N * 1e-3 / 2, rel=5e-3)
    assert force.taken < 1e-3 * force.given
    assert ada.force is None
    assert ada.n_held is None
    assert ada.movement is not None
    assert ada.movement.smoothness is None


def test_take_stats_hands_and_cutoff_options():
    (ada,) = ergon.take_stats("hand.take", ergon.TakeStatsOptions(hands=["ada"], cutoff="5Hz"))
    assert ada.movement is not None
    assert ada.movement.cutoff == 5.0
    with pytest.raises(ergon.OptionError, match="there are remi, ada"):
        ergon.take_stats("hand.take", ergon.TakeStatsOptions(hands=["eve"]))
    with pytest.raises(ergon.OptionError, match="cutoff"):
        ergon.take_stats("hand.take", ergon.TakeStatsOptions(cutoff="5kg"))


def test_take_stats_of_invalid_empty_and_short_takes(folder: Path):
    (folder / "no.take").write_bytes(b"RIFF")
    with pytest.raises(TakeError, match="not a recording"):
        ergon.take_stats("no.take")
    with pytest.raises(TakeError, match="No such file"):
        ergon.take_stats("none.take")
    (folder / "empty.take").write_bytes(header() + end())
    (only,) = ergon.take_stats("empty.take")
    assert (only.n_ticks, only.n_lost, only.movement, only.force) == (0, 0, None, None)
    (folder / "one.take").write_bytes(header() + rows(row(5, Axis(0.001, 1.0))) + end())
    (first,) = ergon.take_stats("one.take")
    assert first.movement is None
    assert first.force is not None
    assert (first.force.peak, first.force.given) == (1.0, 0.0)
