"""The tables of loudspeakers, the ways to them, and the file that is written."""

from __future__ import annotations

from typing import Any

from ergon.instruments.playing import LOUDNESS_SHAPE
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import Reference, Text, choice
from ergon.notation.text.errors import TextError, quote
from ergon.scores.reading import mixing, tones
from ergon.scores.reading.foreign_words import ADVICE_BY_WORD, FIELD_SYNONYMS

MAX_CHANNELS = 64  # of sound files, of the ring of a sound card and of the loudness of a mix


def _parse_channels(channels_text: str) -> Any:
    if channels_text.strip()[:1].isalpha() and channels_text != "nearest":
        message = (
            f"{quote(channels_text)} is not a channel: channels are numbers from 1 (1 and 2 are "
            "left "
        )
        message += "and right of two), or `nearest`"
        suggestion = {"left": "1", "right": "2", "both": "[1, 2]", "stereo": "[1, 2]"}.get(
            channels_text.strip()
        )
        raise TextError(message, length=len(channels_text), suggestion=suggestion, code="E201")
    return "nearest" if channels_text == "nearest" else (CHANNEL_SHAPE.parse(channels_text),)


CHANNEL_SHAPE = value_kinds.integer(1, MAX_CHANNELS, "1")
_TARGET_SHAPE = Either(
    scalar=Text(_parse_channels, "a channel from 1, or nearest", "^([0-9]+|nearest)$"),
    sequence=ListOf(CHANNEL_SHAPE, 1, MAX_CHANNELS),
)
ROOM_RECORD = mixing.room_table(ListOf(CHANNEL_SHAPE, 1, MAX_CHANNELS, single=True))
ROUTE_RECORD = Record(
    "route",
    "from an instrument to loudspeakers",
    (
        Field(
            "from",
            Reference("an instrument or one of its outputs", ("instruments",)),
            "what",
            None,
            True,
        ),
        Field(
            "to",
            _TARGET_SHAPE,
            "channels, or the loudspeaker nearest to each module",
            required=True,
        ),
        Field("gain", value_kinds.GAIN, "level", 1.0, shown="0dB"),
        Field("level", LOUDNESS_SHAPE, "loudness of a stroke at mf, from which `gain` counts"),
        Field(
            "highpass", value_kinds.HERTZ, "second-order high-pass", shown="8Hz in 16 and 24 bits"
        ),
        Field("lowpass", value_kinds.HERTZ, "second-order low-pass"),
        Field("lowshelf", tones.SHELF_RECORD, "a gain of all below a frequency"),
        Field("highshelf", tones.SHELF_RECORD, "a gain of all above a frequency"),
        Field("delay", tones.DELAY_SHAPE, "how much later it is heard, or with echoes"),
        Field(
            "pan", mixing.PAN_SHAPE, "place between two channels, by constant power; or its points"
        ),
        Field("send", mixing.SENDS_SHAPE, "rooms by name, each with a level"),
        Field("fade", mixing.FADE_SHAPE, "levels at positions of the piece"),
        Field("radiate", mixing.RADIATION_SHAPE, "as a disc in a wall, heard at a distance"),
    ),
    synonyms=FIELD_SYNONYMS["route"],
    advice_by_name=ADVICE_BY_WORD["route"],
)
MASTER_RECORD = Record(
    "master",
    "all channels together",
    (
        Field("gain", value_kinds.GAIN, "level", 1.0, shown="0dB"),
        Field(
            "reference",
            value_kinds.REFERENCE,
            "level of 0.1 mm, 1 m/s, 10,000 m/s², 10 mN and 1 Pa, or SI: that of one unit is 0 dB",
            shown="-20dB",
        ),
        Field("loudness", LOUDNESS_SHAPE, "loudness of the whole piece, peaks up to -1 dBTP"),
        Field("normalise", value_kinds.GAIN, "level of the highest peak of the whole piece"),
        Field("limit", value_kinds.GAIN, "ceiling of the limiter"),
        Field("fade", mixing.FADE_SHAPE, "levels at positions of the piece"),
    ),
)
MIX_RECORD = Record(
    "mix",
    "loudspeakers and the ways to them",
    (
        Field("channels", CHANNEL_SHAPE, "how many", shown="as many as the routes need"),
        Field("layout", value_kinds.PATH, "a file that says where loudspeakers are"),
        Field("route", ListOf(ROUTE_RECORD, single=True), "from instruments to channels"),
        Field("rooms", NamesOf(ROOM_RECORD, "room"), "rooms that routes send to"),
        Field("master", MASTER_RECORD, "all channels together"),
    ),
)
RENDER_RECORD = Record(
    "render",
    "the file that is written",
    (
        Field("file", value_kinds.PATH, "its name, relative to the score, in its folder"),
        Field("bits", choice("16", "24", "float"), "sample format", "24"),
        Field("tail", value_kinds.TAIL, "time after the last event; auto: until -80 dB", "auto"),
        Field("channels", CHANNEL_SHAPE, "as in the mix"),
    ),
    synonyms=FIELD_SYNONYMS["render"],
    advice_by_name=ADVICE_BY_WORD["render"],
    value_pattern_by_field={"file": r"(.+\.(?:wav|flac|mp3|WAV|FLAC))"},
)
