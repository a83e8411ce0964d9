"""Gains of what plays: the ratios of faders, which need no stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.session.engine import Change
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.waiting_lines import REFUSALS

if TYPE_CHECKING:
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.version import Faders, Version
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
    for line in lines:
        edited = line.edit(version, line.beat)
        version = replace(version, faders=edited.faders, number=edited.number, line=edited.line)
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
    result: RunningVersion, before: Version, lines: Sequence[WaitingLine]
) -> RunningVersion:
    """A version that lines made, with the faders that they make of those of `before`."""
    version = result.version
    if not lines:  # the timeline is extended
        number, text = before.number, before.line
        version = replace(version, faders=before.faders, number=number, line=text)
    else:
        *_, faders = faders_after(before, lines)
        version = replace(version, faders=faders)
    return replace(result, version=version)


def faders_after(before: Version, lines: Sequence[WaitingLine]) -> Iterator[Faders]:
    """The faders after each of the lines that follow a version."""
    version = before
    for line in lines:
        base, result = line.base, line.version
        keeps = base is not None and result is not None and base.faders == result.faders
        if not keeps or line.sets_all or line.kind is LineKind.FADERS:
            try:
                version = replace(version, faders=line.edit(version, line.beat).faders)
            except REFUSALS:  # it was made of what this version lacks
                version = version if result is None else replace(version, faders=result.faders)
        yield version.faders
