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
from ergon.workshop.models.naming import product_text
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
    expressions: dict[str, str]  # values as expressions of the score
    start_fields: tuple[str, str]  # X0 and V0 of what moves, as fields of a module
    x0: str  # x0 as an expression; "0" where it is 0
    edge_name: str  # the name of its fixed point
    needs_edge: bool = False  # the fixed point is needed as a module
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
    def is_single_generator(self) -> bool:
        """Whether one generator holds all its moving points."""
        keyword = self.statement.keyword
        return keyword in ("chain", "mesh") or (keyword != "cornerMesh" and self.x0 == "0")

    def moving_columns(self, row: int) -> tuple[int, int]:
        """The columns of a row that move: the first, and their number."""
        if self.statement.keyword == "closedMesh" and row in (0, self.rows - 1):
            return 0, 0
        has_fixed_ends = self.is_fixed(row, 0)
        return int(has_fixed_ends), self.columns - 2 * has_fixed_ends

    def member_range(self, row: int, first_member: int, count: int = 1) -> str:
        """Moving points of a row, as a range of a module."""
        first_moving, n_moving = self.moving_columns(row)
        module_name, member_offset = self.row_module(row), first_member - first_moving
        if self.is_single_generator:
            module_name = self.name
            member_offset += (row - (self.statement.keyword == "closedMesh")) * n_moving
        if n_moving == 1 and (self.statement.keyword == "chain" or not self.is_single_generator):
            return module_name  # a MAS
        return (
            f"{module_name}.{member_offset}"
            if count == 1
            else f"{module_name}.{member_offset}..{member_offset + count - 1}"
        )

    @property
    def moving_ranges(self) -> list[str]:
        """All moving points: one range for each module, split where a link cannot take as many."""
        moving_rows = [row for row in range(self.rows) if self.moving_columns(row)[1]]
        if not self.is_single_generator or len(moving_rows) == 1:
            return [self.member_range(row, *self.moving_columns(row)) for row in moving_rows]
        n_moving = len(moving_rows) * self.moving_columns(moving_rows[0])[1]
        range_begins = range(0, n_moving, MAX_LINKED_POINTS)
        return [
            f"{self.name}.{begin}..{min(begin + MAX_LINKED_POINTS, n_moving) - 1}"
            for begin in range_begins
        ]

    def neighbours(self) -> list[tuple[str, str]]:
        """Both ends of all links along a single row; those between moving points are given as
        ranges.
        """
        first_moving, n_moving = self.moving_columns(0)
        links_between_moving = [
            (self.member_range(0, column, size), self.member_range(0, column + 1, size))
            for column in range(first_moving, first_moving + n_moving - 1, MAX_LINKED_POINTS)
            if (size := min(MAX_LINKED_POINTS, first_moving + n_moving - 1 - column))
        ]
        if not first_moving:
            return links_between_moving
        last_moving = first_moving + n_moving - 1
        return [
            (self.point_name(0, 0), self.point_name(0, 1)),
            *links_between_moving,
            (self.point_name(0, last_moving), self.point_name(0, last_moving + 1)),
        ]

    def row_module(self, row: int) -> str:
        """The name of the module of one row."""
        return self.name if self.rows == 1 else f"{self.name}_row{row}"

    def point_name(self, row_index: int, column_index: int) -> str:
        """The name of one point."""
        if not self.is_fixed(row_index, column_index):
            return self.member_range(row_index, column_index)
        self.needs_edge = True
        return self.edge_name

    def point_shares(
        self, places: Sequence[float], *, is_2019: bool, line: int
    ) -> list[tuple[float, str]]:
        """The members between which a place lies, with the share of each. Raises ModelError.

        Shares are linear along each side, so that at most four members of a mesh have one.
        """
        is_string = self.statement.keyword in STRINGS
        points_per_side = (self.columns,) if is_string else (self.rows, self.columns)
        weights_by_side = []
        for place, count in zip(places, points_per_side, strict=True):
            if is_2019:
                position = min(place * count, count - 1.0)
            else:
                position = min(max(place, 0.0), 1.0) * (count - 1)
            if position < 0.0:
                raise ModelError(
                    f"a place on {quote(self.statement.name)} is {place:g}, below 0", line
                )
            lower_index, upper_share = int(position), position - int(position)
            if min(upper_share, 1.0 - upper_share) < _PLACE_TOLERANCE:
                weights_by_side.append([(round(position), 1.0)])
            else:
                weights_by_side.append(
                    [(lower_index, 1.0 - upper_share), (lower_index + 1, upper_share)]
                )
        if is_string:
            weights_by_side.insert(0, [(0, 1.0)])
        shares: dict[str, float] = {}
        for row, row_share in weights_by_side[0]:
            for column, column_share in weights_by_side[1]:
                name = self.point_name(row, column)
                shares[name] = shares.get(name, 0.0) + row_share * column_share
        return [(share, name) for name, share in shares.items()]


