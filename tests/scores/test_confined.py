"""A score reads and writes in its own folder, unless whoever runs it trusts it."""

import json
import os
from pathlib import Path

import pytest
from commands import forked

from ergon.cli import app
from ergon.notation.text.bounds import MARKER, FileBounds
from ergon.repl.language.versions import Load, Reload
from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import resumed_state
from ergon.repl.session.version import NotTakenError, Version
from ergon.repl.session.version_edits import VERSION_EDITS
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import load

KEY = "keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {p: {key: k}}\n"
PLAYED = (
    "instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}\n"
    "strikes: {r: {to: bell.m, at: 0, every: 1, times: 2, impulse: 1uNs}}\n"
)
CSV = "t [s],x [mm]\n0,0\n0.1,1\n0.2,0\n"
SECRET = "root:x:0:0:secret"
# What names a file, and the file that it names.
NAMED = {
    "use": ("use: ['{}']\n", "gestures: {g: 0@0 1@1}\n"),
    "use with a prefix": ("use: {{c: '{}'}}\n", "gestures: {g: 0@0 1@1}\n"),
    "take": ("takes: {{t: {{file: '{}'}}}}\n", CSV),
    "calib": ("keys: {{k: {{calib: '{}'}}}}\n", "ergon: 1\nM: 1g\nK: 1\nZ: 1\n"),
    "layout": ("mix: {{layout: '{}'}}\n", "ergon: 1\nspeakers: [[0, 1]]\n"),
    "nearest": (
        "instruments: {{b: {{BANK: {{count: 2, M: 1g, f: 1kHz, t60: 1s}},"
        " out: {{SOF: {{nearest: '{}'}}}}}}}}\n",
        "ergon: 1\nspeakers: [[0, 1]]\n",
    ),
    "render": ("render: {{file: '{}'}}\n", None),
}


@pytest.fixture
def piece(tmp_path, monkeypatch):
    """A folder of a score in a folder of other things; what is outside of it is a secret."""
    folder = tmp_path / "piece"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def reports(text, name="s.yaml", **options):
    return [
        (d.code, d.message) for d in load(name, text="ergon: 1\n" + text, **options).diagnostics
    ]


@pytest.mark.parametrize("what", NAMED)
@pytest.mark.parametrize(
    "method", ["absolute", "above", "link", "folder that is a link", "missing"]
)
def test_files_outside_score_folder_are_refused(piece, what, method):
    text, content = NAMED[what]
    suffix = ".csv" if content == CSV else ".yaml"
    outside = piece.parent / f"x{suffix}"
    if method != "missing":
        outside.write_text(content or "")
    name = {"absolute": str(outside), "link": f"in{suffix}"}.get(method, f"../x{suffix}")
    if method == "link":
        os.symlink(outside, name)
    elif method == "folder that is a link":
        os.symlink("..", "in")
        name = f"in/x{suffix}"
    codes = [code for code, _ in reports(text.format(name))]
    assert "E112" in codes
    assert "E107" not in codes
    trusted = [
        c for c, _ in reports(text.format(name), bounds=FileBounds.around(piece, trust=True))
    ]
    assert "E112" not in trusted
    assert ("E107" in trusted) == (method == "missing" and content is not None)


