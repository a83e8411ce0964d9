"""The path of a real key and its derivatives, beside references."""

import numpy as np
import pytest
from measured_keys import KEY, PLAIN, RATE, path, rain
from scipy.linalg import expm

from ergon import _core


def exact(row: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Positions (n,) of a key without dry friction or delay, by the exponential of its matrix."""
    n = 1 + (len(row) - 10) // 3
    mass, spring, damper = (np.zeros((n, n)) for _ in range(3))
    mass[0, 0], spring[0, 0], damper[0, 0] = row[:3]
    for i in range(1, n):
        m, f, ratio = row[7 + 3 * i : 10 + 3 * i]
        w = 2 * np.pi * f
        pair = np.zeros(n)
        pair[[0, i]] = -1, 1
        mass[i, i] = m
        spring += m * w * w * np.outer(pair, pair)
        damper += 2 * m * ratio * w * np.outer(pair, pair)
    inverse = np.linalg.inv(mass)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ spring, -inverse @ damper]])
    # The last column is the force, which is held.
    complete = np.zeros((2 * n + 1, 2 * n + 1))
    complete[:-1, :-1] = flow
    complete[n : 2 * n, -1] = inverse[:, 0]
    step = expm(complete / RATE)
    state = np.zeros(2 * n + 1)
    state[:n] = row[5]
    out = []
    for f in force - row[3]:
        out.append(state[0])
        state[-1] = f
        state = step @ state
    return np.array(out)


@pytest.mark.parametrize("row", [KEY, PLAIN], ids=["mode", "plain"])
def test_key_path_without_friction_against_matrix_exponential(row: np.ndarray):
    row = row.copy()
    row[[4, 6]] = 0.0
    row[5] = 1e-3
    force = rain(row, 3.0)
    reference = exact(row, force)
    errors = [np.sqrt(np.mean((path(row, force, s) - reference) ** 2)) for s in (22, 44, 88)]
    assert errors[1] < 1e-8, errors  # a thousandth of a sensor's step
    assert errors[2] < errors[0] / 3


def test_key_path_derivatives_equal_differences():
    force = rain(KEY, 3.0)
    columns = [0, 1, 2, 3, 4, 5, 6, 10, 11, 12]
    _, jacobian = _core.key_path(KEY, force, RATE, columns=columns)
    for column, index in enumerate(columns):
        errors = []
        for by in (1e-5, 1e-6, 1e-7):
            step = np.zeros_like(KEY)
            step[index] = by * abs(KEY[index])
            wide = (path(KEY + step, force) - path(KEY - step, force)) / (2 * step[index])
            errors.append(np.linalg.norm(jacobian[:, column] - wide) / np.linalg.norm(wide))
        assert min(errors) < 1e-5, (index, errors)


def test_key_path_shapes_and_refusals():
    force = np.zeros(10)
    x, jacobian = _core.key_path(KEY, force, RATE)
    assert x.shape == (10,)
    assert jacobian.shape == (10, 13)
    for row, rate, message in (
        (KEY[:12], RATE, "3 for each mode"),
        (-KEY, RATE, "above zero"),
        (KEY, 0.0, "ticks a second"),
    ):
        with pytest.raises(_core.EngineError, match=message):
            _core.key_path(row, force, rate)
