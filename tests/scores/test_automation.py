"""Automation: parameters that follow patterns of values, and those that swing."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from ergon.notation.text.errors import Collector, TextError
from ergon.scores.pattern.values import SCALES, parse_values
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.automating import GLIDE_DURATION, automation_points
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span, prepare
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
seed: {seed}
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}]
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, X0: 1mm}}}}
      n: {{CEL: {{M: 2g, K: 900N/m, Z: 0.2Ns/m}}}}
      b: {{BUT: {{between: [k, m], K: 900N/m, gap: 9mm}}}}
      s: {{STRING: {{masses: 5, M: 1g, f: 99Hz}}}}
      p: {{STRING: {{masses: 8, M: 1g, f: 99Hz, t60: {{99Hz: 2s, 300Hz: 1s}}}}}}
      r: {{BANK: {{count: 3, M: 1g, f: 99Hz..999Hz, t60: 1s}}}}
      l: {{LNL: {{between: [n, m], law: q*d**3, q: 1N/m3}}}}
    out: {{SOX: m}}
automation: [{lines}]
render: {{tail: {tail}s}}
"""


def piece(lines: str, seed: int = 5, tail: float = 8.0) -> Piece:
    loaded = load("s.yaml", text=SCORE.format(lines=lines, seed=seed, tail=tail))
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def points(source: Piece, module: str = "m", since: float = -math.inf, until: float = 8.0):
    collector = Collector()
    result = automation_points(source, since, until, collector)
    assert not collector.has_errors()
    return result.points["bell", module]


def frequency(k: float, z: float, m: float) -> float:
    return math.sqrt(k / m - (z / (2 * m)) ** 2) / (2 * math.pi)


def pitch(sound: np.ndarray, rate: float) -> float:
    """By its zero crossings, an independent measure."""
    rising = np.flatnonzero((sound[:-1] < 0) & (sound[1:] >= 0))
    position = rising - sound[rising] / (sound[rising + 1] - sound[rising])
    return rate * (len(position) - 1) / (position[-1] - position[0])


def test_set_pattern_of_notes_in_sound():
    source = piece("{set: bell.m.f, to: A3 C4 (E4 A4), at: 1|1, every: 1, times: 2}", tail=7.0)
    complete = stage(source)
    sound = np.zeros((complete.n_frames, complete.simulation.n_out))
    complete.simulation.process(sound)
    rate = int(complete.rate)

    def played_pitch(begin: float, end: float) -> float:
        return pitch(sound[int((begin + 0.05) * rate) : int((end - 0.02) * rate), 0], rate)

    spans = [(0, 1), (1, 2), (2, 2.5), (2.5, 3), (3, 4), (4, 5), (5, 5.5), (5.5, 6), (6.0, 7.0)]
    notes = [220.0, 261.6256, 329.6276, 440.0] * 2 + [220.0]
    assert [played_pitch(*span) for span in spans] == [pytest.approx(f, rel=2e-4) for f in notes]


def test_values_and_factors_are_set_in_twenty_milliseconds():
    result = points(piece("{set: bell.n.K, to: 1kN/m x0.5 ~, at: 1|2, every: 1/2, times: 1}"), "n")
    assert [(t, k) for t, k, _, _ in result] == [
        (1.0, 900.0),
        (1.0 + GLIDE_DURATION, 1000.0),
        (1.5, 1000.0),
        (1.5 + GLIDE_DURATION, 450.0),
        (2.5, 450.0),
        (2.5 + GLIDE_DURATION, 900.0),
    ]
    assert {(z, m) for _, _, z, m in result} == {(0.2, 0.002)}


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ("sine", lambda p: 1.0 + 0.2 * math.sin(2 * math.pi * p)),
        ("triangle", lambda p: 1.0 + 0.2 * (1 - 4 * abs((p + 0.25) % 1.0 - 0.5))),
        ("square", lambda p: 1.2 if p < 0.5 else 0.8),
        ("ramp", lambda p: 0.8 + 0.4 * p),
    ],
)
def test_lfo_values_of_each_shape(shape, expected):
    source = piece(f"{{lfo: bell.n.K, range: 0.8..1.2, period: 4, shape: {shape}, at: 1|1}}")
    result = points(source, "n")
    t, k = [p[0] for p in result], [p[1] / 900.0 for p in result]
    for index in np.arange(0.2, 7.99, 0.037):
        if min(abs(index % 2.0), 2.0 - index % 2.0) < 0.07:  # on its way from end to end
            continue
        assert np.interp(index, t, k) == pytest.approx(expected(index / 4 % 1.0), abs=1e-3)
    assert result[0][:2] == (0.0, 900.0)  # from its own value


