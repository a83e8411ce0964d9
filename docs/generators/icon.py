"""The icon of the extension of VS Code: rings that an ergon sends out, 256 pixels square.

python -m docs.generators.icon editors/vscode/icon.png
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergon.common.module_arguments import module_arguments
from ergon.view.sound import png

SIZE = 256
_PAPER, _RING, _POINT = (27, 31, 42), (116, 207, 214), (230, 198, 116)


def icon() -> bytes:
    """A PNG file."""
    y, x = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    radius = np.hypot(x, y) / (SIZE / 2)
    ring = np.clip(np.cos(10 * np.pi * radius) * 4 - 2, 0, 1) * np.clip(1 - radius, 0, 1) ** 0.7
    point = np.clip((0.16 - radius) * SIZE / 2, 0, 1)
    pixels = np.asarray(_PAPER, float) * np.ones((SIZE, SIZE, 1))
    for share, colour in ((ring, _RING), (point, _POINT)):
        pixels += share[:, :, None] * (np.asarray(colour, float) - pixels)
    return png(np.rint(pixels).astype(np.uint8))


if __name__ == "__main__":
    Path(module_arguments("FILE")[0]).write_bytes(icon())
