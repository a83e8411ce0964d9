"""Brings families of instruments into a score, and those of their instruments that are played."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from ergon.notation.text import document, edit
from ergon.notation.text.files import shipped
from ergon.scores.edits import structure
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def with_family(score_texts: Texts, family: str, family_file: str) -> tuple[Texts, dict[str, str]]:
    """Add a file to `use:` under a prefix; returns the texts of the files that were read for it,
    which are not of the library, too. Mistakes in them are those of the new texts.

    Raises EditError.
    """
    use_section = score_texts.section("use")
    if isinstance(use_section, document.Sequence) or (
        isinstance(use_section, document.Scalar) and not use_section.is_empty
    ):
        texts_with_use = score_texts.append(("use",), edit.flow({family: family_file}))
    else:
        texts_with_use = score_texts.put(("use", family), edit.quoted(family_file))
    return with_files_read(texts_with_use)


def with_files_read(score_texts: Texts) -> tuple[Texts, dict[str, str]]:
    """Texts with those of the files that they name and do not hold yet, and these files, which are
    not of the library.
    """
    documents_by_name = replace(score_texts, sealed=False).load().files
    read_texts = {
        name: file_document.text
        for name, file_document in documents_by_name.items()
        if name != score_texts.path
        and name not in score_texts.overlay
        and shipped(Path(name)) is None
    }
    return replace(score_texts, overlay={**read_texts, **score_texts.overlay}), read_texts


def unplayed_instruments(piece: Piece) -> dict[str, str]:
    """Instruments of files that are not played yet, by the names that a line uses for them; each
    with its name in the score, which may have a prefix.

    The name of an instrument without the prefix of its family is free if nothing else has it.
    """
    names = dict.fromkeys(piece.available)
    unplayed_names = {name: name for name in names if "." not in name}
    for full_name in names:
        family, _, name = full_name.rpartition(".")
        if family in piece.used and not is_defined(piece, name):
            unplayed_names.setdefault(name, full_name)
    return unplayed_names


def is_defined(piece: Piece, name: str) -> bool:
    """Whether a key or an instrument of a score has a name."""
    return name in piece.instruments or name in piece.families or name in piece.keys


def instrument_base(piece: Piece, instrument_name: str) -> str:
    """What an instrument is built from: `skins/kick` where `kick` is one of a family that nothing
    plays yet, else the name itself.
    """
    family, _, plain_name = unplayed_instruments(piece).get(instrument_name, "").rpartition(".")
    return f"{family}/{plain_name}" if family else instrument_name


def with_routes(score_texts: Texts, piece: Piece, paths: Iterable[str]) -> Texts:
    """Route instruments of files to all channels that `score_texts` play, and `piece` does not.

    Those of a family with a prefix are defined first, by the paths of modules (`kick.hammer`) of
    which some may be theirs. Raises EditError.
    """
    score_texts, piece = with_definitions(score_texts, piece, paths)
    plain_names = [name for name in piece.available if "." not in name]
    new_piece = score_texts.load().piece if plain_names else None
    for name in plain_names:
        if new_piece is not None and (name in new_piece.instruments or name in new_piece.families):
            score_texts = structure.routed_to_all(score_texts, piece, name)
            piece = score_texts.load().piece or piece  # all routes are written now
    return score_texts


def with_definitions(score_texts: Texts, piece: Piece, paths: Iterable[str]) -> tuple[Texts, Piece]:
    """Define the instruments of families with a prefix that paths of modules name, without the
    prefix and heard on all channels; returns their piece too. Raises EditError.
    """
    unplayed_names = unplayed_instruments(piece)
    for name in sorted({path.partition(".")[0] for path in paths} & unplayed_names.keys()):
        if (base_name := instrument_base(piece, name)) != name:
            score_texts = structure.add_instrument(score_texts, piece, name, base_name, {})
            piece = score_texts.load().piece or piece
    return score_texts, piece


def with_act_modules(score_texts: Texts, path: str) -> Texts:
    """Let the modules of an act be there that strikes from outside will play: `vib`, `vib.strike`.

    Nothing changes where the act brings none, or where they are there. Raises EditError.
    """
    act_owner, _, act_name = path.partition(".")
    piece = score_texts.load().piece
    instrument = None if piece is None else piece.playable_instrument(act_owner)
    acts = {} if instrument is None else {act.name: act for act in instrument.acts}
    played_act = acts.get(act_name) if act_name else next(iter(acts.values()), None)
    if instrument is None or played_act is None:
        return score_texts
    modules = {module.name for module in instrument.modules}
    if all(module.name in modules for module in played_act.modules):
        return score_texts
    return score_texts.put(("instruments", act_owner, "ready"), played_act.name)