def test_lfo_continues_to_end_of_piece():
    """Its points are a second apart, and the piece ends in between."""
    line = "{lfo: bell.m.f, range: 200Hz..300Hz, period: 64, at: 1|1}"
    [cut, complete] = [stage(piece(line, tail=tail)) for tail in (7.5, 9.0)]
    sounds = []
    for item in (cut, complete):
        sound = np.zeros((cut.n_frames, item.simulation.n_out))
        item.simulation.process(sound)
        sounds.append(sound)
    assert np.array_equal(*sounds)


def test_lfo_with_phase_starts_within_period():
    half = "{lfo: bell.n.K, range: 1kN/m..2kN/m, period: 4, phase: 0.25, at: 1|1, until: 2|1}"
    result = points(piece(half), "n")
    t, k = [p[0] for p in result], [p[1] for p in result]
    for index in np.arange(0.1, 3.9, 0.1):
        expected = 1500 + 500 * math.cos(math.pi * index / 2)
        assert np.interp(index, t, k) == pytest.approx(expected, abs=1.5)
    assert result[-1][:2] == (4.0 + GLIDE_DURATION, 900.0)  # its own again


def test_automation_entries_in_succession_and_in_parallel():
    lines = (
        "{set: bell.m.f, to: A3 A4, at: 1|1, every: 1, until: 2|1},"
        "{lfo: bell.m.t60, range: 1s..3s, period: 2, at: 1|1, until: 2|1},"
        "{set: bell.m.f, to: E4, at: 2|1, every: 4, until: 3|1}"
    )
    result = points(piece(lines))

    def values_of_time(instant: float) -> tuple[float, float]:
        t = [p[0] for p in result]
        k, z, m = (float(np.interp(instant, t, [p[i] for p in result])) for i in (1, 2, 3))
        return frequency(k, z, m), 6.907755278982137 / (z / (2 * m)) if z else math.inf

    assert values_of_time(0.5) == (pytest.approx(220.0, rel=1e-5), pytest.approx(3.0, rel=1e-3))
    assert values_of_time(1.5) == (pytest.approx(440.0, rel=1e-5), pytest.approx(1.0, rel=1e-3))
    assert values_of_time(4.5)[0] == pytest.approx(329.6276, rel=1e-5)
    assert frequency(*result[-1][1:]) == pytest.approx(220.0)
    assert all(a[0] <= b[0] for a, b in pairwise(result))


def test_automation_chance_and_choices_by_seed():
    line = "{set: bell.m.f, to: choose A3 C4 E4, at: 1|1, every: 1/4, until: 3|1, chance: 0.7}"
    assert points(piece(line)) == points(piece(line))
    assert points(piece(line)) != points(piece(line, 6))
    walk = "{set: bell.m.f, to: walk A3.minor, at: 1|1, every: 1/4, until: 3|1}"
    listened = {round(frequency(*p[1:]), 2) for p in points(piece(walk))}
    scale = {round(220 * 2 ** (n / 12), 2) for n in SCALES["minor"]}
    assert listened <= scale
    assert len(listened) > 2


def test_set_over_length_glides_evenly_in_pitch():
    result = points(piece("{set: bell.m.f, to: A5, at: 1|2, over: 2}"))
    t, k = [p[0] for p in result], [p[1] for p in result]
    for position, f in (
        (0.5, 220.0),
        (1.5, 220 * 2**0.5),
        (2.0, 440.0),
        (3.0, 880.0),
        (7.5, 880.0),
    ):
        assert np.interp(position, t, k) == pytest.approx(0.002 * (2 * math.pi * f) ** 2, rel=1e-5)
    straight = points(piece("{set: bell.n.K, to: x3, at: 1|2, over: 2}"), "n")
    assert np.interp(2.0, [p[0] for p in straight], [p[1] for p in straight]) == pytest.approx(1800)
    smooth = points(piece("{set: bell.n.K, to: x3, at: 1|2, over: 2, curve: smooth}"), "n")
    u = 0.25
    expected = 900 + 1800 * u**3 * (10 - 15 * u + 6 * u * u)
    position = np.interp(1.5, [p[0] for p in smooth], [p[1] for p in smooth])
    assert position == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("grid_steps", [345.0, 345.25, 345.5, 345.9])
