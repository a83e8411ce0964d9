"""`ergon.admittance`: points, frequencies, what an engine render says, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import ergon
from tests.api.test_modes import SCORE

STRUCK = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  wire:
    modules:
      s: {STRING: {masses: 24, M: 4g, f: D4, t60: 0.3s}}
      pad: {FRO: {between: [s.9, floor], Z: 0.05Ns/m}}
      floor: {SOL: {}}
    out: {SOX: s.17}
  block:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1, K: 0.02, Z: 0.005}}
      n: {MAS: {M: 2}}
      r: {RES: {between: [m, n], K: 0.01}}
    out: {SOX: n}
strikes: {a: {to: [WHERE], at: 0.01s, impulse: 1mNs, lasts: 0s}}
mix: {channels: 1, route: [{from: PART, to: 1}]}
render: {tail: 1.5s}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("wires.yaml").write_text(SCORE)
    return work_folder


@pytest.mark.parametrize(("where", "listened"), [("wire.s.3", "wire.s.17"), ("block.m", "block.n")])
def test_admittance_equals_spectrum_of_rendered_strike(where: str, listened: str):
    """Velocity over force, from the positions that follow 1 mN·s."""
    score = STRUCK.replace("WHERE", where).replace("PART", where.split(".")[0])
    Path("struck.yaml").write_text(score)
    sound = ergon.render("struck.yaml", ergon.RenderOptions(bits="float"))
    x = sound.frames[:, 0].astype(float)
    x = x[round(0.01 * sound.rate) :]
    f = np.fft.rfftfreq(len(x), 1 / sound.rate)
    audible_at = (f > 40.0) & (f < 3000.0)
    played = 2j * np.pi * f * np.fft.rfft(x) / sound.rate / 1e-3
    wanted = ergon.admittance(
        "struck.yaml", where, listened, ergon.AdmittanceOptions(frequencies=f[audible_at])
    )
    size = np.abs(wanted.values[0])
    error = np.abs(played[audible_at] - wanted.values[0])
    assert error.max() < 2e-3 * size.max()
    strong = size > 0.05 * size.max()
    assert np.abs(20 * np.log10(np.abs(played[audible_at]) / size))[strong].max() < 0.1


def test_admittance_points_levels_phases_and_peaks():
    options = ergon.AdmittanceOptions(low="D3", high="1kHz", count=40, peaks=True)
    result = ergon.admittance("wires.yaml", "wire.s.3", ["wire.s.17", "wire.s.3"], options)
    assert (result.parts, result.forced) == (("wire",), "wire.s.3")
    assert result.observed == ("wire.s.17", "wire.s.3")
    assert result.values.shape == (2, len(result.frequencies)) == (2, 43)
    assert result.decibels == pytest.approx(20 * np.log10(np.abs(result.values)))
    assert np.all(np.abs(result.phases[1]) <= 90.0 + 1e-9)
    (part,) = ergon.modes("wires.yaml", ergon.ModesOptions(parts=["wire"], count=3))
    peaks = np.sort(result.frequencies[result.peaks(1)])
    assert peaks == pytest.approx(part.frequencies, rel=1e-4)
    # At a resonance the driving-point admittance is real, and 1/(2σ) times the square of the shape.
    position = result.values[1][np.isin(result.frequencies, peaks)]
    shape = np.abs(part.points["wire.s.3"])
    assert position.real == pytest.approx(shape**2 / (-2 * part.poles.real), rel=5e-3)


def test_admittance_of_a_point_to_itself_counts_contacts():
    result = ergon.admittance("wires.yaml", "pad.m", options=ergon.AdmittanceOptions(count=5))
    assert result.observed == ("pad.m",)
    assert (result.n_laws, result.n_contacts) == (1, 1)
    assert result.inputs[0] == Path("wires.yaml")


def test_admittance_between_linked_parts_closed_form():
    text = SCORE.replace("  air:", "  wall:").replace(
        "hit: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}",
        "hit: {RES: {between: [k1, m], K: 900N/m}}",
    )
    options = ergon.AdmittanceOptions(text=text, low=1, high=30, count=4)
    result = ergon.admittance("wires.yaml", "k1", "pad.m", options)
    assert result.parts == ("k1", "pad")
    for f, value in zip(result.frequencies, result.values[0], strict=True):
        s = 2j * np.pi * f
        matrix = np.array([[0.4 * s * s + 1.2 * s + 960, -900], [-900, 0.02 * s * s + 1100]])
        assert value == pytest.approx(s * np.linalg.inv(matrix)[1, 0], rel=1e-9)


@pytest.mark.parametrize(
    ("forced", "listened", "options", "message"),
    [
        ("wirr.s.3", (), {}, "forced: nothing is called 'wirr.s.3'; did you mean 'wire'?"),
        ("wire.s.3", "wire.s.99", {}, "observed: wire.s has members 0 to 23"),
        ("wire.s", (), {}, "forced: wire.s has 24 masses; write one of them: wire.s.0"),
        ("pad.floor", (), {}, "forced: pad.floor is fixed, so no force moves it"),
        ("k1", "pad.floor", {}, "observed: pad.floor is fixed, so no force moves it"),
        ("k1", "pad.m", {"peaks": True}, "peaks: peaks are those of one part"),
        ("k1", (), {"low": 50, "high": "20Hz"}, "high: is 20 Hz; it must be above low, 50 Hz"),
        ("k1", (), {"low": "h3"}, "low: 'h3' is neither a frequency"),
        ("k1", (), {"count": 1}, "count: is 1; it must be at least 2"),
        ("k1", (), {"frequencies": [1.0, 0.0]}, "frequencies: write a row of numbers above 0"),
    ],
)
def test_admittance_refuses_wrong_points_and_options(
    forced: str, listened: str, options: dict, message: str
):
    with pytest.raises(ergon.OptionError) as refused:
        ergon.admittance("wires.yaml", forced, listened, ergon.AdmittanceOptions(**options))
    assert str(refused.value).startswith(message)
