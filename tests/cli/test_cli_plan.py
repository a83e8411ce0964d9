"""`ergon plan`, and renders by the plan that it wrote."""

import json
from pathlib import Path

import pytest
from commands import records

from ergon.cli import app
from ergon.exchange.wave import hash_samples, read_info
from ergon.scores.reading.outputs import METHODS

Capture = pytest.CaptureFixture[str]

# A struck string nobody touches, a gong that is heard, one that is not, a bell that a key strikes,
# and a drum that nothing moves.
SCORE = """\
ergon: 1
title: Some of everything
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  wire: {modules: {s: {STRING: {masses: 24, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.17}}
  gong:
    modules: {p: {PLATE: {shape: hex, radius: 2, M: 50g, f: 900Hz, t60: 1s, hardening: 1e10}}}
    out: {SOX: p.centre}
  deaf: {modules: {m: {CEL: {M: 1g, f: 200Hz, t60: 1s}}}}
  drum: {modules: {m: {CEL: {M: 1g, f: 300Hz, t60: 1s}}}, out: {SOX: m}}
  sky: {modules: {b: {BANK: {count: 40, M: 1g, f: 200Hz..4kHz, t60: 1s}}}, out: {SOX: b.all}}
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
strikes:
  a: {to: [wire.s.3, deaf.m], at: 0.1s, impulse: 1mNs}
  b: {to: [sky.b.all], at: 0.1s, impulse: 1uNs}
  c: {to: [gong.p.centre], at: 0.05s, impulse: 3mNs}
render: {tail: 0.5s, bits: float}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    (work_folder / "all.yaml").write_text(SCORE)
    return work_folder


def rows(capsys: Capture, *options: str) -> dict[str, dict]:
    """The rows of a plan by their first part; those of islands by what is in them."""
    assert app.run(["plan", "all.yaml", "--json", *options]) == 0
    records_read = records(capsys)
    assert [row["event"] for row in records_read][-1] == "plan"
    return {"+".join(row["parts"]): row for row in records_read if row["event"] == "plan_row"}


def test_plan_rows_by_kind_of_part(capsys: Capture) -> None:
    records_read = rows(capsys, "--error", "-60dB")
    assert records_read["wire"]["what"] == "modes"
    assert records_read["wire"]["modes"] <= records_read["wire"]["modes_of"] == 24
    assert (records_read["sky"]["what"], records_read["sky"]["n_mat"]) == ("oscillators", 40)
    assert records_read["deaf"]["what"] == "unheard"
    assert records_read["drum"]["what"] == "still"
    assert records_read["k1+bell"]["what"] == "stepped"
    assert records_read["k1+bell"]["error_db"] <= -60.0
    assert records_read["gong"]["error_db"] <= -60.0
    assert all(
        row["certificate"] == "proved" for row in (records_read["wire"], records_read["sky"])
    )


def test_plan_method_for_all_parts(capsys: Capture) -> None:
    assert {row["what"] for row in rows(capsys, "--method", "ca").values()} == {
        "stepped",
        "unheard",
        "still",
    }
    assert rows(capsys, "--method", "bm4")["gong"]["what"] == "bm4"
    assert rows(capsys, "--method", "modal")["wire"]["modes"] == 24


def test_plan_table_and_why_option(capsys: Capture) -> None:
    assert app.run(["plan", "all.yaml"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].split() == [
        *("part", "modules", "computed", "error", "pitch,", "T60,", "third", "octaves,", "strokes"),
        *("cost", "stable", "left", "out"),
    ]  # fmt: skip
    assert "× real time on one core by the table" in out
    assert app.run(["plan", "all.yaml", "--why", "deaf.m"]) == 0
    assert "No output listens to it" in capsys.readouterr().out
    assert app.run(["plan", "all.yaml", "--why", "gongg"]) == 2
    assert "did you mean 'gong'?" in capsys.readouterr().err


def test_render_with_plan_file_equals_render_with_error(capsys: Capture) -> None:
    exact = ["--error", "-100dB"]
    assert app.run(["plan", "all.yaml", *exact, "-o", "all.json"]) == 0
    assert app.run(["render", "all.yaml", *exact, "-o", "a.wav"]) == 0
    assert app.run(["render", "all.yaml", "--plan", "all.json", "-o", "b.wav"]) == 0
    assert app.run(["render", "all.yaml", "-o", "c.wav"]) == 0
    a, b, c = (hash_samples(Path(name)) for name in ("a.wav", "b.wav", "c.wav"))
    assert a == b != c
    output = json.loads(Path("all.json").read_text())["hash"]
    assert read_info(Path("a.wav")).plan == read_info(Path("b.wav")).plan == output
    capsys.readouterr()
    assert app.run(["info", "a.wav"]) == 0
    assert f"plan:    sha256 {output}" in capsys.readouterr().out


# Four masses in a row: every method has a plan of its own for them.
ROW = """\
ergon: 1
title: A row
instruments:
  s:
    modules:
      e: {SOL: {}}
      a: {MAS: {M: 1g, X0: 1mm}}
      b: {MAS: {M: 1g}}
      c: {MAS: {M: 1g}}
      d: {MAS: {M: 1g}}
      r1: {REF: {between: [e, a], K: 1e5}}
      r2: {REF: {between: [a, b], K: 1e5}}
      r3: {REF: {between: [b, c], K: 1e5}}
      r4: {REF: {between: [c, d], K: 1e5}}
    out: {SOX: b}
