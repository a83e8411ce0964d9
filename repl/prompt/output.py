"""Text for the terminal: replies, and any text without characters that control the terminal."""

from __future__ import annotations

import re

from ergon.common.terminal import clean
from ergon.repl.session_protocol import Reply

INDENT = " " * 6  # replies stand out from what was typed
F12_SEQUENCE = "\x1b[24~"  # F12 as xterm and the Linux console send it
TAB_LABEL = "[Tab]"
_ECHO_MAX = 2_000  # characters; what fills a screen is not read again
_SURROGATE_PATTERN = re.compile("[\ud800-\udfff]")  # Python reads bytes that are not UTF-8 as these


def valid_unicode(text: str) -> str:
    """Typed or piped text as valid Unicode: characters that UTF-8 cannot hold become U+FFFD."""
    return _SURROGATE_PATTERN.sub("\ufffd", text)


def echo(prompt: str, entered_text: str) -> str:
    """Entered text as it stays on the screen: every line after the first has a continuation
    mark.
    """
    n_omitted = len(entered_text) - _ECHO_MAX
    shown_text = clean(entered_text[:_ECHO_MAX]).replace("\n", "\n" + continuation(len(prompt)))
    return prompt + shown_text + (f" … {n_omitted:,} more characters" if n_omitted > 0 else "")


def continuation(width: int) -> str:
    """The mark before a continued line, as wide as the prompt."""
    return ". ".rjust(width)


def reply_lines(reply: Reply, *, plain: bool) -> list[str]:
    """The lines of a reply; plain ones are not indented and name no key."""
    texts = [reply.text if reply.taken else f"not taken: {reply.text}"] if reply.text else []
    if reply.try_ is not None:
        texts.append(f"try: {reply.try_}" + ("" if plain else f"   {TAB_LABEL}"))
    indent = "" if plain else INDENT
    shown_lines = [indent + line for text in texts for line in clean(text).split("\n")]
    return shown_lines + [clean(line) for line in reply.lines]
