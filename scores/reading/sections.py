"""The tables of a score: every section (`keys`, `parts`, `mix` …), every field.

The checker, the JSON Schema, the reference and the language server use these tables.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from ergon.instruments.module_kinds import LINKS, tables
from ergon.instruments.playing import LOUDNESS
from ergon.instruments.read import INSTRUMENT, MODULES_DOC, module_table
from ergon.instruments.space.fields import DIRECTION
from ergon.instruments.transpose import INTERVAL
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import (
    MISSING,
    Context,
    Either,
    ListOf,
    NamedValues,
    NamesOf,
    Reference,
    Shape,
    Text,
    choice,
    wrong_shape,
)
from ergon.notation.tables.strengths import LEVELS
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.tables.velocities import VELOCITY_CURVE
from ergon.notation.text import document
from ergon.notation.text.document import Mapping, Node, Scalar
from ergon.notation.text.errors import TextError
from ergon.scores.gesture.points import CURVES
from ergon.scores.gesture.transforms import MEANINGS as OF_GESTURES
from ergon.scores.pattern.cycle_table import MEANINGS as OF_RHYTHMS
from ergon.scores.reading import mixing, phrase_do, tones
from ergon.scores.reading.automation import AUTOMATION
from ergon.scores.reading.include import INCLUDE
from ergon.scores.reading.melody import ENTRY, PHRASE_ENTRY, Entries
from ergon.scores.reading.part import PART
from ergon.scores.reading.patterns import PATTERN_TABLE
from ergon.scores.reading.piece import METHODS
from ergon.scores.reading.playing_options import DO, GESTURE_FIELDS
from ergon.scores.reading.rhythms import RHYTHM
from ergon.scores.reading.sweep_fields import FIELDS as PASSING_FIELDS

RATE = 44100.0  # default frames a second
MAX_CHANNELS = 1024
MAX_SEED = 2**64 - 1  # the random generator's key has 64 bits
CURVE = choice(*CURVES)


@dataclass(frozen=True)
class Raw(Shape):
    """A text that is read later, when the fields beside it are known."""

    what: str

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Give the scalar itself."""
        return node if isinstance(node, Scalar) else wrong_shape(self, node, name, context)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string"]}

    def words(self) -> str:
        """In words."""
        return self.what


GESTURE = Record(
    "gesture",
    "a narrative gesture: a notation alone, or these fields",
    (
        Field("notation", Raw("points x@t, such as 0mm@0 smooth 6mm@1/8"), "points in one line"),
        Field("points", Raw("a table below '|': rows of t, x and a curve"), "points in rows"),
        Field("curve", CURVE, "the way into points without a curve word", "smooth"),
        Field("like", Reference("a gesture", ("gestures",)), "begin with another gesture"),
        Field("do", DO, "transformations, left to right (after those of `like`)"),
        *GESTURE_FIELDS,
    ),
)


