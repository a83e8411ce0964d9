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
from ergon.repl.session.journal_names import LIBRARY_PREFIX, journal_name
from ergon.scores.edits.texts import Texts


def texts_to_write(
    score_texts: Texts, changed_files: Collection[str], target_path: Path
) -> Mapping[str, str]:
    """The texts to write, by file, where these used files were changed. Raises EditError."""
    copied_files = _dependent_files(score_texts, changed_files)
    folder = Path(score_texts.path).parent
    journal_names = {
        file: journal_name(file, folder).removeprefix(LIBRARY_PREFIX)
        for file in score_texts.overlay
    }
    for file_name, path, used_name, used_file in [*_use_entries(score_texts)]:
        if file_name not in copied_files and file_name != score_texts.path:
            continue
        new_name = (
            f"{target_path.stem}/{journal_names[used_file]}"
            if used_file in copied_files
            else journal_names[used_file]
        )
        if new_name != used_name and (used_file in copied_files or file_name in copied_files):
            score_texts = score_texts.put(path, edit.quoted(new_name), file_name)
    path_by_file = {
        file: target_path.parent / target_path.stem / journal_names[file] for file in copied_files
    }
    return {
        str(target_path): score_texts.text,
        **{str(copy_path): score_texts.overlay[file] for file, copy_path in path_by_file.items()},
    }


def _dependent_files(score_texts: Texts, changed_files: Collection[str]) -> set[str]:
    """These files, and all files that use one of them, directly or not."""
    using_files, n_before = set(changed_files), -1
    while changed_files and len(using_files) != n_before:
        n_before = len(using_files)
        using_files |= {
            file for file, _, _, used_file in _use_entries(score_texts) if used_file in using_files
        }
    return using_files - {score_texts.path}


def _use_entries(score_texts: Texts) -> Iterator[tuple[str, edit.Path, str, str]]:
    """Every `use`: its file, its path in that file, the name written there, and the file that it
    means.
    """
    score_folder = Path(score_texts.path).parent
    finder = Files(
        Collector(), score_folder, score_texts.overlay, bounds=score_texts.bounds, sealed=True
    )
    for file_name in (score_texts.path, *score_texts.overlay):
        root = score_texts.document(file_name).root
        use_node = root.get("use") if isinstance(root, document.Mapping) else None
        use_items: list[tuple[edit.Path, document.Node | None]] = [(("use",), use_node)]
        if isinstance(use_node, document.Sequence):
            use_items = [(("use", index), item) for index, item in enumerate(use_node.items)]
        for path, use_item in [*use_items]:
            if isinstance(use_item, document.Mapping):
                use_items += [
                    ((*path, name), child) for name, (_, child) in use_item.entries.items()
                ]
        for path, use_item in use_items:
            if isinstance(use_item, document.Scalar) and not use_item.is_empty:
                used_file = finder.find(use_item.text, Path(file_name).parent)
                if used_file is not None and str(used_file) in score_texts.overlay:
                    yield file_name, path, use_item.text, str(used_file)
