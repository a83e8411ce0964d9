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


def retune(texts: Texts, target: str, fields: Mapping[str, str]) -> tuple[Texts, Mapping[str, str]]:
    """Set `tuning`, or `vib.tuning` of an instrument, to fields as they are written; without any,
    that of the score holds, or equal steps. Returns the texts of scales that were read for it, too.

    Raises EditError.
    """
    path: tuple[str, ...] = (TUNING,)
    file, root_node = texts.path, texts.document().root
    name = target.removesuffix(TUNING).rstrip(".")
    if name:
        names, _ = texts.names()
        entry = names.tables["instruments"].get(name)
        values = None if entry is None else entry.values
        if not isinstance(values, Values):
            raise EditError(f"{quote(name)} is not an instrument that can be tuned")
        path = ("instruments", values.context.name, TUNING)
        file, root_node = values.node.document.file, values.node
    if fields:
        return families.with_files_read(texts.put(path, edit.flow(dict(fields)), file))
    is_written = isinstance(root_node, document.Mapping) and TUNING in root_node.entries
    return texts.remove(path, file=file) if is_written else texts, {}
