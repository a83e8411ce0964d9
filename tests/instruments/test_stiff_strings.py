"""Strings that resist bending, against the partials of a stiff string held at both ends."""

import numpy as np
import pytest
from checked import check, check_reports
from sweep import few

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
F = 110.0
SCORE = """\
ergon: 1
instruments:
  s:
    modules:
      body: {STRING: {masses: 60, M: 6g, f: 110Hz, t60: 2000s, %s}}
    out: {SOX: body.2}
strikes:
  hit: {to: s.body.0, at: 0s, impulse: 0.1mNs}
accuracy: {method: %s}
"""


def rendered(text: str, n_frames: int) -> np.ndarray:
    simulation = stage(load("x.yaml", text=text).piece, planned=True).simulation
    out = np.zeros((n_frames, 1))
    simulation.process(out)
    return out[:, 0]


def peaks(sound: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Frequencies [Hz] of the strongest bins near the expected ones, between bins by a parabola."""
    padded = 4 * len(sound)
    spectrum = np.abs(np.fft.rfft(sound * np.blackman(len(sound)), padded))
    level = np.log(spectrum + 1e-300)
    listened = []
    for f in expected * padded / RATE:
        low = round(f) - 40
        top = low + int(np.argmax(level[low : low + 81]))
        left, middle, right = level[top - 1 : top + 2]
        listened.append(top + 0.5 * (left - right) / (left - 2.0 * middle + right))
    return np.array(listened) * RATE / padded


@pytest.mark.parametrize("method", few(["modal", "bm4", "ca2p"], 3))
@pytest.mark.parametrize("b", [1e-4, 3e-4, 1e-3])
def test_stiff_string_first_twenty_partials(b, method):
    n = np.arange(1, 21)
    wanted = F * n * np.sqrt((1.0 + b * n * n) / (1.0 + b))
    listened = peaks(rendered(SCORE % (f"inharmonicity: {b}", method), 3 * 44100), wanted)
    assert np.abs(1200.0 * np.log2(listened / wanted)).max() < 1.0


def test_string_with_zero_inharmonicity_harmonic():
    wanted = F * np.arange(1, 21)
    listened = peaks(rendered(SCORE % ("inharmonicity: 0", "modal"), 3 * 44100), wanted)
    assert np.abs(1200.0 * np.log2(listened / wanted)).max() < 1.0


def test_wire_inharmonicity_from_dimensions():
    wire = "inharmonicity: {young: 200GPa, radius: 0.4mm, tension: 70N, length: 65cm}"
    (module,) = check(SCORE % (wire, "ca")).piece.instruments["s"].modules
    # π³·E·r⁴/(4·T·L²), Fletcher and Rossing, The Physics of Musical Instruments, §2.18.
    wanted = np.pi**3 * 200e9 * 0.4e-3**4 / (4.0 * 70.0 * 0.65**2)
    assert module.fields["inharmonicity"] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("inharmonicity: -1e-4", "E202", "negative"),
        ("inharmonicity: 1", "E202", "maximum of 0.1"),
        ("inharmonicity: 1e-4, stiffness: 0.1", "E111", "keep `inharmonicity`"),
        ("inharmonicity: {young: 200GPa, radius: 0.4mm, length: 1m}", "E103", "tension"),
        ("inharmonicity: {young: 200N, radius: 0.4mm, tension: 1N, length: 1m}", "E203", "Pa"),
        ("inharmonicity: {young: 200GPa, radius: 9mm, tension: 1N, length: 1m}", "E202", "thinner"),
    ],
)
def test_stiff_string_refusals_with_place(fields, code, part):
    (report,) = check_reports(SCORE % (fields, "ca"))
    assert report[0] == code
    assert part in report[2]


def test_stiff_string_with_too_few_masses_suggests_count():
    text = (SCORE % ("inharmonicity: 1e-3", "ca")).replace("masses: 60", "masses: 12")
    with pytest.raises(Exception, match=r"give it 2. masses or more"):
        stage(load("x.yaml", text=text).piece)
