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
from ergon.workshop.models.mims.faust import find_script
from ergon.workshop.models.mims.grammar import DIALECT_NAMES, FORMS, MESHES, Dialect, Form
from ergon.workshop.models.mims.model import Model, Point, Statement, evaluate_number

BYTES_MAX = 16 << 20
LINES_MAX = 200_000
CHARACTERS_MAX = 1_000  # longest line with content
# Of a mark of the order of bytes, or of the first letter of XML.
_WIDE_ENCODINGS = {
    b"\xff\xfe": "utf-16-le",
    b"\xfe\xff": "utf-16-be",
    b"<\0": "utf-16-le",
    b"\0<": "utf-16-be",
}
_XML_DECLARATION = re.compile(r"\A<\?xml[^>]*\?>")  # it names an encoding that the text has no more
_LINE_END = re.compile(r"\r\n|\r|\n")
_NAME = re.compile(r"@[A-Za-z_]\w{0,63}")
_V2_WORD = re.compile(r"[^\s\[\]]+|\[[^\[\]]*\]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_CHANNEL = {"input": re.compile(r"in([1-9]\d?)"), "output": re.compile(r"out([1-9]\d?)")}
_DISPLAYABLE = ("ground", "mass", "massG", "osc", "posInput")  # v1: a buffer, x and y may follow


def read_text(path: Path) -> str:
    """The text of a model, or of the script in a Faust program (`.dsp`).

    Raises ModelError if the file has neither, and OSError.
    """
    text = _read_text(path)
    return find_script(text) if path.suffix.lower() == ".dsp" else text


def _read_text(path: Path) -> str:
    model_bytes = read_bounded(path, BYTES_MAX)
    if len(model_bytes) > BYTES_MAX:
        raise ModelError(f"it is larger than {BYTES_MAX >> 20} MB")
    wide_encoding = _WIDE_ENCODINGS.get(model_bytes[:2])
    if wide_encoding is not None:
        try:
            model_text = model_bytes.decode(wide_encoding)
        except UnicodeDecodeError:
            raise ModelError("it begins as UTF-16 does, but is no valid UTF-16") from None
        return _XML_DECLARATION.sub("", model_text.removeprefix("\ufeff"))
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
    text: str, dialect: Dialect, file_name: str = "", overrides: Mapping[str, str] = {}
) -> Model:
    """A model in one dialect; `overrides` are values of parameters by name. Raises ModelError."""
    split_line = _v1_words if dialect == "v1" else _v2_words
    lines = _LINE_END.split(text)
    if len(lines) > LINES_MAX:
        raise ModelError(f"it has more than {LINES_MAX:,} lines", LINES_MAX + 1)
    try:
        numbered_lines = [
            (line_number, words)
            for line_number, line in enumerate(lines, 1)
            if (words := split_line(line, line_number))
        ]
        if not numbered_lines:
            raise ModelError(
                f"it says nothing in {DIALECT_NAMES[dialect]}: no line begins with @ and a name"
            )
        macros = {
            line_words[0][1:]
            for _, line_words in numbered_lines
            if _family(line_words, dialect) == "macro"
        }
        statements = tuple(
            _parse_statement(line_number, line_words, dialect, macros)
            for line_number, line_words in numbered_lines
        )
        model = Model(file_name, dialect, statements)
        _refuse_duplicate_names(model)
        model.params = _parameter_values(model, overrides)
        _check_points(model, macros)
        for statement in statements:
            _check_numbers(model, statement)
    except ModelError as error:
        error.file = file_name
        raise
    return model


# --- lines --------------------------------------------------------------------------------------


def _v1_words(line: str, line_number: int) -> tuple[str, ...]:
    content = line.split("#", 1)[0].strip()
    if content and not content.startswith("@"):
        raise ModelError("a line begins with @ and a name, or with # for a comment", line_number)
    return _check_line_length(tuple(content.split()), line, line_number)


