"""The winds of the library: beside DOP853, in tune, and blown by strength."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from sweep import few

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

Samples = NDArray[np.float64]

LIBRARY = Path(__file__).parents[2] / "instruments" / "library" / "winds.yaml"
WINDS: dict[str, Any] = yaml.load(LIBRARY.read_text(encoding="utf-8"), yaml.BaseLoader)
RATE = 44_100.0
MASSES, M, F, T60 = 8, 4e-3, 200.0, 0.4  # of a small bore


def planned(text: str, n_frames: int) -> Samples:
    piece = load(LIBRARY.with_name("here.yaml"), text="ergon: 1\n" + text).piece
    assert piece is not None
    simulation = stage(piece, planned=True).simulation
    out = np.zeros((n_frames, simulation.n_out))
    simulation.process(out)
    return out[:, 0]


def law(name: str, link: str) -> str:
    """The damping of a link that the library's act `blow` brings, without its noise."""
    body = WINDS["instruments"][name]["play"]["blow"]["with"][link]["LNL"]
    return f"damping: '{body['damping']}', F: {body['F']}, g: 1, r: 0, e: 0"


def reed_flow(v: float, u: float) -> float:
    """Flow through a slit that pressure closes (McIntyre, Schumacher and Woodhouse, 1983)."""
    across, shutting = v - u, 0.045 + 1.2 * u
    opening = max(0.0, 1.0 + min(0.0, across) / shutting)
    return 1.0 * opening * across / np.sqrt(0.02 + abs(across) / shutting)


def jet_flow(v: float, u: float) -> float:
    return -2.2 * u * np.tanh(v / (u + 1e-4) + 1.1)


def exact(
    n_held: int, place: int, flow: Callable[[float, float], float], u: float, n_frames: int
) -> Samples:
    """Positions of the first mass of a row, held at its left end or at both, that is blown."""
    path = np.diff(np.eye(MASSES + 2), axis=0)[: MASSES + n_held - 1, 1 : MASSES + 1]
    laplacian, mass = path.T @ path, M / MASSES
    sigma, omega = 3.0 * np.log(10.0) / T60, 2.0 * np.pi * F
    k = mass * (omega**2 + sigma**2) / np.linalg.eigvalsh(laplacian)[0]
    z = 2.0 * sigma * k / (omega**2 + sigma**2)

    def motion(_: float, state: Samples) -> Samples:
        x, v = state[:MASSES], state[MASSES:]
        force = -laplacian @ (k * x + z * v)
        force[place] -= flow(v[place], u)
        return np.concatenate([v, force / mass])

    solved = solve_ivp(
        motion,
        (0.0, n_frames / RATE),
        np.zeros(2 * MASSES),
        method="DOP853",
        t_eval=np.arange(n_frames) / RATE,
        rtol=1e-10,
        atol=1e-14,
        max_step=2e-4,
    )
    assert solved.success
    return np.asarray(solved.y[0])


