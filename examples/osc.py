"""Lines of a session sent as OSC by another program, which is told what is played."""

import socket
import sys
import time
from pathlib import Path

from pythonosc.udp_client import SimpleUDPClient

import ergon

SCORE = """\
ergon: 1
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: A4, t60: 1s}}}, out: {SOX: m}}
mix: {route: [{from: bell, to: 1}]}
"""


def free_port() -> int:
    """A port of this machine that no program has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main(folder: Path) -> Path:
    """Let OSC type a line; where the score that it made is."""
    path, port = folder / "bell.yaml", free_port()
    path.write_text(SCORE, encoding="utf-8")
    options = ergon.SessionOptions(audio="null", osc=str(port), journal=folder / "session.jsonl")
    client = SimpleUDPClient("127.0.0.1", port)
    with ergon.open_session(path, options) as session:
        session.play()
        client.send_message("/ergon/cmd", "rain strikes bell.m every 1 impulse 2mNs")
        for _ in range(1_000):  # the line is taken within a few milliseconds
            if any("rain" in line for line in session.voices().lines):
                break
            time.sleep(0.01)
        client.send_message("/ergon/gain", -6.0)
        session.save(str(folder / "rain"))
    return folder / "rain.yaml"


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
