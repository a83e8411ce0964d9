"""The tables of a score: every section (`keys`, `parts`, `mix` …), every field.

The checker, the JSON Schema, the reference and the language server use these tables.
"""

from __future__ import annotations

from ergon.instruments.read import INSTRUMENT_SHAPE
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import NamedValues, Text, choice
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.text.errors import TextError
from ergon.scores.reading.automation import AUTOMATION_RECORD
from ergon.scores.reading.foreign_words import ADVICE_BY_WORD, METER_SECTION_ADVICE
from ergon.scores.reading.gesture_tables import TAKE_RECORD, GestureShape, UnreadText
from ergon.scores.reading.include import INCLUDE_RECORD
from ergon.scores.reading.key_tables import COUPLING_RECORD, KEY_RECORD, PLAYER_RECORD
from ergon.scores.reading.measured_tables import (
    CALIBRATION_RECORD,
    LAYOUT_RECORD,
    distinct_fields,
    parse_version,
)
from ergon.scores.reading.mix_tables import MIX_RECORD, RENDER_RECORD
from ergon.scores.reading.outputs import METHODS
from ergon.scores.reading.part import PART_SHAPE
from ergon.scores.reading.strike_tables import PHRASE_RECORD, STRIKES_RECORD, MelodyShape

DEFAULT_RATE_HZ = 44100.0  # default frames a second
MAX_SEED = 2**64 - 1  # the random generator's key has 64 bits
_LINK_ADVICE = (
    "Ableton Link is not part of ergon, because all bindings to it contain code under the GPL "
    "(docs/midi.md); `ergon repl SCORE --midi-clock-to PORT` shares the tempo"
)
TEMPO_RECORD = Record(
    "tempo entry",
    "a tempo, a ramp or a meter from a position on",
    (
        Field("at", value_kinds.WHEN, "where", shown="the beginning"),
        Field("bpm", value_kinds.BPM, "beats a minute, or a ramp: 60 -> 96", shown="goes on"),
        Field("over", value_kinds.LENGTH, "length of the ramp"),
        Field("meter", value_kinds.METER, "meter from this position on", shown="4/4"),
        Field(
            "from",
            value_kinds.PATH,
            "a MIDI or MusicXML file whose tempos hold, in the first line and alone there",
        ),
    ),
    refusal_by_name={"link": _LINK_ADVICE},
    advice_by_name=ADVICE_BY_WORD["tempo entry"],
    value_pattern_by_field={"bpm": r"(\d+(?:\.\d+)?|\d+(?:\.\d+)? *-> *\d+(?:\.\d+)?) *(?:bpm)?"},
)
METERS_RECORD = Record(
    "meter map",
    "the meters of a MIDI or MusicXML file",
    (Field("from", value_kinds.PATH, "a MIDI or MusicXML file whose meters hold", required=True),),
    group_help=METER_SECTION_ADVICE,
)
RATES_RECORD = Record(
    "rates",
    "sample rates",
    (
        Field("audio", value_kinds.RATE, "frames a second", DEFAULT_RATE_HZ),
        Field(
            "gesture",
            value_kinds.RATE,
            "of all keys: audio divided by a whole number",
            shown="audio",
        ),
        Field(
            "motion",
            value_kinds.RATE,
            "of what is only seen, at least: audio divided by a whole number",
            shown="audio",
        ),
    ),
    value_pattern_by_field={"audio": r"(\d+(?:\.\d+)? *k?Hz)"},
)
ACCURACY_RECORD = Record(
    "accuracy",
    "error and cost that the plan may have; without the section the error stays inaudible",
    (
        Field("method", choice(*METHODS), "one method for everything, whatever its error"),
        Field("error", value_kinds.ERROR, "largest error of the waveform, relative to the sound"),
        Field("cents", value_kinds.CENTS, "largest error of a pitch", shown="3"),
        Field("upto", value_kinds.HERTZ, "highest frequency at which pitches count", shown="5kHz"),
        Field("cpu", value_kinds.SHARE, "largest work: 100% is one core at real time"),
        Field(
            "guard",
            choice("on", "off"),
            "with `method: ca`: compute frames finer in which links stiffen too much, or never",
            "on",
        ),
    ),
)
LAW_RECORD = Record(
    "law",
    "a law that LNL modules use by name; its constants are defaults",
    (
        Field("doc", value_kinds.TITLE, "description and source"),
        Field("law", value_kinds.TITLE, "force over elongation d"),
        Field("damping", value_kinds.TITLE, "force over elongation d and its rate v"),
    ),
    free=value_kinds.CONSTANT,
)
BLOCK_LINES_MAX = 50  # lines that a block has at most


