"""Gains of what plays: the ratios of faders, which need no stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.session.engine import Change
from ergon.repl.session.waiting_lines import REFUSALS

if TYPE_CHECKING:
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.version import Version
    from ergon.repl.session.waiting_lines import WaitingLine


def gains_at(frame: int, running: RunningVersion, gains: Mapping[int, float]) -> Change:
    """A change of gains alone."""
    return Change(frame, running.stage, running.stage, gains=gains)


def all_gains_at(frame: int, running: RunningVersion) -> Change:
    """A change that sets every gain as a version has it."""
    return gains_at(frame, running, fader_ratios(running))


def fader_ratios(running: RunningVersion) -> dict[int, float]:
    """The ratio of each group of routes, by its number."""
    version = running.version
    parts = enumerate(running.stage.listening.parts())
    return {
        group: version.faders.ratio(version.sounds_as.shown(part, version.piece.instruments))
        for group, part in parts
    }


def changed_ratios(before: RunningVersion, after: RunningVersion) -> dict[int, float]:
    """The groups of routes whose ratio has changed; all groups if the mixer is new."""
    old = fader_ratios(before) if after.stage.network is before.stage.network else {}
    return {group: to for group, to in fader_ratios(after).items() if to != old.get(group)}


def with_faders(running: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
    """A version with the faders that lines move. Raises one of `REFUSALS` if it lacks what they
    name.
    """
    version = running.version
    for one in lines:
        made = one.edit(version, one.beat)
        version = replace(version, faders=made.faders, number=made.number, line=made.line)
    return replace(running, version=version, skipped_from=None)


def can_move(running: RunningVersion, lines: Sequence[WaitingLine]) -> bool:
    """Whether a version has everything whose faders lines move."""
    try:
        with_faders(running, lines)
    except REFUSALS:
        return False
    return True


def faded(running: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
    """A version with the faders that lines move, or as it is if it lacks what they name."""
    try:
        return with_faders(running, lines)
    except REFUSALS:
        return running


def on_other_faders(
    made: RunningVersion, base: Version, before: Version, lines: Sequence[WaitingLine]
) -> RunningVersion:
    """A version that lines made of `base`, with the faders that they make of those of `before`."""
    version = made.version
    if not lines:  # the timeline is extended
        number, line = before.number, before.line
        return replace(
            made, version=replace(version, faders=before.faders, number=number, line=line)
        )
    faders = before.faders
    if any(one.sets_all for one in lines) or version.faders != base.faders:
        try:
            on = before
            for one in lines:
                on = one.edit(on, one.beat)
            faders = on.faders
        except REFUSALS:  # it was made from what `before` lacks
            faders = version.faders
    return replace(made, version=replace(version, faders=faders))
