"""Scripts of MIMS in programs of Faust."""

from pathlib import Path

import pytest

from ergon.cli import app
from ergon.workshop.api.model import import_model
from ergon.workshop.models.errors import ModelError

pytestmark = pytest.mark.usefixtures("work_folder")
SCRIPT = """\
@K param 0.1
@o osc 1. K 0.0003 0. 0.
@in1 frcInput @o
@out1 posOutput @o
"""
PROGRAM = f"""\
declare author "A. N. Other";
/* ======== DESCRIPTION ========
@o is a basic oscillator.
*/
import("stdfaust.lib");
process = button("in") : ba.impulsify; // @o mass 2 0 0
/*
======== MIMS SCRIPT ========

# An oscillator
{SCRIPT}
# end of MIMS script
*/
"""


def test_faust_script_equals_mdl_model() -> None:
    Path("o.dsp").write_text(PROGRAM)
    Path("o.mdl").write_text(SCRIPT)
    program, model = (import_model(name) for name in ("o.dsp", "o.mdl"))
    assert program.n_statements == 4
    assert program.text.splitlines()[1:] == model.text.splitlines()[1:]


def test_faust_script_mistake_line(capsys: pytest.CaptureFixture[str]) -> None:
    Path("o.dsp").write_text(PROGRAM.replace("@o osc", "@o ask"))
    assert app.run(["import", "o.dsp"]) == 2
    line = PROGRAM.splitlines().index("@o osc 1. K 0.0003 0. 0.") + 1
    assert f"o.dsp:{line}: 'ask' is not a word" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("process = _;\n", 0, "has no MIMS script"),
        ("// @o osc 1 0.1 0 0 0\n", 0, "has no MIMS script"),
        ("/* @author somebody\n@o is one */\n", 0, "has no MIMS script"),
        (f"/*\n{SCRIPT}*/\n/*\n{SCRIPT}*/\n", 7, "a second MIMS script"),
    ],
    ids=["none", "no block", "words", "two"],
)
def test_faust_files_without_a_mims_script_are_refused(text: str, line: int, says: str) -> None:
    Path("o.dsp").write_text(text)
    with pytest.raises(ModelError, match=says) as output:
        import_model("o.dsp")
    assert output.value.line == line
