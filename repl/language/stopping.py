"""Verbs that end what sounds."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, Command
from ergon.repl.language.forms import Slot, form


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


# fmt: off
REST_FORM = form("rest", "res", "the player finishes this gesture and begins no other",
    "rest ada", Rest, Slot("player", "PLAYER|all", values.PLAYER_OR_ALL))
HUSH_FORM = form("hush", "hu", "all hands lift; what sounds rings out", "hush", Hush)
DAMP_FORM = form("damp", "d", "adds viscosity everywhere until all is silent",
    "damp 3s", Damp, Slot("time", "TIME", amounts.DURATION_VALUE))
PANIC_FORM = form("panic", "pa", "silence at once, no force on any key",
    "panic", Panic, takes_time=False)
RELEASE_FORM = form("release", "rele", "switches sound and forces on again, after a stop",
    "release", Release, takes_time=False)
# fmt: on
