"""Version edits: for each verb that changes the music, the edit of a version."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.notation.text.bounds import FileBounds
from ergon.notation.text.edit import EditError
from ergon.repl.language.automating import Automate, StopLfo
from ergon.repl.language.commands import Command
from ergon.repl.language.hearing import Hear
from ergon.repl.language.library import Use
from ergon.repl.language.mapping import MapControl, MapNotes, Unmap
from ergon.repl.language.matter import Couple, Set, Uncouple
from ergon.repl.language.playing import Define, Do, Plays
from ergon.repl.language.recording import Guide
from ergon.repl.language.retuning import Retune
from ergon.repl.language.stopping import Damp, Hush, Rest
from ergon.repl.language.striking import DoStrikes, StrikeModules
from ergon.repl.language.transport import Nudge, SetMeter, Tempo
from ergon.repl.language.versions import Load, Reload, Scene, Seed
from ergon.repl.session import block_edits as block_edits
from ergon.repl.session import family_edits, midi_maps
from ergon.repl.session import level_edits as level_edits
from ergon.repl.session import phrase_edits as phrase_edits
from ergon.repl.session import retuning_edits as retuning_edits
from ergon.repl.session import scene_edits as scene_edits
from ergon.repl.session import structure_edits as structure_edits
from ergon.repl.session.edit_table import VERSION_EDITS as VERSION_EDITS
from ergon.repl.session.edit_table import edits_texts, makes_edit, with_texts
from ergon.repl.session.guidance import guide_of
from ergon.repl.session.rehearsing import keys_for, rehearsal_stage
from ergon.repl.session.version import (
    GLIDE_DURATION,
    NotTakenError,
    Version,
    piece_from_files,
    piece_of,
)
from ergon.scores.edits import (
    automation,
    families,
    keys,
    matter,
    merging,
    names,
    parts,
    renaming,
    strikes,
    times,
    transformed,
)
from ergon.scores.edits.matter import TRANSPOSE
from ergon.scores.edits.scenes import has_events_from
from ergon.scores.edits.texts import Texts
from ergon.scores.gesture import space_path
from ergon.scores.staging.automating import value_on_beat

if TYPE_CHECKING:
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import VersionEdit

# A shorter glide [s] is not written into the score: a controller sends hundreds of them.
_WRITTEN_GLIDE_MIN = 0.1


def unchanged_version(version: Version, beat: float) -> Version:
    """Return the same version."""
    return version


def combine_edits(commands: Sequence[Command]) -> VersionEdit:
    """Combine several commands into one edit."""
    version_edits = [VERSION_EDITS[type(command)](command) for command in commands]

    def edit(version: Version, beat: float) -> Version:
        for apply_edit in version_edits:
            version = apply_edit(version, beat)
        return version

    return edit


def end_all_playing(version: Version, beat: float) -> Version:
    """End all players and strikes, and all rules of blocks."""
    texts = parts.end_all_parts(version.texts, version.piece, beat)
    return replace(with_texts(version, texts), ends_gestures=True, rules={})


def with_take(version: Version, name: str, file: str, channel: str) -> Version:
    """The version with a take of this name."""
    return with_texts(version, names.define_take(version.texts, name, file, channel))


# --- texts ---------------------------------------------------------------------------------------


def _define(command: Define, version: Version, beat: float) -> Texts:
    return names.define(version.texts, command.name, command.words["notation"].text)


@edits_texts(Plays)
def _plays(command: Plays, version: Version, beat: float) -> Texts:
    assert command.entry is not None  # every line has one
    return parts.play(version.texts, version.piece, command.player, beat, command.entry)


@edits_texts(Do)
def _transform_part(command: Do, version: Version, beat: float) -> Texts:
    return parts.transform(
        version.texts, version.piece, command.player, beat, command.transform_texts
    )


@edits_texts(StrikeModules)
def _strike_modules(command: StrikeModules, version: Version, beat: float) -> Texts:
    # First what is struck: a text that strikes what is not there cannot be read for its routes.
    texts, piece = families.with_definitions(version.texts, version.piece, command.struck)
    texts = strikes.strike(texts, piece, command.name, beat, command.fields)
    return families.with_routes(texts, piece, command.struck)


@edits_texts(DoStrikes)
def _transform_strikes(command: DoStrikes, version: Version, beat: float) -> Texts:
    return transformed.transform(version.texts, version.piece, command.name, beat, command.do)


@edits_texts(Automate)
def _automate(command: Automate, version: Version, beat: float) -> Texts:
    return automation.automate(
        version.texts, version.piece, command.target, beat, command.kind, command.fields
    )


@edits_texts(StopLfo)
def _stop_lfo(command: StopLfo, version: Version, beat: float) -> Texts:
    return automation.end_automation(version.texts, version.piece, command.target, beat)


@edits_texts(Rest)
def _rest(command: Rest, version: Version, beat: float) -> Texts:
    return parts.end_part(version.texts, version.piece, command.player, beat)


@edits_texts(Tempo)
def _change_tempo(command: Tempo, version: Version, beat: float) -> Texts:
    end_text = "" if command.end is None else f" -> {command.end:.12g}"
    ramp_length = command.words["over"].text if command.over is not None else None
    return times.change_tempo(
        version.texts, version.piece, beat, f"{command.bpm:.12g}{end_text}", ramp_length
    )


@edits_texts(SetMeter)
def _change_meter(command: SetMeter, version: Version, beat: float) -> Texts:
    return times.change_meter(version.texts, version.piece, beat, str(command.meter))


@edits_texts(Nudge)
def _nudge(command: Nudge, version: Version, beat: float) -> Texts:
    """Make the beat that begins longer (or shorter) by a length; the next beats have the old
    tempo.
    """
    tempo_map = version.piece.tempo_map
    bpm = tempo_map.bpm(beat)
    shift_seconds = tempo_map.seconds(tempo_map.after(beat, command.by)) - tempo_map.seconds(beat)
    beat_length = 60.0 / bpm + shift_seconds
    if not 30.0 / bpm <= beat_length <= 120.0 / bpm:
        raise NotTakenError(
            "this nudge is too large: it may make one beat half or twice "
            "as long; `tempo` changes more"
        )
    texts = times.change_tempo(version.texts, version.piece, beat, f"{60.0 / beat_length:.12g}")
    return times.change_tempo(texts, piece_of(texts), beat + 1.0, f"{bpm:.12g}")


@edits_texts(Couple)
def _couple(command: Couple, version: Version, beat: float) -> Texts:
    stiffness, viscosity = f"{command.stiffness:.12g}N/m", f"{command.viscosity:.12g}Ns/m"
    key_names = command.a, command.b
    return keys.couple(version.texts, version.piece, beat, *key_names, stiffness, viscosity)


@edits_texts(Uncouple)
def _uncouple(command: Uncouple, version: Version, beat: float) -> Texts:
    return keys.uncouple(version.texts, version.piece, beat, command.a, command.b)


def _set(command: Set, version: Version, beat: float) -> Texts:
    value = command.words["change"].text
    texts = automation.end_if_automated(version.texts, version.piece, command.target, beat)
    return matter.set_value(texts, version.piece, command.target, value)


@makes_edit(Set)
def _set_gliding(command: Set) -> VersionEdit:
    """Set a parameter, which may glide for the length `over`: in the score's time if that runs."""

    def edit(version: Version, edit_beat: float) -> Version:
        if command.over is None:
            return with_texts(version, _set(command, version, edit_beat))
        tempo_map, command_words = version.piece.tempo_map, command.words
        duration = tempo_map.seconds(tempo_map.after(edit_beat, command.over)) - tempo_map.seconds(
            edit_beat
        )
        is_written = duration >= _WRITTEN_GLIDE_MIN and not command.target.endswith(TRANSPOSE)
        if version.is_running and is_written:
            value, glide_length = command_words["change"].text, command_words["over"].text
            glide_arguments = (
                command.target,
                edit_beat,
                value,
                {"over": glide_length},
                value_on_beat,
            )
            return with_texts(
                version, automation.glide(version.texts, version.piece, *glide_arguments)
            )
        automation.check_can_glide(version.piece, command.target)
        edited_version = with_texts(version, _set(command, version, edit_beat))
        return replace(edited_version, glide_duration=max(GLIDE_DURATION, duration))

    return edit


