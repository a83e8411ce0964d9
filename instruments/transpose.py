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

AUDIBLE = 20.0  # [Hz] slower CELs are mechanics
CENTS_MAX = 12000.0  # ten octaves
_EXAMPLE = "7st, -14cents or 3/2"
_RATIO = re.compile(r"\d{1,15}/\d{1,15}")
_INTERVAL = re.compile(r"([+-]?(?:\d{1,5}\.?\d{0,6}|\.\d{1,6})) *(st|cents?)")
_A4 = 440.0


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

    def then(self, other: Interval) -> Interval:
        """The sum of this interval and another."""
        if self.cents is not None and other.cents is not None:
            return interval_of_cents(self.cents + other.cents)
        return Interval(_times(self.ratio, other.power(1)))

    def back(self) -> Interval:
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
    """An interval of so many cents."""
    return Interval(_core.pow(2.0, cents / 1200.0), cents)


def is_interval(word: str) -> bool:
    """Whether a word is an interval in semitones or cents, such as `7st`."""
    return _INTERVAL.fullmatch(word) is not None


def parse_interval(text: str) -> Interval:
    """Read `7st`, `-14cents`, `x1.5` or `3/2`. Raises TextError."""
    word = text.strip()
    if word.startswith("x") or _RATIO.fullmatch(word):
        ratio = q.factor(f"x{word.removeprefix('x')}")
        if not 1e-3 <= ratio <= 1e3:
            message = f"{quote(word)} lies outside the range from x0.001 to x1000"
            raise TextError(message, length=max(1, len(word)), code="E202")
        return Interval(ratio)
    match = _INTERVAL.fullmatch(word)
    if match is None:
        wrong = f"{quote(word)} is not an interval" if word else "an interval is missing,"
        message = f"{wrong} such as {_EXAMPLE}"
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
    return replace(interval_of_cents(cents), keys=int(amount) if is_keys else None)


INTERVAL = Text(
    parse_interval,
    f"an interval, such as {_EXAMPLE}",
    r"^([+-]?[0-9.]+ *(st|cents?)|x[0-9./]+|[0-9]+/[0-9]+)$",
    types=("string",),
    is_value=True,
)


def _parse_cents(text: str) -> float:
    interval = parse_interval(text)
    return 1200.0 * math.log2(interval.ratio) if interval.cents is None else interval.cents


TRANSPOSITION = Text(_parse_cents, "an interval, such as 2st", is_value=True)  # in cents


def between(low: float, high: float) -> Interval:
    """The interval from one frequency [Hz] to another."""
    a, b = _cents(low), _cents(high)
    return Interval(high / low) if a is None or b is None else interval_of_cents(float(b - a))


def pitch(frequency: float, interval: Interval) -> float:
    """A frequency [Hz] moved by an interval; the frequency of a note becomes exactly that of
    another note.
    """
    cents = _cents(frequency) if interval.cents is not None else None
    if cents is not None and interval.cents is not None and (cents + interval.cents).is_integer():
        return _note(int(cents + interval.cents))
    return _times(frequency, interval.power(1))


def _times(value: float, factor: Fraction) -> float:
    """The float nearest to the product of two numbers as they are written in decimals."""
    return float(Fraction(repr(value)) * factor)


def _note(cents: int) -> float:
    """The frequency [Hz] of a note so many cents above A4, exactly as for its name."""
    octaves, rest = divmod(cents, 1200)
    semitones, over = divmod(rest, 100)
    steps = semitones + over / 100
    return math.ldexp(_A4 * (_core.pow(2.0, steps / 12) if steps else 1.0), octaves)


def _cents(frequency: float) -> int | None:
    """The cents above A4 of a frequency that belongs to a note exactly; None for any other."""
    if frequency <= 0.0:
        return None
    cents = round(1200.0 * math.log2(frequency / _A4))
    return cents if _note(cents) == frequency else None


# --- instruments --------------------------------------------------------------------------------

# The power of the ratio that multiplies each field, except `f`, `points` and laws; other fields
# stay.
_POWERS = {"t60": -1, "K": 2, "Z": 1, "V0": 1, "hardening": 2, "stretching": 2}


def base_at_pitch(base: Values, member: Values, *, is_root: bool) -> Values:
    """The base of an instrument, at the pitch that the instrument's own `f` and `transpose` ask
    for.

    For a root, which has no `like` or `from`, the base is the instrument itself. Reports a base
    without a pitch.
    """
    interval = member["transpose"] if member.written("transpose") else None
    f = member.by_name.get("f")
    if not is_root and isinstance(f, tuple) and base.written("modules"):
        if member.written("modules") and f[0] != f[1]:
            return base
        base_pitch = named_pitch(base)
        if base_pitch is None:
            message = (
                f"{member.context.label('f')}: {base.context.label('')} has no named pitch; write "
                "`f` beside its modules, the pitch at which they are written, or `transpose`"
            )
            member.error("E103", message, "f")
        elif f[0] == f[1]:
            step = between(base_pitch, f[0])
            interval = step.then(interval) if interval is not None else step
    if interval is None or (interval.ratio == 1.0 and is_root):
        return base
    if base["units"] == "ca" or member["units"] == "ca":
        name = "transpose" if member.written("transpose") else "f"
        message = (
            f"{member.context.label(name)}: under `units: ca` K and Z are those of a discrete "
            "network, "
            "whose modes no factor moves alike; write them in SI units"
        )
        member.error("E111", message, name)
        return base
    return _instrument(base, interval)


