"""What verbs make of a version: an edit of its texts, or of its faders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.notation.text.bounds import Bounds
from ergon.repl.language import commands as c
from ergon.repl.session.leads import lead_of
from ergon.repl.session.version import GLIDE, Desk, NotTakenError, Version, piece_of
from ergon.scores.edits import keys, matter, names, parts, times
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import solo

if TYPE_CHECKING:
    from ergon.repl.session.commits import Deed
    from ergon.repl.session.running import Running
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage


def same(version: Version, beat: float) -> Version:
    """Nothing is different."""
    return version


def together(commands: Sequence[c.Command]) -> Deed:
    """Several commands as one."""
    own = [DEEDS[type(command)](command) for command in commands]

    def deed(version: Version, beat: float) -> Version:
        for one in own:
            version = one(version, beat)
        return version

    return deed


def hushed(version: Version, beat: float) -> Version:
    """No hand plays on, and nothing strikes."""
    texts = parts.hush(version.texts, version.piece, beat)
    return replace(_read(version, texts), cuts=True)


def _read(version: Version, texts: Texts) -> Version:
    return replace(version, texts=texts, piece=piece_of(texts))


def taken(version: Version, name: str, file: str, channel: str) -> Version:
    """A recording gets the name by which it is played."""
    return _read(version, names.take(version.texts, name, file, channel))


def rehearsed(piece: Piece, name: str) -> list[Stage]:
    """A gesture alone on each key that it is played on, or on the first. Raises StageError."""
    players = (piece.players[play.player] for play in piece.parts if play.what == name)
    on = dict.fromkeys(player.key for player in players) or dict.fromkeys([*piece.keys][:1])
    mix = replace(piece.mix, routes=(), channels=1)
    bare = replace(piece, instruments={}, duet=(), strikes=(), mix=mix)
    return [solo(bare, name, key) for key in on]


# --- what is written -----------------------------------------------------------------------------


def _define(command: c.Define, version: Version, beat: float) -> Texts:
    return names.define(version.texts, command.name, command.words["notation"].text)


def _plays(command: c.Plays, version: Version, beat: float) -> Texts:
    said = command.words["play"].text
    return parts.play(version.texts, version.piece, command.player, beat, said)


def _do(command: c.Do, version: Version, beat: float) -> Texts:
    said = command.words["do"].text
    return parts.transform(version.texts, version.piece, command.player, beat, said)


def _rest(command: c.Rest, version: Version, beat: float) -> Texts:
    return parts.rest(version.texts, version.piece, command.player, beat)


def _tempo(command: c.Tempo, version: Version, beat: float) -> Texts:
    end = "" if command.end is None else f" -> {command.end:.12g}"
    over = command.words["over"].text if command.over is not None else None
    return times.change(version.texts, version.piece, beat, f"{command.bpm:.12g}{end}", over)


def _nudge(command: c.Nudge, version: Version, beat: float) -> Texts:
    """The beat that begins lasts so much longer, and the next ones as before."""
    tempo = version.piece.tempo_map
    bpm = tempo.bpm(beat)
    by = tempo.seconds(tempo.after(beat, command.by)) - tempo.seconds(beat)
    length = 60.0 / bpm + by
    if not 30.0 / bpm <= length <= 120.0 / bpm:
        raise NotTakenError("a nudge is at most half a beat; `tempo` changes more")
    texts = times.change(version.texts, version.piece, beat, f"{60.0 / length:.12g}")
    return times.change(texts, piece_of(texts), beat + 1.0, f"{bpm:.12g}")


def _couple(command: c.Couple, version: Version, beat: float) -> Texts:
    stiffness, viscosity = f"{command.stiffness:.12g}N/m", f"{command.viscosity:.12g}Ns/m"
    ends = command.a, command.b
    return keys.couple(version.texts, version.piece, beat, *ends, stiffness, viscosity)


def _uncouple(command: c.Uncouple, version: Version, beat: float) -> Texts:
    return keys.uncouple(version.texts, version.piece, beat, command.a, command.b)


def _set(command: c.Set, version: Version, beat: float) -> Texts:
    value = command.words["change"].text
    return matter.set_value(version.texts, version.piece, command.target, value)


def _glided(command: c.Set) -> Deed:
    """A parameter is set, and takes its time."""

    def deed(version: Version, beat: float) -> Version:
        made = _read(version, _set(command, version, beat))
        if command.over is None:
            return made
        tempo = version.piece.tempo_map
        seconds = tempo.seconds(tempo.after(beat, command.over)) - tempo.seconds(beat)
        return replace(made, glide=max(GLIDE, seconds))

    return deed


def _seed(command: c.Seed, version: Version, beat: float) -> Texts:
    return names.seed(version.texts, command.seed)


_EDITS: Mapping[type[c.Command], Callable[[Any, Version, float], Texts]] = {
    c.Plays: _plays,
    c.Do: _do,
    c.Rest: _rest,
    c.Tempo: _tempo,
    c.Nudge: _nudge,
    c.Couple: _couple,
    c.Uncouple: _uncouple,
    c.Seed: _seed,
}


# --- faders --------------------------------------------------------------------------------------


def _gain(command: c.Gain, desk: Desk, parts_of: frozenset[str]) -> Desk:
    if command.name is None:
        return replace(desk, master=command.ratio)
    return replace(desk, gains={**desk.gains, **dict.fromkeys(parts_of, command.ratio)})


def _mute(command: c.Mute, desk: Desk, parts_of: frozenset[str]) -> Desk:
    return replace(desk, muted=desk.muted | parts_of)


def _solo(command: c.Solo, desk: Desk, parts_of: frozenset[str]) -> Desk:
    return replace(desk, solo=parts_of)


def _unmute(command: c.Unmute, desk: Desk, parts_of: frozenset[str]) -> Desk:
    if command.name is None:
        return replace(desk, muted=frozenset(), solo=frozenset())
    return replace(desk, muted=desk.muted - parts_of, solo=frozenset())


_FADES: Mapping[type[c.Command], Callable[[Any, Desk, frozenset[str]], Desk]] = {
    c.Gain: _gain,
    c.Mute: _mute,
    c.Solo: _solo,
    c.Unmute: _unmute,
}


def _parts(version: Version, name: str | None) -> frozenset[str]:
    """An instrument, or those that a player's key touches."""
    piece = version.piece
    if name is None:
        return frozenset()
    if name in piece.instruments:
        return frozenset([name])
    key = piece.players[name].key
    touched = frozenset(
        end.part
        for instrument in piece.instruments.values()
        for module in instrument.modules
        for end in _ends(module.fields.get("between"), key)
    )
    if not touched:
        raise NotTakenError(f"{name}'s key {key} touches no instrument")
    return touched


