"""What is refused of a model: the sentence, and the line at which it is."""

from pathlib import Path

import pytest

from ergon.api.errors import OptionError
from ergon.instruments.kinds.bodies import MAX_MODULES
from ergon.instruments.kinds.plate import MAX_RADIUS
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import DialectError, ModelError
from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.reading import BYTES_MAX, parse
from ergon.workshop.models.mims.score import score_text

M = "@g ground 0\n@m mass 1 0 0\n"
S = "@s string 5 1 0.1 0 0 0\n"
READING = {
    "an unknown word": (
        2,
        "v2",
        "@a mass 1 0 0\n@b sprong @a @a 1",
        "'sprong' is not a word.*spring",
    ),
    "a word of the other dialect": (1, "v1", "@a nlContact @b @c 1 2 3 4", "not a word of MIMS"),
    "massG in v2": (1, "v2", "@p massG 1 1 0 0", "'massG' is not a word of mi-gen.*mass"),
    "too few values": (1, "v2", "@a mass 1 0", r"mass is written M \[gravity\] x0 v0"),
    "too many values": (1, "v2", "@a mass 1 0 0 0 0", "here it has 5 values"),
    "a name twice": (2, "v2", "@a mass 1 0 0\n@a mass 1 0 0", "'a' is the name of line 1"),
    "a link's name twice": (4, "v2", f"{M}@l spring @g @m 1\n@l spring @g @m 1", "line 3"),
    "a mass twice in v1": (2, "v1", "@a mass 1 0 0\n@a mass 1 0 0", "line 1"),
    "no such mass": (3, "v2", f"{M}@l spring @g @mm 1", "'@mm' is not a mass.*'m'"),
    "an undefined parameter": (1, "v2", "@a mass [2*kScale3] 0 0", "M of 'a'.*kScale3"),
    "a number that is none": (1, "v2", "@a mass 1k 0 0", "M of 'a'"),
    "a unit": (1, "v2", "@a mass 2kg 0 0", "'2kg' is neither a number nor a parameter"),
    "a note": (1, "v2", "@a mass A4 0 0", "'A4' is neither a number nor a parameter"),
    "a division by zero": (1, "v2", "@a mass [1/0] 0 0", "divides by zero"),
    "a call": (1, "v2", "@a mass [noise(1)] 0 0", "noise"),
    "code": (1, "v2", "@a mass __import__('os') 0 0", "__import__"),
    "deep brackets": (1, "v2", f"@a mass [{'(' * 50}1{')' * 50}] 0 0", "at most 16 deep"),
    "a long expression": (1, "v2", f"@a mass [{'1+' * 150}1] 0 0", "at most 200 characters"),
    "a long line": (1, "v2", f"@a mass [{'1+' * 1000}1] 0 0", "at most 1,000 characters"),
    "a plus outside brackets": (1, "v2", "@a mass 1+1 0 0", "taken apart"),
    "a comment behind": (1, "v2", "@a mass 1 0 0 # heavy", "line of its own"),
    "an open bracket": (1, "v2", "@a mass [1 0 0", "brackets do not match"),
    "prose in v1": (1, "v1", "this is a mass", "begins with @"),
    "half a buffer": (1, "v2", "~begin", "~begin NAME"),
    "a name alone": (1, "v2", "@a", "says nothing"),
    "no name": (1, "v2", "@1 mass 1 0 0", "'@1' is not a name"),
    "a point without a name": (3, "v2", f"{M}@l spring [] @m 1", "not a point"),
    "no place on a macro": (2, "v2", f"{S}@out1 posOutput @s", "one number from 0 to 1"),
    "two places on a string": (2, "v2", f"{S}@out1 posOutput [@s 0 1]", "one number"),
    "one place on a mesh": (
        2,
        "v2",
        "@s mesh 3 3 1 1 0 0 0\n@out1 posOutput [@s 0]",
        "two numbers from 0 to 1",
    ),
    "a place on a mass": (3, "v2", f"{M}@out1 posOutput [@m 0.5]", "not a macro"),
    "no place in v1": (2, "v1", "@s string 5 1 1 1 0\n@out1 posOutput @s", "left out"),
    "no channel": (3, "v2", f"{M}@left posOutput @m", "@left has no number"),
    "channel 0": (3, "v2", f"{M}@out0 posOutput @m", "@out0 has no number"),
    "half a mass": (1, "v2", "@s string 4.5 1 1 0 0 0", "N of 's' is a whole number"),
    "two coordinates": (1, "v2", "@a mass 1 [0 1] 0", "one number, or three"),
    "a parameter as position": (2, "v2", "@p param 1\n@a mass 1 p 0", "plain number in mi-gen"),
    "a signal of no input": (1, "v2", "@p audioParam @left", "needs an input"),
}
WRITING = {
    "signal": (2, "v2", "@p audioParam @in1\n@m mass p 0 0", "M is 0 in the first sample"),
    "macro force": (2, "v2", f"{S}@out1 frcOutput [@s 0.5]", "is 0 at all times"),
    "still force": (3, "v2", f"{M}@out1 frcOutput @m", "no link ends"),
    "both ends": (
        5,
        "v2",
        f"{M}@l spring @g @m 1\n@out1 frcOutput @m\n@out2 frcOutput @g",
        "hears 'l' at its other end",
    ),
    "negative": (3, "v2", f"{M}@l spring @g @m [0-1]", "K is -1"),
    "no mass": (1, "v2", "@m mass 0 0 0", "M is 0"),
    "far": (1, "v2", "@m mass 1 5000 0", "x0 is 5000"),
    "few": (1, "v2", "@s string 2 1 1 0 0 0", "a string has 3 points or more"),
    "scale": (3, "v2", f"{M}@l nlBow @g @m 1 0", "scale is 0"),
    "10^12 masses": (1, "v2", "@s cornerMesh 1000000 1000000 1 1 0 0 0", "more than a score"),
    "a long string": (1, "v2", "@s chain 3000000 1 1 0 0 0", "3,000,000 masses are more"),
    "a long side": (1, "v2", "@s mesh 802 2 1 1 0 0 0", "801 masses at most"),
}


