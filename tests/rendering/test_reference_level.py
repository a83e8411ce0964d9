"""The level of a file whose score gives none: fixed quantities at a fixed level."""

import math
from pathlib import Path

import numpy as np
import pytest

import ergon
from ergon.api.score import level_of
from ergon.scores.reading.load import load

RATE = 44_100
OMEGA = 2 * math.pi * 440.0
# A mass that swings by AMPLITUDE at 440 Hz.
SCORE = """\
ergon: 1
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 440Hz, X0: {x0}m}}}}
      wall: {{SOL: {{}}}}
      d: {{FRO: {{between: [wall, m], Z: 1e-6}}}}
    out: {{{out}}}
mix: {{channels: 1{mix}}}
render: {{tail: 300ms, bits: {bits}}}
"""


def peak(out: str, x0: float, mix: str = "", bits: str = "24") -> float:
    """Peak of the file [dBFS]."""
    text = SCORE.format(out=out, x0=x0, mix=mix, bits=bits)
    path = Path("bell.yaml")
    path.write_text(text, encoding="utf-8")
    frames = ergon.render(path).frames[RATE // 10 :]  # the high-pass has settled
    return 20.0 * math.log10(float(np.abs(frames).max()))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("out", "amplitude"),
    [
        ("SOX: m", 1e-4),
        ("SOV: m", 1.0 / OMEGA),
        ("SOA: m", 1e4 / OMEGA**2),
        ("SOF: {FRO: d}", 1e-2 / (1e-6 * OMEGA)),
    ],
)
def test_reference_level_of_each_output_kind(out: str, amplitude: float) -> None:
    assert peak(out, amplitude / 4) == pytest.approx(-32.04, abs=0.02)
    assert peak(out, amplitude / 2) == pytest.approx(-26.02, abs=0.02)  # twice is 6 dB louder
    assert peak(out, amplitude) == pytest.approx(-20.0, abs=0.02)


def test_reference_level_of_radiated_pressure() -> None:
    """1 Pa: of a disc of 5 cm at 2 m, an acceleration of 2 · 2 m / (1.204 kg/m³ · (5 cm)²)."""
    amplitude = 2 * 2.0 / (1.204 * 0.05**2) / OMEGA**2
    mix = ", route: {from: bell, to: 1, radiate: {distance: 2m, radius: 5cm}}"
    assert peak("SOA: m", amplitude, mix) == pytest.approx(-20.0, abs=0.02)


@pytest.mark.parametrize(
    ("master", "level"),
    [
        ("", -20.0),
        ("{limit: -1dB}", -20.0),
        ("{reference: -26dB}", -26.0),
        ("{reference: -26dB, gain: 3dB}", -23.0),
        ("{reference: -26dB, normalise: -9dB}", -9.0),
        ("{gain: 6dB}", -14.0),
        ("{reference: SI, gain: 70dB}", -10.0),  # of 0.1 mm: -80 dB
        ("{normalise: -3dB}", -3.0),
    ],
)
def test_reference_level_with_explicit_master(master: str, level: float) -> None:
    mix = f", master: {master}" if master else ""
    assert peak("SOX: m", 1e-4, mix) == pytest.approx(level, abs=0.02)


@pytest.mark.parametrize(
    ("master", "level"),
    [
        ("", -80.0),
        ("{limit: 0dB}", -80.0),
        ("{gain: 6dB}", -74.0),
        ("{reference: -20dB}", -20.0),
        ("{normalise: -3dB}", -3.0),
    ],
)
def test_float_render_unscaled_without_reference(master: str, level: float) -> None:
    mix = f", master: {master}" if master else ""
    assert peak("SOX: m", 1e-4, mix, "float") == pytest.approx(level, abs=0.02)


# A position and a speed, one after the other.
TWO = """\
ergon: 1
instruments:
  place:
    modules: {{m: {{CEL: {{M: 2g, f: 440Hz, t60: 200ms}}}}}}
    out: {{SOX: m}}
  speed:
    modules: {{m: {{CEL: {{M: 2g, f: 660Hz, t60: 200ms}}}}}}
    out: {{SOV: m}}
strikes:
  first: {{to: place.m, at: 0s, impulse: 1mNs}}
  second: {{to: speed.m, at: 1s, impulse: 1mNs}}
mix: {{channels: 1, route: [{{from: place, to: 1}}, {{from: speed, to: 1, gain: -3dB}}]{mix}}}
render: {{tail: 500ms, bits: {bits}}}
"""


def balance(master: str, bits: str = "24") -> float:
    """How much louder the position is than the speed [dB]."""
    path = Path("two.yaml")
    mix = f", master: {master}" if master else ""
    path.write_text(TWO.format(mix=mix, bits=bits), encoding="utf-8")
    frames = np.abs(ergon.render(path).frames)
    return 20.0 * math.log10(frames[:RATE].max() / frames[RATE + RATE // 10 :].max())


def test_instrument_balance_independent_of_master() -> None:
    usual = balance("")
    for master in (
        *("{gain: 0dB}", "{gain: -9dB}", "{normalise: -1dB}", "{loudness: -26LUFS}"),
        *("{reference: -30dB}", "{reference: -30dB, normalise: -3dB}", "{limit: 0dB}"),
    ):
        assert balance(master) == pytest.approx(usual, abs=0.01), master
    for master in ("{normalise: -1dB}", "{loudness: -26LUFS}"):
        assert balance(master, "float") == pytest.approx(usual, abs=0.2), master  # no high-pass
    # 1 m is then as loud as 1 m/s: 80 dB less than 0.1 mm beside 1 m/s.
    assert balance("{reference: SI, normalise: -1dB}") == pytest.approx(usual - 80.0, abs=0.1)


def test_master_with_two_levels_is_refused() -> None:
    loaded = load("s.yaml", text="ergon: 1\nmix: {master: {loudness: -20LUFS, normalise: -1dB}}\n")
    assert [one.code for one in loaded.diagnostics] == ["E111"]


def test_route_gain_relative_to_reference() -> None:
    mix = ", route: {from: bell, to: 1, gain: 6dB}"
    assert peak("SOX: m", 1e-4, mix) == pytest.approx(-14.0, abs=0.02)


def test_highpass_default_for_integer_files_only() -> None:
    piece = load("s.yaml", text="ergon: 1\n").piece
    assert piece is not None
    assert [level_of(piece, bits).highpass for bits in (16, 24, "float")] == [8.0, 8.0, None]
