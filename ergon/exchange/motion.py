"""Motion files for other programs: npz and CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

from ergon.common.structured import parse_json

from .motion_space import NotMotionError, links_in_space, points_in_space
from .safe import MARK

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Motion

_BLOCK_NUMBERS = 1 << 24  # numbers that are computed at once
NUMBERS_MAX = 1 << 28  # displacements of one export: 2 GiB
_FRAMES_PER_SECOND_MAX = 1_000_000


def read_manifest(motion: Motion) -> dict[str, Any]:
    """The manifest at the beginning of the file (docs/motion.md). Raises NotMotionError."""
    manifest: dict[str, Any] = parse_json(motion.manifest)
    fps = manifest.get("fps")
    if not isinstance(fps, float | int) or not 0.0 < fps <= _FRAMES_PER_SECOND_MAX:
        raise NotMotionError(
            f"its frames a second must be above 0 and at most {_FRAMES_PER_SECOND_MAX:,}"
        )
    for manifest_part in manifest["parts"]:
        manifest_part["name"] = str(manifest_part.get("name") or "")
        manifest_part["why"] = manifest_part.get("why")
        manifest_part["modes"] = (
            manifest_part.get("modes") if manifest_part["kind"] == "modal" else None
        )
    return manifest


def instants(motion: Motion, fps: float | None) -> NDArray[np.float64]:
    """Instants [s] of an export, (n,): `fps` a second, or by default the frame rate of the file.

    Raises NotMotionError if the export would have more numbers than fit.
    """
    import numpy as np

    rate = fps or float(read_manifest(motion)["fps"])
    instant_count = math.floor(motion.duration * rate + 1e-6) + 1
    if instant_count * max(1, len(motion.names)) > NUMBERS_MAX:
        raise NotMotionError(
            f"{instant_count:,} instants of {len(motion.names):,} points are more than fits; lower "
            "--fps"
        )
    return np.arange(instant_count) / rate


def write_npz(output_file: BinaryIO, motion: Motion, frame_instants: NDArray[np.float64]) -> None:
    """`t` [s], `names`, `places` (x, y, z, rest) [m], `displacement` [m] (n_instants, n_points).

    Displacements are single floats; NaN marks those that were not computed. `manifest` is JSON.
    If there are points in space, the file also has: `space_names`, one name per point in space;
    `space_positions` (n_instants, n_space, 3) [m], their positions in the room, z upwards;
    `space_links` (n_links, 2), the springs between them, by their numbers; `space_broken`
    (n_links,), when each spring broke [s], inf if it is whole. Raises NotMotionError.
    """
    import numpy as np

    point_places, point_displacements = (
        motion.places(),
        motion.displacements(frame_instants.tolist()),
    )
    arrays: dict[str, NDArray[Any]] = {}
    if space := points_in_space(read_manifest(motion).get("space"), motion.names):
        paths = [
            point.path(point_places, point_displacements).astype(np.float32) for point in space
        ]
        arrays["space_names"] = np.array([point.name for point in space])
        arrays["space_positions"] = np.stack(paths, axis=1)
        links = links_in_space(motion, space)
        arrays["space_links"] = np.array([link.ends for link in links], dtype=int).reshape(-1, 2)
        arrays["space_broken"] = np.array([link.break_instant for link in links])
    np.savez_compressed(
        output_file,
        allow_pickle=False,
        t=frame_instants,
        names=np.array(motion.names),
        places=point_places,
        displacement=point_displacements.astype(np.float32),
        manifest=np.array(motion.manifest),
        **arrays,
    )


def csv_rows(motion: Motion, frame_instants: NDArray[np.float64]) -> Iterator[str]:
    """The text of a CSV in pieces: t and the displacement of each point, one row per instant."""
    names = ",".join('"' + name.replace('"', '""') + ' [m]"' for name in motion.names)
    yield f"# {MARK.decode()}\nt [s],{names}\n"
    count = max(1, _BLOCK_NUMBERS // max(1, len(motion.names)))
    for first_index in range(0, len(frame_instants), count):
        block_instants = frame_instants[first_index : first_index + count].tolist()
        for t, row in zip(block_instants, motion.displacements(block_instants), strict=True):
            numbers = ("" if math.isnan(x) else repr(float(x)) for x in row)
            yield f"{t!r},{','.join(numbers)}\n"
