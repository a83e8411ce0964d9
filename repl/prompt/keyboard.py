"""Keyboard input: the keys that have a meaning here, and a way out of a paste that never ends."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol, TextIO

from prompt_toolkit.application.current import get_app
from prompt_toolkit.enums import DEFAULT_BUFFER
from prompt_toolkit.filters import Condition, has_focus
from prompt_toolkit.input import Input, create_input
from prompt_toolkit.key_binding import KeyBindings, KeyPressEvent
from prompt_toolkit.keys import Keys

from .output import F12_SEQUENCE

TEXT_MAX = 20_000  # characters of a block: the screen is drawn anew at every key
_PASTE_BEGIN, _PASTE_END = "\x1b[200~", "\x1b[201~"
_CTRL_C = "\x03"
# One key, or a run of characters that is too long to have been typed.
_KEY_OR_RUN = re.compile(
    "(?P<key>\x1b\\[[0-9;]*[@-~]|\x1bO?.)|([^\x00-\x1f\x7f-\x9f]{16,})", re.DOTALL
)
_CURSOR_REPORT = re.compile("\x1b\\[[0-9]+;[0-9]+R")  # the terminal's report of the cursor


class KeyActions(Protocol):
    """The actions of keys."""

    def panic(self) -> None:
        """End sound and force at once."""

    def clear(self) -> None:
        """Clear the text that is typed."""

    def leave(self) -> None:
        """Leave when all lines are done; if pressed again, at once."""

    def enter(self) -> None:
        """Enter the line."""

    def complete(self) -> None:
        """Complete the word, or take a suggestion (Tab)."""

    def report_too_long(self, length: int) -> None:
        """Report that a paste of `length` characters did not fit."""


def bindings(actions: KeyActions) -> KeyBindings:
    """The key bindings that differ from other prompts."""
    key_bindings = KeyBindings()
    is_typing = has_focus(DEFAULT_BUFFER)
    is_empty = Condition(lambda: not get_app().current_buffer.text)
    is_full = Condition(lambda: len(get_app().current_buffer.text) >= TEXT_MAX)

    def handler(action: Callable[[], None]) -> Callable[[KeyPressEvent], None]:
        return lambda event: action()

    key_bindings.add("f12", eager=True)(handler(actions.panic))
    key_bindings.add("c-c", filter=is_typing)(handler(actions.clear))
    key_bindings.add("<sigint>")(handler(actions.clear))
    key_bindings.add("c-d", filter=is_typing & is_empty)(handler(actions.leave))
    key_bindings.add("enter", filter=is_typing)(handler(actions.enter))
    key_bindings.add("tab", filter=is_typing)(handler(actions.complete))
    # In other programs these keys suspend, freeze and continue; here nothing may halt a
    # performance.
    for key in ("c-z", "c-s", "c-q"):
        key_bindings.add(key)(handler(lambda: None))
    key_bindings.add(Keys.Any, filter=is_full)(handler(lambda: None))

    @key_bindings.add(Keys.BracketedPaste)
    def _(event: KeyPressEvent) -> None:
        pasted_text = _CURSOR_REPORT.sub("", event.data)  # a report that came in two pieces
        pasted_text = pasted_text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n")
        buffer = event.current_buffer
        if len(buffer.text) + len(pasted_text) > TEXT_MAX:
            actions.report_too_long(len(pasted_text))
        else:
            buffer.insert_text(pasted_text)

    return key_bindings


def _as_paste(match: re.Match[str]) -> str:
    return match[0] if match["key"] else f"{_PASTE_BEGIN}{match[0]}{_PASTE_END}"


def keyboard(on_characters: Callable[[str], None]) -> Input:
    """The input of the terminal; `on_characters` is called with the characters before they
    become keys.
    """
    return create_input() if sys.platform == "win32" else _Keys(sys.stdin, on_characters)


if sys.platform != "win32":
    from prompt_toolkit.input.posix_utils import PosixStdinReader
    from prompt_toolkit.input.vt100 import Vt100Input

    class _Keys(Vt100Input):
        """Input of a terminal that stays in raw mode all the time."""

        def __init__(self, stdin: TextIO, on_characters: Callable[[str], None]) -> None:
            super().__init__(stdin)
            self.stdin_reader = _Reader(stdin.fileno())
            self.stdin_reader.on_characters = on_characters

        def cooked_mode(self) -> AbstractContextManager[None]:
            """Stay in raw mode, also while text is printed above the prompt.

            In cooked mode the terminal would echo what is typed meanwhile, turn Ctrl-C and
            Ctrl-Z into signals, take Ctrl-D away and drop characters beyond 4,096.
            """
            return contextlib.nullcontext()

    class _Reader(PosixStdinReader):
        """Makes sure that no paste keeps F12 from being noticed.

        If the end of a paste never comes, all further input would count as pasted; F12 and
        Ctrl-C end such a paste. If a terminal sends a paste as if it were typed, it is marked as
        a paste: a million characters, key by key, would take two minutes.
        """

        on_characters: Callable[[str], None]
        _is_pasting = False
        _reports = ""
        _tail = ""  # rest of the last read; a mark may come in two pieces

        def read(self, count: int = 1024) -> str:
            """The characters that have come since the last call."""
            characters = super().read(count)
            if not self._is_pasting and _PASTE_BEGIN not in characters:
                self.on_characters(characters)
            characters = self._with_paste_end(characters)
            recent, may_be_cut = self._tail + characters, "\x1b" in self._tail
            self._tail = recent[1 - len(_PASTE_BEGIN) :]
            last_begin, last_end = recent.rfind(_PASTE_BEGIN), recent.rfind(_PASTE_END)
            if last_begin != last_end:  # a mark is in the text
                self._is_pasting = last_begin > last_end
            if self._is_pasting or last_begin != last_end:
                return self._without_reports(characters)
            return characters if may_be_cut else _KEY_OR_RUN.sub(_as_paste, characters)

        def _with_paste_end(self, characters: str) -> str:
            """Close an open paste before a Ctrl-C that comes alone, and before F12 anywhere.

            A busy program reads pasted text and the key after it in one piece.
            """
            if self._is_pasting and characters == _CTRL_C:
                return _PASTE_END + characters
            last_mark = max(characters.rfind(_PASTE_BEGIN), characters.rfind(_PASTE_END))
            f12_index = characters.rfind(F12_SEQUENCE)
            is_open = (
                characters.startswith(_PASTE_BEGIN, last_mark)
                if last_mark >= 0
                else self._is_pasting
            )
            return (
                characters[:f12_index] + _PASTE_END + characters[f12_index:]
                if is_open and f12_index > last_mark
                else characters
            )

        def _without_reports(self, characters: str) -> str:
            """Move reports of the terminal, which may come within a paste, to its end."""
            self._reports += "".join(_CURSOR_REPORT.findall(characters))
            characters = _CURSOR_REPORT.sub("", characters)
            if self._is_pasting:
                return characters
            answers, self._reports = self._reports, ""
            return characters + answers
