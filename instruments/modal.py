"""BANK and MODES with each mode given: in lists of the score, or in rows of a CSV file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ergon import _core
from ergon.instruments.modal_band import Band, band
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, NAME, Context, Text
from ergon.notation.text.document import Document, Node
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place

MAX_MODES = 100_000  # of a list or a file
_MAX_LINE = 1_000  # characters
DEFAULT_PLACE = "point"  # of MODES without named places


class Each(tuple[float, ...]):
    """A value for each member of a BANK or MODES; a plain tuple of two values is a range."""

    __slots__ = ()


@dataclass(frozen=True)
class EachShape(Either):
    """One value or range, or a list with a value for each member."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        value = Either.read(self, node, name, context)
        is_list = value is not MISSING and self._shape_for(node) is self.sequence
        return Each(value) if is_list else value


def _each(one: Text, scalar: Text | None) -> EachShape:
    return EachShape(scalar, None, ListOf(one, 1, MAX_MODES))


BANK_PITCHES = _each(k.PITCH, k.PITCHES)
BANK_DECAYS = _each(k.DURATION, k.DURATIONS)
BANK_GAINS = _each(k.GAIN, None)


def listed(values: Values) -> Values | None:
    """The fields of a BANK whose modes are listed, with its count; None if an error was
    reported.
    """
    fields, nodes = dict(values.by_name), dict(values.nodes)
    if any(name not in fields for name in ("f", "t60", "gain") if name in nodes):
        return None  # refused already
    f, t60, gain = (fields.get(name) for name in ("f", "t60", "gain"))
    if not isinstance(f, Each):
        for name, value in (("t60", t60), ("gain", gain)):
            if isinstance(value, Each):
                message = f"{values.context.label(name)}: a list of values needs a list of "
                values.error("E103", message + "frequencies, such as f: [200Hz, 453Hz]", name)
                return None
        return values
    if wrong := values.written("count", "spread"):
        message = f"{values.context.label(wrong[0])}: its modes are listed one by one; remove it"
        values.error("E111", message, wrong[0])
        return None
    if isinstance(t60, tuple) and not isinstance(t60, Each) and t60[0] == t60[1]:
        t60 = Each(t60[:1] * len(f))
    gain = Each((1.0,) * len(f)) if gain is None else gain
    for name, value in (("t60", t60), ("gain", gain)):
        if name == "gain" and any(one <= 0.0 for one in gain):
            message = (
                f"{values.context.label(name)}: a mode of gain 0 does not move; remove the mode"
            )
            values.error("E202", message, name)
            return None
        if value is not None and (not isinstance(value, Each) or len(value) != len(f)):
            message = (
                f"{values.context.label(name)}: there are {len(f)} frequencies; write as many "
            )
            if not isinstance(value, Each):
                message += "values, as a list"
            else:
                message += f"values, not {len(value)}"
            values.error("E106", message, name)
            return None
    fields |= {"count": len(f), "gain": gain}
    if t60 is not None:
        fields["t60"] = t60
    place = nodes.get("modes", nodes["f"])
    nodes |= {"count": place, "gain": nodes.get("gain", place)}
    return replace(values, by_name=fields, nodes=nodes)


# --- files ----------------------------------------------------------------------------------------


def from_file(
    values: Values,
    read: Callable[[str, Place], Document | None],
    moved: Callable[[str, Any, Any], Any],
    collector: Collector,
) -> Values:
    """The fields of a BANK or MODES with the modes of the file that it names, moved by an
    `interval` if there is one.
    """
    name = values.by_name.get("modes")
    if name is None:
        return values
    conflicting = values.written("f", "t60", "gain", "count", "spread", "places")
    if conflicting:
        message = (
            f"{values.context.label(conflicting[0])}: `modes` is written too; keep one of the two"
        )
        values.error("E111", message, conflicting[0])
        return _without(values)
    table = read(name, values.place_of("modes"))
    columns = None if table is None else _columns(table, values, collector)
    if columns is None:
        return _without(values)
    fields = {field: value for field, value in values.by_name.items() if field != "modes"}
    nodes, node = dict(values.nodes), values.nodes["modes"]
    for field, column in columns.items():
        fields[field] = moved(field, column, fields["interval"]) if "interval" in fields else column
        nodes[field] = node
    fields.pop("interval", None)
    return replace(values, by_name=fields, nodes=nodes)


def _without(values: Values) -> Values:
    """The fields after an error: f counts as written, but has no value."""
    fields = {name: value for name, value in values.by_name.items() if name != "f"}
    return replace(values, by_name=fields, nodes={**values.nodes, "f": values.nodes["modes"]})