@edits_texts(Seed)
def _seed(command: Seed, version: Version, beat: float) -> Texts:
    return names.set_seed(version.texts, command.seed)


# --- whole versions ------------------------------------------------------------------------------


@makes_edit(Define)
def _define_rehearsed(command: Define) -> VersionEdit:
    """Define a gesture, and check that its keys can follow it."""

    def edit(version: Version, beat: float) -> Version:
        edited_version = with_texts(version, _define(command, version, beat))
        for name in space_path.played_names(command.name, edited_version.piece.gestures):
            rehearsal_stage(edited_version.piece, name)
        return edited_version

    return edit


@makes_edit(Guide)
def _guide(command: Guide) -> VersionEdit:
    """Guide a hand along another player's part, or end the guidance."""
    guide = None if command.by is None else guide_of(command)

    def edit(version: Version, beat: float) -> Version:
        guides = dict(version.guides)
        if guide is not None:
            guides[command.player] = guide
        elif guides.pop(command.player, None) is None:
            raise NotTakenError(f"{command.player}'s hand is not guided")
        return replace(version, guides=guides)

    return edit


@makes_edit(Hear)
@makes_edit(MapControl)
@makes_edit(MapNotes)
def _add_map(command: midi_maps.Map) -> VersionEdit:
    """Map a MIDI controller or notes, or let what `hear` strikes be ready."""

    def edit(version: Version, beat: float) -> Version:
        struck_paths = [] if isinstance(command, MapControl) else [command.target]
        played_texts = families.with_routes(version.texts, version.piece, struck_paths)
        if isinstance(command, Hear) or (isinstance(command, MapNotes) and command.impulse is None):
            played_texts = families.with_act_modules(played_texts, command.target)
        mapped_version = (
            version if played_texts is version.texts else with_texts(version, played_texts)
        )
        return replace(mapped_version, maps=midi_maps.with_map(mapped_version, command))

    return edit


