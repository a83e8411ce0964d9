"""Commands: one class for each thing that a typed line can ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from ergon.notation.clock.meter import Meter
from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables.strengths import Level
from ergon.repl.language.triggers import Trigger
from ergon.scores.edits.entries import Entry
from ergon.scores.gesture.notation import Notation
from ergon.scores.pattern.turn_chain import Change
from ergon.scores.reading.playing import PlayingOptions
from ergon.scores.reading.rhythms import words_of


class Now(Enum):
    """The next tick, whatever `quant` says."""

    NOW = "now"


NOW: Final = Now.NOW


@dataclass(frozen=True, slots=True)
class Sync:
    """The next beginning of another voice: of its cycle, its round, or its next stroke."""

    name: str


# `now`, `at C`, `in 2`, `sync d1`; None: the next boundary of `quant`
When = Now | Position | Length | Sync | None


class Word(NamedTuple):
    """A value as it was written, and its place in the submitted text, in characters."""

    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """When a command acts, and its values as written, by the names of its fields.

    An option of `plays` is under its own name (`every`, `from`, `grain`); `play` has the whole
    of it without the time, as the table of a part has it. The value or factor of `set` is under
    `change`.
    """

    when: When = None
    words: Mapping[str, Word] = field(default_factory=dict, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class BlockCommand(Command):
    """A command that a block may hold: it changes the music at the beat on which the block runs.

    It is not about files, history, other blocks or real hands.
    """


# --- what is played ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Define(BlockCommand):
    """`knock = 0@0 6@1/8 0@1/4`: define a gesture."""

    name: str
    notation: Notation


@dataclass(frozen=True, slots=True)
class Plays(BlockCommand):
    """`ada plays knock every 1`: play this from now on, in place of the rest of the part."""

    player: str
    what: str
    every: Length | None
    times: int | None
    until: Position | None
    do: tuple[Change, ...]
    manner: PlayingOptions
    entry: Entry | None = field(default=None, compare=False, repr=False)  # as a part has it


@dataclass(frozen=True, slots=True)
class Do(BlockCommand):
    """`ada do mirror`: transform further what the player plays."""

    player: str
    do: tuple[Change, ...]

    @property
    def chain(self) -> tuple[str, ...]:
        """Each transformation as it was written."""
        text = self.words["do"].text
        return tuple(text[one.offset : one.offset + one.length] for one in self.do)


@dataclass(frozen=True, slots=True)
class DoStrikes(BlockCommand):
    """`d1 do rev`: transform further what strikes play; `none` ends all transformations."""

    name: str
    do: str


@dataclass(frozen=True, slots=True)
class StrikeModules(BlockCommand):
    """`rain strikes sky.all every 1/2 impulse 2mNs`: replace what `rain` strikes.

    The fields are those of `strikes:` in a score, as texts.
    """

    name: str
    fields: Mapping[str, str]

    @property
    def struck(self) -> tuple[str, ...]:
        """The paths of what may be struck: those after `to`, and the words of a rhythm."""
        return (*self.fields.get("to", "").split(), *words_of(self.fields.get("rhythm", "")))


@dataclass(frozen=True, slots=True)
class Hear(Command):
    """`hear kick`, `hear vib C4 E4 f`, `hear bell.m 2mNs`: strike once, at the next tick.

    `notes` are the words of pitches; none: the note in the middle, if the instrument has notes.
    """

    target: str
    notes: tuple[str, ...]
    level: Level

    @property
    def name(self) -> str:
        """The name of what was struck, among the maps of a version."""
        return " ".join(("hear", self.target, *self.notes))


@dataclass(frozen=True, slots=True)
class DefinePhrase(BlockCommand):
    """`phrase tune 0 C4 1mNs, 1/2 E4 to bell`: define a phrase, which `strikes` play.

    Its entries have `at`, `what` and `impulse` as texts.
    """

    name: str
    entries: tuple[Mapping[str, str], ...]
    to: str | None = None


@dataclass(frozen=True, slots=True)
class Automate(BlockCommand):
    """`set bell.m.f A3 C4 E4 every 1`, `lfo bell.m.K 0.8..1.2 period 4bar`: automate a parameter.

    `kind` is `set` or `lfo`; the fields are those of `automation:` in a score, as texts.
    """

    target: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class StopLfo(BlockCommand):
    """`lfo bell.m.K off`: the parameter has its own value again."""

    target: str


@dataclass(frozen=True, slots=True)
class Rest(BlockCommand):
    """Play no further occurrence after the present one. None: every player."""

    player: str | None


@dataclass(frozen=True, slots=True)
class Hush(BlockCommand):
    """End all gestures and strikes; what sounds rings out."""


@dataclass(frozen=True, slots=True)
class Damp(BlockCommand):
    """End all gestures, and damp all that sounds with a T60 of `time` [s]."""

    time: float


@dataclass(frozen=True, slots=True)
class Panic(Command):
    """End sound and force at once."""


@dataclass(frozen=True, slots=True)
class Release(Command):
    """Switch sound and forces on again."""


# --- time ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Play(Command):
    """Run the piece, from a position or from where it stopped."""

    start: Position | None


@dataclass(frozen=True, slots=True)
class Stop(Command):
    """Stop the piece."""


@dataclass(frozen=True, slots=True)
class Tempo(BlockCommand):
    """`tempo 72`, or `tempo 60 -> 84 over 4bar`: then `end` and `over` are given."""

    bpm: float
    end: float | None = None
    over: Length | None = None


@dataclass(frozen=True, slots=True)
class SetMeter(BlockCommand):
    """`meter 3/4`: from a bar line on."""

    meter: Meter


@dataclass(frozen=True, slots=True)
class Tap(Command):
    """Mark a beat; two or more taps set the tempo."""


@dataclass(frozen=True, slots=True)
class Nudge(BlockCommand):
    """Delay the following beats by a length; a negative length brings them forward."""

    by: Length


@dataclass(frozen=True, slots=True)
class Quant(Command):
    """Set the boundaries on which lines act that do not say when."""

    grid: Now | Length


# --- matter --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Set(BlockCommand):
    """Set a physical parameter to a value [SI], or multiply it by a factor, gliding for the length
    `over`.
    """

    target: str
    value: float | None
    factor: float | None
    over: Length | None


@dataclass(frozen=True, slots=True)
class Retune(Command):
    """`set vib.tuning edo 19`: move an instrument, or the score, to another tuning, gliding for the
    length `over`; without fields to that of the score, or to equal steps.
    """

    target: str
    fields: Mapping[str, str]
    over: Length | None


@dataclass(frozen=True, slots=True)
class Couple(BlockCommand):
    """Join two keys by a REF: `stiffness` [N/m], `viscosity` [Ns/m]."""

    a: str
    b: str
    stiffness: float
    viscosity: float


@dataclass(frozen=True, slots=True)
class Uncouple(BlockCommand):
    """Remove the couplings between two keys."""

    a: str
    b: str


@dataclass(frozen=True, slots=True)
class Build(BlockCommand):
    """`bell2 = bell/bell transpose 7st`: add an instrument made from another, or from one in a
    file.

    `fields` replace its fields, as written.
    """

    name: str
    base: str
    semitones: float
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Use(Command):
    """`use skins`: bring in the instruments of a file, whose names a line may then play."""

    family: str
    file: str


@dataclass(frozen=True, slots=True)
class Link(BlockCommand):
    """Join two modules by a link of a kind, with its fields as written."""

    a: str
    b: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Takes(BlockCommand):
    """Let a player take a key; a new key is a copy of the key `like` (None: of the first)."""

    player: str
    key: str
    like: str | None = None


@dataclass(frozen=True, slots=True)
class Route(BlockCommand):
    """Set the channels, gain, pan and room of an instrument.

    None leaves a setting as it was. `send` is a room and a level.
    """

    name: str
    channels: tuple[str, ...] | None
    gain: float | None = None
    pan: float | None = None
    send: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class MovePan(Command):
    """Move an instrument to a place between its two channels, over a length."""

    name: str
    pan: float
    over: Length


@dataclass(frozen=True, slots=True)
class Filter(BlockCommand):
    """Set a filter or the delay of an instrument: the fields of its routes and their texts.

    An empty mapping removes it.
    """

    name: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Room(Command):
    """Add a room, or change fields of one, as written."""

    name: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Fade(Command):
    """Fade in or out, over a length: an instrument, or everything if the name is None."""

    name: str | None
    is_in: bool
    over: Length


@dataclass(frozen=True, slots=True)
class Remove(BlockCommand):
    """Remove what a name stands for, and what belongs to it alone."""

    name: str


@dataclass(frozen=True, slots=True)
class Rename(Command):
    """Give a gesture, a phrase, a take, a player, a block, a key or an instrument another name."""

    old: str
    name: str


@dataclass(frozen=True, slots=True)
class Guide(Command):
    """Guide a real hand along the part of the player `by`; None ends the guidance.

    `stiffness` [N/m] and `viscosity` [Ns/m] are those of the guide; None if they are not
    written.
    """

    player: str
    by: str | None = None
    stiffness: float | None = None
    viscosity: float | None = None


@dataclass(frozen=True, slots=True)
class Record(Command):
    """Record a real key's movement as a take."""

    player: str
    take: str


