"""Verbs of versions and files."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.notation.clock.positions import Length
from ergon.notation.text.errors import TextError
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, Command, When
from ergon.repl.language.forms import OVER_SLOT, Slot, Words, form


@dataclass(frozen=True, slots=True)
class Seed(BlockCommand):
    """Set the number from which all chance derives."""

    seed: int


@dataclass(frozen=True, slots=True)
class Undo(Command):
    """Return to the previous version."""


@dataclass(frozen=True, slots=True)
class Redo(Command):
    """Restore the version that was undone."""


@dataclass(frozen=True, slots=True)
class History(Command):
    """List the versions, each with the place at which it took effect."""


@dataclass(frozen=True, slots=True)
class Back(Command):
    """Go back by a number of versions."""

    count: int


@dataclass(frozen=True, slots=True)
class KeepAsScore(Command):
    """Write the last `length` of the piece as a score."""

    length: Length
    name: str


@dataclass(frozen=True, slots=True)
class Scene(Command):
    """Play the bars of a scene from their beginning, again and again; parameters glide for `over`.

    With `first_scene`, the bars of that scene play for `over`, and then those of `name`.
    """

    name: str
    first_scene: str | None = None
    over: Length | None = None


@dataclass(frozen=True, slots=True)
class Save(Command):
    """Write the score; None: to its own file."""

    file: str | None


@dataclass(frozen=True, slots=True)
class Load(Command):
    """Open another score in place of the present one."""

    file: str


@dataclass(frozen=True, slots=True)
class Reload(Command):
    """Read the score's files again, and take over what has changed in them."""


def play_scene(
    names: tuple[str, str | None], over: Length | None, *, when: When, words: Words
) -> Scene:
    """Play a scene, or go from one scene to another, which needs a length. Raises TextError."""
    scene_name, target_name = names
    if target_name is None:
        return Scene(scene_name, None, over, when=when, words=words)
    if over is None:
        names_word = words["names"]
        message = "the way from one scene to another needs a length: scene A -> B over 4bar"
        raise TextError(message, offset=names_word.start, length=len(names_word.text))
    return Scene(target_name, scene_name, over, when=when, words=words)


# fmt: off
UNDO_FORM = form("undo", "und", "returns to the version before", "undo", Undo)
REDO_FORM = form("redo", "red", "restores the version that was undone", "redo", Redo)
BACK_FORM = form("back", "b", "goes back by a number of versions",
    "back 3", Back, Slot("count", "N", amounts.COUNT_VALUE))
HISTORY_FORM = form("history", "hi", "lists the versions, with their bars",
    "history", History, takes_time=False)
KEEP_FORM = form("keep", "k", "writes what was played last as a score of its own",
    "keep 8bar as verse-2", KeepAsScore, Slot("length", "LENGTH", amounts.LENGTH_VALUE),
    Slot("name", "NAME", values.NEW_NAME, "as"), takes_time=False)
SCENE_FORM = form("scene", "sce", "plays kept bars from their beginning, again and again",
    "scene verse-2 -> refrain over 4bar", play_scene,
    Slot("names", "NAME|NAME -> NAME", values.SCENES_VALUE, takes_many=True), OVER_SLOT)
SAVE_FORM = form("save", "sa", "writes the score, comments and all",
    "save scores/duet-live.yaml", Save,
    Slot("file", "FILE", values.FILE_VALUE, optional=True), takes_time=False)
LOAD_FORM = form("load", "lo", "opens another score in place of this one",
    "load duet.yaml", Load, Slot("file", "FILE", values.FILE_VALUE))
RELOAD_FORM = form("reload", "relo", "reads the score's files again; what differs changes",
    "reload", Reload)
SEED_FORM = form("seed", "see", "sets the number from which all chance derives",
    "seed 7", Seed, Slot("seed", "N", amounts.SEED_VALUE))
# fmt: on
