"""Scenes of a session: scores beside its own, whose bars it repeats."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.notation.text.bounds import FileBounds
from ergon.notation.text.edit import EditError
from ergon.notation.text.files import is_file
from ergon.notation.text.spelling import nearest
from ergon.repl.language import versions
from ergon.repl.language.scope import SCORE_SUFFIXES, scores_in
from ergon.repl.session.disk import folder_of
from ergon.repl.session.edit_table import makes_edit, with_texts
from ergon.repl.session.version import GLIDE_DURATION, NotTakenError, Version, piece_of
from ergon.scores.edits import scene_matter, scenes
from ergon.scores.edits.scenes import Scene
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit

_FileStamps = Sequence[tuple[str, int, int]]  # file, time of the last change [ns], bytes


def read_scene(score_texts: Texts, scene_name: str) -> Scene:
    """The scene of a name, from its file beside a score. Raises NotTakenError."""
    folder = folder_of(score_texts)
    path = next(
        (
            scene_path
            for suffix in SCORE_SUFFIXES
            if is_file(scene_path := folder / f"{scene_name}{suffix}")
        ),
        None,
    )
    if path is None:
        suggestion = nearest(scene_name, [score_file.stem for score_file in scores_in(folder)])
        raise NotTakenError(
            f"there is no scene {scene_name} beside the score; `keep 8bar as {scene_name}` makes "
            "one",
            None if suggestion is None else f"scene {suggestion}",
        )
    bounds = FileBounds.around(
        folder, trust=score_texts.bounds is not None and score_texts.bounds.allows_any_file
    )
    try:
        scene, files = _read_scene_file(_file_stamps([path]), bounds)
        if _file_stamps(map(Path, [name for name, *_ in files])) != files:
            _read_scene_file.cache_clear()
            scene, _ = _read_scene_file(_file_stamps([path]), bounds)
    except OSError as error:
        raise NotTakenError(f"{path}: {error.strerror}") from None
    except (EditError, NotTakenError) as error:
        raise NotTakenError(f"{path.name}: {error}") from None
    return scene


@lru_cache(maxsize=8)  # a scene of 100 modules takes 40 ms to read
def _read_scene_file(stamps: _FileStamps, bounds: FileBounds) -> tuple[Scene, _FileStamps]:
    """The scene in a file, and the stamps of all files from which it was read."""
    texts = Texts.read(stamps[0][0], bounds)
    scene = Scene.from_texts(texts, piece_of(texts))
    return scene, _file_stamps([Path(texts.path), *map(Path, texts.overlay)])


def _file_stamps(paths: Iterable[Path]) -> _FileStamps:
    stamps = []
    for path in paths:
        file_status = os.stat(path)
        stamps.append((str(path), file_status.st_mtime_ns, file_status.st_size))
    return tuple(stamps)


@makes_edit(versions.Scene)
def _play_scene(command: versions.Scene) -> VersionEdit:
    """Repeat the bars of a scene; parameters go to those of the scene, over a length if one is
    given.
    """
    scenes_by_name: dict[str, Scene] = {}

    def cached_scene(version: Version, name: str) -> Scene:
        if name not in scenes_by_name:
            scenes_by_name[name] = read_scene(version.texts, name)
        return scenes_by_name[name]

    def edit(version: Version, edit_beat: float) -> Version:
        target_scene = cached_scene(version, command.name)
        edited_texts = version.texts
        piece = version.piece
        played_scenes = (
            [target_scene]
            if command.first_scene is None
            else [cached_scene(version, command.first_scene), target_scene]
        )
        for played_scene in played_scenes:
            edited_texts = scene_matter.with_scene_parts(edited_texts, piece, played_scene)
            piece = piece if edited_texts is version.texts else piece_of(edited_texts)
        new_texts = {
            file: text
            for file, text in edited_texts.overlay.items()
            if file not in version.texts.overlay
        }
        base_texts = version.file_texts
        if new_texts and base_texts is not None:  # `use` adds files in the same way
            base_texts = replace(base_texts, overlay={**new_texts, **base_texts.overlay})
        glide_text = None if command.over is None else command.words["over"].text
        begin_beat, glide_seconds = edit_beat, GLIDE_DURATION
        first_scene = (
            target_scene
            if command.first_scene is None
            else cached_scene(version, command.first_scene)
        )
        released_parameters = tuple(scenes.released_parameters(piece, first_scene, edit_beat))
        edited_texts = scenes.with_scene_tempo(
            edited_texts, piece, target_scene, edit_beat, glide_text
        )
        if command.over is not None:
            tempo_map = piece_of(edited_texts).tempo_map
            glide_end = tempo_map.after(edit_beat, command.over)
            glide_seconds = max(
                GLIDE_DURATION, tempo_map.seconds(glide_end) - tempo_map.seconds(edit_beat)
            )
            if command.first_scene is not None:
                edited_texts = scenes.play_scene(
                    edited_texts, piece_of(edited_texts), first_scene, edit_beat, glide_end
                )
                begin_beat = glide_end
        edited_texts = scenes.play_scene(
            edited_texts, piece_of(edited_texts), target_scene, begin_beat
        )
        edited_texts = scenes.with_scene_values(
            edited_texts, piece, target_scene
        )  # last: no beat depends on a parameter
        played_version = with_texts(version, edited_texts)
        return replace(
            played_version,
            glide_duration=glide_seconds,
            released_parameters=released_parameters,
            read_files=new_texts,
            file_texts=base_texts,
        )

    return edit