@makes_edit(Unmap)
def _unmap(command: Unmap) -> VersionEdit:
    """End a map."""
    return lambda version, beat: replace(version, maps=midi_maps.without_map(version, command.name))


@makes_edit(Load)
def _load(command: Load) -> VersionEdit:
    loaded_texts: list[Texts] = []

    def edit(version: Version, edit_beat: float) -> Version:
        if not loaded_texts:
            bounds_before = version.texts.bounds
            is_trusted = bounds_before is not None and bounds_before.allows_any_file
            folder = Path(command.file).parent
            loaded_texts.append(
                _read_texts(command.file, FileBounds.around(folder, trust=is_trusted))
            )
        texts = loaded_texts[0]
        loaded_version = replace(version, texts=texts, piece=piece_from_files(texts))
        loaded_version = replace(loaded_version, read_texts=texts, file_texts=texts, renames=())
        return replace(
            loaded_version,
            takeover_beat=edit_beat if has_events_from(loaded_version.piece, edit_beat) else 0.0,
        )

    return edit


@makes_edit(Reload)
def _reload(command: Reload) -> VersionEdit:
    """Read the score's files again, as they are when the line is typed, and keep the typed changes.

    If a place was both typed and changed in the files, the files have it.
    """
    reloaded_texts: dict[str, Texts] = {}

    def edit(version: Version, beat: float) -> Version:
        path = version.texts.path
        if path not in reloaded_texts:
            reloaded_texts[path] = _read_texts(path, version.texts.bounds)
        texts_before = version.file_texts or version.texts
        disk_texts = family_edits.with_brought_files(reloaded_texts[path], texts_before)
        piece_from_files(disk_texts)  # its own mistakes come before those of the merge
        current_texts = disk_texts
        for (
            old_name,
            new_name,
        ) in version.renames:  # a renamed thing is what it was: its edits meet there
            with contextlib.suppress(EditError, NotTakenError):
                renamed_pair = [
                    renaming.rename(old_texts, piece_of(old_texts), old_name, new_name)
                    for old_texts in (texts_before, current_texts)
                ]
                texts_before, current_texts = renamed_pair
        texts, discarded_places = merging.merged_texts(texts_before, current_texts, version.texts)
        reloaded_version = with_texts(version, texts)
        return replace(
            reloaded_version,
            read_texts=disk_texts,
            file_texts=disk_texts,
            discarded_places=tuple(discarded_places),
        )

    return edit


