"""Several scores by one call: the files of each by itself, whatever becomes of the others."""

import json
from pathlib import Path

import own_workers
import pytest
from patience import until

from ergon.api import cluster_worker
from ergon.cli import app
from ergon.rendering import remote, stretches

BELL = """\
ergon: 1
rates: {{audio: 8000Hz}}
accuracy: {{method: ca}}
instruments:
  a: {{modules: {{p: {{PLATE: {{shape: hex, radius: 2, M: 50g, f: {f}Hz, t60: 1s,
    hardening: 1e9N/m3}}}}}}, out: {{x: {{SOX: p.3}}}}}}
  b: {{modules: {{m: {{CEL: {{M: 2g, f: 440Hz, t60: 0.5s}}}}, n: {{CEL: {{M: 2g, f: 500Hz,
    t60: 0.5s}}}}, l: {{LNL: {{between: [m, n], law: "k*d + q*d**3", k: 20N/m, q: {q}N/m3}}}}}},
    out: {{x: {{SOX: m}}}}}}
strikes: {{s: {{to: [a.p.centre, b.m], at: 0.1s, impulse: {impulse}, every: 0.2s, times: 4}}}}
render: {{tail: {tail}s, bits: float}}
"""
FEW = {"f": 300, "q": "4e6", "impulse": "1mNs", "tail": 1}
NOT_STABLE = (
    "ergon: 1\nrates: {audio: 8000Hz}\n"
    "instruments: {a: {modules: {m: {MAS: {M: 1g}}, n: {MAS: {M: 1g}},"
    " r: {LNL: {between: [m, n], law: '1e9*d'}}}, out: {x: {SOX: m}}}}\n"
    "strikes: {s: {to: [a.m], at: 0s, impulse: 1mNs}}\nrender: {tail: 1s}\n"
)