@dataclass(frozen=True, slots=True)
class RecordOff(Command):
    """End the recording."""


@dataclass(frozen=True, slots=True)
class RecordAudio(Command):
    """Record the sound that is heard into a file; None ends the recording."""

    file: str | None


BPM_UNIT = "bpm"  # the unit of a controller that sets the tempo
LEARN = "learn"  # the source of a map that takes the next controller that moves


@dataclass(frozen=True, slots=True)
class MapControl(Command):
    """`map cc 21 bell.m.K 1kN/m..9kN/m`: a MIDI controller moves a parameter, or a level.

    `source` is `cc 21`, `cc 1/33` (14 bits), `bend`, `pressure`, `pressure 60` (of a key) or
    `learn`. `range` has the values at its two ends. They are in the SI `unit` of the parameter
    `target`; without a target, in dB for the level of `sounding` (None: of everything).
    """

    source: str
    target: str | None
    range: tuple[float, float]
    unit: str = ""
    sounding: str | None = None

    @property
    def name(self) -> str:
        """The name of the map."""
        return self.source

    @property
    def line(self) -> str:
        """The line that makes the map."""
        if self.unit == BPM_UNIT:
            return f"map {self.name} tempo {self.range[0]!r}..{self.range[1]!r}"
        low, high = (f"{end!r}{self.unit}" for end in self.range)
        what = (
            " ".join(filter(None, ("gain", self.sounding))) if self.target is None else self.target
        )
        return f"map {self.name} {what} {low}..{high}"


