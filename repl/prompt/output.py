"""What is printed: replies, and text from anywhere with nothing in it that steers a terminal."""

from __future__ import annotations

import re

from ergon.common.terminal import clean
from ergon.repl.session_protocol import Reply

INDENT = " " * 6  # replies stand out from what was typed
F12 = "\x1b[24~"  # as xterm, the Linux console and those after them send it
TAB = "[Tab]"
_ECHO_MAX = 2_000  # characters; what fills a screen is not read again
_SURROGATE = re.compile("[\ud800-\udfff]")  # Python reads bytes that are not UTF-8 as these


def typed(text: str) -> str:
    """What was typed or piped as valid Unicode: what no UTF-8 stands for becomes U+FFFD."""
    return _SURROGATE.sub("\ufffd", text)


def echo(prompt: str, text: str) -> str:
    """What was typed, as it stays on the screen: a block begins each line below its first."""
    left_out = len(text) - _ECHO_MAX
    shown = clean(text[:_ECHO_MAX]).replace("\n", "\n" + continuation(len(prompt)))
    return prompt + shown + (f" … {left_out:,} more characters" if left_out > 0 else "")


def continuation(width: int) -> str:
    """What stands before a further line, as wide as the prompt."""
    return ". ".rjust(width)


def lines_of(reply: Reply, *, plain: bool) -> list[str]:
    """The lines of a reply; plain ones are not indented and name no key."""
    shown = [reply.text if reply.taken else f"not taken: {reply.text}"] if reply.text else []
    if reply.try_ is not None:
        shown.append(f"try: {reply.try_}" + ("" if plain else f"   {TAB}"))
    indent = "" if plain else INDENT
    told = [indent + line for text in shown for line in clean(text).split("\n")]
    return told + [clean(line) for line in reply.lines]
