"""What a take may cost in memory, measured of a process of its own."""

import io
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

_CHILD = """
import resource, sys
from pathlib import Path
import ergon.cli.take_info, ergon.scores.gesture.takes, ergon.scores.gesture.summary
from ergon.cli import app

kind, name = sys.argv[1:]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if kind == "info":
    code = app.run(["info", name])
else:
    from ergon.scores.gesture.takes import TakeError, read
    code = 0
    try:
        read(Path(name), "x", rate=100.0)
    except TakeError as error:
        print(error, file=sys.stderr)
        code = 2
print(code, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
MORE = 100_000 if sys.platform != "darwin" else 100_000_000  # ru_maxrss: kB, on macOS bytes


def cost(kind: str, path: Path) -> tuple[int, int, str]:
    """Exit code, how much larger the process became, and what it said."""
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, kind, str(path)], capture_output=True, text=True, check=True
    )
    code, more = done.stdout.split("\n")[-2].split()
    return int(code), int(more), done.stderr


def npy(shape: str, descr: str = "<f8") -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (117 - len(text)) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def bomb(
    path: Path, shape: str, n_bytes: int, name: str = "x.npy", members: int = 1, level: int = 1
) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as archive:
        for i in range(members):
            with archive.open(name.replace("x", f"x{i or ''}"), "w", force_zip64=True) as member:
                member.write(npy(shape))
                for _ in range(n_bytes // 2**20):
                    member.write(bytes(2**20))


def overlapping(path: Path) -> None:
    """A thousand members that are the same bytes (D. Fifield, A better zip bomb, 2019)."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", npy("(2500000,)") + bytes(20_000_000))
        (only,) = archive.infolist()
        for i in range(1000):
            again = zipfile.ZipInfo(f"x{i}.npy")
            for name in ("compress_size", "file_size", "CRC", "header_offset", "compress_type"):
                setattr(again, name, getattr(only, name))
            archive.filelist.append(again)
            archive.NameToInfo[again.filename] = again
        archive._didModify = True
    path.write_bytes(packed.getvalue())


def lying(path: Path, size: int) -> None:
    """A member that says that it is larger than deflate can make it of its bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", npy(f"({(size - 128) // 8},)") + bytes(80))
        archive.infolist()[0].file_size = size
        archive._didModify = True


def directory(path: Path) -> None:
    """Half a million members of nothing: 30 MB of directory that is read before anything else."""
    entry = b"PK\x01\x02" + bytes(24) + b"\x0c\x00" + bytes(16)
    entries = b"".join(entry + b"x%07d.npy" % i for i in range(500_000))
    end = b"PK\x05\x06" + bytes(8) + len(entries).to_bytes(4, "little") + bytes(4) + bytes(2)
    path.write_bytes(entries + end)


@pytest.fixture(scope="module")
def bombs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bombs")
    built = {
        name: folder / f"{name}.npz" for name in ("long", "many", "over", "lying", "directory")
    }
    bomb(built["long"], "(125829104,)", 960 * 2**20)
    bomb(built["many"], "(13107200,)", 100 * 2**20, members=12)
    overlapping(built["over"])
    lying(built["lying"], 150_000_000)
    directory(built["directory"])
    return built


@pytest.mark.parametrize("kind", ["info", "read"])
def test_decompression_bombs_are_refused_in_little_memory(bombs, kind):
    for name, path in bombs.items():
        assert path.stat().st_size < 32e6
        code, more, output = cost(kind, path)
        assert (name, code) == (name, 2)
        assert "internal" not in output
        assert more < MORE, name


def test_summary_of_long_take_uses_little_memory(tmp_path):
    """6 million samples and their times are 96 MB; a summary holds a block of them."""
    path = tmp_path / "long.npz"
    np.savez(path, t=np.arange(6e6), x=np.zeros(6_000_000))
    code, more, output = cost("info", path)
    assert code == 0
    assert more < 0.4 * MORE
    assert output == ""


@pytest.mark.slow
def test_npz_bomb_of_6_mb_is_refused(tmp_path):
    path = tmp_path / "bomb.npz"
    bomb(path, "(796917744,)", 6080 * 2**20, level=9)
    assert 5.5e6 < path.stat().st_size < 7e6
    for kind in ("info", "read"):
        code, more, output = cost(kind, path)
        assert code == 2
        assert "more than 1 GB" in output
        assert more < MORE


def test_csv_with_huge_row_is_refused(tmp_path):
    path = tmp_path / "long.csv"
    with path.open("wb") as file:
        file.write(b"t [s],x [mm]\n0,")
        for _ in range(200):
            file.write(b"0" * 2**20)
    code, more, _ = cost("info", path)
    assert code == 2
    assert more < MORE
