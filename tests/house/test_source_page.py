"""The page about the source: its stream obeys the equations that it states."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from docs.generators.pages import blocks, put
from ergon.cli import app

PAGE = Path(__file__).parents[2] / "docs" / "source.md"
MASS, STIFFNESS, DAMPING = 0.4, 60.0, 1.2  # of the key, SI
RATE = 44_100


def test_source_page_stream_satisfies_equations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for block in blocks(PAGE):
        if block.language == "yaml":
            put(block, tmp_path)
    score = Path("source.yaml").read_text(encoding="utf-8")
    free = score.replace("gap: 1mm", "gap: 20mm")  # nothing touches the key
    Path("source.yaml").write_text(free, encoding="utf-8")
    assert app.run(["compile", "source.yaml", "-o", "ergons.csv", "-q"]) == 0
    lines = Path("ergons.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    instant = np.array([float(row["time [s]"]) for row in rows])
    mass = np.array([float(row["mass [kg]"]) for row in rows])
    sign = np.array([1.0 if row["sign"] == "+" else -1.0 for row in rows])
    speed = np.array([float(row["speed [m/s]"]) for row in rows])
    impulse = sign * np.array([float(row["impulse [N·s]"]) for row in rows])
    # The free key by its difference equation, moved by these impulses alone.
    kappa, zeta = STIFFNESS / RATE**2 / MASS, DAMPING / RATE / MASS
    frames = np.rint(instant * RATE).astype(int)
    pushes = np.zeros(frames[-1] + 1)
    pushes[frames] = impulse
    path = np.zeros(len(pushes) + 1)
    for n, push in enumerate(pushes):
        before = path[n - 1] if n else 0.0
        path[n + 1] = (2 - kappa - zeta) * path[n] - (1 - zeta) * before + push / RATE / MASS
    assert path[round(0.06 * RATE)] == pytest.approx(6e-3, abs=2e-6)
    assert path[round(0.2 * RATE)] == pytest.approx(0.0, abs=2e-6)
    # Equation (2), with the velocity of the key before the collision.
    velocity = (path[frames] - path[np.maximum(frames - 1, 0)]) * RATE
    expected = velocity + impulse * (mass + MASS) / (2 * mass * MASS)
    np.testing.assert_allclose(speed, np.abs(expected), atol=1e-4)
    # Equation (4) is wrong by m/M + V/v.
    swift = (expected > 0) & (speed > 0.5)
    wanted = 2 * mass[swift] * speed[swift]  # M times the change of the key's velocity
    error = 1 - impulse[swift] / wanted
    bound = mass[swift] / MASS + velocity[swift] / speed[swift]
    np.testing.assert_allclose(error, bound, atol=1e-3)
