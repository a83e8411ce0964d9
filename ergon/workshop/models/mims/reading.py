"""Reads the text of a `.mdl` file into a `Model`, in both dialects."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

from ergon.common.regular import read_bounded
from ergon.notation.tables.expressions import Amount
from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.faust import script
from ergon.workshop.models.mims.grammar import FORMS, MESHES, NAMES, Dialect, Form
from ergon.workshop.models.mims.model import Model, Point, Statement, number

BYTES_MAX = 16 << 20
LINES_MAX = 200_000
CHARACTERS_MAX = 1_000  # longest line with content
_LINE_END = re.compile(r"\r\n|\r|\n")
_NAME = re.compile(r"@[A-Za-z_]\w{0,63}")
_V2_WORD = re.compile(r"[^\s\[\]]+|\[[^\[\]]*\]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_CHANNEL = {"input": re.compile(r"in([1-9]\d?)"), "output": re.compile(r"out([1-9]\d?)")}
_DISPLAYED = ("ground", "mass", "massG", "osc", "posInput")  # v1: a buffer, x and y may follow


def text_of(path: Path) -> str:
    """The text of a model, or of the script in a Faust program (`.dsp`).

    Raises ModelError if the file has neither, and OSError.
    """
    text = _text_of(path)
    return script(text) if path.suffix.lower() == ".dsp" else text


def _text_of(path: Path) -> str:
    model_bytes = read_bounded(path, BYTES_MAX)
    if len(model_bytes) > BYTES_MAX:
        raise ModelError(f"it is larger than {BYTES_MAX >> 20} MB")
    if b"\0" in model_bytes:
        raise ModelError(
            "it is not text: it has null bytes",
            model_bytes[: model_bytes.index(b"\0")].count(10) + 1,
        )
    try:
        return model_bytes.decode("utf-8-sig")
    except UnicodeDecodeError:
        return model_bytes.decode("latin-1")  # comments of older editors


def is_mims(text: str) -> bool:
    """Whether a line of a text begins as statements do, with @ and a name."""
    return any(_NAME.match(line.lstrip()) for line in text.splitlines())


def is_table(text: str) -> bool:
    """Whether a text is rows of three or four numbers, as a table of resonances is."""
    lines = (line.replace(",", " ").split() for line in text.splitlines())
    rows = [words for words in lines if words and words[0][0] not in ";#"]
    return bool(rows) and all(
        len(words) in (3, 4) and all(map(_NUMBER.fullmatch, words)) for words in rows
    )


def parse(
    model_text: str, dialect: Dialect, file_name: str = "", overrides: Mapping[str, str] = {}
) -> Model:
    """A model in one dialect; `overrides` are values of parameters by name. Raises ModelError."""
    words_of_line = _v1_words if dialect == "v1" else _v2_words
    text_lines = _LINE_END.split(model_text)
    if len(text_lines) > LINES_MAX:
        raise ModelError(f"it has more than {LINES_MAX:,} lines", LINES_MAX + 1)
    try:
        statement_rows = [
            (line_number, row)
            for line_number, line in enumerate(text_lines, 1)
            if (row := words_of_line(line, line_number))
        ]
        if not statement_rows:
            raise ModelError(
                f"it says nothing in {NAMES[dialect]}: no line begins with @ and a name"
            )
        macros = {row[0][1:] for _, row in statement_rows if _family(row, dialect) == "macro"}
        statements = tuple(
            _statement(line_number, row, dialect, macros) for line_number, row in statement_rows
        )
        model = Model(file_name, dialect, statements)
        _refuse_duplicate_names(model)
        model.params = _params(model, overrides)
        _known_points(model, macros)
        for statement in statements:
            _numbers(model, statement)
    except ModelError as error:
        error.file = file_name
        raise
    return model


# --- lines --------------------------------------------------------------------------------------


def _v1_words(model_line: str, line_number: int) -> tuple[str, ...]:
    line_content = model_line.split("#", 1)[0].strip()
    if line_content and not line_content.startswith("@"):
        raise ModelError("a line begins with @ and a name, or with # for a comment", line_number)
    return _bounded(tuple(line_content.split()), model_line, line_number)


def _v2_words(model_line: str, line_number: int) -> tuple[str, ...]:
    line_content = model_line.strip()
    if line_content.startswith("~") and not re.match(r"~(begin|end)\s+\S", line_content):
        raise ModelError("a buffer is `~begin NAME`, later `~end NAME`", line_number)
    if not line_content.startswith("@"):
        return ()
    line_words = _bounded(tuple(_V2_WORD.findall(line_content)), model_line, line_number)
    if re.sub(r"\s", "", "".join(line_words)) != re.sub(r"\s", "", line_content):
        raise ModelError("brackets do not match; a value in brackets is [a + b]", line_number)
    for line_word in line_words:
        if line_word.startswith("#"):
            message = "a comment behind a statement is read as values; give it a line of its own"
            raise ModelError(message, line_number)
        if "+" in line_word and not line_word.startswith("["):
            message = f"{quote(line_word)} is taken apart at the +; write it in brackets, [a + b]"
            raise ModelError(message, line_number)
    return line_words


def _bounded(words: tuple[str, ...], line: str, line_number: int) -> tuple[str, ...]:
    if words and len(line) > CHARACTERS_MAX:
        raise ModelError(f"a line has at most {CHARACTERS_MAX:,} characters", line_number)
    return words


def _family(row: tuple[str, ...], dialect: Dialect) -> str:
    form = FORMS[dialect].get(row[1]) if len(row) > 1 else None
    return "" if form is None else form.family


# --- statements ---------------------------------------------------------------------------------


def _statement(
    line_number: int, row: tuple[str, ...], dialect: Dialect, macros: set[str]
) -> Statement:
    statement_name, *line_words = row
    if not _NAME.fullmatch(statement_name):
        message = (
            f"{quote(statement_name)} is not a name: write @, a letter, then letters, digits and _"
        )
        raise ModelError(message, line_number)
    if not line_words:
        raise ModelError(
            f"{statement_name} says nothing: a word such as mass or spring follows", line_number
        )
    keyword, *argument_words = line_words
    statement_form = FORMS[dialect].get(keyword)
    if statement_form is None:
        message = f"{quote(keyword)} is not a word of {NAMES[dialect]}"
        raise ModelError(message, line_number, nearest(keyword, FORMS[dialect]))
    if len(argument_words) < statement_form.points:
        raise ModelError(f"{keyword} is written {statement_form.words}", line_number)
    end_words, value_words = (
        argument_words[: statement_form.points],
        argument_words[statement_form.points :],
    )
    end_points = tuple(_point(end, line_number) for end in end_words)
    if dialect == "v1":
        end_points, value_words = _v1_points(end_points, value_words, macros, keyword, line_number)
        if keyword in _DISPLAYED and len(value_words) == len(statement_form.values) + 3:
            value_words = value_words[:-3]
    by_field = _values(
        statement_form, [word.strip("[]").strip() for word in value_words], keyword, line_number
    )
    if "x0" in by_field:
        by_field["x0"] = _height(by_field["x0"], line_number)
    if "v0" in by_field:
        by_field["v0"] = _height(by_field["v0"], line_number)
    channel = _CHANNEL.get(statement_form.family)
    if channel is not None and not channel.fullmatch(statement_name[1:]):
        message = (
            f"{statement_name} has no number of a channel: write @in1 to @in99, @out1 to @out99"
        )
        raise ModelError(message, line_number)
    return Statement(
        statement_name[1:], keyword, statement_form.family, line_number, end_points, by_field
    )


def _point(point_word: str, line_number: int) -> Point:
    point_name, *side_positions = (
        point_word.strip("[]").split(None, 1)[:2] if point_word.strip("[] ") else ("",)
    )
    if not _NAME.fullmatch(point_name):
        raise ModelError(f"{quote(point_word)} is not a point: write @ and its name", line_number)
    return Point(point_name[1:], tuple(side_positions[0].split()) if side_positions else ())


def _v1_points(
    end_points: tuple[Point, ...],
    value_words: list[str],
    macros: set[str],
    keyword: str,
    line_number: int,
) -> tuple[tuple[Point, ...], list[str]]:
    """The places on macros, which follow the values, in the order of the points."""
    macro_points = [point for point in end_points if point.name in macros]
    if len(value_words) < len(macro_points):
        raise ModelError(
            f"{keyword}: where on {quote(macro_points[0].name)} is left out", line_number
        )
    places = iter(value_words[len(value_words) - len(macro_points) :])
    model_points = tuple(
        Point(point.name, tuple(next(places).split(":"))) if point.name in macros else point
        for point in end_points
    )
    return model_points, value_words[: len(value_words) - len(macro_points)]


def _values(
    statement_form: Form, line_words: list[str], keyword: str, line_number: int
) -> dict[str, str]:
    least = len(statement_form.values) + len(statement_form.after)
    if not least <= len(line_words) <= least + len(statement_form.optional) or not all(line_words):
        raise ModelError(
            f"{keyword} is written {statement_form.words}; here it has {len(line_words)} values",
            line_number,
        )
    value_names = (
        *statement_form.values,
        *statement_form.optional[: len(line_words) - least],
        *statement_form.after,
    )
    return dict(zip(value_names, line_words, strict=True))


def _height(height_text: str, line_number: int) -> str:
    """The third component of [x y z], the only one that moves; or the number as written."""
    height_words = height_text.split()
    if len(height_words) == 1 or not all(
        re.fullmatch(r"[+-]?[\d.eE+-]+", word) for word in height_words
    ):
        return height_text
    if len(height_words) != 3:
        raise ModelError(
            f"{quote(height_text)}: a position has one number, or three in brackets", line_number
        )
    return height_words[2]


# --- what statements mean together --------------------------------------------------------------


def _refuse_duplicate_names(model: Model) -> None:
    line_by_name: dict[str, int] = {}
    for model_statement in model.statements:
        if model.dialect == "v1" and model_statement.family == "link":
            continue  # MIMS has no use for the names of links
        if model_statement.name in line_by_name:
            message = (
                f"{quote(model_statement.name)} is the name of line "
                f"{line_by_name[model_statement.name]} already"
            )
            raise ModelError(message, model_statement.line)
        line_by_name[model_statement.name] = model_statement.line


def _params(model: Model, overrides: Mapping[str, str]) -> dict[str, Amount]:
    amounts: dict[str, Amount] = {}
    declared = {declaration.name: declaration for declaration in model.statements_of("param")}
    for parameter_name in overrides:
        if parameter_name not in declared:
            raise ModelError(
                f"{quote(parameter_name)} is not a parameter", 0, nearest(parameter_name, declared)
            )
        if declared[parameter_name].keyword == "audioParam":
            port = declared[parameter_name].values["input"].removeprefix("@")
            message = (
                f"{quote(parameter_name)} follows the signal of {port} and has no value to set; "
            )
            message += f"feed it by --feed {port}=FILE.wav"
            raise ModelError(message, declared[parameter_name].line)
    for parameter_name, declaration in declared.items():
        if declaration.keyword == "audioParam":
            if not re.fullmatch(r"@in[1-9]\d?", declaration.values["input"]):
                raise ModelError(
                    f"{quote(parameter_name)} needs an input, such as @in1", declaration.line
                )
            amounts[parameter_name] = Amount(Fraction(0), "")
            continue
        text = overrides.get(parameter_name, declaration.values["value"])
        value = number(text, {}, f"parameter {quote(parameter_name)}", declaration.line)
        amounts[parameter_name] = Amount(Fraction(value), "")
    return amounts


def _known_points(model: Model, macros: set[str]) -> None:
    points_by_name = {
        statement.name: statement
        for statement in model.statements_of("mass", "macro")
        if statement.name not in macros
    }
    inputs = {
        statement.name
        for statement in model.statements_of("input")
        if statement.keyword == "posInput"
    }
    masses = {*points_by_name, *inputs}
    kinds = {statement.name: statement.keyword for statement in model.statements_of("macro")}
    for model_statement in model.statements:
        for end_point in model_statement.points:
            if end_point.name in macros:
                sides = 2 if kinds[end_point.name] in MESHES else 1
                if len(end_point.along) != sides:
                    wanted_form = (
                        "one number from 0 to 1" if sides == 1 else "two numbers from 0 to 1"
                    )
                    message = f"a point of {quote(end_point.name)} needs {wanted_form}"
                    raise ModelError(message, model_statement.line)
            elif end_point.name not in masses:
                message = f"{quote('@' + end_point.name)} is not a mass of this model"
                suggestion = nearest(end_point.name, (*masses, *macros))
                raise ModelError(message, model_statement.line, suggestion)
            elif end_point.along:
                message = f"{quote(end_point.name)} is not a macro and has no places"
                raise ModelError(message, model_statement.line)


def _numbers(model: Model, model_statement: Statement) -> None:
    """Check that every value is a number, even if it is not used later."""
    for value_name in _values_of(model_statement):
        model.value(model_statement, value_name)
        if (
            model.dialect == "v2"
            and value_name in ("x0", "v0")
            and not _is_plain(model_statement.values[value_name])
        ):
            message = (
                f"{value_name} of {quote(model_statement.name)} is a plain number in mi-gen, no "
                "parameter"
            )
            raise ModelError(message, model_statement.line)
    for point in model_statement.points:
        for side_position in point.along:
            model.number(side_position, f"the place on {quote(point.name)}", model_statement.line)
    for value_name in ("N", "L", "W"):
        if value_name in model_statement.values and not re.fullmatch(
            r"[1-9]\d{0,6}", model_statement.values[value_name]
        ):
            raise ModelError(
                f"{value_name} of {quote(model_statement.name)} is a whole number above 0",
                model_statement.line,
            )


def _is_plain(text: str) -> bool:
    return re.fullmatch(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", text) is not None


def _values_of(statement: Statement) -> Iterator[str]:
    return (name for name in statement.values if name != "input" and statement.family != "param")
