"""Strings whose tension rises as they are stretched, against DOP853 on the same equations."""

import numpy as np
import pytest
from checked import check, check_reports
from scipy.integrate import solve_ivp
from sweep import few

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
MASSES, M, F, T60 = 30, 6e-3, 110.0, 3.0
Q = 3.6e8  # [N/m³]: a steel string of 1.1 mm and 65 cm in 31 gaps
SPEED = 12.0  # [m/s] of the struck masses: some 5 mm
SCORE = """\
ergon: 1
instruments:
  s:
    modules:
      body:
        STRING: {masses: 30, M: 6g, f: 110Hz, t60: 3s, ends: %s, stretching: %s,
                 V0: [{at: 4..9, v: 12m/s}]}
    out: {SOX: body.2}
accuracy: {%s}
render: {tail: 2s}
"""


def planned(text: str, n_frames: int) -> np.ndarray:
    simulation = stage(load("x.yaml", text=text).piece, planned=True).simulation
    out = np.zeros((n_frames, 1))
    simulation.process(out)
    return out[:, 0]


def exact(ends: str, q: float, n_frames: int) -> np.ndarray:
    """Kirchhoff and Carrier's string on a lattice: every link has k·d + z·ḋ + q·d·Σd²."""
    held = {"fixed": (1, 1), "left": (1, 0), "free": (0, 0)}[ends]
    path = np.zeros((MASSES - 1 + sum(held), MASSES))  # elongations from positions
    for link in range(len(path)):
        a, b = link - held[0], link - held[0] + 1
        if a >= 0:
            path[link, a] = -1.0
        if b < MASSES:
            path[link, b] = 1.0
    laplacian = path.T @ path
    mass = M / MASSES
    sigma = 3.0 * np.log(10.0) / T60
    values = np.linalg.eigvalsh(laplacian)
    k = mass * ((2.0 * np.pi * F) ** 2 + sigma**2) / values[values > 1e-9][0]
    z = 2.0 * sigma * k / ((2.0 * np.pi * F) ** 2 + sigma**2)

    def motion(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state[:MASSES], state[MASSES:]
        d = path @ x
        force = (k + q * (d @ d)) * (laplacian @ x) + z * (laplacian @ v)
        return np.concatenate([v, -force / mass])

    start = np.zeros(2 * MASSES)
    start[MASSES + 4 : MASSES + 10] = SPEED
    times = np.arange(n_frames) / RATE
    solved = solve_ivp(motion, (0.0, times[-1]), start, "DOP853", times, rtol=1e-11, atol=1e-14)
    return solved.y[2]


def error_db(sound: np.ndarray, wanted: np.ndarray) -> float:
    return float(20.0 * np.log10(np.linalg.norm(sound - wanted) / np.linalg.norm(wanted)))


@pytest.mark.parametrize("ends", few(["fixed", "left"], 1))
def test_stretched_string_against_kirchhoff_equation(ends):
    wanted = exact(ends, Q, 4410)
    linear = exact(ends, 0.0, 4410)
    assert error_db(linear, wanted) > -20.0  # its tension matters
    text = SCORE % (ends, f"{Q:g}N/m3", "error: -60dB")
    assert error_db(planned(text, 4410), wanted) < -60.0


@pytest.mark.parametrize(
    ("method", "most"), few([("ca", -30.0), ("ca2p", -60.0), ("bm4", -100.0)], 1)
)
def test_stretched_string_error_by_method(method, most):
    text = SCORE % ("fixed", f"{Q:g}N/m3", f"method: {method}")
    assert error_db(planned(text, 4410), exact("fixed", Q, 4410)) < most


def test_stretched_string_pitch_falls_during_decay():
    loud = planned(SCORE % ("fixed", f"{Q:g}N/m3", "method: bm4"), 88200)
    pitches = []
    for part in (loud[:22050], loud[-22050:]):
        spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part)), 16 * len(part)))
        low = 16 * len(part) * 100 // 44100
        pitches.append(low + int(np.argmax(spectrum[low : 2 * low])))
    cents = 1200.0 * np.log2(pitches[0] / pitches[1])
    assert 5.0 < cents < 200.0


def test_stretched_string_ledger_closes():
    piece = load("x.yaml", text=SCORE % ("fixed", f"{Q:g}N/m3", "method: ca")).piece
    simulation = stage(piece, ledger=True).simulation
    simulation.process(np.zeros((44100, 1)))
    energy = simulation.energy()
    balance = energy.start + energy.injected - energy.stored - energy.lost + energy.produced
    assert abs(balance) < 1e-11 * energy.flow
    assert energy.start > 0.9 * 0.5 * 6 * (M / MASSES) * SPEED**2
    assert 0.0 < abs(energy.produced) < 0.01 * energy.start


def test_wire_stretching_from_dimensions():
    wire = "{young: 200GPa, radius: 0.4mm, length: 65cm}"
    (module,) = check(SCORE % ("fixed", wire, "method: ca")).piece.instruments["s"].modules
    # E·A/(2·L·h²) with L in 31 gaps of h.
    wanted = 200e9 * np.pi * 0.4e-3**2 / (2.0 * 0.65 * (0.65 / 31) ** 2)
    assert module.fields["stretching"] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("stretching", "code"), [("-1N/m3", "E202"), ("1N", "E203"), ("{young: 1GPa}", "E103")]
)
def test_wrong_stretching_reports_its_code(stretching, code):
    assert code in [
        report[0] for report in check_reports(SCORE % ("fixed", stretching, "method: ca"))
    ]
