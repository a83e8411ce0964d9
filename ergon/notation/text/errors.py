"""What a mistake is: a message with a place, a code, a suggestion; and how it is shown."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from ergon.common.errors import ErgonError
from ergon.common.terminal import json_text, printable
from ergon.notation.text.spelling import nearest
from ergon.notation.text.typeset import plain, typeset_character
from ergon.notation.text.values import Place

MAX_SHOWN = 20  # diagnostics of each severity
MAX_KEPT = 10_000  # found before sorting; the rest is only counted, so that memory is bounded
_COMPARED_NAMES_MAX = 2_000  # names that did-you-mean compares with: about 10 ms
_MAX_LISTED = 20  # names that are told where none is near
_NUMBER = re.compile(r"\d+(?:[.,]\d+)*")
_MAX_LINE = 160  # columns of source shown; longer lines are shown round the caret

Severity = Literal["error", "warning", "note"]
_SEVERITIES: dict[str, Severity] = {"E": "error", "W": "warning", "N": "note"}


class TextError(ErgonError, ValueError):
    """A mistake inside one text; `offset` and `length` count characters of the text."""

    def __init__(
        self,
        message: str,
        *,
        offset: int = 0,
        length: int = 1,
        suggestion: str | None = None,
        code: str = "E204",
    ) -> None:
        """Keep what a report needs once the scalar's place is known."""
        super().__init__(message)
        self.message = message
        self.offset = offset
        self.length = length
        self.suggestion = suggestion
        self.code = code


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One mistake, warning or note, in its place."""

    code: str
    message: str
    place: Place
    suggestion: str | None = None
    help: str | None = None

    @property
    def severity(self) -> Severity:
        """The code's letter: E error, W warning, N note."""
        return _SEVERITIES[self.code[0]]


class Source(Protocol):
    """A file whose lines can be shown."""

    def line(self, number: int) -> str:
        """The text of a line, numbered from 1."""
        ...


class Collector:
    """Gathers diagnostics; `finish` returns them in file order, up to 20 of each severity."""

    n_reports: int  # how often something was reported, the same twice too

    def __init__(self) -> None:
        """Start with none."""
        self.clear()

    def clear(self) -> None:
        """Forget all reports."""
        self.n_reports = 0
        self._reports: dict[tuple[str, str, Place], tuple[Diagnostic, tuple[str, ...]]] = {}
        self._counts: dict[Severity, int] = {"error": 0, "warning": 0, "note": 0}
        self._files: dict[str, int] = {}
        self._loops: dict[str, list[range]] = {}  # lines of loops, by file
        # A file that is used, or a loop, cannot be read: unknown names may be its own.
        self.lacks_names = False

    def error(
        self,
        code: str,
        message: str,
        place: Place,
        *,
        suggestion: str | None = None,
        help: str | None = None,
        word: str | None = None,
        names: Iterable[str] = (),
    ) -> None:
        """Add a diagnostic of any severity; with `word`, the nearest of `names` becomes the
        suggestion.
        """
        self.n_reports += 1
        if self.lacks_names and code == "E301":
            return
        message = printable(message)  # file names may hold terminal control characters
        # A node is read once for each alias, note, copy, and turn of a loop. Its message names the
        # owner up to the first colon, and a loop changes numbers: the key leaves both out.
        words = message.partition(": ")[2] or message
        report_key = (code, _NUMBER.sub("0", words) if self._is_in_loop(place) else words, place)
        if report_key in self._reports:
            return
        diagnostic = Diagnostic(code, message, place, suggestion, help)
        self._counts[diagnostic.severity] += 1
        if len(self._reports) < MAX_KEPT:
            # Suggestions are searched in `finish`: of 10,000 mistakes only 20 are shown.
            word_and_names = (word, *names) if word is not None else ()
            self._reports[report_key] = (diagnostic, word_and_names)

    def loop(self, first_place: Place, last_place: Place) -> None:
        """Note the lines of a loop: each of its mistakes is told once, not in each turn."""
        self._loops.setdefault(first_place.file, []).append(
            range(first_place.line, last_place.line + 1)
        )

    def _is_in_loop(self, place: Place) -> bool:
        return any(place.line in lines for lines in self._loops.get(place.file, ()))

    def file(self, name: str) -> None:
        """Note that a file was opened: reports follow the order of opening."""
        self._files.setdefault(name, len(self._files))

    def has_errors(self) -> bool:
        """Whether any error was added."""
        return self._counts["error"] > 0

    def finish(self) -> list[Diagnostic]:
        """Everything found, in file order: at most 20 of each severity, with suggestions."""
        ordered_reports = sorted(
            self._reports.values(),
            key=lambda item: (
                self._files.get(item[0].place.file, len(self._files)),
                item[0].place.line,
                item[0].place.column,
                item[0].code,
            ),
        )
        shown_counts: dict[Severity, int] = {"error": 0, "warning": 0, "note": 0}
        sorted_diagnostics = []
        for diagnostic, word_and_names in ordered_reports:
            shown_counts[diagnostic.severity] += 1
            if shown_counts[diagnostic.severity] <= MAX_SHOWN:
                sorted_diagnostics.append(_with_suggestion(diagnostic, word_and_names))
        return sorted_diagnostics

    def left_out(self) -> dict[Severity, int]:
        """How many of each severity `finish` does not show."""
        return {kind: max(0, count - MAX_SHOWN) for kind, count in self._counts.items()}


