"""Drawn stiffness and viscosity of pmpd's tabLink: arrays as laws of LNL modules."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.pmpd.network import Link

_BENDS_MAX = 20  # bends of a law, whose expression may have 2,000 characters
_VALUES_MAX = 2_000  # largest number of values in an array of viscosities


@dataclass(frozen=True, slots=True)
class Table:
    """Values of an array at 0, 1/n … (n - 1)/n, linear between them; odd, and constant beyond the
    last.
    """

    values: Sequence[float]

    def interpolate(self, argument: float) -> float:
        """The value at a place, which pmpd interpolates linearly."""
        position = abs(argument) * len(self.values)
        sign = 1.0 if argument > 0.0 else -1.0
        if position >= len(self.values) - 1:
            return sign * self.values[-1]
        lower_index = int(position)
        fraction = position - lower_index
        lower, upper = self.values[lower_index : lower_index + 2]
        return sign * (fraction * upper + (1.0 - fraction) * lower)


def find_table(arrays: Mapping[str, Sequence[float]], name: str, line_number: int) -> Table:
    """The array of a name. Raises ModelError where there is none."""
    values = arrays.get(name)
    if not values:
        message = f"no values of the array {quote(name)}: write {name} 0, then its values"
        raise ModelError(
            message,
            line_number,
            nearest(name, [array_name for array_name in arrays if arrays[array_name]]),
        )
    return Table(values)


def law_fields(arrays: Mapping[str, Sequence[float]], link: Link) -> Iterator[str]:
    """Laws that add up to a tabLink: first of the elongation, then of its rate. Raises
    ModelError.
    """
    assert link.tables is not None
    name_k, length_k, name_d, length_d = link.tables
    stiffness_values, viscosity_values = (
        find_table(arrays, name_k, link.line).values,
        find_table(arrays, name_d, link.line).values,
    )
    if viscosity_values[0] and link.D:
        message = f"viscosity that jumps at rest is not built yet: let {name_d} begin with 0"
        raise ModelError(message, link.line)
    if len(viscosity_values) > _VALUES_MAX:
        raise ModelError(
            f"{quote(name_d)} has {len(viscosity_values):,} values, and {_VALUES_MAX:,} are read",
            link.line,
        )
    yield from _elastic_laws([link.K * value for value in stiffness_values], length_k)
    yield from _viscous_laws([link.D * value for value in viscosity_values], length_d)


def _elastic_laws(values: Sequence[float], length: float) -> Iterator[str]:
    """The points of a law without its jump at 0, then the jump as a law of its own."""
    jump, n_values = values[0], len(values)
    if any(value != jump for value in values):
        positive_points = [
            (length * index / n_values, value - jump) for index, value in enumerate(values)
        ]
        last_elongation, last_force = positive_points[-1]
        positive_points.append(
            (2.0 * last_elongation, last_force)
        )  # constant beyond the last value
        negative_points = [(-elongation, -force) for elongation, force in positive_points[1:]]
        points = negative_points[::-1] + positive_points
        point_texts = (f"[{elongation!r}m, {force!r}N]" for elongation, force in points)
        yield f"points: [{', '.join(point_texts)}]"
    if jump:
        # Written as friction: a law with an infinite slope at rest has no certificate.
        yield f'damping: "f*sign(d)", f: {jump!r}'


def _viscous_laws(values: Sequence[float], length: float) -> Iterator[str]:
    """A sum of terms b·max(0, |v| - c) with the sign of v, in as many laws as needed."""
    n_values = len(values)
    slopes = [
        0.0,
        *((next_value - value) * n_values / length for value, next_value in pairwise(values)),
        0.0,
    ]
    bends = [
        (length * index / n_values, slope_after - slope_before)
        for index, (slope_before, slope_after) in enumerate(pairwise(slopes))
        if slope_after != slope_before
    ]
    for first_bend in range(0, len(bends), _BENDS_MAX):
        bends_of_law = bends[first_bend : first_bend + _BENDS_MAX]
        terms = " + ".join(
            f"{slope_change!r}*max(0, abs(v) - {speed!r})" for speed, slope_change in bends_of_law
        )
        yield f'damping: "sign(v)*({terms})"'