def _read_texts(path: str, bounds: FileBounds | None) -> Texts:
    try:
        return Texts.read(path, bounds)
    except OSError as error:
        raise NotTakenError(f"{path}: {error.strerror}") from None


@makes_edit(Hush)
def _hush(command: Hush) -> VersionEdit:
    return end_all_playing


@makes_edit(Damp)
def _damp(command: Damp) -> VersionEdit:
    return lambda version, beat: replace(end_all_playing(version, beat), damping_t60=command.time)


READS_FILES = (Load, Reload, Retune, Scene, Use)


# --- replies -------------------------------------------------------------------------------------


def command_summary(command: Command, running: RunningVersion, position_text: str) -> str:
    """The part of a reply about a command, after `ok` and `position_text` it acts."""
    if isinstance(command, Define):
        return _defined_text(command, running)
    if isinstance(command, Plays):
        return f"{command.player}: {command.words['play'].text}"
    if isinstance(command, Scene):
        prefix = "" if command.first_scene is None else f"{command.first_scene}, then "
        reply_sentence = f"{prefix}{command.name}, from its beginning, again and again"
        if not running.version.released_parameters:
            return reply_sentence
        has_several = len(running.version.released_parameters) > 1
        verb_phrase = "have their own values" if has_several else "has its own value"
        return (
            f"{reply_sentence}; {', '.join(running.version.released_parameters)} {verb_phrase} "
            "again"
        )
    if isinstance(command, Use):
        return family_edits.family_summary(command, running.version.piece)
    if (
        isinstance(command, Load)
        and running.version.takeover_beat == 0.0
        and position_text != "1|1"
    ):
        return f"{Path(command.file).name} begins at 1|1, because the present bar is behind its end"
    if isinstance(command, Guide):
        guiding_player = command.by
        return (
            f"{command.player}: no longer guided"
            if guiding_player is None
            else f"{command.player}: guided by {guiding_player}"
        )
    return ""


def _defined_text(command: Define, running: RunningVersion) -> str:
    piece = running.version.piece
    if command.name not in piece.gestures:
        axis_names = space_path.played_names(command.name, piece.gestures)
        n_points = max(len(piece.gestures[name].points) for name in axis_names)
        return (
            f"{command.name}: a path in space of {n_points} points, played by "
            f"{', '.join(axis_names)}"
        )
    gesture = piece.gestures[command.name]
    reply_sentence = f"{command.name}: {len(gesture.points)} points"
    last_position = gesture.points[-1].at
    if "throw" not in {point.curve for point in gesture.points[1:]}:
        seconds = last_position.beats * 60.0 / piece.tempo_map.bpm(0.0) + last_position.seconds
        reply_sentence += f", {int(seconds * running.stage.rate + 0.5):,} ergons"
    if any(command.name in play.names for play in piece.parts):
        return reply_sentence
    able_keys = keys_for(piece, command.name)
    if len(able_keys) == len(piece.keys):
        return reply_sentence
    return (
        f"{reply_sentence}; no player plays it yet, and of the keys only {', '.join(able_keys)} "
        "can follow it"
    )
