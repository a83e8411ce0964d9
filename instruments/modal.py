"""BANK and MODES with each mode given: in lists of the score, or in rows of a CSV file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ergon import _core
from ergon.instruments.modal_band import Band, band_record
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, NAME, Context, Text
from ergon.notation.text.document import Document, Node
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place

MAX_MODES = 100_000  # modes of a list or a file
_MAX_LINE = 1_000  # characters
DEFAULT_PLACE_NAME = "point"  # place of MODES that name none


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


def _each_shape(member: Text, scalar: Text | None) -> EachShape:
    return EachShape(scalar, None, ListOf(member, 1, MAX_MODES))


BANK_PITCHES_SHAPE = _each_shape(value_kinds.PITCH, value_kinds.PITCHES)
BANK_DECAYS_SHAPE = _each_shape(value_kinds.DURATION, value_kinds.DURATIONS)
BANK_GAINS_SHAPE = _each_shape(value_kinds.GAIN, None)


def with_listed_modes(bank_values: Values) -> Values | None:
    """The fields of a BANK whose modes are listed, with its count; None if an error was
    reported.
    """
    bank_fields, bank_nodes = dict(bank_values.by_name), dict(bank_values.nodes)
    if any(name not in bank_fields for name in ("f", "t60", "gain") if name in bank_nodes):
        return None  # refused already
    mode_frequencies, t60, mode_gains = (bank_fields.get(name) for name in ("f", "t60", "gain"))
    if not isinstance(mode_frequencies, Each):
        for field_name, field_value in (("t60", t60), ("gain", mode_gains)):
            if isinstance(field_value, Each):
                message = (
                    f"{bank_values.context.label(field_name)}: a list of values needs a list of "
                )
                bank_values.error(
                    "E103", message + "frequencies, such as f: [200Hz, 453Hz]", field_name
                )
                return None
        return bank_values
    if foreign_field := bank_values.written("count", "spread"):
        message = (
            f"{bank_values.context.label(foreign_field[0])}: its modes are listed one by one; "
            "remove it"
        )
        bank_values.error("E111", message, foreign_field[0])
        return None
    if isinstance(t60, tuple) and not isinstance(t60, Each) and t60[0] == t60[1]:
        t60 = Each(t60[:1] * len(mode_frequencies))
    mode_gains = Each((1.0,) * len(mode_frequencies)) if mode_gains is None else mode_gains
    for field_name, field_value in (("t60", t60), ("gain", mode_gains)):
        if field_name == "gain" and any(mode_gain <= 0.0 for mode_gain in mode_gains):
            message = (
                f"{bank_values.context.label(field_name)}: a mode of gain 0 does not move; remove "
                "the mode"
            )
            bank_values.error("E202", message, field_name)
            return None
        if field_value is not None and (
            not isinstance(field_value, Each) or len(field_value) != len(mode_frequencies)
        ):
            message = (
                f"{bank_values.context.label(field_name)}: there are {len(mode_frequencies)} "
                "frequencies; write as many "
            )
            if not isinstance(field_value, Each):
                message += "values, as a list"
            else:
                message += f"values, not {len(field_value)}"
            bank_values.error("E106", message, field_name)
            return None
    bank_fields |= {"count": len(mode_frequencies), "gain": mode_gains}
    if t60 is not None:
        bank_fields["t60"] = t60
    place = bank_nodes.get("modes", bank_nodes["f"])
    bank_nodes |= {"count": place, "gain": bank_nodes.get("gain", place)}
    return replace(bank_values, by_name=bank_fields, nodes=bank_nodes)


# --- files ----------------------------------------------------------------------------------------


def with_modes_of_file(
    values: Values,
    read_document: Callable[[str, Place], Document | None],
    transposed: Callable[[str, Any, Any], Any],
    collector: Collector,
) -> Values:
    """The fields of a BANK or MODES with the modes of the file that it names, moved by an
    `interval` if there is one.
    """
    file_name = values.by_name.get("modes")
    if file_name is None:
        return values
    conflicting_fields = values.written("f", "t60", "gain", "count", "spread", "places")
    if conflicting_fields:
        message = (
            f"{values.context.label(conflicting_fields[0])}: `modes` is written too; keep one "
            "of the two"
        )
        values.error("E111", message, conflicting_fields[0])
        return _without_frequencies(values)
    table = read_document(file_name, values.place_of("modes"))
    columns = None if table is None else _columns(table, values, collector)
    if columns is None:
        return _without_frequencies(values)
    fields = {field: value for field, value in values.by_name.items() if field != "modes"}
    nodes, modes_node = dict(values.nodes), values.nodes["modes"]
    for field, column in columns.items():
        fields[field] = (
            transposed(field, column, fields["interval"]) if "interval" in fields else column
        )
        nodes[field] = modes_node
    fields.pop("interval", None)
    return replace(values, by_name=fields, nodes=nodes)


def _without_frequencies(values: Values) -> Values:
    """The fields after an error: f counts as written, but has no value."""
    fields = {name: value for name, value in values.by_name.items() if name != "f"}
    return replace(values, by_name=fields, nodes={**values.nodes, "f": values.nodes["modes"]})


def _columns(table: Document, bank_values: Values, collector: Collector) -> dict[str, Any] | None:
    """Fields from the columns of a table: f [Hz], t60 [s], and gain or places; None if errors were
    reported.
    """
    label, modes_place = bank_values.context.label("modes"), bank_values.place_of("modes")
    is_bank = "gain" in bank_values.record.by_name
    row_format = _BANK_ROW if is_bank else _places_row([DEFAULT_PLACE_NAME])
    rows: list[tuple[float, ...]] = []
    are_all_valid = True
    for line_number, line in enumerate(table.text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        line_place = Place(table.file, line_number, 1)
        if not rows and are_all_valid and _is_heading(line):
            place_names = [cell.strip() for cell in line.split(",")][2:]
            if is_bank or not place_names:
                continue
            if (wrong_name := _wrong_name(place_names)) is not None:
                collector.error("E110", f"{label}: {wrong_name}", line_place)
                return None
            row_format = _places_row(place_names)
            continue
        row = _read_row(line, line_place, label, row_format, collector)
        are_all_valid &= row is not None
        if row is not None:
            rows.append(row)
        if len(rows) > MAX_MODES:
            message = f"{label}: the file has more than {MAX_MODES:,} modes"
            collector.error("E105", message, modes_place)
            return None
    if not rows and are_all_valid:
        message = f"{label}: the file has no modes; write lines such as {row_format.example}"
        collector.error("E106", message, modes_place)
    if not rows or not are_all_valid:
        return None
    f, t60, *others = (Each(column) for column in zip(*rows, strict=True))
    if is_bank:
        return {"f": f, "t60": t60, "gain": others[0]}
    return {"f": f, "t60": t60, "places": dict(zip(row_format.places, others, strict=True))}


@dataclass(frozen=True)
class _LineFormat:
    """The format of a line of a file: how its cells are read; the last cell of a BANK is
    optional.
    """

    cell_shapes: tuple[Text, ...]
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

    def accepts_cells(self, count: int) -> bool:
        """Whether a line may have this number of cells."""
        return count == len(self.cell_shapes) or (
            not self.places and count == len(self.cell_shapes) - 1
        )


_BANK_ROW = _LineFormat((value_kinds.PITCH, value_kinds.DURATION, value_kinds.GAIN))


def _places_row(names: Sequence[str]) -> _LineFormat:
    return _LineFormat(
        (value_kinds.PITCH, value_kinds.DURATION, *(LEVEL_SHAPE for _ in names)), names
    )


def _is_heading(line: str) -> bool:
    return [cell.strip().lower() for cell in line.split(",")][:2] == ["f", "t60"]


def _read_row(
    line: str,
    line_place: Place,
    label: str,
    row_format: _LineFormat,
    collector: Collector,
) -> tuple[float, ...] | None:
    """The values of a line; None if errors were reported, each at its cell."""
    cells = line.split(",")
    if not row_format.accepts_cells(len(cells)) or len(line) > _MAX_LINE:
        message = f"{label}: a line is {row_format.words}"
        collector.error("E106", message, replace(line_place, length=max(1, min(len(line), 80))))
        return None
    values, column = [], 1
    for cell_text, shape in zip(cells, row_format.cell_shapes, strict=False):
        cell_word = cell_text.strip()
        cell_begin = column + len(cell_text) - len(cell_text.lstrip())
        try:
            values.append(_cell_value(cell_word, shape))
        except TextError as error:
            error_place = replace(
                line_place, column=cell_begin + error.offset, length=max(1, error.length)
            )
            message = f"{label}: {error.message}"
            collector.error(error.code, message, error_place, suggestion=error.suggestion)
        column += len(cell_text) + 1
    if len(values) < len(cells):
        return None
    return (*values, 1.0)[: len(row_format.cell_shapes)]


def _cell_value(cell_text: str, cell_reader: Text) -> float:
    """The value of a cell; a decay without a unit is in seconds, as other programs write it."""
    if cell_reader is value_kinds.DURATION and cell_text.replace(".", "", 1).isdigit():
        cell_text += "s"
    cell_value = float(cell_reader.parse(cell_text))
    if cell_reader is value_kinds.GAIN and cell_value <= 0.0:
        raise TextError(
            f"{quote(cell_text)}: a mode of gain 0 does not move; remove the line",
            length=len(cell_text),
            code="E202",
        )
    return cell_value


# --- MODES ----------------------------------------------------------------------------------------


def _parse_level(text: str) -> float:
    level_word = text.strip()
    if level_word.startswith("x") or level_word.endswith("dB"):
        return float(value_kinds.GAIN.parse(level_word))
    return float(value_kinds.NUMBER.parse(level_word))


LEVEL_SHAPE = Text(
    _parse_level,
    "a level, such as 0.5, -0.3 or -6dB",
    r"^([+-]?[0-9.]+(e[+-]?[0-9]+)?( *dB)?|x[0-9.]+)$",
    is_value=True,
)
MODES_PITCHES_SHAPE = ListOf(value_kinds.PITCH, 1, _core.MAX_MODAL, single=True)
MODES_DECAYS_SHAPE = ListOf(value_kinds.DURATION, 1, _core.MAX_MODAL, single=True)
PLACES_SHAPE = NamesOf(ListOf(LEVEL_SHAPE, 1, _core.MAX_MODAL, single=True), "place")
BAND_RECORD = band_record(LEVEL_SHAPE)


def _wrong_name(place_names: Sequence[str]) -> str | None:
    """The reason why these names cannot be names of places; None if they can."""
    for place_name in place_names:
        if not NAME.fullmatch(place_name) or place_name in ("all", "last", "centre"):
            message = (
                f"{quote(place_name)} is not a name for a place: a name has letters, digits, '-' "
            )
            return message + "and '_', begins with a letter, and is not all, last or centre"
        if place_names.count(place_name) > 1:
            return f"two places are called {quote(place_name)}; rename one of them"
    if len(place_names) > _core.MAX_PLACES:
        return f"there are {len(place_names)} places; the most is {_core.MAX_PLACES}"
    return None


def with_levels_at_places(values: Values) -> Values | None:
    """The fields of MODES, with a decay for each mode and the level of each mode at each place.

    None if an error was reported.
    """
    fields, nodes = dict(values.by_name), dict(values.nodes)
    if any(name not in fields for name in ("f", "t60", "places", "band") if name in nodes):
        return None  # refused already
    frequencies, t60, levels_by_place = (
        fields.get("f"),
        fields.get("t60"),
        fields.get("places"),
    )
    if frequencies is None:
        return values
    if t60 is not None and len(t60) == 1:
        fields["t60"] = t60 = Each(t60 * len(frequencies))
    if levels_by_place is None:
        fields["places"] = levels_by_place = {DEFAULT_PLACE_NAME: (1.0,) * len(frequencies)}
        nodes["places"] = nodes["f"]
    place_names = list(levels_by_place)
    if (wrong_name := _wrong_name(place_names)) is not None or not place_names:
        wrong_name = wrong_name or "name a place at least, such as rim: [1, 0.5]"
        values.error("E110", f"{values.context.label('places')}: {wrong_name}", "places")
        return None
    values_by_list = {
        "t60": t60,
        **{f"place {quote(name)}": levels for name, levels in levels_by_place.items()},
    }
    for list_name, mode_levels in values_by_list.items():
        field_name = list_name if list_name == "t60" else "places"
        if mode_levels is MISSING:
            return None
        if mode_levels is not None and len(mode_levels) != len(frequencies):
            message = (
                f"{values.context.label(list_name)}: there are {len(frequencies)} "
                "frequencies; write as many "
            )
            values.error("E106", message + f"values, not {len(mode_levels)}", field_name)
            return None
        if field_name == "places" and not any(mode_levels):
            message = (
                f"{values.context.label(list_name)}: all levels are 0, so that nothing moves "
                "there; "
            )
            values.error("E202", message + "remove the place", field_name)
            return None
    if isinstance(band := fields.pop("band", None), Band):
        if (mistake := _wrong_band(band, place_names, len(frequencies))) is not None:
            values.error("E110", f"{values.context.label('band')}: {mistake}", "band")
            return None
        band_frequencies, band_t60, mode_levels = band.draw_modes(place_names)
        fields["f"] = Each((*frequencies, *band_frequencies))
        if t60 is not None:
            fields["t60"] = Each((*t60, *band_t60))
        levels_by_place = {
            name: (*levels_by_place[name], *mode_levels[name]) for name in place_names
        }
    fields["places"] = tuple(levels_by_place.items())
    return replace(values, by_name=fields, nodes=nodes)


def _wrong_band(band: Band, place_names: Sequence[str], n_listed: int) -> str | None:
    """Why a band cannot be added to modes that are listed; None if it can."""
    if unknown_places := sorted(set(band.levels) - set(place_names)):
        return (
            f"there is no place {quote(unknown_places[0])}; its places are {', '.join(place_names)}"
        )
    if n_listed + band.count > _core.MAX_MODAL:
        return f"there are {n_listed + band.count} modes with it; the most is {_core.MAX_MODAL}"
    return None


def retuned_modes(
    values: Values, member_values: Values, tune: Callable[[tuple[float, ...], float], Any]
) -> Values:
    """MODES with its lowest pitch, its decay and its mass set to those of the instrument's own
    fields.

    `tune` moves the other modes by the same interval; their decays keep their ratios.
    """
    fields, nodes = dict(values.by_name), dict(values.nodes)
    frequencies = fields.get("f")
    for field_name in member_values.written("f", "t60", "M"):
        member_value = member_values.by_name.get(field_name)
        if member_value is None or not frequencies:
            continue
        if field_name != "M" and member_value[0] != member_value[1]:
            member_values.error(
                "E202",
                f"{member_values.context.label(field_name)}: only a BANK has a range",
                field_name,
            )
            continue
        if field_name == "f":
            fields["f"] = Each(tune(frequencies, member_value[0]))
            if isinstance(band := fields.get("band"), Band):
                band_ends = tune((min(frequencies), *band.f), member_value[0])[1:]
                fields["band"] = replace(band, f=tuple(band_ends))
        elif field_name == "M":
            fields["M"] = member_value
        elif t60 := fields.get("t60"):
            lowest_t60 = (
                t60[min(range(len(frequencies)), key=frequencies.__getitem__)]
                if len(t60) == len(frequencies)
                else t60[0]
            )
            fields["t60"] = Each(member_value[0] * (mode_t60 / lowest_t60) for mode_t60 in t60)
            if isinstance(band := fields.get("band"), Band):
                low, high = (member_value[0] * (mode_t60 / lowest_t60) for mode_t60 in band.t60)
                fields["band"] = replace(band, t60=(low, high))
        else:
            fields["t60"] = Each(member_value[:1])
        nodes[field_name] = member_values.nodes[field_name]
    return replace(values, by_name=fields, nodes=nodes)