def _columns(table: Document, values: Values, collector: Collector) -> dict[str, Any] | None:
    """Fields from the columns of a table: f [Hz], t60 [s], and gain or places; None if errors were
    reported.
    """
    who, asked = values.context.label("modes"), values.place_of("modes")
    is_bank = "gain" in values.record.by_name
    format = _BANK_ROW if is_bank else _places_row([DEFAULT_PLACE])
    rows: list[tuple[float, ...]] = []
    is_whole = True
    for number, line in enumerate(table.text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        place = Place(table.file, number, 1)
        if not rows and is_whole and _is_heading(line):
            names = [cell.strip() for cell in line.split(",")][2:]
            if is_bank or not names:
                continue
            if (wrong := _wrong_name(names)) is not None:
                collector.error("E110", f"{who}: {wrong}", place)
                return None
            format = _places_row(names)
            continue
        row = _row(line, place, who, format, collector)
        is_whole &= row is not None
        if row is not None:
            rows.append(row)
        if len(rows) > MAX_MODES:
            message = f"{who}: the file has more than {MAX_MODES:,} modes"
            collector.error("E105", message, asked)
            return None
    if not rows and is_whole:
        message = f"{who}: the file has no modes; write lines such as {format.example}"
        collector.error("E106", message, asked)
    if not rows or not is_whole:
        return None
    f, t60, *others = (Each(column) for column in zip(*rows, strict=True))
    if is_bank:
        return {"f": f, "t60": t60, "gain": others[0]}
    return {"f": f, "t60": t60, "places": dict(zip(format.places, others, strict=True))}


@dataclass(frozen=True)
class _Row:
    """The format of a line of a file: how its cells are read; the last cell of a BANK is
    optional.
    """

    reads: tuple[Text, ...]
    places: Sequence[str] = ()

    @property
    def example(self) -> str:
        """An example of a line."""
        return "200Hz, 4s" + (", 0.5" * len(self.places) or ", -6dB")

    @property
    def words(self) -> str:
        """The format in words."""
        if not self.places:
            return f"a frequency, a decay and, if you like, a gain: {self.example}"
        return f"a frequency, a decay and a level at {', '.join(self.places)}: {self.example}"

    def fits(self, count: int) -> bool:
        """Whether a line may have this number of cells."""
        return count == len(self.reads) or (not self.places and count == len(self.reads) - 1)


_BANK_ROW = _Row((k.PITCH, k.DURATION, k.GAIN))


def _places_row(names: Sequence[str]) -> _Row:
    return _Row((k.PITCH, k.DURATION, *(LEVEL for _ in names)), names)


def _is_heading(line: str) -> bool:
    return [cell.strip().lower() for cell in line.split(",")][:2] == ["f", "t60"]


def _row(
    line: str, place: Place, who: str, format: _Row, collector: Collector
) -> tuple[float, ...] | None:
    """The values of a line; None if errors were reported, each at its cell."""
    cells = line.split(",")
    if not format.fits(len(cells)) or len(line) > _MAX_LINE:
        message = f"{who}: a line is {format.words}"
        collector.error("E106", message, replace(place, length=max(1, min(len(line), 80))))
        return None
    row_values, column = [], 1
    for cell, read in zip(cells, format.reads, strict=False):
        word = cell.strip()
        begin = column + len(cell) - len(cell.lstrip())
        try:
            row_values.append(_value(word, read))
        except TextError as error:
            error_place = replace(place, column=begin + error.offset, length=max(1, error.length))
            message = f"{who}: {error.message}"
            collector.error(error.code, message, error_place, suggestion=error.suggestion)
        column += len(cell) + 1
    if len(row_values) < len(cells):
        return None
    return (*row_values, 1.0)[: len(format.reads)]


def _value(word: str, read: Text) -> float:
    """The value of a cell; a decay without a unit is in seconds, as other programs write it."""
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


# --- MODES ----------------------------------------------------------------------------------------


def _level(text: str) -> float:
    word = text.strip()
    if word.startswith("x") or word.endswith("dB"):
        return float(k.GAIN.parse(word))
    return float(k.NUMBER.parse(word))


LEVEL = Text(
    _level,
    "a level, such as 0.5, -0.3 or -6dB",
    r"^([+-]?[0-9.]+(e[+-]?[0-9]+)?( *dB)?|x[0-9.]+)$",
    is_value=True,
)
MODES_PITCHES = ListOf(k.PITCH, 1, _core.MAX_MODAL, single=True)
MODES_DECAYS = ListOf(k.DURATION, 1, _core.MAX_MODAL, single=True)
PLACES = NamesOf(ListOf(LEVEL, 1, _core.MAX_MODAL, single=True), "place")
BAND = band(LEVEL)


def _wrong_name(names: Sequence[str]) -> str | None:
    """Why names cannot be those of places; None if they can."""
    for name in names:
        if not NAME.fullmatch(name) or name in ("all", "last", "centre"):
            message = f"{quote(name)} is not a name for a place: a name has letters, digits, '-' "
            return message + "and '_', begins with a letter, and is not all, last or centre"
        if names.count(name) > 1:
            return f"two places are called {quote(name)}; rename one of them"
    if len(names) > _core.MAX_PLACES:
        return f"there are {len(names)} places; the most is {_core.MAX_PLACES}"
    return None


def placed(values: Values) -> Values | None:
    """The fields of MODES, with a decay for each mode and the level of each mode at each place.

    None if an error was reported.
    """
    fields, nodes = dict(values.by_name), dict(values.nodes)
    if any(name not in fields for name in ("f", "t60", "places", "band") if name in nodes):
        return None  # refused already
    f, t60, places = fields.get("f"), fields.get("t60"), fields.get("places")
    if f is None:
        return values
    if t60 is not None and len(t60) == 1:
        fields["t60"] = t60 = Each(t60 * len(f))
    if places is None:
        fields["places"] = places = {DEFAULT_PLACE: (1.0,) * len(f)}
        nodes["places"] = nodes["f"]
    names = list(places)
    if (wrong := _wrong_name(names)) is not None or not names:
        wrong = wrong or "name a place at least, such as rim: [1, 0.5]"
        values.error("E110", f"{values.context.label('places')}: {wrong}", "places")
        return None
    lists = {"t60": t60, **{f"place {quote(name)}": levels for name, levels in places.items()}}
    for name, levels in lists.items():
        field = name if name == "t60" else "places"
        if levels is MISSING:
            return None
        if levels is not None and len(levels) != len(f):
            message = (
                f"{values.context.label(name)}: there are {len(f)} frequencies; write as many "
            )
            values.error("E106", message + f"values, not {len(levels)}", field)
            return None
        if field == "places" and not any(levels):
            message = (
                f"{values.context.label(name)}: all levels are 0, so that nothing moves there; "
            )
            values.error("E202", message + "remove the place", field)
            return None
    if isinstance(drawn := fields.pop("band", None), Band):
        if (mistake := _wrong_band(drawn, names, len(f))) is not None:
            values.error("E110", f"{values.context.label('band')}: {mistake}", "band")
            return None
        pitches, decays, levels = drawn.drawn(names)
        fields["f"] = Each((*f, *pitches))
        if t60 is not None:
            fields["t60"] = Each((*t60, *decays))
        places = {name: (*places[name], *levels[name]) for name in names}
    fields["places"] = tuple(places.items())
    return replace(values, by_name=fields, nodes=nodes)


def _wrong_band(drawn: Band, names: Sequence[str], listed_modes: int) -> str | None:
    """Why a band cannot be added to modes that are listed; None if it can."""
    if strange := sorted(set(drawn.levels) - set(names)):
        return f"there is no place {quote(strange[0])}; its places are {', '.join(names)}"
    if listed_modes + drawn.count > _core.MAX_MODAL:
        return (
            f"there are {listed_modes + drawn.count} modes with it; the most is {_core.MAX_MODAL}"
        )
    return None


def retuned_modes(
    body: Values, member: Values, tune: Callable[[tuple[float, ...], float], Any]
) -> Values:
    """MODES with its lowest pitch, its decay and its mass set to those of the instrument's own
    fields.

    `tune` moves the other modes by the same interval; their decays keep their ratios.
    """
    fields, nodes = dict(body.by_name), dict(body.nodes)
    f = fields.get("f")
    for name in member.written("f", "t60", "M"):
        value = member.by_name.get(name)
        if value is None or not f:
            continue
        if name != "M" and value[0] != value[1]:
            member.error("E202", f"{member.context.label(name)}: only a BANK has a range", name)
            continue
        if name == "f":
            fields["f"] = Each(tune(f, value[0]))
            if isinstance(drawn := fields.get("band"), Band):
                ends = tune((min(f), *drawn.f), value[0])[1:]
                fields["band"] = replace(drawn, f=tuple(ends))
        elif name == "M":
            fields["M"] = value
        elif t60 := fields.get("t60"):
            lowest = t60[min(range(len(f)), key=f.__getitem__)] if len(t60) == len(f) else t60[0]
            fields["t60"] = Each(value[0] * (one / lowest) for one in t60)
            if isinstance(drawn := fields.get("band"), Band):
                low, high = (value[0] * (one / lowest) for one in drawn.t60)
                fields["band"] = replace(drawn, t60=(low, high))
        else:
            fields["t60"] = Each(value[:1])
        nodes[name] = member.nodes[name]
    return replace(body, by_name=fields, nodes=nodes)
