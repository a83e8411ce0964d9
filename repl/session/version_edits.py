"""Version edits: what each verb that changes the music makes of a version."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.notation.text.bounds import Bounds
from ergon.repl.language import commands as c
from ergon.repl.session import midi_maps
from ergon.repl.session.guidance import guide_of
from ergon.repl.session.rehearsing import keys_for, rehearse
from ergon.repl.session.version import GLIDE, Faders, NotTakenError, Version, piece_of
from ergon.scores.edits import keys, matter, merging, names, parts, times
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.repl.session.commits import VersionEdit
    from ergon.repl.session.running import Running


def unchanged(version: Version, beat: float) -> Version:
    """The same version."""
    return version


def combined(commands: Sequence[c.Command]) -> VersionEdit:
    """Several commands as one."""
    own = [VERSION_EDITS[type(command)](command) for command in commands]

    def edit(version: Version, beat: float) -> Version:
        for one in own:
            version = one(version, beat)
        return version

    return edit


def hushed(version: Version, beat: float) -> Version:
    """No player plays on, and no strikes follow."""
    texts = parts.hush(version.texts, version.piece, beat)
    return replace(_with_texts(version, texts), cuts=True)


def _with_texts(version: Version, texts: Texts) -> Version:
    return replace(version, texts=texts, piece=piece_of(texts))


def with_take(version: Version, name: str, file: str, channel: str) -> Version:
    """The version with a take of a name."""
    return _with_texts(version, names.take(version.texts, name, file, channel))


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
    """The beat that begins lasts longer by a length; the next ones have the old tempo."""
    tempo = version.piece.tempo_map
    bpm = tempo.bpm(beat)
    by = tempo.seconds(tempo.after(beat, command.by)) - tempo.seconds(beat)
    length = 60.0 / bpm + by
    if not 30.0 / bpm <= length <= 120.0 / bpm:
        raise NotTakenError(
            "this nudge is too large: it may make one beat half or twice "
            "as long; `tempo` changes more"
        )
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


def _set_gliding(command: c.Set) -> VersionEdit:
    """Set a parameter, which glides `over` a length."""

    def edit(version: Version, beat: float) -> Version:
        made = _with_texts(version, _set(command, version, beat))
        if command.over is None:
            return made
        tempo = version.piece.tempo_map
        seconds = tempo.seconds(tempo.after(beat, command.over)) - tempo.seconds(beat)
        return replace(made, glide=max(GLIDE, seconds))

    return edit


def _seed(command: c.Seed, version: Version, beat: float) -> Texts:
    return names.seed(version.texts, command.seed)


_TEXT_EDITS: Mapping[type[c.Command], Callable[[Any, Version, float], Texts]] = {
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


def _gain(command: c.Gain, faders: Faders, names: frozenset[str]) -> Faders:
    if command.name is None:
        return replace(faders, master=command.ratio)
    return replace(faders, gains={**faders.gains, **dict.fromkeys(names, command.ratio)})


def _mute(command: c.Mute, faders: Faders, names: frozenset[str]) -> Faders:
    return replace(faders, muted=faders.muted | names)


def _solo(command: c.Solo, faders: Faders, names: frozenset[str]) -> Faders:
    return replace(faders, solo=names)


def _unmute(command: c.Unmute, faders: Faders, names: frozenset[str]) -> Faders:
    if command.name is None:
        return replace(faders, muted=frozenset(), solo=frozenset())
    return replace(faders, muted=faders.muted - names, solo=frozenset())


_FADER_EDITS: Mapping[type[c.Command], Callable[[Any, Faders, frozenset[str]], Faders]] = {
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
        raise NotTakenError(
            f"{name} plays the key {key}, which touches no instrument: name an instrument"
        )
    return touched


def _ends(between: Any, key: str) -> list[Any]:
    """The ends of a link that are not the key; none where the key is not linked."""
    if not between or all(end.part != key for end in between):
        return []
    return [end for end in between if end.part != key]


# --- all of it -----------------------------------------------------------------------------------


def _text_edit(command: c.Command) -> VersionEdit:
    change = _TEXT_EDITS[type(command)]
    return lambda version, beat: _with_texts(version, change(command, version, beat))


def _define_rehearsed(command: c.Define) -> VersionEdit:
    """Define a gesture, and rehearse it on its keys."""

    def edit(version: Version, beat: float) -> Version:
        made = _with_texts(version, _define(command, version, beat))
        rehearse(made.piece, command.name)
        return made

    return edit


def _fader_edit(command: Any) -> VersionEdit:
    change = _FADER_EDITS[type(command)]
    return lambda version, beat: replace(
        version, faders=change(command, version.faders, _parts(version, command.name))
    )


def _guide(command: c.Guide) -> VersionEdit:
    """Guide a hand along another player's part, or end that."""
    guide = None if command.by is None else guide_of(command)

    def edit(version: Version, beat: float) -> Version:
        guides = dict(version.guides)
        if guide is not None:
            guides[command.player] = guide
        elif guides.pop(command.player, None) is None:
            raise NotTakenError(f"{command.player}'s hand is not guided")
        return replace(version, guides=guides)

    return edit


