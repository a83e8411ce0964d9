"""What trials found of an island holds as long as nothing changes that they played."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest
import random_scores
from sweep import few

from ergon import _core
from ergon.api import score as scores
from ergon.api.options import AccuracyOptions
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.reading.piece import Piece
from ergon.scores.staging import planning
from ergon.scores.staging.planning import PlanWithNotes
from ergon.scores.staging.preparing import prepare

# Three islands, each with a player: a mesh that hardens, a string that rattles, a bell by a law.
SCORE = """\
ergon: 1
accuracy: {error: -50dB}
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}, k3: {like: k1}}
instruments:
  gong:
    modules:
      p: {PLATE: {shape: hex, radius: 2, M: 50g, f: 300Hz, t60: 1s, hardening: 1e8}}
      b: {BUT: {between: [k1, p.centre], K: 4kN/m, Z: 2Ns/m, gap: 2mm}}
    out: {SOX: p.5}
  wire:
    modules:
      s: {STRING: {masses: 12, M: 4g, f: D4, t60: 1s}}
      w: {SOL: {}}
      r: {BUT: {between: [w, s.6], K: 3e4N/m, Z: 0.02Ns/m, gap: 50um}}
      b: {BUT: {between: [k2, s.3], K: 2kN/m, gap: 2mm}}
    out: {SOX: s.8}
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}
      b: {LNL: {between: [k3, m], law: "-k*max(-d, 0)**1.5", k: 4e4}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2, lean: 0mm@0 smooth 4mm@1/4 smooth 0mm@3/4}
players: {ada: {key: k1}, remi: {key: k2}, mia: {key: k3}}
parts:
  ada: [{at: 1|1, play: knock}, {at: 2|1, play: knock}]
  remi: [{at: 1|1, play: knock}, {at: 2|2, play: knock}]
  mia: [{at: 1|2, play: lean}, {at: 2|3, play: knock}]
strikes:
  a: {to: [gong.p.1], at: 4s, impulse: 1mNs}
