"""What has ended is not expanded again, and what goes on has the same points, bit by bit."""

from __future__ import annotations

import math
import random
from bisect import bisect_right

import pytest
from sweep import few

from ergon.notation.text.errors import Collector
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging import parameter_curves
from ergon.scores.staging.automating import automation_points, takeover_points
from ergon.scores.staging.parameter_curves import SWING_SEGMENTS, Entry, swing_beats
from ergon.scores.staging.parameter_values import AutomatedModule

SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}, {{at: 9|1, bpm: 60 -> 90, over: 4bar}}]
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, t60: 1s}}}}
      n: {{CEL: {{M: 2g, K: 900N/m, Z: 0.2Ns/m}}}}
    out: {{SOX: m}}
strikes: {{{strikes}}}
automation: [{lines}]
"""
BEATS = 120  # in all
AHEAD = 0.03  # [s] by which a version takes over before the beat from which it plays


def piece(lines: str, strikes: str = "") -> Piece:
    loaded = load("s.yaml", text=SCORE.format(lines=lines, strikes=strikes))
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def _entry(rnd: random.Random, beat: float) -> str:
    name, values = rnd.choice(
        [
            ("bell.m.f", ["A3", "C4", "x1.2", "E4"]),
            ("bell.m.t60", ["1s", "2s", "x0.5"]),
            ("bell.n.K", ["1kN/m", "x2", "x0.5"]),
            ("bell.n.Z", ["x2", "0.5Ns/m", "x3"]),
        ]
    )
    length = rnd.choice([0.01, 0.02, 0.1, 0.5, 1, 4, 7.3, 30])
    until = f", until: {beat + length}" if rnd.random() < 0.4 else ""
    position = f"at: {beat}{until}"
    kind = rnd.choice(["swing", "glide", "curve", "pattern", "pattern"])
    if kind == "swing":
        shape = rnd.choice(["sine", "triangle", "ramp", "square"])
        period = rnd.choice(["1/2", "1", "3", "4bar", "20bar", "1.7s"])
        phase = rnd.choice([0, 0.3])
        fields = f"range: 0.8..1.2, period: {period}, shape: {shape}, phase: {phase}"
        return f"{{lfo: {name}, {fields}, {position}}}"
    if kind == "glide":
        over = rnd.choice(["10ms", "0.3", "1", "1bar", "8bar", "40bar"])
        method = rnd.choice(["line", "smooth"])
        return (
            f"{{set: {name}, to: {rnd.choice(values)}, over: {over}, curve: {method}, {position}}}"
        )
    if kind == "curve":
        times = sorted(rnd.sample([0.5, 1, 2, 5, 20], 2))
        some = [rnd.choice(values) for _ in range(3)]
        path = f"{some[0]}@0 smooth {some[1]}@{times[0]} line {some[2]}@{times[1]}"
        return f"{{set: {name}, to: {path}, {position}}}"
    some = " ".join([values[0], *(rnd.choice([*values, "~"]) for _ in range(rnd.randint(1, 3)))])
    every = rnd.choice(["1/8", "1/3", "1", "2bar", "9bar"])
    times = "" if until else f", times: {rnd.choice([1, 3, 40])}"
    return f"{{set: {name}, to: {some}, every: {every}{times}, {position}}}"


def _random_piece(seed: int) -> Piece:
    rnd = random.Random(seed)
    beats = {rnd.choice([rnd.randrange(BEATS), round(rnd.uniform(0, BEATS), 2)]) for _ in range(40)}
    beats |= {beat + rnd.choice([0.005, 0.02]) for beat in [*beats][:6]}
    lines = ", ".join(_entry(rnd, beat) for beat in sorted(beats))
    tune = f"{{to: bell.m, at: 5|1, notes: A3 C4 ~ E4, every: {rnd.choice([1, 3])}"
    strikes = f"tune: {tune}, times: 3, impulse: 0.1mNs}}" if rnd.random() < 0.5 else ""
    return piece(lines, strikes)


@pytest.mark.parametrize("seed", few(range(12), range(5)))
def test_automation_points_from_instant_equal_complete_points(seed: int):
    source, rnd = _random_piece(seed), random.Random(seed)
    collector = Collector()
    for _ in range(6):
        beat = rnd.choice([rnd.uniform(1, BEATS + 20), rnd.randrange(1, BEATS) + 1e-3])
        begins = source.tempo_map.seconds(beat) - AHEAD
        complete = automation_points(source, -math.inf, beat + 16, collector).points
        some = automation_points(source, beat, beat + 16, collector, begins).points
        assert not collector.has_errors(), collector.finish()
        for where in complete.keys() | some.keys():
            alone = [(0.0, *led_of(source, where).written_engine_values)]
            item, expected = (
                _from(points.get(where) or alone, begins) for points in (some, complete)
            )
            assert item == expected, (where, begins)


def led_of(source: Piece, where: tuple[str, str]) -> AutomatedModule:
    led = AutomatedModule.from_piece(source, where)
    assert led is not None
    return led


def _from(points, begins: float):
    """Points from the last one at or before an instant on; of what is constant the values alone."""
    last = max(0, bisect_right(points, begins, key=lambda point: point[0]) - 1)
    here = points[last:]
    return here if len(here) > 1 else [points[last][1:]]


def _evening(count: int) -> Piece:
    """As many ended swings, glides, curves and patterns, and one swing that goes on."""
    kinds = [
        "{{lfo: bell.n.K, range: 0.8..1.2, period: 1, at: {at}, until: {end}}}",
        "{{set: bell.n.K, to: x2, over: 2, at: {at}, until: {end}}}",
        "{{set: bell.n.K, to: x2@0 smooth x1@2, at: {at}}}",
        "{{set: bell.n.K, to: x2 x3, every: 1, times: 1, at: {at}}}",
        "{{set: bell.n.K, to: x1.5, over: 1, at: {at}}}",
    ]
    lines = [kinds[i % len(kinds)].format(at=8 * i, end=8 * i + 4) for i in range(count)]
    swing = "{lfo: bell.m.f, range: 0.99..1.01, period: 1, at: 1|1}"
    return piece(", ".join([*lines, swing]))


def _counted(monkeypatch, source: Piece, beat: float) -> dict[str, int]:
    """How many points of curves and numbers of modules are made for a line on a beat."""
    counts = {"points": 0, "numbers": 0}
    to, numbers = parameter_curves.Curve.add_point, AutomatedModule.engine_values

    def counted_to(self, instant, value):
        counts["points"] += 1
        to(self, instant, value)

    def counted_numbers(self, said):
        counts["numbers"] += 1
        return numbers(self, said)

    with monkeypatch.context() as patched:
        patched.setattr(parameter_curves.Curve, "add_point", counted_to)
        patched.setattr(AutomatedModule, "engine_values", counted_numbers)
        begins = source.tempo_map.seconds(beat) - AHEAD
        automation_points(source, beat, beat + 16, Collector(), begins)
    return counts


def test_points_of_ended_entries_are_not_expanded(monkeypatch):
    few, many = (_counted(monkeypatch, _evening(count), 4800.0) for count in (5, 500))
    assert few == many
    assert few["points"] < 1200, few  # those of the swing: 16 beats and a period


@pytest.mark.parametrize("period", ["1", "1/3", "1bar", "2.5bar", "900ms"])
def test_points_of_swing_lie_where_the_tempo_map_puts_them(period: str):
    source = piece(f"{{lfo: bell.n.K, range: 0.8..1.2, period: {period}, at: 7|2.3}}")
    first, tempo = source.automation[0], source.tempo_map
    assert first.swing is not None
    begin = tempo.resolve(first.at)
    beat_of = swing_beats(tempo, Entry(first, begin, math.inf), first.swing)
    for number in range(2000):
        assert beat_of(number) == tempo.after(
            begin, first.swing.period.times(number / SWING_SEGMENTS)
        )


def test_glide_under_way_is_expanded_from_the_window_on(monkeypatch):
    line = "{set: bell.n.K, to: x2, over: 100, at: 1|1}"
    begun, late = (_counted(monkeypatch, piece(line), beat) for beat in (1.0, 95.0))
    assert late["points"] < 0.2 * begun["points"]


def test_module_glided_back_remains_automated():
    source = piece(
        "{set: bell.n.K, to: x2, over: 1, at: 1|1}, {set: bell.n.K, to: x1, over: 1, at: 2}"
    )
    led = led_of(source, ("bell", "n"))
    result = automation_points(source, 60.0, 76.0, Collector(), 59.9)
    assert {point[1:] for point in result.points["bell", "n"]} == {led.written_engine_values}
    paths = takeover_points({}, result.points, source, 59.9, 75.0, result.permanent_modules)
    assert paths.keys() == {("bell", "n")}
    assert takeover_points({}, result.points, source, 59.9, 75.0) == {}