def instrument_at_note(values: Values, note: str) -> Values:
    """An instrument with `notes` at one of its notes; it must have a named pitch."""
    base_pitch, high = named_pitch(values), q.frequency(note)
    assert base_pitch is not None
    fields = {name: value for name, value in values.by_name.items() if name != "notes"}
    member = replace(values, by_name=fields)
    if not values.kind:
        member = _instrument(member, between(base_pitch, high))
    # Set `f` beside a generator, as if it were written.
    nodes = {"f": values.nodes["notes"], **values.nodes}
    return replace(member, by_name={**member.by_name, "f": (high, high)}, nodes=nodes)


def named_pitch(values: Values) -> float | None:
    """The named pitch [Hz] of an instrument: its `f`, or that of its only module with one.

    None for a range, and for mechanics.
    """
    written = values.by_name.get("f")
    if isinstance(written, tuple):
        return written[0] if written[0] == written[1] else None
    bodies = [body for body in (values["modules"] or {}).values() if isinstance(body, Values)]
    pitches = []
    for body in [values] if values.kind else bodies:
        fields = body.by_name.get(body.kind)
        if isinstance(fields, Values):
            fields = from_material(body.kind, fields, quietly=True) or fields
        f = fields.by_name.get("f") if isinstance(fields, Values) else None
        if isinstance(f, tuple) and body.kind == "MODES":
            f = min(f, default=None)
        elif isinstance(f, tuple) and not isinstance(f, Each) and f[0] == f[1]:
            f = f[0]
        if isinstance(f, float) and not (body.kind == "CEL" and f < AUDIBLE):
            pitches.append(f)
    return pitches[0] if len(pitches) == 1 else None


def _instrument(values: Values, interval: Interval) -> Values:
    fields = dict(values.by_name)
    if isinstance(fields.get("modules"), dict):
        fields["modules"] = {
            name: _body(body, interval) if isinstance(body, Values) else body
            for name, body in fields["modules"].items()
        }
    if values.kind and isinstance(body := fields.get(values.kind), Values):
        fields[values.kind] = _fields(values.kind, body, interval)
    for name in ("f", "t60"):
        if name in fields:
            fields[name] = moved(name, fields[name], interval)
    return replace(values, by_name=fields)


def _body(body: Values, interval: Interval) -> Values:
    fields = body.by_name.get(body.kind, MISSING)
    if not isinstance(fields, Values):
        return body
    return replace(body, by_name={**body.by_name, body.kind: _fields(body.kind, fields, interval)})


def _fields(kind: str, fields: Values, interval: Interval) -> Values:
    """The fields of one module moved by an interval; a law keeps the interval in `interval`, and is
    moved later.
    """
    if is_mechanics(kind, fields):
        return fields
    fields = from_material(kind, fields, quietly=True) or fields
    moved_fields = {name: moved(name, value, interval) for name, value in fields.by_name.items()}
    if KINDS[kind].role == "law" or fields.written("modes"):
        moved_fields["interval"] = (
            moved_fields["interval"].then(interval) if "interval" in moved_fields else interval
        )
    return replace(fields, by_name=moved_fields)


def is_mechanics(kind: str, fields: Values) -> bool:
    """Whether a module is below audible frequencies, so that it is not transposed."""
    return is_slow(kind, fields.by_name)


def is_slow(kind: str, fields: Mapping[str, Any]) -> bool:
    """Whether a module with these fields, in SI units, is below audible frequencies, or is
    friction.
    """
    f, stiffness, mass = (fields.get(name) for name in ("f", "K", "M"))
    if KINDS[kind].role == "friction":
        return True  # it belongs to the bow
    if kind != "CEL":
        return False
    if isinstance(f, float):
        return f < AUDIBLE
    if not isinstance(stiffness, float) or not isinstance(mass, float):
        return False
    return stiffness < mass * (2.0 * math.pi * AUDIBLE) ** 2


def moved(name: str, value: Any, interval: Interval) -> Any:
    """The value of a field of a module, moved by an interval."""
    if isinstance(value, tuple):
        if name == "points":
            return tuple((d, _times(force, interval.power(2))) for d, force in value)
        if name == "t60" and isinstance(value[0], tuple):
            return tuple((pitch(f, interval), moved(name, t, interval)) for f, t in value)
        each = (moved(name, one, interval) for one in value)
        return Each(each) if isinstance(value, Each) else tuple(each)
    if isinstance(value, Band):
        f, t60 = moved("f", value.f, interval), moved("t60", value.t60, interval)
        return replace(value, f=f, t60=t60)
    if isinstance(value, Start):
        return replace(value, value=moved(name, value.value, interval))
    if isinstance(value, Stretched):
        return replace(value, per_gap=_times(value.per_gap, interval.power(2)))
    if name == "f" and isinstance(value, float):
        return pitch(value, interval)
    power = _POWERS.get(name)
    if power is None or not isinstance(value, float):
        return value
    return _times(value, interval.power(power))


def law(fields: dict[str, Any], interval: Interval) -> None:
    """Move a law that is written out: law(d) is multiplied by r², damping(d, v) becomes
    r²·damping(d, v/r).

    A damping without a law is friction, which stays.
    """
    if fields["law"] is None and fields["points"] is None:
        return
    square = f"{float(interval.power(2))!r}"
    if fields["law"] is not None:
        fields["law"] = f"{square}*({fields['law']})"
    if fields["damping"] is not None:
        slower = re.sub(r"\bv\b", f"(v/{float(interval.power(1))!r})", fields["damping"])
        fields["damping"] = f"{square}*({slower})"
