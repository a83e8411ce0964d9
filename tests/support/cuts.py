"""Sessions whose piece is hushed, stopped or reset at a frame: by their texts, and by a cut."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from random_scores import Score
from random_sessions import SCORE, Player
from sessions import Stepped

from ergon import _core
from ergon.repl.session import version_edits
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.running import RunningVersion
from ergon.repl.session.schedule import Schedule
from ergon.repl.session.version import Version
from ergon.repl.session.waiting_lines import VersionEdit, WaitingLine, reparse, version_after_line
from ergon.scores.staging.cutting import cut_stage
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import Stage

Act = Literal["hush", "stop", "panic"]
ACTS: tuple[Act, ...] = ("hush", "stop", "panic")
_UNUSED = 10**6  # the number of a line that no session has


@dataclass(frozen=True)
class Sounds:
    """What plays after one frame: `by_text` and `by_cut` (n_frames, n_out), before the mixer.

    `stepped_on` are the simulations then, in the same order.
    """

    frame: int
    by_text: NDArray[np.float64]
    by_cut: NDArray[np.float64]
    texted: RunningVersion
    cut: RunningVersion
    stepped_on: tuple[_core.Simulation, _core.Simulation]

    @property
    def error(self) -> float:
        """The largest difference, as a share of the peak of its output."""
        peak = np.abs(self.by_text).max(axis=0)
        difference = np.abs(self.by_text - self.by_cut).max(axis=0)
        return float(np.max(difference / np.where(peak > 0.0, peak, 1.0), initial=0.0))


def after_act(stepped: Stepped, act: Act, seconds: float = 1.0) -> Sounds:
    """The sound of a session after an act at the next frame; the session itself goes on."""
    schedule = stepped.session.schedule
    running, frame = schedule.running, schedule.soonest_frame()
    assert stepped.engine.frame >= running.start_frame
    texted = _by_text(schedule, running, act, frame)
    cut = cut_of(running, texted, act, frame)
    old = stepped.engine._simulation.fork()
    process(old, frame - stepped.engine.frame)
    return _sounds(frame, (old, old), texted, cut, int(seconds * stepped.rate))


def after_line(stepped: Stepped, sounds: Sounds, line: WaitingLine, seconds: float) -> Sounds:
    """The sound after another line, which takes over from the texts' version and from the cut."""
    schedule = stepped.session.schedule
    texted, cut = (_staged(schedule, on, line) for on in (sounds.texted, sounds.cut))
    n_frames = int(seconds * stepped.rate)
    return _sounds(line.start_frame, sounds.stepped_on, texted, cut, n_frames)


def line_at(stepped: Stepped, sounds: Sounds, text: str) -> WaitingLine:
    """A line that takes effect where the sounds of an act end, on the beat of that frame."""
    every = stepped.engine.tick_frames
    start = sounds.stepped_on[0].frame
    assert start % every == 0
    running = sounds.texted
    beat, edit = running.beat(start), _edit(running.version, text)
    goes = True if text == "play" else None
    return WaitingLine(_UNUSED, text, edit, LineKind.STRUCTURE, beat, start, goes)


def _edit(version: Version, text: str) -> VersionEdit:
    if text == "play":
        return _same
    return version_edits.combine_edits(reparse(text, version))


def _same(version: Version, beat: float) -> Version:
    return version


def cut_of(running: RunningVersion, texted: RunningVersion, act: Act, frame: int) -> RunningVersion:
    """The version of the texts, played by a cut of the stage before."""
    stage = cut_stage(running.stage, frame, ends_gestures=act != "stop", is_stopped=act != "hush")
    return replace(texted, stage=stage)


def _by_text(schedule: Schedule, running: RunningVersion, act: Act, frame: int) -> RunningVersion:
    edit = _same if act == "stop" else version_edits.end_all_playing
    goes = None if act == "hush" else False
    beat = running.beat(frame)
    line = WaitingLine(_UNUSED, act, edit, LineKind.STOPS, beat, frame, goes)
    return _staged(schedule, running, line)


def _staged(schedule: Schedule, on: RunningVersion, line: WaitingLine) -> RunningVersion:
    version = version_after_line(on.version, line)
    return schedule.version_maker.staged(
        on, [replace(line, version_before=on.version, version=version)]
    )


def process(simulation: _core.Simulation, n_frames: int) -> NDArray[np.float64]:
    """The next frames (n_frames, n_out)."""
    out = np.zeros((n_frames, simulation.n_out))
    simulation.process(out)
    return out


