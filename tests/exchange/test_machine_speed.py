"""What `ergon doctor` keeps of a machine's speed, and what it is used for."""

import json
from pathlib import Path

import pytest
from checked import check
from commands import records

from ergon.cli import app
from ergon.exchange import machine_speed
from ergon.live import fitness
from ergon.scores.staging.stage import stage

Capture = pytest.CaptureFixture[str]
SCORE = """\
ergon: 1
instruments:
  s:
    modules:
      a: {MAS: {M: 10g, X0: 1mm}}
      w: {SOL: {}}
      k: {LNL: {between: [w, a], law: cubic, k: 2000, q: 1e9, damping: cubic, z: 0.1}}
    out: {x: {SOX: a}}
accuracy: {error: -40dB, cpu: 1%}
render: {tail: 0.5s}
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ERGON_CACHE", "on")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache" / "ergon" / "speed.json"


def test_speed_correction_by_processor(cache: Path, monkeypatch: pytest.MonkeyPatch):
    assert machine_speed.read_correction() is None
    assert machine_speed.store_correction(2.8)
    assert machine_speed.read_correction() == 2.8
    monkeypatch.setattr(machine_speed, "processor_name", lambda: "another")
    assert machine_speed.read_correction() is None
    monkeypatch.setenv("ERGON_CACHE", "off")
    assert not machine_speed.store_correction(1.0)
    assert json.loads(cache.read_text())["correction"] == 2.8


@pytest.mark.parametrize("text", ["", "[]", '{"correction": 2.0}', "[" * 10_000, "NaN", "\0"])
def test_damaged_speed_cache_is_ignored(cache: Path, text: str):
    cache.parent.mkdir(parents=True)
    cache.write_text(text)
    assert machine_speed.read_correction() is None
    for correction in ("1e9", "0.0", "NaN", "true", '"2"', "-1.0"):
        single = json.dumps(machine_speed.processor_name())
        cache.write_text(f'{{"processor": {single}, "correction": {correction}}}')
        assert machine_speed.read_correction() is None


def test_speed_correction_in_plan_output(capsys: Capture):
    Path("a.yaml").write_text(SCORE)

    def planned() -> tuple[dict, str]:
        assert app.run(["plan", "a.yaml", "--json"]) == 0
        rows = records(capsys)
        (plan,) = (line for line in rows if line["event"] == "plan")
        assert app.run(["plan", "a.yaml"]) == 0
        shown = capsys.readouterr()
        return plan, shown.out + shown.err

    plain, text = planned()
    assert plain["cost_here"] is None
    assert "on this machine" not in text
    assert "W402" not in text
    assert machine_speed.store_correction(50.0)
    corrected, text = planned()
    assert corrected["hash"] == plain["hash"]
    assert corrected["cost"] == plain["cost"]
    assert corrected["cost_here"] == pytest.approx(50.0 * plain["cost"])
    assert "× on this machine by `ergon doctor`" in text
    assert "W402" in text


def test_plan_hash_independent_of_speed_correction():
    piece = check(SCORE.replace("error: -40dB, ", "")).piece
    assert piece is not None
    plans = [stage(piece, planned=True, correction=own).plan for own in (1.0, 100.0)]
    assert plans[0] is not None
    assert plans[1] is not None
    assert plans[0].hash == plans[1].hash


def test_doctor_stores_measured_speed(monkeypatch: pytest.MonkeyPatch, capsys: Capture):
    def speed(seconds: float) -> fitness.Finding:
        assert seconds > 0.0
        return fitness.Finding("speed", "measured", numbers={"correction": 1.5})

    monkeypatch.setattr(fitness, "measure_speed", speed)
    assert app.run(["doctor", "--no-audio", "--seconds", "0.1"]) == 0
    assert "speed    measured" in capsys.readouterr().out
    assert machine_speed.read_correction() == 1.5


def test_measure_speed_returns_ratios():
    result = fitness.measure_speed(0.0)  # one block of each
    assert result.topic == "speed"
    each = result.numbers["each"]
    assert isinstance(each, list)
    assert len(each) == 3
    assert all(ratio > 0.0 for ratio in each)