def _v2_words(line: str, line_number: int) -> tuple[str, ...]:
    content = line.strip()
    if content.startswith("~") and not re.match(r"~(begin|end)\s+\S", content):
        raise ModelError("a buffer is `~begin NAME`, later `~end NAME`", line_number)
    if not content.startswith("@"):
        return ()
    words = _check_line_length(tuple(_V2_WORD.findall(content)), line, line_number)
    if re.sub(r"\s", "", "".join(words)) != re.sub(r"\s", "", content):
        raise ModelError("brackets do not match; a value in brackets is [a + b]", line_number)
    for word in words:
        if word.startswith("#"):
            message = "a comment behind a statement is read as values; give it a line of its own"
            raise ModelError(message, line_number)
        if "+" in word and not word.startswith("["):
            message = f"{quote(word)} is taken apart at the +; write it in brackets, [a + b]"
            raise ModelError(message, line_number)
    return words


def _check_line_length(words: tuple[str, ...], line: str, line_number: int) -> tuple[str, ...]:
    if words and len(line) > CHARACTERS_MAX:
        raise ModelError(f"a line has at most {CHARACTERS_MAX:,} characters", line_number)
    return words


def _family(row: tuple[str, ...], dialect: Dialect) -> str:
    form = FORMS[dialect].get(row[1]) if len(row) > 1 else None
    return "" if form is None else form.family


# --- statements ---------------------------------------------------------------------------------


def _parse_statement(
    line_number: int, words: tuple[str, ...], dialect: Dialect, macros: set[str]
) -> Statement:
    statement_name, *words_after_name = words
    if not _NAME.fullmatch(statement_name):
        message = (
            f"{quote(statement_name)} is not a name: write @, a letter, then letters, digits and _"
        )
        raise ModelError(message, line_number)
    if not words_after_name:
        raise ModelError(
            f"{statement_name} says nothing: a word such as mass or spring follows", line_number
        )
    keyword, *argument_words = words_after_name
    form = FORMS[dialect].get(keyword)
    if form is None:
        message = f"{quote(keyword)} is not a word of {DIALECT_NAMES[dialect]}"
        raise ModelError(message, line_number, nearest(keyword, FORMS[dialect]))
    if len(argument_words) < form.n_points:
        raise ModelError(f"{keyword} is written {form.usage}", line_number)
    point_words, value_words = (argument_words[: form.n_points], argument_words[form.n_points :])
    points = tuple(_parse_point(point_word, line_number) for point_word in point_words)
    if dialect == "v1":
        points, value_words = _v1_points(points, value_words, macros, keyword, line_number)
        if keyword in _DISPLAYABLE and len(value_words) == len(form.values) + 3:
            value_words = value_words[:-3]
    values = _named_values(
        form, [word.strip("[]").strip() for word in value_words], keyword, line_number
    )
    if "x0" in values:
        values["x0"] = _vertical_component(values["x0"], line_number)
    if "v0" in values:
        values["v0"] = _vertical_component(values["v0"], line_number)
    channel_pattern = _CHANNEL.get(form.family)
    if channel_pattern is not None and not channel_pattern.fullmatch(statement_name[1:]):
        message = (
            f"{statement_name} has no number of a channel: write @in1 to @in99, @out1 to @out99"
        )
        raise ModelError(message, line_number)
    return Statement(statement_name[1:], keyword, form.family, line_number, points, values)


def _parse_point(point_word: str, line_number: int) -> Point:
    point_name, *place_texts = (
        point_word.strip("[]").split(None, 1)[:2] if point_word.strip("[] ") else ("",)
    )
    if not _NAME.fullmatch(point_name):
        raise ModelError(f"{quote(point_word)} is not a point: write @ and its name", line_number)
    return Point(point_name[1:], tuple(place_texts[0].split()) if place_texts else ())


def _v1_points(
    points: tuple[Point, ...],
    value_words: list[str],
    macros: set[str],
    keyword: str,
    line_number: int,
) -> tuple[tuple[Point, ...], list[str]]:
    """The places on macros, which follow the values, in the order of the points."""
    macro_points = [point for point in points if point.name in macros]
    if len(value_words) < len(macro_points):
        raise ModelError(
            f"{keyword}: where on {quote(macro_points[0].name)} is left out", line_number
        )
    place_words = iter(value_words[len(value_words) - len(macro_points) :])
    placed_points = tuple(
        Point(point.name, tuple(next(place_words).split(":"))) if point.name in macros else point
        for point in points
    )
    return placed_points, value_words[: len(value_words) - len(macro_points)]


