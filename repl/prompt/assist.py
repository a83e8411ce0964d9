"""Colours and completions of a session, for prompt_toolkit."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.formatted_text import StyleAndTextTuples
from prompt_toolkit.lexers import Lexer
from prompt_toolkit.styles import Style

from ergon.common.terminal import clean
from ergon.repl.session_protocol import SessionProtocol

# A mistake is underlined, so that NO_COLOR and colour blindness hide nothing.
STYLE = Style.from_dict(
    {
        "verb": "bold",
        "name": "ansicyan",
        "number": "ansiyellow",
        "unit": "ansiyellow",
        "curve": "ansigreen",
        "unknown": "underline ansired",
        "comment": "ansibrightblack",
    }
)
_COLOURED_MAX = 2_000  # characters of a line; it is coloured again at every key
_HINT_MAX = 60


class Colours(Lexer):
    """Shows each word of a line in the style of its kind."""

    def __init__(self, session: SessionProtocol) -> None:
        """Use the kinds of words that a session reports."""
        self._session = session

    def lex_document(self, document: Document) -> Callable[[int], StyleAndTextTuples]:
        """Colour lines on demand: of a block, only the visible lines are processed."""
        return lambda number: self._coloured_line(document.lines, number)

    def _coloured_line(self, lines: list[str], number: int) -> StyleAndTextTuples:
        line_text = lines[number] if number < len(lines) else ""
        if len(line_text) > _COLOURED_MAX:
            return [("", line_text)]
        fragments: StyleAndTextTuples = []
        start_column = 0
        for token_start, token_end, token_kind in self._session.tokens(line_text):
            if start_column <= token_start < token_end:  # gaps between words have no kind
                fragments += [
                    ("", line_text[start_column:token_start]),
                    (f"class:{token_kind}", line_text[token_start:token_end]),
                ]
                start_column = token_end
        return [*fragments, ("", line_text[start_column:])]


class Completions(Completer):
    """The completions at the cursor, each with a hint."""

    def __init__(self, session: SessionProtocol) -> None:
        """Use the completions of a session."""
        self._session = session

    def get_completions(
        self, document: Document, complete_event: CompleteEvent
    ) -> Iterable[Completion]:
        """Yield all completions; there are some hundred at most."""
        cursor_column = document.cursor_position_col
        for completion in self._session.complete(document.current_line, cursor_column):
            hint = clean(completion.hint)[:_HINT_MAX]
            yield Completion(completion.text, completion.start - cursor_column, display_meta=hint)
