"""Version edits of levels: those of instruments, by faders, and those of strikes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

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
from ergon.repl.session.edit_table import edits_faders, instruments_of, makes_edit
from ergon.repl.session.strike_levels import StrikeLevels, unnumbered
from ergon.repl.session.version import Faders, NotTakenError, Version
from ergon.scores.edits.strikes import strikes_named

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit


@edits_faders(Gain)
def _set_gain(command: Gain, faders: Faders, instrument_names: frozenset[str]) -> Faders:
    if command.name is None:
        return replace(faders, master=command.ratio)
    return replace(faders, gains={**faders.gains, **dict.fromkeys(instrument_names, command.ratio)})


@edits_faders(Mute)
def _mute(command: Mute, faders: Faders, instrument_names: frozenset[str]) -> Faders:
    return replace(faders, muted=faders.muted | instrument_names)


@makes_edit(Solo)
def _solo(command: Solo) -> VersionEdit:
    def edit(version: Version, beat: float) -> Version:
        faders = replace(version.faders, solo=instruments_of(version, command.name))
        levels = replace(version.strike_levels, solo=frozenset())
        return _with_levels(version, faders, levels)

    return edit


@makes_edit(Unmute)
def _unmute(command: Unmute) -> VersionEdit:
    def edit(version: Version, beat: float) -> Version:
        name, faders, levels = command.name, version.faders, version.strike_levels
        muted_instruments = (
            faders.muted - instruments_of(version, name) if name else frozenset[str]()
        )
        muted_strikes = levels.muted if name else frozenset[str]()
        faders = replace(faders, muted=muted_instruments, solo=frozenset())
        return _with_levels(version, faders, replace(levels, muted=muted_strikes, solo=frozenset()))

    return edit


@makes_edit(GainStrikes)
def _gain_strikes(command: GainStrikes) -> VersionEdit:
    def edit(version: Version, beat: float) -> Version:
        levels = version.strike_levels
        gains = {**levels.gains, _level_key(version, command.name): command.ratio}
        return replace(version, strike_levels=replace(levels, gains=gains))

    return edit


@makes_edit(MuteStrikes)
def _mute_strikes(command: MuteStrikes) -> VersionEdit:
    def edit(version: Version, beat: float) -> Version:
        levels = version.strike_levels
        muted_strikes = levels.muted | {_level_key(version, command.name)}
        return replace(version, strike_levels=replace(levels, muted=muted_strikes))

    return edit


@makes_edit(SoloStrikes)
def _solo_strikes(command: SoloStrikes) -> VersionEdit:
    """Silence all other strikes, and instruments of players that these strikes do not play."""

    def edit(version: Version, beat: float) -> Version:
        level_key = _level_key(version, command.name)
        quiet_instruments = _played_instruments(version) - _struck_instruments(version, level_key)
        solo_instruments = (
            frozenset(version.piece.instruments) - quiet_instruments
            if quiet_instruments
            else frozenset[str]()
        )
        faders = replace(version.faders, solo=solo_instruments)
        levels = replace(version.strike_levels, solo=frozenset([level_key]))
        return _with_levels(version, faders, levels)

    return edit


@makes_edit(UnmuteStrikes)
def _unmute_strikes(command: UnmuteStrikes) -> VersionEdit:
    def edit(version: Version, beat: float) -> Version:
        levels, faders = version.strike_levels, version.faders
        if levels.solo:
            faders = replace(faders, solo=frozenset())
        muted_strikes = levels.muted - {_level_key(version, command.name)}
        return _with_levels(version, faders, replace(levels, muted=muted_strikes, solo=frozenset()))

    return edit


def _with_levels(version: Version, faders: Faders, levels: StrikeLevels) -> Version:
    return replace(version, faders=faders, strike_levels=levels)


def _level_key(version: Version, strikes_name: str) -> str:
    """The name under which strikes have their level. Raises NotTakenError if they are gone."""
    strikes_names = {strikes.name for strikes in version.piece.strikes}
    if strikes_name not in strikes_names:
        raise NotTakenError(f"{strikes_name} was removed by another line")
    base_name = unnumbered(strikes_name)
    return base_name if base_name in strikes_names else strikes_name


def _struck_instruments(version: Version, name: str) -> frozenset[str]:
    """The instruments that strikes strike."""
    return frozenset[str]().union(
        *(strikes.parts for strikes in strikes_named(version.piece, name))
    )


def _played_instruments(version: Version) -> frozenset[str]:
    """The instruments that the keys of players are linked to."""
    played_parts: set[str] = set()
    for player in version.piece.players:
        try:
            played_parts |= instruments_of(version, player)
        except NotTakenError:  # a key that touches nothing
            continue
    return frozenset(played_parts)
