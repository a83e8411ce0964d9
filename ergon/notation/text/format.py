"""`ergon fmt`: canonical spacing, and nothing else.

It changes spaces inside flow maps and lists (`{ a:1,b: 2 }`), columns of tables that are not
aligned, spaces at ends of lines, and the end of the file. Comments stay byte for byte. The
meaning of the score is compared before and after: a text whose meaning would change is refused.
"""

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import yaml

from ergon.notation.text.document import MAX_DEPTH, TOO_DEEP
from ergon.notation.text.errors import TextError
from ergon.notation.text.syntax import MAX_BYTES, is_too_deep

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_COLUMN_GAP = "   "
_OPENERS = (yaml.FlowMappingStartToken, yaml.FlowSequenceStartToken)
_CLOSERS = (yaml.FlowMappingEndToken, yaml.FlowSequenceEndToken)


class _ScalarOfLines(NamedTuple):
    """A scalar of more than one line: its span and the names that lead to it."""

    start: int
    end: int
    path: tuple[str, ...]
    style: str | None

    @property
    def columns(self) -> int:
        """Number of columns of the text as a table; 0 if it is not a table."""
        if self.style == "|" and self.path[-1:] == ("points",):
            return 3  # t x curve
        return 2 if self.style == "|" and self.path[:1] == ("parts",) else 0  # at, play


def formatted(source_text: str) -> str:
    """Return the score with canonical spacing. Raises TextError where it is not YAML."""
    if len(source_text) > MAX_BYTES:
        raise TextError(f"more than {MAX_BYTES // 2**20} MB of text", code="E105")
    try:
        meaning_before = _meaning(source_text)
        formatted_text = _trimmed(_aligned(_spaced(source_text)))
        if _meaning(formatted_text) == meaning_before:
            return formatted_text
    except yaml.YAMLError as error:
        if is_too_deep(error):
            raise TextError(TOO_DEEP, code="E105") from None
        mark = getattr(error, "problem_mark", None)
        raise TextError(
            "the score cannot be read, so it cannot be formatted: "
            f"{getattr(error, 'problem', error)}",
            offset=min(mark.index, len(source_text)) if mark else 0,
            code="E100",
        ) from None
    raise TextError("this score cannot be formatted without a change of its meaning", code="E100")


def _events(source_text: str) -> Iterator[tuple[yaml.Event, tuple[str, ...]]]:
    """Every event with the names that lead to it."""
    path: list[str | None] = []  # one per open collection: the key being read, "" in a list
    key_flags: list[bool] = []  # whether the next scalar of that collection is a key
    for yaml_event in yaml.parse(source_text, Loader=_LOADER):
        if len(path) > MAX_DEPTH:  # libyaml takes quadratic time over brackets
            raise TextError(TOO_DEEP, code="E105")
        if isinstance(yaml_event, yaml.CollectionEndEvent):
            path.pop()
            key_flags.pop()
        if isinstance(yaml_event, yaml.ScalarEvent) and key_flags and key_flags[-1]:
            path[-1] = yaml_event.value
        yield yaml_event, tuple(name or "" for name in path)
        if key_flags and isinstance(
            yaml_event, (yaml.ScalarEvent, yaml.AliasEvent, yaml.CollectionEndEvent)
        ):
            key_flags[-1] = not key_flags[-1] if path[-1] is not None else False
        if isinstance(yaml_event, yaml.MappingStartEvent):
            path.append("")
            key_flags.append(True)
        elif isinstance(yaml_event, yaml.SequenceStartEvent):
            path.append(None)
            key_flags.append(False)


def _texts(source_text: str) -> list[_ScalarOfLines]:
    """The scalars that span lines."""
    scalars = []
    for yaml_event, path in _events(source_text):
        start, end = yaml_event.start_mark, yaml_event.end_mark
        if isinstance(yaml_event, yaml.ScalarEvent) and start and end and start.line != end.line:
            scalars.append(_ScalarOfLines(start.index, end.index, path, yaml_event.style))
    return scalars


def _meaning(source_text: str) -> list[object]:
    """What must not change: every event, tables as their words."""
    event_values: list[object] = []
    for yaml_event, path in _events(source_text):
        if isinstance(yaml_event, yaml.ScalarEvent):
            event_value: object = yaml_event.value
            if _ScalarOfLines(0, 0, path, yaml_event.style).columns:
                event_value = [line.split() for line in yaml_event.value.rstrip().split("\n")]
            event_values.append((event_value, yaml_event.style, yaml_event.anchor, yaml_event.tag))
        else:
            event_values.append((type(yaml_event), getattr(yaml_event, "anchor", None)))
    return event_values