EVEN = "even"  # the curve of a map whose strengths follow the velocity as it is


@dataclass(frozen=True, slots=True)
class MapNotes(Command):
    """`map note 60..72 sky.all 1mNs..20mNs`: MIDI notes strike modules; `map note C3..C5 vib`: or
    the notes of an instrument, by its strengths; `map note D2 fill`: or run a block; `map note D2
    ada knock`: or let a player play a gesture.

    `impulse` [N·s] has the impulses at the velocities 1 and 127; None: those of what is struck.
    `curve` says how strengths follow the velocity.
    """

    low: int
    high: int
    target: str
    impulse: tuple[float, float] | None
    gesture: str | None = None
    curve: str = EVEN

    @property
    def name(self) -> str:
        """The name of the map."""
        return f"note {self.low}" + ("" if self.high == self.low else f"..{self.high}")

    @property
    def line(self) -> str:
        """The line that makes the map."""
        impulse = None
        if self.impulse is not None:
            weak, strong = self.impulse
            impulse = f"{weak!r}Ns..{strong!r}Ns"
        curve = None if self.curve == EVEN else f"curve {self.curve}"
        return " ".join(filter(None, ("map", self.name, self.target, self.gesture, impulse, curve)))


@dataclass(frozen=True, slots=True)
class Learn(Command):
    """`map learn bell.m.K 1kN/m..9kN/m`: the next controller, or note, that comes is mapped; None:
    none is.
    """

    map: MapControl | MapNotes | None


@dataclass(frozen=True, slots=True)
class Monitor(Command):
    """Print MIDI messages as they come, or end that."""

    is_on: bool


@dataclass(frozen=True, slots=True)
class Unmap(Command):
    """End a map, by its name."""

    name: str


@dataclass(frozen=True, slots=True)
class Maps(Command):
    """List the maps."""


@dataclass(frozen=True, slots=True)
class Gain(BlockCommand):
    """Set the gain (a ratio of amplitudes) of an instrument or a player; None: of everything."""

    name: str | None
    ratio: float


