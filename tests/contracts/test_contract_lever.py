"""A key behind a lever: what is said of it and of its ergons is said in the key's own terms."""

import csv
import re
from pathlib import Path

import pytest
from commands import records

from ergon.cli import app

Capture = pytest.CaptureFixture[str]
SCORE = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -5mm..5mm, reach: %s}}
instruments:
  i:
    modules:
      m: {CEL: {M: 400g, f: 1Hz}}
      r: {REF: {between: [k, m], K: %sN/m}}
    out: {SOX: m}
players: {p: {key: k}}
gestures: {g: 0mm@0 4mm@1/4 0mm@1/2}
parts: {p: [{at: 0, play: g, touch: %s}]}
render: {tail: 0.1s}
"""
# Behind the lever 1 N/m is felt as 100 N/m; an m of 400 g, moved ten times as far, as 40 kg.
SAME = {"1": "100", "10": "1"}


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> None:
    for reach, stiffness in SAME.items():
        for touch in ("open", "tracked"):
            text = SCORE % (reach, stiffness, touch)
            if reach == "1":
                text = text.replace("m: {CEL: {M: 400g", "m: {CEL: {M: 40kg")
            (work_folder / f"{touch}{reach}.yaml").write_text(text, encoding="utf-8")


def test_lever_gesture_report_in_key_millimetres(capsys: Capture) -> None:
    result = []
    for reach in SAME:
        assert app.run(["check", "--simulate", "--json", f"open{reach}.yaml"]) == 0
        result.append(next(r for r in records(capsys) if r["event"] == "followed"))
    for field in ("rms_m", "worst_m", "strongest_m_s"):
        assert result[1][field] == pytest.approx(result[0][field], rel=1e-6)
    assert 1e-4 < result[0]["worst_m"] < 4e-3


def test_lever_plot_in_key_millimetres(capsys: Capture) -> None:
    for reach in SAME:
        assert app.run(["plot", "--json", f"tracked{reach}.yaml", "g"]) == 0
        curves = [r for r in records(capsys) if r["event"] == "curve"]
        assert [curve["name"] for curve in curves] == ["asked", "done"]
        for curve in curves:
            assert max(x for x in curve["x_mm"] if x is not None) == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize("touch", ["open", "tracked"])
def test_lever_ergons_in_key_mass_speed_and_impulse(touch: str) -> None:
    result = []
    for reach in SAME:
        target = Path(f"{touch}{reach}.csv")
        assert app.run(["compile", "-q", f"{touch}{reach}.yaml", "-o", str(target)]) == 0
        lines = [line for line in target.read_text("utf-8").splitlines() if line[0] != "#"]
        result.append([[float(row[i]) for i in (0, 3, 4, 5)] for row in csv.reader(lines[1:])])
    first, ten = result
    assert len(first) == len(ten) > 20_000
    assert max(row[2] for row in first) > 1e-2
    for a, b in zip(first[::97], ten[::97], strict=True):
        assert b == pytest.approx(a, rel=1e-6, abs=1e-8)  # 1e-17 m of rounding, by rate and M/m


def test_lever_force_limit_and_strikes_from_scene(capsys: Capture) -> None:
    """A limit is the key's own, [N] on it; a strike from the scene is felt `reach` times."""
    result, struck = [], []
    for reach in SAME:
        text = Path(f"open{reach}.yaml").read_text("utf-8")
        text = text.replace("touch: open", "touch: open, force_limit: 0.08N")
        Path("limited.yaml").write_text(text, "utf-8")
        assert app.run(["check", "--simulate", "--json", "limited.yaml"]) == 0
        result.append(next(r for r in records(capsys) if r["event"] == "followed"))
        text = re.sub("players:.*parts:[^\n]*\n", "", text, flags=re.DOTALL)
        Path("struck.yaml").write_text(
            text + "strikes: {s: {to: k, at: 0.1, impulse: 4mNs}}\n", "utf-8"
        )
        assert app.run(["compile", "--json", "struck.yaml"]) == 0
        struck.append([r["impulse_n_s"] for r in records(capsys) if "impulse_n_s" in r])
    assert result[0]["missed"] == result[1]["missed"] > 100
    assert result[1]["strongest_m_s"] == pytest.approx(result[0]["strongest_m_s"], rel=1e-6)
    assert result[0]["strongest_m_s"] == pytest.approx(0.08 / 0.4 / 44100.0, rel=1e-9)
    assert struck[0] == pytest.approx([4e-3])
    assert struck[1] == pytest.approx([4e-2])