def _map(command: midi_maps.Map) -> VersionEdit:
    """Map a MIDI controller or notes."""
    return lambda version, beat: replace(version, maps=midi_maps.with_map(version, command))


def _unmap(command: c.Unmap) -> VersionEdit:
    """End a map."""
    return lambda version, beat: replace(version, maps=midi_maps.without_map(version, command.name))


def _load(command: c.Load) -> VersionEdit:
    files: list[Texts] = []

    def edit(version: Version, beat: float) -> Version:
        if not files:
            before = version.texts.bounds
            trust = before is not None and before.trusts
            folder = Path(command.file).parent
            files.append(_file(command.file, Bounds.around(folder, trust=trust)))
        return replace(_with_texts(version, files[0]), read=files[0], base=files[0])

    return edit


def _reload(command: c.Reload) -> VersionEdit:
    """Read the score's files again, as they are when the line is typed; what was typed stays.

    A place that was typed and has changed in the files too is as the files say.
    """
    files: dict[str, Texts] = {}

    def edit(version: Version, beat: float) -> Version:
        path = version.texts.path
        if path not in files:
            files[path] = _file(path, version.texts.bounds)
        now = files[path]
        piece_of(now)  # its own mistakes come before those of the merge
        texts, dropped = merging.merged(version.base or version.texts, now, version.texts)
        made = _with_texts(version, texts)
        return replace(made, read=now, base=now, dropped=tuple(dropped))

    return edit


def _file(path: str, bounds: Bounds | None) -> Texts:
    try:
        return Texts.read(path, bounds)
    except OSError as error:
        raise NotTakenError(f"{path}: {error.strerror}") from None


def _hush(command: c.Hush) -> VersionEdit:
    return hushed


def _damp(command: c.Damp) -> VersionEdit:
    return lambda version, beat: replace(hushed(version, beat), damp=command.time)


VERSION_EDITS: Mapping[type[c.Command], Callable[[Any], VersionEdit]] = {
    **dict.fromkeys(_TEXT_EDITS, _text_edit),
    **dict.fromkeys(_FADER_EDITS, _fader_edit),
    c.Set: _set_gliding,
    c.Guide: _guide,
    c.MapControl: _map,
    c.MapNotes: _map,
    c.Unmap: _unmap,
    c.Define: _define_rehearsed,
    c.Hush: _hush,
    c.Damp: _damp,
    c.Load: _load,
    c.Reload: _reload,
}


READS_FILES = (c.Load, c.Reload)


# --- what is said of it --------------------------------------------------------------------------


def summary(command: c.Command, made: Running) -> str:
    """What a reply says of a command beyond `ok`."""
    if isinstance(command, c.Define):
        return _defined(command, made)
    if isinstance(command, c.Plays):
        return f"{command.player}: {command.words['play'].text}"
    if isinstance(command, c.Guide):
        by = command.by
        return (
            f"{command.player}: no longer guided"
            if by is None
            else f"{command.player}: guided by {by}"
        )
    return ""


def _defined(command: c.Define, made: Running) -> str:
    piece = made.version.piece
    gesture = piece.gestures[command.name]
    said = f"{command.name}: {len(gesture.points)} points"
    last = gesture.points[-1].at
    if "throw" not in {point.curve for point in gesture.points[1:]}:
        seconds = last.beats * 60.0 / piece.tempo_map.bpm(0.0) + last.seconds
        said += f", {int(seconds * made.stage.rate + 0.5):,} ergons"
    if any(play.what == command.name for play in piece.parts):
        return said
    able = keys_for(piece, command.name)
    if len(able) == len(piece.keys):
        return said
    return f"{said}; nobody plays it yet, and of the keys only {', '.join(able)} can follow it"
