"""`import ergon`: what its functions return and raise, beside what the commands write."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from dataclasses import FrozenInstanceError, fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
from one_bell import SCORE
from patience import until

import ergon
from ergon import _core
from ergon.cli import app
from ergon.exchange.wave import hash_samples, read_blocks
from tests.house.test_docs import blocks, put

PAGE = Path(__file__).parents[2] / "docs" / "library.md"


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bell.yaml").write_text(SCORE)
    Path("bad.yaml").write_text(SCORE.replace("400g", "400h"))
    return work_folder


def test_public_names_listed_and_documented():
    assert set(ergon.__all__) == set(ergon._PLACES)
    assert set(ergon.__all__) <= set(dir(ergon))
    for name in ergon.__all__:
        result = getattr(ergon, name)
        assert result.__doc__, name
        assert "cli" not in result.__module__.split("."), name
    with pytest.raises(AttributeError, match="no attribute 'rendre'"):
        _ = ergon.rendre


def test_import_of_public_names_without_cli():
    code = (
        "import sys, ergon; [getattr(ergon, name) for name in ergon.__all__]; "
        "print([name for name in sys.modules if name.startswith(('ergon.cli', 'click'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_options_and_results_frozen():
    kinds = [getattr(ergon, name) for name in ergon.__all__]
    options = [kind for kind in kinds if kind.__name__.endswith("Options")]
    assert len(options) == 18
    for kind in options:
        assert is_dataclass(kind)
        assert all(field.kw_only for field in fields(kind))
        kind()  # every field has a default
    checked = ergon.check("bell.yaml")
    with pytest.raises(FrozenInstanceError):
        checked.diagnostics = ()  # type: ignore[misc]


def test_check_result_with_code_and_place():
    fine = ergon.check("bell.yaml")
    assert fine.is_playable
    assert fine.errors == ()
    bad = ergon.check("bad.yaml")
    assert not bad.is_playable
    (error,) = bad.errors
    assert (error.code, error.place.line, error.place.column) == ("E203", 8, 14)
    # What the engine will not run is found as well.
    stiff = SCORE.replace("f: A3", "f: 40kHz")
    assert not ergon.check("stiff.yaml", ergon.ReadOptions(text=stiff)).is_playable


@pytest.mark.parametrize("bits", ["float", "24", "16"])
def test_render_to_file_bytes_equal_command(bits: str):
    command = ["render", "bell.yaml", "-o", "command.wav", "--stems", "command", "--bits", bits]
    assert app.run([*command, "-q"]) == 0
    kind = bits if bits == "float" else int(bits)
    options = ergon.FileOptions(bits=kind, stems="library")  # type: ignore[arg-type]
    files = ergon.render_to_file("bell.yaml", "library.wav", options)
    assert Path("library.wav").read_bytes() == Path("command.wav").read_bytes()
    assert files.mix.path == "library.wav"
    assert files.mix.sha256 == hash_samples(Path("library.wav"))
    assert [Path(stem.path).name for stem in files.stems] == ["01_bell.wav"]
    assert Path("library/01_bell.wav").read_bytes() == Path("command/01_bell.wav").read_bytes()


@pytest.mark.parametrize("bits", ["float", 24, 16])
def test_render_array_equals_file_before_rounding(bits: str | int):
    part = {"from_": "1|2", "until": "1|4", "bits": bits}
    files = ergon.render_to_file("bell.yaml", "bell.wav", ergon.FileOptions(**part))
    sound = ergon.render("bell.yaml", ergon.RenderOptions(**part, threads=1, block=1000))
    assert sound.frames.dtype == np.float64
    assert sound.frames.shape == (44100, 2)
    assert sound.rate == 44100.0
    assert (sound.peak, sound.gain, sound.loudness) == (
        files.mix.peak,
        files.mix.gain,
        files.mix.loudness,
    )
    read = np.concatenate(list(read_blocks(Path("bell.wav"))))
    if bits == "float":
        assert np.array_equal(_core.single(sound.frames, 1.0), read.astype(np.float32))
    else:
        assert np.array_equal(_core.pcm(sound.frames, 1.0, bits) / 2.0**31, read)
        assert sound.gain == 1.0  # at the fixed level
        assert 0.01 < sound.peak < 1.0


def test_render_of_score_text_without_file():
    text = ergon.RenderOptions(text=SCORE, until="1|3")
    there = ergon.render("bell.yaml", ergon.RenderOptions(until="1|3"))
    assert np.array_equal(ergon.render("nowhere.yaml", text).frames, there.frames)
    other = ergon.render("bell.yaml", ergon.RenderOptions(until="1|3", rate=48000.0))
    assert other.frames.shape == (48000, 2)


def test_plan_write_and_reuse():
    plan = ergon.plan("bell.yaml", ergon.AccuracyOptions(method="ca"))
    assert plan.cost == sum(row.cost for row in plan.rows) > 0
    assert {row.what for row in plan.rows} == {"stepped"}
    plan.write("bell.plan")
    again = ergon.plan("bell.yaml", ergon.AccuracyOptions(plan="bell.plan"))
    assert (again.hash, again.choices) == (plan.hash, plan.choices)
    with pytest.raises(ergon.FileRefusedError, match="is an input"):
        plan.write("bell.yaml")


def test_freeze_writes_stems_of_parts():
    frozen = ergon.freeze("bell.yaml", ["bell"], "frozen")
    assert frozen.parts == ["bell"]
    assert frozen.stems[0].path.exists()
    with pytest.raises(ergon.OptionError, match="did you mean 'bell'"):
        ergon.freeze("bell.yaml", ["bel"])


def test_render_of_session_journal_equals_command():
    options = ergon.SessionOptions(audio="null", gain="0dB", journal="s.jsonl")
    with ergon.open_session("bell.yaml", options, report=ergon.Report()) as session:
        assert isinstance(session.play(), ergon.Reply)
        assert isinstance(session.state, ergon.State)
        until(lambda: session.state.where != "1|1", "a beat of the piece")
    with pytest.raises(ergon.OptionError, match="seed: a journal is rendered as it was played"):
        ergon.render_to_file("s.jsonl", "s.wav", ergon.FileOptions(seed=3))
    files = ergon.render_to_file("s.jsonl", "s.wav")
    assert app.run(["render", "s.jsonl", "-o", "t.wav", "-q"]) == 0
    assert files.mix.sha256 == hash_samples(Path("t.wav"))


def test_report_diagnostics_and_progress_calls():
    class StoringReport(ergon.Report):
        def __init__(self) -> None:
            self.found: list[str] = []
            self.tasks: list[str] = []

        def diagnostics(self, found, sources, left_out):
            self.found += [one.code for one in found]

        def progress(self, task: str, total: int, rate: float) -> ergon.Progress:
            self.tasks.append(task)
            return super().progress(task, total, rate)

    saved = StoringReport()
    unused = ergon.RenderOptions(
        text=SCORE.replace("parts:", "marks: {A: 1|1}\nparts:"), until="1|3"
    )
    with pytest.raises(ergon.ScoreError):
        ergon.render("bell.yaml", unused, report=saved)
    assert saved.found
    ergon.render("bell.yaml", ergon.RenderOptions(until="1|3"), report=saved)
    assert saved.tasks == ["rendering"]


def test_refused_options_raise_ergon_errors(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(ergon.ScoreError) as raised:
        ergon.render("bad.yaml")
    assert str(raised.value).startswith("bad.yaml:8:14: error[E203] M of key 'k1'")
    assert [one.code for one in raised.value.diagnostics] == ["E203"]
    with pytest.raises(ergon.ScoreError, match=r"none\.yaml"):
        ergon.render("none.yaml")
    for wrong, option in (
        ({"from_": "Q"}, "from_"),
        ({"from_": "40|1"}, "from_"),
        ({"method": "bm5"}, "method"),
        ({"error": "60"}, "error"),
        ({"error": -60.0, "cents": 3.0}, "cents"),
        ({"plan": "none.plan"}, "plan"),
        ({"hands": "none.take"}, "hands"),
        ({"rate": 44100.5}, "rate"),
    ):
        with pytest.raises(ergon.OptionError) as refused:
            ergon.render("bell.yaml", ergon.RenderOptions(**wrong))
        assert refused.value.option == option
        assert isinstance(refused.value, ergon.ErgonError)
    Path("mine.wav").write_bytes(b"not a render")
    with pytest.raises(ergon.FileRefusedError, match="no record of writing it"):
        ergon.render_to_file("bell.yaml", "mine.wav")
    assert capsys.readouterr() == ("", "")


def test_exception_tree_equals_docs_page():
    page = PAGE.read_text(encoding="utf-8")
    named = re.findall(r"^\| [│├└ ]*`(\w+)` \|", page, re.MULTILINE)
    exceptions = {
        name
        for name in ergon.__all__
        if isinstance(getattr(ergon, name), type) and issubclass(getattr(ergon, name), Exception)
    }
    assert set(named) == exceptions
    assert all(issubclass(getattr(ergon, name), ergon.ErgonError) for name in named)
    assert issubclass(ergon.DivergedError, ergon.ScoreError)


def test_exceptions_of_all_modules_derive_from_ergon_error():
    stray = set()
    for path in sorted((Path(ergon.__file__).parent).glob("*/**/*.py")):
        name = ".".join(path.relative_to(Path(ergon.__file__).parent).with_suffix("").parts)
        if name.endswith("__main__"):
            continue
        module = importlib.import_module(f"ergon.{name.removesuffix('.__init__')}")
        stray |= {
            value.__qualname__
            for value in vars(module).values()
            if isinstance(value, type)
            and issubclass(value, Exception)
            and value.__module__.startswith("ergon.")
            and value.__module__ != "ergon._core"
            and not value.__name__.startswith("_")
            and not issubclass(value, ergon.ErgonError)
        }
    assert stray == set()


def test_library_page_examples_run(capsys: pytest.CaptureFixture[str]):
    names: dict[str, object] = {}
    for block in blocks(PAGE):
        if block.language == "yaml":
            put(block, Path())
        elif block.language == "python":
            exec(block.text, names)
    output = capsys.readouterr().out
    assert "bell.yaml:2:" in output
    assert "'bell'" in output
    assert names["heard"].kept == []  # type: ignore[attr-defined]