def dimensions(statement: Statement) -> tuple[int, int]:
    """Rows and columns of a macro. Raises ModelError."""
    if statement.keyword in STRINGS:
        n_rows, n_columns = 1, int(statement.values["N"])
        n_min = 1 if statement.keyword == "chain" else 3
        if n_columns < n_min:
            message = REFUSED["few"].format(keyword=statement.keyword, least=n_min)
            raise ModelError(message, statement.line)
    else:
        n_rows, n_columns = int(statement.values["L"]), int(statement.values["W"])
        n_min = 1 if statement.keyword == "mesh" else 3
        if min(n_rows, n_columns) < n_min:
            message = REFUSED["few"].format(keyword=statement.keyword, least=f"{n_min} by {n_min}")
            raise ModelError(message, statement.line)
    if statement.keyword in ("mesh", "closedMesh"):
        longest_side = max(n_rows, n_columns) - 2 * (statement.keyword == "closedMesh")
        if longest_side > SIDE_MAX:
            message = f"{statement.keyword}: a side has {SIDE_MAX} masses at most in a score"
            raise ModelError(message, statement.line)
    if n_rows * n_columns > MASSES_MAX or (statement.keyword == "cornerMesh" and n_rows > ROWS_MAX):
        message = f"{statement.keyword}: {n_rows * n_columns:,} masses are more than a score holds"
        raise ModelError(message, statement.line)
    return n_rows, n_columns


def add_modules(macro: Macro, is_2019: bool) -> None:
    """Add the modules of the macro."""
    if macro.is_single_generator:
        _add_single_generator(macro)
    else:
        _add_rows(macro)
    if macro.statement.keyword == "stiffString":
        _add_bending_springs(macro, is_2019)
    if "Zo" in macro.expressions:
        macro.needs_edge = True
        for nth, point_name in enumerate(macro.moving_ranges):
            name = f"{macro.name}_air{nth or ''}"
            ends = f"between: [{macro.edge_name}, {point_name}]"
            macro.modules.append((name, f"FRO: {{{ends}, Z: {macro.expressions['Zo']}}}"))


def _add_generator(macro: Macro, name: str, n_masses: int, generator: str) -> None:
    """Masses in a row, or a mesh; a single one is a MAS."""
    start_fields = "".join(f", {text}" for text in macro.start_fields if text)
    if n_masses == 1 and generator.startswith("STRING") and "ends: free" in generator:
        macro.modules.append((name, f"MAS: {{M: {macro.expressions['M']}{start_fields}}}"))
        return
    mass = product_text(n_masses, macro.expressions["M"])
    k, z = macro.expressions["K"], macro.expressions["Z"]
    macro.modules.append((name, f"{generator}, M: {mass}, K: {k}, Z: {z}{start_fields}}}"))


def _add_single_generator(macro: Macro) -> None:
    keyword = macro.statement.keyword
    if macro.rows == 1 and keyword in STRINGS:
        n_moving = macro.columns if keyword == "chain" else macro.columns - 2
        ends = "free" if keyword == "chain" else "fixed"
        _add_generator(macro, macro.name, n_moving, f"STRING: {{masses: {n_moving}, ends: {ends}")
        return
    n_fixed, rim = (2, "fixed") if keyword == "closedMesh" else (0, "free")
    n_moving_columns, n_moving_rows = macro.columns - n_fixed, macro.rows - n_fixed
    generator = (
        f"PLATE: {{shape: rectangle, sides: [{n_moving_columns}, {n_moving_rows}], rim: {rim}"
    )
    _add_generator(macro, macro.name, n_moving_columns * n_moving_rows, generator)


