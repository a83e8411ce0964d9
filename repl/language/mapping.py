"""What a MIDI controller or note does."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.repl.language.commands import Command

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
        low_end, high_end = (f"{end!r}{self.unit}" for end in self.range)
        target_text = (
            " ".join(filter(None, ("gain", self.sounding))) if self.target is None else self.target
        )
        return f"map {self.name} {target_text} {low_end}..{high_end}"


EVEN_CURVE = "even"  # the curve of a map whose strengths follow the velocity as it is


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
    curve: str = EVEN_CURVE

    @property
    def name(self) -> str:
        """The name of the map."""
        return f"note {self.low}" + ("" if self.high == self.low else f"..{self.high}")

    @property
    def line(self) -> str:
        """The line that makes the map."""
        impulse = None
        if self.impulse is not None:
            softest, loudest = self.impulse
            impulse = f"{softest!r}Ns..{loudest!r}Ns"
        curve = None if self.curve == EVEN_CURVE else f"curve {self.curve}"
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
