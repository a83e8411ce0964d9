"""Sound servers for tests: each with a name, socket and folder of its own, stopped when done."""

import contextlib
import fcntl
import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from needed import program
from patience import PATIENCE, until


@contextlib.contextmanager
def running(command: list[str], **how: object) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        **how,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)  # a JACK server that is killed keeps its name
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def jack_name(n_names: int = 4) -> Iterator[str]:
    """A name for a JACK server that nobody else uses meanwhile; waits until one is free.

    JACK's registry has eight places for all names ever used: a server that was killed keeps its
    place until one of the same name starts. So there are few names, lent to all test runs on
    this machine.
    """
    with contextlib.ExitStack() as held:
        name = ""

        def is_lent() -> bool:
            nonlocal name
            name = _lent(held, n_names)
            return bool(name)

        until(is_lent, "a name for a JACK server")
        yield name


def _lent(held: contextlib.ExitStack, n_names: int) -> str:
    """A free name, returned when `held` is closed; empty if there is none."""
    for name in (f"ergon-test-{i}" for i in range(n_names)):
        with contextlib.ExitStack() as tried:
            path = Path(tempfile.gettempdir()) / f"{name}-{os.getuid()}.lock"
            lock = tried.enter_context(path.open("w"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            if _is_there(name):
                continue  # a run that was killed has left its server
            held.push(tried.pop_all())
            return name
    return ""


def _is_there(name: str) -> bool:
    from ergon import _core

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JACK_DEFAULT_SERVER", name)
        return _core.survey_audio()[0].sentence != "no JACK server runs"


class Jack:
    """A server without a card; clients find it by `JACK_DEFAULT_SERVER`."""

    def __init__(self, name: str, rate: int = 48000, block: int = 256, channels: int = 24):
        self.name, self.rate, self.block, self.channels = name, rate, block, channels

    @contextlib.contextmanager
    def run(self) -> Iterator[subprocess.Popen[bytes]]:
        from ergon import _core

        # Real-time priority if it is granted; jackd continues without.
        server = [program("jackd"), "-R", "-P", "60", "-n", self.name]
        driver = ["-d", "dummy", "-r", self.rate, "-p", self.block, "-C", 2, "-P", self.channels]
        environment = os.environ | {"JACK_NO_AUDIO_RESERVATION": "1"}
        with running([*server, *map(str, driver)], env=environment) as process:
            until(lambda: _core.survey_audio()[0].available, "a JACK server")
            yield process


class Pulse:
    """A server with one null sink `dome`; clients find it by `PULSE_SERVER`."""

    def __init__(self, folder: Path, rate: int = 48000, channels: int = 24):
        self.folder, self.rate, self.channels = folder, rate, channels
        self.socket = folder / "pulse.sock"
        self.map = ",".join(f"aux{i}" for i in range(channels))

    @contextlib.contextmanager
    def run(self) -> Iterator[subprocess.Popen[bytes]]:
        from ergon import _core

        self.socket.unlink(missing_ok=True)
        sink = (
            f"module-null-sink sink_name=dome format=float32le rate={self.rate} "
            f"channels={self.channels} channel_map={self.map}"
        )
        door = f"module-native-protocol-unix socket={self.socket} auth-anonymous=1"
        single = {"HOME": str(self.folder), "XDG_RUNTIME_DIR": str(self.folder)}
        command = [
            program("pulseaudio"),
            *("-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no"),
            *("--resample-method=copy", "-L", sink, "-L", door),
        ]
        with running(command, env=os.environ | single) as process:
            until(lambda: _core.survey_audio()[1].available, "a PulseAudio server")
            yield process

    @contextlib.contextmanager
    def recording(self, path: Path) -> Iterator[None]:
        """What the sink hears, as raw float32 of all channels."""
        command = [
            *(program("parec"), "-d", "dome.monitor", "--format=float32le", f"--rate={self.rate}"),
            *(f"--channels={self.channels}", "--raw", f"--channel-map={self.map}"),
            *("--latency-msec=20", str(path)),
        ]
        with running(command):
            until(lambda: path.exists() and path.stat().st_size > 0, "a recording")
            yield
