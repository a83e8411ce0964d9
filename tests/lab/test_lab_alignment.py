"""One metric and one alignment for maps, charts and plans: outputs of position, speed and
acceleration are judged alike, and against the closed form of a struck oscillator.
"""

import math

import numpy as np
import pytest

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.workshop.lab import chart, map_catalogue, maps, metrics
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Score

RATE = 44_100.0
# Frames by which each output is late, and whether it is the position or one of its derivatives.
OUTPUTS = {"SOX": (0.0, 0), "SOV": (7.5, 1), "SOA": (8.0, 2)}
M, K, Z = 5e-3, 1.6e4, 0.02  # [kg], [N/m], [N·s/m]: 285 Hz
STRUCK, IMPULSE = 0.08, 2e-3  # [s], a whole number of frames at every rate; [N·s]
SECONDS = 0.3

OSCILLATOR = """
ergon: 1
instruments:
  a:
    modules:
      wall: {{SOL: {{}}}}
      m: {{MAS: {{M: 5g}}}}
      s: {{REF: {{between: [wall, m], K: 16kN/m, Z: 0.02Ns/m}}}}
    out: {{{output}: m}}
strikes: {{s: {{to: a.m, at: 0.08s, impulse: 2mNs, lasts: 0s}}}}
render: {{tail: 1s}}
"""
STRING = """
ergon: 1
title: string alone
instruments:
  a:
    modules:
      wire: {{STRING: {{masses: 40, M: 5g, f: 147Hz, t60: 3s}}}}
    out: {{{output}: wire.20}}
strikes: {{s: {{to: a.wire.5, at: 0.05s, impulse: 2mNs}}}}
render: {{tail: 1s}}
"""


def piece_of(text: str, output: str) -> Piece:
    piece = load("scene.yaml", text=text.format(output=output)).piece
    assert piece is not None
    return piece


def closed_form(t: np.ndarray, order: int) -> np.ndarray:
    """x = Im(J/(m·ω)·exp(λ·t)) with λ = -Z/2M + iω, and its derivatives."""
    damping = Z / (2.0 * M)
    omega = math.sqrt(K / M - damping**2)
    pole = complex(-damping, omega)
    shape: np.ndarray = np.imag(IMPULSE / (M * omega) * pole**order * np.exp(pole * t))
    return np.where(t >= 0.0, shape, 0.0)


@pytest.mark.parametrize("output", OUTPUTS)
def test_map_truth_is_closed_form_at_each_rate(output: str):
    """A derivative is late by frames of the rate at which it is heard, at each rate of a map."""
    late, order = OUTPUTS[output]
    springs = map_catalogue.maps_of_score(piece_of(OSCILLATOR, output), SECONDS, "ca")["springs"]
    for times in springs.ys:
        rate = RATE * times
        n_frames = round(SECONDS * rate)
        truth = springs.make_point(1.0, times).truth(n_frames)
        assert truth.frames is not None
        assert truth.change_db < -60.0
        expected = closed_form((np.arange(n_frames) - late) / rate - STRUCK, order)[:, None]
        # A derivative hears the kink of the stroke over its 17 frames.
        after = slice(round(STRUCK * rate) + 20, None)
        error = metrics.waveform_db(truth.frames[after], expected[after])
        assert error < -40.0, (times, error)
        # Half a frame beside it is another sound.
        beside = closed_form((np.arange(n_frames) - late - 0.5) / rate - STRUCK, order)[:, None]
        assert metrics.waveform_db(truth.frames[after], beside[after]) > error + 6.0, times


@pytest.mark.parametrize("output", OUTPUTS)
def test_maps_and_charts_judge_each_output_alike(output: str):
    piece = piece_of(STRING, output)
    springs = map_catalogue.maps_of_score(piece, 0.5, "ca")["springs"]
    spot = maps.compute_spot(springs, 1.0, 1.0)
    wanted = [*chart.settings(["ca", "modal"], ["f64"], 4)]
    measured = chart.measure(Score(piece), wanted, 0.5, "waveform", lambda done: None)
    point = next(p for p in measured.points if p.setting == Setting("ca", 1))
    assert point.early_db is not None
    assert spot.error_db == pytest.approx(point.early_db, abs=2.0)


def test_waveform_errors_to_each_end_beside_numpy():
    rng = np.random.default_rng(3)
    reference = np.cumsum(rng.normal(size=(500, 3)), axis=0) + np.array([0.0, 5.0, -1e3])
    sound = reference + rng.normal(size=(500, 3)) * [1e-3, 1e-2, 1e-4]
    ends = [0, 20, 100, 500]
    errors = _core.waveform_errors(sound, reference, ends)
    assert errors[0] == -math.inf
    for error, end in zip(errors[1:], ends[1:], strict=True):
        x = reference[:end] - reference[:end].mean(axis=0)
        ratio = np.linalg.norm((sound - reference)[:end], axis=0) / np.linalg.norm(x, axis=0)
        assert error == pytest.approx(20.0 * math.log10(ratio.max()), abs=1e-6)
    with pytest.raises(_core.EngineError, match="sound must be"):
        _core.waveform_errors(sound[:, :2].copy(), reference, ends)
