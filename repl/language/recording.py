"""Verbs of real hands, and of what is recorded."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.repl.language import values
from ergon.repl.language.commands import Command, When
from ergon.repl.language.forms import LINK_SLOTS, OFF_SLOT, PLAYER_SLOT, Slot, Words, form


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


def record_audio(file: str | None = None, *, when: When, words: Words) -> RecordAudio:
    """Record sound into a file; without a file, end the recording."""
    return RecordAudio(file, when=when, words=words)


# fmt: off
RECORD_FORM = form("record", "rec", "records a real hand as a take",
    "record remi as solo", Record, PLAYER_SLOT, Slot("take", "NAME", values.NEW_NAME, "as"))
RECORD_OFF_FORM = form("record", "rec", "ends the recording", "record off", RecordOff, OFF_SLOT)
GUIDE_FORM = form("guide", "gu", "guides a real hand along what another player plays",
    "guide remi ada K=30N/m", Guide,
    PLAYER_SLOT, Slot("by", "PLAYER", values.OTHER_PLAYER), *LINK_SLOTS)
GUIDE_OFF_FORM = form("guide", "gu", "ends the guidance of a hand",
    "guide remi off", Guide, PLAYER_SLOT, OFF_SLOT)
RECORD_AUDIO_OFF_FORM = form("record", "rec", "ends the file of what is heard", "record audio off",
    record_audio, Slot("", "", None, "audio"), OFF_SLOT, takes_time=False)
RECORD_AUDIO_FORM = form("record", "rec", "records what is heard in a file",
    "record audio evening.wav", record_audio, Slot("", "", None, "audio"),
    Slot("file", "FILE", values.FILE_VALUE), takes_time=False)
# fmt: on
