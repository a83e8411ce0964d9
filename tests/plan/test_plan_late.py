"""Parts that rest for long before they play: their trials begin where the rest ends."""

import numpy as np
import pytest
from planned_sound import planned
from sweep import crossed

from ergon import _core
from ergon.scores.reading.load import load
from ergon.workshop.lab import metrics
from ergon.workshop.lab.scene import NetworkAndTimeline, Score

RATE = 44_100.0
# A rest of half a minute: longer than any trial plays [s].
LATE = 30.0
KEY = """\
ergon: 1
keys: {k: {M: 200g, K: 0.5N/m, Z: 0.2Ns/m}}
instruments:
  s:
    modules:
      b: {STRING: {masses: 24, M: 4g, f: 196Hz, t60: 3s}}
      l: {BUT: {between: [k, b.5], K: 20kN/m, Z: 0.2Ns/m, gap: 1mm}}
    out: {SOX: b.17}
gestures: {press: 0mm@0 smooth 2mm@0.06s 0mm@0.2s}
players: {ada: {key: k}}
parts: {ada: [{at: WHEN, play: press}]}
mix: {channels: 1}
"""
STRUCK = """\
ergon: 1
instruments:
  s:
    modules:
      b: {PLATE: {shape: hex, radius: 4, f: 220Hz, t60: 2s, M: 60g, rim: fixed}}
      m: {CEL: {M: 5g, f: 1Hz, t60: 2s}}
      h: {BUT: {between: [m, b.centre], K: 2000kN/m, exponent: 1.5, gap: 2mm}}
    out: {SOX: b.8}
strikes: {a: {to: [s.m], at: WHEN, impulse: 5mNs}}
mix: {channels: 1}
"""


def errors(score: str, time: float, **budget: float) -> list[tuple[float, float]]:
    """What a plan says of errors [dB], and until when [s], where the event is at an instant."""
    piece = load("scene.yaml", text=score.replace("WHEN", f"{time}s")).piece
    assert piece is not None
    scene = Score(piece).build_at(RATE)
    rows = _core.Plan(scene.network, scene.timeline, **budget).rows()
    return [
        (row.error_db, row.error_s)
        for row in rows
        if row.error_db is not None and row.error_s is not None
    ]


@pytest.mark.parametrize(("score", "budget"), crossed([KEY, STRUCK], [{"error_db": -60.0}, {}]))
def test_late_event_error_equals_early_event_error(score: str, budget: dict[str, float]):
    soon, late = errors(score, 0.5, **budget), errors(score, LATE, **budget)
    assert soon
    assert len(late) == len(soon)
    for (soon_db, soon_s), (late_db, late_s) in zip(soon, late, strict=True):
        assert late_db == pytest.approx(soon_db, abs=1.5)
        assert late_s - soon_s == pytest.approx(LATE - 0.5, abs=0.01)


SWINGS_OUT = """\
ergon: 1
instruments:
  s:
    modules:
      m: {CEL: {M: 1.7g, f: 1.3kHz, t60: 0.5s, X0: 2mm}}
      l: {DRY: {to: m, F: 6.76N}}
    out: {SOX: m}
strikes: {a: {to: [s.m], at: 50ms, impulse: 0.3mNs}}
mix: {channels: 1}
"""


def test_plan_trial_of_part_at_rest_before_event():
    piece = load("scene.yaml", text=SWINGS_OUT).piece
    assert piece is not None
    scene = Score(piece).build_at(RATE)
    sounds = []
    for error_db in (-45.0, -80.0):
        plan = _core.Plan(scene.network, scene.timeline, error_db=error_db)
        sound = np.empty((round(0.35 * RATE), 1))
        _core.Simulation(scene.network, scene.timeline, plan=plan).process(sound)
        sounds.append(sound)
        if error_db == -45.0:
            # After the blow alone it is a small step of the mass, which CA misses by more.
            (choice,) = plan.choices()
            assert not choice.counted_cost
    rough, exact = sounds
    assert metrics.waveform_db(rough, exact) <= -45.0


HAMMERED = """\
ergon: 1
rates: {audio: 44.1kHz}
instruments:
  g:
    modules:
      s: {STRING: {masses: 40, M: 0.5g, f: 131Hz, t60: 3s, ends: fixed}}
      felt: {DRY: {to: s.20, F: 2N, static: 3.5N, speed: 20mm/s}}
    out: {o: {SOX: s.31}OTHERS}
strikes:
  a: {to: g.s.9, at: 50ms, impulse: 0.2mNs, lasts: 0s}
  b: {to: g.s.9, at: 400ms, impulse: 3mNs, lasts: 0s}
mix: {channels: 1}
"""


