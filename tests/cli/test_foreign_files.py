"""Files of other programs: each command says what such a file is, and what to do instead."""

import gzip
import json
from pathlib import Path

import pytest
from sweep import few

from ergon.cli.app import run
from ergon.common.foreign_files import foreign_file, foreign_form

# A file of each kind, as its program writes it: name, bytes, what it is, what to do.
FILES = {
    "a.maxpat": (json.dumps({"patcher": {"fileversion": 1}}), "a patch of Max", ".mdl"),
    "max.json": (json.dumps({"patcher": {"boxes": []}}, indent=1), "a patch of Max", ".mdl"),
    "a.amxd": (b"ampf\x04\0\0\0mmmmmeta", "a device of Max for Live", ".mdl"),
    "a.scd": ("s.boot;\n{ SinOsc.ar(440) * 0.1 }.play;\n", "SuperCollider", "WAV or FLAC"),
    "a.csd": ("<CsoundSynthesizer>\n<CsInstruments>\n", "a program of Csound", "WAV or FLAC"),
    "csound.txt": ("; tune\n<CsoundSynthesizer>\n", "a program of Csound", "WAV or FLAC"),
    "a.ck": ("SinOsc s => dac;\n", "a program of ChucK", "WAV or FLAC"),
    "a.tidal": ('d1 $ sound "bd sn"\n', "patterns of TidalCycles", "ergon help patterns"),
    "a.ly": ('\\version "2.24.0"\n{ c4 d }\n', "a score of LilyPond", "MusicXML or MIDI"),
    "a.abc": ("X:1\nT:a\nK:C\nCDEF|\n", "a tune in ABC", "MusicXML or MIDI"),
    "score.xml": ('<?xml version="1.0"?>\n<museScore version="4.0"/>', "MuseScore", "MusicXML"),
    "a.mscz": (b"PK\3\4" + bytes(40), "a score of MuseScore", "MusicXML"),
    "a.als": (gzip.compress(b"<Ableton/>"), "a set of Ableton Live", "export its tracks"),
    "a.rpp": ("<REAPER_PROJECT 0.1\n>\n", "a project of REAPER", "export its tracks"),
    "a.stl": ("solid a\n facet normal 0 0 1\n", "a shape in STL", "OBJ or glTF"),
    "a.blend": (b"BLENDER-v300", "a scene of Blender", "OBJ or glTF"),
    "a.xlsx": (b"PK\3\4" + bytes(40), "a sheet of a spreadsheet", "CSV"),
    "a.mat": (b"MATLAB 5.0 MAT-file, Platform", "a file of MATLAB", "CSV"),
    "a.npy": (b"\x93NUMPY\x01\0", "an array of NumPy", ".npz"),
    "a.sf2": (b"RIFF\x10\0\0\0sfbkLIST", "a SoundFont", "ergon bell"),
    "a.mp4": (b"\0\0\0\x18ftypmp42", "MPEG-4", "WAV or FLAC"),
    "a.png": (b"\x89PNG\r\n\x1a\n", "a picture", "is meant"),
    "a.zip": (b"PK\3\4" + bytes(40), "an archive", "unpack it"),
}
READ = (
    b"RIFF\0\0\0\0WAVEfmt ",
    b"fLaC",
    b"FORM",
    b"MThd\0\0\0\6",
    b"ergon: 1\n",
    b"v 0 0 1\n",
    b"t [s],x\n",
    b"\xef\xbb\xbft [s],x",
    b"\xff\xfet\0",
    b"PK\3\4",
    b"\x89HDF\r\n\x1a\n",
    b"HIERARCHY\n",
    b"PathFileType\t4",
    b"SDIF",
    b"ERGM",
    b"# comment\n@m mass\n",
    b"#N canvas 0 0;",
    b"! scale.scl\n",
    b"<?xml version='1.0'?>\n<score-partwise>",
    b'{"LoudspeakerLayout": {}}',
)


def written(folder: Path, name: str) -> Path:
    data = FILES[name][0]
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return folder / name


@pytest.mark.parametrize("name", few([*FILES], 6))
def test_info_names_file_of_another_program(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = written(tmp_path, name)
    assert run(["info", str(path)]) == 2
    _, form, advice = FILES[name]
    error = capsys.readouterr().err
    assert f"{path}: it is " in error
    assert form in error
    assert advice in error
    assert "which is not read" in error


@pytest.mark.parametrize("name", few(["a.maxpat", "a.scd", "a.csd", "a.als", "a.png"], 2))
@pytest.mark.parametrize(
    "command", ["check", "render", "import", "take info", "take import -o new.take", "bell"]
)
def test_commands_name_file_of_another_program(
    name: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = written(tmp_path, name)
    assert run([*command.split(), str(path)]) == 2
    error = capsys.readouterr().err
    assert FILES[name][1] in error
    assert FILES[name][2] in error


def test_score_names_take_and_mesh_of_another_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    score = tmp_path / "score.yaml"
    score.write_text(
        "ergon: 1\n"
        "takes: {walk: {file: walk.fbx, channel: x}}\n"
        "instruments:\n"
        "  b:\n"
        "    space: 3\n"
        "    modules: {net: {MESH: {file: bowl.stl, M: 40g, at: [0, 0, 0], K: 1N/m}}}\n"
    )
    for name in ("walk.fbx", "bowl.stl"):
        (tmp_path / name).write_bytes(b"x")
    run(["check", str(score)])
    mistakes = "".join(capsys.readouterr())
    assert "it is a scene in FBX, which is not read" in mistakes
    assert "it is a shape in STL, which is not read" in mistakes


@pytest.mark.parametrize("head", READ)
def test_foreign_form_of_readable_files(head: bytes):
    assert foreign_form(head) is None


def test_foreign_file_of_missing_path(tmp_path: Path):
    assert foreign_file(tmp_path / "no.scd") is None


def test_score_with_foreign_ending_is_read(tmp_path: Path):
    path = tmp_path / "piece.rb"
    path.write_text("ergon: 1\ninstruments: {bell: {from: bells/bowl, f: A4}}\n")
    assert run(["check", str(path)]) == 0


def test_info_of_empty_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "empty"
    path.write_bytes(b"")
    assert run(["info", str(path)]) == 2
    assert capsys.readouterr().err == f"error: {path} is empty\n"
