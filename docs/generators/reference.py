"""The reference of all fields, generated from the tables that the checker uses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ergon.common.module_arguments import module_arguments
from ergon.instruments.materials import MATERIAL_RECORD, MATERIALS
from ergon.instruments.module_kinds import KINDS, LINK_KINDS, POINT_KINDS, tables
from ergon.instruments.read import INSTRUMENT_SHAPE, PLACING_RECORD
from ergon.instruments.space.fields import SURFACE_FILE
from ergon.instruments.spread import PROFILE
from ergon.notation.tables.fields import Field, Record
from ergon.scores.reading import sections as s
from ergon.scores.reading.automation import AUTOMATION_RECORD
from ergon.scores.reading.gesture_tables import GESTURE_RECORD, TAKE_RECORD
from ergon.scores.reading.key_tables import COUPLING_RECORD, KEY_RECORD, PLAYER_RECORD
from ergon.scores.reading.measured_tables import CALIBRATION_RECORD, LAYOUT_RECORD, SPEAKER_RECORD
from ergon.scores.reading.melody import ENTRY_RECORD, PHRASE_ENTRY_RECORD
from ergon.scores.reading.mix_tables import MASTER_RECORD, MIX_RECORD, RENDER_RECORD, ROUTE_RECORD
from ergon.scores.reading.part import PLAY_RECORD
from ergon.scores.reading.strike_tables import PHRASE_RECORD, STRIKES_RECORD

_SECTIONS: tuple[tuple[str, Record], ...] = (
    ("tuning", s.TUNING),
    ("rates", s.RATES_RECORD),
    ("tempo", s.TEMPO_RECORD),
    ("meter", s.METERS_RECORD),
    ("keys", KEY_RECORD),
    ("instruments", INSTRUMENT_SHAPE.forms["si"]),
    ("instruments: place", PLACING_RECORD),
    ("laws", s.LAW_RECORD),
    ("gestures", GESTURE_RECORD),
    ("takes", TAKE_RECORD),
    ("phrases", PHRASE_RECORD),
    ("strikes", STRIKES_RECORD),
    ("strikes: entries", ENTRY_RECORD),
    ("phrases: entries", PHRASE_ENTRY_RECORD),
    ("players", PLAYER_RECORD),
    ("duet", COUPLING_RECORD),
    ("parts", PLAY_RECORD),
    ("automation", AUTOMATION_RECORD),
    ("mix", MIX_RECORD),
    ("mix: route", ROUTE_RECORD),
    ("mix: master", MASTER_RECORD),
    ("render", RENDER_RECORD),
    ("accuracy", s.ACCURACY_RECORD),
    ("files of `calib:`", CALIBRATION_RECORD),
    ("files of `layout:`", LAYOUT_RECORD),
    ("files of `layout:`: speakers by angles", SPEAKER_RECORD),
)


_MATTER = (*POINT_KINDS, *LINK_KINDS)


def _default(field: Field) -> str:
    if field.required:
        return "required"
    if field.shown is not None:
        return field.shown
    if field.default in (None, ""):
        return ""
    value: Any = field.default
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


def _rows(record: Record) -> Iterator[str]:
    yield "| field | what is written | default | meaning |"
    yield "|---|---|---|---|"
    for field in record.fields:
        cells = (f"`{field.name}`", field.shape.words(), _default(field), field.doc)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    if record.free is not None:
        yield f"| any other name | {record.free.words()} | | |"


def _section(title: str, record: Record, level: str = "##") -> Iterator[str]:
    yield f"{level} {title}"
    yield ""
    yield f"{record.doc[0].upper()}{record.doc[1:]}."
    yield ""
    if record.fields:
        yield from _rows(record)
        yield ""
    if record.kinds:
        yield f"And one of: {', '.join(f'`{kind}`' for kind in record.kinds)}."
        yield ""


def _materials() -> Iterator[str]:
    yield "## Materials"
    yield ""
    yield "What `material` names; of woods E is along the grain, then across it."
    yield ""
    yield "| material | density [kg/m³] | E [GPa] | Poisson's ratio | loss factor | source |"
    yield "|---|---|---|---|---|---|"
    for name, material in MATERIALS.items():
        young = f"{material.young / 1e9:g}"
        if material.across is not None:
            young += f", {material.across / 1e9:g}"
        cells = (
            f"`{name}`",
            f"{material.density:g}",
            young,
            f"{material.poisson:g}",
            f"{material.loss:g}",
        )
        yield "| " + " | ".join((*cells, material.source)) + " |"
    yield ""


def text() -> str:
    """The whole reference in Markdown."""
    lines = [
        "# The fields of a score",
        "",
        "Made from the checker's tables by `make docs`.",
        "",
    ]
    lines += _section("A score", s.SCORE_RECORD)
    for title, record in _SECTIONS:
        lines += _section(title, record)
    lines += ["## Modules", ""]
    for kind in KINDS.values():
        if "si" in kind.tables:
            lines += _section(f"`{kind.name}`", kind.table, "###")
    lines += _section("`gap`", PROFILE, "###")
    lines += _section("`material`", MATERIAL_RECORD, "###")
    lines += ["## Modules of an instrument in space", ""]
    for name, table in tables("space", _MATTER).items():
        lines += _section(f"`{name}` in space", table, "###")
    lines += _section("`mesh`", SURFACE_FILE, "###")
    lines += _materials()
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    path = Path(module_arguments("PAGE")[0])
    path.write_text(text(), encoding="utf-8")
