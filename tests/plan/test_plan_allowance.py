"""The work of planning is bounded, and a plan says where it ended at that bound."""

import json
from functools import cache
from pathlib import Path

import pytest
import random_scores

from ergon import _core
from ergon.api import score as scores
from ergon.api.options import AccuracyOptions
from ergon.cli import app
from ergon.scores.staging.planning import _percent_text

Capture = pytest.CaptureFixture[str]

# A seed whose plan takes all of the allowance before it is exact enough.
HOSTILE = 3
STARVED = "{error: -60dB, cpu: 0.0001%}"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("ERGON_CACHE", "off")


def write(monkeypatch: pytest.MonkeyPatch, seed: int, accuracy: str) -> None:
    monkeypatch.setattr(random_scores, "METHODS", (accuracy,))
    Path("a.yaml").write_text(random_scores.score(seed))


@cache
def hostile(threads: int) -> _core.Plan:
    with pytest.MonkeyPatch.context() as monkeypatch:
        write(monkeypatch, HOSTILE, STARVED)
        return planned(threads)


def planned(threads: int = 1) -> _core.Plan:
    options = AccuracyOptions()
    staged = scores.stage_piece(scores.read("a.yaml", options, None), options, threads=threads)
    assert staged.stage.plan is not None
    return staged.stage.plan


@pytest.mark.slow
def test_trials_within_their_allowance() -> None:
    drawn, most = hostile(1).trials
    assert 0.0 < drawn <= most


@pytest.mark.slow
def test_truncated_plan_same_with_any_threads() -> None:
    first, four = hostile(1), hostile(4)
    assert any(row.cut_short for row in first.rows())
    assert (first.hash, first.trials) == (four.hash, four.trials)
    assert [row.error_db for row in first.rows()] == [row.error_db for row in four.rows()]


@pytest.mark.slow
def test_truncated_plan_reported_also_from_cache(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("ERGON_CACHE", "on")
    write(monkeypatch, HOSTILE, STARVED)
    for is_kept in (False, True):
        assert app.run(["plan", "a.yaml", "--json"]) == 0
        out, err = capsys.readouterr()
        *rows, plan = [json.loads(line) for line in out.splitlines()]
        assert (plan["kept"], plan["cut_short"]) == (is_kept, True)
        assert any(row.get("cut_short") for row in rows)
        assert "planning reached its work limit" in out + err
    assert app.run(["plan", "a.yaml"]) == 0
    out, err = capsys.readouterr()
    assert "planning ended" in out
    assert "warning[W403]" in err
    assert "above the 0.0001% allowed" in err
    assert app.run(["check", "a.yaml"]) == 0
    assert "planning reached its work limit" in capsys.readouterr().err


@pytest.mark.slow
def test_slow_part_stability_proof_counted_as_work() -> None:
    network = _core.Network()
    for name, every in (("one", 137), ("two", 139)):
        network.part(name, macrostep=every)
        mats = [network.cel(f"{name}0", M=0.5, K=20.0, Z=0.01)]
        mats += [network.mas(f"{name}{i}", M=0.5) for i in range(1, 40)]
        for i in range(39):
            network.ref(f"{name}r{i}", mats[i], mats[i + 1], K=20.0, Z=0.01 * (1 + i % 3))
    network.part("between")
    network.ref("c", 39, 40, K=1.0, Z=0.0)
    network.listen("end", positions=[(40, 1, 1.0)])
    timeline = _core.Timeline(network, 44100.0)
    timeline.gesture(timeline.key("key", 0), [0.0, 0.1], [0.0, 1e-3], ["smooth", "smooth"])
    plan = _core.Plan(network, timeline, error_db=-60.0)
    # A map of 19,043 frames, until all pulls fall together; the pilot alone takes 0.023 s.
    assert 0.1 < plan.trials[0] <= plan.trials[1]


@pytest.mark.parametrize(
    ("part", "shown"),
    [(1e-6, "0.0001%"), (0.0347, "3.5%"), (0.8, "80%"), (1.234, "123%"), (0.0, "0%")],
)
def test_percent_text_of_small_core_shares(part: float, shown: str) -> None:
    assert _percent_text(part) == shown