def hammered(others: str) -> NetworkAndTimeline:
    piece = load("scene.yaml", text=HAMMERED.replace("OTHERS", others)).piece
    assert piece is not None
    return Score(piece).build_at(RATE)


def played(scene: NetworkAndTimeline, plan: _core.Plan) -> np.ndarray:
    simulation = _core.Simulation(scene.network, scene.timeline, plan=plan)
    sound = np.empty((round(0.7 * RATE), simulation.n_out))
    simulation.process(sound)
    return sound


def test_plan_trial_of_first_audible_blow_after_friction():
    scene = hammered("")
    (by_ca,) = _core.Plan(scene.network, scene.timeline, method="ca").choices()
    pins = [by_ca._replace(oversampling=64)]
    exact = played(scene, _core.Plan(scene.network, scene.timeline, method="ca", pins=pins))
    for error_db in (-40.0, -60.0):
        plan = _core.Plan(scene.network, scene.timeline, error_db=error_db)
        error = metrics.waveform_db(played(scene, plan), exact)
        assert error < error_db
        stated = [row.error_db for row in plan.rows() if row.error_db is not None]
        assert error < max(stated) + 1.0
        # Not only the first blow, which moves nothing beyond the felt.
        assert all(row.error_s == pytest.approx(0.7, abs=0.01) for row in plan.rows())


def test_plan_treats_rounding_noise_as_silence():
    # The felt and what lies beyond it differ from run to run by as much as they move.
    scene = hammered(", near: {SOX: s.9}, felt: {SOX: s.20}")
    plan = _core.Plan(scene.network, scene.timeline, error_db=-60.0)
    rows = plan.rows()
    assert all(row.error_db is not None and row.error_db <= -60.0 for row in rows)
    (choice,) = plan.choices()
    assert (choice.counted_cost or 0) < 10_000


HARDENS = """\
ergon: 1
instruments:
  gong:
    modules:
      body: {PLATE: {shape: hex, radius: 2, f: F2, M: 60g, rim: fixed, hardening: HARDENING}}
    out: {SOV: body.7}
strikes:
  soft: {to: gong.body.3, at: 0, impulse: 1mNs}
  later: {to: gong.body.3, at: 3, impulse: LATER}
render: {tail: 1s}
"""


@pytest.mark.parametrize(
    ("hardening", "later", "stated_db"),
    [
        ("1e9N/m3", "5mNs", 3.0),
        ("1e9N/m3", "-5mNs", 3.0),
        ("1e9N/m3", "1.1mNs", None),
        ("0N/m3", "5mNs", None),
    ],
)
def test_harder_later_stroke_raises_the_stated_error(
    hardening: str, later: str, stated_db: float | None
):
    """The error was that of the soft stroke, and nothing said so."""
    text = HARDENS.replace("HARDENING", hardening).replace("LATER", later)
    _, plan = planned(text, error_db=-40.0)
    assert {row.harder_at for row in plan.rows()} == {stated_db}


KEYED = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  gong:
    modules:
      body: {PLATE: {shape: hex, radius: 6, f: F2, M: 60g, rim: fixed, hardening: 5e12N/m3}}
      mallet: {CEL: {M: 30g, f: 1Hz, t60: 2s}}
      head: {BUT: {between: [mallet, body.centre], K: 2e7, exponent: 1.5, gap: 7mm}}
      push: {BUT: {between: [k, mallet], K: 40kN/m, gap: 1mm}}
    out: {SOV: body.60}
gestures: {soft: 0mm@0 smooth 8mm@0.25s 0mm@0.5s, strong: 0mm@0 smooth 8mm@0.06s 0mm@0.2s}
players: {ada: {key: k}}
parts: {ada: [{at: 0, play: soft}, {at: 8, play: LATER}]}
"""


@pytest.mark.parametrize(("later", "stated_db"), [("soft", None), ("strong", 8.0)])
def test_plan_states_later_harder_key_stroke(later: str, stated_db: float | None):
    """Its trials play on, and may not come so far."""
    _, plan = planned(KEYED.replace("LATER", later))
    for row in plan.rows():
        assert row.error_s is not None
        assert row.error_s < 8.0
        assert row.harder_at == stated_db
