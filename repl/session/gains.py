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
    """A change that sets every gain to that of a version."""
    return gains_at(frame, running, fader_ratios(running))


def fader_ratios(running: RunningVersion) -> dict[int, float]:
    """The ratio of each group of routes, by its number."""
    version = running.version
    numbered_parts = enumerate(running.stage.listening.parts())
    return {
        group: version.faders.ratio(version.sounds_as.shown_name(part, version.piece.instruments))
        for group, part in numbered_parts
    }


def changed_ratios(
    running_before: RunningVersion, running_after: RunningVersion
) -> dict[int, float]:
    """The groups of routes whose ratio has changed; all groups if the mixer is new."""
    old_ratios = (
        fader_ratios(running_before)
        if running_after.stage.network is running_before.stage.network
        else {}
    )
    return {
        group: ratio
        for group, ratio in fader_ratios(running_after).items()
        if ratio != old_ratios.get(group)
    }


def with_faders(running: RunningVersion, waiting_lines: Sequence[WaitingLine]) -> RunningVersion:
    """A version with the faders that lines move. Raises one of `REFUSALS` if it lacks what they
    name.
    """
    version = running.version
    for line in waiting_lines:
        edited_version = line.edit(version, line.beat)
        version = replace(
            version,
            faders=edited_version.faders,
            number=edited_version.number,
            line=edited_version.line,
        )
    return replace(running, version=version, skipped_from=None)


def can_move_faders(running: RunningVersion, waiting_lines: Sequence[WaitingLine]) -> bool:
    """Whether a version has everything whose faders lines move."""
    try:
        with_faders(running, waiting_lines)
    except REFUSALS:
        return False
    return True


def with_known_faders(
    running: RunningVersion, waiting_lines: Sequence[WaitingLine]
) -> RunningVersion:
    """A version with the faders that lines move, or as it is if it lacks what they name."""
    try:
        return with_faders(running, waiting_lines)
    except REFUSALS:
        return running


def with_rebased_faders(
    new_running: RunningVersion, old_version: Version, waiting_lines: Sequence[WaitingLine]
) -> RunningVersion:
    """The version made by lines, with the faders that these lines give when they start from the
    faders of `old_version`.
    """
    version = new_running.version
    if not waiting_lines:  # the timeline is extended
        number, line = old_version.number, old_version.line
        version = replace(version, faders=old_version.faders, number=number, line=line)
    else:
        *_, faders = faders_after(old_version, waiting_lines)
        version = replace(version, faders=faders)
    return replace(new_running, version=version)


def faders_after(version_before: Version, waiting_lines: Sequence[WaitingLine]) -> Iterator[Faders]:
    """The faders after each of the lines that follow a version."""
    version = version_before
    for waiting_line in waiting_lines:
        base_version, result_version = waiting_line.version_before, waiting_line.version
        is_unchanged = (
            base_version is not None
            and result_version is not None
            and base_version.faders == result_version.faders
        )
        if (
            not is_unchanged
            or waiting_line.restores_version
            or waiting_line.kind is LineKind.FADERS
        ):
            try:
                version = replace(
                    version, faders=waiting_line.edit(version, waiting_line.beat).faders
                )
            except REFUSALS:  # the line needs parts that this version lacks
                version = (
                    version
                    if result_version is None
                    else replace(version, faders=result_version.faders)
                )
        yield version.faders
