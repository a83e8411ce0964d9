"""Acts that draw and press: constants of a link that last as long as a note."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from checked import check, check_reports
from planned_sound import played

# A weight on a spring of 100 N/m is pushed by F, and by nothing else: it goes to F/K.
SCALES = """\
ergon: 1
tempo: {{bpm: 60}}
instruments:
  scales:
    modules: {{m: {{CEL: {{M: 100g, K: 100N/m, Z: 8Ns/m}}}}}}
    out: {{SOX: m}}
    play:
      lean:
        press: weight 0.2N..2N
        until: note
        with: {{floor: {{SOL: {{}}}}, weight: {{LNL: {{between: [floor, m], law: 0*d - F{rest}}}}}}}
      more: {{press: weight 0.1N..1N}}
strikes: {{s: {strikes}}}
mix: {{channels: 1, route: [{{from: scales, to: 1}}]}}
render: {{tail: 1s}}
"""
K = 100.0  # N/m


def positions(strikes: str, rest: str = "") -> list[float]:
    """Where the weight is at the middle of each second [m]."""
    sound = played(SCALES.format(strikes=strikes, rest=rest))[:, 0]
    return [float(sound[round(44100 * (second + 0.5))]) for second in range(len(sound) // 44100)]


@pytest.mark.parametrize("strength", [Fraction(0), Fraction(3, 7), Fraction(1)])
def test_press_is_held_until_note_ends(strength):
    force = 0.2 * 10.0 ** float(strength)
    line = f'{{rhythm: "scales:{float(strength):.9f}@2 ~ scales:0", at: 0, times: 1}}'
    expected = [force / K, force / K, 0.0, 0.2 / K]
    assert np.array(positions(line)[:4]) == pytest.approx(np.array(expected), rel=1e-3, abs=2e-5)


def test_press_counts_from_written_value():
    line = "{to: scales, at: 1, impulse: fff}"  # without a length it lasts a second
    expected = [0.5 / K, 2.5 / K, 0.5 / K]
    assert positions(line, ", F: 0.5N")[:3] == pytest.approx(expected, rel=5e-3)


def test_press_of_two_acts_adds():
    rows = "{at: 0, what: scales, impulse: 0}, {at: 0, what: scales.more, impulse: 1}"
    assert positions(f"{{entries: [{rows}]}}")[0] == pytest.approx(1.2 / K, rel=1e-3)


def test_impulse_with_unit_is_force_for_a_second():
    line = "{to: scales, at: 0, impulse: 1.5Ns}"
    assert positions(line)[0] == pytest.approx(1.5 / K, rel=1e-3)


# The speed at which a string sticks to a bow that never slips is the bow's.
ROAD = """\
ergon: 1
tempo: {{bpm: 60}}
instruments:
  cart:
    modules: {{m: {{MAS: {{M: 10g}}}}}}
    out: {{SOV: m}}
    play:
      pull:
        draw: hand 0.1m/s..1m/s
        turns: {turns}
        with: {{floor: {{SOL: {{}}}}, hand: {{LNL: {{between: [floor, m], damping: 2*(v - u)}}}}}}
strikes: {{s: {{rhythm: "cart:{strength}*3 ~", at: 0, times: 1, cycle: 4}}}}
mix: {{channels: 1, route: [{{from: cart, to: 1}}]}}
"""


@pytest.mark.parametrize(("turns", "signs"), [("false", [1, 1, 1]), ("true", [1, -1, 1])])
def test_draw_is_speed_of_bow(turns, signs):
    sound = played(ROAD.format(turns=turns, strength="0.5").replace("*3", "!3"))[:, 0]
    speeds = [sound[round(44100 * (second + 0.9))] for second in range(3)]
    expected = [sign * 0.1 * 10.0**0.5 for sign in signs]
    assert speeds == pytest.approx(expected, rel=1e-2)


PLAY = """\
ergon: 1
instruments:
  v:
    modules: {{m: {{CEL: {{M: 5g, f: 90Hz, t60: 1s}}}}}}
    out: {{SOV: m}}
    play:
      bow: {act}
strikes: {{s: {strikes}}}
"""
HAIR = "with: {s: {SOL: {}}, hair: {LNL: {between: [s, m], damping: bow}}}"


@pytest.mark.parametrize(
    ("act", "code", "part"),
    [
        ("{draw: hare 0.1m/s..1m/s, " + HAIR + "}", "E301", "no act brings a link 'hare'"),
        ("{draw: hair 1m/s, " + HAIR + "}", "E201", "is not a range"),
        ("{draw: 0.1m/s..1m/s, " + HAIR + "}", "E201", "a link and a range"),
        ("{press: hair 1m/s..2m/s, " + HAIR + "}", "E203", "force"),
        ("{press: hair 0N..2N, " + HAIR + "}", "E202", "both above 0"),
        ("{press: hair 2N..1N, " + HAIR + "}", "E202", "runs downwards"),
        ("{press: s 1N..2N, " + HAIR + "}", "E304", "'s' is a SOL"),
        ("{at: m, press: hair 1N..2N, " + HAIR + "}", "E103", "has no 'impulse'"),
        ("{until: note}", "E103", "has no 'impulse'"),
        ("{draw: hair 0.1m/s..1m/s, until: dawn, " + HAIR + "}", "E206", "not one of note"),
    ],
)
def test_wrong_draw_is_refused_in_its_place(act, code, part):
    reports = [
        r for r in check_reports(PLAY.format(act=act, strikes="{to: v.m, at: 0, impulse: 1mNs}"))
    ]
    assert any(each == code and part in message for each, _, message in reports), reports
    assert all(line == 7 for _, line, _ in reports)


def test_law_without_constant_is_refused():
    hair = HAIR.replace("damping: bow", "damping: z*v, z: 1Ns/m")
    loaded = check(PLAY.format(act="{press: hair 1N..2N, " + hair + "}", strikes="{to: v, at: 0}"))
    assert [(d.code, d.place.line) for d in loaded.diagnostics] == [("E101", 7)]


def test_draw_refuses_strikes_by_chance():
    act, line = "{draw: hair 0.1m/s..1m/s, " + HAIR + "}", "{to: v, at: 0, for: 4, rate: 3Hz}"
    (report,) = check(PLAY.format(act=act, strikes=line)).diagnostics
    assert report.code == "E111"
    assert "as long as a note" in report.message
