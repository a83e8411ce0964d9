"""`noise` of laws: beside its definition in Python, its moments in closed form, and as breath."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from docs.generators.noise_level import noise_level, stands_out
from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

Samples = NDArray[np.float64]

RATE = 44_100
HERE = Path(__file__).parents[2] / "instruments" / "library" / "here.yaml"
SCALE = np.sqrt(60.0 / 11.0)  # heights of variance 1/3, of which the spline has 11/20
MASK = (1 << 64) - 1


def height(n: int) -> float:
    """SplitMix64 of a whole number, from -1 to 1; 1 beside 0."""
    if abs(n) <= 1:
        return 1.0
    z = n * 0x9E3779B97F4A7C15 & MASK
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & MASK
    z = (z ^ z >> 27) * 0x94D049BB133111EB & MASK
    return ((z ^ z >> 31) >> 11) / 2.0**52 - 1.0


def noise(x: Samples) -> Samples:
    """The quadratic B-spline of the heights, as a sum over all pieces that reach a place."""

    def spline(t: float) -> float:
        t = abs(t)
        if t < 0.5:
            return 0.75 - t * t
        return 0.5 * (1.5 - t) ** 2 if t < 1.5 else 0.0

    def value(place: float) -> float:
        first = int(np.floor(place)) - 2
        return sum(height(n) * spline(place - n) for n in range(first, first + 6))

    return SCALE * np.array([value(float(place)) for place in x])


def forces(law: str, constants: str, seconds: float) -> Samples:
    """What a law gives at a mass so heavy that it stays, while eddies pass at 10 mm/s."""
    text = f"""\
ergon: 1
instruments:
  x:
    modules:
      mouth: {{SOL: {{}}}}
      eddies: {{MAS: {{M: 1g, V0: 10mm/s}}}}
      m: {{MAS: {{M: 1000kg}}}}
      jet: {{LNL: {{between: [mouth, m], damping: '{law}', {constants},
        follows: {{e: {{of: eddies, from: 0, to: 1e6, span: 1m}}}}}}}}
    out: {{SOF: jet}}
