"""Captured hands: the spline through a take, and the take as a gesture of a key."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle.core import play
from oracle.key import KEYS, RATE, grid, lone, moved
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from ergon import _core

TAKES = sorted((Path(__file__).parents[2] / "scores/library/takes").glob("*.csv"))
NATURAL = ([(3, 0.0), (4, 0.0)], [(3, 0.0), (4, 0.0)])


def samples(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """t [s] and x [m] of a take in `t [s],x [mm]`."""
    head = file.read_text(encoding="utf-8").splitlines()[0]
    assert head == "t [s],x [mm]"
    t, x = np.loadtxt(file, delimiter=",", skiprows=1).T
    return np.ascontiguousarray(t), x * 1e-3


def spline(t: np.ndarray, x: np.ndarray) -> Any:
    """The natural quintic: third and fourth derivatives vanish at both ends."""
    return make_interp_spline(t, x, k=5, bc_type=NATURAL)


def test_take_files_present_in_repository():
    assert len(TAKES) == 3


@pytest.mark.parametrize("file", TAKES, ids=lambda f: f.stem)
def test_take_equals_natural_quintic_spline(file: Path):
    t, x = samples(file)
    take, truth = _core.Take(t, x), spline(t, x)
    assert take.duration == pytest.approx(t[-1] - t[0], rel=1e-15)
    size = [np.abs(truth(t, k)).max() for k in range(3)]
    for when in np.linspace(t[0], t[-1], 1777):
        result = take.evaluate(float(when - t[0]))
        for k in range(3):
            assert result[k] == pytest.approx(float(truth(when, k)), abs=1e-9 * size[k])


def test_trimmed_take_start_and_duration():
    t, x = samples(TAKES[0])
    take, truth = _core.Take(t, x, trim=(1.0, 2.5)), spline(t, x)
    saved = t[(t >= 1.0) & (t <= 2.5)]
    assert take.duration == pytest.approx(1.5, abs=2.0 * (t[1] - t[0]))
    # Away from the cut the spline of the part is the spline of the whole.
    for when in saved[12:-12]:
        assert take.evaluate(float(when - 1.0))[0] == pytest.approx(float(truth(when)), abs=1e-7)


def test_smoothed_take_equals_sosfiltfilt():
    t = np.arange(600) / 200.0
    x = 5e-3 * np.sin(2 * np.pi * 1.5 * t) + 5e-4 * np.sin(2 * np.pi * 40.0 * t)
    take = _core.Take(t, x, smooth=12.0)
    wanted = sosfiltfilt(butter(4, 12.0, fs=200.0, output="sos"), x)
    inside = slice(100, -100)  # the ends depend on how the filter is started
    result = np.array([take.evaluate(float(s))[0] for s in t])
    assert np.abs(result - wanted)[inside].max() < 1e-3 * 5e-4


@pytest.mark.parametrize(
    ("t", "x"),
    [
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0]),
        ([0.0, 2.0, 1.0], [0.0, 1.0, 2.0]),
        ([0.0, 1.0, 2.0], [0.0, np.nan, 2.0]),
        ([0.0, 1.0, np.inf], [0.0, 1.0, 2.0]),
        ([0.0, 1.0], [0.0, 1.0, 2.0]),
        ([], []),
    ],
    ids=["equal", "falling", "nan", "inf", "lengths", "empty"],
)
def test_take_refuses_invalid_samples(t: list[float], x: list[float]):
    with pytest.raises(_core.EngineError):
        _core.Take(np.array(t), np.array(x))


@pytest.mark.parametrize("touch", ["open", "tracked"])
@pytest.mark.parametrize("file", TAKES, ids=lambda f: f.stem)
def test_replayed_take_on_free_key_follows_spline(file: Path, touch: str):
    """The key alone follows the resampled take from its first instant to its last."""
    t, x = samples(file)
    network, timeline, key = lone(**KEYS["placeholder"])
    timeline.take(key, _core.Take(t, x), 0.5, touch=touch)
    seconds = 0.5 + t[-1] - t[0]
    done, sim = moved(network, timeline, seconds + 0.1)
    first, last = round(0.5 * RATE), int(seconds * RATE) - 1
    when = grid(len(done))[first:last]
    assert np.abs(done[first:last] - spline(t, x)(when - 0.5 + t[0])).max() < 1e-9
    assert sim.reports()[0].worst < 1e-9


@pytest.mark.parametrize("touch", ["open", "tracked"])
def test_replayed_take_on_instrument_reports_deviation(touch: str):
    t, x = samples(TAKES[0])
    low, high = x.min(), x.max()
    network = _core.Network()
    network.part("k1")
    struck = network.cel("m", **KEYS["placeholder"])
    network.part("bell")
    bell = network.cel("m", M=2e-3, f=220.0, t60=2.5)
    network.but("b", struck, bell, K=1e5, Z=1.0, gap=float(0.5 * (low + high)))
    network.listen("x", positions=[(struck, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.take(timeline.key("k1", struck), _core.Take(t, x), 0.5, touch=touch)
    sim = _core.Simulation(network, timeline)
    seconds = 0.5 + t[-1] - t[0]
    done = play(sim, round((seconds + 0.1) * RATE))[:, 0]
    first, last = round(0.5 * RATE), int(seconds * RATE) - 1
    off = np.abs(done[first:last] - spline(t, x)(grid(len(done))[first:last] - 0.5 + t[0]))
    if touch == "tracked":
        assert off.max() < 1e-9
    else:
        assert off.max() > 1e-4
        assert sim.reports()[0].worst == pytest.approx(off.max(), rel=1e-6)


@pytest.mark.parametrize(
    "options",
    [{"scale": 0.5}, {"scale": -1.0}, {"stretch": 2.0}, {"reverse": True}, {"until": 1.2}],
    ids=["half", "mirror", "slow", "reverse", "until"],
)
def test_take_with_scale_stretch_and_reverse(options: dict[str, Any]):
    t, x = samples(TAKES[1])
    t, x = t[:60], x[:60]
    truth, length = spline(t, x), float(t[-1] - t[0])
    network, timeline, key = lone(**KEYS["light"])
    timeline.take(key, _core.Take(t, x), 0.25, **options)
    stretch = options.get("stretch", 1.0)
    stop = options.get("until", 0.25 + length * stretch)
    done, _ = moved(network, timeline, 0.25 + length * stretch + 0.1)
    first, last = round(0.25 * RATE), int(stop * RATE) - 1
    inside = (grid(len(done))[first:last] - 0.25) / stretch
    inside = length - inside if options.get("reverse") else inside
    wanted = options.get("scale", 1.0) * truth(t[0] + inside)
    assert np.abs(done[first:last] - wanted).max() < 1e-9


def test_take_driving_imposed_point():
    t, x = samples(TAKES[2])
    network = _core.Network()
    network.part("p")
    mat, bell = network.sol("s"), network.cel("m", M=2e-3, f=220.0, t60=2.5)
    network.impose(mat)
    network.ref("r", mat, bell, K=50.0)
    network.listen("x", positions=[(mat, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.drive(mat, "position", take=_core.Take(t, x), start=0.3, scale=2.0)
    done = play(_core.Simulation(network, timeline), round((t[-1] + 0.5) * RATE))[:, 0]
    when = np.clip(grid(len(done)) - 0.3 + t[0], t[0], t[-1])  # first and last value are held
    assert np.abs(done - 2.0 * spline(t, x)(when)).max() < 1e-9
