"""How high bodies sound, and the warning of one that stops low (W331)."""

import re

import numpy as np
import pytest
from checked import check

from ergon.api import check as api_check
from ergon.scores.staging.highest_modes import highest_modes, warn_low_modes
from ergon.scores.staging.preparing import prepare

SCORE = "ergon: 1\ninstruments:\n  s: {modules: {body: {%s}}}\n"


def modes(fields: str) -> list:
    piece = check(SCORE % fields).piece
    return highest_modes(piece, prepare(piece).built_network)


def test_highest_mode_of_string_by_formula():
    (first,) = modes("STRING: {masses: 40, M: 1g, f: 100Hz, t60: 3s}")
    # sin(40·π/82)/sin(π/82) of the lowest; losses do not count.
    assert (first.name, first.frequency) == ("s.body", pytest.approx(2608.9, rel=1e-3))


@pytest.mark.parametrize(
    ("body", "low", "enough"),
    [
        ("STRING: {masses: %d, M: 1g, f: 110Hz}", 70, 72),
        ("STRING: {masses: %d, M: 1g, f: 110Hz, inharmonicity: 1e-4}", 50, 53),
        ("PLATE: {radius: %d, M: 1g, f: 110Hz, rim: fixed}", 24, 48),
        ("PLATE: {radius: %d, M: 1g, f: 80Hz, bending: true}", 4, 10),
        ("PLATE: {radius: %d, shape: disc, M: 1g, f: 110Hz, rim: fixed}", 12, 43),
    ],
)
def test_low_mode_warning_suggests_sufficient_masses(body, low, enough):
    (warning,) = warn_low_modes(modes(body % low))
    assert warning.code == "W331"
    text = re.fullmatch(
        r"(?:`masses: (\d+)`|[\d,]+ masses \((\d+) rings\)) would reach about 5 kHz", warning.help
    )
    number = int(text[1] or text[2])
    assert low < number <= enough
    assert modes(body % number)[0].frequency > 0.93 * 5000.0
    assert warn_low_modes(modes(body % (number + 4))) == []


def test_low_mode_warning_of_rectangle_gives_sides():
    (warning,) = warn_low_modes(
        modes("PLATE: {shape: rectangle, sides: [9, 7], M: 1g, f: 100Hz, bending: true}")
    )
    across, up = map(int, re.search(r"\((\d+) by (\d+)\)", warning.help).groups())
    (first,) = modes(
        f"PLATE: {{shape: rectangle, sides: [{across}, {up}], M: 1g, f: 100Hz, bending: true}}"
    )
    assert first.frequency > 4000.0


def test_check_low_mode_warning_once_for_all_notes(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(
        "ergon: 1\ninstruments:\n"
        "  s: {notes: [D3, F3, A3], modules: {m: {STRING: {masses: 20, M: 1g, f: D3, X0: 1mm}}},"
        " out: {SOX: m.0}}\n"
        "  g: {from: gong/tamtam}\n"
    )
    result = [one for one in api_check.check(path).diagnostics if one.code == "W331"]
    assert [(one.place.line, one.message) for one in result] == [
        (3, "'s.D3.m' has no mode above 1.96 kHz")
    ]


AUTOMATED = """\
ergon: 1
instruments: {s: {modules: {s: {STRING: {masses: 80, M: 4g, f: A2, t60: 2s}}}, out: {SOX: s.8}}}
strikes: {a: {to: [s.s.5], at: 0s, impulse: 1mNs}}
automation: [{at: 1|2, set: s.s.f, to: %s}]
render: {tail: 1s}
"""


@pytest.mark.parametrize("accuracy", ["", "accuracy: {method: ca}\n", "accuracy: {error: -40dB}\n"])
def test_automation_above_step_limit_warns_with_time(tmp_path, accuracy):
    path = tmp_path / "a.yaml"
    path.write_text(AUTOMATED % "A2@0 line A5@4" + accuracy)
    (result,) = [one for one in api_check.check(path).diagnostics if one.code == "W332"]
    highest = modes("STRING: {masses: 80, M: 4g, f: A2, t60: 2s}")[0].frequency
    assert result.place.line == 4
    # At 60 bpm the glide lasts from 1 s to 5 s, evenly in semitones.
    position = float(re.search(r"\((.*?) s\)", result.message)[1])
    pitch = 110.0 * 8.0 ** ((position - 1.0) / 4.0)
    assert highest * pitch / 110.0 == pytest.approx(44100.0 / np.pi, rel=1e-2)
    times = int(re.search(r"takes (\d+) steps", result.help)[1])
    assert times == np.ceil(highest * 8.0 / (44100.0 / np.pi))
    path.write_text(AUTOMATED % "A2@0 line A3@4")
    assert not [one for one in api_check.check(path).diagnostics if one.code == "W332"]