render: {{tail: {seconds}s, bits: float}}
"""
    piece = load(HERE, text=text).piece
    assert piece is not None
    simulation = stage(piece).simulation
    out = np.zeros((int(seconds * RATE), simulation.n_out))
    simulation.process(out)
    return -out[:, 0]  # the force on its second end


def test_noise_law_equals_its_definition():
    places = np.concatenate([np.linspace(-9.0, 9.0, 181), [1e6 + 0.3, -7e8 + 0.77, 3e12 + 0.25]])
    law = _core.Law("noise(d)", None, {}, None, 1.0)
    ours = np.array([law.force(float(place), 0.0) for place in places])
    assert np.abs(ours - noise(places)).max() < 1e-12


def test_noise_force_equals_frozen_eddies():
    """Sample by sample, at the places where the eddies are."""
    ours = forces("F*u*r*noise(e)", "F: 2, u: 0.3, r: 0.15", 0.05)
    places = 10e-3 * 1e6 * np.arange(len(ours)) / RATE
    exact = 2.0 * 0.3 * 0.15 * noise(places)
    lag = min((0, 1), key=lambda lag: np.abs(ours[lag:] - exact[: len(ours) - lag]).max())
    difference = ours[lag:] - exact[: len(ours) - lag]
    assert np.abs(np.abs(ours).max() - np.abs(exact).max()) < 1e-6
    assert np.abs(difference).max() < 1e-6


def test_noise_variance_and_spectrum_closed_form():
    """Variance (F·u·r)², and power by sinc⁶ of the frequency over the rate of eddies, 10 kHz."""
    force = forces("F*u*r*noise(e)", "F: 2, u: 0.3, r: 0.15", 8.0)[RATE // 100 :]
    rms = 2.0 * 0.3 * 0.15
    assert np.var(force) == pytest.approx(rms**2, rel=0.03)
    n = 4096
    pieces = force[: len(force) // n * n].reshape(-1, n) * np.hanning(n)
    power = np.mean(np.abs(np.fft.rfft(pieces)) ** 2, axis=0)
    power /= np.sum(np.hanning(n) ** 2) * RATE / 2.0  # a density, both sides as one [N²/Hz]
    f = np.fft.rfftfreq(n, 1.0 / RATE)
    eddies = 1e4
    density = 2.0 * (rms * SCALE) ** 2 / 3.0 / eddies * np.sinc(f / eddies) ** 6
    for low in (300.0, 1000.0, 2000.0, 3000.0, 4000.0):
        band = (f > low) & (f < low + 400.0)
        assert power[band].mean() == pytest.approx(density[band].mean(), rel=0.12)


def test_noise_grows_with_pressure():
    loud, soft = (forces("F*u*r*noise(e)", f"F: 2, u: {u}, r: 0.15", 0.5) for u in (0.4, 0.1))
    assert np.std(loud) / np.std(soft) == pytest.approx(4.0, rel=1e-9)


FLUTES = """\
ergon: 1
use: [instruments/winds.yaml]
instruments: {x: {from: winds/flute, notes: [A4, D5]}}
strikes: {s: {to: x.A4, at: 0s, impulse: mf}, t: {to: x.D5, at: 0s, impulse: f}}
mix: {channels: 2, route: [{from: x.A4, to: 1}, {from: x.D5, to: 2}]}
render: {tail: 1.5s, bits: float}
"""


def blown(threads: int = 1, text: str = FLUTES) -> Samples:
    piece = load(HERE, text=text).piece
    assert piece is not None
    simulation = stage(piece, planned=True, threads=threads).simulation
    out = np.zeros((RATE, simulation.n_out))
    simulation.process(out)
    return out


def test_breath_bytes_on_any_thread_count():
    assert blown(1).tobytes() == blown(2).tobytes() == blown(2).tobytes()


def test_breath_of_two_notes_is_not_alike():
    """Eddies pass by the pressure of each note, so the noises of a chord do not add up as one."""
    high = np.fft.rfft(blown()[RATE // 2 :].T * np.blackman(RATE - RATE // 2))
    f = np.fft.rfftfreq(RATE - RATE // 2, 1.0 / RATE)
    between = (f > 1500.0) & (np.abs(f / 440.0 % 1.0 - 0.5) < 0.1)
    between &= np.abs(f / 587.33 % 1.0 - 0.5) < 0.2
    a, b = high[:, between]
    alike = abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)
    assert alike < 0.2


@pytest.mark.parametrize(
    ("name", "f", "low", "high"),
    [
        ("clarinet", 146.83, -42.0, -31.0),
        ("oboe", 233.08, -42.0, -31.0),
        ("flute", 440.0, -44.0, -32.0),
        ("trumpet", 466.16, -52.0, -40.0),
        ("voice", 220.0, -30.0, -18.0),
    ],
)
def test_breath_level_beside_partials(name: str, f: float, low: float, high: float):
    text = f"""\
ergon: 1
use: [instruments/winds.yaml]
instruments: {{x: {{from: winds/{name}}}}}
strikes: {{s: {{to: x, at: 0s, impulse: mf}}}}
render: {{tail: 1.5s}}
"""
    steady = blown(text=text)[int(0.4 * RATE) : int(0.95 * RATE), 0]
    assert low < noise_level(steady, RATE, f) < high


@pytest.mark.parametrize("level", [-20.0, -40.0, -60.0])
def test_noise_level_of_known_noise(level: float):
    """Three partials and white noise up to half the rate, of which a share lies below 16 kHz."""
    t = np.arange(RATE) / RATE
    tone = sum(np.sin(2.0 * np.pi * 300.3 * k * t) / k for k in (1, 2, 3))
    white = np.random.default_rng(1).normal(size=RATE)
    share = (16_000.0 - 50.0) / (RATE / 2.0)
    white *= np.std(tone) * 10.0 ** (level / 20.0) / np.sqrt(share)
    assert noise_level(tone + white, RATE, 300.0) == pytest.approx(level, abs=0.5)


def test_noise_is_no_partial():
    t = np.arange(RATE) / RATE
    x = np.sin(2.0 * np.pi * 400.0 * t) + 0.01 * np.random.default_rng(2).normal(size=RATE)
    magnitude = np.abs(np.fft.rfft(x * np.hanning(RATE)))
    f = np.fft.rfftfreq(RATE, 1.0 / RATE)
    assert stands_out(f, magnitude, 400.0)
    assert not any(stands_out(f, magnitude, place) for place in np.arange(700.0, 9000.0, 130.0))
