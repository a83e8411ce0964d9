"""Saving under another name: the score, with copies of the used files that were changed.

Files that it uses may belong to other scores, so they stay as they are. Changed files, and files
that use them, are copied into a folder with the name of the score.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from ergon.notation.text import document, edit
from ergon.notation.text.errors import Collector
from ergon.notation.text.files import Files
from ergon.repl.session.journal_names import LIBRARY, journal_name
from ergon.scores.edits.texts import Texts


def files(texts: Texts, changed: Collection[str], target: Path) -> Mapping[str, str]:
    """The texts to write, by file, where these used files were changed. Raises EditError."""
    moved = _using(texts, changed)
    folder = Path(texts.path).parent
    names = {file: journal_name(file, folder).removeprefix(LIBRARY) for file in texts.overlay}
    for file, path, name, used in [*_uses(texts)]:
        if file not in moved and file != texts.path:
            continue
        new = f"{target.stem}/{names[used]}" if used in moved else names[used]
        if new != name and (used in moved or file in moved):
            texts = texts.put(path, edit.quoted(new), file)
    copies = {file: target.parent / target.stem / names[file] for file in moved}
    return {
        str(target): texts.text,
        **{str(copy): texts.overlay[file] for file, copy in copies.items()},
    }


def _using(texts: Texts, changed: Collection[str]) -> set[str]:
    """These files, and all files that use one of them, directly or not."""
    users, count = set(changed), -1
    while changed and len(users) != count:
        count = len(users)
        users |= {file for file, _, _, used in _uses(texts) if used in users}
    return users - {texts.path}


def _uses(texts: Texts) -> Iterator[tuple[str, edit.Path, str, str]]:
    """Every `use`: its file, its path in that file, the name written there, and the file that it
    means.
    """
    home = Path(texts.path).parent
    finder = Files(Collector(), home, texts.overlay, bounds=texts.bounds, sealed=True)
    for file in (texts.path, *texts.overlay):
        root = texts.document(file).root
        node = root.get("use") if isinstance(root, document.Mapping) else None
        items: list[tuple[edit.Path, document.Node | None]] = [(("use",), node)]
        if isinstance(node, document.Sequence):
            items = [(("use", index), item) for index, item in enumerate(node.items)]
        for path, item in [*items]:
            if isinstance(item, document.Mapping):
                items += [((*path, name), child) for name, (_, child) in item.entries.items()]
        for path, item in items:
            if isinstance(item, document.Scalar) and not item.is_empty:
                used_file = finder.find(item.text, Path(file).parent)
                if used_file is not None and str(used_file) in texts.overlay:
                    yield file, path, item.text, str(used_file)
