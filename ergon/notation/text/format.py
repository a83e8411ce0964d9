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


class _Text(NamedTuple):
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


def formatted(text: str) -> str:
    """Return the score with canonical spacing. Raises TextError where it is not YAML."""
    if len(text) > MAX_BYTES:
        raise TextError(f"more than {MAX_BYTES // 2**20} MB of text", code="E105")
    try:
        meaning = _meaning(text)
        result = _trimmed(_aligned(_spaced(text)))
        if _meaning(result) == meaning:
            return result
    except yaml.YAMLError as error:
        if is_too_deep(error):
            raise TextError(TOO_DEEP, code="E105") from None
        mark = getattr(error, "problem_mark", None)
        raise TextError(
            "the score cannot be read, so it cannot be formatted: "
            f"{getattr(error, 'problem', error)}",
            offset=min(mark.index, len(text)) if mark else 0,
            code="E100",
        ) from None
    raise TextError("this score cannot be formatted without a change of its meaning", code="E100")


def _events(text: str) -> Iterator[tuple[yaml.Event, tuple[str, ...]]]:
    """Every event with the names that lead to it."""
    path: list[str | None] = []  # one per open collection: the key being read, "" in a list
    keys: list[bool] = []  # whether the next scalar of that collection is a key
    for event in yaml.parse(text, Loader=_LOADER):
        if len(path) > MAX_DEPTH:  # libyaml takes quadratic time over brackets
            raise TextError(TOO_DEEP, code="E105")
        if isinstance(event, yaml.CollectionEndEvent):
            path.pop()
            keys.pop()
        if isinstance(event, yaml.ScalarEvent) and keys and keys[-1]:
            path[-1] = event.value
        yield event, tuple(name or "" for name in path)
        if keys and isinstance(event, (yaml.ScalarEvent, yaml.AliasEvent, yaml.CollectionEndEvent)):
            keys[-1] = not keys[-1] if path[-1] is not None else False
        if isinstance(event, yaml.MappingStartEvent):
            path.append("")
            keys.append(True)
        elif isinstance(event, yaml.SequenceStartEvent):
            path.append(None)
            keys.append(False)


def _texts(text: str) -> list[_Text]:
    """The scalars that span lines."""
    blocks = []
    for event, path in _events(text):
        start, end = event.start_mark, event.end_mark
        if isinstance(event, yaml.ScalarEvent) and start and end and start.line != end.line:
            blocks.append(_Text(start.index, end.index, path, event.style))
    return blocks


def _meaning(text: str) -> list[object]:
    """What must not change: every event, tables as their words."""
    meaning: list[object] = []
    for event, path in _events(text):
        if isinstance(event, yaml.ScalarEvent):
            value: object = event.value
            if _Text(0, 0, path, event.style).columns:
                value = [line.split() for line in event.value.rstrip().split("\n")]
            meaning.append((value, event.style, event.anchor, event.tag))
        else:
            meaning.append((type(event), getattr(event, "anchor", None)))
    return meaning


def _spaced(text: str) -> str:
    """Set the spaces between the tokens of flow maps and lists that share a line."""
    pieces: list[str] = []
    offset = depth = 0
    token_before: yaml.Token | None = None
    for token in yaml.scan(text, Loader=_LOADER):
        if isinstance(token, yaml.KeyToken):  # no character of its own in the flow
            continue
        if token_before is not None and depth:
            gap = slice(token_before.end_mark.index, token.start_mark.index)
            if not text[gap].strip(" "):
                pieces += (text[offset : gap.start], _gap(token_before, token))
                offset = gap.stop
        depth += isinstance(token, _OPENERS) - isinstance(token, _CLOSERS)
        token_before = token
    return "".join((*pieces, text[offset:]))


def _gap(token_before: yaml.Token, token_after: yaml.Token) -> str:
    if isinstance(token_before, _OPENERS) or isinstance(
        token_after, (*_CLOSERS, yaml.FlowEntryToken, yaml.ValueToken)
    ):
        return ""
    return " "


def _aligned(text: str) -> str:
    """Align the columns of tables that are not."""
    pieces: list[str] = []
    offset = 0
    for block in _texts(text):
        if not block.columns:
            continue
        block_start = text.find("\n", block.start) + 1
        lines = text[block_start : block.end].split("\n")
        pieces += (text[offset:block_start], "\n".join(_columns(lines, block.columns)))
        offset = block.end
    return "".join((*pieces, text[offset:]))


def _columns(lines: list[str], columns: int) -> list[str]:
    """Rows with their words under each other; comments and blank lines as they were."""
    rows: dict[int, tuple[str, list[str], str]] = {}
    for i, line in enumerate(lines):
        code, comment = _without_comment(line)
        words = code.split(maxsplit=columns - 1)
        if words:
            words[-1] = words[-1] if columns == 3 else " ".join(words[-1].split())
            rows[i] = (line[: len(line) - len(line.lstrip())], words, comment)
    if _is_aligned(lines, rows.values(), rows):
        return lines
    widths = [
        max((len(words[k]) for _, words, _ in rows.values() if len(words) > k), default=0)
        for k in range(columns)
    ]
    indent = min((row_indent for row_indent, _, _ in rows.values()), key=len)
    out = list(lines)
    for i, (_, words, comment) in rows.items():
        cells = [word.ljust(width) for word, width in zip(words, widths, strict=False)]
        row_text = indent + _COLUMN_GAP.join(cells).rstrip()
        out[i] = f"{row_text}  {comment}" if comment else row_text
    return out


def _without_comment(line: str) -> tuple[str, str]:
    match = re.search(r"(?:^|(?<=\s))#", line)
    return (line[: match.start()], line[match.start() :].rstrip()) if match else (line, "")


def _is_aligned(
    lines: list[str], rows: Iterable[tuple[str, list[str], str]], numbers: Iterable[int]
) -> bool:
    """Whether every column begins at one place already."""
    begins: list[set[int]] = [set(), set(), set()]
    for i, (_, words, _) in zip(numbers, rows, strict=True):
        column = 0
        for k, word in enumerate(words):
            column = lines[i].find(word, column)
            if column < 0:  # words of a play with more than one space between them
                return False
            begins[k].add(column)
            column += len(word)
    return all(len(places) <= 1 for places in begins)


def _trimmed(text: str) -> str:
    """Take away spaces at ends of lines, where they are not text, and end with one newline."""
    blocks = [(block.start, block.end) for block in _texts(text) if not block.columns]
    pieces: list[str] = []
    copied_until = i = 0
    for match in re.finditer(r"(?<![ \t])[ \t]+(?=\r?$)", text, re.MULTILINE):
        while i < len(blocks) and blocks[i][1] <= match.start():
            i += 1
        if i == len(blocks) or match.end() <= blocks[i][0]:
            pieces.append(text[copied_until : match.start()])
            copied_until = match.end()
    trimmed = "".join((*pieces, text[copied_until:]))
    ended = trimmed.rstrip("\r\n") + ("\r\n" if "\r\n" in trimmed else "\n")
    return ended if _meaning(ended) == _meaning(trimmed) else trimmed