def _parse_session_line(line_text: str) -> str:
    """A line of a session; it is parsed when the block is run."""
    if not line_text.strip() or "\n" in line_text.strip():
        raise TextError(
            "a block is a list of lines, each a line of a session", length=len(line_text)
        )
    return line_text.strip()


BLOCK_SHAPE = ListOf(
    Text(
        _parse_session_line,
        "a line of a session, such as ada plays knock every 1/2",
        types=("string",),
    ),
    1,
    BLOCK_LINES_MAX,
    single=True,
)
_FILE_SHAPE = UnreadText("the name of a file")
_WITH_PREFIX = NamesOf(_FILE_SHAPE, "prefix")
USE_SHAPE = Either(
    scalar=_FILE_SHAPE,
    mapping=_WITH_PREFIX,
    sequence=ListOf(Either(scalar=_FILE_SHAPE, mapping=_WITH_PREFIX)),
)


NAMED_VALUES = NamedValues()

SCORE_RECORD = Record(
    "score",
    "a whole score; a file that `use:` names has the same sections",
    (
        Field("ergon", Text(parse_version, "1", "^1$"), "version of the format"),
        Field("title", value_kinds.TITLE, "the piece's name", ""),
        Field("seed", value_kinds.integer(0, MAX_SEED, "7"), "seed of all random draws", 0),
        Field("use", USE_SHAPE, "files whose names are brought in; with a prefix: {c: file}"),
        Field(
            "include",
            ListOf(INCLUDE_RECORD, single=True),
            "other scores, played from a position on",
        ),
        Field("tuning", TUNING, "which frequencies notes have; {A4: 442Hz}, {edo: 31}, a scale"),
        Field("let", NAMED_VALUES, "values with names: {heavy: 400g, low: D2, twice: 2*heavy}"),
        Field("rates", RATES_RECORD, "sample rates"),
        Field("tempo", ListOf(TEMPO_RECORD, single=True), "the tempo map", shown="60 bpm in 4/4"),
        Field("meter", METERS_RECORD, "meters that a file of notes says; `tempo` may say others"),
        Field("marks", NamesOf(value_kinds.MARK, "mark"), "names of instants"),
        Field("keys", NamesOf(KEY_RECORD, "key"), "keys that hands play"),
        Field("instruments", NamesOf(INSTRUMENT_SHAPE, "instrument"), "networks that sound"),
        Field("laws", NamesOf(LAW_RECORD, "law"), "laws of non-linear links"),
        Field("gestures", NamesOf(GestureShape(), "gesture"), "written gestures"),
        Field("takes", NamesOf(TAKE_RECORD, "take"), "captured hands"),
        Field(
            "phrases", NamesOf(MelodyShape(PHRASE_RECORD), "phrase"), "melodies that strikes play"
        ),
        Field("strikes", NamesOf(MelodyShape(STRIKES_RECORD), "strikes"), "ergons without a key"),
        Field(
            "automation", ListOf(AUTOMATION_RECORD, single=True), "parameters that change in time"
        ),
        Field("players", NamesOf(PLAYER_RECORD, "player"), "hands on keys"),
        Field("duet", ListOf(COUPLING_RECORD, single=True), "links between keys"),
        Field("parts", NamesOf(PART_SHAPE, "part"), "what each player plays: a list or a table"),
        Field(
            "blocks", NamesOf(BLOCK_SHAPE, "block"), "lines that a session runs together, by a name"
        ),
        Field("mix", MIX_RECORD, "loudspeakers and the ways to them"),
        Field("render", RENDER_RECORD, "the file that is written"),
        Field("accuracy", ACCURACY_RECORD, "error and cost that the plan may have"),
    ),
    refusal_by_name={"link": _LINK_ADVICE},
    advice_by_name=ADVICE_BY_WORD["score"],
    help_by_foreign_name={
        **dict.fromkeys(
            distinct_fields(CALIBRATION_RECORD), "a calibration is named by a key: `calib: FILE`"
        ),
        **dict.fromkeys(
            distinct_fields(LAYOUT_RECORD), "a layout is named by the mix: `layout: FILE`"
        ),
    },
)