def _spaced(source_text: str) -> str:
    """Set the spaces between the tokens of flow maps and lists that share a line."""
    pieces: list[str] = []
    copied_end = depth = 0
    previous: yaml.Token | None = None
    for yaml_token in yaml.scan(source_text, Loader=_LOADER):
        if isinstance(yaml_token, yaml.KeyToken):  # no character of its own in the flow
            continue
        if previous is not None and depth:
            gap_slice = slice(previous.end_mark.index, yaml_token.start_mark.index)
            if not source_text[gap_slice].strip(" "):
                pieces += (source_text[copied_end : gap_slice.start], _gap(previous, yaml_token))
                copied_end = gap_slice.stop
        depth += isinstance(yaml_token, _OPENERS) - isinstance(yaml_token, _CLOSERS)
        previous = yaml_token
    return "".join((*pieces, source_text[copied_end:]))


def _gap(previous: yaml.Token, next_token: yaml.Token) -> str:
    if isinstance(previous, _OPENERS) or isinstance(
        next_token, (*_CLOSERS, yaml.FlowEntryToken, yaml.ValueToken)
    ):
        return ""
    return " "


def _aligned(source_text: str) -> str:
    """Align the columns of tables that are not."""
    pieces: list[str] = []
    copied_end = 0
    for text_block in _texts(source_text):
        if not text_block.columns:
            continue
        block_start = source_text.find("\n", text_block.start) + 1
        block_lines = source_text[block_start : text_block.end].split("\n")
        pieces += (
            source_text[copied_end:block_start],
            "\n".join(_columns(block_lines, text_block.columns)),
        )
        copied_end = text_block.end
    return "".join((*pieces, source_text[copied_end:]))


def _columns(table_lines: list[str], n_columns: int) -> list[str]:
    """Rows with their words under each other; comments and blank lines as they were."""
    rows_by_line: dict[int, tuple[str, list[str], str]] = {}
    for line_number, table_line in enumerate(table_lines):
        code, comment = _without_comment(table_line)
        row_words = code.split(maxsplit=n_columns - 1)
        if row_words:
            row_words[-1] = row_words[-1] if n_columns == 3 else " ".join(row_words[-1].split())
            rows_by_line[line_number] = (
                table_line[: len(table_line) - len(table_line.lstrip())],
                row_words,
                comment,
            )
    if _is_aligned(table_lines, rows_by_line.values(), rows_by_line):
        return table_lines
    widths = [
        max(
            (len(words[column]) for _, words, _ in rows_by_line.values() if len(words) > column),
            default=0,
        )
        for column in range(n_columns)
    ]
    indent = min((row_indent for row_indent, _, _ in rows_by_line.values()), key=len)
    aligned_lines = list(table_lines)
    for line_number, (_, row_words, comment) in rows_by_line.items():
        cells = [word.ljust(width) for word, width in zip(row_words, widths, strict=False)]
        row_text = indent + _COLUMN_GAP.join(cells).rstrip()
        aligned_lines[line_number] = f"{row_text}  {comment}" if comment else row_text
    return aligned_lines


def _without_comment(line: str) -> tuple[str, str]:
    match = re.search(r"(?:^|(?<=\s))#", line)
    return (line[: match.start()], line[match.start() :].rstrip()) if match else (line, "")


def _is_aligned(
    table_lines: list[str],
    row_parts: Iterable[tuple[str, list[str], str]],
    line_numbers: Iterable[int],
) -> bool:
    """Whether every column begins at one place already."""
    begins_by_column: list[set[int]] = [set(), set(), set()]
    for line_number, (_, words, _) in zip(line_numbers, row_parts, strict=True):
        word_column = 0
        for column, row_word in enumerate(words):
            word_column = table_lines[line_number].find(row_word, word_column)
            if word_column < 0:  # words of a play with more than one space between them
                return False
            begins_by_column[column].add(word_column)
            word_column += len(row_word)
    return all(len(column_begins) <= 1 for column_begins in begins_by_column)


def _trimmed(source_text: str) -> str:
    """Take away spaces at ends of lines, where they are not text, and end with one newline."""
    text_blocks = [(block.start, block.end) for block in _texts(source_text) if not block.columns]
    pieces: list[str] = []
    copied_end = block_index = 0
    for blank_match in re.finditer(r"(?<![ \t])[ \t]+(?=\r?$)", source_text, re.MULTILINE):
        while block_index < len(text_blocks) and text_blocks[block_index][1] <= blank_match.start():
            block_index += 1
        if block_index == len(text_blocks) or blank_match.end() <= text_blocks[block_index][0]:
            pieces.append(source_text[copied_end : blank_match.start()])
            copied_end = blank_match.end()
    trimmed = "".join((*pieces, source_text[copied_end:]))
    with_line_end = trimmed.rstrip("\r\n") + ("\r\n" if "\r\n" in trimmed else "\n")
    return with_line_end if _meaning(with_line_end) == _meaning(trimmed) else trimmed
