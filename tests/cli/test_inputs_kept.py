"""No command writes over a file that it reads, under whatever name."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from recordings import Axis, end, header, row, rows

from ergon.cli import app
from ergon.exchange.safe import write_text

SCORE = """ergon: 1
use: [used.yaml]
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
players: {p: {key: k}}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
takes: {t: {file: t.csv}}
strikes: {r: {to: bell.m, at: 0, every: 0.1s, times: 2, impulse: 1uNs}}
parts: {p: [{at: 0, play: t}, {at: 1, play: g}]}
render: {tail: 10ms}
mix: {layout: layout.yaml}
"""
FILES = {
    "s.yaml": SCORE,
    "used.yaml": "gestures: {g: 0mm@0 1mm@1/8 0mm@1/4}\n",
    "t.csv": "t [s],x [mm]\n0,0\n0.1,1\n0.2,0\n",
    "layout.yaml": "ergon: 1\nspeakers: [[0, 1]]\n",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with a score, what it reads, and what commands read beside it."""
    folder = tmp_path_factory.mktemp("piece")
    for name, text in FILES.items():
        write_text(folder / name, text)  # as ergon does: else they would be kept for that alone
    before = Path.cwd()
    try:
        os.chdir(folder)
        assert app.run(["plan", "s.yaml", "-o", "p.json"]) == 0
        assert app.run(["render", "s.yaml", "-o", "r.wav"]) == 0
    finally:
        os.chdir(before)
    (folder / "h.take").write_bytes(
        header() + rows(*(row(i, Axis(i * 1e-6)) for i in range(10))) + end()
    )
    return folder


@pytest.fixture
def piece(written, tmp_path, monkeypatch):
    folder = tmp_path / "piece"
    shutil.copytree(written, folder)
    monkeypatch.chdir(folder)
    return folder


def contents():
    return {str(path): path.read_bytes() for path in sorted(Path().rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    "command",
    [
        "render s.yaml -f -o s.yaml",
        "render s.yaml -o used.yaml",
        "render s.yaml -o t.csv",
        "render s.yaml -o layout.yaml",
        "render s.yaml --plan p.json -o p.json",
        "compile s.yaml -f -o s.yaml",
        "compile s.yaml -o used.yaml",
        "compile s.yaml -o t.csv",
        "plan s.yaml -f -o s.yaml",
        "plan s.yaml -o used.yaml",
        "plan s.yaml --plan p.json -o p.json",
        "plot s.yaml g -f --svg s.yaml",
        "plot s.yaml g --svg t.csv",
        "plot r.wav --svg r.wav",
        "take export h.take -f -o ./h.take",
        "take trim h.take 0s end -f -o h.take",
        "take import t.csv -f -o t.csv",
        "chart s.yaml --seconds 0.05 --upto 2 --methods ca -o t",
        "stability s.yaml --seconds 0.05 -o t",
    ],
)
def test_commands_never_overwrite_their_inputs(piece, capsys, command):
    before = contents()
    assert app.run(command.split()) == 2
    assert contents() == before
    assert "internal" not in capsys.readouterr().err


@pytest.mark.parametrize("alias", ["link", "hard", "up", "absolute", "folder"])
@pytest.mark.parametrize("name", FILES)
def test_output_refused_as_alias_of_input(piece, alias, name):
    target = f"alias{Path(name).suffix}"
    if alias == "link":
        os.symlink(name, target)
    elif alias == "hard":
        os.link(name, target)
    elif alias == "folder":
        os.symlink(".", "again")
        target = f"again/{name}"
    else:
        target = f"../piece/{name}" if alias == "up" else os.path.abspath(name)
    before = contents()
    assert app.run(["render", "s.yaml", "-f", "-o", target]) == 2
    assert app.run(["compile", "s.yaml", "-f", "-o", target]) == 2
    assert contents() == before


def test_output_folder_with_linked_input_is_refused(piece, capsys):
    for folder, name in (("out", "marks.csv"), ("stems", "01_bell.wav"), ("frozen", "frozen.json")):
        Path(folder).mkdir()
        os.link("t.csv", f"{folder}/{name}")
    before = contents()
    for command in (
        "export s.yaml -f --no-stems -o out",
        "render s.yaml -f -o x.wav --stems stems",
        "render s.yaml -f --freeze bell -o frozen",
    ):
        assert app.run(command.split()) == 2
        assert "is an input" in capsys.readouterr().err
        assert contents() == before


def test_render_file_field_with_input_name_is_refused(piece, capsys):
    for name in ("s.yaml", "used.yaml", "t.csv"):
        Path("s.yaml").write_text(SCORE.replace("{tail: 10ms}", f"{{tail: 10ms, file: {name}}}"))
        before = contents()
        assert app.run(["render", "s.yaml", "-f"]) == 1
        assert "but sound files end in .wav" in capsys.readouterr().err
        assert contents() == before


def test_render_refuses_to_overwrite_take_of_same_name(piece):
    """`ergon take export` writes WAV files, and a render is written over without asking."""
    Path("s.yaml").write_text(SCORE.replace("t.csv", "s.wav"))
    assert app.run(["take", "export", "h.take", "-o", "s.wav"]) == 0
    before = contents()
    assert app.run(["render", "s.yaml"]) == 2
    assert contents() == before


def test_journal_render_never_overwrites_inputs(piece, capsys):
    overlay = {name: FILES[name] for name in ("used.yaml", "layout.yaml")}
    first = {"score": "s.yaml", "text": SCORE, "overlay": overlay, "every": 64, "frame": 0}
    events = [
        {"v": 1, "event": "session", **first, "gain": 1.0, "limit": 1.0},
        {"v": 1, "event": "end", "frame": 100},
    ]
    Path("j.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    before = contents()
    for name in ("j.jsonl", "t.csv"):
        assert app.run(["render", "j.jsonl", "-f", "-o", name]) == 2
        assert "but sound files end in .wav" in capsys.readouterr().err
    assert contents() == before
    assert app.run(["render", "j.jsonl", "-o", "x.wav"]) == 0


def test_fmt_rewrites_its_input(piece):
    Path("s.yaml").write_text(SCORE.replace("{key: k}", "{ key:   k }"))
    assert app.run(["fmt", "s.yaml"]) == 0
    assert Path("s.yaml").read_text() == SCORE


def test_non_input_files_written_as_usual(piece):
    assert app.run(["render", "s.yaml", "-o", "r.wav"]) == 0
    assert np.fromfile("r.wav", np.uint8).size > 100
    assert app.run(["compile", "s.yaml", "-o", "x.csv"]) == 0
    assert app.run(["compile", "s.yaml", "-o", "x.csv"]) == 0