@pytest.mark.parametrize(
    ("name", "link", "ends", "place", "u", "flow"),
    [
        ("clarinet", "reed", "left", 7, 0.4, reed_flow),
        ("flute", "jet", "fixed", 2, 0.3, jet_flow),
    ],
)
def test_blown_bore_against_dop853(name, link, ends, place, u, flow):
    n_frames = int(0.08 * RATE)
    text = f"""\
instruments:
  x:
    modules:
      mouth: {{SOL: {{}}}}
      bore: {{STRING: {{masses: {MASSES}, M: {M}kg, f: {F}Hz, t60: {T60}s, ends: {ends}}}}}
      lips: {{LNL: {{between: [mouth, bore.{place}], {law(name, link)}, u: {u}}}}}
    out: {{SOX: bore.0}}
accuracy: {{error: -80dB}}
render: {{tail: 1s, bits: float}}
"""
    ours = planned(text, n_frames)
    truth = exact({"left": 1, "fixed": 2}[ends], place, flow, u, n_frames)
    assert truth[n_frames // 2 :].std() > 0.3 * np.abs(truth).max()  # it sounds
    assert np.sqrt(np.mean((ours - truth) ** 2) / np.mean(truth**2)) < 1e-3


def note(
    name: str, f: float, strength: str = "mf", act: str = "", seconds: float = 0.95
) -> Samples:
    text = f"use: [instruments/winds.yaml]\ninstruments: {{x: {{from: winds/{name}, f: {f}Hz}}}}\n"
    text += f"strikes: {{s: {{to: x{act}, at: 0s, impulse: {strength}}}}}\nrender: {{tail: 1.5s}}\n"
    return planned(text, int(seconds * RATE))


def partial(sound: Samples, near: float) -> tuple[float, float]:
    """Frequency [Hz] and level [dB] of the strongest peak within 4 % of a frequency."""
    n = len(sound)
    magnitude = np.abs(np.fft.rfft(sound * np.blackman(n), 16 * n))
    f = np.fft.rfftfreq(16 * n, 1.0 / RATE)
    inside = np.flatnonzero(np.abs(f / near - 1.0) < 0.04)
    top = inside[np.argmax(magnitude[inside])]
    return float(f[top]), float(20.0 * np.log10(magnitude[top]))


RANGES = {  # the named pitch of each in Hz, times an octave and a half
    "clarinet": 146.83,
    "oboe": 220.0,
    "flute": 293.66,
    "trumpet": 311.13,
    "voice": 110.0,
}
NOTES = [(name, low * 2.0 ** (st / 12)) for name, low in RANGES.items() for st in (0, 6, 12, 17)]


@pytest.mark.parametrize(("name", "f"), few(NOTES, NOTES[2::8]))
def test_wind_pitch_equals_its_note(name: str, f: float):
    steady = note(name, f)[int(0.4 * RATE) :]
    sounding, level = partial(steady, f)
    assert abs(1200.0 * np.log2(sounding / f)) < 5.0
    assert level > partial(steady, 0.5 * f)[1] + 20.0  # no octave below


def test_clarinet_odd_partials_above_even_ones():
    steady = note("clarinet", 146.83)[int(0.4 * RATE) :]
    levels = [partial(steady, n * 146.83)[1] for n in range(1, 8)]
    assert min(levels[0:5:2]) > max(levels[1:6:2]) + 20.0


@pytest.mark.parametrize(
    ("name", "act", "f", "ratio"),
    [
        ("clarinet", ".clarion", 146.83, 3),
        ("oboe", ".octave", 233.08, 2),
        ("flute", ".octave", 440.0, 2),
    ],
)
def test_hole_of_a_wind_lets_the_next_partial_sound(name: str, act: str, f: float, ratio: int):
    steady = note(name, f, act=act)[int(0.5 * RATE) :]
    sounding, level = partial(steady, ratio * f)
    assert abs(1200.0 * np.log2(sounding / (ratio * f))) < 5.0
    assert level > partial(steady, f)[1] + 30.0


def test_voice_formants_stay_under_another_pitch():
    """The strongest partial of `i` above 1.5 kHz is next to 2.3 kHz, whatever the note."""
    for f in (110.0, 165.0):
        steady = note("voice", f, act=".i")[int(0.4 * RATE) :]
        levels = {n * f: partial(steady, n * f)[1] for n in range(int(1500 / f), int(2800 / f))}
        assert abs(max(levels, key=levels.__getitem__) - 2290.0) < f


def test_note_of_a_wind_swells_and_ends():
    sound = note("clarinet", 146.83, seconds=1.3)
    level = np.sqrt(np.convolve(sound**2, np.ones(600) / 600, "same"))
    steady = np.median(level[int(0.6 * RATE) : int(0.9 * RATE)])
    rise = (np.argmax(level > 0.9 * steady) - np.argmax(level > 0.1 * steady)) / RATE
    assert 0.07 < rise < 0.19
    assert level[int(1.25 * RATE)] < 1e-3 * steady


@pytest.mark.slow
@pytest.mark.parametrize("partial_number", [4, 5])
def test_trumpet_partial_chosen_by_lips(partial_number: int):
    """The lips at 4/3 and 5/3 of their pitch: the fourth and fifth partial of a tube that plays
    the third at the written pitch.
    """
    ratio = partial_number / 3
    lips = f"modules: {{lips: {{CEL: {{f: {414.61 * ratio}Hz}}}}}}"
    text = f"use: [instruments/winds.yaml]\ninstruments: {{x: {{like: trumpet, {lips}}}}}\n"
    text += "strikes: {s: {to: x, at: 0s}}\nrender: {tail: 1.5s}\n"
    steady = planned(text, int(0.95 * RATE))[int(0.4 * RATE) :]
    sounding, level = partial(steady, 466.16 * ratio)
    assert abs(1200.0 * np.log2(sounding / (466.16 * ratio))) < 15.0
    assert level > partial(steady, 466.16)[1] + 30.0
