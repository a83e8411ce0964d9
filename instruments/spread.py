"""Links over a range of members: `between: [bridge, string.1..12]` is one contact of many points.

Such a link is a link for each member. Its `gap` may differ between members: a list, or a
profile.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ergon import _core
from ergon.instruments.members import PATTERN
from ergon.instruments.modal import Each
from ergon.instruments.model import Module, Target
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.errors import Collector, quote

_MEMBER_SUFFIX = re.compile(rf"\.{PATTERN}$")

MAX_LINKED_POINTS = 10_000  # points of one link
MAX_CONTACT_POINTS = 200_000  # points that meet each other
MAX_ATTRACTED_POINTS = (
    1_000  # points that attract each other: each looks at all others in every frame
)
# Links that act between all pairs: their name, and the largest number of points.
_PAIRWISE_LIMITS = {
    "BUT": ("a contact", MAX_CONTACT_POINTS),
    "ATTRACTION": ("an attraction", MAX_ATTRACTED_POINTS),
}


@dataclass(frozen=True, slots=True)
class Profile:
    """An obstacle whose gap is `least` [m] at its `top`, a point, and grows by `depth` [m] away
    from it.

    Points count from 0, as members do; the depth is reached `length` points from the top.
    """

    least: float
    depth: float
    top: float
    length: float | None
    power: float

    def gaps(self, n: int) -> tuple[float, ...]:
        """least + depth·(|i - top|/length)^power for each of n points i [m]."""
        distances = [abs(i - self.top) for i in range(n)]
        length = self.length or max(distances) or 1.0
        return tuple(
            self.least + self.depth * _core.pow(distance / length, self.power)
            for distance in distances
        )


def _profile(values: Values) -> Profile:
    names = ("least", "depth", "top", "length", "power")
    return Profile(*(values[name] for name in names))


PROFILE = Record(
    "profile",
    "how far an obstacle with a curved top is, from point to point",
    (
        Field(
            "depth", value_kinds.POSITION, "how much farther it is at the far end", required=True
        ),
        Field("least", value_kinds.POSITION, "gap at its top", 0.0),
        Field("top", value_kinds.NUMBER, "point at which it is nearest, counted from 0", 0.0),
        Field(
            "length",
            value_kinds.POSITIVE,
            "points from the top to that depth",
            shown="to the farthest end",
        ),
        Field("power", value_kinds.EXPONENT, "2: a parabola, 1: a slope", 2.0),
    ),
    _profile,
)
GAP = Either(value_kinds.POSITION, PROFILE, ListOf(value_kinds.POSITION, 1, MAX_LINKED_POINTS))


def link_count(ends: Sequence[Target]) -> int:
    """The number of links between two ends, of which one or both may be ranges."""
    return max((end.count for end in ends), default=1)


def is_pairwise(kind_name: str, link_fields: Mapping[str, Any], ends: Sequence[Target]) -> bool:
    """Whether a link in space acts between all points of its ends, touches a wall, or has
    friction.
    """
    if kind_name not in ("BUT", "ATTRACTION") or not any(end.points for end in ends):
        return False
    return link_count(ends) > 1 or has_wall(link_fields) or link_fields.get("friction", 0.0) > 0.0


def has_wall(contact_fields: Mapping[str, Any]) -> bool:
    """Whether the first end of a contact in space is a wall: a plane, a box, a surface, or a sphere
    seen from inside.
    """
    shapes = (contact_fields.get(name) for name in ("normal", "box", "mesh"))
    return any(shape is not None for shape in shapes) or contact_fields.get("side") == "inside"


def single_links(link: Module) -> Iterator[Module]:
    """The single links of a link over a range, `bridge.0` and so on; the link itself if it is one.

    A link that acts between all points of two ranges is one link; a box is one for each wall.
    """
    ends = link.ends
    n, gap = link_count(ends), link.fields.get("gap")
    if link.fields.get("box") is not None:
        yield from _box_walls(link)
        return
    if n == 1 or is_pairwise(link.kind, link.fields, ends):
        yield link
        return
    for i in range(n):
        module_fields = {
            **link.fields,
            "between": tuple(_single_end(end, i) for end in ends),
        }
        if isinstance(gap, tuple):
            module_fields["gap"] = gap[i]
        yield replace(link, name=f"{link.name}.{i}", fields=module_fields)


def _box_walls(link: Module) -> Iterator[Module]:
    """The walls of a box, two for each axis: planes that face its middle."""
    widths = link.fields["box"]
    for axis, width in enumerate(widths):
        for sign, side in ((1.0, "from"), (-1.0, "to")):
            normal = tuple(sign if other == axis else 0.0 for other in range(len(widths)))
            wall_fields = {
                "box": None,
                "normal": normal,
                "gap": link.fields["gap"] - 0.5 * width,
            }
            name = f"{link.name} {side} {AXES[axis]}"
            yield replace(link, name=name, fields={**link.fields, **wall_fields})


def _single_end(end: Target, i: int) -> Target:
    """The end of single link `i`: a range gives its member, a single module stays."""
    if end.count == 1 or end.first == "centre":
        return end
    member = end.first + i
    return replace(end, first=member, count=1, text=f"{_MEMBER_SUFFIX.sub('', end.text)}.{member}")


def may_join(ends: Sequence[Target], link_label: str, collector: Collector) -> bool:
    """Whether two ends make links: one MAT and a range, or two ranges of one size; reports an error
    if not.
    """
    if len(ends) != 2:
        return False
    first, second = ends
    end_place = second.place
    if first.count != second.count and min(first.count, second.count) > 1:
        message = (
            f"{link_label}: {quote(first.text)} has {first.count:,} members and "
            f"{quote(second.text)} {second.count:,}"
        )
        message += "; a link joins one module to each of a range, or two ranges of one length"
        collector.error("E304", message, end_place)
        return False
    if link_count(ends) > MAX_LINKED_POINTS:
        message = (
            f"{link_label}: a link has at most {MAX_LINKED_POINTS:,} points, not "
            f"{link_count(ends):,}"
        )
        collector.error("E105", message, end_place)
        return False
    if (shared_point := _self_joined_point(first, second)) is not None:
        message = f"{link_label}: both ends are {shared_point}; a link joins two different points"
        collector.error("E304", message, end_place)
        return False
    return True


def may_act_on_all_pairs(
    kind_name: str, ends: Sequence[Target], is_wall: bool, module_label: str, collector: Collector
) -> bool:
    """Whether a contact or an attraction may act between all points of both ends; reports an error
    if not.
    """
    if len(ends) != 2:
        return False
    first, second = ends
    noun, n_max = _PAIRWISE_LIMITS[kind_name]
    problem = ""
    code = "E304"
    if is_wall and first.count > second.count:
        problem = (
            f"{quote(first.text)} has {first.count:,} points; the first end is the wall "
            "and must be "
        )
        problem += "one point"
    elif (
        first.part == second.part and first.module == second.module and isinstance(first.first, int)
    ):
        is_same = (first.first, first.count) == (second.first, second.count)
        overlap_end = (
            min(first.first + first.count, second.first + second.count)
            if isinstance(second.first, int)
            else 0
        )
        if is_same and (is_wall or first.count == 1):
            problem = f"both ends are {second.text}; {noun} joins different points"
        elif (
            not is_same
            and isinstance(second.first, int)
            and max(first.first, second.first) < overlap_end
        ):
            problem = (
                f"{quote(first.text)} and {quote(second.text)} have points in common; "
                "write the same "
            )
            problem += "range twice, or two that have none"
    if not problem and link_count(ends) > n_max:
        code = "E105"
        problem = f"{noun} of all pairs has at most {n_max:,} points, not {link_count(ends):,}"
    if problem:
        collector.error(code, f"{module_label}: {problem}", second.place)
    return not problem


def _self_joined_point(first_end: Target, second_end: Target) -> str | None:
    """A point that would be joined to itself; None if there is none."""
    if (first_end.part, first_end.module) != (second_end.part, second_end.module):
        return None
    if "centre" in (first_end.first, second_end.first):
        return second_end.text if first_end.first == second_end.first else None
    n = link_count((first_end, second_end))
    for first, other in ((_single_end(first_end, i), _single_end(second_end, i)) for i in range(n)):
        if first.first == other.first:
            return other.text
    return None


def contact_gaps(contact: Module, n: int, module_label: str, collector: Collector) -> Any:
    """The gap of a contact of n points: one for all, or one for each; reports a list of another
    length.
    """
    gap = contact.fields.get("gap")
    if isinstance(gap, Profile):
        gap = gap.gaps(n)
    elif isinstance(gap, tuple) and len(gap) != n:
        gap_place = contact.places.get("gap", contact.place)
        message = f"{module_label}: gap: the number of items is {len(gap)}, but must be {n}"
        message += " (one for each point)" if n > 1 else ": it joins two single points"
        collector.error("E106", message, gap_place)
        return 0.0
    if not isinstance(gap, tuple):
        return gap
    return gap[0] if n == 1 else Each(gap)