@pytest.mark.parametrize("what", NAMED)
def test_files_inside_score_folder_are_read(piece, what):
    text, content = NAMED[what]
    suffix = ".csv" if content == CSV else ".yaml"
    for name in (f"x{suffix}", f"sub/deeper/x{suffix}", f"sub/../y{suffix}"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(content or "")
        here = os.path.abspath(name)
        os.symlink(here, f"{name}.link{suffix}")
        for method in (name, here, f"{name}.link{suffix}"):
            assert not {c for c, _ in reports(text.format(method))} & {"E112", "E107"}


def test_check_output_hides_text_of_outside_file(piece, capsys):
    Path("../passwd").write_text(f"{SECRET}\n\tx: [\n")
    for name in (str(piece.parent / "passwd"), "../passwd"):
        Path("s.yaml").write_text(f"ergon: 1\nuse: [{name}]\n")
        for more in ([], ["--json"], ["--format", "github"], ["--format", "concise"]):
            assert app.run(["check", "s.yaml", *more]) == 1
            out, err = capsys.readouterr()
            assert "secret" not in out + err
            assert "E112" in out + err


def test_outside_file_message_suggests_trust(piece, capsys):
    Path("../x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    Path("s.yaml").write_text("ergon: 1\nuse: [../x.yaml]\n" + PLAYED)
    assert app.run(["check", "s.yaml"]) == 1
    output = capsys.readouterr().err
    assert "s.yaml:2:7: error[E112] " in output
    assert "--trust" in output
    assert app.run(["check", "--trust", "s.yaml"]) == 0


def test_use_paths_relative_to_instrument_file(piece):
    Path("instruments/parts").mkdir(parents=True)
    Path("common").mkdir()
    Path("common/laws.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    Path("instruments/bell.yaml").write_text("use: [parts/m.yaml, ../common/laws.yaml]\n")
    Path("instruments/parts/m.yaml").write_text("gestures: {h: 0@0 1@1}\n")
    assert reports("use: [instruments/bell.yaml]\n") == []
    Path("instruments/parts/m.yaml").write_text("use: [../../../x.yaml]\n")
    Path("../x.yaml").write_text("gestures: {i: 0@0 1@1}\n")
    assert [code for code, _ in reports("use: [instruments/bell.yaml]\n")] == ["E112"]


def test_library_files_are_always_read(piece):
    assert reports("use: [instruments/bowed.yaml]\n") == []
    # Its own take lies in another folder of the library.
    assert (
        reports(f"use: [instruments/bowed.yaml]\n{KEY}parts: {{p: [{{at: 0, play: drawing}}]}}\n")
        == []
    )


def test_project_marker_widens_bounds_to_its_folder(piece):
    (piece.parent / "scores").mkdir()
    (piece.parent / "x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    name = str(piece.parent / "scores" / "s.yaml")
    assert [code for code, _ in reports("use: [../x.yaml]\n", name)] == ["E112"]
    (piece.parent / MARKER).touch()
    assert reports("use: [../x.yaml]\nrender: {file: ../out/x.wav}\n", name) == []
    assert [code for code, _ in reports("use: [../../x.yaml]\n", name)] == ["E112"]


def test_project_marker_must_be_file_of_same_user(piece, monkeypatch):
    (piece.parent / "x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    os.mkfifo(piece.parent / MARKER)
    assert [code for code, _ in reports("use: [../x.yaml]\n")] == ["E112"]
    (piece.parent / MARKER).unlink()
    (piece.parent / MARKER).touch()
    assert reports("use: [../x.yaml]\n") == []
    other = os.geteuid() + 1  # in a folder that all may write to, another user made it
    monkeypatch.setattr(os, "geteuid", lambda: other)
    assert [code for code, _ in reports("use: [../x.yaml]\n")] == ["E112"]


def test_render_refuses_output_outside_folder(piece, capsys):
    for name in ("../x.wav", str(piece.parent / "x.wav")):
        Path("s.yaml").write_text(f"ergon: 1\nrender: {{file: {name}, tail: 10ms}}\n" + PLAYED)
        for more in ([], ["-f"], ["-n"]):
            assert app.run(["render", "s.yaml", *more]) == 1
            assert "E112" in capsys.readouterr().err
        assert list(piece.parent.glob("*.wav")) == []
        assert app.run(["render", "s.yaml", "--trust"]) == 0
        (piece.parent / "x.wav").unlink()
    Path("s.yaml").write_text("ergon: 1\nrender: {tail: 10ms}\n" + PLAYED)
    assert app.run(["render", "s.yaml", "-o", "../y.wav"]) == 0  # whoever types it knows


COMMANDS = (
    ["check", "s.yaml"],
    ["render", "s.yaml", "-n"],
    ["export", "s.yaml", "-o", "out", "--no-stems"],
    ["compile", "s.yaml"],
    ["plot", "s.yaml", "g"],
    ["info", "s.yaml"],
    ["plan", "s.yaml"],
    ["play", "s.yaml", "--audio", "null", "--plain"],
    ["duet", "s.yaml", "--audio", "null", "--plain"],
    ["render", "s.yaml", "--freeze", "bell", "-o", "frozen"],
)


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_trust_option_of_every_command(piece, capsys, arguments):
    Path("../x.yaml").write_text("gestures: {g: 0mm@0 1mm@1/8 0mm@1/4}\n")
    text = f"ergon: 1\nuse: [../x.yaml]\nrender: {{tail: 10ms}}\n{KEY}{PLAYED}"
    text = text.replace("every: 1, times: 2", "every: 0.1s, times: 2")
    Path("s.yaml").write_text(text + "parts: {p: [{at: 0, play: g}]}\n")
    assert app.run(arguments) == 1
    assert "E112" in capsys.readouterr().err
    assert app.run([*arguments, "--trust"]) == 0


def test_texts_keep_trust_of_first_reading(piece):
    Path("../x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    text = "ergon: 1\nuse: [../x.yaml]\n" + PLAYED
    Path("s.yaml").write_text(text)
    assert [d.code for d in Texts.read("s.yaml").load().diagnostics] == ["E112"]
    trusted = Texts.read("s.yaml", FileBounds.around(piece, trust=True))
    assert trusted.load().piece is not None
    assert "g" in trusted.names()[0].names("gestures")
    assert "g" not in Texts.read("s.yaml").names()[0].names("gestures")
    assert trusted.with_text(text + "title: x\n").load().piece is not None


def test_journal_reads_only_files_of_its_folder(piece):
    """A stranger's journal says where its score lay: that is no leave to read there."""
    secret = piece.parent / "hidden"
    secret.mkdir()
    (secret / "x.csv").write_text(CSV)
    (secret / "passwd").write_text(SECRET + "\n")
    for text in ("use: [passwd]\n", "takes: {t: {file: x.csv}}\n"):
        text = "ergon: 1\\n" + text.replace("\n", "\\n")
        Path("s.jsonl").write_text(
            '{{"v": 1, "event": "session", "score": "{}", "text": "{}", "every": 64,'
            ' "gain": 1.0, "limit": 1.0}}\n'.format(secret / "s.yaml", text)
        )
        loaded = read_journal(Path("s.jsonl")).session_start.texts.load()
        assert [d.code for d in loaded.diagnostics] == ["E107"]
        assert all("secret" not in d.message for d in loaded.diagnostics)


def test_resume_with_score_outside_journal_folder(piece):
    """Lines of a session that goes on write its score: not where a stranger's journal says."""
    outside = piece.parent / "s.yaml"
    for score, refused in ((outside, True), (piece / "s.yaml", False), ("s.yaml", False)):
        Path("s.jsonl").write_text(
            json.dumps({"v": 1, "event": "session", "score": str(score), "every": 64, "at": 0.0})[
                :-1
            ]
            + ', "gain": 1.0, "limit": 1.0, "text": '
            + json.dumps("ergon: 1\n" + PLAYED)
            + "}\n"
        )
        if refused:
            with pytest.raises(
                JournalError, match=("its score is outside this folder and the journal's: name it")
            ):
                read_journal(Path("s.jsonl"), resumes=True)
            named = read_journal(Path("s.jsonl"), str(score), resumes=True)
            assert resumed_state(named)[0].texts.path == str(score)
        else:
            version, *_ = resumed_state(read_journal(Path("s.jsonl"), resumes=True))
            Path("../x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
            Path("s.yaml").write_text("ergon: 1\nuse: [../x.yaml]\n" + PLAYED)
            with pytest.raises(NotTakenError, match="outside the score's folder"):
                VERSION_EDITS[Reload](Reload())(version, 0.0)


def test_load_bounds_are_folder_of_loaded_score(piece):
    """`load` is typed; what it loads is held to where it lies, and trusted if the session is."""
    other = piece.parent / "other"
    other.mkdir()
    (other / "s.yaml").write_text("ergon: 1\nuse: [x.yaml]\n" + PLAYED)
    (other / "x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
    (piece / "s.yaml").write_text("ergon: 1\n" + PLAYED)
    for trust in (False, True):
        texts = Texts.read("s.yaml", FileBounds.around(piece, trust=trust))
        version = Version(0, "", texts, texts.load().piece)
        (other / "s.yaml").write_text("ergon: 1\nuse: [x.yaml]\n" + PLAYED)
        loaded = VERSION_EDITS[Load](Load(str(other / "s.yaml")))(version, 0.0)
        assert "g" in loaded.texts.names()[0].names("gestures")
        (other / "s.yaml").write_text("ergon: 1\nuse: [../other/../x.yaml]\n" + PLAYED)
        (piece.parent / "x.yaml").write_text("gestures: {g: 0@0 1@1}\n")
        load_outside = VERSION_EDITS[Load](Load(str(other / "s.yaml")))
        if trust:
            assert load_outside(version, 0.0).texts.load().piece is not None
        else:
            with pytest.raises(NotTakenError, match="outside the score's folder"):
                load_outside(version, 0.0)


@pytest.mark.parametrize("what", [name for name in NAMED if name != "render"])
def test_non_regular_files_in_score_are_refused(piece, what):
    text, _ = NAMED[what]
    suffix = ".csv" if what == "take" else ""
    os.mkfifo(f"fifo{suffix}")
    os.mkdir(f"dir{suffix}")
    os.symlink(f"fifo{suffix}", f"link{suffix}")
    os.symlink(f"loop{suffix}", f"loop{suffix}")
    for name in ("fifo", "dir", "link", "loop"):
        assert "E107" in [code for code, _ in reports(text.format(name + suffix))]


@pytest.mark.parametrize("kind", ["fifo", "/dev/zero", "dir"])
def test_commands_refuse_score_of_irregular_file(piece, kind):
    os.mkfifo("fifo")
    os.mkdir("dir")
    for command in (["check", kind], ["render", "x.yaml", "--plan", kind], ["take", "info", kind]):
        Path("x.yaml").write_text("ergon: 1\nrender: {tail: 10ms}\n" + PLAYED)
        done = forked(command, Path.cwd())
        assert done.returncode in (1, 2)
        assert "internal" not in done.stderr
