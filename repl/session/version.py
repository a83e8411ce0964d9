"""A version of a session: the texts of a score, the piece they say, and the faders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.scores.reading.sounding import SoundingNames

if TYPE_CHECKING:
    from ergon.repl.language.commands import MapControl, MapNotes
    from ergon.repl.session.block_rules import Rule
    from ergon.scores.edits.merging import Spot
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.piece import Piece


# A jump of K by a half raises the third difference of a sound twelvefold, a glide over 64 frames by
# a fifth; lower modes need longer [s].
GLIDE = 0.02


class NotTakenError(ErgonError):
    """A line is refused and changes nothing: one sentence why, and the line to type instead."""

    def __init__(self, message: str, try_: str | None = None) -> None:
        """Keep what to type instead."""
        super().__init__(message)
        self.try_ = try_


@dataclass(frozen=True, slots=True)
class Faders:
    """Faders of instruments: ratios, which are muted, and which alone are heard."""

    gains: Mapping[str, float] = field(default_factory=dict)
    muted: frozenset[str] = frozenset()
    solo: frozenset[str] = frozenset()
    master: float = 1.0

    def ratio(self, part: str) -> float:
        """The ratio of an instrument."""
        is_heard = part not in self.muted and (not self.solo or part in self.solo)
        return self.master * self.gains.get(part, 1.0) if is_heard else 0.0


@dataclass(frozen=True, slots=True)
class HandGuide:
    """Who guides a hand, and by which shares (0 to 1) of the strongest stiffness and viscosity."""

    by: str
    stiffness: float
    viscosity: float


@dataclass(frozen=True, slots=True)
class Version:
    """What one accepted line (or block of lines) made of the version before it.

    A version that `cuts` ends every gesture in flight; `damp` [s] is the T60 that it gives to all
    that sounds; parameters that differ from those before glide for `glide` [s]; `guides` says by
    player who guides a real hand; `maps` are those of MIDI, by their names; `rules` say when blocks
    run by themselves, by their names; `sounds_as` says by which names the engine knows keys and
    instruments that were renamed, which sound on; a version that `enters` goes on from that beat of
    its own piece, whatever the beat was before; `read` is what the line read from the disk, and
    `dropped` are the places whose typing gave way to it; `released` are the parameters whose
    automation a scene has ended. `base` is what the files held when they were last read or saved,
    and `renames` are those since, each a name and the one that took its place; while the score's
    time `goes`, beats pass.
    """

    number: int
    line: str
    texts: Texts
    piece: Piece
    faders: Faders = Faders()
    cuts: bool = False
    damp: float | None = None
    glide: float = GLIDE
    guides: Mapping[str, HandGuide] = field(default_factory=dict)
    enters: float | None = None
    maps: Mapping[str, MapControl | MapNotes] = field(default_factory=dict)
    rules: Mapping[str, Rule] = field(default_factory=dict)
    sounds_as: SoundingNames = field(default_factory=SoundingNames)
    renames: Sequence[tuple[str, str]] = ()
    read: Texts | None = None
    dropped: Sequence[Spot] = ()
    released: Sequence[str] = ()
    base: Texts | None = None
    goes: bool = False

    @property
    def sounding(self) -> Piece:
        """The piece as the engine knows it."""
        return self.sounds_as.piece(self.piece)


@dataclass(frozen=True, slots=True)
class PastVersion:
    """What an earlier version is restored from: its piece, 1000 times as large, is left out.

    `where` is the beat at which it took effect, as written.
    """

    number: int
    line: str
    texts: Texts
    faders: Faders
    guides: Mapping[str, HandGuide]
    where: str = ""
    base: Texts | None = None
    maps: Mapping[str, MapControl | MapNotes] = field(default_factory=dict)
    rules: Mapping[str, Rule] = field(default_factory=dict)
    sounds_as: SoundingNames = field(default_factory=SoundingNames)
    renames: Sequence[tuple[str, str]] = ()

    @classmethod
    def of(cls, version: Version, where: str = "", line: str | None = None) -> PastVersion:
        """Keep a version for `undo`, as that of another `line` where one is given."""
        line = version.line if line is None else line
        own = version
        return cls(
            own.number,
            line,
            own.texts,
            own.faders,
            own.guides,
            where,
            own.base,
            own.maps,
            own.rules,
            own.sounds_as,
            own.renames,
        )

    def restored(self, version: Version, beat: float) -> Version:
        """The version as it was, in place of another."""
        piece = piece_of(self.texts)
        return replace(
            version,
            texts=self.texts,
            piece=piece,
            faders=self.faders,
            guides=self.guides,
            maps=self.maps,
            rules=self.rules,
            sounds_as=self.sounds_as,
            renames=self.renames,
            base=self.base or version.base,
        )


def in_short(line: str) -> str:
    """A line as messages and the history show it: of several lines the first."""
    first, *more = line.strip().split("\n")
    return f"{first} …" if more else first


def piece_of(texts: Texts) -> Piece:
    """The piece that texts say. Raises NotTakenError with their first mistake."""
    loaded = texts.load()
    if loaded.piece is None:
        first = next(found for found in loaded.diagnostics if found.severity == "error")
        raise NotTakenError(first.message)
    return loaded.piece
