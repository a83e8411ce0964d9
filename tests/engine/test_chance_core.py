"""Chance against numpy's own PCG64, set to the same state and increment."""

import hashlib

import numpy as np
import pytest

from ergon._core import Chance, exp, ln

MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645


def generator(seed: int, kind: str, name: str, member: int, occurrence: int) -> np.random.PCG64:
    digest = hashlib.sha256(f"{seed}/{kind}/{name}/{member}/{occurrence}".encode()).digest()
    state, stream = (int.from_bytes(half, "little") for half in (digest[:16], digest[16:]))
    increment = (stream << 1 | 1) % 2**128
    bits = np.random.PCG64()
    complete = bits.state
    complete["state"] = {
        "state": ((state + increment) * MULTIPLIER + increment) % 2**128,
        "inc": increment,
    }
    bits.state = complete
    return bits


KEYS = [
    (20181110, "strikes", "rain", 0, 0),
    (-1, "jitter", "hésitation", 7, 3),
    (0, "", "", 2**40, 2**40),
]


@pytest.mark.parametrize("key", KEYS, ids=str)
def test_chance_draws_equal_numpy_pcg64(key: tuple[int, str, str, int, int]) -> None:
    chance, units = Chance(*key), np.random.Generator(generator(*key)).random(600)
    for u in map(float, units[:200]):
        assert chance.uniform(-2.0, 3.0) == -2.0 + 5.0 * u
    for u in map(float, units[200:400]):
        wanted = exp(ln(20.0) + (ln(2e4) - ln(20.0)) * u)
        assert chance.logarithmic(20.0, 2e4) == wanted
    for u in map(float, units[400:]):
        assert chance.exponential(0.5) == pytest.approx(-0.5 * np.log1p(-u), rel=1e-14)


def test_chance_streams_depend_only_on_key() -> None:
    key = KEYS[0]
    first = [Chance(*key).uniform(0.0, 1.0) for _ in range(3)]
    assert len(set(first)) == 1
    others = {Chance(*key[:3], member, 0).uniform(0.0, 1.0) for member in range(1000)}
    assert len(others) == 1000


def test_chance_refuses_invalid_parameters() -> None:
    chance = Chance(*KEYS[0])
    with pytest.raises(ValueError, match="above zero"):
        chance.logarithmic(0.0, 1.0)
    with pytest.raises(ValueError, match="finite"):
        chance.uniform(0.0, float("inf"))
    with pytest.raises(ValueError, match="mean"):
        chance.exponential(-1.0)
