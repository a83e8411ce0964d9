"""A version of a session: the texts of a score, their piece, and the faders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.notation.text.errors import quote
from ergon.repl.session.strike_levels import StrikeLevels
from ergon.scores.reading.sounding import SoundingNames

if TYPE_CHECKING:
    from ergon.repl.language.hearing import Hear
    from ergon.repl.language.mapping import MapControl, MapNotes
    from ergon.repl.session.block_rules import Rule
    from ergon.scores.edits.merging import ValuePlace
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.piece import Piece


# The shortest glide of a parameter [s]. A jump of K by a half raises the third difference of the
# sound twelvefold, a glide over 64 frames by a fifth; lower modes need longer.
GLIDE_DURATION = 0.02


class NotTakenError(ErgonError):
    """A line is refused and changes nothing; it has a sentence that says why, and the line to type
    instead.
    """

    def __init__(self, message: str, try_: str | None = None) -> None:
        """Keep what to type instead."""
        super().__init__(message)
        self.try_ = try_


@dataclass(frozen=True, slots=True)
class Faders:
    """Faders of instruments: gains as ratios, muted instruments, and instruments on solo."""

    gains: Mapping[str, float] = field(default_factory=dict)
    muted: frozenset[str] = frozenset()
    solo: frozenset[str] = frozenset()
    master: float = 1.0

    def ratio(self, part: str) -> float:
        """The gain of an instrument as it is heard: 0 if it is muted."""
        is_heard = part not in self.muted and (not self.solo or part in self.solo)
        return self.master * self.gains.get(part, 1.0) if is_heard else 0.0


@dataclass(frozen=True, slots=True)
class HandGuide:
    """Which player guides a hand, and the shares (0 to 1) of the strongest stiffness and
    viscosity.
    """

    guiding_player: str
    stiffness: float
    viscosity: float


@dataclass(frozen=True, slots=True)
class Version:
    """The result of one accepted line (or block of lines) on the version before it.

    How it takes over: if it `ends_gestures`, every gesture in flight ends; `damping_t60` [s] is a
    T60 for all that sounds; changed parameters glide for `glide_duration` [s]; with a
    `takeover_beat`, the piece goes on from that beat, whatever the beat was before.

    What it has: `guides` has the guide of each real hand, by player; `maps` the MIDI maps and
    `rules` the rules of blocks, by name; `strike_levels` the levels of strikes; `sounds_as` the
    names in the engine of keys and instruments that were renamed while they sound; `is_running` is
    True while the piece runs.

    From files: `read_texts` has the texts that the line read from the disk, and `discarded_places`
    the places where typed values gave way to them; `read_files` has the texts of further files
    that the line brought in; `released_parameters` has the parameters whose automation a scene has
    ended; `file_texts` is the content of the files when they were last read or
    saved, and `renames` are the renamings since then, as (old, new).
    """

    number: int
    line: str
    texts: Texts
    piece: Piece
    faders: Faders = Faders()
    ends_gestures: bool = False
    damping_t60: float | None = None
    glide_duration: float = GLIDE_DURATION
    guides: Mapping[str, HandGuide] = field(default_factory=dict)
    takeover_beat: float | None = None
    maps: Mapping[str, MapControl | MapNotes | Hear] = field(default_factory=dict)
    rules: Mapping[str, Rule] = field(default_factory=dict)
    sounds_as: SoundingNames = field(default_factory=SoundingNames)
    renames: Sequence[tuple[str, str]] = ()
    read_texts: Texts | None = None
    read_files: Mapping[str, str] = field(default_factory=dict)
    discarded_places: Sequence[ValuePlace] = ()
    released_parameters: Sequence[str] = ()
    file_texts: Texts | None = None
    is_running: bool = False
    strike_levels: StrikeLevels = field(default_factory=StrikeLevels)

    def taken_over(self) -> Version:
        """The version after its takeover, without the fields that say how it takes over and what
        its line read.
        """
        return replace(
            self,
            ends_gestures=False,
            damping_t60=None,
            glide_duration=GLIDE_DURATION,
            takeover_beat=None,
            read_texts=None,
            read_files={},
            discarded_places=(),
            released_parameters=(),
        )

    @property
    def sounding(self) -> Piece:
        """The piece with the names that the engine knows, and with the levels of its strikes."""
        return self.strike_levels.scaled(self.sounds_as.sounding_piece(self.piece))


def is_same_music(first_version: Version, other_version: Version) -> bool:
    """Whether two versions differ by faders alone, so that one stage plays both."""
    return (
        first_version.texts is other_version.texts
        and first_version.piece is other_version.piece
        and first_version.sounds_as is other_version.sounds_as
        and first_version.file_texts is other_version.file_texts
        and first_version.strike_levels == other_version.strike_levels
        and (first_version.guides, first_version.maps, first_version.rules)
        == (other_version.guides, other_version.maps, other_version.rules)
        and (
            first_version.ends_gestures,
            first_version.damping_t60,
            first_version.glide_duration,
            first_version.takeover_beat,
            first_version.is_running,
        )
        == (
            other_version.ends_gestures,
            other_version.damping_t60,
            other_version.glide_duration,
            other_version.takeover_beat,
            other_version.is_running,
        )
    )


@dataclass(frozen=True, slots=True)
class PastVersion:
    """What is needed to restore an earlier version. Its piece, which is 1000 times as large, is
    left out.

    `beat_text` is the beat at which it took effect, as written.
    """

    number: int
    line: str
    texts: Texts
    faders: Faders
    guides: Mapping[str, HandGuide]
    beat_text: str = ""
    file_texts: Texts | None = None
    maps: Mapping[str, MapControl | MapNotes | Hear] = field(default_factory=dict)
    rules: Mapping[str, Rule] = field(default_factory=dict)
    sounds_as: SoundingNames = field(default_factory=SoundingNames)
    renames: Sequence[tuple[str, str]] = ()
    strike_levels: StrikeLevels = field(default_factory=StrikeLevels)

    @classmethod
    def from_version(
        cls, version: Version, where_text: str = "", new_line: str | None = None
    ) -> PastVersion:
        """Keep a version for `undo`; `new_line` replaces its line if it is given."""
        new_line = version.line if new_line is None else new_line
        return cls(
            version.number,
            new_line,
            version.texts,
            version.faders,
            version.guides,
            where_text,
            version.file_texts,
            version.maps,
            version.rules,
            version.sounds_as,
            version.renames,
            version.strike_levels,
        )

    def restore(self, version: Version, beat: float) -> Version:
        """The restored version, made from the present one."""
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
            strike_levels=self.strike_levels,
            file_texts=self.file_texts or version.file_texts,
        )


def first_line(line: str) -> str:
    """A line as messages and the history show it: only the first of several lines."""
    first_text, *lines_after = line.strip().split("\n")
    return f"{first_text} …" if lines_after else first_text


def piece_from_files(score_texts: Texts) -> Piece:
    """The piece of texts that were read from files. Raises NotTakenError with their first mistake
    and its place.
    """
    loaded = score_texts.load()
    if loaded.piece is None:
        errors = [diagnostic for diagnostic in loaded.diagnostics if diagnostic.severity == "error"]
        first_error, error_place = errors[0], errors[0].place
        suggestion_text = (
            f"; did you mean {quote(first_error.suggestion)}?" if first_error.suggestion else ""
        )
        others_text = f" (`ergon check` shows {len(errors)} mistakes)" if len(errors) > 1 else ""
        place_text = f"{Path(error_place.file).name}:{error_place.line}:{error_place.column}"
        raise NotTakenError(f"{place_text}: {first_error.message}{suggestion_text}{others_text}")
    return loaded.piece


def piece_of(texts: Texts) -> Piece:
    """The piece of these texts. Raises NotTakenError with their first mistake."""
    loaded = texts.load()
    if loaded.piece is None:
        first_error = next(
            diagnostic for diagnostic in loaded.diagnostics if diagnostic.severity == "error"
        )
        raise NotTakenError(
            f"{first_error.message} ({first_error.help})"
            if first_error.help
            else first_error.message
        )
    return loaded.piece
