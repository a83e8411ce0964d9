"""Kinds of lines: what each needs of the engine, and whether it waits for the lines before it.

| kind      | standing, panicked | running             | needs       | late, it slips with        |
|-----------|--------------------|---------------------|-------------|----------------------------|
| faders    | next tick          | next tick or grid   | gains alone | later faders               |
| ends      | next tick          | next tick or grid   | a cut stage | later ends                 |
| values    | soonest frame      | soonest or grid     | a new stage | later values               |
| structure | soonest frame      | soonest or grid     | a new stage | later lines of these two   |
| start     | soonest frame      | soonest frame       | a new stage | later lines of these two   |

Lines of one kind may set the same thing, so what was typed last has to act last.

Any of them may name its beat (`at`, `in`). While the piece is stopped it then waits until the piece
gets there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import NamedTuple

from ergon.repl.language.automating import Automate, StopLfo
from ergon.repl.language.commands import Command
from ergon.repl.language.levels import (
    Gain,
    GainStrikes,
    Mute,
    MuteStrikes,
    Solo,
    SoloStrikes,
    Unmute,
    UnmuteStrikes,
)
from ergon.repl.language.matter import Set
from ergon.repl.language.mixing import Fade, MovePan
from ergon.repl.language.recording import Guide
from ergon.repl.language.stopping import Damp, Hush, Rest
from ergon.repl.language.transport import Nudge, Tempo


class LineKind(Enum):
    """What a line changes, from the least to the most."""

    FADERS = 0  # gains alone
    STOPS = 1  # ends what plays
    VALUES = 2  # values and patterns of existing parts
    STRUCTURE = 3  # the structure of the piece
    START = 4  # starts the piece, or jumps


class KindRule(NamedTuple):
    """How lines of a kind act.

    A kind that `is_quick` needs no new stage, so that it is late only with what it needs; one
    that `is_structural` keeps the order of typing with all others that are.
    """

    is_quick: bool
    is_structural: bool


RULE_BY_KIND: Mapping[LineKind, KindRule] = {
    LineKind.FADERS: KindRule(is_quick=True, is_structural=False),
    LineKind.STOPS: KindRule(is_quick=True, is_structural=False),
    LineKind.VALUES: KindRule(is_quick=False, is_structural=False),
    LineKind.STRUCTURE: KindRule(is_quick=False, is_structural=True),
    LineKind.START: KindRule(is_quick=False, is_structural=True),
}


def must_keep_order(earlier: LineKind, later: LineKind) -> bool:
    """Whether a line of the kind `later` must not overtake one of the kind `earlier` that slips."""
    return earlier is later or (
        RULE_BY_KIND[earlier].is_structural and RULE_BY_KIND[later].is_structural
    )


# Commands that are not listed change structure.
_KIND_BY_COMMAND: Mapping[type[Command], LineKind] = {
    **dict.fromkeys((Gain, Mute, Solo, Unmute), LineKind.FADERS),
    **dict.fromkeys((Hush, Damp), LineKind.STOPS),
    **dict.fromkeys(
        (Set, Automate, StopLfo, Rest, Tempo, Nudge, Fade, MovePan, Guide),
        LineKind.VALUES,
    ),
    **dict.fromkeys((GainStrikes, MuteStrikes, SoloStrikes, UnmuteStrikes), LineKind.VALUES),
}


def kind_of(commands: Sequence[Command], *, has_strike_levels: bool = False) -> LineKind:
    """The kind of a line, or of a block of lines that take effect together.

    A line that ends all mute or solo needs a stage where strikes have levels (`has_strike_levels`).
    """
    command_kinds = {
        _KIND_BY_COMMAND.get(type(command), LineKind.STRUCTURE) for command in commands
    }
    if has_strike_levels and any(isinstance(command, Solo | Unmute) for command in commands):
        command_kinds = {*(command_kinds - {LineKind.FADERS}), LineKind.VALUES}
    if len(command_kinds) == 1:
        return command_kinds.pop()
    # A block that ends what plays and changes something else needs a stage.
    return max(LineKind.VALUES, *command_kinds, key=lambda kind: kind.value)
