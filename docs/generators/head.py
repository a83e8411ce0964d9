"""Write `ergon/space/kemar.csv`, the head that ships, from a SOFA file of a KEMAR manikin.

    python -m docs.generators.head MIT_KEMAR_normal_pinna.sofa ergon/space/kemar.csv

The source is in Debian's package `libmysofa1`, in /usr/share/libmysofa.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ergon.common.module_arguments import module_arguments
from ergon.exchange import sofa
from ergon.space.directions import angles, point, unit_vectors
from ergon.space.head import FULL_SCALE, prepared

_HEAD = """\
# 24 pairs of filters of a KEMAR manikin with normal pinnae, made by ergon from the measurements of
# Bill Gardner and Keith Martin, "HRTF Measurements of a KEMAR Dummy-Head Microphone", MIT Media Lab
# Perceptual Computing Technical Report 280, 1994. Copyright 1994 by the MIT Media Laboratory: "It
# is provided free with no restrictions on use, provided the authors are cited when the data is used
# in any research or commercial application." Changed: equalised to a diffuse field, minimum phase.
# azimuth, elevation [degrees], delay of the left and of the right ear [us], 128 taps of the left
# ear at 44,100 Hz, 128 of the right; 8192 is 1
"""
RINGS = ((12, 0.0, 0.0), (8, 35.0, 22.5), (4, 70.0, 45.0))


def text(path: Path) -> str:
    """The text of the shipped file, from the measurements."""
    measured = sofa.read(path)
    directions = unit_vectors([point(a, e, 1.0) for a, e in measured.angles.tolist()])
    places = [
        point(first + 360.0 * k / n, elevation, 1.0)
        for n, elevation, first in RINGS
        for k in range(n)
    ]
    wanted = unit_vectors(places)
    head = prepared(directions, measured.responses, measured.rate, wanted, measured.delays)
    lines = [_HEAD]
    for place, pair, late in zip(places, head.filters, head.delays, strict=True):
        azimuth, elevation, _ = angles(place)
        taps = np.rint(pair.ravel() * FULL_SCALE).astype(int)
        row = [f"{azimuth:g}", f"{elevation:g}", *(f"{1e6 * one:.1f}" for one in late), *taps]
        lines.append(",".join(map(str, row)) + "\n")
    return "".join(lines)


if __name__ == "__main__":
    source, target = map(Path, module_arguments("SOURCE", "TARGET"))
    target.write_text(text(source), encoding="utf-8")
