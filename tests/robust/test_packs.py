"""Packs: the same piece everywhere, and nothing written by those of strangers."""

import hashlib
import io
import json
import os
import stat
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

import ergon
from ergon import _core
from ergon.cli import app
from ergon.exchange.pack import BYTES_MAX, FILES_MAX, Pack, PackError, pack_bytes, read_pack
from ergon.scores.reading.digest import digest_of

SCORE = """\
ergon: 1
title: packed
use: [../common/gestures.yaml, instruments/bells.yaml]
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  k2: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 300ms}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
      c: {BUT: {between: [k2, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
takes: {hand: {file: takes/hand.csv}}
players: {ada: {key: k1}, remi: {key: k2}}
parts:
  ada: [{at: 1|1, play: knock}]
  remi: [{at: 1|2, play: hand}]
mix: {layout: layouts/pair.yaml, route: [{from: bell, to: [1, 2], pan: -0.4}]}
render: {file: ../../../sound.wav, tail: 200ms}
"""
GESTURES = "gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}\n"
LAYOUT = "speakers: [{az: 30deg}, {az: -30deg}]\n"
HAND = "t [s],x [m]\n" + "".join(f"{i / 100},{0.004 * (1 - abs(i - 10) / 10)}\n" for i in range(21))

pytestmark = pytest.mark.usefixtures("work_folder")


@pytest.fixture(autouse=True)
def temporary(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of temporary files, which must be empty at the end."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def project() -> Path:
    """A project of a score in a folder of its own, with files of three kinds."""
    files = {
        "one/ergon.project": "",
        "one/pieces/piece.yaml": SCORE.replace("../../../sound.wav", "sound.wav"),
        "one/common/gestures.yaml": GESTURES,
        "one/pieces/takes/hand.csv": HAND,
        "one/pieces/layouts/pair.yaml": LAYOUT,
    }
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text)
    return Path("one/pieces/piece.yaml")


def packed(capsys: pytest.CaptureFixture[str]) -> bytes:
    assert app.run(["pack", str(project()), "-o", "piece.ergonpack"]) == 0, capsys.readouterr().err
    return Path("piece.ergonpack").read_bytes()


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_render_of_a_pack_in_another_folder(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, temporary: Path
):
    packed(capsys)
    score = "one/pieces/piece.yaml"
    assert app.run(["render", score, "-o", "own.wav"]) == 0, capsys.readouterr().err
    original = Path("own.wav").read_bytes()
    elsewhere = Path("else where")
    elsewhere.mkdir()
    Path("piece.ergonpack").rename(elsewhere / "piece.ergonpack")
    Path("one").rename("gone")
    monkeypatch.chdir(elsewhere)
    assert app.run(["render", "piece.ergonpack", "--motion"]) == 0, capsys.readouterr().err
    assert Path("piece.wav").read_bytes() == original
    motion = Path("piece.motion").read_bytes()
    assert app.run(["render", "piece.ergonpack", "--motion", "-f"]) == 0, capsys.readouterr().err
    assert Path("piece.motion").read_bytes() == motion
    assert "piece.ergonpack:pieces/piece.yaml" in _core.read_motion("piece.motion").manifest
    assert sorted(os.listdir()) == ["piece.ergonpack", "piece.motion", "piece.wav"]
    assert os.listdir(temporary) == []


