"""Explains why a file is not YAML, or not text, in terms of a score."""

import re
from collections.abc import Callable

import yaml
from yaml.composer import ComposerError

from ergon.notation.text.errors import Collector
from ergon.notation.text.typeset import BLANK, typeset_character
from ergon.notation.text.values import Place

# Turns the bytes of a named file into a text; None after a report.
Decoder = Callable[[bytes, str, Collector], str | None]

MAX_BYTES = 64 * 2**20  # bigger data are takes, and takes are files of their own
MAX_LINES = 5_000_000  # five times the rows of the longest table: places need an index of them
PURE_PARSER_LIMIT = 200_000  # characters: the pure parser's better message costs about 1 s here

_INDENTED = "this line is indented differently from the lines that it belongs to"
_INDENTED_BY_BLANK = re.compile(f"^ *{BLANK.pattern}", re.MULTILINE)
_INDENTATIONS_SHOWN_MAX = 4  # lines above whose indentation a line may have

# libyaml and PyYAML say what the parser wanted; a composer needs what to do.
_SENTENCES = (
    ("found character '\\t'", "the line is indented by a tab; indent it by spaces"),
    ("tab character", "the line is indented by a tab; indent it by spaces"),
    ("<block end>", _INDENTED),
    ("did not find expected key", _INDENTED),
    (
        "mapping values are not allowed",
        "a name is not allowed here: there is a second ':' or a wrong indentation",
    ),
    ("could not find expected ':'", "the name has no ':' after it"),
    ("expected ',' or ']'", "a list that begins with '[' is not closed with ']'"),
    ("expected ',' or '}'", "a group that begins with '{' is not closed with '}'"),
    ("found character '@'", "a word that begins with '@' needs quotes"),
    ("found character '`'", "a word that begins with a backquote needs quotes"),
    ("found character '%'", "a word that begins with '%' needs quotes"),
    ("undefined alias", "a word that begins with '*' is an alias in YAML; this one has no anchor"),
    (
        "while scanning an alias",
        "a word that begins with '*' is an alias in YAML; write it in quotes",
    ),
    (
        "while scanning an anchor",
        "a word that begins with '&' is an anchor in YAML; write it in quotes",
    ),
    ("quoted scalar", "a quoted text is not closed"),
    ("special characters are not allowed", "the text has a control character; remove it"),
    ("control characters are not allowed", "the text has a control character; remove it"),
)


def is_too_deep(error: Exception) -> bool:
    """Whether the parser gave up at a bound of its own: in PyYAML 6.0.4 libyaml has 1,000."""
    return "maximum nesting depth" in str(getattr(error, "problem", ""))


def index_of_level(
    source_text: str, error: Exception, start_and_level: tuple[int, int], bracket_level: int
) -> int:
    """Index at which bracket level `bracket_level` opens before such an error; `start_and_level` is
    an index and its level.

    Brackets in quotes count too, so if there are any the index may be a few levels off.
    """
    (begin, depth), error_index = start_and_level, _index_of(error)
    for text_index in range(begin, error_index):
        depth += (source_text[text_index] in "[{") - (source_text[text_index] in "]}")
        if depth >= bracket_level:
            return text_index
    return error_index


def explained(source_text: str, error: Exception) -> tuple[int, str]:
    """Index and message of an error; the pure Python parser explains it if the text up to the error
    is short.
    """
    if _index_of(error) <= PURE_PARSER_LIMIT and not isinstance(error, ComposerError):
        try:
            for _ in yaml.parse(source_text[: 2 * PURE_PARSER_LIMIT], yaml.SafeLoader):
                pass
        except yaml.YAMLError as clearer_error:
            error = clearer_error
        except (RecursionError, ValueError):
            pass  # keep the first message
    if (blank_index := _typeset_blank(source_text, _index_of(error))) is not None:
        return blank_index, f"here stands {typeset_character(source_text[blank_index])}"
    error_words = str(error)
    for needle, error_sentence in _SENTENCES:
        if needle in error_words:
            if error_sentence is _INDENTED:
                return _index_of(error), _indentation_message(source_text, _index_of(error))
            unclosed = "closed" in error_sentence or "':' after" in error_sentence
            return _index_of(error, unclosed), error_sentence
    problem = getattr(error, "problem", None) or error_words.split("\n")[0]
    return _index_of(error), f"not YAML: {problem}"


