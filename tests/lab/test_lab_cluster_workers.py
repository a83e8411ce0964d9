"""Points of charts and maps by workers: the figures of one machine, but for what took time."""

import csv
from pathlib import Path

import own_workers
import pytest
from sweep import few

from ergon.cli import app
from ergon.workshop.lab import chart, cluster_workers, pictures

SCORE = """\
ergon: 1
rates: {audio: 8000Hz}
instruments:
  a: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}, n: {CEL: {M: 2g, f: 500Hz, t60: 0.5s}},
    r: {REF: {between: [m, n], K: 100N/m}},
    b: {BUT: {between: [m, n], K: 100N/m, gap: 1um}}}, out: {x: {SOX: m}}}
strikes: {s: {to: [a.m], at: 0.01s, impulse: 1mNs}}
render: {tail: 0.06s}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> own_workers.Client:
    """Tables alone are compared; pictures take as long as all of them."""
    Path("a.yaml").write_text(SCORE)
    monkeypatch.setattr(pictures, "save", lambda *_, **__: [])
    return own_workers.use(monkeypatch)


def table(path: str) -> list[dict[str, str]]:
    lines = Path(path).read_text().splitlines()
    return list(csv.DictReader(line for line in lines if line[0] != "#"))


@pytest.mark.parametrize("metric", few(["waveform", "energy"], ("waveform",)))
def test_chart_by_workers_equals_local_chart(metric: str, folder: own_workers.Client):
    words = ["chart", "a.yaml", "--seconds", "0.05", "--upto", "2", "--metric", metric]
    words += ["--methods", "ca,bm4,modal", "--error", "-60dB", "-q"]
    assert app.run([*words, "-o", "one"]) == 0
    assert app.run([*words, "-o", "two", "--on", "local:2"]) == 0
    first, two = table("one.csv"), table("two.csv")
    assert len(first) == 8
    assert {words[2]["method"] for _, words in folder.called} == {"ca", "bm4", "modal", None}
    assert len(folder.called) == 8
    for here, there in zip(first, two, strict=True):
        # Which of two is best for its cost depends on the costs.
        measured = ("cost", "on_front")
        assert {name: x for name, x in here.items() if name not in measured} == {
            name: x for name, x in there.items() if name not in measured
        }
        assert (here["cost"] == "") == (there["cost"] == "")
    assert any(row["cost"] for row in two)
    assert "by workers (local:2), costs scaled by a reference" in Path("two.csv").read_text()


def test_worker_costs_scaled_to_local_seconds(monkeypatch: pytest.MonkeyPatch):
    """A worker that takes three times as long, for the yardstick too, tells the same cost."""
    setting, content = chart.Setting("ca"), {"score": "", "root": "", "files": {}}

    def slow(*asked: object) -> dict[str, object]:
        point = {"status": "ok", "reason": "", "cost": 3 * 0.02}
        return {"point": point, "samples": bytes(80), "n_channels": 1, "yardstick": 3 * 0.5}

    monkeypatch.setattr(cluster_workers, "play", slow)
    monkeypatch.setattr(cluster_workers, "yardstick", lambda: 0.5)
    with elsewhere_cluster() as cluster:
        (result,) = cluster_workers.Workers(cluster, content).play_settings(
            [setting], 10, has_energy=False
        )  # type: ignore[arg-type]
    assert result.point.cost == pytest.approx(0.02)
    assert result.sound is not None
    assert result.sound.shape == (10, 1)


def elsewhere_cluster():  # type: ignore[no-untyped-def]
    from ergon.api import cluster
    from ergon.common.report import Report

    return cluster.open_cluster("local:2", Report())


@pytest.mark.parametrize(
    ("words", "n_columns"),
    [
        (["a.yaml", "--maps", "springs", "--seconds", "0.05", "--accurate", "-30"], 11),
        pytest.param(["--maps", "cell", "--method", "ieq"], 25, marks=pytest.mark.slow),
    ],
)
def test_stability_maps_by_workers_equal_local(
    words: list[str], n_columns: int, folder: own_workers.Client
):
    assert app.run(["stability", *words, "-q", "-o", "one"]) == 0
    assert app.run(["stability", *words, "-q", "-o", "two", "--on", "local:2"]) == 0
    assert Path("one.csv").read_text() == Path("two.csv").read_text()
    assert len(folder.called) == n_columns
    assert len(table("one.csv")) > n_columns


def test_on_option_excludes_trust(capsys: pytest.CaptureFixture[str]):
    for name in ("chart", "stability"):
        assert app.run([name, "a.yaml", "--on", "local:2", "--trust", "-o", "x"]) == 2
        assert "--on excludes --trust" in capsys.readouterr().err
