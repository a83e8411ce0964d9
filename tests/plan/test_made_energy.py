"""Energy that steps make: refused or told of, with its place, and never called proved."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from sweep import few

from ergon import _core
from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.scores.staging import planning
from ergon.scores.staging.preparing import prepare
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

SCENES = Path(__file__).parents[1] / "data" / "accuracy"
HAMMER = """\
ergon: 1
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}
      hammer: {MAS: {M: 5g, X0: -2mm, V0: 1m/s}}
      felt: {BUT: {between: [hammer, m], K: 5000kN/m, gap: 0.5mm}}
    out: {SOX: m}
render: {tail: 0.2s}
"""
LAWFUL = """\
ergon: 1
accuracy: {method: ieq}
instruments:
  row:
    modules:
      a: {MAS: {M: 1g, X0: 1mm}}
      b: {MAS: {M: 1g}}
      c: {MAS: {M: 1g}}
      d: {MAS: {M: 1g}}
      r1: {REF: {between: [a, b], K: 1kN/m}}
      r2: {REF: {between: [b, c], K: 1kN/m}}
      soft: {LNL: {between: [c, d], law: F*tanh(d/w), F: 1N, w: 1mm}}
    out: {SOX: a}
render: {tail: 0.2s}
"""
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    return work_folder


@pytest.mark.parametrize(
    ("scene", "method", "module"),
    [("but-16", "ca", "s.c"), ("but-14", "ca", "s.c"), ("hard-4", "ieq", "s.b"),
     ("hard-14", "ieq", "s.b")],
)  # fmt: skip
def test_render_with_energy_doubling_exits_4(
    scene: str, method: str, module: str, capsys: Capture
) -> None:
    path = SCENES / f"stability-{scene}.yaml"
    assert app.run(["render", str(path), "--method", method, "-o", "x.wav"]) == 4
    err = capsys.readouterr().err
    assert "error[E401]" in err
    assert f"{module}" in err
    assert "created energy: " in err
    assert "remove `method` from `accuracy`" in err
    assert not Path("x.wav").exists()


@pytest.mark.parametrize("scene", ["but-16", "but-14"])
def test_planned_scene_creates_no_energy(scene: str) -> None:
    piece = load(str(SCENES / f"stability-{scene}.yaml")).piece
    assert piece is not None
    played = stage(piece, planned=True)
    played.simulation.process(_frames(played.simulation))
    assert played.energy_gains() == []


def test_small_created_energy_warns_w404_unless_planned(capsys: Capture) -> None:
    Path("a.yaml").write_text(HAMMER)
    assert app.run(["render", "a.yaml", "--method", "ca"]) == 0
    err = capsys.readouterr().err
    assert "a.yaml:7:7: warning[W404] bell.felt created energy" in err
    assert app.run(["render", "a.yaml"]) == 0
    assert "W404" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("scene", "error"),
    few([("hard-14", None), ("hard-4", -60.0), ("hard-4", None), ("hard-14", -60.0)], 2),
)
def test_plan_warns_of_diverged_trial(
    scene: str, error: float | None, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("ERGON_CACHE", "on")
    monkeypatch.setenv("XDG_CACHE_HOME", str(Path.cwd()))
    text = (SCENES / f"stability-{scene}.yaml").read_text()
    if error is not None:
        text += f"accuracy: {{error: {error}dB}}\n"
    Path("a.yaml").write_text(text)
    for is_kept in (False, True):
        assert app.run(["plan", "a.yaml", "--json"]) == 0
        *warnings, row, plan = map(json.loads, capsys.readouterr().out.splitlines())
        assert (row["diverges"], row["error_db"], plan["kept"]) == (True, None, is_kept)
        message = [one["message"] for one in warnings if one.get("code") == "W403"]
        assert len(message) == 1
        assert "s: the motion diverged in a trial; a render stops there with E401" in message[0]
    assert app.run(["check", "a.yaml"]) == 0
    # Without an accuracy `check` makes no plan.
    assert ("W403" in capsys.readouterr().err) == (error is not None)
    assert app.run(["render", "a.yaml"]) == 4
    err = capsys.readouterr().err
    assert err.index("warning[W403]") < err.index("error[E401]")


def test_guarantee_of_ieq_with_hardening_links_is_guarded() -> None:
    piece = load(str(SCENES / "stability-hard-4.yaml")).piece
    assert piece is not None
    ready = prepare(piece)
    plan = _core.Plan(ready.network, ready.timeline, method="ieq")
    assert [row.guarantee for row in plan.rows()] == ["guarded"]


def test_ieq_with_unsupported_law_is_refused() -> None:
    piece = load("a.yaml", text=LAWFUL).piece
    assert piece is not None
    with pytest.raises(StageError) as refused:
        stage(piece, planned=True)
    (result,) = refused.value.diagnostics
    assert (result.code, result.place.line) == ("E309", 12)
    assert "ieq needs a law by points or a polynomial" in result.message


def test_plan_warns_of_unmeasured_error() -> None:
    row = SimpleNamespace(
        what="ieq",
        parts=["gong"],
        error_db=None,
        error_s=None,
        spectral_db=None,
        cut_short=False,
        diverges=False,
    )
    plan = SimpleNamespace(rows=lambda: [row])
    (text,) = planning._error_misses(plan, -60.0, is_foreseen=True)  # type: ignore[arg-type]
    assert text.startswith("gong: the error is unknown")
    assert "it may be above the -60 dB that you asked for" in text
    # Where hands play nothing can be measured beforehand.
    assert planning._error_misses(plan, -60.0, is_foreseen=False) == []  # type: ignore[arg-type]


def _frames(simulation: _core.Simulation) -> NDArray[np.float64]:
    return np.zeros((8_000, simulation.n_out))
