"""Macros as generators of a score, and the member that each of their points becomes.

All fixed points of a macro are one SOL of its own: they are at the same place, whatever is
joined to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ergon.instruments.spread import MAX_SPREAD
from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import STRINGS
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.naming import times
from ergon.workshop.models.refused import REFUSED

MASSES_MAX = 2_000_000
ROWS_MAX = 2_000
SIDE_MAX = 801  # masses of a PLATE
_NEAR = 1e-9  # of a mass: what rounding leaves of 0.7·(N - 1)


@dataclass(slots=True)
class Macro:
    """A macro: `rows` by `columns` points, and the modules that it is made of."""

    of: Statement
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
        ends = row in (0, self.rows - 1), column in (0, self.columns - 1)
        return {
            "string": ends[1],
            "stiffString": ends[1],
            "closedMesh": any(ends),
            "cornerMesh": all(ends),
        }.get(self.of.keyword, False)

    @property
    def is_whole(self) -> bool:
        """Whether one generator holds all its moving points."""
        keyword = self.of.keyword
        return keyword in ("chain", "mesh") or (keyword != "cornerMesh" and self.height == "0")

    def span(self, row: int) -> tuple[int, int]:
        """The columns of a row that move: the first, and their number."""
        if self.of.keyword == "closedMesh" and row in (0, self.rows - 1):
            return 0, 0
        held = self.is_fixed(row, 0)
        return int(held), self.columns - 2 * held

    def member(self, row: int, first: int, count: int = 1) -> str:
        """Moving points of a row, as a range of a module."""
        own, size = self.span(row)
        name, at = self.row(row), first - own
        if self.is_whole:
            name = self.name
            at += (row - (self.of.keyword == "closedMesh")) * size
        if size == 1 and (self.of.keyword == "chain" or not self.is_whole):
            return name  # a MAS
        return f"{name}.{at}" if count == 1 else f"{name}.{at}..{at + count - 1}"

    @property
    def moving(self) -> list[str]:
        """All moving points: one range for each module, split where a link cannot take as many."""
        rows = [row for row in range(self.rows) if self.span(row)[1]]
        if not self.is_whole or len(rows) == 1:
            return [self.member(row, *self.span(row)) for row in rows]
        count = len(rows) * self.span(rows[0])[1]
        firsts = range(0, count, MAX_SPREAD)
        return [f"{self.name}.{a}..{min(a + MAX_SPREAD, count) - 1}" for a in firsts]

    def neighbours(self) -> list[tuple[str, str]]:
        """Both ends of all links along a single row; those between moving points are given as
        ranges.
        """
        first, count = self.span(0)
        inner = [
            (self.member(0, at, size), self.member(0, at + 1, size))
            for at in range(first, first + count - 1, MAX_SPREAD)
            if (size := min(MAX_SPREAD, first + count - 1 - at))
        ]
        if not first:
            return inner
        last = first + count - 1
        return [(self.at(0, 0), self.at(0, 1)), *inner, (self.at(0, last), self.at(0, last + 1))]

    def row(self, row: int) -> str:
        """The name of the module of one row."""
        return self.name if self.rows == 1 else f"{self.name}_row{row}"

    def at(self, row: int, column: int) -> str:
        """The name of one point."""
        if not self.is_fixed(row, column):
            return self.member(row, column)
        self.is_joined = True
        return self.edge

    def points(
        self, sides: Sequence[float], *, is_2019: bool, line: int
    ) -> list[tuple[float, str]]:
        """The members between which a place lies, with the share of each. Raises ModelError.

        Shares are linear along each side, so that at most four members of a mesh have one.
        """
        is_string = self.of.keyword in STRINGS
        counts = (self.columns,) if is_string else (self.rows, self.columns)
        along = []
        for share, count in zip(sides, counts, strict=True):
            if is_2019:
                at = min(share * count, count - 1.0)
            else:
                at = min(max(share, 0.0), 1.0) * (count - 1)
            if at < 0.0:
                raise ModelError(f"a place on {quote(self.of.name)} is {share:g}, below 0", line)
            low, part = int(at), at - int(at)
            if min(part, 1.0 - part) < _NEAR:
                along.append([(round(at), 1.0)])
            else:
                along.append([(low, 1.0 - part), (low + 1, part)])
        if is_string:
            along.insert(0, [(0, 1.0)])
        shares: dict[str, float] = {}
        for row, a in along[0]:
            for column, b in along[1]:
                name = self.at(row, column)
                shares[name] = shares.get(name, 0.0) + a * b
        return [(share, name) for name, share in shares.items()]


def size(one: Statement) -> tuple[int, int]:
    """Rows and columns of a macro. Raises ModelError."""
    if one.keyword in STRINGS:
        rows, columns = 1, int(one.values["N"])
        least = 1 if one.keyword == "chain" else 3
        if columns < least:
            few = REFUSED["few"].format(keyword=one.keyword, least=least)
            raise ModelError(few, one.line)
    else:
        rows, columns = int(one.values["L"]), int(one.values["W"])
        least = 1 if one.keyword == "mesh" else 3
        if min(rows, columns) < least:
            few = REFUSED["few"].format(keyword=one.keyword, least=f"{least} by {least}")
            raise ModelError(few, one.line)
    if one.keyword in ("mesh", "closedMesh"):
        sides = max(rows, columns) - 2 * (one.keyword == "closedMesh")
        if sides > SIDE_MAX:
            message = f"{one.keyword}: a side has {SIDE_MAX} masses at most in a score"
            raise ModelError(message, one.line)
    if rows * columns > MASSES_MAX or (one.keyword == "cornerMesh" and rows > ROWS_MAX):
        message = f"{one.keyword}: {rows * columns:,} masses are more than a score holds"
        raise ModelError(message, one.line)
    return rows, columns


def build(own: Macro, is_2019: bool) -> None:
    """Add the modules of the macro."""
    if own.is_whole:
        _whole(own)
    else:
        _rows(own)
    if own.of.keyword == "stiffString":
        _stiffness(own, is_2019)
    if "Zo" in own.written:
        own.is_joined = True
        for count, where in enumerate(own.moving):
            name = f"{own.name}_air{count or ''}"
            ends = f"between: [{own.edge}, {where}]"
            own.modules.append((name, f"FRO: {{{ends}, Z: {own.written['Zo']}}}"))


def _body(own: Macro, name: str, count: int, form: str) -> None:
    """Masses in a row, or a mesh; a single one is a MAS."""
    start = "".join(f", {text}" for text in own.start if text)
    if count == 1 and form.startswith("STRING") and "ends: free" in form:
        own.modules.append((name, f"MAS: {{M: {own.written['M']}{start}}}"))
        return
    mass = times(count, own.written["M"])
    k, z = own.written["K"], own.written["Z"]
    own.modules.append((name, f"{form}, M: {mass}, K: {k}, Z: {z}{start}}}"))


def _whole(own: Macro) -> None:
    keyword = own.of.keyword
    if own.rows == 1 and keyword in STRINGS:
        count = own.columns if keyword == "chain" else own.columns - 2
        ends = "free" if keyword == "chain" else "fixed"
        _body(own, own.name, count, f"STRING: {{masses: {count}, ends: {ends}")
        return
    less, rim = (2, "fixed") if keyword == "closedMesh" else (0, "free")
    across, up = own.columns - less, own.rows - less
    form = f"PLATE: {{shape: rectangle, sides: [{across}, {up}], rim: {rim}"
    _body(own, own.name, across * up, form)


def _rows(own: Macro) -> None:
    """Write a STRING for each row, and links that join it to the next row and to fixed points."""
    for row in range(own.rows):
        first, count = own.span(row)
        if not count:
            continue
        name = own.row(row)
        _body(own, name, count, f"STRING: {{masses: {count}, ends: free")
        if count < own.columns:
            _join(own, f"{name}_left", own.edge, own.member(row, first))
            _join(own, f"{name}_right", own.member(row, first + count - 1), own.edge)
    for row in range(own.rows - 1):
        (a, n), (b, m) = own.span(row), own.span(row + 1)
        if n and m:
            low, high = max(a, b), min(a + n, b + m)
            ends = (own.member(at, low, high - low) for at in (row, row + 1))
            _join(own, f"{own.name}_rows{row}", *ends)
        for column in (0, own.columns - 1):
            fixed = own.is_fixed(row, column), own.is_fixed(row + 1, column)
            if fixed[0] != fixed[1] and not (n == 0 or m == 0):
                ends = (own.at(at, column) for at in (row, row + 1))
                _join(own, f"{own.name}_corner{row}_{column}", *ends)
        if (n == 0) != (m == 0):
            at, (first, count) = (row, (a, n)) if n else (row + 1, (b, m))
            _join(own, f"{own.name}_rim{row}", own.edge, own.member(at, first, count))


def _join(own: Macro, name: str, a: str, b: str) -> None:
    own.is_joined = own.is_joined or own.edge in (a, b)
    k, z = own.written["K"], own.written["Z"]
    own.modules.append((name, f"REF: {{between: [{a}, {b}], K: {k}, Z: {z}}}"))


def _stiffness(own: Macro, is_2019: bool) -> None:
    """Add springs to second neighbours, and at the ends to the neighbour; the laws of 2019 had none
    at the first end.
    """
    n = own.columns
    k = own.written["K2"]
    if n > 4:
        inner = f"[{own.member(0, 1, n - 4)}, {own.member(0, 3, n - 4)}]"
        own.modules.append((f"{own.name}_stiff", f"RES: {{between: {inner}, K: {k}}}"))
    ends = [(0, 2), (n - 3, n - 1)] if n > 3 else []
    ends += [(n - 2, n - 1)] if is_2019 else [(0, 1), (n - 2, n - 1)]
    for nth, (first, last) in enumerate(ends):
        where = f"[{own.at(0, first)}, {own.at(0, last)}]"
        own.modules.append((f"{own.name}_end{nth}", f"RES: {{between: {where}, K: {k}}}"))
