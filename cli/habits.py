"""What people type who know other programs, and what to type instead."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

# Words that are typed as a command; `{rest}` is what follows the word, with a space before it.
COMMAND_INSTEAD: Mapping[str, str] = {
    "build": "ergon render{rest}",
    "config": "ergon devices",
    "convert": "ergon help export",
    "create": "ergon new{rest}",
    "delete": "ergon help files",
    "docs": "ergon help{rest}",
    "examples": "ergon demo --list",
    "edit": "ergon help editors",
    "exec": "ergon render{rest}",
    "format": "ergon fmt{rest}",
    "gui": "ergon view{rest}",
    "init": "ergon new{rest}",
    "install": "ergon help install",
    "lint": "ergon check{rest}",
    "list": "ergon demo --list",
    "listen": "ergon play{rest}",
    "live": "ergon repl{rest}",
    "ls": "ergon demo --list",
    "man": "ergon help{rest}",
    "open": "ergon view{rest}",
    "record": "ergon take record{rest}",
    "run": "ergon render{rest}",
    "serve": "ergon view{rest}",
    "show": "ergon view{rest}",
    "start": "ergon repl{rest}",
    "tempo": "ergon help tempo",
    "test": "ergon check{rest}",
    "uninstall": "pip uninstall ergon-live",
    "update": "ergon help install",
    "upgrade": "ergon help install",
    "usage": "ergon help",
    "validate": "ergon check{rest}",
    "version": "ergon --version",
    "-V": "ergon --version",
    "-version": "ergon --version",
    "-help": "ergon help",
    "/?": "ergon help",
    "/h": "ergon help",
    "?": "ergon help",
}
# Options of other programs, and what does the same here.
OPTIONS_INSTEAD: Mapping[str, str] = {
    "--bpm": "a score says it (`tempo:`), and `tempo 90` at the prompt of `ergon repl`",
    "--channels": "a score says them: `mix: {channels: 2}`",
    "--device": "--audio names the sound card (`ergon help sound`), --live a key (`ergon devices`)",
    "--duration": "--until TIME ends it there",
    "--end": "--until TIME ends it there",
    "--format": "the ending of -o says it: -o piece.flac",
    "--length": "--until TIME ends it there",
    "--png": "--svg FILE writes the picture",
    "--midi": "`ergon export SCORE -o FOLDER` writes tempo.mid, with the notes",
    "--mono": "a score says it: `mix: {channels: 1}`",
    "--out": "-o FILE names the output",
    "--port": "--at 127.0.0.1:8080 names the host and the port",
    "--sample-rate": "--rate 48kHz sets it",
    "--samplerate": "--rate 48kHz sets it",
    "--start": "--from TIME begins it there",
    "--stereo": "a score says it: `mix: {channels: 2}`",
    "--tempo": "a score says it (`tempo:`), and `tempo 90` at the prompt of `ergon repl`",
    "--volume": "--gain -6dB sets it; `ergon render` takes it from the score (`loudness:`)",
}
# What to do with a file that is typed alone, or behind `convert`, by its ending.
FILES_INSTEAD: Mapping[str, str] = {
    ".aif": "ergon info {file}",
    ".aiff": "ergon info {file}",
    ".flac": "ergon info {file}",
    ".m4a": "ffmpeg -i {file} {stem}.wav",
    ".mid": "ergon info {file}",
    ".motion": "ergon view {file}",
    ".mp3": "ffmpeg -i {file} {stem}.wav",
    ".ogg": "ffmpeg -i {file} {stem}.wav",
    ".take": "ergon info {file}",
    ".wav": "ergon info {file}",
}
# Words behind a group of commands that lists what there is where none is named.
LISTING = ("list", "ls", "show")
# Options that most commands have, and `ergon` itself has not.
BEHIND = ("-v", "--verbose", "-q", "--quiet", "--json", "-f", "--force")
_SINGLE_DASH = re.compile(r"-[a-z][a-z-]+")


def option_instead(option_name: str, known_options: Iterable[str]) -> str | None:
    """What does here what an option of other programs does there; None for others, and where the
    command has no such option.
    """
    advice = OPTIONS_INSTEAD.get(option_name)
    advised_option = advice.split()[0] if advice is not None else ""
    return (
        advice
        if not advised_option.startswith("-") or advised_option in set(known_options)
        else None
    )


def instead(command_words: list[str]) -> str | None:
    """The line that does what `command_words` most likely mean; None for others."""
    file_word = next(
        iter(command_words[1:2] if command_words[0] == "convert" else command_words[:1]), ""
    )
    if advice := FILES_INSTEAD.get(Path(file_word).suffix.lower()):
        return advice.format(file=file_word, stem=Path(file_word).stem)
    line = COMMAND_INSTEAD.get(command_words[0])
    further_words = "".join(f" {word}" for word in command_words[1:])
    return None if line is None else line.format(rest=further_words)


def reordered(command_words: list[str], commands: Iterable[str]) -> str | None:
    """The line with its command first, where options or a score precede it; else None."""
    command_names = set(commands)
    command_index = next((i for i, word in enumerate(command_words) if word in command_names), None)
    if not command_index:
        return None
    return " ".join(
        [
            "ergon",
            command_words[command_index],
            *command_words[command_index + 1 :],
            *command_words[:command_index],
        ]
    )


def long_option_meant(command_words: Iterable[str], known_options: Iterable[str]) -> str | None:
    """The long option that a word with one dash was meant for (`-output`); None if there is none.

    Such a word would be read as short options in a row, and the next one as a score.
    """
    option_names = set(known_options)
    for dashed_word in command_words:
        if dashed_word == "--":
            break
        name = dashed_word.partition("=")[0]
        if _SINGLE_DASH.fullmatch(name) and f"-{name}" in option_names:
            return f"-{name}"
    return None