@pytest.fixture(autouse=True)
def folder(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ERGON_CACHE", "plans")
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", 4096)
    monkeypatch.setattr(stretches, "_NS_PER_SAMPLE", 0.0)
    monkeypatch.setattr(cluster_worker, "_staged_jobs", [])
    Path("a.yaml").write_text(BELL.format(**FEW))
    Path("b.yaml").write_text(BELL.format(**FEW | {"f": 350}))
    Path("long.yaml").write_text(BELL.format(**FEW | {"tail": 4}))
    Path("wild.yaml").write_text(BELL.format(**FEW | {"q": "1e17", "impulse": "10Ns"}))
    Path("stiff.yaml").write_text(NOT_STABLE)
    return work_folder


def sounds(*paths: str) -> list[bytes]:
    return [Path(path).read_bytes() for path in paths]


@pytest.fixture
def each() -> list[bytes]:
    """What a render of each by itself writes."""
    for name in ("long", "a", "b"):
        assert app.run(["render", f"{name}.yaml", "-o", f"own/{name}.wav", "-q"]) == 0
    return sounds("own/long.wav", "own/a.wav", "own/b.wav")


@pytest.mark.parametrize("more", [(), ("--on", "local:2")])
def test_batch_render_files_equal_single_renders(
    each: list[bytes], more: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
):
    own_workers.use(monkeypatch)
    words = ["render", "long.yaml", "a.yaml", "b.yaml", *more]
    assert app.run([*words, "-n"]) == 0
    assert not list(Path().glob("*.wav"))
    assert app.run(words) == 0
    assert sounds("long.wav", "a.wav", "b.wav") == each
    assert app.run([*words, "-o", "made", "--stems", "parts"]) == 0
    assert sounds("made/long.wav", "made/a.wav", "made/b.wav") == each
    assert len(list(Path("parts").glob("*/*.wav"))) == 6


@pytest.mark.parametrize("more", [(), ("--on", "local:2")])
def test_batch_render_continues_after_a_failure(
    each: list[bytes],
    more: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    own_workers.use(monkeypatch)
    capsys.readouterr()
    words = ["render", *more, "-o", "made"]
    assert app.run([*words, "wild.yaml", "stiff.yaml", "a.yaml", "long.yaml"]) == 1
    output = capsys.readouterr().err
    assert "2 of 4 scores failed: " in output
    assert "wild.yaml:" in output
    assert "stiff.yaml:" in output
    assert "Traceback" not in output
    assert sorted(path.name for path in Path("made").iterdir()) == ["a.wav", "long.wav"]
    assert sounds("made/long.wav", "made/a.wav") == each[:2]
    # Of those that diverge alone the exit code says so.
    assert app.run([*words, "b.yaml", "wild.yaml", "--json"]) == 4
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["file"] for one in lines if one["event"] == "rendered"] == ["made/b.wav"]
    assert lines[-1]["message"] == "1 of 2 scores failed: wild.yaml"


def test_batch_render_shares_one_worker_queue(each: list[bytes], monkeypatch: pytest.MonkeyPatch):
    """What the first one asks for is computed only when another one has asked as well."""
    client = own_workers.use(monkeypatch)
    compute = cluster_worker.compute_stretch

    def jobs() -> set[str]:
        stretches = [words for function, words in client.called if function is late]
        return {words[0]["digest"] for words in stretches}

    def late(job: cluster_worker.Job, request: remote.Request) -> remote.Answer:
        until(lambda: len(jobs()) > 1, "another score")
        return compute(job, request)

    monkeypatch.setattr(cluster_worker, "compute_stretch", late)
    assert app.run(["render", "long.yaml", "a.yaml", "b.yaml", "--on", "local:2", "-q"]) == 0
    assert sounds("long.wav", "a.wav", "b.wav") == each
    assert len(jobs()) == 3
    assert len(cluster_worker._staged_jobs) == 3  # none had to be staged again


def test_cluster_worker_piece_cache_limit(monkeypatch: pytest.MonkeyPatch, each: list[bytes]):
    own_workers.use(monkeypatch)
    monkeypatch.setattr(cluster_worker, "MODULES_MAX", 10)
    assert app.run(["render", "long.yaml", "a.yaml", "b.yaml", "--on", "local:2", "-q"]) == 0
    assert len(cluster_worker._staged_jobs) == 1
    assert sounds("long.wav", "a.wav", "b.wav") == each


def same_name() -> list[str]:
    Path("more").mkdir()
    Path("more/a.yaml").write_text(BELL.format(**FEW))
    return ["a.yaml", "more/a.yaml"]


def mistaken() -> list[str]:
    Path("b.yaml").write_text("ergon: 1\ninstruments: {a: {modules: {m: {CAL: {}}}}}\n")
    return ["a.yaml", "b.yaml"]


def in_the_way() -> list[str]:
    Path("b.wav").write_text("a diary")
    return ["a.yaml", "b.yaml"]


@pytest.mark.parametrize(
    ("scores", "more", "code", "output"),
    [
        (same_name, [], 2, "a.yaml and more/a.yaml would both be written to a.wav"),
        (mistaken, [], 1, "b.yaml:2:"),
        (in_the_way, [], 2, "b.wav exists, and ergon has no record"),
        (
            lambda: ["a.yaml", "b.yaml"],
            ["-o", "a.yaml"],
            2,
            "a.yaml is a file; several scores need a folder",
        ),
        (lambda: ["a.yaml", "b.yaml"], ["-o", "-"], 2, "-o - is for one score"),
        (lambda: ["a.yaml", "b.yaml"], ["--freeze", "a"], 2, "--freeze is for one score"),
        (
            lambda: ["a.yaml", "b.yaml"],
            ["--plan", "x.plan"],
            2,
            "--plan: this option is for one score",
        ),
        (lambda: ["a.yaml", "-"], [], 2, "error: - cannot be rendered together with other scores"),
        (lambda: ["a.yaml", "x.jsonl"], [], 2, "x.jsonl cannot be rendered together"),
        (lambda: ["a.yaml", "none.yaml"], [], 1, "none.yaml cannot be read: No such file"),
        (lambda: ["a.yaml", "b.yaml"], ["--on", "local:2", "--motion"], 2, "excludes --motion"),
    ],
)
def test_batch_render_checks_scores_before_rendering(
    scores: object, more: list[str], code: int, output: str, capsys: pytest.CaptureFixture[str]
):
    names = scores()  # type: ignore[operator]
    assert app.run(["render", *names, *more]) == code
    assert output in capsys.readouterr().err
    assert not Path("a.wav").exists()
