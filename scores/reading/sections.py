"""The tables of a score: every section (`keys`, `parts`, `mix` …), every field.

The checker, the JSON Schema, the reference and the language server use these tables.
"""

from __future__ import annotations

from ergon.instruments.read import INSTRUMENT_SHAPE
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import NamedValues, Text, choice
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.text.errors import TextError
from ergon.scores.reading.automation import AUTOMATION
from ergon.scores.reading.foreign_words import ELSEWHERE, OTHER_METER
from ergon.scores.reading.gesture_tables import TAKE, GestureShape, Raw
from ergon.scores.reading.include import INCLUDE
from ergon.scores.reading.key_tables import COUPLING, KEY, PLAYER
from ergon.scores.reading.measured_tables import CALIBRATION, LAYOUT, distinct_fields, version
from ergon.scores.reading.mix_tables import MIX, RENDER
from ergon.scores.reading.outputs import METHODS
from ergon.scores.reading.part import PART
from ergon.scores.reading.strike_tables import PHRASE, STRIKES, MelodyShape

RATE = 44100.0  # default frames a second
MAX_SEED = 2**64 - 1  # the random generator's key has 64 bits
_LINK = (
    "Ableton Link is not part of ergon, because all bindings to it contain code under the GPL "
    "(docs/midi.md); `ergon repl SCORE --midi-clock-to PORT` shares the tempo"
)
TEMPO = Record(
    "tempo entry",
    "a tempo, a ramp or a meter from a position on",
    (
        Field("at", k.WHEN, "where", shown="the beginning"),
        Field("bpm", k.BPM, "beats a minute, or a ramp: 60 -> 96", shown="goes on"),
        Field("over", k.LENGTH, "length of the ramp"),
        Field("meter", k.METER, "meter from this position on", shown="4/4"),
        Field(
            "from",
            k.PATH,
            "a MIDI or MusicXML file whose tempos hold, in the first line and alone there",
        ),
    ),
    refused={"link": _LINK},
    elsewhere=ELSEWHERE["tempo entry"],
    lone={"bpm": r"(\d+(?:\.\d+)?|\d+(?:\.\d+)? *-> *\d+(?:\.\d+)?) *(?:bpm)?"},
)
METERS = Record(
    "meter map",
    "the meters of a MIDI or MusicXML file",
    (Field("from", k.PATH, "a MIDI or MusicXML file whose meters hold", required=True),),
    otherwise=OTHER_METER,
)
RATES = Record(
    "rates",
    "sample rates",
    (
        Field("audio", k.RATE, "frames a second", RATE),
        Field("gesture", k.RATE, "of all keys: audio divided by a whole number", shown="audio"),
        Field(
            "motion",
            k.RATE,
            "of what is only seen, at least: audio divided by a whole number",
            shown="audio",
        ),
    ),
    lone={"audio": r"(\d+(?:\.\d+)? *k?Hz)"},
)
ACCURACY = Record(
    "accuracy",
    "error and cost that the plan may have; without the section the error stays inaudible",
    (
        Field("method", choice(*METHODS), "one method for everything, whatever its error"),
        Field("error", k.ERROR, "largest error of the waveform, relative to the sound"),
        Field("cents", k.CENTS, "largest error of a pitch", shown="3"),
        Field("upto", k.HERTZ, "highest frequency at which pitches count", shown="5kHz"),
        Field("cpu", k.SHARE, "largest work: 100% is one core at real time"),
        Field(
            "guard",
            choice("on", "off"),
            "with `method: ca`: compute frames finer in which links stiffen too much, or never",
            "on",
        ),
    ),
)
LAW = Record(
    "law",
    "a law that LNL modules use by name; its constants are defaults",
    (
        Field("doc", k.TITLE, "description and source"),
        Field("law", k.TITLE, "force over elongation d"),
        Field("damping", k.TITLE, "force over elongation d and its rate v"),
    ),
    free=k.CONSTANT,
)
MAX_BLOCK = 50  # lines that a block has at most


def _line(line_text: str) -> str:
    """A line of a session; it is parsed when the block is run."""
    if not line_text.strip() or "\n" in line_text.strip():
        raise TextError(
            "a block is a list of lines, each a line of a session", length=len(line_text)
        )
    return line_text.strip()


BLOCK = ListOf(
    Text(_line, "a line of a session, such as ada plays knock every 1/2", types=("string",)),
    1,
    MAX_BLOCK,
    single=True,
)
_FILE = Raw("the name of a file")
_WITH_PREFIX = NamesOf(_FILE, "prefix")
USE = Either(
    scalar=_FILE,
    mapping=_WITH_PREFIX,
    sequence=ListOf(Either(scalar=_FILE, mapping=_WITH_PREFIX)),
)


LETS = NamedValues()

SCORE = Record(
    "score",
    "a whole score; a file that `use:` names has the same sections",
    (
        Field("ergon", Text(version, "1", "^1$"), "version of the format"),
        Field("title", k.TITLE, "the piece's name", ""),
        Field("seed", k.integer(0, MAX_SEED, "7"), "seed of all random draws", 0),
        Field("use", USE, "files whose names are brought in; with a prefix: {c: file}"),
        Field(
            "include",
            ListOf(INCLUDE, single=True),
            "other scores, played from a position on",
        ),
        Field("tuning", TUNING, "which frequencies notes have; {A4: 442Hz}, {edo: 31}, a scale"),
        Field("let", LETS, "values with names: {heavy: 400g, low: D2, twice: 2*heavy}"),
        Field("rates", RATES, "sample rates"),
        Field("tempo", ListOf(TEMPO, single=True), "the tempo map", shown="60 bpm in 4/4"),
        Field("meter", METERS, "meters that a file of notes says; `tempo` may say others"),
        Field("marks", NamesOf(k.MARK, "mark"), "names of instants"),
        Field("keys", NamesOf(KEY, "key"), "keys that hands play"),
        Field("instruments", NamesOf(INSTRUMENT_SHAPE, "instrument"), "networks that sound"),
        Field("laws", NamesOf(LAW, "law"), "laws of non-linear links"),
        Field("gestures", NamesOf(GestureShape(), "gesture"), "written gestures"),
        Field("takes", NamesOf(TAKE, "take"), "captured hands"),
        Field("phrases", NamesOf(MelodyShape(PHRASE), "phrase"), "melodies that strikes play"),
        Field("strikes", NamesOf(MelodyShape(STRIKES), "strikes"), "ergons without a key"),
        Field("automation", ListOf(AUTOMATION, single=True), "parameters that change in time"),
        Field("players", NamesOf(PLAYER, "player"), "hands on keys"),
        Field("duet", ListOf(COUPLING, single=True), "links between keys"),
        Field("parts", NamesOf(PART, "part"), "what each player plays: a list or a table"),
        Field("blocks", NamesOf(BLOCK, "block"), "lines that a session runs together, by a name"),
        Field("mix", MIX, "loudspeakers and the ways to them"),
        Field("render", RENDER, "the file that is written"),
        Field("accuracy", ACCURACY, "error and cost that the plan may have"),
    ),
    refused={"link": _LINK},
    elsewhere=ELSEWHERE["score"],
    foreign={
        **dict.fromkeys(
            distinct_fields(CALIBRATION), "a calibration is named by a key: `calib: FILE`"
        ),
        **dict.fromkeys(distinct_fields(LAYOUT), "a layout is named by the mix: `layout: FILE`"),
    },
)
