"""What the engine will not play is said in one way, whichever command staged it."""

from pathlib import Path

import pytest

from ergon.cli import app
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart
from ergon.repl.session.version import Faders
from ergon.scores.edits.texts import Texts

SCORE = """\
ergon: 1
instruments:
  bell:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1, K: 5, X0: 1mm}}
    out: {SOX: m}
"""


@pytest.fixture
def here(work_folder: Path) -> Path:
    """A score that is read without a mistake and cannot be played, and the journal of one."""
    Path("score.yaml").write_text(SCORE, encoding="utf-8")
    journal = Journal(Path("began.jsonl"))
    opening = SessionStart(Texts.read("score.yaml"), 0.0, Faders(), 64, 1.0, 1.0, None)
    journal.append("session", **opening.fields())
    journal.append("said", line="show", taken=True, reply="", frame=640)
    journal.close()
    return work_folder


@pytest.mark.parametrize(
    "typed",
    [
        ["render", "score.yaml", "-o", "x.wav", "--method", "ca"],
        ["render", "began.jsonl", "-o", "x.wav"],
        ["repl", "score.yaml", "--audio", "null"],
        ["repl", "score.yaml", "--audio", "null", "--gain", "0dB"],
        ["repl", "--resume", "began.jsonl", "--audio", "null"],
    ],
    ids=" ".join,
)
def test_commands_report_unstable_module_with_line(
    here: Path, capsys: pytest.CaptureFixture[str], typed: list[str]
) -> None:
    assert app.run(typed) == 1
    place, line, mark, *_ = capsys.readouterr().err.splitlines()
    assert place.startswith("score.yaml:7:7: error[E309] bell.m: unstable")
    assert line == " 7 |       m: {CEL: {M: 1, K: 5, X0: 1mm}}"
    assert mark == "   |       ^"
    assert {path.name for path in here.iterdir()} == {"score.yaml", "began.jsonl"}
