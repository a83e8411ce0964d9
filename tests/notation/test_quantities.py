import math
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.tables import notes
from ergon.notation.tables import quantities as q
from ergon.notation.text.errors import TextError


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("400g", q.MASS, 0.4),
        ("2g", q.MASS, 0.002),
        ("4e-1", q.STIFFNESS, 0.4),
        ("1e3", q.STIFFNESS, 1000.0),
        ("8kN/m", q.STIFFNESS, 8000.0),
        ("2N/mm", q.STIFFNESS, 2000.0),
        ("012", q.STIFFNESS, 12.0),
        ("1mm", q.POSITION, 0.001),
        ("-15mm", q.POSITION, -0.015),
        ("3 µm", q.POSITION, 3e-6),
        ("1/8m", q.POSITION, 0.125),
        ("1/3mm", q.POSITION, float(Fraction(1, 3000))),
        (".5mNs", q.IMPULSE, 0.0005),
        ("1uNs", q.IMPULSE, 1e-6),
        ("4e8N/m3", q.HARDENING, 4e8),
        ("44.1kHz", q.RATE, 44100.0),
        ("250ms", q.DURATION, 0.25),
        ("0", q.INSTANT, 0.0),
        ("120mNs/m", q.DAMPING, 0.12),
    ],
)
def test_quantity_values_with_units(text, dimension, value):
    assert q.quantity(text, dimension) == value


@given(
    st.decimals(-(10**6), 10**6, allow_nan=False, places=7),
    st.sampled_from(sorted(q.CONSTANT.units.items())),
)
def test_quantity_units_are_correctly_rounded(number, unit):
    name, power = unit
    text = f"{number:f}{name}"
    exact = Fraction(Decimal(number)) * Fraction(10) ** power
    assert q.quantity(text, q.CONSTANT) == float(exact)


@pytest.mark.parametrize(
    ("text", "dimension", "meant"),
    [
        ("4.5sec", q.DURATION, "s"),
        ("2 seconds", q.DURATION, "s"),
        ("300msec", q.DURATION, "ms"),
        ("220hertz", q.FREQUENCY, "Hz"),
        ("2KHZ", q.FREQUENCY, "kHz"),
        ("3grams", q.MASS, "g"),
        ("1kilogram", q.MASS, "kg"),
        ("-6db", q.LEVEL, "dB"),
        ("30degrees", q.AZIMUTH, "deg"),
        # The nearest word is a thousand times as much, or a thousand million times less.
        ("3ng", q.MASS, None),
        ("1MHz", q.FREQUENCY, None),
        ("20ug", q.MASS, None),
        ("5MN/m", q.STIFFNESS, None),
        ("5Ms", q.DURATION, None),
    ],
)
def test_unknown_unit_suggestion(text, dimension, meant):
    with pytest.raises(TextError) as error:
        q.quantity(text, dimension)
    assert error.value.code == "E203"
    assert error.value.suggestion == meant


@pytest.mark.parametrize(
    ("text", "dimension", "code", "part"),
    [
        ("400N", q.MASS, "E203", "unit 'N' does not measure mass (use kg, g, mg)"),
        ("60N/mm/s", q.STIFFNESS, "E203", "unknown unit"),
        ("-1g", q.MASS, "E202", "not positive"),
        ("0g", q.MASS, "E202", "not positive"),
        ("-1N/m", q.STIFFNESS, "E202", "negative"),
        (".nan", q.MASS, "E201", "finite"),
        ("-.inf", q.POSITION, "E201", "finite"),
        ("1e12Hz", q.FREQUENCY, "E202", "above the maximum of 1e+06Hz"),
        ("10Hz", q.RATE, "E202", "below the minimum of 1000Hz"),
        ("1e400", q.STIFFNESS, "E202", "too large"),
        ("1e9999g", q.MASS, "E202", "too large"),
        ("1e99999999999", q.STIFFNESS, "E201", "not a number"),
        ("1:30", q.DURATION, "E201", "clock"),
        ("1_000", q.STIFFNESS, "E201", "without"),
        ("1,5", q.STIFFNESS, "E201", "point"),
        ("2.5", q.DURATION, "E203", "no unit"),
        ("0.5m", q.RATIO, "E203", "no unit"),
        ("1/0", q.RATIO, "E202", "zero"),
        ("", q.MASS, "E201", "no value"),
        ("x" * 100, q.MASS, "E201", "more than 64 characters"),
        ("٣g", q.MASS, "E201", "character"),
        ("fast", q.SPEED, "E201", "0.5m/s"),
    ],
)
def test_quantity_refusals_and_suggestions(text, dimension, code, part):
    with pytest.raises(TextError) as caught:
        q.quantity(text, dimension)
    assert caught.value.code == code
    assert part in caught.value.message


def test_missing_unit_suggestion():
    with pytest.raises(TextError) as caught:
        q.quantity("2.5", q.DURATION)
    assert caught.value.suggestion == "2.5s"
    with pytest.raises(TextError) as caught:
        q.quantity("60Nm", q.STIFFNESS)
    assert (caught.value.suggestion, caught.value.offset) == ("N/m", 2)


@pytest.mark.parametrize(
    ("note", "midi"), [("A4", 69), ("A1", 33), ("C4", 60), ("C#4", 61), ("Bb2", 46), ("B3", 59)]
)
def test_frequency_of_notes(note, midi):
    assert q.frequency(note) == pytest.approx(440 * 2 ** ((midi - 69) / 12), rel=1e-15)