def _with_suggestion(diagnostic: Diagnostic, word_and_names: tuple[str, ...]) -> Diagnostic:
    if diagnostic.suggestion is not None or not word_and_names:
        return diagnostic
    suggestion = nearest(word_and_names[0], word_and_names[1 : 1 + _COMPARED_NAMES_MAX])
    if suggestion == word_and_names[0]:
        suggestion = None
    help_text = diagnostic.help
    if help_text is None and (character := typeset_character(word_and_names[0])) is not None:
        suggestion, help_text = (
            plain(word_and_names[0]),
            f"{quote(word_and_names[0])} has {character}",
        )
    if suggestion is None and help_text is None and 1 < len(word_and_names) <= _MAX_LISTED + 1:
        help_text = f"known here: {', '.join(dict.fromkeys(word_and_names[1:]))}"
    return Diagnostic(diagnostic.code, diagnostic.message, diagnostic.place, suggestion, help_text)


def quote(word: str) -> str:
    """A word of the score in quotes, shortened, without terminal control characters."""
    shown_word = word if len(word) <= 40 else word[:37] + "..."
    return f"'{printable(shown_word)}'"


_VOWELS = "aeiou"
_SPELLED_VOWELS = "AEFHILMNORSX"  # letters whose names begin with a vowel


def with_article(noun: str) -> str:
    """The noun with its article: `a mass`, `an impulse`, `a MAS`, `an LNL`."""
    is_spelled = noun.isupper() and not set(noun.lower()) & set(_VOWELS)
    starts_with_vowel = noun[0] in _SPELLED_VOWELS if is_spelled else noun[0].lower() in _VOWELS
    return f"{'an' if starts_with_vowel else 'a'} {noun}"


# --- showing ------------------------------------------------------------------------------------


def concise(diagnostic: Diagnostic, sources: Mapping[str, Source] | None = None) -> str:
    """One line: `file:line:column: error[E101] …     did you mean 'players'?`."""
    shown = diagnostic
    suggestion_text = f"     did you mean {quote(shown.suggestion)}?" if shown.suggestion else ""
    return f"{shown.place}: {shown.severity}[{shown.code}] {shown.message}{suggestion_text}"


def full(diagnostic: Diagnostic, sources: Mapping[str, Source] | None = None) -> str:
    """The sentence, the source line, a caret with the suggestion, and one line of help."""
    shown = diagnostic
    source = (sources or {}).get(shown.place.file)
    if source is None:
        return concise(shown) + (f"\n    = {shown.help}" if shown.help else "")
    report_lines = [f"{shown.place}: {shown.severity}[{shown.code}] {shown.message}"]
    gutter_text = f" {shown.place.line} | "
    text, indentation, marked_width = _window(source.line(shown.place.line), shown.place)
    suggestion_text = f" did you mean {quote(shown.suggestion)}?" if shown.suggestion else ""
    report_lines.append(gutter_text + text)
    report_lines.append(
        " " * (len(gutter_text) - 2)
        + "| "
        + " " * indentation
        + "^" * marked_width
        + suggestion_text
    )
    if shown.help:
        report_lines.append(" " * (len(gutter_text) - 2) + f"= {shown.help}")
    return "\n".join(report_lines)


def _window(shown_line: str, error_place: Place) -> tuple[str, int, int]:
    """The part of a line round the caret, columns before the caret, and its width."""
    start = error_place.column - 1
    first_column = max(0, start - _MAX_LINE // 2) if len(shown_line) > _MAX_LINE else 0
    shown_text = "".join(
        character if character.isprintable() else " "
        for character in shown_line[first_column : first_column + _MAX_LINE]
    )
    indentation = _width(shown_text[: start - first_column])
    marked_width = max(
        1, _width(shown_text[start - first_column : start - first_column + error_place.length])
    )
    return shown_text.rstrip(), indentation, marked_width


def _width(text: str) -> int:
    """Columns on a terminal."""
    n_wide = sum(unicodedata.east_asian_width(character) in "WF" for character in text)
    return len(text) + n_wide - sum(unicodedata.combining(character) > 0 for character in text)


def github(diagnostic: Diagnostic, sources: Mapping[str, Source] | None = None) -> str:
    """A workflow command that GitHub shows beside the line."""
    shown = diagnostic
    github_kind = "notice" if shown.severity == "note" else shown.severity
    message = shown.message + (
        f"; did you mean {quote(shown.suggestion)}?" if shown.suggestion else ""
    )
    location = f"file={_escaped(shown.place.file)},line={shown.place.line},col={shown.place.column}"
    return f"::{github_kind} {location},title={shown.code}::{message.replace('%', '%25')}"


def _escaped(field_value: str) -> str:
    for character, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A"), (":", "%3A"), (",", "%2C")):
        field_value = field_value.replace(character, code)
    return field_value


def json_line(diagnostic: Diagnostic, sources: Mapping[str, Source] | None = None) -> str:
    """One JSON object, for other programs."""
    shown = diagnostic
    record = {
        "v": 1,
        "event": shown.severity,
        "code": shown.code,
        "file": shown.place.file,
        "line": shown.place.line,
        "column": shown.place.column,
        "message": shown.message,
        "suggestion": shown.suggestion,
    }
    return json_text(record)


Renderer = Callable[[Diagnostic, Mapping[str, Source] | None], str]
RENDERERS: dict[str, Renderer] = {
    "full": full,
    "concise": concise,
    "github": github,
    "json": json_line,
}
