"""LICENSE-THIRD-PARTY: what the licences ask for of the crates that are linked into `ergon._core`.

    python core-rs/third_party.py LICENSE-THIRD-PARTY

Every crate is named with its licence, and every text that one ships stands there once. Build and
macro crates are not linked. Crates of other systems are, there.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[1]
_TOP = "ergon-bridge"
_TEXTS = ("LICENSE*", "LICENCE*", "COPYING*", "COPYRIGHT*", "UNLICENSE*", "NOTICE*")
_RULE = "-" * 80
_HEAD = """\
ergon itself is under MIT OR Apache-2.0 (LICENSE-MIT, LICENSE-APACHE). Its compiled part,
ergon._core, holds the crates that are listed here, under their own licences, and the standard
library of Rust (MIT OR Apache-2.0, Copyright (c) The Rust Project Contributors).
The source of each, unchanged, is at https://crates.io/crates/NAME/VERSION.
Made by core-rs/third_party.py.
"""


def cargo_metadata() -> dict[str, Any]:
    """What cargo knows of all packages."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    done = subprocess.run(command, cwd=_ROOT, capture_output=True, check=True)
    metadata_json: dict[str, Any] = json.loads(done.stdout)
    return metadata_json


def linked_packages(metadata_json: dict[str, Any]) -> list[dict[str, Any]]:
    """Packages that are linked in, in order of their names."""
    packages = {package["id"]: package for package in metadata_json["packages"]}
    nodes = {node["id"]: node for node in metadata_json["resolve"]["nodes"]}
    top = next(key for key, package in packages.items() if package["name"] == _TOP)
    seen, waiting = {top}, [top]
    while waiting:
        for dependency in nodes[waiting.pop()]["deps"]:
            is_linked = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            targets = packages[dependency["pkg"]]["targets"]
            is_macro = any("proc-macro" in target["kind"] for target in targets)
            if is_linked and not is_macro and dependency["pkg"] not in seen:
                seen.add(dependency["pkg"])
                waiting.append(dependency["pkg"])
    third_party_packages = (packages[key] for key in seen if packages[key]["source"] is not None)
    return sorted(third_party_packages, key=lambda package: (package["name"], package["version"]))


def licence_texts_of(package: dict[str, Any]) -> Iterator[str]:
    """What licence files a package ships."""
    folder = Path(package["manifest_path"]).parent
    files = {path for pattern in _TEXTS for path in folder.glob(pattern) if path.is_file()}
    if package["license_file"]:
        files.add(folder / package["license_file"])
    for path in sorted(files):
        text = path.read_text(encoding="utf-8", errors="replace").replace("\r\n", "\n")
        yield "\n".join(line.rstrip() for line in text.strip("\n").split("\n"))


def licence_page(packages: list[dict[str, Any]]) -> str:
    """The whole file."""
    by_text: dict[str, list[str]] = {}
    rows = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        authors = ", ".join(author.split(" <")[0] for author in package["authors"])
        row = f"{name}: {package['license'] or 'see below'}{f', by {authors}' if authors else ''}"
        licence_texts = [*licence_texts_of(package)]
        rows.append(row if licence_texts else f"{row} (it ships no text of its licence)")
        for text in licence_texts:
            by_text.setdefault(text, []).append(name)
    parts = [_HEAD, "\n".join(rows) + "\n"]
    for text, names in by_text.items():
        parts.append(f"{_RULE}\n{', '.join(names)}:\n\n{text}\n")
    return "\n".join(parts)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(licence_page(linked_packages(cargo_metadata())), encoding="utf-8")