@dataclass(frozen=True)
class GestureShape(Shape):
    """A gesture: a notation alone, or a table of fields."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar) or node.is_empty:
            return GESTURE.read(node, name, context)
        values = Values(GESTURE, node, context)
        # A literal block ('|') without '@' is a table of points.
        field = "points" if node.style == "|" and "@" not in node.text else "notation"
        values.given[field] = values.nodes[field] = node
        return values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return Either(Raw(""), GESTURE).schema()

    def words(self) -> str:
        """In words."""
        return "points such as 0mm@0 smooth 6mm@1/8, or a gesture's fields"

    def chosen(self, node: Node) -> Shape:
        """The table of fields, unless the node is a notation alone."""
        return self if isinstance(node, Scalar) and not node.is_empty else GESTURE


KEY = Record(
    "key",
    "a force-feedback key (TGR), real or emulated: a mass with spring and viscosity, or a network",
    (
        Field("like", Reference("a key", ("keys",)), "begin with another key's values"),
        Field("calib", k.PATH, "a file of what the key is made of, as measured"),
        Field("simple", k.BOOLEAN, "take M, K and Z alone from that file", False),
        Field("M", k.MASS, "mass"),
        Field("K", k.STIFFNESS, "stiffness of its spring"),
        Field("Z", k.DAMPING, "viscosity", 0.0),
        Field("f", k.PITCH, "damped frequency, instead of K"),
        Field("t60", k.DURATION, "decay, instead of Z", shown="none"),
        Field("rest", k.POSITION, "position at which its spring has no force", 0.0),
        Field("X0", k.POSITION, "position at the beginning", 0.0),
        Field("V0", k.SPEED, "velocity at the beginning", 0.0),
        Field("travel", k.TRAVEL, "range of positions of the key", shown="anywhere"),
        Field("reach", k.POSITIVE, "factor from the movement of the key to that of the piece", 1.0),
        Field("modules", NamesOf(module_table("si"), "module", has_loops=True), MODULES_DOC),
        Field("struck", Reference("a MAT of its modules"), "the MAT that ergons strike"),
        Field("rate", k.RATE, "its own: audio divided by a whole number", shown="rates: gesture"),
    ),
)
OSC = "osc"  # an input whose values come by OSC
TAKE = Record(
    "take",
    "a captured movement",
    (
        Field(
            "file",
            k.PATH,
            "a recording (.take), CSV, TSV, WAV, npz, C3D, BVH, TRC, SDIF, MIDI or MusicXML; of an "
            "input a WAV file, heard where no card is",
        ),
        Field(
            "input",
            k.integer_or(OSC, 1, 64, "1"),
            "an input of the sound card, or values that come by OSC, which drives ENX or ENF",
        ),
        Field("gain", k.FULL_SCALE, "what full scale of an input is"),
        Field("highpass", k.HERTZ, "cutoff of an input's high-pass filter", shown="20Hz"),
        Field("clamp", k.FULL_SCALE, "the most that an input gives, either way", shown="`gain`"),
        Field("glide", k.PAUSE, "time from one value by OSC to the next", shown="20ms"),
        Field(
            "channel",
            k.TITLE,
            "the column, player, point and axis (hand.x), channel of MIDI or part of MusicXML",
            shown="the only one; of notes all",
        ),
        Field("velocity", k.IMPULSES, "impulses of the softest and the hardest note of MIDI"),
        Field("bend", INTERVAL, "how far the pitch wheel of MIDI goes where its file says nothing"),
        Field("depth", k.TRAVEL, "how far such notes press a key that plays them"),
        Field("curve", VELOCITY_CURVE, "how strong a MIDI note of a velocity is", shown="even"),
        Field("trim", k.TRIM, "the part that is used; its beginning becomes time 0"),
        Field("smooth", k.HERTZ, "cutoff of a low-pass filter, run forward and backward"),
        Field("rate", k.HERTZ, "sample rate of a file without a column t [s]"),
        Field(
            "unit", k.SIZE, "what 1.0 means in a file without units (BVH, SDIF, tables; WAV: 1m)"
        ),
    ),
)


@dataclass(frozen=True)
class StrikesDo(Shape):
    """Transformations as texts: what they mean depends on whether a phrase or a rhythm plays."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        items = node.items if isinstance(node, document.Sequence) else [node]
        texts = [item for item in items if isinstance(item, Scalar)]
        if len(texts) < len(items) or not texts:
            return wrong_shape(self, node, name, context)
        return tuple(texts)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "array"], "items": {"type": ["string"]}}

    def words(self) -> str:
        """In words."""
        return "transformations, such as scale 0.5, or every 4 rev"

    def vocabulary(self) -> dict[str, str]:
        """Words of rhythms, and those of gestures that are for the entries of a phrase."""
        return {**OF_GESTURES, **OF_RHYTHMS}


