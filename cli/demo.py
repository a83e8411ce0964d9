"""`ergon demo`: the first sound, from a score that ships with ergon."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import click

from . import options
from .bundled import bundled_scores
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
@options.with_console
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
    score_paths = bundled_scores()
    if list_:
        for path in score_paths.values():
            if console.json:
                console.record("score", name=path.stem, file=str(path), about=score_title(path))
            else:
                console.data(f"{path.stem:<20} {score_title(path)}\n")
        return
    path = _chosen_path(score_paths, name)
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


def _chosen_path(score_paths: dict[str, Path], score_name: str | None) -> Path:
    from ergon.notation.text.spelling import nearest

    if not score_paths:
        raise Refused("this installation has no scores; install ergon again")
    if score_name is None:
        return score_paths.get(_DEFAULT_SCORE) or next(iter(score_paths.values()))
    if score_name not in score_paths:
        nearest_name = nearest(score_name, score_paths)
        hint = f"; did you mean '{nearest_name}'?" if nearest_name else ""
        raise Refused(f"no score '{score_name}' ships with ergon{hint} (ergon demo --list)")
    return score_paths[score_name]


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
    player_names = ", ".join(_PLAYERS)
    console.warn(f"no sound: none of {player_names} works here. Listen to {path} with any player")
