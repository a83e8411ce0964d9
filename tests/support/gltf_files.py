"""A glTF scene of six vertices, embedded and binary."""

import base64
import json
import struct
from typing import Any

CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (0, 1, 0), (0, 0, 1)]


def tetrahedron(mode: int = 4, indices: tuple[int, ...] = (0, 1, 2, 3, 4, 5), **node: Any) -> dict:
    """A tetrahedron without one of its faces; vertices are repeated for each face."""
    data = struct.pack("<18f", *(part for corner in CORNERS for part in corner))
    data += struct.pack(f"<{len(indices)}H", *indices)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    views = [{"buffer": 0, "byteLength": 72}, {"buffer": 0, "byteOffset": 72, "byteLength": 99}]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": len(indices), "type": "SCALAR"},
    ]
    part = {"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [10, 0, 0]}, {"mesh": 0, **node}],
        "meshes": [{"primitives": [part]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": uri}],
    }


def binary(root: dict) -> bytes:
    """The same scene as a binary file: its data in a separate chunk."""
    _, data = root["buffers"][0]["uri"].split(",")
    chunk = base64.b64decode(data)
    chunk += b"\0" * (-len(chunk) % 4)
    root = {**root, "buffers": [{"byteLength": root["buffers"][0]["byteLength"]}]}
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(chunk), b"BIN\0") + chunk
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
