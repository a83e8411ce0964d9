"""Verbs of levels: gain, mute and solo."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, Command
from ergon.repl.language.forms import Slot, form


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
class Meters(Command):
    """Show the level of every channel."""


# fmt: off
_SOUNDING = Slot("name", "NAME", values.LEVELLED_VALUE)
_SOUNDING_OR_ALL = Slot("name", "NAME", values.LEVELLED_VALUE, optional=True)
_STRIKES = Slot("name", "STRIKES", values.STRIKES_VALUE)
GAIN_FORM = form("gain", "ga", "sets the level of an instrument, a player or everything",
    "gain bell -6dB", Gain,
    _SOUNDING_OR_ALL, Slot("ratio", "LEVEL|xFACTOR", amounts.GAIN_VALUE))
GAIN_STRIKES_FORM = form("gain", "ga", "scales the impulses of strikes", "gain rain -6dB",
    GainStrikes, _STRIKES, Slot("ratio", "LEVEL|xFACTOR", amounts.GAIN_VALUE))
MUTE_FORM = form("mute", "mu", "silences an instrument or a player", "mute bell", Mute, _SOUNDING)
MUTE_STRIKES_FORM = form("mute", "mu", "lets strikes go on without striking", "mute rain",
    MuteStrikes, _STRIKES)
SOLO_FORM = form("solo", "so", "silences everything but an instrument or a player",
    "solo bell", Solo, _SOUNDING)
SOLO_STRIKES_FORM = form("solo", "so", "silences all other strikes, and players", "solo rain",
    SoloStrikes, _STRIKES)
UNMUTE_FORM = form("unmute", "unm", "ends mute and solo, of one or of everything",
    "unmute bell", Unmute, _SOUNDING_OR_ALL)
UNMUTE_STRIKES_FORM = form("unmute", "unm", "lets strikes strike again", "unmute rain",
    UnmuteStrikes, _STRIKES)
METERS_FORM = form("meters", "me", "shows the level of every channel",
    "meters", Meters, takes_time=False)
# fmt: on
