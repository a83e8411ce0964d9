"""Options that were spelt otherwise in an earlier version, and are still taken, with a warning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .console import Console

UNTIL_VERSION = "0.3"
# By command: the earlier spelling, and the present one. In all commands --from and --until are
# positions in time, --to is whom a file or the sound is for, --upto a frequency.
RENAMED: Mapping[str, Mapping[str, str]] = {
    "render": {"--to": "--until"},
    "view": {"--to": "--until"},
    "share": {"--to": "--until"},
    "modes": {"--to": "--upto"},
    "stats": {"--to": "--upto"},
    "fold": {"--from": "--layout"},
    "import": {"--input": "--feed"},
}


def respelt(command: str, words: Sequence[str]) -> list[str]:
    """The words behind a command with the present spellings; a warning names each that changed."""
    spellings = RENAMED.get(command, {})
    result: list[str] = []
    for place, word in enumerate(words):
        if word == "--":
            return [*result, *words[place:]]
        option, equals, value = word.partition("=")
        present = spellings.get(option)
        if present is not None:
            _console(words).warn(
                f"{option} of `ergon {command}` is written {present} now; "
                f"version {UNTIL_VERSION} takes {present} alone"
            )
            word = f"{present}{equals}{value}"
        result.append(word)
    return result


def _console(words: Sequence[str]) -> Console:
    return Console(json="--json" in words, quiet=bool({"-q", "--quiet"} & set(words)))
