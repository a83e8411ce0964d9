"""The tables of files of measurements: a calibrated key, a layout of loudspeakers."""

from __future__ import annotations

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import Text, choice
from ergon.notation.text.errors import TextError, quote
from ergon.scores.reading.mix_tables import CHANNEL_SHAPE, MAX_CHANNELS


def parse_version(version_text: str) -> str:
    """The format version, 1."""
    if version_text != "1":
        message = (
            f"this ergon reads version 1 of the format, not {quote(version_text)}; write 1, or "
            "install "
        )
        message += "a newer ergon if the file was written for one"
        raise TextError(message, length=max(1, len(version_text)), code="E109")
    return version_text


_MODE_RECORD = Record(
    "mode",
    "a part of a key that swings on it",
    (
        Field("M", value_kinds.MASS, "mass, which is part of that of the key", required=True),
        Field("f", value_kinds.HERTZ, "frequency on a key that stands still", required=True),
        Field("t60", value_kinds.DURATION, "decay by 60 dB", required=True),
    ),
)
CALIBRATION_RECORD = Record(
    "calibration",
    "a key as measured",
    (
        Field("ergon", Text(parse_version, "1", "^1$"), "version of the format"),
        Field("M", value_kinds.MASS, "mass", required=True),
        Field("K", value_kinds.STIFFNESS, "stiffness", required=True),
        Field("Z", value_kinds.DAMPING, "viscosity", required=True),
        Field("travel", value_kinds.TRAVEL, "range of positions of the key"),
        Field("rest", value_kinds.POSITION, "where spring and weight balance"),
        Field("weight", value_kinds.PUSH, "constant force downwards, of a key without a spring"),
        Field("dry", value_kinds.FORCE, "dry friction"),
        Field(
            "presliding", value_kinds.STIFFNESS, "stiffness of dry friction before the key slides"
        ),
        Field("static", value_kinds.FORCE, "dry friction near rest"),
        Field(
            "static_speed", value_kinds.SPEED, "speed at which it has fallen towards `dry` by 1/e"
        ),
        Field("delay", value_kinds.PAUSE, "delay of the motor's force"),
        Field("modes", ListOf(_MODE_RECORD), "parts that swing on the key"),
        Field("noise", value_kinds.POSITION, "rms of the sensor's noise"),
        Field("correlations", ListOf(value_kinds.TITLE), "of each figure with those before it"),
        Field("takes", ListOf(value_kinds.TITLE), "SHA-256 of the takes that it was measured by"),
        *(
            Field(name, value_kinds.TITLE, "for the reader")
            for name in ("title", "date", "device", "residual")
        ),
    ),
)
SPEAKER_RECORD = Record(
    "loudspeaker",
    "where a loudspeaker is, as seen from the middle",
    (
        Field("az", value_kinds.AZIMUTH, "from the front to the left", required=True),
        Field("el", value_kinds.ELEVATION, "from the horizon up", 0.0, shown="0deg"),
        Field("r", value_kinds.DISTANCE, "how far away", 1.0, shown="1m"),
    ),
)
LAYOUT_RECORD = Record(
    "layout",
    "where loudspeakers are",
    (
        Field("ergon", Text(parse_version, "1", "^1$"), "version of the format"),
        Field("title", value_kinds.TITLE, "for the reader"),
        Field(
            "project",
            choice("plan", "equidistant"),
            "what the bench shows: the room from above, or angles from the zenith",
            "plan",
        ),
        Field(
            "speakers",
            ListOf(
                Either(mapping=SPEAKER_RECORD, sequence=ListOf(value_kinds.POSITION, 2, 3)),
                1,
                MAX_CHANNELS,
            ),
            "[x, y] or [x, y, z] of each, in metres, or {az, el, r}",
            required=True,
        ),
        Field(
            "outputs",
            ListOf(CHANNEL_SHAPE, 1, MAX_CHANNELS),
            "the output of each; without them the loudspeakers are at the outputs 1, 2, 3 …",
        ),
    ),
)


def distinct_fields(table: Record) -> tuple[str, ...]:
    """Fields that only such a file has: a score with one of them is a file of that kind."""
    return tuple(f.name for f in table.fields if f.name not in ("ergon", "title"))