def test_glide_between_grid_instants_ends_in_phase(grid_steps: float):
    """The phase of an undamped cell is the integral of its frequency."""
    begin, length, first, last = grid_steps * 64 / 44_100, 0.3007, 2_000.0, 3_000.0
    lines = f"{{set: bell.m.f, to: {last}Hz, at: {begin!r}s, over: {length}s}}"
    text = SCORE.replace("f: 220Hz", f"f: {first}Hz")
    loaded = load("s.yaml", text=text.format(lines=lines, seed=5, tail=1.0))
    assert loaded.piece is not None, loaded.diagnostics
    played = stage(loaded.piece)
    sound = np.zeros((played.n_frames, played.simulation.n_out))
    played.simulation.process(sound)
    frames = np.arange(round((begin + length + 0.01) * 44_100), len(sound))
    cycles = (
        first * begin
        + (last - first) / math.log(last / first) * length
        + last * (frames / 44_100 - begin - length)
    )
    waves = np.exp(-2j * np.pi * cycles)
    # Of x = a·cos(φ + δ), the mean of x·exp(-iφ) has the angle δ.
    phase_error = np.angle(np.sum(sound[frames, 0] * waves))
    assert abs(phase_error) < 5e-4


def test_set_curve_passes_its_points():
    line = "{set: bell.m.f, to: A3@0 smooth A4@1 line A3@2 hold A3@250ms, at: 1|2, until: 2|3}"
    collector = Collector()
    automation_points(piece(line), -math.inf, 8.0, collector)
    assert "do not rise in time" in collector.finish()[0].message
    result = points(piece(line.replace("250ms", "3")))

    def frequency_of_time(instant: float) -> float:
        t = [p[0] for p in result]
        return frequency(*(float(np.interp(instant, t, [p[i] for p in result])) for i in (1, 2, 3)))

    for instant, f in (
        (0.0, 220),
        (1.5, 220 * 2**0.5),
        (2.0, 440),
        (2.5, 220 * 2**0.5),
        (3.5, 220),
    ):
        assert frequency_of_time(instant) == pytest.approx(f, rel=1e-3)
    again = points(piece("{set: bell.m.f, to: A3@0 (A3@1/2 line A4@1)*3, at: 1|1}"))
    assert frequency(*again[-1][1:]) == pytest.approx(440.0)


def test_set_glide_cut_by_next_entry():
    lines = "{set: bell.n.K, to: x3, at: 1|1, over: 4},{set: bell.n.K, to: x1, at: 1|3, over: 2}"
    result = points(piece(lines), "n")
    t, k = [p[0] for p in result], [p[1] for p in result]
    for position, expected in (
        (1.0, 1350.0),
        (2.0, 1800.0),
        (3.0, 1350.0),
        (4.0, 900.0),
        (7.0, 900.0),
    ):
        assert np.interp(position, t, k) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("since", [2.0, 3.1, 5.77])
@pytest.mark.parametrize(
    "line",
    [
        "{set: bell.n.K, to: choose 1kN/m 2kN/m x3, at: 1|1, every: 1/4, until: 3|1, chance: 0.6}",
        "{lfo: bell.n.K, range: 0.5..1.5, period: 3, at: 1|1}",
        "{lfo: bell.n.K, range: 0.5..1.5, period: 3, at: 1|1, shape: square}",
    ],
)
def test_automation_from_middle_equals_complete_automation(line, since):
    source = piece(line)
    complete, rest = points(source, "n"), points(source, "n", since)
    for index in np.arange(since, 7.9, 0.003):
        values = [
            np.interp(index, [p[0] for p in some], [p[1] for p in some])
            for some in (complete, rest)
        ]
        assert values[0] == pytest.approx(values[1], rel=1e-12), index


