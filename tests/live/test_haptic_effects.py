"""The effects of docs/howto/haptic.md: what the hand feels, against closed forms."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from docs.generators import haptic

STROKES = 0.25  # a second
OMEGA = 2.0 * math.pi * STROKES  # [rad/s]
TICK = 44 / 44100  # [s]

Force = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of positions [m] and speeds [m/s]


def wall(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.where(x > 5e-3, -300.0 * (x - 5e-3) - 0.5 * v, 0.0)


def detent(x: np.ndarray, _v: np.ndarray) -> np.ndarray:
    """A triangle of 5 mm, whose slope is 0.4 N over 1.25 mm."""
    return -0.4 * 2.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * x / 5e-3))


def texture(x: np.ndarray, _v: np.ndarray) -> np.ndarray:
    grooves = [(x - 2e-3 * number) / 0.4e-3 for number in range(-4, 5)]
    return -0.3 * sum((d * np.exp(-(d**2)) for d in grooves), np.zeros_like(x))


def friction(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Dahl (1968): after a way s since the last turn it is F·(1 - 2·exp(-K·s/F))."""
    s = haptic.REACH + x * np.sign(v)
    return -0.5 * np.sign(v) * (1.0 - 2.0 * np.exp(-300.0 * s / 0.5))


def inertia(x: np.ndarray, _v: np.ndarray) -> np.ndarray:
    """A mass of 100 g that nearly follows: m·ω²·x."""
    return 0.1 * OMEGA**2 * x


EXACT: dict[str, Force] = {
    "wall": wall,
    "magnet": lambda x, v: 25e-6 / (15e-3 - x + 2e-3) ** 2,
    "detent": detent,
    "texture": texture,
    "friction": friction,
    "inertia": inertia,
    "viscosity": lambda x, v: -2.0 * v,
    "spring": lambda x, v: -100.0 * x,
}


@pytest.mark.parametrize("name", EXACT)
def test_force_of_an_effect(name: str):
    x, forces = haptic.force(haptic.effects()[name], STROKES)
    t = np.arange(len(x)) * TICK
    # What is felt in a tick is the mean of the key's way from the place before.
    middle = t - 0.5 * TICK
    x, v = haptic.REACH * np.sin(OMEGA * middle), haptic.REACH * OMEGA * np.cos(OMEGA * middle)
    exact = EXACT[name](x, v)
    error = np.abs(forces - exact)
    assert np.max(error) < 0.03 * np.max(np.abs(exact)), f"{np.max(error)} N"


def test_haptic_page_pictures_of_all_effects():
    for name, text in haptic.effects().items():
        picture = haptic.PAGE.with_name(f"haptic-{name}.svg")
        assert f"(haptic-{name}.svg)" in haptic.PAGE.read_text()
        assert picture.read_text() == haptic.picture(name, text)
    assert set(haptic.effects()) == set(EXACT)


@pytest.mark.slow
def test_haptic_page_table_of_device_stiffness():
    assert haptic.table() in haptic.PAGE.read_text()
