"""Another tuning of an instrument, or of the whole score."""

from __future__ import annotations

from collections.abc import Mapping

from ergon.notation.tables.fields import Values
from ergon.notation.text import document, edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.scores.edits import families
from ergon.scores.edits.texts import Texts

TUNING = "tuning"


def retune(
    score_texts: Texts, target_path: str, tuning_fields: Mapping[str, str]
) -> tuple[Texts, Mapping[str, str]]:
    """Set `tuning`, or `vib.tuning` of an instrument, to fields as they are written; without any,
    that of the score holds, or equal steps. Returns the texts of scales that were read for it, too.

    Raises EditError.
    """
    path: tuple[str, ...] = (TUNING,)
    file_name, root_node = score_texts.path, score_texts.document().root
    instrument_name = target_path.removesuffix(TUNING).rstrip(".")
    if instrument_name:
        names, _ = score_texts.names()
        entry = names.tables["instruments"].get(instrument_name)
        tuning_values = None if entry is None else entry.values
        if not isinstance(tuning_values, Values):
            raise EditError(f"{quote(instrument_name)} is not an instrument that can be tuned")
        path = ("instruments", tuning_values.context.name, TUNING)
        file_name, root_node = tuning_values.node.document.file, tuning_values.node
    if tuning_fields:
        return families.with_files_read(
            score_texts.put(path, edit.flow(dict(tuning_fields)), file_name)
        )
    is_written = isinstance(root_node, document.Mapping) and TUNING in root_node.entries
    return score_texts.remove(path, file=file_name) if is_written else score_texts, {}