render: {tail: 0.1s}
"""


class Records:
    """A store in memory, which counts what is new and what is found."""

    def __init__(self, kept: Mapping[str, _core.TrialRecord] | None = None) -> None:
        self.kept = dict(kept or {})
        self.new: list[str] = []

    def get(self, key: str) -> _core.TrialRecord | None:
        return self.kept.get(key)

    def put(self, key: str, record: _core.TrialRecord) -> None:
        self.new.append(key)
        self.kept[key] = record

    def forget(self) -> None:
        pass


def piece_of(text: str) -> Piece:
    Path("a.yaml").write_text(text)
    return scores.piece_of(scores.read("a.yaml", AccuracyOptions(), None))


def planned(text: str, store: Records | None) -> PlanWithNotes:
    piece = piece_of(text)
    ready = prepare(piece)
    return planning.make_plan(ready.network, ready.timeline, piece.accuracy, store=store)


def plan_values(built: PlanWithNotes) -> tuple[object, ...]:
    """All that a plan says of itself."""
    plan = built.plan
    names = [name for name in dir(_core.PlanRow) if not name.startswith("_")]
    rows = [[getattr(row, name) for name in names] for row in plan.rows()]
    return plan.hash, rows, plan.choices(), plan.stay(), built.notes


@cache
def plan_of_score() -> tuple[tuple[object, ...], Mapping[str, _core.TrialRecord]]:
    """What the plan of SCORE says of itself, and what its trials found."""
    store = Records()
    return plan_values(planned(SCORE, store)), store.kept


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ERGON_CACHE", "off")


EDITS = [
    ("{at: 2|1, play: knock}", "{at: 2|1.5, play: lean}"),
    ("{at: 2|2, play: knock}", "{at: 2|1.5, play: lean}"),
    ("{at: 2|3, play: knock}", "{at: 3|1, play: lean}"),
    ("ada: [{at: 1|1, play: knock}", "ada: [{at: 1|1, play: lean}"),
    ("mia: [{at: 1|2, play: lean}", "mia: [{at: 1|1.5, play: lean}"),
    ("at: 4s, impulse: 1mNs", "at: 3s, impulse: 2mNs"),
    ("[gong.p.1]", "[gong.p.2]"),
    ("M: 2g, f: 440Hz", "M: 2g, f: 441Hz"),
]


@pytest.mark.parametrize(("old", "new"), few(EDITS, EDITS[1:2]))
def test_plan_of_edited_score_from_store_equals_fresh(old: str, new: str) -> None:
    edited = SCORE.replace(old, new)
    assert edited != SCORE
    first, saved = plan_of_score()
    store = Records(saved)
    built, fresh = planned(edited, store), planned(edited, None)
    assert plan_values(built) == plan_values(fresh)
    assert built.plan.trials == pytest.approx(fresh.plan.trials, rel=1e-9)
    # Two pilots of three are known; how long errors hold depends on what others leave to spend.
    assert len(store.new) <= 5
    assert plan_values(planned(SCORE, store)) == first


def test_plan_of_same_score_from_store_equals_fresh() -> None:
    first, saved = plan_of_score()
    assert plan_values(planned(SCORE, None)) == first
    store = Records(saved)
    again = planned(SCORE, store)
    assert (plan_values(again), again.is_kept, store.new) == (first, True, [])


@pytest.mark.slow
def test_plan_of_late_added_entry_needs_no_trials() -> None:
    text = SCORE.replace("accuracy: {error: -50dB}", "accuracy: {error: -20dB}")
    store = Records()
    planned(text, store)
    n_first = len(store.new)
    late = text.replace("{at: 2|3, play: knock}", "{at: 2|3, play: knock}, {at: 60|1, play: knock}")
    assert plan_values(planned(late, store)) == plan_values(planned(late, None))
    # Of how long the error of one island holds alone is something new.
    assert len(store.new) - n_first <= 2


@pytest.mark.parametrize("share", few([0.001, 0.01, 0.05, 0.2], [0.01]))
def test_plan_at_allowance_limit_from_store_equals_fresh(share: float) -> None:
    """An allowance that all islands share: what one takes less of, another has."""
    network, timeline = _prepared(SCORE)
    _, edited = _prepared(
        SCORE.replace("ada: [{at: 1|1, play: knock}", "ada: [{at: 1|1.1, play: lean}")
    )
    store = Records()
    for played in (timeline, edited, timeline, edited):
        saved = _core.Plan(network, played, error_db=-60.0, store=store, share=share)
        fresh = _core.Plan(network, played, error_db=-60.0, share=share)
        assert plan_values(PlanWithNotes(saved, Accuracy())) == plan_values(
            PlanWithNotes(fresh, Accuracy())
        )
        assert saved.trials == pytest.approx(fresh.trials, rel=1e-9)


def _prepared(text: str) -> tuple[_core.Network, _core.Timeline]:
    ready = prepare(piece_of(text))
    return ready.network, ready.timeline


# Each plans eight times: these take up to six seconds, some of the others a minute.
_SHORT = (0, 6, 9, 21)


@pytest.mark.parametrize("seed", few(range(24), _SHORT))
def test_plan_of_random_scores_from_store_equals_fresh(seed: int) -> None:
    built = random_scores.Score(seed)
    store = Records()
    first = planned(built.text, store)
    assert plan_values(planned(built.text, store)) == plan_values(first)
    assert plan_values(planned(built.text, None)) == plan_values(first)
    for old, new in (("impulse: 1mNs", "impulse: 2mNs"), ("4mm@40ms", "5mm@40ms")):
        edited = built.text.replace(old, new)
        assert plan_values(planned(edited, store)) == plan_values(planned(edited, None))


def test_plan_store_exceptions_propagate() -> None:
    class Broken(Records):
        def get(self, key: str) -> _core.TrialRecord | None:
            raise KeyboardInterrupt(key)

    network, timeline = _prepared(SCORE)
    with pytest.raises(KeyboardInterrupt):
        _core.Plan(network, timeline, store=Broken())