_TARGETS = ListOf(Reference("modules, such as sky.all", ("modules", "instruments")), 1, single=True)
_MUTE = (
    "an instrument is silent without its route, or with `gain: x0` there; at the prompt "
    "`mute bell` and `solo bell`"
)
_MUTE_STRIKES = (
    "to leave strikes out, put '#' before their lines; at the prompt `mute NAME` and `solo NAME`"
)
_PEDAL = (
    "a score has no pedal: strokes of a rhythm last as `do: legato 1` says, notes of a MIDI file "
    "until its pedal (controller 64) comes up, and other strokes have no end"
)
STRIKES = Record(
    "strikes",
    "ergons that hit modules directly, without a key",
    (
        Field("to", _TARGETS, "what; of a melody the instrument whose notes are struck"),
        Field("at", k.WHEN, "when they begin"),
        Field("for", k.LENGTH, "how long; of `sweep` and `path` once over the instrument"),
        Field("until", k.WHEN, "when they end, instead of `for`"),
        Field("rate", k.HERTZ, "mean strikes a second for each target, by chance (Poisson)"),
        Field("every", k.LENGTH, "time between strikes, instead of `rate`"),
        Field("times", k.TIMES, "number of strikes; of whole rounds, with `notes` or `euclid`"),
        *PATTERN_TABLE,
        Field("impulse", LEVELS, "how strongly, from a range by chance; a pattern in turn"),
        Field(
            "notes",
            Text(str, "notes, such as A3 C4 E4", has_values=True),
            "pitch of a CEL at each strike",
        ),
        Field("entries", Entries(ENTRY), "a melody, instead of all these: strikes one by one"),
        Field(
            "play",
            Reference("a phrase, or a take of MIDI or MusicXML"),
            "what is played, `every` so often",
        ),
        Field("rhythm", RHYTHM, "a text of words, notes and rests, which is one cycle"),
        Field("cycle", k.LENGTH, "length of a cycle of the rhythm", shown="1bar"),
        *PASSING_FIELDS,
        Field("transpose", INTERVAL, "how much higher the notes of the phrase are"),
        Field(
            "do",
            StrikesDo(),
            "transformations of a phrase, a rhythm, or strikes by the clock, left to right",
        ),
        Field("mass", k.MASS, "mass of the ergon, with `speed` instead of `impulse`"),
        Field("speed", k.SPEED, "speed of the ergon"),
        Field(
            "lasts", k.CONTACT_TIME, "how long each strike lasts; 0s: an instant", shown="0.19ms"
        ),
        Field("along", DIRECTION, "direction of the push on points in space, axis by axis"),
    ),
    meant={"repeat": "times"},
    elsewhere={"pedal": _PEDAL, "sustain": _PEDAL, "mute": _MUTE_STRIKES, "solo": _MUTE_STRIKES},
)


def _phrase(values: Values) -> Any:
    if values.written("entries", "like") or "entries" in values.misspelt:
        return values
    shape = values.record.by_name["entries"].shape
    message = f"{values.context.of('')} has no 'entries': {shape.words()}"
    values.context.error("E103", message, values.place)
    return MISSING


PHRASE = Record(
    "phrase",
    "a melody with a length of its own, which `strikes` play",
    (
        Field("entries", Entries(PHRASE_ENTRY), "its strikes; needed without `like`"),
        Field("length", k.LENGTH, "its length", shown="to the beat after its last strike"),
        Field("to", _TARGETS, "the instrument whose notes are struck"),
        Field("impulse", LEVELS, "how strongly strikes are that say nothing"),
        Field("like", Reference("a phrase", ("phrases",)), "begin with another phrase"),
        Field("do", phrase_do.DO, "transformations, left to right (after those of `like`)"),
    ),
    _phrase,
)


@dataclass(frozen=True)
class MelodyShape(Shape):
    """A record, or its `entries` alone as a list or a table."""

    record: Record

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        is_bare = not isinstance(node, Mapping) and not (isinstance(node, Scalar) and node.is_empty)
        if not is_bare:
            return self.record.read(node, name, context)
        values = Values(self.record, node, context)
        entries = self.record.by_name["entries"].shape.read(node, name, context)
        if entries is MISSING:
            return MISSING
        values.given["entries"], values.nodes["entries"] = entries, node
        return values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        record_schema = self.record.schema()
        return {**self.record.by_name["entries"].shape.schema(), **record_schema, "type": _ANY}

    def words(self) -> str:
        """In words."""
        return f"{self.record.words()}, or its entries alone"

    def field_names(self) -> Collection[str]:
        """The names of fields of the record."""
        return self.record.field_names()

    def chosen(self, node: Node) -> Shape:
        """The record, unless the node is its entries alone."""
        is_bare = not isinstance(node, Mapping) and not (isinstance(node, Scalar) and node.is_empty)
        return self.record.by_name["entries"].shape.chosen(node) if is_bare else self.record


_ANY = ["object", "array", "string", "null"]
PLAYER = Record(
    "player",
    "a hand on a key",
    (
        Field("hand", choice("virtual", "live"), "emulated, or a real hand", "virtual"),
        Field("key", Reference("a key", ("keys",)), "the key that it plays", required=True),
        Field("device", k.TITLE, "a live hand's axis, such as tgr0.3"),
        Field(
            "standin",
            Reference("a take or gesture", ("takes", "gestures")),
            "what plays in place of a real hand",
        ),
        Field("tick", k.TICK_RATE, "rate at which the device is read", shown="1000 Hz"),
    ),
    refused={
        "follow": "following another player is not built yet",
        "sync": "synchronisation with a player is not built yet",
    },
)


