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
        is_at_edge = row in (0, self.rows - 1), column in (0, self.columns - 1)
        return {
            "string": is_at_edge[1],
            "stiffString": is_at_edge[1],
            "closedMesh": any(is_at_edge),
            "cornerMesh": all(is_at_edge),
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
        row_name, member_offset = self.row(row), first - first_column
        if self.is_whole:
            row_name = self.name
            member_offset += (row - (self.statement.keyword == "closedMesh")) * row_size
        if row_size == 1 and (self.statement.keyword == "chain" or not self.is_whole):
            return row_name  # a MAS
        return (
            f"{row_name}.{member_offset}"
            if count == 1
            else f"{row_name}.{member_offset}..{member_offset + count - 1}"
        )

    @property
    def moving(self) -> list[str]:
        """All moving points: one range for each module, split where a link cannot take as many."""
        moving_rows = [row for row in range(self.rows) if self.span(row)[1]]
        if not self.is_whole or len(moving_rows) == 1:
            return [self.member(row, *self.span(row)) for row in moving_rows]
        count = len(moving_rows) * self.span(moving_rows[0])[1]
        firsts = range(0, count, MAX_LINKED_POINTS)
        return [f"{self.name}.{a}..{min(a + MAX_LINKED_POINTS, count) - 1}" for a in firsts]

    def neighbours(self) -> list[tuple[str, str]]:
        """Both ends of all links along a single row; those between moving points are given as
        ranges.
        """
        first_moving, moving_count = self.span(0)
        inner_links = [
            (self.member(0, offset, size), self.member(0, offset + 1, size))
            for offset in range(first_moving, first_moving + moving_count - 1, MAX_LINKED_POINTS)
            if (size := min(MAX_LINKED_POINTS, first_moving + moving_count - 1 - offset))
        ]
        if not first_moving:
            return inner_links
        last_moving = first_moving + moving_count - 1
        return [
            (self.point_name(0, 0), self.point_name(0, 1)),
            *inner_links,
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
        self, sides: Sequence[float], *, is_2019: bool, line: int
    ) -> list[tuple[float, str]]:
        """The members between which a place lies, with the share of each. Raises ModelError.

        Shares are linear along each side, so that at most four members of a mesh have one.
        """
        is_string = self.statement.keyword in STRINGS
        counts = (self.columns,) if is_string else (self.rows, self.columns)
        positions = []
        for side_share, side_count in zip(sides, counts, strict=True):
            if is_2019:
                side_position = min(side_share * side_count, side_count - 1.0)
            else:
                side_position = min(max(side_share, 0.0), 1.0) * (side_count - 1)
            if side_position < 0.0:
                raise ModelError(
                    f"a place on {quote(self.statement.name)} is {side_share:g}, below 0", line
                )
            low_member, member_part = int(side_position), side_position - int(side_position)
            if min(member_part, 1.0 - member_part) < _PLACE_TOLERANCE:
                positions.append([(round(side_position), 1.0)])
            else:
                positions.append([(low_member, 1.0 - member_part), (low_member + 1, member_part)])
        if is_string:
            positions.insert(0, [(0, 1.0)])
        shares: dict[str, float] = {}
        for row, a in positions[0]:
            for column, b in positions[1]:
                name = self.point_name(row, column)
                shares[name] = shares.get(name, 0.0) + a * b
        return [(share, name) for name, share in shares.items()]


def size(model_statement: Statement) -> tuple[int, int]:
    """Rows and columns of a macro. Raises ModelError."""
    if model_statement.keyword in STRINGS:
        row_count, column_count = 1, int(model_statement.values["N"])
        least = 1 if model_statement.keyword == "chain" else 3
        if column_count < least:
            refusal_text = REFUSED["few"].format(keyword=model_statement.keyword, least=least)
            raise ModelError(refusal_text, model_statement.line)
    else:
        row_count, column_count = int(model_statement.values["L"]), int(model_statement.values["W"])
        least = 1 if model_statement.keyword == "mesh" else 3
        if min(row_count, column_count) < least:
            refusal_text = REFUSED["few"].format(
                keyword=model_statement.keyword, least=f"{least} by {least}"
            )
            raise ModelError(refusal_text, model_statement.line)
    if model_statement.keyword in ("mesh", "closedMesh"):
        sides = max(row_count, column_count) - 2 * (model_statement.keyword == "closedMesh")
        if sides > SIDE_MAX:
            message = f"{model_statement.keyword}: a side has {SIDE_MAX} masses at most in a score"
            raise ModelError(message, model_statement.line)
    if row_count * column_count > MASSES_MAX or (
        model_statement.keyword == "cornerMesh" and row_count > ROWS_MAX
    ):
        message = (
            f"{model_statement.keyword}: {row_count * column_count:,} masses are more than a score "
            "holds"
        )
        raise ModelError(message, model_statement.line)
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
        for count, point_name in enumerate(macro.moving):
            name = f"{macro.name}_air{count or ''}"
            between_text = f"between: [{macro.edge}, {point_name}]"
            macro.modules.append((name, f"FRO: {{{between_text}, Z: {macro.written['Zo']}}}"))


def _body(macro: Macro, body_name: str, mass_count: int, body_form: str) -> None:
    """Masses in a row, or a mesh; a single one is a MAS."""
    start_text = "".join(f", {text}" for text in macro.start if text)
    if mass_count == 1 and body_form.startswith("STRING") and "ends: free" in body_form:
        macro.modules.append((body_name, f"MAS: {{M: {macro.written['M']}{start_text}}}"))
        return
    mass = times(mass_count, macro.written["M"])
    k, z = macro.written["K"], macro.written["Z"]
    macro.modules.append((body_name, f"{body_form}, M: {mass}, K: {k}, Z: {z}{start_text}}}"))


def _single_macro(macro: Macro) -> None:
    keyword = macro.statement.keyword
    if macro.rows == 1 and keyword in STRINGS:
        count = macro.columns if keyword == "chain" else macro.columns - 2
        edge_kind = "free" if keyword == "chain" else "fixed"
        _body(macro, macro.name, count, f"STRING: {{masses: {count}, ends: {edge_kind}")
        return
    less, rim = (2, "fixed") if keyword == "closedMesh" else (0, "free")
    column_steps, row_steps = macro.columns - less, macro.rows - less
    form = f"PLATE: {{shape: rectangle, sides: [{column_steps}, {row_steps}], rim: {rim}"
    _body(macro, macro.name, column_steps * row_steps, form)


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
        (a, n), (b, m) = macro.span(row_index), macro.span(row_index + 1)
        if n and m:
            low, high = max(a, b), min(a + n, b + m)
            ends = (
                macro.member(row_place, low, high - low) for row_place in (row_index, row_index + 1)
            )
            _join(macro, f"{macro.name}_rows{row_index}", *ends)
        for end_column in (0, macro.columns - 1):
            fixed = macro.is_fixed(row_index, end_column), macro.is_fixed(row_index + 1, end_column)
            if fixed[0] != fixed[1] and not (n == 0 or m == 0):
                ends = (
                    macro.point_name(row_place, end_column)
                    for row_place in (row_index, row_index + 1)
                )
                _join(macro, f"{macro.name}_corner{row_index}_{end_column}", *ends)
        if (n == 0) != (m == 0):
            row_place, (first_moving, moving_count) = (
                (row_index, (a, n)) if n else (row_index + 1, (b, m))
            )
            _join(
                macro,
                f"{macro.name}_rim{row_index}",
                macro.edge,
                macro.member(row_place, first_moving, moving_count),
            )


def _join(macro: Macro, name: str, a: str, b: str) -> None:
    macro.is_joined = macro.is_joined or macro.edge in (a, b)
    k, z = macro.written["K"], macro.written["Z"]
    macro.modules.append((name, f"REF: {{between: [{a}, {b}], K: {k}, Z: {z}}}"))


def _stiffness(macro: Macro, is_2019: bool) -> None:
    """Add springs to second neighbours, and at the ends to the neighbour; the laws of 2019 had none
    at the first end.
    """
    n = macro.columns
    k = macro.written["K2"]
    if n > 4:
        inner = f"[{macro.member(0, 1, n - 4)}, {macro.member(0, 3, n - 4)}]"
        macro.modules.append((f"{macro.name}_stiff", f"RES: {{between: {inner}, K: {k}}}"))
    column_pairs = [(0, 2), (n - 3, n - 1)] if n > 3 else []
    column_pairs += [(n - 2, n - 1)] if is_2019 else [(0, 1), (n - 2, n - 1)]
    for nth, (first_column, second_column) in enumerate(column_pairs):
        point_pair = f"[{macro.point_name(0, first_column)}, {macro.point_name(0, second_column)}]"
        macro.modules.append((f"{macro.name}_end{nth}", f"RES: {{between: {point_pair}, K: {k}}}"))
