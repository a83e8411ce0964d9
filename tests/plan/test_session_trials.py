"""Plans of a session: contacts are computed as a trial of the hardest strikes decides."""

from collections.abc import Iterator

import numpy as np
import pytest
from trial_store import TrialStore

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.preparing import PreparedPiece, prepare
from ergon.scores.staging.trial_strikes import put_trial_strikes

# A bar that a mallet strikes, damped at one point, so that its modes are complex.
_BAR = """\
  bar{n}:
    modules:
      body: {{STRING: {{masses: 24, f: {f}Hz, M: 20g, t60: 2s}}}}
      ground: {{SOL: {{}}}}
      pad: {{FRO: {{between: [ground, body.3], Z: 0.5Ns/m}}}}
      mallet: {{CEL: {{M: 10g, f: 3Hz, t60: 0.1s}}}}
      felt: {{BUT: {{between: [mallet, body.5], K: 2e7, exponent: 2.3, gap: 0.2mm}}}}
    out: {{SOV: body.20}}
    play: {{strike: {{at: mallet, impulse: 2mNs..40mNs}}}}
"""
_RATE = 44_100


def _piece(count: int, strikes: str = "") -> Piece:
    bars = "".join(_BAR.format(n=n, f=110 + 40 * n) for n in range(count))
    routes = ", ".join(f"{{from: bar{n}, to: 1}}" for n in range(count))
    mix = f"mix: {{channels: 1, route: [{routes}]}}\n"
    loaded = load("bars.yaml", text=f"ergon: 1\ninstruments:\n{bars}{strikes}{mix}")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def _hit(impulse: str) -> str:
    return f"strikes: {{hit: {{to: bar0.mallet, at: 1|1, impulse: {impulse}}}}}\n"


def _open(piece: Piece, *, is_tried: bool = True) -> PreparedPiece:
    prepared = prepare(piece)
    prepared.timeline.open()
    if is_tried:
        put_trial_strikes(piece, prepared.built_network.assembly, prepared.timeline)
    return prepared


def _plan(prepared: PreparedPiece, like: _core.Plan | None = None) -> _core.Plan:
    return _core.Plan(prepared.network, prepared.timeline, cents=3.0, like=like)


def _steps(plan: _core.Plan) -> list[tuple[int, int]]:
    return [(choice.oversampling, choice.contact_substeps) for choice in plan.choices()]


def _sound(prepared: PreparedPiece, seconds: float) -> np.ndarray:
    plan = _plan(prepared)
    simulation = _core.Simulation(prepared.network, prepared.timeline, plan=plan, on_fault="mute")
    sound = np.zeros((int(seconds * _RATE), 1))
    simulation.process(sound)
    return sound


def test_session_contacts_by_trial():
    untried = _plan(_open(_piece(1), is_tried=False))
    assert _steps(untried) == [(1, 2)]
    tried = _plan(_open(_piece(1)))
    [(_, contact_substeps)] = _steps(tried)
    assert contact_substeps == 1
    assert "complex modes" in {row.what for row in tried.rows()}
    assert tried.trials.done > 10 * untried.trials.done  # beside the solution of its modes


def test_session_trial_of_an_earlier_plan():
    first = _plan(_open(_piece(2)))
    second = _plan(_open(_piece(2)), first)
    assert second.hash == first.hash
    assert second.trials.done < 0.5 * first.trials.done  # bodies alone
    smaller = _plan(_open(_piece(1)), second)
    assert _plan(_open(_piece(2)), smaller).hash == first.hash


def test_session_trial_beside_other_islands():
    alone = _steps(_plan(_open(_piece(1))))
    assert _steps(_plan(_open(_piece(3))))[:1] == alone


class _Recorder:
    """A timeline that only records what is declared."""

    def __init__(self) -> None:
        self.declared: list[tuple[int, float, float | None]] = []

    def trial_strike(self, mat: int, impulse: float, *, lasts: float | None) -> None:
        self.declared.append((mat, impulse, lasts))


@pytest.mark.parametrize(("impulse", "hardest"), [("30mNs", 0.04), ("90mNs", 0.09), ("ff", 0.04)])
def test_trial_strikes_of_instrument_and_score(impulse: str, hardest: float):
    piece = _piece(1, _hit(impulse))
    assembly, recorder = prepare(piece).built_network.assembly, _Recorder()
    put_trial_strikes(piece, assembly, recorder)  # type: ignore[arg-type]
    assert recorder.declared == [(assembly.mats["bar0", "mallet"], pytest.approx(hardest), None)]


def test_trial_strikes_of_bowed_parts():
    text = """\
ergon: 1
use: [instruments/friction.yaml]
mix: {channels: 1, route: [{from: saw, to: 1}]}
"""
    piece = load("bowed.yaml", text=text).piece
    assert piece is not None
    assert any(act.is_drawn for act in piece.instruments["saw"].acts)
    recorder = _Recorder()
    put_trial_strikes(piece, prepare(piece).built_network.assembly, recorder)  # type: ignore[arg-type]
    assert recorder.declared == []


def test_closed_timeline_without_trial_strikes():
    """A closed timeline plays none of them, and its plan tries none."""
    piece = _piece(1, _hit("mf"))
    plain, declared = prepare(piece), prepare(piece)
    put_trial_strikes(piece, declared.built_network.assembly, declared.timeline)
    sounds = [_sound(prepared, 0.5) for prepared in (plain, declared)]
    assert np.abs(sounds[0]).max() > 0.0
    assert np.array_equal(*sounds)


def _octaves_db(sound: np.ndarray) -> Iterator[float]:
    power = np.abs(np.fft.rfft(sound[:, 0])) ** 2
    frequency = np.fft.rfftfreq(len(sound), 1 / _RATE)
    for low in (88.0, 177.0, 354.0, 707.0, 1414.0, 2828.0):
        band = (frequency >= low) & (frequency < 2 * low)
        yield 10 * np.log10(power[band].sum())


@pytest.mark.parametrize("impulse", ["pp", "mf", "fff"])
def test_session_sound_by_trial_over_all_strengths(impulse: str):
    """Octaves within 1 dB of those with contacts between frames."""
    piece = _piece(1, _hit(impulse))
    fine, tried = _open(piece, is_tried=False), _open(piece)
    fine_db, tried_db = (
        np.array(list(_octaves_db(_sound(prepared, 0.6)))) for prepared in (fine, tried)
    )
    is_strong = fine_db > fine_db.max() - 60.0
    assert np.abs(fine_db - tried_db)[is_strong].max() < 1.0


def test_session_trial_from_a_store():
    store, prepared = TrialStore(), _open(_piece(1))
    first, second = (
        _core.Plan(prepared.network, prepared.timeline, cents=3.0, store=store) for _ in range(2)
    )
    assert store.n_found > 0
    assert first.hash == second.hash == _plan(prepared).hash
