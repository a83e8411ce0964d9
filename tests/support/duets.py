"""`ergon duet` as a process, and its sound, recorded and rendered."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile
from commands import ERGON
from patience import PATIENCE

from ergon import _core

STAND_IN = 8  # of a row's flags


@dataclass
class Duet:
    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)

    def until(self, words: str) -> str:
        """The next line that contains these words."""
        assert self.process.stdout is not None
        while line := self.process.stdout.readline():
            self.lines.append(line.rstrip())
            if words in line:
                return self.lines[-1]
        raise AssertionError(f"'{words}' was not said, but: {self.lines}")

    def end(self) -> int:
        """Read the remaining lines; returns the exit code."""
        assert self.process.stdout is not None
        self.lines += self.process.stdout.read().splitlines()
        return self.process.wait(timeout=PATIENCE)


@contextmanager
def duet(*arguments: object) -> Iterator[Duet]:
    """A running performance; its lines are read one by one. No axis is tried first."""
    command = [*ERGON, "duet", *map(str, arguments), "--plain", "--unchecked"]
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, **both, text=True) as process:
        try:
            yield Duet(process)
        finally:
            process.kill()


def played(*arguments: object) -> list[str]:
    """Run a performance to its end; returns its lines."""
    with duet(*arguments) as playing:
        assert playing.end() == 0, playing.lines
        return playing.lines


def command_output(*arguments: object) -> tuple[int, str]:
    """Run a command that ends by itself; returns its exit code and its output."""
    done = subprocess.run([*ERGON, *map(str, arguments)], capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def rendered(score: Path, take: Path, doubted: bool = False) -> np.ndarray:
    """The recorded motion of the hands, rendered offline: (n_frames, n_channels) of float32."""
    target = take.with_suffix(".offline.wav")
    code, output = command_output("render", score, "--hands", take, "--bits", "float", "-o", target)
    assert code == 0, output
    assert ("warning" in output) == doubted, output
    return sound(target)


def sound(path: Path) -> np.ndarray:
    frames, _ = soundfile.read(path, dtype="float32", always_2d=True)
    return frames


def recorded(path: Path) -> _core.Recording:
    """A complete and finished recording."""
    result = _core.read_recording(path)
    assert result.finished, result.damage
    assert result.dropped == 0
    return result
