"""Small scenes by chance, planned for an error, against the plain scheme so fine that it is sure."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import chance
from oracle.core import render as plain
from oracle.planned import plan, render

RATE = 44100.0
N = round(chance.SPAN * RATE)
BUDGET_DB = -50.0
TIMES = (32, 64, 128)  # as fine as that it is played to know what it does
ORDER_DB = 12.0  # by so much an error of the plain scheme falls with a doubling, at most
SILENT = 1e-6  # of the loudest output: nothing has met it
SEEDS = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Found:
    """How far the plan is from the finest run, and how sure that one is of itself [dB]."""

    error: float
    sure: float
    how: list[tuple[str, int, object]]


def db(y: np.ndarray, x: np.ndarray, heard: np.ndarray) -> float:
    sounds = np.linalg.norm(x - x.mean(axis=0), axis=0)[heard]
    worst = float((np.linalg.norm(y - x, axis=0)[heard] / sounds).max())
    return 20.0 * float(np.log10(max(worst, 1e-15)))


def look(seed: int, *, even: bool) -> Found:
    scene = chance.scene(seed, even=even)
    coarse, rough, fine = (plain(scene, RATE * s, N * s)[::s] for s in TIMES)
    loud = np.linalg.norm(fine - fine.mean(axis=0), axis=0)
    heard = loud > SILENT * loud.max()
    # A bounce that comes out otherwise in a finer run shows here; a lucky doubling does not count.
    sure = max(db(rough, fine, heard), db(coarse, rough, heard) - ORDER_DB)
    planned = render(scene, RATE, N, error_db=BUDGET_DB)
    rows = plan(scene, RATE, error_db=BUDGET_DB).rows()
    return Found(db(planned, fine, heard), sure, [(r.what, r.n_mat, r.modes) for r in rows])


def check(seed: int, *, even: bool) -> None:
    found = look(seed, even=even)
    assert found.error <= max(BUDGET_DB, found.sure), f"seed {seed}: {found}"


@given(seed=SEEDS)
@settings(max_examples=30, deadline=None)
def test_a_plan_keeps_its_budget(seed: int):
    check(seed, even=True)
