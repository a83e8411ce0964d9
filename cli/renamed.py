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


def respelt(command: str, command_words: Sequence[str]) -> list[str]:
    """The words behind a command with the present spellings; a warning names each that changed."""
    spellings = RENAMED.get(command, {})
    respelt_words: list[str] = []
    for place, command_word in enumerate(command_words):
        if command_word == "--":
            return [*respelt_words, *command_words[place:]]
        option_name, equals, option_value = command_word.partition("=")
        present = spellings.get(option_name)
        if present is not None:
            _console(command_words).warn(
                f"{option_name} of `ergon {command}` is written {present} now; "
                f"version {UNTIL_VERSION} takes {present} alone"
            )
            command_word = f"{present}{equals}{option_value}"
        respelt_words.append(command_word)
    return respelt_words


def _console(words: Sequence[str]) -> Console:
    return Console(json="--json" in words, quiet=bool({"-q", "--quiet"} & set(words)))
