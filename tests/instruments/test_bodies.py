"""Decays at several pitches, and plates that bend, as scores write them."""

import numpy as np
import pytest
from checked import check, check_reports, codes

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
SCORE = """\
ergon: 1
instruments:
  s:
    modules:
      body: {%s}
    out: {SOX: body.%s}
strikes:
  hit: {to: s.body.%s, at: 0s, impulse: 0.1mNs}
accuracy: {method: %s}
"""
STRING = "STRING: {masses: 60, M: 6g, f: 100Hz, t60: {100Hz: 8s, 4kHz: 1s}%s}"


def rendered(text: str, n_frames: int) -> np.ndarray:
    simulation = stage(load("x.yaml", text=text).piece, planned=True).simulation
    out = np.zeros((n_frames, 1))
    simulation.process(out)
    return out[:, 0]


def decay(sound: np.ndarray, f: float, length: int = 4096) -> float:
    """T60 [s] of a partial: how its level at f falls from window to window."""
    window = np.hanning(length) * np.exp(-2j * np.pi * f / RATE * np.arange(length))
    starts = np.arange(2000, len(sound) - length, length // 2)
    level = [np.log10(abs(np.dot(sound[at : at + length], window))) for at in starts]
    slope = np.polyfit(starts / RATE, level, 1)[0]
    return -3.0 / slope


@pytest.mark.parametrize("method", ["modal", "bm4"])
def test_string_partials_decay_at_listed_t60(method):
    module = STRING % ", inharmonicity: 0"
    sound = rendered(SCORE % (module, 2, 0, method), 66150)
    near = min(modes(module), key=lambda mode: abs(mode[0] - 4000.0))
    for f, length in ((100.0, 22050), (near[0], 8192)):
        # Between the two, loss over the square of the frequency is a straight line.
        wanted = 1.0 / np.interp(f * f, (1e4, 16e6), (1.0 / 8.0, 1.0 / 1.0))
        assert decay(sound, f, length) == pytest.approx(wanted, rel=0.01), f


def modes(module: str) -> list[tuple[float, float]]:
    built = check(SCORE % (module, 0, 0, "ca")).piece.instruments["s"].modules[0]
    network = _core.Network()
    network.part("s")
    fields = built.fields
    network.string(
        "b",
        masses=fields["masses"],
        M=fields["M"],
        f=fields["f"],
        t60=fields["t60"],
        inharmonicity=fields["inharmonicity"],
    )
    return network.modes("s", 55)


@pytest.mark.parametrize(
    "t60",
    [
        "{110Hz: 12s, 500Hz: 8s, 1.5kHz: 4s, 4kHz: 1s}",
        "{A2: 8s, 440Hz: 0.2s}",
    ],
)
def test_fitted_decays_same_in_modal_and_stepped_render(t60):
    string = f"STRING: {{masses: 40, M: 6g, f: 110Hz, t60: {t60}, inharmonicity: 2e-4}}"
    text = SCORE % (string, 2, 0, "modal")
    plan = stage(load("x.yaml", text=text).piece, planned=True).plan
    assert [row.what for row in plan.rows()] == ["modes"]
    first = rendered(text, 22050)
    two = rendered(text.replace("method: modal", "method: bm4"), 22050)
    # What is damped within some frames is as exact as the method.
    assert 20.0 * np.log10(np.abs(first - two).max() / np.abs(first).max()) < -40.0


@pytest.mark.parametrize(
    ("module", "code", "part"),
    [
        ("STRING: {masses: 9, M: 1g, f: A3, t60: {A3: 1s}}", "E106", "from 2"),
        ("STRING: {masses: 9, M: 1g, f: A3, t60: {A3: 1s, x: 2s}}", "E201", "x"),
        ("STRING: {masses: 9, M: 1g, f: A3, t60: {A3: 1s, A4: 2m}}", "E203", "m"),
        ("STRING: {masses: 9, M: 1g, f: A3, t60: [1s]}", "E106", "decays at frequencies"),
        ("PLATE: {M: 1g, f: A3}", "E103", "needs radius"),
        ("PLATE: {M: 1g, f: A3, shape: rectangle, radius: 3}", "E103", "needs sides"),
        ("PLATE: {M: 1g, f: A3, radius: 4, sides: [3, 4]}", "E111", "remove it"),
        ("PLATE: {M: 1g, f: A3, radius: 4, bending: {poisson: 0.7}}", "E202", "0.5"),
        ("PLATE: {M: 1g, f: A3, radius: 4, bending: 0.3}", "E206", "true"),
    ],
)
def test_wrong_body_fields_report_code_and_text(module, code, part):
    reports = check_reports(SCORE % (module, 0, 0, "ca"))
    assert code in [report[0] for report in reports]
    assert any(part in report[2] for report in reports)


def test_impossible_decays_report_nearest_value():
    comb = ", ".join(f"{110 * i}Hz: {9 if i % 2 else 0.1}s" for i in range(1, 12))
    text = SCORE % (f"STRING: {{masses: 20, M: 1g, f: A2, t60: {{{comb}}}}}", 0, 0, "ca")
    with pytest.raises(Exception, match="the nearest possible value"):
        stage(load("x.yaml", text=text).piece)


# Leissa, Vibration of Plates (NASA SP-160, 1969), nu = 0.33.
def test_free_disc_mode_ratios_of_thin_plate():
    disc = "PLATE: {shape: disc, radius: 12, M: 300g, f: 200Hz, bending: {poisson: 0.33}}"
    assert codes(SCORE % (disc, "last", "468", "ca")) == []
    network = _core.Network()
    network.part("s")
    network.plate("p", shape="disc", radius=12, M=0.3, f=200.0, bending=0.33)
    listened = np.array([f for f, _ in network.modes("s", 12) if f > 20.0])[:5]
    assert listened / listened[0] == pytest.approx([1.0, 1.0, 1.729, 2.328, 2.328], rel=0.02)


def test_fixed_rectangle_modes_closed_form():
    network = _core.Network()
    network.part("s")
    network.plate("p", sides=(39, 24), M=0.3, f=100.0, bending=0.3, rim="fixed")
    listened = np.array([f for f, _ in network.modes("s", 10)])
    wanted = sorted((m / 40) ** 2 + (n / 25) ** 2 for m in range(1, 9) for n in range(1, 9))[:10]
    assert listened[0] == pytest.approx(100.0, rel=1e-6)
    assert listened / listened[0] == pytest.approx(np.array(wanted) / wanted[0], rel=0.02)


@pytest.mark.parametrize(
    ("plate", "count"),
    [
        ("shape: disc, radius: 4, bending: true", 61),
        ("shape: disc, radius: 4, bending: true, rim: fixed", 37),
        ("shape: rectangle, sides: [9, 7], bending: true, rim: fixed", 63),
        ("shape: rectangle, sides: [9, 7]", 63),
        ("shape: hex, radius: 4, bending: true", 61),
        ("shape: square, radius: 4, bending: true, rim: fixed, hardening: 1e6N/m3", 81),
    ],
)
def test_plate_mass_counts_and_stability(plate, count):
    text = SCORE % (f"PLATE: {{{plate}, M: 300g, f: 100Hz, t60: 5s}}", "centre", count - 1, "ca")
    sound = rendered(text, 4410)
    assert 0.0 < np.abs(sound).max() < 1e-2
    assert codes(text.replace(f"body.{count - 1}", f"body.{count}")) == ["E304"]
