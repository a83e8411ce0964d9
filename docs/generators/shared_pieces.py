"""Pieces of docs/gallery.md as pages that move and sound, for the site: one file of HTML each.

python -m docs.generators.shared_pieces out/pieces [PIECE ...]

Without a name those that take less than a minute of one core. They are built and not committed;
`make site` puts what lies in out/pieces beside the gallery, with a link under each picture.
"""

from __future__ import annotations

from pathlib import Path

import ergon
from ergon.cli.bundled import bundled_scores
from ergon.common.module_arguments import module_arguments

QUICK = ("one-gesture", "tempo", "change-ringing", "interlocking", "drum-machine")


def main() -> None:
    """Write each piece into the folder."""
    name, *pieces = module_arguments("FOLDER", rest_metavar="PIECE")
    folder = Path(name)
    folder.mkdir(parents=True, exist_ok=True)
    scores = bundled_scores()
    for piece in pieces or QUICK:
        target = folder / f"{piece}.html"
        ergon.page(scores[piece]).write(target, force=True)
        print(f"{target}: {target.stat().st_size / 1e6:.1f} MB", flush=True)


if __name__ == "__main__":
    main()
