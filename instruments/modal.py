"""BANKs whose modes are known one by one: as lists in the score, or as rows of a CSV file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context, Either, ListOf, Text
from ergon.notation.text.document import Document, Node
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place

MAX_MODES = 100_000  # of a list or a file
_MAX_LINE = 1_000  # characters


class Each(tuple[float, ...]):
    """A value for each member of a BANK, where two values would be a range."""

    __slots__ = ()


@dataclass(frozen=True)
class EachShape(Either):
    """One value or range, or a list with a value for each member."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        value = Either.read(self, node, name, context)
        is_list = value is not MISSING and self._of(node) is self.sequence
        return Each(value) if is_list else value


def _each(one: Text, scalar: Text | None) -> EachShape:
    return EachShape(scalar, None, ListOf(one, 1, MAX_MODES))


BANK_PITCHES = _each(k.PITCH, k.PITCHES)
BANK_DECAYS = _each(k.DURATION, k.DURATIONS)
BANK_GAINS = _each(k.GAIN, None)


def listed(values: Values) -> Values | None:
    """The fields of a BANK whose modes are listed, with its count; None after a report."""
    given, nodes = dict(values.given), dict(values.nodes)
    if any(name not in given for name in ("f", "t60", "gain") if name in nodes):
        return None  # refused already
    f, t60, gain = (given.get(name) for name in ("f", "t60", "gain"))
    if not isinstance(f, Each):
        for name, value in (("t60", t60), ("gain", gain)):
            if isinstance(value, Each):
                message = f"{values.context.of(name)}: a list of values needs a list of "
                values.error("E103", message + "frequencies, such as f: [200Hz, 453Hz]", name)
                return None
        return values
    if wrong := values.written("count", "spread"):
        message = f"{values.context.of(wrong[0])}: its modes are listed one by one; remove it"
        values.error("E111", message, wrong[0])
        return None
    if isinstance(t60, tuple) and not isinstance(t60, Each) and t60[0] == t60[1]:
        t60 = Each(t60[:1] * len(f))
    gain = Each((1.0,) * len(f)) if gain is None else gain
    for name, value in (("t60", t60), ("gain", gain)):
        if name == "gain" and any(one <= 0.0 for one in gain):
            message = f"{values.context.of(name)}: a mode of gain 0 does not move; remove the mode"
            values.error("E202", message, name)
            return None
        if value is not None and (not isinstance(value, Each) or len(value) != len(f)):
            message = f"{values.context.of(name)}: there are {len(f)} frequencies; write as many "
            if not isinstance(value, Each):
                message += "values, as a list"
            else:
                message += f"values, not {len(value)}"
            values.error("E106", message, name)
            return None
    given |= {"count": len(f), "gain": gain}
    if t60 is not None:
        given["t60"] = t60
    place = nodes.get("modes", nodes["f"])
    nodes |= {"count": place, "gain": nodes.get("gain", place)}
    return replace(values, given=given, nodes=nodes)


# --- files ----------------------------------------------------------------------------------------


def from_file(
    values: Values,
    read: Callable[[str, Place], Document | None],
    moved: Callable[[str, Any, Any], Any],
    collector: Collector,
) -> Values:
    """The fields of a BANK with the modes of the file that it names, at its own pitch."""
    name = values.given.get("modes")
    if name is None:
        return values
    said = values.written("f", "t60", "gain", "count", "spread")
    if said:
        message = f"{values.context.of(said[0])}: `modes` is written too; keep one of the two"
        values.error("E111", message, said[0])
        return _without(values)
    table = read(name, values.place_of("modes"))
    modes = None if table is None else _rows(table, values, collector)
    if modes is None:
        return _without(values)
    given = {field: value for field, value in values.given.items() if field != "modes"}
    nodes, node = dict(values.nodes), values.nodes["modes"]
    for field, column in zip(("f", "t60", "gain"), zip(*modes, strict=True), strict=True):
        each = Each(column)
        given[field] = moved(field, each, given["interval"]) if "interval" in given else each
        nodes[field] = node
    given.pop("interval", None)
    return replace(values, given=given, nodes=nodes)


def _without(values: Values) -> Values:
    """A BANK that was refused: its frequencies are there, but have no value."""
    given = {name: value for name, value in values.given.items() if name != "f"}
    return replace(values, given=given, nodes={**values.nodes, "f": values.nodes["modes"]})


def _rows(table: Document, values: Values, collector: Collector) -> list[tuple[float, ...]] | None:
    """f [Hz], t60 [s] and gain of each row; None after reports."""
    who, asked = values.context.of("modes"), values.place_of("modes")
    rows: list[tuple[float, ...]] = []
    is_whole = True
    for number, line in enumerate(table.text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if not rows and is_whole and _is_heading(line):
            continue
        row = _row(line, Place(table.file, number, 1), who, collector)
        is_whole &= row is not None
        if row is not None:
            rows.append(row)
        if len(rows) > MAX_MODES:
            message = f"{who}: the file has more than {MAX_MODES:,} modes"
            collector.error("E105", message, asked)
            return None
    if not rows and is_whole:
        message = f"{who}: the file has no modes; write lines such as 200Hz, 4s, -6dB"
        collector.error("E106", message, asked)
    return rows if rows and is_whole else None


def _is_heading(line: str) -> bool:
    return [cell.strip().lower() for cell in line.split(",")][:2] == ["f", "t60"]


def _row(line: str, place: Place, who: str, collector: Collector) -> tuple[float, ...] | None:
    """A line `frequency, decay[, gain]`; None after reports, each at its cell."""
    cells = line.split(",")
    if not 2 <= len(cells) <= 3 or len(line) > _MAX_LINE:
        message = f"{who}: a line is a frequency, a decay and, if you like, a gain: 200Hz, 4s, -6dB"
        collector.error("E106", message, replace(place, length=max(1, min(len(line), 80))))
        return None
    found, column = [], 1
    for cell, read in zip(cells, (k.PITCH, k.DURATION, k.GAIN), strict=False):
        word = cell.strip()
        begin = column + len(cell) - len(cell.lstrip())
        try:
            found.append(_value(word, read))
        except TextError as error:
            at = replace(place, column=begin + error.offset, length=max(1, error.length))
            message = f"{who}: {error.message}"
            collector.error(error.code, message, at, suggestion=error.suggestion)
        column += len(cell) + 1
    if len(found) < len(cells):
        return None
    return (*found, 1.0)[:3]


def _value(word: str, read: Text) -> float:
    """A cell; a decay without a unit is in seconds, as other programs write it."""
    if read is k.DURATION and word.replace(".", "", 1).isdigit():
        word += "s"
    value = float(read.parse(word))
    if read is k.GAIN and value <= 0.0:
        raise TextError(
            f"{quote(word)}: a mode of gain 0 does not move; remove the line",
            length=len(word),
            code="E202",
        )
    return value