def _without_between(table: Record) -> Record:
    return replace(table, fields=tuple(f for f in table.fields if f.name not in ("to", "between")))


COUPLING = Record(
    "coupling",
    "a link through which two keys act on each other",
    (
        Field("couple", ListOf(Reference("a key", ("keys",)), 2, 2), "the two keys", required=True),
        Field("at", k.WHEN, "beginning of the link", shown="the beginning"),
        Field("until", k.WHEN, "end of the link", shown="the end"),
    ),
    kinds={name: _without_between(table) for name, table in tables("si", LINKS).items()},
    kind_required=True,
)
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
    lone={"bpm": r"(\d+(?:\.\d+)?|\d+(?:\.\d+)? *-> *\d+(?:\.\d+)?) *(?:bpm)?"},
)
METERS = Record(
    "meter map",
    "the meters of a MIDI or MusicXML file",
    (Field("from", k.PATH, "a MIDI or MusicXML file whose meters hold", required=True),),
)


def _channels(text: str) -> Any:
    return "nearest" if text == "nearest" else (_CHANNEL.parse(text),)


_CHANNEL = k.integer(1, MAX_CHANNELS, "1")
_TO = Either(
    scalar=Text(_channels, "a channel from 1, or nearest", "^([0-9]+|nearest)$"),
    sequence=ListOf(_CHANNEL, 1, MAX_CHANNELS),
)
ROOM = mixing.room_table(ListOf(_CHANNEL, 1, MAX_CHANNELS, single=True))
ROUTE = Record(
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
        Field("to", _TO, "channels, or the loudspeaker nearest to each module", required=True),
        Field("gain", k.GAIN, "level", 1.0, shown="0dB"),
        Field("level", LOUDNESS, "loudness of a stroke at mf, from which `gain` counts"),
        Field("highpass", k.HERTZ, "second-order high-pass", shown="8Hz in 16 and 24 bits"),
        Field("lowpass", k.HERTZ, "second-order low-pass"),
        Field("lowshelf", tones.SHELF, "a gain of all below a frequency"),
        Field("highshelf", tones.SHELF, "a gain of all above a frequency"),
        Field("delay", tones.DELAY, "how much later it is heard, or with echoes"),
        Field("pan", mixing.PAN, "place between two channels, by constant power; or its points"),
        Field("send", mixing.SENDS, "rooms by name, each with a level"),
        Field("fade", mixing.FADE, "levels at positions of the piece"),
        Field("radiate", mixing.RADIATION, "as a disc in a wall, heard at a distance"),
    ),
    elsewhere={"mute": _MUTE, "solo": _MUTE},
)
MASTER = Record(
    "master",
    "all channels together",
    (
        Field("gain", k.GAIN, "level", 1.0, shown="0dB"),
        Field(
            "reference",
            k.REFERENCE,
            "level of 0.1 mm, 1 m/s, 10,000 m/s², 10 mN and 1 Pa, or SI: that of one unit is 0 dB",
            shown="-20dB",
        ),
        Field("loudness", LOUDNESS, "loudness of the whole piece, peaks up to -1 dBTP"),
        Field("normalise", k.GAIN, "level of the highest peak of the whole piece"),
        Field("limit", k.GAIN, "ceiling of the limiter"),
        Field("fade", mixing.FADE, "levels at positions of the piece"),
    ),
)
MIX = Record(
    "mix",
    "loudspeakers and the ways to them",
    (
        Field("channels", _CHANNEL, "how many", shown="as many as the routes need"),
        Field("layout", k.PATH, "a file that says where loudspeakers are"),
        Field("route", ListOf(ROUTE, single=True), "from instruments to channels"),
        Field("rooms", NamesOf(ROOM, "room"), "rooms that routes send to"),
        Field("master", MASTER, "all channels together"),
    ),
)
RENDER = Record(
    "render",
    "the file that is written",
    (
        Field("file", k.PATH, "its name, relative to the score, in its folder"),
        Field("bits", choice("16", "24", "float"), "sample format", "24"),
        Field("tail", k.TAIL, "time after the last event; auto: until -80 dB", "auto"),
        Field("channels", _CHANNEL, "as in the mix"),
    ),
    lone={"file": r"(.+\.(?:wav|flac|mp3|WAV|FLAC))"},
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


def _line(text: str) -> str:
    """A line of a session; it is parsed when the block is run."""
    if not text.strip() or "\n" in text.strip():
        raise TextError("a block is a list of lines, each a line of a session", length=len(text))
    return text.strip()


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


def version(text: str) -> str:
    """The format version, 1."""
    if text != "1":
        raise TextError("this program reads format 1", length=max(1, len(text)), code="E109")
    return text


_MODE = Record(
    "mode",
    "a part of a key that swings on it",
    (
        Field("M", k.MASS, "mass, which is part of that of the key", required=True),
        Field("f", k.HERTZ, "frequency on a key that stands still", required=True),
        Field("t60", k.DURATION, "decay by 60 dB", required=True),
    ),
)
CALIBRATION = Record(
    "calibration",
    "a key as measured",
    (
        Field("ergon", Text(version, "1", "^1$"), "version of the format"),
        Field("M", k.MASS, "mass", required=True),
        Field("K", k.STIFFNESS, "stiffness", required=True),
        Field("Z", k.DAMPING, "viscosity", required=True),
        Field("travel", k.TRAVEL, "range of positions of the key"),
        Field("rest", k.POSITION, "where spring and weight balance"),
        Field("weight", k.PUSH, "constant force downwards, of a key without a spring"),
        Field("dry", k.FORCE, "dry friction"),
        Field("presliding", k.STIFFNESS, "stiffness of dry friction before the key slides"),
        Field("static", k.FORCE, "dry friction near rest"),
        Field("static_speed", k.SPEED, "speed at which it has fallen towards `dry` by 1/e"),
        Field("delay", k.PAUSE, "delay of the motor's force"),
        Field("modes", ListOf(_MODE), "parts that swing on the key"),
        Field("noise", k.POSITION, "rms of the sensor's noise"),
        Field("correlations", ListOf(k.TITLE), "of each figure with those before it"),
        Field("takes", ListOf(k.TITLE), "SHA-256 of the takes that it was measured by"),
        *(
            Field(name, k.TITLE, "for the reader")
            for name in ("title", "date", "device", "residual")
        ),
    ),
)
SPEAKER = Record(
    "loudspeaker",
    "where a loudspeaker is, as seen from the middle",
    (
        Field("az", k.AZIMUTH, "from the front to the left", required=True),
        Field("el", k.ELEVATION, "from the horizon up", 0.0, shown="0deg"),
        Field("r", k.DISTANCE, "how far away", 1.0, shown="1m"),
    ),
)
LAYOUT = Record(
    "layout",
    "where loudspeakers are",
    (
        Field("ergon", Text(version, "1", "^1$"), "version of the format"),
        Field("title", k.TITLE, "for the reader"),
        Field(
            "project",
            choice("plan", "equidistant"),
            "what the bench shows: the room from above, or angles from the zenith",
            "plan",
        ),
        Field(
            "speakers",
            ListOf(Either(mapping=SPEAKER, sequence=ListOf(k.POSITION, 2, 3)), 1, MAX_CHANNELS),
            "[x, y] or [x, y, z] of each, in metres, or {az, el, r}",
            required=True,
        ),
        Field(
            "outputs",
            ListOf(_CHANNEL, 1, MAX_CHANNELS),
            "the output of each; without them the loudspeakers are at the outputs 1, 2, 3 …",
        ),
    ),
)


def _field_names(table: Record) -> tuple[str, ...]:
    """Fields that only such a file has: a score with one of them is a file of that kind."""
    return tuple(f.name for f in table.fields if f.name not in ("ergon", "title"))


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
        Field("instruments", NamesOf(INSTRUMENT, "instrument"), "networks that sound"),
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
    elsewhere={"mute": _MUTE, "solo": _MUTE, "pedal": _PEDAL},
    foreign={
        **dict.fromkeys(
            _field_names(CALIBRATION), "a calibration is named by a key: `calib: FILE`"
        ),
        **dict.fromkeys(_field_names(LAYOUT), "a layout is named by the mix: `layout: FILE`"),
    },
)