def test_automation_with_scale_and_chord_names():
    order, amounts = parse_values("A3.minor ~ C4.maj*2", lambda text: 0.0, is_pitch=True)
    assert order.places == 7 + 1 + 6
    result = [amounts[leaf.name].value for leaf in order.leaves()]
    assert result[:3] == [220.0, pytest.approx(246.94165), pytest.approx(261.62557)]
    assert result[7:10] == result[10:]
    assert all(0 in steps and list(steps) == sorted(set(steps)) for steps in SCALES.values())
    with pytest.raises(TextError) as caught:
        parse_values("A3 C4.mayor", lambda text: 1.0, is_pitch=True)
    assert caught.value.suggestion == "major"
    assert caught.value.offset == 6


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("{at: 1|1}", "E103", "either `set` or `lfo`"),
        ("{set: bell.m.f, at: 1|1}", "E103", "`to` is missing"),
        ("{lfo: bell.m.f, range: 1..2, at: 1|1}", "E103", "`period` is missing"),
        ("{set: bell.m.f, to: A3 C4, at: 1|1}", "E103", "write `every`"),
        ("{set: bell.m.f, to: A3 H4, every: 1, at: 1|1}", "E201", "neither a frequency"),
        ("{set: bell.m.K, to: 3N, every: 1, at: 1|1}", "E203", "does not measure stiffness"),
        ("{set: bell.b.gap, to: 3mm, every: 1, at: 1|1}", "E304", "only K and Z change"),
        ("{set: bell.b.Z, to: 3Ns/m, over: 1, at: 1|1}", "E304", "no Z of its own"),
        ("{set: bell.m.X0, to: 3mm, every: 1, at: 1|1}", "E304", "only f and t60 and K"),
        ("{set: bell.s.gap, to: 3mm, over: 1, at: 1|1}", "E304", "only f and t60"),
        ("{set: bell.s.t60, to: 3s, over: 1, at: 1|1}", "E304", "has no t60 of its own"),
        ("{set: bell.s.3.f, to: A3, over: 1, at: 1|1}", "E304", "changes as a whole"),
        ("{set: bell.p.t60, to: 3s, over: 1, at: 1|1}", "E304", "each of several frequencies"),
        ("{set: bell.r.f, to: A3, over: 1, at: 1|1}", "E201", "write a factor"),
        ("{set: bell.l.K, to: x2, over: 1, at: 1|1}", "E304", "is an LNL"),
        ("{set: bell.m.f, to: A3, at: 1|1}", "E103", "needs `over`"),
        ("{set: bell.m.f, to: A3, over: 0, at: 1|1}", "E202", "above 0"),
        ("{set: bell.m.f, to: A3 C4, over: 1, at: 1|1}", "E201", "one value"),
        ("{set: bell.m.K, to: 0N/m, over: 1, at: 1|1}", "E202", "no factor leads away from 0"),
        ("{set: bell.m.f, to: A3, over: 1, every: 1, at: 1|1}", "E111", "no steps"),
        ("{set: bell.m.f, to: A3 C4, every: 1, curve: line, at: 1|1}", "E111", "has a way"),
        ("{set: bell.m.f, to: A3@0 C4@1, over: 1, at: 1|1}", "E111", "times of its own"),
        ("{set: bell.m.f, to: A3@0 smooth H4@1, at: 1|1}", "E201", "neither a frequency"),
        ("{set: bell.m.f, to: A3@0 smoth C4@1, at: 1|1}", "E204", "unknown word"),
        ("{set: bell.m.f, to: A3@0 throw C4@1, at: 1|1}", "E204", "is for gestures only"),
        ("{set: bell.m.f, to: A3@0 hold C4@1, at: 1|1}", "E204", "keeps the value"),
        ("{set: bell.m.f, to: A3@1 C4@2, at: 1|1}", "E204", "begins at 0"),
        ("{lfo: bell.m.f, range: 1..2, period: 1, over: 1, at: 1|1}", "E111", "does not belong"),
        ("{set: bell.q.f, to: A3, every: 1, at: 1|1}", "E301", "bell.q"),
        ("{lfo: bell.m.f, range: 0.8, period: 1, at: 1|1}", "E201", "is not a range"),
        ("{lfo: bell.m.f, range: 0.8..1.2, period: 0, at: 1|1}", "E202", "above 0"),
        ("{lfo: bell.m.f, range: 1..2, period: 1, every: 1, at: 1|1}", "E111", "does not belong"),
        ("{set: bell.m.f, to: A3, every: 1, at: Z}", "E301", "no mark is called"),
    ],
)  # fmt: skip
def test_automation_mistakes_and_codes(line, code, words):
    loaded = load("s.yaml", text=SCORE.format(lines=line, seed=1, tail=1))
    assert loaded.piece is None
    assert (loaded.diagnostics[0].code, words in loaded.diagnostics[0].message) == (code, True), (
        loaded.diagnostics
    )


