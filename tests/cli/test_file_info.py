"""`ergon info` of files of other programs: what is read of them, and what is passed over."""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from commands import forked
from one_bell import SCORE

from ergon.cli.app import run
from ergon.cli.file_info import READERS
from ergon.exchange import wave
from ergon.exchange.iff import chunks

TUNE = (
    '<score-partwise><work><work-title>Two bars</work-title></work><part-list><score-part id="P1">'
    '<part-name>Bars</part-name></score-part><score-part id="P2"/></part-list><part id="P1">'
    "<measure><attributes><divisions>2</divisions><time><beats>3</beats><beat-type>4</beat-type>"
    '</time></attributes><direction><sound tempo="72"/></direction><direction><direction-type>'
    "<dynamics><pp/></dynamics></direction-type></direction>"
    "<note><pitch><step>D</step><alter>1</alter><octave>4</octave></pitch><duration>4</duration>"
    "<notations><fermata/></notations></note>"
    "<note><pitch><step>B</step><octave>4</octave></pitch><duration>2</duration></note></measure>"
    "<measure><note><rest/><duration>6</duration></note></measure></part>"
    '<part id="P2"><measure><note><rest/><duration>3</duration></note></measure>'
    "<measure><note><rest/><duration>3</duration></note></measure></part></score-partwise>"
)
_TUNE_READ: dict[str, object] = {
    "form": "score (MusicXML)",
    "title": "Two bars",
    "length": "6 quarters, 2 bars as played",
    "part P1 (Bars)": "2 notes, D#4 to B4, strengths 0.14 to 0.14",
    "part P2": "no notes",
    "tempo": "72 bpm",
    "meter": "3/4",
}
FILES: dict[str, str] = {
    "tune.musicxml": TUNE,
    "tune.xml": f"<?xml version='1.0'?>{TUNE}",
    "a.obj": "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nv 6 5 5\n"
    "f 1 2 3\nl 4 5\nvn 0 0 1\n",
    "a.scl": "! a.scl\nFifths\n2\n701.955\n2/1\n",
    "a.kbm": "12\n0\n127\n60\n60\n440.0\n12\n0\nx\n2\n",
    "a.mdl": "@m mass 1 0 0\n@g ground 0\n@s spring @g @m 0.01\n@out1 posOutput @m\n",
    "gris.xml": '<SPEAKER_SETUP><SPEAKER_1 DIRECT_OUT_ONLY="1"><POSITION X="0" Y="1" Z="0"/>'
    '</SPEAKER_1><SPEAKER_2 GAIN="-3"><POSITION X="0" Y="1" Z="0"/></SPEAKER_2></SPEAKER_SETUP>',
    "iem.json": '{"LoudspeakerLayout": {"Loudspeakers": [{"Azimuth": 0, "Elevation": 0}]}}',
    "ear.yaml": "speakers:\n- {channel: 3, names: LFE1}\n- {channel: 0, position: {az: 30}}\n",
    "ours.yaml": "ergon: 1\ntitle: two\nspeakers: [{az: 30}, {az: -30}]\noutputs: [1, 4]\n",
}