@dataclass(frozen=True, slots=True)
class Mute(BlockCommand):
    """Silence an instrument or a player."""

    name: str


@dataclass(frozen=True, slots=True)
class Solo(BlockCommand):
    """Silence all but an instrument or a player."""

    name: str


@dataclass(frozen=True, slots=True)
class Unmute(BlockCommand):
    """End mute and solo; None: of everything."""

    name: str | None


@dataclass(frozen=True, slots=True)
class GainStrikes(BlockCommand):
    """Scale the impulses of strikes by a ratio."""

    name: str
    ratio: float


@dataclass(frozen=True, slots=True)
class MuteStrikes(BlockCommand):
    """Let strikes go on without striking."""

    name: str


@dataclass(frozen=True, slots=True)
class SoloStrikes(BlockCommand):
    """Silence all other strikes, and what players play."""

    name: str


@dataclass(frozen=True, slots=True)
class UnmuteStrikes(BlockCommand):
    """End mute of strikes, and the solo of any."""

    name: str


@dataclass(frozen=True, slots=True)
class Seed(BlockCommand):
    """Set the number from which all chance derives."""

    seed: int


# --- blocks --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class DefineBlock(Command):
    """`def fill: …`: define a block of lines; it replaces a block of the same name."""

    name: str
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunBlock(Command):
    """`fill`, `fill 16`, `fill n=16`: do the lines of a block, as one version; with values."""

    name: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RunByRule(Command):
    """`fill every 4bar`, `when bar % 4 == 3 fill`: run a block by a rule."""

    name: str
    trigger: Trigger


@dataclass(frozen=True, slots=True)
class StopBlock(Command):
    """`stop fill`: end the rule of a block."""

    name: str


# --- versions and files --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Undo(Command):
    """Return to the previous version."""


@dataclass(frozen=True, slots=True)
class Redo(Command):
    """Restore the version that was undone."""


@dataclass(frozen=True, slots=True)
class History(Command):
    """List the versions, each with the place at which it took effect."""


@dataclass(frozen=True, slots=True)
class Back(Command):
    """Go back by a number of versions."""

    count: int


@dataclass(frozen=True, slots=True)
class Keep(Command):
    """Write the last `length` of the piece as a score."""

    length: Length
    name: str


@dataclass(frozen=True, slots=True)
class Scene(Command):
    """Play the bars of a scene from their beginning, again and again; parameters glide for `over`.

    With `before`, the bars of that scene play for `over`, and then those of `name`.
    """

    name: str
    before: str | None = None
    over: Length | None = None


@dataclass(frozen=True, slots=True)
class Save(Command):
    """Write the score; None: to its own file."""

    file: str | None


@dataclass(frozen=True, slots=True)
class Load(Command):
    """Open another score in place of the present one."""

    file: str


@dataclass(frozen=True, slots=True)
class Reload(Command):
    """Read the score's files again, and take over what has changed in them."""


# --- looking -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Look(Command):
    """Draw a gesture or a take, or show where a name is defined; None: who plays what at which
    beat."""

    name: str | None


@dataclass(frozen=True, slots=True)
class Show(Command):
    """List who plays what, or show where a name is defined."""

    name: str | None


@dataclass(frozen=True, slots=True)
class ListInstruments(Command):
    """List the instruments of a family; None: those of the score, and all families."""

    family: str | None


@dataclass(frozen=True, slots=True)
class ListGestures(Command):
    """List the gestures and the takes."""


@dataclass(frozen=True, slots=True)
class ListScenes(Command):
    """List the scores beside this one, which can be played as scenes."""


@dataclass(frozen=True, slots=True)
class Trace(Command):
    """Draw where a player's key was."""

    name: str


@dataclass(frozen=True, slots=True)
class TraceOn(Command):
    """Keep the drawing of a player's key above the status line; None ends it."""

    name: str | None = None


@dataclass(frozen=True, slots=True)
class Meters(Command):
    """Show the level of every channel."""


@dataclass(frozen=True, slots=True)
class Help(Command):
    """List the verbs, or explain one."""

    verb: str | None


@dataclass(frozen=True, slots=True)
class Py(Command):
    """Evaluate a Python expression."""

    expression: str


@dataclass(frozen=True, slots=True)
class Quit(Command):
    """End the session."""
