"""An example or two of each command, as a person types them; `--help` and messages show them.

Names without an ending, such as `duet`, are scores that ship.
"""

from __future__ import annotations

from collections.abc import Mapping

Example = tuple[str, str]  # the line, and what it does

EXAMPLES: Mapping[str, tuple[Example, ...]] = {
    "new": (
        ("ergon new bells", "a folder with a score that plays"),
        ("ergon new --template duet two", "one for two players"),
    ),
    "check": (
        ("ergon check piece.yaml", "every mistake with its place"),
        ("ergon check --simulate piece.yaml", "also what shows only when it plays"),
        ("ergon check --strict piece.yaml", "fail by a warning too, for scripts"),
    ),
    "compile": (("ergon compile piece.yaml -o ergons.csv", "what the keys are struck with"),),
    "render": (
        ("ergon render piece.yaml -o piece.wav", "the sound"),
        ("ergon render duet --channels 2 --until 10s", "ten seconds of a score that ships"),
        ("ergon render piece.yaml --rate 48kHz --bits float", "another format"),
    ),
    "sweep": (("ergon sweep piece.yaml --vary seed=1..4 -o variants", "four variants"),),
    "play": (
        ("ergon play piece.yaml", "through the loudspeakers"),
        ("ergon play duet --to binaural --view", "for headphones, with its picture"),
    ),
    "duet": (("ergon duet fader --live remi=emul:", "an emulated key for the player remi"),),
    "repl": (
        ("ergon repl", "begin with nothing"),
        ("ergon repl piece.yaml", "a score that lines change"),
    ),
    "plan": (("ergon plan duet", "how each part is computed"),),
    "modes": (("ergon modes one-gesture bell", "pitches of the part bell"),),
    "tune": (("ergon tune piece.yaml bell A4 -o tuned.yaml", "bring bell to A4"),),
    "admittance": (("ergon admittance piece.yaml bell.m --svg bell.svg", "at the mass m"),),
    "stats": (
        ("ergon stats duet", "what it is made of"),
        ("ergon stats hands.take", "what hands did"),
    ),
    "bell": (("ergon bell stroke.wav -o bell.yaml", "an instrument from a recording"),),
    "plot": (
        ("ergon plot piece.yaml knock", "a gesture in the terminal"),
        ("ergon plot piece.wav --svg piece.svg", "a sound as a picture"),
    ),
    "chart": (("ergon chart piece.yaml -o errors", "error against cost"),),
    "stability": (("ergon stability piece.yaml -o map", "where methods fail"),),
    "devices": (("ergon devices", "loudspeakers, keys and ports"),),
    "devices calibrate": (("ergon devices calibrate firefader:/dev/ttyACM0#1", ""),),
    "doctor": (
        ("ergon doctor", "the machine and its sound"),
        ("ergon doctor --no-audio --device emul:", "how soon a device replies"),
        ("ergon doctor --hands page:", "how positions of a pointer arrive"),
    ),
    "emulate": (("ergon emulate frame --udp 9001", "a device for trying scores"),),
    "metrology measure": (("ergon metrology measure tgr0", "by pushing the key tgr0"),),
    "metrology fit": (("ergon metrology fit push-1.take push-2.take", ""),),
    "metrology replay": (("ergon metrology replay tgr0.json tgr0", ""),),
    "metrology compare": (("ergon metrology compare before.json after.json", ""),),
    "metrology log": (("ergon metrology log tgr0.json", ""),),
    "metrology weigh": (("ergon metrology weigh empty.json loaded.json --mass 50g", ""),),
    "import": (("ergon import model.mdl -o model.yaml", "a model of mi-gen"),),
    "export": (
        ("ergon export piece.yaml -o daw", "sound, stems, tempo and marks for a workstation"),
        ("ergon export piece.yaml bell --to faust -o faust", "a part as a program"),
    ),
    "take list": (("ergon take list takes", "recordings in a folder"),),
    "take info": (("ergon take info hand.take", ""),),
    "take record": (("ergon take record --live emul: -o hand.take --seconds 10", ""),),
    "take trim": (("ergon take trim hand.take 2s 8s -o middle.take", ""),),
    "take import": (("ergon take import motion.csv --rate 1kHz -o hand.take", ""),),
    "take export": (("ergon take export hand.take -o hand.csv", ""),),
    "motion export": (("ergon motion export piece.motion -o piece.gltf", ""),),
    "fold": (("ergon fold dome.wav --to binaural -o headphones.wav", "for two ears"),),
    "view": (
        ("ergon view duet", "a score that ships, in a browser"),
        ("ergon view piece.motion --movie piece.webm", "a film"),
    ),
    "share": (("ergon share piece.yaml -o piece.html", "one file to send to somebody"),),
    "pack": (
        ("ergon pack piece.yaml", "one file, piece.ergonpack, to send to somebody"),
        ("ergon render piece.ergonpack", "its sound, anywhere"),
    ),
    "unpack": (("ergon unpack piece.ergonpack", "its files, in the folder piece"),),
    "layout check": (("ergon layout check dome24", "how well it places sound"),),
    "layout export": (("ergon layout export dome24 --form iem -o dome.json", ""),),
    "layout import": (("ergon layout import dome.json -o dome.yaml", ""),),
    "layout noise": (("ergon layout noise stereo -o noise.wav", "one loudspeaker at a time"),),
    "info": (("ergon info piece.wav", "which score, which samples"),),
    "schema": (("ergon schema -o score.schema.json", "for completion in editors"),),
    "lsp": (("ergon lsp", "an editor starts it"),),
    "fmt": (("ergon fmt --diff piece.yaml", "what would change"),),
    "demo": (
        ("ergon demo", "the first sound"),
        ("ergon demo --list", "scores that ship"),
    ),
    "completion": (("ergon completion bash", "eval its output in ~/.bashrc"),),
    "help": (
        ("ergon help render", "a command"),
        ("ergon help rhythm", "a page of the manual"),
    ),
    "explain": (("ergon explain E204", ""),),
}


def section(name: str) -> str | None:
    """The lines of `--help` with the examples of a command; None if it has none."""
    example_rows = EXAMPLES.get(name)
    if example_rows is None:
        return None
    width = max(len(line) for line, _ in example_rows)
    lines = (f"  {line:{width}}  {meaning}".rstrip() for line, meaning in example_rows)
    return "\n".join(["\b", "Examples:", *lines])