def _named_values(
    form: Form, value_words: list[str], keyword: str, line_number: int
) -> dict[str, str]:
    n_min = len(form.values) + len(form.trailing)
    if not n_min <= len(value_words) <= n_min + len(form.optional) or not all(value_words):
        raise ModelError(
            f"{keyword} is written {form.usage}; here it has {len(value_words)} values", line_number
        )
    value_names = (*form.values, *form.optional[: len(value_words) - n_min], *form.trailing)
    return dict(zip(value_names, value_words, strict=True))


def _vertical_component(text: str, line_number: int) -> str:
    """The third component of [x y z], the only one that moves; or the number as written."""
    components = text.split()
    if len(components) == 1 or not all(
        re.fullmatch(r"[+-]?[\d.eE+-]+", component) for component in components
    ):
        return text
    if len(components) != 3:
        raise ModelError(
            f"{quote(text)}: a position has one number, or three in brackets", line_number
        )
    return components[2]


# --- what statements mean together --------------------------------------------------------------


def _refuse_duplicate_names(model: Model) -> None:
    line_by_name: dict[str, int] = {}
    for statement in model.statements:
        if model.dialect == "v1" and statement.family == "link":
            continue  # MIMS has no use for the names of links
        if statement.name in line_by_name:
            message = (
                f"{quote(statement.name)} is the name of line "
                f"{line_by_name[statement.name]} already"
            )
            raise ModelError(message, statement.line)
        line_by_name[statement.name] = statement.line


def _parameter_values(model: Model, overrides: Mapping[str, str]) -> dict[str, Amount]:
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
        parameter_value = evaluate_number(
            text, {}, f"parameter {quote(parameter_name)}", declaration.line
        )
        amounts[parameter_name] = Amount(Fraction(parameter_value), "")
    return amounts


def _check_points(model: Model, macros: set[str]) -> None:
    mass_statements = {
        statement.name: statement
        for statement in model.statements_of("mass", "macro")
        if statement.name not in macros
    }
    inputs = {
        statement.name
        for statement in model.statements_of("input")
        if statement.keyword == "posInput"
    }
    masses = {*mass_statements, *inputs}
    kinds = {statement.name: statement.keyword for statement in model.statements_of("macro")}
    for statement in model.statements:
        for point in statement.points:
            if point.name in macros:
                n_sides = 2 if kinds[point.name] in MESHES else 1
                if len(point.places) != n_sides:
                    numbers_needed = (
                        "one number from 0 to 1" if n_sides == 1 else "two numbers from 0 to 1"
                    )
                    message = f"a point of {quote(point.name)} needs {numbers_needed}"
                    raise ModelError(message, statement.line)
            elif point.name not in masses:
                message = f"{quote('@' + point.name)} is not a mass of this model"
                suggestion = nearest(point.name, (*masses, *macros))
                raise ModelError(message, statement.line, suggestion)
            elif point.places:
                message = f"{quote(point.name)} is not a macro and has no places"
                raise ModelError(message, statement.line)


def _check_numbers(model: Model, statement: Statement) -> None:
    """Check that every value is a number, even if it is not used later."""
    for value_name in _numeric_value_names(statement):
        model.value(statement, value_name)
        if (
            model.dialect == "v2"
            and value_name in ("x0", "v0")
            and not _is_plain(statement.values[value_name])
        ):
            message = (
                f"{value_name} of {quote(statement.name)} is a plain number in mi-gen, no parameter"
            )
            raise ModelError(message, statement.line)
    for point in statement.points:
        for place in point.places:
            model.number(place, f"the place on {quote(point.name)}", statement.line)
    for value_name in ("N", "L", "W"):
        if value_name in statement.values and not re.fullmatch(
            r"[1-9]\d{0,6}", statement.values[value_name]
        ):
            raise ModelError(
                f"{value_name} of {quote(statement.name)} is a whole number above 0", statement.line
            )


def _is_plain(text: str) -> bool:
    return re.fullmatch(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", text) is not None


def _numeric_value_names(statement: Statement) -> Iterator[str]:
    return (name for name in statement.values if name != "input" and statement.family != "param")
