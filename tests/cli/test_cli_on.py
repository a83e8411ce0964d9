"""`--on`: what is refused before any process begins, and what `ergon plan` says of the shares."""

import json
from pathlib import Path

import pytest

from ergon.api.work_shares import WorkPiece, share_out
from ergon.cli import app

GONGS = """\
ergon: 1
accuracy: {method: ca}
instruments:
  a: {modules: {p: {PLATE: {shape: hex, radius: 6, M: 50g, f: 300Hz, t60: 4s}}}, out: {SOX: p.3}}
  b: {modules: {p: {PLATE: {shape: hex, radius: 5, M: 50g, f: 300Hz, t60: 4s}}}, out: {SOX: p.3}}
  d: {BANK: {count: 2, f: 80Hz..1kHz, t60: 1s, M: 1g}, out: {SOX: d.all}}
strikes: {s: {to: [a.p.0, b.p.0, d.all], at: 0.1s, impulse: 1mNs}}
render: {tail: 0.1s}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("a.yaml").write_text(GONGS)
    return work_folder


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["render", "--on", "local:0"], "--on: local:0: the number is from 1 to 1024"),
        (["render", "--on", "here"], "--on: 'here' is neither local:N nor an address"),
        (["plan", "--on", "tcp://x y:1"], "is neither local:N nor an address"),
        (["render", "--on", "local:2", "--motion"], "--on: excludes --motion"),
        (["render", "--on", "local:2", "--trust"], "--on: excludes --trust"),
        (
            ["render", "--on", "local:2", "--freeze", "a"],
            "a journal and --freeze are computed here",
        ),
        (["sweep", "--on", "local:2", "--jobs", "2", "--vary", "seed=1,2"], "excludes --jobs"),
    ],
)
def test_on_option_refuses_mistakes(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert app.run([words[0], "a.yaml", *words[1:]]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in Path().iterdir()] == ["a.yaml"]


def test_plan_on_workers_shares_and_time_bound(capsys: pytest.CaptureFixture[str]):
    assert app.run(["plan", "a.yaml", "--on", "local:3"]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.startswith("on 3 workers: ")
    assert "a cannot be split" in line
    assert app.run(["plan", "a.yaml", "--on", "local:3", "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    rows = dict.fromkeys("abd", 0.0)
    for item in lines:
        if item["event"] == "plan_row":
            rows[item["parts"][0]] += item["cost"]
    (output,) = (item for item in lines if item["event"] == "shares")
    assert sorted(output["workers"]) == pytest.approx(sorted([rows["a"], rows["b"], 0.0]))
    assert output["home"] == pytest.approx(rows["d"])
    assert output["dearest"] == ["a"]
    assert output["bound"] == pytest.approx(sum(rows.values()) / rows["a"])


def test_share_out_loads_closed_form():
    single = [WorkPiece(("a",), 4.0), WorkPiece(("b",), 3.0), WorkPiece(("c", "d"), 2.0)]
    result = share_out(single, 10.0, 2)
    assert sorted(result.loads) == [4.0, 5.0]
    assert (result.home_load, result.total, result.largest_load, result.speedup_max) == (
        1.0,
        10.0,
        5.0,
        2.5,
    )
    assert result.costliest_piece == single[0]
    assert share_out([], 2.0, 4).largest_load == 2.0
