"""Macros as generators of a score, and the member that each of their points becomes.

All fixed points of a macro are one SOL of its own: they are at the same place, whatever is
joined to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ergon.instruments.spread import MAX_LINKED_POINTS
from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import STRINGS
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.naming import times
from ergon.workshop.models.refused import REFUSED

MASSES_MAX = 2_000_000
ROWS_MAX = 2_000
SIDE_MAX = 801  # masses of a PLATE
_PLACE_TOLERANCE = 1e-9  # of a mass: what rounding leaves of 0.7·(N - 1)


@dataclass(slots=True)
class Macro:
    """A macro: `rows` by `columns` points, and the modules that it is made of."""

    statement: Statement
    name: str
    rows: int
    columns: int
    written: dict[str, str]  # values as expressions of the score
    start: tuple[str, str]  # X0 and V0 of what moves, as fields of a module
    height: str  # x0 as an expression; "0" where it is 0
    edge: str  # the name of its fixed point
    is_joined: bool = False  # the fixed point is needed as a module
    modules: list[tuple[str, str]] = field(default_factory=list)

    def is_fixed(self, row: int, column: int) -> bool:
        """Whether a point is fixed."""
        is_at_ends = row in (0, self.rows - 1), column in (0, self.columns - 1)
        return {
            "string": is_at_ends[1],
            "stiffString": is_at_ends[1],
            "closedMesh": any(is_at_ends),
            "cornerMesh": all(is_at_ends),
        }.get(self.statement.keyword, False)

    @property
    def is_whole(self) -> bool:
        """Whether one generator holds all its moving points."""
        keyword = self.statement.keyword
        return keyword in ("chain", "mesh") or (keyword != "cornerMesh" and self.height == "0")

    def span(self, row: int) -> tuple[int, int]:
        """The columns of a row that move: the first, and their number."""
        if self.statement.keyword == "closedMesh" and row in (0, self.rows - 1):
            return 0, 0
        is_first_fixed = self.is_fixed(row, 0)
        return int(is_first_fixed), self.columns - 2 * is_first_fixed

    def member(self, row: int, first: int, count: int = 1) -> str:
        """Moving points of a row, as a range of a module."""
        first_column, row_size = self.span(row)
        module_name, member_offset = self.row(row), first - first_column
        if self.is_whole:
            module_name = self.name
            member_offset += (row - (self.statement.keyword == "closedMesh")) * row_size
        if row_size == 1 and (self.statement.keyword == "chain" or not self.is_whole):
            return module_name  # a MAS
        return (
            f"{module_name}.{member_offset}"
            if count == 1
            else f"{module_name}.{member_offset}..{member_offset + count - 1}"
        )

    @property
    def moving(self) -> list[str]:
        """All moving points: one range for each module, split where a link cannot take as many."""
        moving_rows = [row for row in range(self.rows) if self.span(row)[1]]
        if not self.is_whole or len(moving_rows) == 1:
            return [self.member(row, *self.span(row)) for row in moving_rows]
        moving_count = len(moving_rows) * self.span(moving_rows[0])[1]
        range_begins = range(0, moving_count, MAX_LINKED_POINTS)
        return [
            f"{self.name}.{begin}..{min(begin + MAX_LINKED_POINTS, moving_count) - 1}"
            for begin in range_begins
        ]

    def neighbours(self) -> list[tuple[str, str]]:
        """Both ends of all links along a single row; those between moving points are given as
        ranges.
        """
        first_moving, moving_count = self.span(0)
        links_between_moving = [
            (self.member(0, column, size), self.member(0, column + 1, size))
            for column in range(first_moving, first_moving + moving_count - 1, MAX_LINKED_POINTS)
            if (size := min(MAX_LINKED_POINTS, first_moving + moving_count - 1 - column))
        ]
        if not first_moving:
            return links_between_moving
        last_moving = first_moving + moving_count - 1
        return [
            (self.point_name(0, 0), self.point_name(0, 1)),
            *links_between_moving,
            (self.point_name(0, last_moving), self.point_name(0, last_moving + 1)),
        ]

    def row(self, row: int) -> str:
        """The name of the module of one row."""
        return self.name if self.rows == 1 else f"{self.name}_row{row}"

    def point_name(self, row_index: int, column_index: int) -> str:
        """The name of one point."""
        if not self.is_fixed(row_index, column_index):
            return self.member(row_index, column_index)
        self.is_joined = True
        return self.edge

    def points(
        self, places: Sequence[float], *, is_2019: bool, line: int
    ) -> list[tuple[float, str]]:
        """The members between which a place lies, with the share of each. Raises ModelError.

        Shares are linear along each side, so that at most four members of a mesh have one.
        """
        is_string = self.statement.keyword in STRINGS
        side_counts = (self.columns,) if is_string else (self.rows, self.columns)
        members_by_side = []
        for place, count in zip(places, side_counts, strict=True):
            if is_2019:
                position = min(place * count, count - 1.0)
            else:
                position = min(max(place, 0.0), 1.0) * (count - 1)
            if position < 0.0:
                raise ModelError(
                    f"a place on {quote(self.statement.name)} is {place:g}, below 0", line
                )
            lower_member, upper_share = int(position), position - int(position)
            if min(upper_share, 1.0 - upper_share) < _PLACE_TOLERANCE:
                members_by_side.append([(round(position), 1.0)])
            else:
                members_by_side.append(
                    [(lower_member, 1.0 - upper_share), (lower_member + 1, upper_share)]
                )
        if is_string:
            members_by_side.insert(0, [(0, 1.0)])
        shares: dict[str, float] = {}
        for row, row_share in members_by_side[0]:
            for column, column_share in members_by_side[1]:
                name = self.point_name(row, column)
                shares[name] = shares.get(name, 0.0) + row_share * column_share
        return [(share, name) for name, share in shares.items()]


def size(statement: Statement) -> tuple[int, int]:
    """Rows and columns of a macro. Raises ModelError."""
    if statement.keyword in STRINGS:
        row_count, column_count = 1, int(statement.values["N"])
        count_min = 1 if statement.keyword == "chain" else 3
        if column_count < count_min:
            message = REFUSED["few"].format(keyword=statement.keyword, least=count_min)
            raise ModelError(message, statement.line)
    else:
        row_count, column_count = int(statement.values["L"]), int(statement.values["W"])
        count_min = 1 if statement.keyword == "mesh" else 3
        if min(row_count, column_count) < count_min:
            message = REFUSED["few"].format(
                keyword=statement.keyword, least=f"{count_min} by {count_min}"
            )
            raise ModelError(message, statement.line)
    if statement.keyword in ("mesh", "closedMesh"):
        longest_side = max(row_count, column_count) - 2 * (statement.keyword == "closedMesh")
        if longest_side > SIDE_MAX:
            message = f"{statement.keyword}: a side has {SIDE_MAX} masses at most in a score"
            raise ModelError(message, statement.line)
    if row_count * column_count > MASSES_MAX or (
        statement.keyword == "cornerMesh" and row_count > ROWS_MAX
    ):
        message = (
            f"{statement.keyword}: {row_count * column_count:,} masses are more than a score holds"
        )
        raise ModelError(message, statement.line)
    return row_count, column_count


def build(macro: Macro, is_2019: bool) -> None:
    """Add the modules of the macro."""
    if macro.is_whole:
        _single_macro(macro)
    else:
        _rows(macro)
    if macro.statement.keyword == "stiffString":
        _stiffness(macro, is_2019)
    if "Zo" in macro.written:
        macro.is_joined = True
        for nth, point_name in enumerate(macro.moving):
            name = f"{macro.name}_air{nth or ''}"
            ends = f"between: [{macro.edge}, {point_name}]"
            macro.modules.append((name, f"FRO: {{{ends}, Z: {macro.written['Zo']}}}"))


def _body(macro: Macro, body_name: str, mass_count: int, generator_text: str) -> None:
    """Masses in a row, or a mesh; a single one is a MAS."""
    start_fields = "".join(f", {text}" for text in macro.start if text)
    if mass_count == 1 and generator_text.startswith("STRING") and "ends: free" in generator_text:
        macro.modules.append((body_name, f"MAS: {{M: {macro.written['M']}{start_fields}}}"))
        return
    mass = times(mass_count, macro.written["M"])
    k, z = macro.written["K"], macro.written["Z"]
    macro.modules.append(
        (body_name, f"{generator_text}, M: {mass}, K: {k}, Z: {z}{start_fields}}}")
    )


def _single_macro(macro: Macro) -> None:
    keyword = macro.statement.keyword
    if macro.rows == 1 and keyword in STRINGS:
        moving_count = macro.columns if keyword == "chain" else macro.columns - 2
        ends = "free" if keyword == "chain" else "fixed"
        _body(macro, macro.name, moving_count, f"STRING: {{masses: {moving_count}, ends: {ends}")
        return
    fixed_count, rim = (2, "fixed") if keyword == "closedMesh" else (0, "free")
    moving_columns, moving_rows = macro.columns - fixed_count, macro.rows - fixed_count
    generator_text = (
        f"PLATE: {{shape: rectangle, sides: [{moving_columns}, {moving_rows}], rim: {rim}"
    )
    _body(macro, macro.name, moving_columns * moving_rows, generator_text)


def _rows(macro: Macro) -> None:
    """Write a STRING for each row, and links that join it to the next row and to fixed points."""
    for row_index in range(macro.rows):
        first_moving, moving_count = macro.span(row_index)
        if not moving_count:
            continue
        row_name = macro.row(row_index)
        _body(macro, row_name, moving_count, f"STRING: {{masses: {moving_count}, ends: free")
        if moving_count < macro.columns:
            _join(macro, f"{row_name}_left", macro.edge, macro.member(row_index, first_moving))
            _join(
                macro,
                f"{row_name}_right",
                macro.member(row_index, first_moving + moving_count - 1),
                macro.edge,
            )
    for row_index in range(macro.rows - 1):
        (first_here, moving_count_here), (first_below, moving_count_below) = (
            macro.span(row_index),
            macro.span(row_index + 1),
        )
        if moving_count_here and moving_count_below:
            first_shared, end_shared = (
                max(first_here, first_below),
                min(first_here + moving_count_here, first_below + moving_count_below),
            )
            ends = (
                macro.member(end_row, first_shared, end_shared - first_shared)
                for end_row in (row_index, row_index + 1)
            )
            _join(macro, f"{macro.name}_rows{row_index}", *ends)
        for end_column in (0, macro.columns - 1):
            fixed_ends = (
                macro.is_fixed(row_index, end_column),
                macro.is_fixed(row_index + 1, end_column),
            )
            if fixed_ends[0] != fixed_ends[1] and not (
                moving_count_here == 0 or moving_count_below == 0
            ):
                ends = (
                    macro.point_name(end_row, end_column) for end_row in (row_index, row_index + 1)
                )
                _join(macro, f"{macro.name}_corner{row_index}_{end_column}", *ends)
        if (moving_count_here == 0) != (moving_count_below == 0):
            end_row, (first_moving, moving_count) = (
                (row_index, (first_here, moving_count_here))
                if moving_count_here
                else (row_index + 1, (first_below, moving_count_below))
            )
            _join(
                macro,
                f"{macro.name}_rim{row_index}",
                macro.edge,
                macro.member(end_row, first_moving, moving_count),
            )


def _join(macro: Macro, name: str, a: str, b: str) -> None:
    macro.is_joined = macro.is_joined or macro.edge in (a, b)
    k, z = macro.written["K"], macro.written["Z"]
    macro.modules.append((name, f"REF: {{between: [{a}, {b}], K: {k}, Z: {z}}}"))


def _stiffness(macro: Macro, is_2019: bool) -> None:
    """Add springs to second neighbours, and at the ends to the neighbour; the laws of 2019 had none
    at the first end.
    """
    column_count = macro.columns
    k = macro.written["K2"]
    if column_count > 4:
        second_neighbours = (
            f"[{macro.member(0, 1, column_count - 4)}, {macro.member(0, 3, column_count - 4)}]"
        )
        macro.modules.append(
            (f"{macro.name}_stiff", f"RES: {{between: {second_neighbours}, K: {k}}}")
        )
    column_pairs = [(0, 2), (column_count - 3, column_count - 1)] if column_count > 3 else []
    column_pairs += (
        [(column_count - 2, column_count - 1)]
        if is_2019
        else [(0, 1), (column_count - 2, column_count - 1)]
    )
    for nth, (first_column, second_column) in enumerate(column_pairs):
        point_pair = f"[{macro.point_name(0, first_column)}, {macro.point_name(0, second_column)}]"
        macro.modules.append((f"{macro.name}_end{nth}", f"RES: {{between: {point_pair}, K: {k}}}"))
