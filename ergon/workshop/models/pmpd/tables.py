"""Drawn stiffness and viscosity of pmpd's tabLink: arrays as laws of LNL modules."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.pmpd.network import Link

_BENDS = 20  # bends of a law, whose expression may have 2,000 characters
_VALUES_MAX = 2_000  # largest number of values in an array of viscosities


@dataclass(frozen=True, slots=True)
class Table:
    """Values of an array at 0, 1/n … (n - 1)/n, linear between them; odd, and constant beyond the
    last.
    """

    values: Sequence[float]

    def interpolate(self, table_place: float) -> float:
        """The value at a place, which pmpd interpolates linearly."""
        place_size = abs(table_place) * len(self.values)
        place_sign = 1.0 if table_place > 0.0 else -1.0
        if place_size >= len(self.values) - 1:
            return place_sign * self.values[-1]
        low = int(place_size)
        part = place_size - low
        return place_sign * (part * self.values[low + 1] + (1.0 - part) * self.values[low])


def table(arrays: Mapping[str, Sequence[float]], name: str, line_number: int) -> Table:
    """The array of a name. Raises ModelError where there is none."""
    array_values = arrays.get(name)
    if not array_values:
        message = f"no values of the array {quote(name)}: write {name} 0, then its values"
        raise ModelError(
            message,
            line_number,
            nearest(name, [array_name for array_name in arrays if arrays[array_name]]),
        )
    return Table(array_values)


def springs(arrays: Mapping[str, Sequence[float]], model_link: Link) -> Iterator[str]:
    """Laws that add up to a tabLink: first of the elongation, then of its rate. Raises
    ModelError.
    """
    assert model_link.tables is not None
    name_k, length_k, name_d, length_d = model_link.tables
    k, d = (
        table(arrays, name_k, model_link.line).values,
        table(arrays, name_d, model_link.line).values,
    )
    if d[0] and model_link.D:
        message = f"viscosity that jumps at rest is not built yet: let {name_d} begin with 0"
        raise ModelError(message, model_link.line)
    if len(d) > _VALUES_MAX:
        raise ModelError(
            f"{quote(name_d)} has {len(d):,} values, and {_VALUES_MAX:,} are read", model_link.line
        )
    yield from _elastic([model_link.K * value for value in k], length_k)
    yield from _viscous([model_link.D * value for value in d], length_d)


def _elastic(array_values: Sequence[float], table_length: float) -> Iterator[str]:
    """The points of a law without its jump at 0, then the jump as a law of its own."""
    value_at_rest, n = array_values[0], len(array_values)
    if any(value != value_at_rest for value in array_values):
        half = [
            (table_length * index / n, value - value_at_rest)
            for index, value in enumerate(array_values)
        ]
        half.append((2.0 * half[-1][0], half[-1][1]))  # constant beyond the last value
        points = [(-d, -f) for d, f in reversed(half[1:])] + half
        yield f"points: [{', '.join(f'[{d!r}m, {f!r}N]' for d, f in points)}]"
    if value_at_rest:
        # Written as friction: a law with an infinite slope at rest has no certificate.
        yield f'damping: "f*sign(d)", f: {value_at_rest!r}'


def _viscous(array_values: Sequence[float], table_length: float) -> Iterator[str]:
    """A sum of terms b·max(0, |v| - c) with the sign of v, in as many laws as needed."""
    n = len(array_values)
    slopes = [0.0, *((b - a) * n / table_length for a, b in pairwise(array_values)), 0.0]
    bends = [
        (table_length * index / n, slope_after - slope_before)
        for index, (slope_before, slope_after) in enumerate(pairwise(slopes))
        if slope_after != slope_before
    ]
    for first_bend in range(0, len(bends), _BENDS):
        bends_of_term = bends[first_bend : first_bend + _BENDS]
        terms = " + ".join(f"{b!r}*max(0, abs(v) - {c!r})" for c, b in bends_of_term)
        yield f'damping: "sign(v)*({terms})"'
