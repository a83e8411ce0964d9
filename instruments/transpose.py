"""Instruments at another pitch: all times in them are divided by one ratio.

Dividing times by r multiplies all eigenvalues by r: each mode's pitch exactly, while its T60 is
divided by r. So stiffnesses are multiplied by r², viscosities by r, and masses and lengths stay.
Modules below audible frequencies (a hammer, a mallet) count as mechanics and stay, as does
friction, a damping without a law.
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
from ergon.notation.tables import quantities as q
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Text
from ergon.notation.text.errors import TextError, quote

AUDIBLE_HZ_MIN = 20.0  # [Hz] slower CELs are mechanics
CENTS_MAX = 12000.0  # ten octaves
_EXAMPLE = "7st, -14cents or 3/2"
_RATIO = re.compile(r"\d{1,15}/\d{1,15}")
_INTERVAL = re.compile(r"([+-]?(?:\d{1,5}\.?\d{0,6}|\.\d{1,6})) *(st|cents?)")
_A4_HZ = 440.0


@dataclass(frozen=True, slots=True)
class Interval:
    """The step from one pitch to another: in cents if they are known, else as a ratio.

    `keys` are those of a scale, if the interval is written in whole semitones.
    """

    ratio: float
    cents: float | None = None
    keys: int | None = None

    @property
    def semitones(self) -> float:
        """The interval in semitones; an integer counts keys of a scale."""
        if self.keys is not None:
            return self.keys
        return 12.0 * math.log2(self.ratio) if self.cents is None else self.cents / 100.0

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
    interval_word = text.strip()
    if interval_word.startswith("x") or _RATIO.fullmatch(interval_word):
        pitch_ratio = q.factor(f"x{interval_word.removeprefix('x')}")
        if not 1e-3 <= pitch_ratio <= 1e3:
            message = f"{quote(interval_word)} lies outside the range from x0.001 to x1000"
            raise TextError(message, length=max(1, len(interval_word)), code="E202")
        return Interval(pitch_ratio)
    interval_match = _INTERVAL.fullmatch(interval_word)
    if interval_match is None:
        problem = (
            f"{quote(interval_word)} is not an interval"
            if interval_word
            else "an interval is missing,"
        )
        message = f"{problem} such as {_EXAMPLE}"
        is_number = re.fullmatch(r"[+-]?\d+(\.\d+)?", interval_word)
        suggestion = f"{interval_word}st" if is_number else None
        code = "E203" if is_number else "E201"
        raise TextError(
            message, length=max(1, len(interval_word)), suggestion=suggestion, code=code
        )
    amount = Fraction(interval_match[1])
    cents = float(amount * (100 if interval_match[2] == "st" else 1))
    if abs(cents) > CENTS_MAX:
        message = f"{quote(interval_word)} lies outside the range from -120st to 120st"
        raise TextError(message, length=len(interval_word), code="E202")
    is_keys = interval_match[2] == "st" and amount.denominator == 1
    return replace(interval_of_cents(cents), keys=int(amount) if is_keys else None)


INTERVAL_SHAPE = Text(
    parse_interval,
    f"an interval, such as {_EXAMPLE}",
    r"^([+-]?[0-9.]+ *(st|cents?)|x[0-9./]+|[0-9]+/[0-9]+)$",
    types=("string",),
    is_value=True,
)


def _parse_cents(text: str) -> float:
    interval = parse_interval(text)
    return 1200.0 * math.log2(interval.ratio) if interval.cents is None else interval.cents


CENTS_SHAPE = Text(_parse_cents, "an interval, such as 2st", is_value=True)  # in cents


def interval_between(low: float, high: float) -> Interval:
    """The interval from one frequency [Hz] to another."""
    a, b = _cents_above_a4(low), _cents_above_a4(high)
    return Interval(high / low) if a is None or b is None else interval_of_cents(float(b - a))


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
    semitone_steps = semitones + cents_over / 100
    return math.ldexp(
        _A4_HZ * (_core.pow(2.0, semitone_steps / 12) if semitone_steps else 1.0), octaves
    )


def _cents_above_a4(frequency: float) -> int | None:
    """The cents above A4 of a frequency that belongs to a note exactly; None for any other."""
    if frequency <= 0.0:
        return None
    cents = round(1200.0 * math.log2(frequency / _A4_HZ))
    return cents if _note_frequency(cents) == frequency else None


# --- instruments --------------------------------------------------------------------------------

# The power of the ratio that multiplies each field, except `f`, `points` and laws; other fields
# stay.
_RATIO_POWERS = {"t60": -1, "K": 2, "Z": 1, "V0": 1, "hardening": 2, "stretching": 2}


def base_at_pitch(base_values: Values, member_values: Values, *, is_root: bool) -> Values:
    """The base of an instrument, at the pitch that the instrument's own `f` and
    `transpose` ask for.

    For a root, which has no `like` or `from`, the base is the instrument itself. Reports a base
    without a pitch.
    """
    interval = member_values["transpose"] if member_values.written("transpose") else None
    member_pitch = member_values.by_name.get("f")
    if not is_root and isinstance(member_pitch, tuple) and base_values.written("modules"):
        if member_values.written("modules") and member_pitch[0] != member_pitch[1]:
            return base_values
        base_pitch = named_pitch(base_values)
        if base_pitch is None:
            message = (
                f"{member_values.context.label('f')}: {base_values.context.label('')} has no named "
                "pitch; write `f` beside its modules, the pitch at which they are written, or "
                "`transpose`"
            )
            member_values.error("E103", message, "f")
        elif member_pitch[0] == member_pitch[1]:
            step = interval_between(base_pitch, member_pitch[0])
            interval = step.plus(interval) if interval is not None else step
    if interval is None or (interval.ratio == 1.0 and is_root):
        return base_values
    if base_values["units"] == "ca" or member_values["units"] == "ca":
        field_name = "transpose" if member_values.written("transpose") else "f"
        message = (
            f"{member_values.context.label(field_name)}: under `units: ca` K and Z are those of a "
            "discrete network, whose modes no factor moves alike; write them in SI units"
        )
        member_values.error("E111", message, field_name)
        return base_values
    return _transposed_instrument(base_values, interval)


def instrument_at_note(instrument_values: Values, note: str) -> Values:
    """An instrument with `notes` at one of its notes; it must have a named pitch."""
    base_pitch, note_frequency = named_pitch(instrument_values), q.frequency(note)
    assert base_pitch is not None
    fields = {name: value for name, value in instrument_values.by_name.items() if name != "notes"}
    note_values = replace(instrument_values, by_name=fields)
    if not instrument_values.kind:
        note_values = _transposed_instrument(
            note_values, interval_between(base_pitch, note_frequency)
        )
    # Set `f` beside a generator, as if it were written.
    nodes = {"f": instrument_values.nodes["notes"], **instrument_values.nodes}
    return replace(
        note_values,
        by_name={**note_values.by_name, "f": (note_frequency, note_frequency)},
        nodes=nodes,
    )


def named_pitch(instrument_values: Values) -> float | None:
    """The named pitch [Hz] of an instrument: its `f`, or that of its only module with
    one.

    None for a range, and for mechanics.
    """
    written = instrument_values.by_name.get("f")
    if isinstance(written, tuple):
        return written[0] if written[0] == written[1] else None
    module_values = [
        body for body in (instrument_values["modules"] or {}).values() if isinstance(body, Values)
    ]
    pitches = []
    for body_values in [instrument_values] if instrument_values.kind else module_values:
        module_fields = body_values.by_name.get(body_values.kind)
        if isinstance(module_fields, Values):
            module_fields = (
                from_material(body_values.kind, module_fields, quietly=True) or module_fields
            )
        body_frequency = (
            module_fields.by_name.get("f") if isinstance(module_fields, Values) else None
        )
        if isinstance(body_frequency, tuple) and body_values.kind == "MODES":
            body_frequency = min(body_frequency, default=None)
        elif (
            isinstance(body_frequency, tuple)
            and not isinstance(body_frequency, Each)
            and body_frequency[0] == body_frequency[1]
        ):
            body_frequency = body_frequency[0]
        if isinstance(body_frequency, float) and not (
            body_values.kind == "CEL" and body_frequency < AUDIBLE_HZ_MIN
        ):
            pitches.append(body_frequency)
    return pitches[0] if len(pitches) == 1 else None


def _transposed_instrument(instrument_values: Values, interval: Interval) -> Values:
    moved_fields = dict(instrument_values.by_name)
    if isinstance(moved_fields.get("modules"), dict):
        moved_fields["modules"] = {
            name: _transposed_body(body, interval) if isinstance(body, Values) else body
            for name, body in moved_fields["modules"].items()
        }
    if instrument_values.kind and isinstance(
        body := moved_fields.get(instrument_values.kind), Values
    ):
        moved_fields[instrument_values.kind] = _transposed_fields(
            instrument_values.kind, body, interval
        )
    for name in ("f", "t60"):
        if name in moved_fields:
            moved_fields[name] = transposed_value(name, moved_fields[name], interval)
    return replace(instrument_values, by_name=moved_fields)


def _transposed_body(body: Values, interval: Interval) -> Values:
    module_fields = body.by_name.get(body.kind, MISSING)
    if not isinstance(module_fields, Values):
        return body
    return replace(
        body,
        by_name={**body.by_name, body.kind: _transposed_fields(body.kind, module_fields, interval)},
    )


def _transposed_fields(kind_name: str, module_fields: Values, interval: Interval) -> Values:
    """The fields of one module moved by an interval; a law keeps the interval in `interval`, and is
    moved later.
    """
    if is_mechanics(kind_name, module_fields):
        return module_fields
    module_fields = from_material(kind_name, module_fields, quietly=True) or module_fields
    moved_fields = {
        name: transposed_value(name, value, interval)
        for name, value in module_fields.by_name.items()
    }
    if KINDS[kind_name].role == "law" or module_fields.written("modes"):
        moved_fields["interval"] = (
            moved_fields["interval"].plus(interval) if "interval" in moved_fields else interval
        )
    return replace(module_fields, by_name=moved_fields)


def is_mechanics(kind: str, fields: Values) -> bool:
    """Whether a module is below audible frequencies, so that it is not transposed."""
    return keeps_pitch(kind, fields.by_name)


def keeps_pitch(kind_name: str, module_fields: Mapping[str, Any]) -> bool:
    """Whether a module with these fields, in SI units, is below audible frequencies, or is
    friction.
    """
    module_frequency, stiffness, module_mass = (module_fields.get(name) for name in ("f", "K", "M"))
    if KINDS[kind_name].role == "friction":
        return True  # the module belongs to the bow
    if kind_name != "CEL":
        return False
    if isinstance(module_frequency, float):
        return module_frequency < AUDIBLE_HZ_MIN
    if not isinstance(stiffness, float) or not isinstance(module_mass, float):
        return False
    return stiffness < module_mass * (2.0 * math.pi * AUDIBLE_HZ_MIN) ** 2


def transposed_value(field_name: str, field_value: Any, interval: Interval) -> Any:
    """The value of a field of a module, moved by an interval."""
    if isinstance(field_value, tuple):
        if field_name == "points":
            return tuple(
                (d, _decimal_product(force, interval.power(2))) for d, force in field_value
            )
        if field_name == "t60" and isinstance(field_value[0], tuple):
            return tuple(
                (transposed_frequency(f, interval), transposed_value(field_name, t, interval))
                for f, t in field_value
            )
        moved_numbers = (
            transposed_value(field_name, field_number, interval) for field_number in field_value
        )
        return Each(moved_numbers) if isinstance(field_value, Each) else tuple(moved_numbers)
    if isinstance(field_value, Band):
        f, t60 = (
            transposed_value("f", field_value.f, interval),
            transposed_value("t60", field_value.t60, interval),
        )
        return replace(field_value, f=f, t60=t60)
    if isinstance(field_value, Start):
        return replace(field_value, value=transposed_value(field_name, field_value.value, interval))
    if isinstance(field_value, Stretched):
        return replace(
            field_value, per_gap=_decimal_product(field_value.per_gap, interval.power(2))
        )
    if field_name == "f" and isinstance(field_value, float):
        return transposed_frequency(field_value, interval)
    power = _RATIO_POWERS.get(field_name)
    if power is None or not isinstance(field_value, float):
        return field_value
    return _decimal_product(field_value, interval.power(power))


def transpose_law(law_fields: dict[str, Any], interval: Interval) -> None:
    """Move a law that is written out: law(d) is multiplied by r², damping(d, v) becomes
    r²·damping(d, v/r).

    A damping without a law is friction, which stays.
    """
    if law_fields["law"] is None and law_fields["points"] is None:
        return
    ratio_squared = f"{float(interval.power(2))!r}"
    if law_fields["law"] is not None:
        law_fields["law"] = f"{ratio_squared}*({law_fields['law']})"
    if law_fields["damping"] is not None:
        slower_damping = re.sub(
            r"\bv\b", f"(v/{float(interval.power(1))!r})", law_fields["damping"]
        )
        law_fields["damping"] = f"{ratio_squared}*({slower_damping})"