def test_bytes_of_a_pack_do_not_depend_on_the_folder(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    first = packed(capsys)
    Path("deep/er").mkdir(parents=True)
    monkeypatch.chdir("deep/er")
    os.utime(project(), (1e9, 1e9))
    monkeypatch.chdir("one")
    assert app.run(["pack", "pieces/piece.yaml", "-o", "again.ergonpack"]) == 0
    assert Path("again.ergonpack").read_bytes() == first
    assert app.run(["pack", "again.ergonpack", "-o", "twice.ergonpack"]) == 0
    assert Path("twice.ergonpack").read_bytes() == first


def test_content_of_a_pack(capsys: pytest.CaptureFixture[str]):
    packed(capsys)
    assert app.run(["info", "piece.ergonpack", "--json"]) == 0
    record = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert record["score"] == "pieces/piece.yaml"
    assert [row["file"] for row in record["files"]] == [
        "common/gestures.yaml",
        "pieces/instruments/bells.yaml",
        "pieces/layouts/pair.yaml",
        "pieces/piece.yaml",
        "pieces/takes/hand.csv",
    ]
    digest = hashlib.sha256(HAND.encode()).hexdigest()
    assert record["files"][-1]["sha256"] == digest


def test_packed_instrument_preferred_to_later_library(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    from ergon.notation.text import bounds, files
    from ergon.scores.reading.load import load

    packed(capsys)
    assert app.run(["unpack", "piece.ergonpack"]) == 0
    digest = digest_of(load("one/pieces/piece.yaml").piece)
    later = tmp_path / "later"
    later.mkdir()
    (later / "bells.yaml").write_text("nonsense: [")
    monkeypatch.setitem(files._LIBRARY, "instruments", later)
    monkeypatch.setattr(bounds, "SHIPPED_INSTRUMENTS_FOLDER", later)
    assert load("one/pieces/piece.yaml").piece is None
    assert digest_of(load("piece/pieces/piece.yaml").piece) == digest


@pytest.mark.parametrize(
    "arguments",
    [
        ["check", "--simulate"],
        ["plan"],
        ["compile"],
        ["modes"],
        ["stats"],
        ["plot", "knock"],
        ["export", "-o", "daw"],
    ],
    ids=lambda words: words[0],
)
def test_commands_read_pack_as_score(
    arguments: list[str], capsys: pytest.CaptureFixture[str], temporary: Path
):
    packed(capsys)
    first, *more = arguments
    assert app.run([first, "one/pieces/piece.yaml", *more, *(["-f"] if "-o" in more else [])]) == 0
    original = capsys.readouterr().out
    assert app.run([first, "piece.ergonpack", *more, *(["-f"] if "-o" in more else [])]) == 0
    output = capsys.readouterr()
    if first != "plan":  # which says how long it took
        assert output.out.replace("piece.ergonpack:", "one/") == original
    assert str(temporary) not in output.out + output.err
    assert os.listdir(temporary) == []


def test_mistake_in_a_pack_has_a_place_in_it(capsys: pytest.CaptureFixture[str], temporary: Path):
    text = "ergon: 1\ninstruments:\n  bell: {CEL: {M: 2x}}\n"
    Path("bad.ergonpack").write_bytes(
        pack_bytes(Pack("score.yaml", "1", {"score.yaml": text.encode()}))
    )
    assert app.run(["check", "bad.ergonpack"]) == 1
    assert "bad.ergonpack:score.yaml:3:20: error[" in capsys.readouterr().err
    assert app.run(["render", "bad.ergonpack", "--json"]) == 1
    record = json.loads(capsys.readouterr().out.splitlines()[0])
    assert (record["file"], record["line"]) == ("bad.ergonpack:score.yaml", 3)
    assert os.listdir() == ["bad.ergonpack"]
    assert os.listdir(temporary) == []


def test_score_with_mistakes_is_not_packed(capsys: pytest.CaptureFixture[str]):
    Path("bad.yaml").write_text("ergon: 1\nuse: [nothing.yaml]\n")
    assert app.run(["pack", "bad.yaml"]) == 1
    assert "E107" in capsys.readouterr().err
    assert os.listdir() == ["bad.yaml"]


def test_absolute_path_in_use_not_packed(capsys: pytest.CaptureFixture[str]):
    Path("g.yaml").write_text(GESTURES)
    Path("s.yaml").write_text(f"ergon: 1\nuse: ['{os.path.abspath('g.yaml')}']\n")
    assert app.run(["pack", "s.yaml"]) == 2
    assert "g.yaml lies outside the score's folder; in a pack" in capsys.readouterr().err
    assert sorted(os.listdir()) == ["g.yaml", "s.yaml"]


def test_render_of_pack_writes_only_to_current_folder(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """The score in the pack names a file that would lie outside the folder."""
    files = {
        "a/b/c/d/piece.yaml": SCORE.replace("../common", "common"),
        "a/b/c/d/common/gestures.yaml": GESTURES,
        "a/b/c/d/takes/hand.csv": HAND,
        "a/b/c/d/layouts/pair.yaml": LAYOUT,
    }
    content = {name: text.encode() for name, text in files.items()}
    Path("x/y/z").mkdir(parents=True)
    monkeypatch.chdir("x/y/z")
    Path("p.ergonpack").write_bytes(pack_bytes(Pack("a/b/c/d/piece.yaml", "1", content)))
    assert app.run(["render", "p.ergonpack"]) == 0, capsys.readouterr().err
    assert sorted(os.listdir()) == ["p.ergonpack", "piece.wav"]
    assert os.listdir("../../..") == ["x"]


def test_unpacked_files_equal_packed_files(capsys: pytest.CaptureFixture[str]):
    data = packed(capsys)
    assert app.run(["unpack", "piece.ergonpack", "-o", "two"]) == 0, capsys.readouterr().err
    for name in ("pieces/piece.yaml", "common/gestures.yaml", "pieces/takes/hand.csv"):
        assert Path("two", name).read_bytes() == Path("one", name).read_bytes()
    assert app.run(["pack", "two/pieces/piece.yaml", "-o", "two.ergonpack"]) == 0
    assert Path("two.ergonpack").read_bytes() == data
    assert app.run(["unpack", "piece.ergonpack", "-o", "two"]) == 2
    assert "two exists already and is not empty" in capsys.readouterr().err


def test_commands_editing_score_refuse_pack(capsys: pytest.CaptureFixture[str]):
    data = packed(capsys)
    assert app.run(["fmt", "piece.ergonpack"]) == 2
    assert "ergon unpack" in capsys.readouterr().err
    assert app.run(["tune", "piece.ergonpack", "bell", "A4", "--write"]) == 2
    assert "ergon unpack" in capsys.readouterr().err
    assert Path("piece.ergonpack").read_bytes() == data


# --- hostile packs -------------------------------------------------------------------------------


def crafted(
    files: dict[str, bytes],
    *,
    manifest: Callable[[dict], object] | None = lambda table: table,
    compression: int = zipfile.ZIP_STORED,
    mode: int = stat.S_IFREG | 0o644,
    prefix: str = "files/",
) -> bytes:
    """A pack made by hand, with right hashes."""
    listed = {
        name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files.items()
    }
    table = {"format": 1, "ergon": "1", "score": "score.yaml", "files": listed}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        if manifest is not None:
            archive.writestr("ergonpack.json", json.dumps(manifest(table)))
        for name, data in files.items():
            entry = zipfile.ZipInfo(prefix + name)
            entry.external_attr = mode << 16
            entry.compress_type = compression
            archive.writestr(entry, data)
    return stream.getvalue()


PLAIN = {"score.yaml": b"ergon: 1\n"}


def with_name(name: str) -> Callable[[], bytes]:
    return lambda: crafted({**PLAIN, name: b"evil"})


def without(**fields: object) -> Callable[[], bytes]:
    return lambda: crafted(PLAIN, manifest=lambda table: {**table, **fields})


def doubled() -> bytes:
    """Two entries of one name."""
    data = crafted({**PLAIN, "scorf.yaml": b"other"})
    return data.replace(b"files/scorf.yaml", b"files/score.yaml")


def many_files() -> bytes:
    return crafted({f"{i}.yaml": b"" for i in range(FILES_MAX + 1)} | PLAIN)


def long_list() -> bytes:
    """A list of files that is longer than its number of files says."""
    data = bytearray(crafted({f"{i:0150}": b"" for i in range(100)} | PLAIN))
    data[-12:-10] = data[-14:-12] = (2).to_bytes(2, "little")
    return bytes(data)


def sizes_that_lie() -> bytes:
    """A file that says that it has 4 GB."""
    data = bytearray(crafted(PLAIN))
    start = data.rindex(b"PK\1\2")
    data[start + 20 : start + 28] = b"\xf0\xff\xff\xff" * 2
    return bytes(data)


def changed_byte() -> bytes:
    """Other content under right check sums of ZIP, and the hash of what was packed."""
    evil = b"ergon: 2\n"
    digest = hashlib.sha256(PLAIN["score.yaml"]).hexdigest()
    listed = {"score.yaml": {"bytes": len(evil), "sha256": digest}}
    return crafted({"score.yaml": evil}, manifest=lambda table: {**table, "files": listed})


HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "climbs": (with_name("../evil.yaml"), "leads out of the pack"),
    "climbs inside": (with_name("a/../../evil.yaml"), "leads out of the pack"),
    "absolute": (with_name("/tmp/evil.yaml"), "leads out of the pack"),
    "drive": (with_name("C:/evil.yaml"), "leads out of the pack"),
    "backslash": (with_name("..\\evil.yaml"), "has a character"),
    "control character": (with_name("a\x1b[2Jb"), "has a character"),
    "turned writing": (with_name("a\u202eb.yaml"), "has a character"),
    "stream": (with_name("a.yaml:evil"), "has a character"),
    "hidden": (with_name(".git/hooks/post-checkout"), "neither a dot nor a space"),
    "device": (with_name("aux.yaml"), "device"),
    "empty part": (with_name("a//b"), "neither a dot nor a space"),
    "long name": (with_name("a" * 300), "200 bytes at most"),
    "case": (with_name("SCORE.yaml"), "one file on some systems"),
    "accents": (lambda: crafted({**PLAIN, "\xe9": b"", "e\u0301": b""}), "on some systems"),
    "file and folder": (with_name("score.yaml/evil"), "is a file and a folder"),
    "twice": (doubled, "two files"),
    "symlink": (lambda: crafted(PLAIN, mode=stat.S_IFLNK | 0o777), "is a link or a folder"),
    "device node": (lambda: crafted(PLAIN, mode=stat.S_IFCHR | 0o666), "is a link or a folder"),
    "folder": (with_name("evil/"), "is a link or a folder"),
    "bomb": (
        lambda: crafted({"score.yaml": bytes(50 << 20)}, compression=zipfile.ZIP_DEFLATED),
        "is compressed",
    ),
    "sizes that lie": (sizes_that_lie, "more bytes than the pack"),
    "many files": (many_files, "files at most"),
    "long list": (long_list, "too long"),
    "wrong hash": (changed_byte, "its SHA-256 differs"),
    "no manifest": (lambda: crafted(PLAIN, manifest=None), "has no ergonpack.json"),
    "manifest of a list": (lambda: crafted(PLAIN, manifest=lambda _: [1]), "is not a table"),
    "other format": (without(format=99), "reads format 1"),
    "no score": (without(score="other.yaml"), "which of its files is the score"),
    "score of a list": (without(score=["score.yaml"]), "which of its files is the score"),
    "unlisted file": (without(files={}), "is not in ergonpack.json"),
    "missing file": (
        lambda: crafted(
            PLAIN, manifest=lambda table: {**table, "files": {**table["files"], "x": {}}}
        ),
        "'x' is missing",
    ),
    "no hash": (without(files={"score.yaml": 1}), "no SHA-256"),
    "elsewhere": (lambda: crafted(PLAIN, prefix="bin/"), "is no file of a pack"),
    "cut": (lambda: crafted(PLAIN)[:-30], "cut short"),
    "half": (lambda: (data := crafted(PLAIN))[: len(data) // 2], "cut short"),
    "longer": (lambda: crafted(PLAIN) + b"more", "cut short, or something was added"),
    "no pack": (lambda: b"ergon: 1\n", "is not a pack"),
    "empty": (lambda: b"", "is not a pack"),
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("command", ["render", "check", "unpack", "info", "repl"])
def test_hostile_pack_is_refused(
    name: str,
    command: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    temporary: Path,
):
    make, sentence = HOSTILE[name]
    Path("evil.ergonpack").write_bytes(make())
    before = tree(tmp_path)
    assert app.run([command, "evil.ergonpack"]) == 2
    output = capsys.readouterr()
    assert sentence in output.err
    assert output.err.startswith("error: evil.ergonpack: ")
    assert "\x1b[2J" not in output.err
    assert output.out == ""
    assert tree(tmp_path) == before
    assert os.listdir(temporary) == []
    assert os.listdir() == ["evil.ergonpack"]


def test_pack_cut_at_each_byte(tmp_path: Path):
    data = crafted(PLAIN)
    path = tmp_path / "cut.ergonpack"
    for size in range(len(data)):
        path.write_bytes(data[:size])
        with pytest.raises(PackError):
            read_pack(path)


def test_pack_with_any_byte_changed(tmp_path: Path):
    """Either what was packed comes out, or a sentence: never other files."""
    data = crafted(PLAIN)
    path = tmp_path / "changed.ergonpack"
    refused = 0
    for index in range(len(data)):
        for value in (0x00, 0xFF, data[index] ^ 1):
            path.write_bytes(data[:index] + bytes([value]) + data[index + 1 :])
            try:
                pack = read_pack(path)
            except PackError:
                refused += 1
            else:
                assert (pack.score, dict(pack.files)) == ("score.yaml", PLAIN)
    assert refused > len(data)


def test_missing_pack_is_refused(capsys: pytest.CaptureFixture[str]):
    assert app.run(["render", "none.ergonpack"]) == 2
    assert "none.ergonpack: No such file" in capsys.readouterr().err


def test_pack_larger_than_the_bound(capsys: pytest.CaptureFixture[str]):
    with open("large.ergonpack", "wb") as file:
        file.write(b"PK\3\4")
        file.truncate(BYTES_MAX + 1)
    assert app.run(["check", "large.ergonpack"]) == 2
    assert "256 MB at most" in capsys.readouterr().err


def test_pack_above_size_limit_is_refused():
    with pytest.raises(PackError, match="256 MB"):
        pack_bytes(Pack("a.yaml", "1", {"a.yaml": bytes(BYTES_MAX)}))


def test_pack_function_equals_pack_command(capsys: pytest.CaptureFixture[str]):
    data = packed(capsys)
    done = ergon.pack("one/pieces/piece.yaml", "other.ergonpack")
    assert Path("other.ergonpack").read_bytes() == data
    assert done.size == len(data)
    assert done.pack == read_pack(Path("piece.ergonpack"))


def test_unpacked_score_renders_the_same_samples_from_python():
    score = project()
    done = ergon.pack(score, "piece.ergonpack")
    expected = ergon.render(score).frames
    unpacked = ergon.unpack(done.path, "copy")
    assert unpacked.is_relative_to("copy")
    assert (ergon.render(unpacked).frames == expected).all()
    before = tree(Path("copy"))
    with pytest.raises(ergon.ErgonError):
        ergon.unpack(done.path, "copy")
    assert tree(Path("copy")) == before


def test_changed_pack_is_refused_from_python():
    path = Path(ergon.pack(project(), "piece.ergonpack").path)
    data = bytearray(path.read_bytes())
    data[data.index(b"title: packed") + 7] ^= 1
    path.write_bytes(data)
    with pytest.raises(ergon.PackError):
        ergon.unpack(path, "copy")
    assert not Path("copy").exists()