def _add_rows(macro: Macro) -> None:
    """Write a STRING for each row, and links that join it to the next row and to fixed points."""
    for row_index in range(macro.rows):
        first_moving, n_moving = macro.moving_columns(row_index)
        if not n_moving:
            continue
        row_name = macro.row_module(row_index)
        _add_generator(macro, row_name, n_moving, f"STRING: {{masses: {n_moving}, ends: free")
        if n_moving < macro.columns:
            _add_spring(
                macro,
                f"{row_name}_left",
                macro.edge_name,
                macro.member_range(row_index, first_moving),
            )
            _add_spring(
                macro,
                f"{row_name}_right",
                macro.member_range(row_index, first_moving + n_moving - 1),
                macro.edge_name,
            )
    for row_index in range(macro.rows - 1):
        (first_upper, n_upper), (first_lower, n_lower) = (
            macro.moving_columns(row_index),
            macro.moving_columns(row_index + 1),
        )
        if n_upper and n_lower:
            first_shared, end_shared = (
                max(first_upper, first_lower),
                min(first_upper + n_upper, first_lower + n_lower),
            )
            ends = (
                macro.member_range(end_row, first_shared, end_shared - first_shared)
                for end_row in (row_index, row_index + 1)
            )
            _add_spring(macro, f"{macro.name}_rows{row_index}", *ends)
        for end_column in (0, macro.columns - 1):
            fixed_ends = (
                macro.is_fixed(row_index, end_column),
                macro.is_fixed(row_index + 1, end_column),
            )
            if fixed_ends[0] != fixed_ends[1] and not (n_upper == 0 or n_lower == 0):
                ends = (
                    macro.point_name(end_row, end_column) for end_row in (row_index, row_index + 1)
                )
                _add_spring(macro, f"{macro.name}_corner{row_index}_{end_column}", *ends)
        if (n_upper == 0) != (n_lower == 0):
            end_row, (first_moving, n_moving) = (
                (row_index, (first_upper, n_upper))
                if n_upper
                else (row_index + 1, (first_lower, n_lower))
            )
            _add_spring(
                macro,
                f"{macro.name}_rim{row_index}",
                macro.edge_name,
                macro.member_range(end_row, first_moving, n_moving),
            )


def _add_spring(macro: Macro, name: str, a: str, b: str) -> None:
    macro.needs_edge = macro.needs_edge or macro.edge_name in (a, b)
    k, z = macro.expressions["K"], macro.expressions["Z"]
    macro.modules.append((name, f"REF: {{between: [{a}, {b}], K: {k}, Z: {z}}}"))


def _add_bending_springs(macro: Macro, is_2019: bool) -> None:
    """Add springs to second neighbours, and at the ends to the neighbour; the laws of 2019 had none
    at the first end.
    """
    n_columns = macro.columns
    k = macro.expressions["K2"]
    if n_columns > 4:
        second_neighbours = ", ".join(
            macro.member_range(0, column, n_columns - 4) for column in (1, 3)
        )
        macro.modules.append(
            (f"{macro.name}_stiff", f"RES: {{between: [{second_neighbours}], K: {k}}}")
        )
    column_pairs = [(0, 2), (n_columns - 3, n_columns - 1)] if n_columns > 3 else []
    column_pairs += (
        [(n_columns - 2, n_columns - 1)] if is_2019 else [(0, 1), (n_columns - 2, n_columns - 1)]
    )
    for nth, (first_column, second_column) in enumerate(column_pairs):
        point_pair = f"[{macro.point_name(0, first_column)}, {macro.point_name(0, second_column)}]"
        macro.modules.append((f"{macro.name}_end{nth}", f"RES: {{between: {point_pair}, K: {k}}}"))