@pytest.mark.parametrize(("line", "dialect", "text", "message"), READING.values(), ids=READING)
def test_reading_damaged_models_reports_the_line(line: int, dialect: str, text: str, message: str):
    with pytest.raises(ModelError, match=message) as raised:
        parse(text, dialect, "m.mdl")
    assert raised.value.line == line
    assert str(raised.value).startswith(f"m.mdl:{line}: ")


@pytest.mark.parametrize(("line", "dialect", "text", "message"), WRITING.values(), ids=WRITING)
def test_writing_models_without_equivalent_reports_the_line(
    line: int, dialect: str, text: str, message: str
):
    model = parse(text, dialect, "m.mdl")
    with pytest.raises(ModelError, match=message) as raised:
        score_text(model)
    assert raised.value.line == line


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"@m mass 1 0 0\n\0\0\x7fELF", "null bytes"),
        (b"\xff\xfe@", "no valid UTF-16"),
        (b"#" * (BYTES_MAX + 1), "larger than 16 MB"),
        (b"\n" * 300_000, "more than 200,000 lines"),
    ],
    ids=["binary", "cut UTF-16", "large", "lines"],
)
def test_import_refuses_non_model_files(data: bytes, message: str, tmp_path: Path):
    path = tmp_path / "m.mdl"
    path.write_bytes(data)
    with pytest.raises(ModelError, match=message):
        import_model(path)


def test_import_of_ambiguous_dialect_needs_option(tmp_path: Path):
    path = tmp_path / "m.mdl"
    path.write_text("@m mass 10 1. 1.\n@out1 posOutput @m\n")
    with pytest.raises(DialectError, match="write --dialect v1 or --dialect v2"):
        import_model(path)
    assert import_model(path, ModelOptions(dialect="v1")).text.count("V0") == 0
    assert import_model(path, ModelOptions(dialect="v2")).text.count("V0") == 1
    path.write_text("@m osc 10 1 0 0 0\n@out1 posOutput @m\n")  # alike in both
    assert import_model(path).dialect == "v2"
    path.write_text("@m massG 10 1 0 0\n@out1 posOutput @m\n")
    assert import_model(path).dialect == "v1"


def test_import_error_of_farther_parsed_dialect(tmp_path: Path):
    path = tmp_path / "m.mdl"
    path.write_text("@m mass [1 + 1] 0 0\n@l spring @m @m 1\n@k sprong @m @m 1")
    with pytest.raises(ModelError, match=r"m\.mdl:3: 'sprong'"):
        import_model(path)


def test_model_size_limits_equal_score_limits():
    assert places.SIDE_MAX == 2 * MAX_RADIUS + 1
    assert places.MASSES_MAX == MAX_MODULES


def test_missing_input_file_is_refused(tmp_path: Path):
    path = tmp_path / "m.mdl"
    path.write_text("@in1 posInput 0\n@out1 posOutput @in1\n")
    asked = ModelOptions(inputs={"in1": tmp_path / "none.wav"})
    with pytest.raises(OptionError, match="in1"):
        import_model(path, asked)


def test_model_expressions_evaluated_once(monkeypatch: pytest.MonkeyPatch):
    from ergon.workshop.models.mims import functions

    read = []
    complete = functions.evaluate
    monkeypatch.setattr(
        functions, "evaluate", lambda *given, **more: read.append(1) or complete(*given, **more)
    )
    lines = ["@k param 0.1"]
    lines += [f"@m{n} mass 1 0 0" for n in range(500)]
    lines += [f"@l{n} spring @m{n} @m{n + 1} [2*k]" for n in range(499)]
    score_text(parse("\n".join(lines), "v2"))
    assert len(read) == 4  # 0.1, 1, 0 and 2*k