render: {tail: 0.05s, bits: float}
"""


@pytest.mark.parametrize(
    "asked",
    [
        *(["--method", method] for method in METHODS),
        ["--error", "-60dB"],
        ["--cents", "1"],
        [],
    ],
)
def test_render_with_a_plan_file_equals_render_with_its_options(
    asked: list[str], capsys: Capture
) -> None:
    """Whatever was asked for when it was written; the score asks for nothing."""
    Path("row.yaml").write_text(ROW)
    assert app.run(["plan", "row.yaml", *asked, "-o", "row.json"]) == 0
    assert app.run(["render", "row.yaml", *asked, "-o", "a.wav"]) == 0
    assert app.run(["render", "row.yaml", "--plan", "row.json", "-o", "b.wav"]) == 0
    assert hash_samples(Path("a.wav")) == hash_samples(Path("b.wav"))
    assert read_info(Path("a.wav")).plan == read_info(Path("b.wav")).plan
    capsys.readouterr()


def test_plan_file_for_cpu_share_render(capsys: Capture) -> None:
    """It was made for the error that the share allows."""
    Path("row.yaml").write_text(ROW.replace("render:", "accuracy: {cpu: 80%}\nrender:"))
    assert app.run(["plan", "row.yaml", "-o", "row.json"]) == 0
    assert json.loads(Path("row.json").read_text())["budget"] == {"error": -80.0}
    assert app.run(["render", "row.yaml", "-o", "a.wav"]) == 0
    assert app.run(["render", "row.yaml", "--plan", "row.json", "-o", "b.wav"]) == 0
    assert hash_samples(Path("a.wav")) == hash_samples(Path("b.wav"))
    capsys.readouterr()


def test_plan_file_without_budget_render(capsys: Capture) -> None:
    """Files of earlier versions name none."""
    Path("row.yaml").write_text(ROW.replace("render:", "accuracy: {method: ca}\nrender:"))
    assert app.run(["plan", "row.yaml", "-o", "row.json"]) == 0
    result = json.loads(Path("row.json").read_text())
    assert result.pop("budget") == {"method": "ca"}
    Path("row.json").write_text(json.dumps(result))
    assert app.run(["render", "row.yaml", "--plan", "row.json", "-o", "b.wav"]) == 0
    capsys.readouterr()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not a plan"),
        ('{"ergon_plan": 2, "choices": [], "budget": {"method": 3}}', "its budget is not valid"),
        (
            '{"ergon_plan": 2, "choices": [], "budget": {"error": -9, "cents": 3}}',
            "its budget is not valid",
        ),
        ('{"ergon_plan": 2, "choices": [], "budget": [NaN]}', "its budget is not valid"),
        ('{"ergon_plan": 2, "choices": [], "budget": {"method": "rk4"}}', "no method 'rk4'"),
        ('{"ergon_plan": 1, "choices": []}', "not a plan of version 2"),
        ('{"ergon_plan": 2, "choices": [[1, 2]]}', "whole numbers"),
        ('{"ergon_plan": 2, "choices": [[1, 1, 1, [[-1]], 0]]}', "whole numbers"),
        ('{"ergon_plan": 2, "choices": []}', "another score"),
        ('{"ergon_plan": 2, "choices": [[27, 1, 1, [[3, 900]], null]]}', "another score"),
        ("[" * 100_000, "not a plan"),
    ],
)
def test_render_with_unfit_plan_writes_no_file(text: str, says: str, capsys: Capture) -> None:
    Path("bad.json").write_text(text)
    assert app.run(["render", "all.yaml", "--plan", "bad.json", "-o", "x.wav"]) in (1, 2)
    assert says in capsys.readouterr().err
    assert not Path("x.wav").exists()


def test_plan_above_cpu_budget_warns_w402(capsys: Capture) -> None:
    expensive = SCORE.replace("render:", "accuracy: {error: -120dB, cpu: 0.5%}\nrender:")
    Path("dear.yaml").write_text(expensive)
    assert app.run(["plan", "dear.yaml"]) == 0
    err = capsys.readouterr().err
    assert "warning[W402]" in err
    assert "dB fits" in err or "the cheapest plan takes" in err


def test_plan_cost_stays_within_a_cpu_budget(capsys: Capture) -> None:
    costs = []
    for cpu in ("100%", "3%"):
        text = SCORE.replace("render:", f"accuracy: {{cpu: {cpu}}}\nrender:")
        Path("all.yaml").write_text(text)
        costs.append(sum(row["cost"] for row in rows(capsys).values()))
    assert costs[1] <= 0.03
    assert costs[1] <= costs[0] <= 1.0


def test_plan_refuses_contradicting_options(capsys: Capture) -> None:
    assert app.run(["plan", "all.yaml", "--error", "-60dB", "--cents", "3"]) == 2
    assert "give one of method, error and cents" in capsys.readouterr().err
    assert app.run(["plan", "all.yaml", "--error", "60"]) == 2
    assert app.run(["plan", "all.yaml", "--method", "bm5"]) == 2
    assert "did you mean 'bm4'?" in capsys.readouterr().err
