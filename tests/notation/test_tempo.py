"""Bars, beats and seconds, against numerical integration and by hand."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from ergon.notation.clock.meter import Meter, parse_meter
from ergon.notation.clock.positions import Length, Position, parse_length, parse_position
from ergon.notation.clock.tempo import Entry, TempoError, TempoMap, parse_bpm
from ergon.notation.text.errors import TextError
from ergon.notation.text.values import Time


def entry(beat, bpm=None, over=None, meter=None):
    """An entry as a score writes it."""
    start, end = (None, None) if bpm is None else parse_bpm(str(bpm))
    return Entry(
        parse_position(beat),
        start,
        end,
        None if over is None else parse_length(over),
        None if meter is None else parse_meter(meter),
    )


def tempo(*entries, **marks):
    return TempoMap(
        [entry(*e) for e in entries], {name: parse_position(at) for name, at in marks.items()}
    )


def resolve(tempo_map, text):
    return tempo_map.resolve(parse_position(text))


EXAMPLE = tempo(("1|1", 60, None, "4/4"), ("9|1", "60 -> 96", "4bar"), A="1|1", B="5|1", C="9|1")


def test_tempo_map_without_entries():
    tempo_map = TempoMap()
    assert tempo_map.seconds(7.5) == 7.5
    assert tempo_map.bar_beat(7.5) == (2, 4.5)


def test_tempo_ramp_of_example_lasts_12_533_seconds():
    ramp = EXAMPLE.seconds(48) - EXAMPLE.seconds(32)
    assert ramp == pytest.approx(60 * 16 * math.log(96 / 60) / 36, rel=1e-14)
    assert round(ramp, 3) == 12.533
    assert EXAMPLE.seconds(49) - EXAMPLE.seconds(48) == pytest.approx(60 / 96, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "beats"),
    [
        ("1|1", 0),
        ("3|2.5", 9.5),
        ("3|5/2", 9.5),
        ("A", 0),
        ("B", 16),
        ("B+2", 18),
        ("B-1/2", 15.5),
        ("B+2bar", 24),
        ("C-1bar", 28),
        ("B+500ms", 16.5),
        ("B + 2", 18),
        ("B - 1/2", 15.5),
        ("2|3 + 1bar", 10),
        ("0", 0),
        ("4", 4),
        ("12.5s", 12.5),
        ("250ms", 0.25),
        ("2|3+1", 7),
    ],
)
def test_resolve_positions_in_example(text, beats):
    assert resolve(EXAMPLE, text) == pytest.approx(beats, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "marked", "words"),
    [
        ("0|1", "0|1", "count from 1"),
        ("1|0.5", "1|0.5", "count from 1"),
        ("3|x", "3|x", "not a position"),
        ("2bar", "2bar", "is not a position"),
        ("12kg", "kg", "does not measure time"),
        ("B+2kg", "kg", "does not measure time"),
        ("B+", "B+", "not a position"),
        ("1/0", "1/0", "divides by zero"),
        ("1e99", "1e99", "too large"),
        ("-4", "-4", "not a position"),
        ("", "", "not a position"),
    ],
)
def test_parse_position_mistake_places(text, marked, words):
    with pytest.raises(TextError) as caught:
        parse_position(text)
    error = caught.value
    assert text[error.offset : error.offset + error.length] == marked
    assert words in error.message


def test_unknown_mark_suggestion():
    tempo_map = tempo(verse="1|1", chorus="5|1")
    with pytest.raises(TextError, match="unknown mark 'chours'") as caught:
        resolve(tempo_map, "chours+2")
    assert (caught.value.suggestion, caught.value.offset, caught.value.length) == ("chorus", 0, 6)
    with pytest.raises(TextError, match="before the beginning"):
        resolve(tempo_map, "verse-1")
    with pytest.raises(TextError, match="bar 3 has 4 beats"):
        resolve(tempo_map, "3|5")


def test_marks_placed_by_other_marks():
    tempo_map = tempo(A="3|1", B="A+8bar", C="B-2", D="A+1s")
    assert resolve(tempo_map, "C+1") == 8 + 32 - 2 + 1
    assert resolve(tempo_map, "D") == 9


def test_circular_marks_are_reported():
    tempo_map = tempo(A="B+1", B="C", C="A")
    with pytest.raises(TextError, match="A -> B -> C -> A"):
        resolve(tempo_map, "A")
    deep = TempoMap((), {f"m{i}": parse_position(f"m{i + 1}") for i in range(5000)})
    with pytest.raises(TextError, match="more than 64"):
        resolve(deep, "m0")


def test_mark_named_like_difference():
    marks = {"verse-2": parse_position("5|1"), "verse": parse_position("3|1")}
    tempo_map = TempoMap((), marks)
    assert resolve(tempo_map, "verse-2") == 16
    assert resolve(tempo_map, "verse-1") == 7


def test_tempo_entries_at_marks_and_seconds():
    tempo_map = tempo(("A", 120), ("8s", 60), A="2|1", B="10s")
    assert tempo_map.seconds(4) == 4
    assert resolve(tempo_map, "8s") == 12
    assert resolve(tempo_map, "B") == 14


def test_meter_changes_at_bars():
    tempo_map = tempo(("1|1", 60, None, "3/4"), ("3|1", 120, None, "3+2+2/8"), ("5|1", 90))
    assert tempo_map.bar_beat(6) == (3, 1)
    assert tempo_map.bar_beat(12.5) == (3, 7.5)
    assert tempo_map.bar_beat(13) == (4, 1)
    assert tempo_map.bar_beat(13 - 1e-12) == (4, 1)
    assert tempo_map.seconds(20) == 6 + 14 / 2
    assert resolve(tempo_map, "2|1+3bar") == 6 + 14
    assert tempo_map.bars.changes()[-1][2] == Meter(7, 8, (3, 2, 2))
    assert [(b, bar, str(m)) for b, bar, m in tempo_map.bars.changes()] == [
        (0, 1, "3/4"), (6, 3, "3+2+2/8"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("entries", "which", "field", "words"),
    [
        ([("1|1", 60, None, "4/4"), ("2|3", None, None, "3/4")], 1, "at", "not at 2|3"),
        ([("3|1", 60), ("2|1", 70)], 1, "at", "order of time"),
        ([("1|1", "60 -> 96")], 0, "bpm", "needs a length"),
        ([("1|1", 60, "4bar")], 0, "over", "needs a ramp"),
        ([("1|1", None, "4bar")], 0, "over", "has no tempi"),
        ([("1|1", "60 -> 90", "0bar")], 0, "over", "above 0"),
        ([("1|1", "60 -> 90", "4bar"), ("3|1", 70)], 1, "at", "before the ramp"),
        (
            [("1|1", "60 -> 90", "4bar"), ("3|1", None, None, "3/4")],
            1,
            "meter",
            "in beats",
        ),
    ],
)
def test_invalid_tempo_entries_and_fields(entries, which, field, words):
    with pytest.raises(TempoError) as caught:
        tempo(*entries)
    assert (caught.value.entry, caught.value.field) == (which, field)
    assert words in caught.value.message


def test_meter_change_inside_tempo_ramp():
    tempo_map = tempo(("1|1", "60 -> 96", "16"), ("3|1", None, None, "3/4"))
    assert tempo_map.seconds(16) == pytest.approx(12.533, abs=5e-4)
    assert tempo_map.bar_beat(16) == (5, 3)


def test_tempo_ramp_over_seconds():
    tempo_map = tempo(("1|1", "60 -> 96", "8s"))
    end = tempo_map.beats(8)
    assert tempo_map.bpm(end) == pytest.approx(96, rel=1e-12)
    assert tempo_map.seconds(end + 96) == pytest.approx(8 + 60, rel=1e-12)


@pytest.mark.parametrize("text", ["4", "4/5", "0/4", "4/4/4", "3++2/8", "999/4", "+3/8", "x"])
def test_wrong_meters_are_refused(text):
    with pytest.raises(TextError):
        parse_meter(text)


@pytest.mark.parametrize(
    ("text", "marked"), [("0", "0"), ("60 > 96", "60 > 96"), ("60 -> 1e9", "1e9"), ("", "")]
)
def test_wrong_tempos_are_refused_with_their_place(text, marked):
    with pytest.raises(TextError) as caught:
        parse_bpm(text)
    assert text[caught.value.offset : caught.value.offset + caught.value.length] == marked


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("4bar", Length(bars=4)),
        ("1/4", Length(beats=0.25)),
        ("2beats", Length(beats=2)),
        ("250ms", Length(seconds=0.25)),
        (" 12s", Length(seconds=12)),
    ],
)
def test_parse_length_in_beats(text, length):
    assert parse_length(text) == length


bpms = st.floats(20, 300)
ramps = st.lists(st.tuples(bpms, bpms, st.floats(0.1, 40), st.floats(0, 40)), max_size=6)


def ramped(rows):
    """The map of ramps from a to b over `span` beats, each `gap` beats after the last."""
    entries, position = [], 0.0
    for a, b, span, gap in rows:
        position += gap
        entries.append(Entry(Position(plus=Length(beats=position)), a, b, Length(beats=span)))
        position += span
    return TempoMap(entries), position + 1.0


# quad says when rounding stops it short of 1e-10; whether the sum is right is asserted anyway.
@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")
@given(ramps, st.floats(0, 1))
def test_seconds_are_the_integral_of_seconds_per_beat(rows, part):
    tempo_map, end = ramped(rows)
    beats = part * end
    corners = sorted({e for e in tempo_map._starts if 0 < e < beats})  # the integrand jumps there
    bounds = [0.0, *corners, beats]
    total = sum(
        quad(lambda b: 60 / tempo_map.bpm(b), lo, hi, epsabs=1e-12, epsrel=1e-10, limit=200)[0]
        for lo, hi in pairwise(bounds)
    )
    assert tempo_map.seconds(beats) == pytest.approx(total, rel=1e-9, abs=1e-9)


@given(ramps, st.floats(-0.2, 1.2))
def test_beats_and_seconds_are_inverse(rows, part):
    tempo_map, end = ramped(rows)
    beats = part * end
    assert tempo_map.beats(tempo_map.seconds(beats)) == pytest.approx(beats, rel=1e-11, abs=1e-11)


@given(bpms, st.floats(-1e-3, 1e-3))
def test_tempo_ramp_with_tiny_change_is_exact(bpm, change):
    tempo_map, _ = ramped([(bpm, bpm + change, 64.0, 0.0)])
    u = change / bpm
    exact = 60 * 64 / bpm * (math.log1p(u) / u if u else 1.0)
    assert tempo_map.seconds(64.0) == pytest.approx(exact, rel=2e-15)
    assert tempo_map.beats(tempo_map.seconds(32.0)) == pytest.approx(32.0, rel=4e-15)


def test_instant_adds_beats_then_seconds():
    assert EXAMPLE.instant(16, Time(0.5, 0.02)) == pytest.approx(16.52)
    assert EXAMPLE.instant(0, Time(-0.5, 0)) == -0.5
    ramp_first = tempo(("1|1", "20 -> 300", "4"))
    assert ramp_first.seconds(-2) == -6
    assert ramp_first.beats(-6) == -2


def test_tempo_entries_at_same_instant_are_refused():
    entries = [Entry(parse_position("1|1"), bpm, None, None, None) for bpm in (60.0, 90.0)]
    with pytest.raises(TempoError) as raised:
        TempoMap(entries)
    assert (raised.value.entry, raised.value.field) == (1, "at")


@pytest.mark.parametrize("text", ["72..108", "72 .. 108", "72-108", "72 to 108", "72 → 108"])
def test_misspelt_tempo_ramp_suggestion(text):
    with pytest.raises(TextError) as raised:
        parse_bpm(text)
    assert raised.value.suggestion == "72 -> 108"


@pytest.mark.parametrize(
    ("text", "suggestion"),
    [("5:1", "5|1"), ("5 : 1.5", "5|1.5"), ("bar 5", "5|1"), ("2 s", "2s"), ("x y", None)],
)
def test_misspelt_position_suggestion(text, suggestion):
    with pytest.raises(TextError) as raised:
        parse_position(text)
    assert raised.value.suggestion == suggestion


def test_length_with_space_suggestion():
    with pytest.raises(TextError) as raised:
        parse_length("2 bars")
    assert raised.value.suggestion == "2bars"