@pytest.mark.parametrize(
    ("name", "read", "passed"),
    [
        ("a.obj", {"points": 5, "edges": 4, "triangles": 1, "bodies": 2}, ["mtllib", "vn"]),
        ("a.scl", {"title": "Fifths", "degrees": 2}, ["1 comment"]),
        ("a.kbm", {"size of the map": 12, "middle key": 60}, []),
        ("a.mdl", {"statements": 4}, ["comments"]),
        (
            "gris.xml",
            {"loudspeakers": 1, "outputs": "2"},
            ["output 1 is a direct out", "gain of output 2", "names"],
        ),
        ("iem.json", {"loudspeakers": 1, "outputs": "1 to 1"}, ["names"]),
        ("ear.yaml", {"loudspeakers": 1}, ["output 4 (LFE1)", "names"]),
        ("ours.yaml", {"loudspeakers": 2, "outputs": "1, 4"}, []),
        ("tune.musicxml", _TUNE_READ, ["1 fermata"]),
        ("tune.xml", _TUNE_READ, ["1 fermata"]),
    ],
)
def test_info_of_foreign_file_kinds(
    name: str, read: dict[str, object], passed: list[str], tmp_path: Path
):
    (tmp_path / name).write_text(FILES[name])
    done = forked(["info", name, "--json"], tmp_path)
    assert done.returncode == 0, done.stderr
    (record,) = (json.loads(line) for line in done.stdout.splitlines())
    assert {key: record[key] for key in read} == read
    assert len(record["passed_over"]) == len(passed)
    for word, sentence in zip(passed, record["passed_over"], strict=True):
        assert word in sentence
    shown = forked(["info", name], tmp_path)
    assert shown.stdout.startswith(f"{name}: ")
    assert shown.stdout.count("passed over: ") == max(1, len(passed))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "v 0 0\nf 1 2 3\n", "a vertex has three numbers"),
        ("a.scl", "x\ny\n", "the number of degrees"),
        ("a.gltf", "{}", "incomplete"),
        ("a.glb", "{}", "not a binary glTF file"),
        ("a.sofa", "{}", "a.sofa"),
        ("a.mdl", "hello\n", "a.mdl"),
        ("a.xml", "<a/>", "a.xml"),
    ],
)
def test_info_of_damaged_files(name: str, text: str, message: str, tmp_path: Path):
    (tmp_path / name).write_text(text)
    done = forked(["info", name], tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "internal error" not in done.stderr


def test_info_of_npz_with_unplayable_array(tmp_path: Path):
    np.savez(tmp_path / "a.npz", x=np.arange(4.0), about=np.array(["text"]))
    done = forked(["info", "a.npz"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "passed over: array about, which is not a row of numbers" in done.stdout


def test_info_of_a_gms_file_lists_its_chunks(tmp_path: Path):
    """GMS is an IFF file; chunks of odd size are followed by a byte, and groups hold chunks."""
    inner = b"LIST" + (4 + 8 + 3 + 1).to_bytes(4, "big") + b"UNIT" + b"NAME\0\0\0\3abc\0"
    body = b"GMS " + inner + b"DATA\0\0\0\2xy"
    (tmp_path / "a.gms").write_bytes(b"FORM" + len(body).to_bytes(4, "big") + body)
    done = forked(["info", "a.gms"], tmp_path)
    assert done.returncode == 0, done.stderr
    rows = [line.strip() for line in done.stdout.splitlines()[1:-1]]
    assert rows == [
        "0.1 FORM GMS: 38 bytes",
        "1.2 LIST UNIT: 16 bytes",
        "2.3 NAME: 3 bytes",
        "1.4 DATA: 2 bytes",
    ]
    (tmp_path / "a.gms").write_bytes(b"FORM" + len(body).to_bytes(4, "big") + body[:-1])
    done = forked(["info", "a.gms"], tmp_path)
    assert done.returncode == 2
    assert "the chunk FORM has 38 bytes, and 37 follow" in done.stderr


def test_chunks_of_aiff_by_libsndfile(tmp_path: Path):
    """An AIFF file is an IFF file, written here by another program."""
    soundfile.write(tmp_path / "a.aiff", np.zeros((100, 1)), 8000, "PCM_S8")
    walked = chunks((tmp_path / "a.aiff").read_bytes())
    assert (walked[0].name, walked[0].group_type) == ("FORM", "AIFF")
    sizes = {chunk.name: chunk.size for chunk in walked[1:]}
    assert sizes["COMM"] == 18
    assert sizes["SSND"] == 8 + 100
    assert {chunk.depth for chunk in walked[1:]} == {1}


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("notes.txt", b"milk\n\n\n"),
        ("README.md", b"# Bells\n"),
        ("settings.json", b'{"a": 1}'),
        ("page.xml", b"<a></a>"),
    ],
)
def test_info_of_unknown_file_is_refused(name: str, data: bytes, tmp_path: Path):
    (tmp_path / name).write_bytes(data)
    done = forked(["info", name], tmp_path)
    assert done.returncode == 2
    assert f"{name} is nothing that ergon reads; `ergon info` reads scores (.yaml); " in done.stderr
    for ending in READERS:
        assert ending in done.stderr or ending == ".yml"


def test_info_of_a_model_named_as_a_text(tmp_path: Path):
    (tmp_path / "model.txt").write_text(FILES["a.mdl"])
    done = forked(["info", "model.txt"], tmp_path)
    assert done.returncode == 0
    assert "statements: 4" in done.stdout


def test_info_of_score_without_suffix_and_bundled(tmp_path: Path):
    (tmp_path / "piece").write_text(SCORE)
    done = forked(["info", "piece"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "piece: One bell" in done.stdout
    done = forked(["info", "one-gesture"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "One gesture" in done.stdout


def test_info_reads_the_samples_of_a_sound_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    samples = np.zeros((400_000, 2))
    samples[300_000, 1] = np.inf
    soundfile.write(tmp_path / "a.wav", samples, 48000, "FLOAT")
    pieces, read = [], wave._sample_bytes_blocks

    def counted(*words: Any) -> Iterator[bytes]:
        for piece in read(*words):
            pieces.append(len(piece))
            yield piece

    monkeypatch.setattr(wave, "_sample_bytes_blocks", counted)
    assert run(["info", str(tmp_path / "a.wav")]) == 0
    assert sum(pieces) == samples.size * 4
    shown = capsys.readouterr()
    assert f"sha256 {sha256(samples.astype('<f4').tobytes()).hexdigest()}" in shown.out
    assert "frame 300,001" in shown.err


@pytest.mark.parametrize(("subtype", "value"), [("FLOAT", np.nan), ("DOUBLE", -np.inf)])
def test_info_of_sound_with_infinite_sample(
    subtype: str, value: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    samples = np.zeros((441, 2))
    samples[10, 1] = value
    soundfile.write(tmp_path / "a.wav", samples, 44100, subtype=subtype)
    assert run(["info", str(tmp_path / "a.wav")]) == 0
    assert "frame 11 (0.000226757 s) is not a number" in capsys.readouterr().err


def test_info_of_obj_with_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    lines = ["v 0 0 0 1 0 0", "v 1 0 0 1 0 0", "v 0 1 0", "f 1 2 3"]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    assert run(["info", str(tmp_path / "a.obj")]) == 0
    assert "passed over: colours or weights in 2 lines of v" in capsys.readouterr().out


def test_info_of_scale_with_decimal_comma(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "a.scl").write_text("! a\ntest\n 2\n 100,5\n 2/1\n")
    assert run(["info", str(tmp_path / "a.scl")]) == 2
    assert "a.scl:4: '100,5' is no pitch; write cents with a period" in capsys.readouterr().err


def test_info_of_obj_with_continued_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The rest of a line is no line of its own, whose first number would be a keyword."""
    vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    (tmp_path / "a.obj").write_text(f"{vertices}f 1 2 \\\n3 4\n")
    assert run(["info", str(tmp_path / "a.obj")]) == 0
    assert "passed over: nothing" in capsys.readouterr().out
