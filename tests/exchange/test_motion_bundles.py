"""Motion files with bundles: chunks that are deflated together."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from motion_reader import BUNDLE, FRAMES, INDEX, MAKER, chunks
from motions import LEVELS, MANIFEST, Piece, bundle, bundled, chunk, group

from ergon import _core
from ergon.cli import app

HEAD = b"ERGM\x03\0\0\0"
SCORE = """\
ergon: 1
instruments:
  s:
    modules: {wire: {STRING: {masses: 12, f: 110Hz, t60: 2s, M: 10g, hardening: 1e6}}}
    out: {SOX: wire.all}
  sky:
    BANK: {count: 40, f: 100Hz..2kHz, t60: 2s, M: 1g}
    out: {SOX: sky.all}
strikes:
  rain: {to: sky.all, at: 0s, for: 3s, rate: 20Hz, impulse: -1uNs..1uNs}
  pluck: {to: s.wire.3, at: 0.5s, impulse: 1mNs}
mix: {channels: 8, route: [{from: sky, to: 1}, {from: s, to: 2}]}
render: {tail: 1s}
"""


def outer(data: bytes) -> list[tuple[int, int]]:
    """Kind and length of the chunks in a file itself."""
    sizes, position = [], 8
    while position < len(data):
        kind, _, length = struct.unpack_from("<HHI", data, position)
        sizes.append((kind, length))
        position += 20 + length
    return sizes


@pytest.fixture
def rendered(work_folder: Path) -> bytes:
    Path("a.yaml").write_text(SCORE)
    assert app.run(["render", "-q", "--motion", "a.yaml", "-o", "a.wav"]) == 0
    return Path("a.motion").read_bytes()


def test_motion_with_bundles_is_shorter(rendered: bytes) -> None:
    assert rendered.startswith(HEAD)
    kinds = Counter(kind for kind, _ in outer(rendered))
    assert set(kinds) == {MAKER, BUNDLE, FRAMES, INDEX}
    packed = sum(20 + length for kind, length in outer(rendered) if kind == BUNDLE)
    inside = [one for one in chunks(rendered) if one[0] not in (MAKER, FRAMES, INDEX)]
    assert packed <= 0.5 * sum(20 + len(payload) for _, _, payload, _ in inside)
    # The first bytes show that the file is one of ours, so it may be written again.
    assert rendered[24:37] == b"made by ergon"
    render = ["render", "-q", "--motion", "a.yaml", "-o", "a.wav"]
    assert app.run(render) == 0
    assert Path("a.motion").read_bytes() == rendered


def test_motion_bundles_for_thread_counts(rendered: bytes) -> None:
    for threads in ("1", "3"):
        render = ["render", "-q", "--motion", "--threads", threads, "a.yaml", "-o", "b.wav"]
        assert app.run(render) == 0
        assert Path("b.motion").read_bytes() == rendered


def test_motion_of_format_2_is_read_as_with_bundles(tmp_path: Path) -> None:
    data = Piece().bytes()
    assert data[4] == 2
    files = []
    for name, content in (("old", data), ("new", bundled(data))):
        (tmp_path / name).write_bytes(content)
        files.append(_core.read_motion(tmp_path / name))
    old, new = files
    assert (new.is_whole, new.manifest, new.names) == (True, old.manifest, old.names)
    instants = np.linspace(0.0, old.duration, 50).tolist()
    np.testing.assert_array_equal(new.displacements(instants), old.displacements(instants))
    old_chunks, new_chunks = (
        sorted((one.kind, one.seconds, file.payload(i)) for i, one in enumerate(file.chunks()))
        for file in files
    )
    assert new_chunks == old_chunks


ZEROS = bytes(16 << 20)


def levels(width: int = 4, count: int = 1, length: int = 8) -> bytes:
    """A group of levels, as it is where nothing is changed."""
    return group(LEVELS, width, [(float(t), bytes(length)) for t in range(count)])


def stream(groups: bytes, length: int | None = None) -> bytes:
    """A bundle that says it is `length` long."""
    return struct.pack("<I", len(groups) if length is None else length) + bundle(groups)[4:]


DAMAGED = {
    "no bytes": b"",
    "no stream": struct.pack("<I", 24),
    "cut": bundle(levels())[:-3],
    "wrong sum": bundle(levels())[:-1] + b"?",
    "more behind": bundle(levels()) + b"?",
    "too short": stream(levels(), len(levels()) + 1),
    "too long": stream(levels(), len(levels()) - 1),
    "no width": bundle(b"\x07\0\0\0" + levels()[4:]),
    "a bundle": bundle(group(BUNDLE, 1, [(0.0, bundle(levels()))])),
    "many chunks": bundle(b"\x07\0\4\0\xff\xff\xff\xff" + levels()[8:]),
    "long chunks": bundle(levels()[:16] + b"\xff\xff\xff\xff" + levels()[20:]),
    "half a head": bundle(levels() + b"\x07\0\4"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_info_of_damaged_bundle(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.motion"
    path.write_bytes(HEAD + chunk(BUNDLE, 0.0, DAMAGED[case]))
    assert app.run(["info", str(path)]) == 2
    assert "a chunk of kind 18 at byte 24 of this motion file is damaged" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 2])
def test_info_of_bundles_longer_than_the_bound(
    count: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One bundle says that it is huge, or several are together more than a file may hold."""
    payload = stream(b"", 1 << 31) if count == 1 else bundle(group(LEVELS, 4, [(0.0, ZEROS[:-64])]))
    data = HEAD + count * chunk(BUNDLE, 0.0, payload)
    path = tmp_path / "a.motion"
    path.write_bytes(data)
    assert app.run(["info", str(path)]) == 2
    place = 24 + (count - 1) * (20 + len(payload))
    length = 1 << 31 if count == 1 else len(ZEROS) - 64 + 20
    assert (
        f"the bundle at byte {place} of this motion file would unpack to {length} bytes, more than "
        "a file of this length may hold" in capsys.readouterr().err
    )


def test_info_of_motion_cut_in_a_bundle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = bundled(Piece().bytes())
    sizes = [20 + length for _, length in outer(data)]
    path = tmp_path / "a.motion"
    path.write_bytes(data[: 8 + sum(sizes[:5]) + 30])
    assert app.run(["info", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[0].endswith(", cut")
    kinds = {one.kind for one in _core.read_motion(path).chunks()}
    assert {MANIFEST, LEVELS, FRAMES} <= kinds
