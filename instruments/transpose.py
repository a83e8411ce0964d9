"""Instruments at another pitch: all times in them are divided by one ratio.

Dividing times by r multiplies all eigenvalues by r. So the pitch of each mode is multiplied by
exactly r, and its T60 is divided by r: stiffnesses are multiplied by r², viscosities by r, and
masses and lengths stay. Modules below audible frequencies (a hammer, a mallet) count as mechanics
and stay, as does friction, a damping without a law.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from ergon import _core
from ergon.instruments.matter import from_material
from ergon.instruments.modal import Each
from ergon.instruments.modal_band import Band
from ergon.instruments.module_kinds import KINDS
from ergon.instruments.starts import Start
from ergon.instruments.stiff import Stretched
from ergon.notation.tables import quantities
from ergon.notation.tables.fields import Values
from ergon.notation.tables.octaves import octaves_of_ratio
from ergon.notation.tables.shapes import MISSING, Text
from ergon.notation.text.errors import TextError, quote

AUDIBLE_FREQUENCY_MIN = 20.0  # [Hz] slower CELs are mechanics
CENTS_MAX = 12000.0  # ten octaves
_EXAMPLE = "7st, -14cents or 3/2"
_RATIO = re.compile(r"\d{1,15}/\d{1,15}")
_INTERVAL = re.compile(r"([+-]?(?:\d{1,5}\.?\d{0,6}|\.\d{1,6})) *(st|cents?)")
_A4_FREQUENCY = 440.0


@dataclass(frozen=True, slots=True)
class Interval:
    """The step from one pitch to another: in cents if they are known, else as a ratio.

    `scale_steps` are those of a scale, if the interval is written in whole semitones.
    """

    ratio: float
    cents: float | None = None
    scale_steps: int | None = None

    @property
    def semitones(self) -> float:
        """The interval in semitones; an integer counts keys of a scale."""
        if self.scale_steps is not None:
            return self.scale_steps
        return 12.0 * octaves_of_ratio(self.ratio) if self.cents is None else self.cents / 100.0

    def plus(self, next_interval: Interval) -> Interval:
        """The sum of this interval and another."""
        if self.cents is not None and next_interval.cents is not None:
            return interval_of_cents(self.cents + next_interval.cents)
        return Interval(_decimal_product(self.ratio, next_interval.power(1)))

    def inverse(self) -> Interval:
        """The inverse interval."""
        if self.cents is not None:
            return interval_of_cents(-self.cents)
        return Interval(float(1 / Fraction(repr(self.ratio))))

    def power(self, exponent: int) -> Fraction:
        """The ratio raised to an integer power."""
        if self.cents is None:
            return Fraction(repr(self.ratio)) ** exponent
        return Fraction(repr(_core.pow(2.0, exponent * self.cents / 1200.0)))


def interval_of_cents(cents: float) -> Interval:
    """An interval of `cents`."""
    return Interval(_core.pow(2.0, cents / 1200.0), cents)


def is_interval(word: str) -> bool:
    """Whether a word is an interval in semitones or cents, such as `7st`."""
    return _INTERVAL.fullmatch(word) is not None


def parse_interval(text: str) -> Interval:
    """Read `7st`, `-14cents`, `x1.5` or `3/2`. Raises TextError."""
    word = text.strip()
    if word.startswith("x") or _RATIO.fullmatch(word):
        ratio = quantities.factor(f"x{word.removeprefix('x')}")
        if not 1e-3 <= ratio <= 1e3:
            message = f"{quote(word)} lies outside the range from x0.001 to x1000"
            raise TextError(message, length=max(1, len(word)), code="E202")
        return Interval(ratio)
    match = _INTERVAL.fullmatch(word)
    if match is None:
        problem = f"{quote(word)} is not an interval" if word else "an interval is missing,"
        message = f"{problem} such as {_EXAMPLE}"
        is_number = re.fullmatch(r"[+-]?\d+(\.\d+)?", word)
        suggestion = f"{word}st" if is_number else None
        code = "E203" if is_number else "E201"
        raise TextError(message, length=max(1, len(word)), suggestion=suggestion, code=code)
    amount = Fraction(match[1])
    cents = float(amount * (100 if match[2] == "st" else 1))
    if abs(cents) > CENTS_MAX:
        message = f"{quote(word)} lies outside the range from -120st to 120st"
        raise TextError(message, length=len(word), code="E202")
    is_keys = match[2] == "st" and amount.denominator == 1
    return replace(interval_of_cents(cents), scale_steps=int(amount) if is_keys else None)


INTERVAL_SHAPE = Text(
    parse_interval,
    f"an interval, such as {_EXAMPLE}",
    r"^([+-]?[0-9.]+ *(st|cents?)|x[0-9./]+|[0-9]+/[0-9]+)$",
    types=("string",),
    is_value=True,
)


def _parse_cents(text: str) -> float:
    interval = parse_interval(text)
    return 1200.0 * octaves_of_ratio(interval.ratio) if interval.cents is None else interval.cents


CENTS_SHAPE = Text(_parse_cents, "an interval, such as 2st", is_value=True)  # in cents


def interval_between(low: float, high: float) -> Interval:
    """The interval from one frequency [Hz] to another."""
    low_cents, high_cents = _cents_above_a4(low), _cents_above_a4(high)
    return (
        Interval(high / low)
        if low_cents is None or high_cents is None
        else interval_of_cents(float(high_cents - low_cents))
    )


def transposed_frequency(frequency: float, interval: Interval) -> float:
    """A frequency [Hz] moved by an interval; the frequency of a note becomes exactly that of
    another note.
    """
    cents = _cents_above_a4(frequency) if interval.cents is not None else None
    if cents is not None and interval.cents is not None and (cents + interval.cents).is_integer():
        return _note_frequency(int(cents + interval.cents))
    return _decimal_product(frequency, interval.power(1))


def _decimal_product(value: float, factor: Fraction) -> float:
    """The float nearest to the product of two numbers as they are written in decimals."""
    return float(Fraction(repr(value)) * factor)


def _note_frequency(cents: int) -> float:
    """The frequency [Hz] of a note `cents` above A4, equal to that of its name to the last bit."""
    octaves, rest = divmod(cents, 1200)
    semitones, cents_over = divmod(rest, 100)
    semitones_above = semitones + cents_over / 100
    return math.ldexp(
        _A4_FREQUENCY * (_core.pow(2.0, semitones_above / 12) if semitones_above else 1.0), octaves
    )


def _cents_above_a4(frequency: float) -> int | None:
    """The cents above A4 of a frequency that belongs to a note exactly; None for any other."""
    if frequency <= 0.0:
        return None
    cents = round(1200.0 * octaves_of_ratio(frequency / _A4_FREQUENCY))
    return cents if _note_frequency(cents) == frequency else None


# --- instruments --------------------------------------------------------------------------------

# The power of the ratio that multiplies each field, except `f`, `points` and laws; other fields
# stay.
_RATIO_POWERS = {"t60": -1, "K": 2, "Z": 1, "V0": 1, "hardening": 2, "stretching": 2}


def transposed_base(base_values: Values, values: Values, *, is_root: bool) -> Values:
    """The base of an instrument, at the pitch that the instrument's own `f` and
    `transpose` ask for.

    For a root, which has no `like` or `from`, the base is the instrument itself. Reports a base
    without a pitch.
    """
    interval = values["transpose"] if values.written("transpose") else None
    frequency_range = values.by_name.get("f")
    if not is_root and isinstance(frequency_range, tuple) and base_values.written("modules"):
        if values.written("modules") and frequency_range[0] != frequency_range[1]:
            return base_values
        base_pitch = named_pitch(base_values)
        if base_pitch is None:
            message = (
                f"{values.context.label('f')}: {base_values.context.label('')} has no named "
                "pitch; write `f` beside its modules, the pitch at which they are written, or "
                "`transpose`"
            )
            values.error("E103", message, "f")
        elif frequency_range[0] == frequency_range[1]:
            step = interval_between(base_pitch, frequency_range[0])
            interval = step.plus(interval) if interval is not None else step
    if interval is None or (interval.ratio == 1.0 and is_root):
        return base_values
    if base_values["units"] == "ca" or values["units"] == "ca":
        field_name = "transpose" if values.written("transpose") else "f"
        message = (
            f"{values.context.label(field_name)}: under `units: ca` K and Z are those of a "
            "discrete network, whose modes no factor moves alike; write them in SI units"
        )
        values.error("E111", message, field_name)
        return base_values
    return _transposed_instrument(base_values, interval)


def instrument_at_note(values: Values, note: str) -> Values:
    """An instrument with `notes` at one of its notes; it must have a named pitch."""
    written_frequency, note_frequency = named_pitch(values), quantities.frequency(note)
    assert written_frequency is not None
    fields = {name: value for name, value in values.by_name.items() if name != "notes"}
    note_values = replace(values, by_name=fields)
    if not values.kind:
        note_values = _transposed_instrument(
            note_values, interval_between(written_frequency, note_frequency)
        )
    # Set `f` beside a generator, as if it were written.
    nodes = {"f": values.nodes["notes"], **values.nodes}
    return replace(
        note_values,
        by_name={**note_values.by_name, "f": (note_frequency, note_frequency)},
        nodes=nodes,
    )


def named_pitch(values: Values) -> float | None:
    """The named pitch [Hz] of an instrument: its `f`, or that of its only module with
    one.

    None for a range, and for mechanics.
    """
    written_pitch = values.by_name.get("f")
    if isinstance(written_pitch, tuple):
        return written_pitch[0] if written_pitch[0] == written_pitch[1] else None
    module_values = [
        body for body in (values["modules"] or {}).values() if isinstance(body, Values)
    ]
    frequencies = []
    for body_values in [values] if values.kind else module_values:
        fields = body_values.by_name.get(body_values.kind)
        if isinstance(fields, Values):
            fields = from_material(body_values.kind, fields, quietly=True) or fields
        frequency = fields.by_name.get("f") if isinstance(fields, Values) else None
        if isinstance(frequency, tuple) and body_values.kind == "MODES":
            frequency = min(frequency, default=None)
        elif (
            isinstance(frequency, tuple)
            and not isinstance(frequency, Each)
            and frequency[0] == frequency[1]
        ):
            frequency = frequency[0]
        if isinstance(frequency, float) and not (
            body_values.kind == "CEL" and frequency < AUDIBLE_FREQUENCY_MIN
        ):
            frequencies.append(frequency)
    return frequencies[0] if len(frequencies) == 1 else None


def _transposed_instrument(values: Values, interval: Interval) -> Values:
    fields = dict(values.by_name)
    if isinstance(fields.get("modules"), dict):
        fields["modules"] = {
            name: _transposed_body(body, interval) if isinstance(body, Values) else body
            for name, body in fields["modules"].items()
        }
    if values.kind and isinstance(body := fields.get(values.kind), Values):
        fields[values.kind] = _transposed_fields(values.kind, body, interval)
    for name in ("f", "t60"):
        if name in fields:
            fields[name] = transposed_value(name, fields[name], interval)
    return replace(values, by_name=fields)


def _transposed_body(body: Values, interval: Interval) -> Values:
    module_fields = body.by_name.get(body.kind, MISSING)
    if not isinstance(module_fields, Values):
        return body
    return replace(
        body,
        by_name={**body.by_name, body.kind: _transposed_fields(body.kind, module_fields, interval)},
    )


def _transposed_fields(kind: str, fields: Values, interval: Interval) -> Values:
    """The fields of one module moved by an interval; a law keeps the interval in `interval`, and is
    moved later.
    """
    if keeps_pitch(kind, fields.by_name):
        return fields
    fields = from_material(kind, fields, quietly=True) or fields
    moved_fields = {
        name: transposed_value(name, value, interval) for name, value in fields.by_name.items()
    }
    if KINDS[kind].role == "law" or fields.written("modes"):
        moved_fields["interval"] = (
            moved_fields["interval"].plus(interval) if "interval" in moved_fields else interval
        )
    return replace(fields, by_name=moved_fields)


def keeps_pitch(kind: str, fields: Mapping[str, Any]) -> bool:
    """Whether a module with these fields, in SI units, is not transposed: below audible
    frequencies, or friction.
    """
    frequency, stiffness, mass = (fields.get(name) for name in ("f", "K", "M"))
    if KINDS[kind].role == "friction":
        return True  # the module belongs to the bow
    if kind != "CEL":
        return False
    if isinstance(frequency, float):
        return frequency < AUDIBLE_FREQUENCY_MIN
    if not isinstance(stiffness, float) or not isinstance(mass, float):
        return False
    return stiffness < mass * (2.0 * math.pi * AUDIBLE_FREQUENCY_MIN) ** 2


def transposed_value(name: str, value: Any, interval: Interval) -> Any:
    """The value of a field of a module, moved by an interval."""
    if isinstance(value, tuple):
        if name == "points":
            return tuple((d, _decimal_product(force, interval.power(2))) for d, force in value)
        if name == "t60" and isinstance(value[0], tuple):
            return tuple(
                (transposed_frequency(f, interval), transposed_value(name, t, interval))
                for f, t in value
            )
        moved_values = (transposed_value(name, field_number, interval) for field_number in value)
        return Each(moved_values) if isinstance(value, Each) else tuple(moved_values)
    if isinstance(value, Band):
        f, t60 = (
            transposed_value("f", value.f, interval),
            transposed_value("t60", value.t60, interval),
        )
        return replace(value, f=f, t60=t60)
    if isinstance(value, Start):
        return replace(value, value=transposed_value(name, value.value, interval))
    if isinstance(value, Stretched):
        return replace(value, per_gap=_decimal_product(value.per_gap, interval.power(2)))
    if name == "f" and isinstance(value, float):
        return transposed_frequency(value, interval)
    power = _RATIO_POWERS.get(name)
    if power is None or not isinstance(value, float):
        return value
    return _decimal_product(value, interval.power(power))


def transpose_law(fields: dict[str, Any], interval: Interval) -> None:
    """Move a law that is written out: law(d) is multiplied by r², damping(d, v) becomes
    r²·damping(d, v/r).

    A damping without a law is friction, which stays.
    """
    if fields["law"] is None and fields["points"] is None:
        return
    ratio_squared = f"{float(interval.power(2))!r}"
    if fields["law"] is not None:
        fields["law"] = f"{ratio_squared}*({fields['law']})"
    if fields["damping"] is not None:
        slower_damping = re.sub(r"\bv\b", f"(v/{float(interval.power(1))!r})", fields["damping"])
        fields["damping"] = f"{ratio_squared}*({slower_damping})"
