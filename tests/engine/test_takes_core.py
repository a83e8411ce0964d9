"""Takes against scipy: its quintic spline with the same ends, its forward-backward Butterworth."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from ergon._core import EngineError, Take

Floats = NDArray[np.float64]

TAKES = sorted((Path(__file__).parents[2] / "scores/library/takes").glob("*.csv"))
NATURAL = ([(3, 0.0), (4, 0.0)], [(3, 0.0), (4, 0.0)])


def read(path: Path) -> tuple[Floats, Floats]:
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1]) * 1e-3


def compare(take: Take, spline: object, instants: Floats, offset: float = 0.0) -> None:
    """Position, velocity and acceleration agree to 1e-9 of the largest of each."""
    result = np.array([take.evaluate(float(t - offset)) for t in instants]).T
    for order, row in enumerate(result):
        wanted = spline(instants, order)  # type: ignore[operator]
        assert np.abs(row - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_take_files_present_in_repository() -> None:
    assert len(TAKES) == 3


@pytest.mark.parametrize("path", TAKES, ids=lambda path: path.stem)
def test_take_spline_equals_scipy(path: Path) -> None:
    t, x = read(path)
    take = Take(t, x)
    assert take.duration == t[-1] - t[0]
    compare(take, make_interp_spline(t, x, k=5, bc_type=NATURAL), np.linspace(t[0], t[-1], 5001))


@pytest.mark.parametrize("path", TAKES, ids=lambda path: path.stem)
def test_trimmed_take_follows_original_path(path: Path) -> None:
    t, x = read(path)
    take = Take(t, x, trim=(0.7123, 3.3))
    assert abs(take.duration - 2.5877) < 1e-15
    spline = make_interp_spline(t, x, k=5, bc_type=NATURAL)
    compare(take, spline, np.linspace(0.7123, 3.3, 3001)[1:-1], offset=0.7123)


@pytest.mark.parametrize("path", TAKES, ids=lambda path: path.stem)
def test_take_part_follows_original_path(path: Path) -> None:
    t, x = read(path)
    take = Take(t, x, trim=(0.5, 3.3)).part(0.2123, 2.5)
    assert take.duration == pytest.approx(2.2877, abs=1e-15)
    spline = make_interp_spline(t, x, k=5, bc_type=NATURAL)
    compare(take, spline, np.linspace(0.7123, 3.0, 3001)[1:-1], offset=0.7123)
    for first, last in ((-0.1, 1.0), (1.0, 1.0), (1.0, 2.3), (float("nan"), 1.0)):
        with pytest.raises(EngineError, match="does not lie inside a take that lasts"):
            take.part(first, last)


@pytest.mark.parametrize("path", TAKES, ids=lambda path: path.stem)
def test_take_smooth_of_jittered_times_equals_scipy(path: Path) -> None:
    t, x = read(path)
    assert np.ptp(np.diff(t)) > 5e-5, "the written instants jitter"
    even = np.linspace(t[0], t[-1], len(t))
    resampled = make_interp_spline(t, x, k=5, bc_type=NATURAL)(even)
    rate = (len(t) - 1) / (t[-1] - t[0])
    smooth = sosfiltfilt(butter(4, 6.0, fs=rate, output="sos"), resampled)
    take = Take(t, x, smooth=6.0)
    compare(take, make_interp_spline(even, smooth, k=5, bc_type=NATURAL), even)


def test_take_smooth_of_even_samples_equals_scipy() -> None:
    rate = 1000.0
    t = np.arange(3000) / rate
    x = 5e-3 * np.sin(17 * t) + 1e-4 * np.random.default_rng(1).standard_normal(len(t))
    smooth = sosfiltfilt(butter(4, 12.0, fs=rate, output="sos"), x)
    take = Take(t, x, smooth=12.0)
    result = np.array([take.evaluate(float(u))[0] for u in t])
    assert np.abs(result - smooth).max() < 1e-13


def test_take_spline_of_uneven_times_is_smooth() -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(10.0 ** rng.uniform(-5, 1, 300))
    x = rng.uniform(-5e-3, 5e-3, 300)
    take = Take(t, x)
    result = np.array([take.evaluate(float(u)) for u in t]).T
    # x''' has no jump from piece to piece; both sides from Hermite's quintic, in time / h.
    h, d = np.diff(t), np.diff(x)
    v, a = result[1], result[2]
    v0, v1, a0, a1 = h * v[:-1], h * v[1:], h * h * a[:-1], h * h * a[1:]
    left = (60 * d - 24 * v0 - 36 * v1 - 3 * a0 + 9 * a1) / h**3
    right = (60 * d - 36 * v0 - 24 * v1 - 9 * a0 + 3 * a1) / h**3
    size = sum(map(np.abs, (60 * d, 36 * v0, 36 * v1, 9 * a0, 9 * a1))) / h**3
    jump = np.abs(left[:-1] - right[1:])
    assert np.all(jump < 1e-9 * np.maximum(size[:-1], size[1:]))


def test_take_at_rest_before_and_after() -> None:
    take = Take(np.array([0.0, 0.1, 0.2, 0.3]), np.array([1.0, 2.0, 0.0, 3.0]))
    assert take.evaluate(-1.0) == (1.0, 0.0, 0.0)
    assert take.evaluate(9.0) == (3.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("t", "x", "care", "sentence"),
    [
        ([0.0], [0.0], {}, "at least two samples"),
        ([0.0, 1.0], [0.0], {}, "2 instants and 1 positions"),
        ([0.0, 1.0, 0.5], [0.0] * 3, {}, "sample 2 is at 0.5 s"),
        ([0.0, np.nan], [0.0] * 2, {}, "sample 1 of the take is not a finite number"),
        ([0.0, 1.0], [0.0] * 2, {"trim": (0.5, 1.5)}, "runs from 0 s to 1 s"),
        ([0.0, 1.0], [0.0] * 2, {"trim": (0.5, 0.5)}, "trim 0.5 s to 0.5 s"),
        ([0.0, 1.0], [0.0] * 2, {"smooth": 0.5}, "smooth 0.5 Hz"),
        ([0.0, 1.0], [0.0] * 2, {"smooth": float("nan")}, "above 0"),
    ],
)
def test_take_refuses_wrong_samples_with_message(
    t: list[float], x: list[float], care: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        Take(np.array(t), np.array(x), **care)  # type: ignore[arg-type]
