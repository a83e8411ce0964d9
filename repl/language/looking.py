"""Verbs that look at the piece."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.repl.language import values
from ergon.repl.language.commands import Command
from ergon.repl.language.forms import OFF_SLOT, SHOWN_SLOT, Slot, form


@dataclass(frozen=True, slots=True)
class Look(Command):
    """Draw a gesture or a take, or show where a name is defined; None: show which player plays
    which gesture on each beat.
    """

    name: str | None


@dataclass(frozen=True, slots=True)
class Trace(Command):
    """Draw where a player's key was."""

    name: str


@dataclass(frozen=True, slots=True)
class TraceOn(Command):
    """Keep the drawing of a player's key above the status line; None ends it."""

    name: str | None = None


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


# fmt: off
LOOK_FORM = form("?", "?", "draws a gesture, a name's definition, or alone two bars",
    "? lean", Look, SHOWN_SLOT, takes_time=False)
SCOPE_FORM = form("scope", "sc", "draws where a player's key was in the last two seconds",
    "scope ada", Trace, Slot("name", "NAME", values.PLAYER_KEY_OR_INSTRUMENT), takes_time=False)
SCOPE_ON_FORM = form("scope", "sc", "keeps that drawing above the status line",
    "scope remi on", TraceOn, Slot("name", "NAME", values.PLAYER_KEY_OR_INSTRUMENT),
    Slot("", "", None, "on"), takes_time=False)
SCOPE_OFF_FORM = form("scope", "sc", "ends it", "scope off", TraceOn, OFF_SLOT, takes_time=False)
PY_FORM = form("py", "py", "evaluates Python in which `session` and `piece` are known",
    "py session.state().tempo", Py,
    Slot("expression", "EXPRESSION", values.EXPRESSION_VALUE, takes_many=True), takes_time=False)
QUIT_FORM = form("quit", "qui", "all hands lift, and the session ends",
    "quit", Quit, takes_time=False)
# fmt: on