def test_frequency_of_octaves_of_a_is_exact():
    assert [q.frequency(f"A{i}") for i in range(1, 8)] == [55.0 * 2**i for i in range(7)]


def test_transposition_in_cents():
    assert q.frequency("A3+20cents") == pytest.approx(220 * 2 ** (20 / 1200), rel=1e-15)


def test_span_of_quantities():
    def read(text):
        return q.quantity(text, q.POSITION)

    assert q.span("-15mm..15mm", read, "") == (-0.015, 0.015)
    assert q.span("-15..15mm", read, "") == (-0.015, 0.015)
    assert q.span("20Hz..10kHz", q.frequency, "") == (20.0, 10000.0)
    assert q.span("A1..A3", q.frequency, "") == (55.0, 220.0)
    with pytest.raises(TextError, match="downwards"):
        q.span("5mm..1mm", read, "")
    with pytest.raises(TextError) as caught:
        q.span("1mm..5N", read, "")
    assert caught.value.offset == 6


def test_gain_in_db_and_factor():
    assert q.gain("x0.5") == 0.5
    assert q.gain("0dB") == 1.0
    assert q.gain("-6dB") == pytest.approx(10 ** (-6 / 20), rel=1e-15)
    with pytest.raises(TextError, match="no unit"):
        q.gain("-6")


def test_integer_forms_and_refusals():
    assert q.integer("1e4", 0, 10**6) == 10_000
    assert q.integer("18446744073709551615", 0, 2**64 - 1) == 2**64 - 1
    for text in ("1.5", "1e11", "-1", "abc", "1e300"):
        with pytest.raises(TextError):
            q.integer(text, 0, 10**7)


@given(st.text(max_size=80))
def test_quantity_of_random_text_raises_text_error_only(text):
    for read in (
        q.frequency,
        q.gain,
        q.factor,
        lambda t: q.quantity(t, q.CONSTANT),
        lambda t: q.span(t, q.frequency, ""),
        lambda t: q.integer(t, 0, 9),
    ):
        try:
            value = read(text)
        except TextError:
            continue
        assert all(map(math.isfinite, value if isinstance(value, tuple) else (value,)))


@pytest.mark.parametrize(
    ("text", "suggestion"),
    [
        ("H3", "B3"),
        ("Cis4", "C#4"),
        ("Es3", "Eb3"),
        ("as2", "Ab2"),
        ("c4", "C4"),
        ("C4#", "C#4"),
        ("bb3", "Bb3"),
        ("Cis4#", None),
        ("X3", None),
        ("440hz", "Hz"),
    ],
)
def test_notes_of_other_spellings_are_suggested(text, suggestion):
    with pytest.raises(TextError) as raised:
        q.frequency(text)
    assert raised.value.suggestion == suggestion


@pytest.mark.parametrize(
    ("text", "dimension", "suggestion"),
    [
        ("4,5s", q.DURATION, "4.5s"),
        ("1,000g", q.MASS, "1000g"),
        ("10_000N/m", q.STIFFNESS, "10000N/m"),
        ("0,0005m", q.POSITION, "0.0005m"),
        ("\u22125mm", q.POSITION, "-5mm"),
    ],
)
def test_numbers_of_other_spellings_are_suggested(text, dimension, suggestion):
    with pytest.raises(TextError) as raised:
        q.quantity(text, dimension)
    assert raised.value.suggestion == suggestion
    q.quantity(suggestion, dimension)


def test_gain_without_unit_suggestion():
    with pytest.raises(TextError, match=r"write x0\.5 for a factor, or 0\.5dB") as raised:
        q.gain("0.5")
    assert raised.value.suggestion == "x0.5"


def test_nearest_note_of_frequency():
    assert notes.nearest_note(440.0) == ("A4", 0.0)
    assert notes.nearest_note(311.0) == ("Eb4", pytest.approx(-0.70674, abs=1e-4))
    assert notes.nearest_note(8.0)[0] == "C-1"


@pytest.mark.parametrize(
    ("text", "dimension", "readings"),
    [
        ("400", q.MASS, ("400g", "400kg")),
        ("2.5", q.DURATION, ("2.5s", "2.5ms")),
        ("7850", q.DENSITY, ("7850kg/m3", "7850g/cm3")),
        ("200", q.PRESSURE, ("200GPa", "200Pa")),
    ],
)
def test_bare_number_lists_possible_units(text, dimension, readings):
    with pytest.raises(TextError) as caught:
        q.quantity(text, dimension)
    assert caught.value.code == "E203"
    assert caught.value.message.endswith("it could be {} or {}".format(*readings))
    assert caught.value.suggestion == readings[0]
    for reading in readings:
        assert q.quantity(reading, dimension) is not None


@pytest.mark.parametrize(("text", "note"), [("60", "C4"), ("127", "G9"), ("1", "C#-1")])
def test_pitch_like_midi_number_suggests_note(text, note):
    with pytest.raises(TextError) as caught:
        q.frequency(text)
    assert f"{text}Hz, or the note {note}," in caught.value.message


@pytest.mark.parametrize("text", ["128", "440", "60.5", "60Hz"])
def test_pitch_unlike_midi_number_is_accepted(text):
    assert q.frequency(text) == float(text.removesuffix("Hz"))
