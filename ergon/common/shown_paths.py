"""How messages name files that lie in a temporary folder: by the pack that they came from.

A folder stays known when it is removed, because errors are printed after that.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

_packs: dict[str, str] = {}  # temporary folder → the pack, as the user named it


def show_as(folder: Path, pack: str) -> None:
    """Name the files of a folder `PACK:FILE` in all messages of this process."""
    _packs[str(folder)] = pack


def is_from_pack(path: str | Path) -> bool:
    """Whether a file lies in the temporary folder of a pack."""
    return any(str(path).startswith(folder + os.sep) for folder in _packs)


def shown(shown_text: str) -> str:
    """The text with the names that files have for the user."""
    for folder, pack in _packs.items():
        shown_text = shown_text.replace(folder + os.sep, f"{pack}:").replace(folder, pack)
    return shown_text


def shown_in_json(shown_text: str) -> str:
    """The same for a text of JSON."""
    for folder, pack in _packs.items():
        folder_text, name = json.dumps(folder + os.sep)[1:-1], json.dumps(pack)[1:-1]
        shown_text = shown_text.replace(folder_text, f"{name}:").replace(
            json.dumps(folder)[1:-1], name
        )
    return shown_text
