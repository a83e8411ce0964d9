"""`ergon demo`: the first sound, from a score that ships with ergon."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import click

from . import options
from .bundled import bundled
from .console import Console
from .outcome import Refused

_DEFAULT_SCORE = "one-gesture"  # the score that plays if none is named
_PLAYERS = ("pw-play", "paplay", "aplay")  # PipeWire, PulseAudio, bare ALSA: the nearest first


@click.command()
@click.argument("name", required=False)
@click.option("--list", "list_", is_flag=True, help="List the scores that ship with ergon.")
@options.target("The WAV file to write. Default: NAME.wav here.")
@click.option("--no-audio", is_flag=True, help="Write the WAV file, play nothing.")
@options.force
@options.speaking
def demo(
    console: Console,
    name: str | None,
    list_: bool,
    output: str | None,
    no_audio: bool,
    force: bool,
) -> None:
    """Render a score that ships with ergon, and play it.

    The sound is written as a WAV file and played by pw-play, paplay or aplay, where one of them
    works. `ergon demo --list` lists the scores.
    """
    scores = bundled()
    if list_:
        for path in scores.values():
            if console.json:
                console.record("score", name=path.stem, file=str(path), about=score_title(path))
            else:
                console.data(f"{path.stem:<20} {score_title(path)}\n")
        return
    path = _chosen(scores, name)
    from ergon.api.options import FileOptions

    from .render import render_file

    output_path = output or f"{path.stem}.wav"
    console.say(f"score: {path}")
    render_file(console, str(path), output_path, FileOptions(force=force))
    if not no_audio and output_path != "-":
        _play(console, output_path)


def score_title(path: Path) -> str:
    """The title of a score, found in its text without parsing."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("title:"):
            return line.removeprefix("title:").split(" #")[0].strip().strip("'\"")
    return ""


def _chosen(scores: dict[str, Path], score_name: str | None) -> Path:
    from ergon.notation.text.spelling import nearest

    if not scores:
        raise Refused("this installation has no scores; install ergon again")
    if score_name is None:
        return scores.get(_DEFAULT_SCORE) or next(iter(scores.values()))
    if score_name not in scores:
        close = nearest(score_name, scores)
        hint = f"; did you mean '{close}'?" if close else ""
        raise Refused(f"no score '{score_name}' ships with ergon{hint} (ergon demo --list)")
    return scores[score_name]


def _play(console: Console, path: str) -> None:
    """Play with the first player that works; a machine without sound is not an error."""
    for player in _PLAYERS:
        program = shutil.which(player)
        if program is None:
            continue
        console.say(f"playing with {player}; Ctrl-C stops")
        player_process = subprocess.run([program, path], check=False, capture_output=True)
        if player_process.returncode == 0:
            return
        console.detail(f"{player}: {player_process.stderr.decode(errors='replace').strip()}")
    tried = ", ".join(_PLAYERS)
    console.warn(f"no sound: none of {tried} works here. Listen to {path} with any player")
