"""Drafts: planned with few trials, stable, and said to be drafts."""

from pathlib import Path

import pytest

from ergon.api.options import RenderOptions
from ergon.api.score import read, stage_piece
from ergon.cli import app
from ergon.exchange.wave import hash_samples
from ergon.rendering import memory, resumed
from ergon.scores.staging import planning

Capture = pytest.CaptureFixture[str]

# A string that rattles, and a stiff link that diverges at the score's rate.
SCORE = """\
ergon: 1
accuracy: {error: -60dB}
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  wire:
    modules:
      s: {STRING: {masses: 12, M: 4g, f: D4, t60: 1s}}
      w: {SOL: {}}
      r: {BUT: {between: [w, s.6], K: 3e4N/m, Z: 0.02Ns/m, gap: 50um}}
      b: {BUT: {between: [k1, s.3], K: 2kN/m, gap: 2mm}}
    out: {SOX: s.8}
  stiff:
    modules:
      a: {MAS: {M: 1g}}
      b: {MAS: {M: 1g}}
      c: {REF: {between: [a, b], K: 9e6N/m, Z: 0.1Ns/m}}
      l: {LNL: {between: [a, b], law: "-k*d", k: 10N/m}}
    out: {SOX: a}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
strikes: {a: {to: [stiff.a], at: 0s, impulse: 1mNs}}
render: {tail: 0.1s}
"""

STRUCK = """\
ergon: 1
instruments: {cimbal: {from: strings/dulcimer, notes: [D4]}}
strikes: {a: {to: cimbal.hammer, at: 0s, notes: D4, every: 1, impulse: 3mNs}}
mix: {route: [{from: cimbal, to: 1}]}
render: {tail: 0.1s}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ERGON_CACHE", "off")
    Path("a.yaml").write_text(SCORE)


def test_draft_render_with_few_trials_and_its_note(capsys: Capture) -> None:
    assert app.run(["render", "a.yaml", "--draft"]) == 0
    output = capsys.readouterr().err
    assert "draft, by the cheapest stable methods and few trials" in output
    assert "W403" not in output
    assert Path("a.wav").exists()


def test_draft_note_names_parts_without_trials(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "_DRAFT_WORK_SHARE", 0.0)
    assert app.run(["render", "a.yaml", "--draft"]) == 0
    assert "the error of k1 + wire is not measured" in capsys.readouterr().err


def test_draft_trials_against_plan_trials() -> None:
    """And they show that a hammer, at least here, needs no more steps than in a render."""
    from ergon.api import score as scores
    from ergon.api.options import AccuracyOptions

    Path("a.yaml").write_text(STRUCK)
    plans = []
    for is_draft in (True, False):
        options = AccuracyOptions(draft=is_draft)
        plan = scores.stage_piece(scores.read("a.yaml", options), options).stage.plan
        assert plan is not None
        plans.append(plan)
    draft, render = plans
    assert draft.trials.allowed == pytest.approx(0.05 * render.trials.allowed)
    assert 0.0 < draft.trials.done <= draft.trials.allowed
    substeps = [max(row.contact_substeps for row in plan.rows()) for plan in plans]
    assert substeps[0] <= substeps[1]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("ERGON_CACHE", "on")


@pytest.mark.usefixtures("cache")
def test_draft_recalls_an_earlier_render(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """A draft has the sound of a render from before the edit, at the accuracy of that render."""
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(memory, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(resumed, "_COST_SHARE_MIN", 0.0)
    Path("a.yaml").write_text(STRUCK)
    assert app.run(["render", "a.yaml", "-o", "full.wav"]) == 0
    Path("a.yaml").write_text(STRUCK.replace("to: 1}", "to: 1, gain: -3dB}"))
    capsys.readouterr()
    assert app.run(["render", "a.yaml", "-o", "draft.wav", "--draft"]) == 0
    shown = capsys.readouterr()
    assert "100% recalled" in shown.out + shown.err
    assert "planned as an earlier render" in shown.err
    monkeypatch.setenv("ERGON_CACHE", "off")
    assert app.run(["render", "a.yaml", "-o", "full.wav"]) == 0
    assert hash_samples(Path("draft.wav")) == hash_samples(Path("full.wav"))


def write_two_notes() -> None:
    Path("a.yaml").write_text(
        STRUCK.replace("notes: [D4]", "notes: [D4, A4]").replace("notes: D4", "notes: D4 A4")
    )


@pytest.mark.usefixtures("cache")
def test_draft_with_another_note_drafts_it_alone(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an earlier render planned is planned so again, and recalled."""
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(memory, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(resumed, "_COST_SHARE_MIN", 0.0)
    write_two_notes()
    text = Path("a.yaml").read_text()
    Path("a.yaml").write_text(text.replace("notes: D4 A4", "notes: D4"))
    assert app.run(["render", "a.yaml", "-o", "full.wav"]) == 0
    Path("a.yaml").write_text(text)
    capsys.readouterr()
    assert app.run(["render", "a.yaml", "-o", "draft.wav", "--draft", "--threads", "1"]) == 0
    shown = capsys.readouterr()
    assert "draft of cimbal.A4" in shown.err
    assert "all else is planned as an earlier render" in shown.err
    assert "0% recalled" not in shown.out + shown.err
    drafted = hash_samples(Path("draft.wav"))
    assert app.run(["render", "a.yaml", "-o", "draft.wav", "--draft"]) == 0
    assert hash_samples(Path("draft.wav")) == drafted


@pytest.mark.usefixtures("cache")
def test_render_after_draft_equals_one_from_scratch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that a draft stores changes an exact render."""
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(memory, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(resumed, "_COST_SHARE_MIN", 0.0)
    write_two_notes()
    for _ in range(2):
        assert app.run(["render", "a.yaml", "-o", "draft.wav", "--draft"]) == 0
    assert app.run(["render", "a.yaml", "-o", "after.wav"]) == 0
    monkeypatch.setenv("ERGON_CACHE", "off")
    assert app.run(["render", "a.yaml", "-o", "scratch.wav"]) == 0
    assert hash_samples(Path("after.wav")) == hash_samples(Path("scratch.wav"))


@pytest.mark.usefixtures("cache")
def test_draft_with_another_instrument_runs_few_trials() -> None:
    """What no earlier render has planned is planned for its cost."""
    Path("a.yaml").write_text(STRUCK)
    assert app.run(["render", "a.yaml", "-o", "full.wav"]) == 0
    write_two_notes()
    options = RenderOptions(draft=True)
    staged = stage_piece(read("a.yaml"), options, recalls_sound=True).stage
    assert staged.is_draft
    assert staged.plan is not None
    assert staged.plan.trials.done <= staged.plan.trials.allowed
    Path("a.yaml").write_text(STRUCK)
    staged = stage_piece(read("a.yaml"), options, recalls_sound=True).stage
    assert not staged.is_draft


@pytest.mark.parametrize("other", [["--error", "-40dB"], ["--method", "ca"], ["--cents", "3"]])
def test_draft_option_excludes_accuracy_options(other: list[str], capsys: Capture) -> None:
    assert app.run(["render", "a.yaml", "--draft", *other]) == 2
    assert f"excludes {other[0]}" in capsys.readouterr().err
