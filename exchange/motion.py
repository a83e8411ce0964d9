"""Motion files for other programs: npz, CSV, and glTF for animators."""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO

from ergon.common.errors import ErgonError

from .safe import MARK

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Motion

_BLOCK = 1 << 24  # numbers that are computed at once
NUMBERS_MAX = 1 << 28  # displacements of one export: 2 GiB
_TARGETS_MAX = 20_000  # glTF writes one node for each point
_FLOAT, _LINEAR = 5126, "LINEAR"
_FPS_MAX = 1_000_000
_PEAKS = 15  # kind of the chunks of largest displacements


class NotMotionError(ErgonError, ValueError):
    """What was asked for cannot be had from a motion file."""


def about(motion: Motion) -> dict[str, Any]:
    """The manifest that it begins with (docs/motion.md). Raises NotMotionError."""
    manifest: dict[str, Any] = json.loads(motion.manifest)
    fps = manifest.get("fps")
    if not isinstance(fps, float | int) or not 0.0 < fps <= _FPS_MAX:
        raise NotMotionError(f"its frames a second must be above 0 and at most {_FPS_MAX:,}")
    for part in manifest["parts"]:
        part["name"] = str(part.get("name") or "")
        part["why"] = part.get("why")
        part["modes"] = part.get("modes") if part["kind"] == "modal" else None
    return manifest


def instants(motion: Motion, fps: float | None) -> NDArray[np.float64]:
    """Instants [s] of an export, (n,): `fps` a second, or as often as the engine was looked at.

    Raises NotMotionError where that would be more numbers than fit.
    """
    import numpy as np

    rate = fps or float(about(motion)["fps"])
    count = math.floor(motion.duration * rate + 1e-6) + 1
    if count * max(1, len(motion.names)) > NUMBERS_MAX:
        raise NotMotionError(
            f"{count:,} instants of {len(motion.names):,} points are more than fits; lower --fps"
        )
    return np.arange(count) / rate


def write_npz(to: BinaryIO, motion: Motion, at: NDArray[np.float64]) -> None:
    """`t` [s], `names`, `places` (x, y, z, rest) [m] and `displacement` [m] (n_instants, n_points).

    Displacements are single floats; NaN is what nobody computed. `manifest` is JSON.
    """
    import numpy as np

    np.savez_compressed(
        to,
        t=at,
        names=np.array(motion.names),
        places=motion.places(),
        displacement=motion.displacements(at.tolist()).astype(np.float32),
        manifest=np.array(motion.manifest),
    )


def csv_rows(motion: Motion, at: NDArray[np.float64]) -> Iterator[str]:
    """The text of a CSV in pieces: t and the displacement of each point, a row an instant."""
    names = ",".join('"' + name.replace('"', '""') + ' [m]"' for name in motion.names)
    yield f"# {MARK.decode()}\nt [s],{names}\n"
    count = max(1, _BLOCK // max(1, len(motion.names)))
    for first in range(0, len(at), count):
        some = at[first : first + count].tolist()
        for t, row in zip(some, motion.displacements(some), strict=True):
            numbers = ("" if math.isnan(x) else repr(float(x)) for x in row)
            yield f"{t!r},{','.join(numbers)}\n"


def gltf(motion: Motion, at: NDArray[np.float64], exaggeration: float) -> str:
    """A glTF 2.0 scene: a node for each point under a node for each part, moved along y (up).

    A displacement is `exaggeration` times as large as it is. Everything is in one file. Raises
    NotMotionError where there are too many points.
    """
    import numpy as np

    if len(motion.names) > _TARGETS_MAX:
        raise NotMotionError(
            f"glTF has a node for each point, {_TARGETS_MAX:,} at most; this has "
            f"{len(motion.names):,}: write npz"
        )
    manifest, places = about(motion), motion.places()
    moved = motion.displacements(at.tolist())
    # glTF is right-handed with y up: (x, y, z) of the bench is (x, z, -y).
    still = np.stack([places[:, 0], places[:, 2], -places[:, 1]], axis=1)
    data, views, accessors = bytearray(), [], []

    def array(values: NDArray[np.float32], kind: str, *, bounds: bool = False) -> int:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        found: dict[str, Any] = {
            "bufferView": len(views) - 1,
            "componentType": _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            found["min"], found["max"] = rows.min(0).tolist(), rows.max(0).tolist()
        accessors.append(found)
        data.extend(values.astype("<f4").tobytes())
        return len(accessors) - 1

    side = 0.004  # [m], of the little octahedron that each point is
    corners = np.array(
        [[side, 0, 0], [-side, 0, 0], [0, side, 0], [0, -side, 0], [0, 0, side], [0, 0, -side]],
        dtype=np.float32,
    )
    faces = [(0, 2, 4), (4, 2, 1), (1, 2, 5), (5, 2, 0), (4, 3, 0), (1, 3, 4), (5, 3, 1), (0, 3, 5)]
    flat = corners[np.array(faces).ravel()]
    mesh = {"primitives": [{"attributes": {"POSITION": array(flat, "VEC3", bounds=True)}}]}
    times = array(at.astype(np.float32), "SCALAR", bounds=True)
    nodes: list[dict[str, Any]] = []
    samplers, channels, roots = [], [], []
    for part in manifest["parts"]:
        parent = len(nodes)
        roots.append(parent)
        children = list(range(parent + 1, parent + 1 + part["count"]))
        nodes.append({"name": part["name"], "children": children})
        for point in range(part["first"], part["first"] + part["count"]):
            place = still[point].astype(np.float32)
            nodes.append({"name": motion.names[point], "mesh": 0, "translation": place.tolist()})
            column = moved[:, point]
            if not np.isfinite(column).all() or not column.any():
                continue
            path = np.tile(place, (len(at), 1))
            path[:, 1] += (exaggeration * column).astype(np.float32)
            output = array(path, "VEC3")
            samplers.append({"input": times, "output": output, "interpolation": _LINEAR})
            target = {"node": len(nodes) - 1, "path": "translation"}
            channels.append({"sampler": len(samplers) - 1, "target": target})
    whole: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": str(manifest.get("made_by"))},
        "scene": 0,
        "scenes": [{"name": str(manifest.get("title") or "ergon"), "nodes": roots}],
        "nodes": nodes,
        "meshes": [mesh],
        "accessors": accessors,
        "bufferViews": views,
    }
    if channels:
        motion_of = {"name": "motion", "samplers": samplers, "channels": channels}
        whole["animations"] = [motion_of]
    uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(data)).decode()
    whole["buffers"] = [{"byteLength": len(data), "uri": uri}]
    return json.dumps(whole)


def automatic(motion: Motion) -> float:
    """The exaggeration at which the largest displacement of all is drawn as 5 cm."""
    kinds = [chunk.kind for chunk in motion.chunks()]
    peaks = [i for i, kind in enumerate(kinds) if kind == _PEAKS]
    if not peaks:
        return 1.0
    payload = motion.payload(peaks[-1])
    largest = max(struct.unpack(f"<{len(payload) // 4}f", payload), default=0.0)
    return 0.05 / largest if largest > 0.0 else 1.0