def _sounds(
    frame: int,
    old: tuple[_core.Simulation, _core.Simulation],
    texted: RunningVersion,
    cut: RunningVersion,
    n_frames: int,
) -> Sounds:
    n_frames = n_frames // 64 * 64
    outputs, stepped_on = [], []
    for before, running in zip(old, (texted, cut), strict=True):
        new = running.stage.simulation.fork()
        new.take_over(before.fork())
        outputs.append(_by_name(running.stage, process(new, n_frames), texted.stage))
        stepped_on.append(new)
    return Sounds(frame, outputs[0], outputs[1], texted, cut, (stepped_on[0], stepped_on[1]))


def _by_name(stage: Stage, out: NDArray[np.float64], like: Stage) -> NDArray[np.float64]:
    """Outputs in the order of another stage."""
    names, wanted = stage.listening.outputs, like.listening.outputs
    return out if names == wanted else out[:, [names.index(name) for name in wanted]]


# --- random sessions ------------------------------------------------------------------------------


def begun(seed: int, folder: Path) -> tuple[Stepped, list[str]]:
    """A random session in which something plays, and the lines that were taken."""
    dice, stepped = random.Random(seed), None
    while stepped is None:
        try:
            stepped, lines = (_scored if dice.random() < 0.4 else _typed)(dice, seed, folder)
        except StageError:  # a network that would diverge
            seed += 10**6
    taken = []
    for line in ("play", "quant now", *lines):
        if stepped.type(line).taken:
            taken.append(line)
        stepped.run(dice.uniform(0.03, 0.5))
    if not stepped.session.schedule.running.clock.is_running and dice.random() < 0.8:
        stepped.ok("play")
        stepped.run(dice.uniform(0.1, 1.0))
    while stepped.session.schedule.changes.pending:
        stepped.run(0.1)
    return stepped, taken


def _typed(dice: random.Random, seed: int, folder: Path) -> tuple[Stepped, list[str]]:
    """A session on a small score, with lines of any verb."""
    player, lines = Player(seed), []
    # A coupling, and gestures that begin behind their beat, stop otherwise by the texts.
    without = ("py ", "load ", "save", "keep", "record", "scene", "reload", "couple", "do from")
    while len(lines) < dice.randint(3, 14):
        line = player.line()
        lines += [] if any(word in line for word in without) else [line]
    return Stepped(SCORE, folder, journal=False, keeps=False), lines


def _scored(dice: random.Random, seed: int, folder: Path) -> tuple[Stepped, list[str]]:
    """A session on a random score of modules of all kinds."""
    score = Score(seed, with_space=dice.random() < 0.3, with_proxies=dice.random() < 0.3)
    text = score.text.replace(
        "seed: 7\n", "seed: 7\nrates: {audio: 16kHz}\ntempo: [{at: 1|1, bpm: 140}]\n"
    )
    text = text.replace(
        "keys: {k: {M: 300g, K: 60N/m, Z: 1Ns/m}}",
        "keys: {k: {M: 300g, K: 60N/m, Z: 1Ns/m}, k2: {M: 200g, K: 60N/m, Z: 1Ns/m}}",
    )
    text = text.replace("{ada: {key: k}}", "{ada: {key: k}, leo: {key: k2}}")
    names = [module.partition(":")[0] for module in score.modules]
    struck = [f"thing.{name}" for name in score.moving]
    lines = []
    for _ in range(dice.randint(2, 9)):
        module = dice.choice(names)
        every = dice.choice(("1", "1/2", "1/3", "2"))
        bpm = f"{dice.uniform(70, 250):.4g}"
        low, high = sorted(dice.uniform(0.5, 2.0) for _ in range(2))
        shape = dice.choice(("", " shape sine", " shape square", " shape ramp"))
        lines.append(
            dice.choice(
                (
                    f"ada plays go every {every} now",
                    f"leo plays (go go) ~ every {every} now",
                    f"ada plays go euclid 3 8 every {every} now",
                    f"rain strikes {dice.choice(struck)} euclid 5 8 impulse 0.1mNs..0.3mNs now",
                    f"hail strikes {dice.choice(struck)} every {every} impulse 0.2mNs now",
                    f"tempo {bpm} now",
                    f"tempo {bpm} -> 90 over 2 now",
                    f"set thing.{module}.K x{high:.3g} over 1 now",
                    f"set thing.{module}.K x{low:.3g} now",
                    f"set thing.{module}.f x{high:.3g} over 2 now",
                    f"lfo thing.{module}.K {low:.3g}..{high:.3g} period 1bar{shape} now",
                    f"lfo thing.{module}.f {low:.3g}..{high:.3g} period 3{shape} now",
                    f"set thing.{module}.t60 x1 x0.4 x{high:.3g} every 1/2 now",
                )
            )
        )
    return Stepped(text, folder, journal=False, keeps=False), lines
