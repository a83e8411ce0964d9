"""Notes and a controller of a MIDI keyboard, led to an instrument of a session."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  vib: {from: bars/vibraphone, notes: C4..C5}
mix: {route: [{from: vib, to: [1, 2], level: -20LUFS}], channels: 2}
"""
MAPS = (
    "map note C4..C5 vib",
    "map cc 7 gain vib -40dB..0dB",
    "map cc 1 vib.transpose 0st..2st",
    "map cc 74 tempo 60..180",
)


def main(folder: Path, ports: tuple[str, ...] = ()) -> None:
    """Map the keyboard, and say what it does; `ports` are parts of the names of MIDI inputs."""
    path = folder / "vib.yaml"
    path.write_text(SCORE, encoding="utf-8")
    options = ergon.SessionOptions(audio="null", midi=ports, journal=folder / "session.jsonl")
    with ergon.open_session(path, options) as session:
        for line in MAPS:
            reply = session(line)
            print(f"{line}: {reply.text}")
        print("\n".join(session.maps().lines))


if __name__ == "__main__":
    main(Path.cwd(), tuple(sys.argv[1:]))