def _ends(between: Any, key: str) -> list[Any]:
    """The other ends of a link of a key."""
    if not between or all(end.part != key for end in between):
        return []
    return [end for end in between if end.part != key]


# --- all of it -----------------------------------------------------------------------------------


def _edit(command: c.Command) -> Deed:
    edit = _EDITS[type(command)]
    return lambda version, beat: _read(version, edit(command, version, beat))


def _defined_alone(command: c.Define) -> Deed:
    """A gesture is tried on its keys before it is believed."""

    def deed(version: Version, beat: float) -> Version:
        made = _read(version, _define(command, version, beat))
        rehearsed(made.piece, command.name)
        return made

    return deed


def _fade(command: Any) -> Deed:
    fade = _FADES[type(command)]
    return lambda version, beat: replace(
        version, desk=fade(command, version.desk, _parts(version, command.name))
    )


def _guide(command: c.Guide) -> Deed:
    """A hand is led by another player's part, or no longer."""
    lead = None if command.by is None else lead_of(command)

    def deed(version: Version, beat: float) -> Version:
        leads = dict(version.leads)
        if lead is not None:
            leads[command.player] = lead
        elif leads.pop(command.player, None) is None:
            raise NotTakenError(f"nobody leads {command.player}")
        return replace(version, leads=leads)

    return deed


def _load(command: c.Load) -> Deed:
    files: list[Texts] = []

    def deed(version: Version, beat: float) -> Version:
        if not files:
            before = version.texts.bounds
            trust = before is not None and before.trusts
            folder = Path(command.file).parent
            files.append(_file(command.file, Bounds.around(folder, trust=trust)))
        return replace(_read(version, files[0]), read=files[0])

    return deed


def _reload(command: c.Reload) -> Deed:
    """The score's own file, and those that it uses, as they are when the line is typed."""
    files: dict[str, Texts] = {}

    def deed(version: Version, beat: float) -> Version:
        path = version.texts.path
        if path not in files:
            files[path] = _file(path, version.texts.bounds)
        return replace(_read(version, files[path]), read=files[path])

    return deed


def _file(path: str, bounds: Bounds | None) -> Texts:
    try:
        return Texts.read(path, bounds)
    except OSError as error:
        raise NotTakenError(f"{path}: {error.strerror}") from None


def _hush(command: c.Hush) -> Deed:
    return hushed


def _damp(command: c.Damp) -> Deed:
    return lambda version, beat: replace(hushed(version, beat), damp=command.time)


DEEDS: Mapping[type[c.Command], Callable[[Any], Deed]] = {
    **dict.fromkeys(_EDITS, _edit),
    **dict.fromkeys(_FADES, _fade),
    c.Set: _glided,
    c.Guide: _guide,
    c.Define: _defined_alone,
    c.Hush: _hush,
    c.Damp: _damp,
    c.Load: _load,
    c.Reload: _reload,
}


READ = (c.Load, c.Reload)


# --- what is said of it --------------------------------------------------------------------------


def said(command: c.Command, made: Running) -> str:
    """A command that was taken, in a few words."""
    if isinstance(command, c.Define):
        return _defined(command, made)
    if isinstance(command, c.Plays):
        return f"{command.player}: {command.words['play'].text}"
    if isinstance(command, c.Guide):
        by = command.by
        return f"{command.player}: free" if by is None else f"{command.player}: led by {by}"
    return ""


def _defined(command: c.Define, made: Running) -> str:
    gesture = made.version.piece.gestures[command.name]
    tempo, rate = made.version.piece.tempo_map, made.stage.rate
    count = len(gesture.points)
    last = gesture.points[-1].at
    if "throw" in {point.curve for point in gesture.points[1:]}:
        return f"{command.name}: {count} points"
    seconds = last.beats * 60.0 / tempo.bpm(0.0) + last.seconds
    return f"{command.name}: {count} points, {int(seconds * rate + 0.5):,} ergons"
