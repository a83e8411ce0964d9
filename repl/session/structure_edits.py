"""Version edits that add, join and remove what a score is made of."""

from __future__ import annotations

from ergon.repl.language import commands as c
from ergon.repl.session.edit_table import writes
from ergon.repl.session.version import NotTakenError, Version
from ergon.scores.edits import structure
from ergon.scores.edits.texts import Texts


@writes(c.Build)
def _build(command: c.Build, version: Version, beat: float) -> Texts:
    piece = version.piece
    if command.name in piece.instruments or command.name in piece.keys:
        raise NotTakenError(f"{command.name} exists: `remove {command.name}` first")
    own = command.base, command.fields, command.semitones
    return structure.build(version.texts, piece, command.name, *own)


@writes(c.Link)
def _link(command: c.Link, version: Version, beat: float) -> Texts:
    ends = command.a, command.b
    return structure.link(version.texts, command.kind, ends, command.fields)[0]


@writes(c.Takes)
def _takes(command: c.Takes, version: Version, beat: float) -> Texts:
    texts, piece = version.texts, version.piece
    if command.key not in piece.keys:
        like = command.like or next(iter(piece.keys), None)
        if like is None:
            raise NotTakenError("the score has no key that a new one could be like")
        texts = structure.key(texts, command.key, like)
    elif command.like is not None:
        raise NotTakenError(f"{command.key} exists already: leave out 'like {command.like}'")
    return structure.player(texts, piece, command.player, command.key)


@writes(c.Route)
def _route(command: c.Route, version: Version, beat: float) -> Texts:
    gain = None if command.gain is None else command.words["gain"].text
    own = command.name, list(command.channels), gain
    return structure.route(version.texts, version.piece, *own)


@writes(c.Remove)
def _remove(command: c.Remove, version: Version, beat: float) -> Texts:
    return structure.remove(version.texts, version.piece, command.name)


@writes(c.Rename)
def _rename(command: c.Rename, version: Version, beat: float) -> Texts:
    return structure.rename(version.texts, version.piece, command.old, command.name)
