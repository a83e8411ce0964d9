"""Maps of a slow key: its certificate against what happens, and what the slowness costs."""

from dataclasses import replace

import numpy as np
import pytest
from sweep import few

from ergon import _core
from ergon.workshop.lab import map_catalogue, map_table, maps, slow_key_scene
from ergon.workshop.lab.names import SLOW, SLOW_MAPS
from ergon.workshop.lab.slow_key_scene import QUICK_KEY, RATE, SOFT_KEY, SlowKeyPoint, SlowKeyScene

KEYS = {"soft": SOFT_KEY, "quick": QUICK_KEY}


def survey(name: str, *every: float) -> tuple[maps.Map, list[maps.Spot]]:
    complete = map_catalogue.built_in(SLOW)[name]
    first = replace(complete, xs=complete.xs[::4], ys=every)  # the whole maps: `make charts`
    return first, maps.survey(first, lambda done: None)


@pytest.mark.slow
def test_soft_slow_key_map_accurate_inside_bounds():
    first, spots = survey("soft", 10.0, 20.0)
    outside = spots[len(first.xs) - 1]
    assert (outside.theory, outside.certified, outside.stable) == (False, False, False)
    inside = [spot for spot in spots if spot.theory]
    assert all(spot.certified and spot.stable for spot in inside)
    assert all(spot.accurate for spot in inside if spot.y <= 10.0)
    # Twenty frames are too many for a stiff spring: stable, and another sound.
    slower = {spot.x: spot.accurate for spot in inside if spot.y == 20.0}
    assert slower[min(slower)] is True
    assert slower[max(slower)] is False


@pytest.mark.slow
def test_slow_key_map_certificate_agrees_with_runs():
    first = map_catalogue.built_in(SLOW)["quick"]
    places = [(x, y) for y in (20.0, 36.0, 54.0) for x in first.xs[::4]]
    spots = [maps.predicted_and_run(first, x, y)[0] for x, y in places]
    assert {spot.certified for spot in spots if spot.theory} == {True, False}
    for spot in spots:
        assert spot.certified == spot.stable, spot
        if spot.stable is False:
            assert "diverged at" in spot.reason or "times as far" in spot.reason


@pytest.mark.parametrize("name", few(SLOW_MAPS, 1))
def test_slow_key_load_formula_at_stability_border(name: str):
    """Whatever the key's rate; its own springs have no part in it."""
    key = KEYS[name]
    low, high = 1e3, 1e7
    while high / low > 1.0 + 1e-6:
        middle = (low * high) ** 0.5
        low, high = (
            (middle, high) if slow_key_scene.eigenvalue_load(key, middle) < 1.0 else (low, middle)
        )
    for every in (2, 4):
        assert SlowKeyPoint(SlowKeyScene(key, low * 0.998, every)).refusal() == ""
    bare = replace(key, K=(1e-3, 1e-3, 1e-3, 1e-3), Z=(0.0, 0.0, 0.0, 0.0))
    built = SlowKeyScene(bare, low * (1.0 - 1e-5), None).build_at(RATE)
    built.network.certify(RATE)
    built = SlowKeyScene(bare, high * (1.0 + 1e-5), None).build_at(RATE)
    with pytest.raises(_core.UnstableError):
        built.network.certify(RATE)


def test_hidden_factor_changes_no_bit():
    """So what is refused is run as it would be, were it not."""

    def frames(scene: SlowKeyScene) -> np.ndarray:
        result = SlowKeyPoint(scene).run(2205).frames
        assert result is not None
        return result

    for every in (10, 44):
        plain = SlowKeyScene(SOFT_KEY, 5e3, every)
        assert frames(replace(plain, hidden_factor=64.0)).tobytes() == frames(plain).tobytes()


@pytest.mark.slow
def test_slow_key_map_accuracy_limits_in_table():
    first = replace(map_catalogue.built_in(SLOW)["soft"], xs=(1.0,), ys=(10.0, 12.0))
    assert [first.error_limit_db(y) for y in (2.0, 10.0, 12.0, 60.0)] == [
        -75.0,
        -75.0,
        -70.0,
        -70.0,
    ]
    spots = maps.survey(first, lambda done: None)
    strict = replace(first, error_limits=((float("inf"), -88.0),))
    assert [spot.accurate for spot in spots] == [True, True]
    assert [s.accurate for s in maps.survey(strict, lambda done: None)] == [True, False]
    text = map_table.csv({"soft": (first, spots)}, SLOW)
    assert "error_db of at most -75 dB up to 10, -70 dB" in text