def test_automation_changes_digest():
    first, other = piece("{set: bell.m.f, to: A3, every: 1, at: 1|1}"), piece("")
    assert digest_of(first) != digest_of(other)
    assert prepare(other).paths == {}
    spans = [Span(first, Window(0.0, 4.0))]
    assert prepare(first, spans=spans).paths.keys() == {("bell", "m")}


def test_notes_of_strikes_set_pitch_at_strike():
    strikes = "strikes: {tune: {to: bell.m, at: 1|1, notes: A3 C4 ~ (E4 A4), every: 1, times: 1,"
    text = SCORE.format(lines="", seed=1, tail=3.0).replace(", X0: 1mm", ", t60: 300ms")
    loaded = load("s.yaml", text=f"{text}{strikes} impulse: 0.1mNs}}}}\n")
    assert loaded.piece is not None, loaded.diagnostics
    complete = stage(loaded.piece)
    sound = np.zeros((complete.n_frames, complete.simulation.n_out))
    complete.simulation.process(sound)
    rate = int(complete.rate)
    level = [np.abs(sound[int(t * rate) : int((t + 0.05) * rate), 0]).max() for t in range(4)]
    assert min(level[0], level[1], level[3]) > 20 * level[2]  # a rest
    for begin, f in ((0.0, 220.0), (1.0, 261.6256), (3.0, 329.6276), (3.5, 440.0), (4.5, 440.0)):
        # From the strike on: the pitch is there when it falls, and stays after the last one.
        single = sound[int(begin * rate) + 2 : int((begin + 0.3) * rate), 0]
        assert pitch(single, rate) == pytest.approx(f, rel=3e-3), begin


def test_notes_of_instrument_without_members_name_the_field():
    """A library's flute has a pitch, and one voice."""
    text = (
        "ergon: 1\nuse: [instruments/winds.yaml]\n"
        "strikes: {tune: {to: flute, at: 1|1, notes: A4 D5, every: 1, impulse: 1mNs}}\n"
        "mix: {channels: 1, route: [{from: flute, to: 1}]}\n"
    )
    (diagnostic,) = load("s.yaml", text=text).diagnostics
    assert (diagnostic.code, "notes: [C4, D4]" in str(diagnostic.help)) == ("E304", True)


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        ("to: bell.m, notes: A3 H4, every: 1", "E201", "neither a frequency"),
        ("to: bell.m, notes: A3", "E103", "write `every`"),
        ("to: bell.m, notes: A3, rate: 1Hz, for: 4", "E111", "strikes by chance have no steps"),
        ("to: drum, notes: A3, every: 1", "E304", "has no pitch of its own"),
    ],
)
def test_notes_of_strikes_mistakes_and_codes(fields, code, words):
    text = SCORE.format(lines="", seed=1, tail=3.0).replace(
        "automation:",
        "  drum: {BANK: {count: 3, f: 99Hz, t60: 1s, M: 1g}, out: {SOX: drum.all}}\nautomation:",
    )
    fields = fields.replace("to: drum", "to: drum.all")
    strikes = f"strikes: {{tune: {{at: 1|1, impulse: 1mNs, {fields}}}}}\n"
    loaded = load("s.yaml", text=text + strikes)
    assert loaded.piece is None
    result = loaded.diagnostics[0]
    assert (result.code, words in result.message) == (code, True), result
