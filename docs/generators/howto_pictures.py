"""The pictures of `docs/howto`: those that the commands of its pages draw."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from docs.generators.pages import blocks, commands, put
from ergon.common.module_arguments import module_arguments

HOWTO = Path(__file__).parents[1] / "howto"


def main() -> None:
    """Run the commands of each page in an empty folder, and keep the pictures."""
    module_arguments()
    for page in sorted(HOWTO.glob("*.md")):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for block in blocks(page):
                if block.language == "yaml":
                    put(block, folder)
                elif block.language == "console":
                    for words, _ in commands(block):
                        subprocess.run(
                            [sys.executable, "-m", "ergon.cli", *words],
                            cwd=folder,
                            check=True,
                            capture_output=True,
                        )
            for picture in folder.glob("*.svg"):
                (HOWTO / picture.name).write_bytes(picture.read_bytes())


if __name__ == "__main__":
    main()