def _indentation_message(source_text: str, error_index: int) -> str:
    """The message for a wrongly indented line: the indentations that the lines above allow, or
    that a name stands among the items of a list.
    """
    line_begin = source_text.rfind("\n", 0, error_index) + 1
    indent = len(source_text[line_begin:error_index]) - len(
        source_text[line_begin:error_index].lstrip(" ")
    )
    is_item = source_text.startswith("- ", line_begin + indent)
    indent_limit, indents_shown = PURE_PARSER_LIMIT, []
    for line in reversed(
        source_text[max(0, line_begin - PURE_PARSER_LIMIT) : line_begin].splitlines()
    ):
        line_text = line.strip()
        indent_above = len(line) - len(line.lstrip(" "))
        if line_text and not line_text.startswith("#") and indent_above < indent_limit:
            if indent_above == indent and line_text.startswith("- ") != is_item:
                return (
                    "a line of a list and one of a group stand side by side here: lines of a list "
                    "begin with '- ', lines of a group with a name and ':'"
                )
            indent_limit = indent_above
            indents_shown.append(f"{indent_above} ('{line_text.partition(':')[0][:20]}')")
        if indent_limit == 0 or len(indents_shown) == _INDENTATIONS_SHOWN_MAX:
            break
    if not indents_shown:
        return _INDENTED
    noun = "space" if indent == 1 else "spaces"
    return (
        f"{_INDENTED}; it begins with {indent} {noun}, those above with {', '.join(indents_shown)}"
    )


def _typeset_blank(source_text: str, source_index: int) -> int | None:
    """Index of a typeset space in the line of an error or the one before, or at the beginning of
    any line before, which YAML takes for a letter; None without one.
    """
    begin = source_text.rfind("\n", 0, max(0, source_text.rfind("\n", 0, source_index))) + 1
    end = source_text.find("\n", source_index)
    blank_match = BLANK.search(source_text, begin, len(source_text) if end < 0 else end)
    if blank_match is not None:
        return blank_match.start()
    blank_match = _INDENTED_BY_BLANK.search(source_text, 0, max(0, source_index))
    return None if blank_match is None else blank_match.end() - 1


def _index_of(error: Exception, unclosed: bool = False) -> int:
    """Index of an error; for something that is never closed, the index where it was opened, if that
    is on an earlier line.
    """
    problem_mark = getattr(error, "problem_mark", None)
    context_mark = getattr(error, "context_mark", None)
    if (
        unclosed
        and problem_mark is not None
        and context_mark is not None
        and context_mark.line < problem_mark.line
    ):
        return int(context_mark.index)
    mark = problem_mark if problem_mark is not None else context_mark
    if mark is not None:
        return int(mark.index)
    position = getattr(error, "position", getattr(error, "start", 0))
    return position if isinstance(position, int) else 0


def decode(file_bytes: bytes, file_name: str, collector: Collector) -> str | None:
    """UTF-8 text of a file's bytes, with or without BOM; None after saying what is wrong."""
    if len(file_bytes) > MAX_BYTES:
        message = f"the file has more than {MAX_BYTES // 2**20} MB; write a long gesture as a take"
        collector.error("E105", message, Place(file_name, 1, 1))
        return None
    if file_bytes[:2] in (b"\xff\xfe", b"\xfe\xff"):
        message = "the file is in UTF-16; save it in UTF-8"
        collector.error("E107", message, Place(file_name, 1, 1))
        return None
    try:
        return file_bytes.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line_start = file_bytes.rfind(b"\n", 0, error.start) + 1
        column = len(file_bytes[line_start : error.start].decode("utf-8", "replace")) + 1
        place = Place(file_name, file_bytes.count(b"\n", 0, error.start) + 1, column)
        message = f"byte 0x{file_bytes[error.start]:02x} is not UTF-8; save the file in UTF-8"
        collector.error("E107", message, place)
        return None
