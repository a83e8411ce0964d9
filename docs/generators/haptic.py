"""Draws the forces of docs/howto/haptic.md, and writes the stiffness that devices bear.

`python -m docs.generators.haptic`
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from docs.generators.pages import blocks
from ergon.api.play import PlayOptions, begin, prepare
from ergon.common.module_arguments import module_arguments
from ergon.common.report import Report
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage
from ergon.view.curve import Curve
from ergon.view.svg import plot

PAGE = Path(__file__).parents[1] / "howto" / "haptic.md"
REACH = 0.01  # [m] to either side
SLOW, FAST = 0.5, 4.0  # strokes a second
_SETTLED = 1  # strokes before the one that is drawn
_HEAD = "| device | stiffness |"
_PLAYER = "ada"
# A spring stiffer than all devices bear, and softer than what is refused.
_SPRING = """\
ergon: 1
keys: {k: {M: 50g, K: 0N/m, Z: 1Ns/m, travel: -20mm..20mm}}
players: {ada: {hand: live, key: k}}
instruments:
  it:
    modules: {post: {SOL: {}}, spring: {RES: {between: [post, k], K: STIFFNESS N/m}}}
    out: {SOX: k}
render: {tail: 60s}
"""
# Emulated devices: what they are called, and how `ergon emulate` begins them.
_DEVICES = {
    "an emulated key in this process (`emul:`)": (),
    "a board by the open frame, 1 kHz (`frame:`)": ("frame", "--udp", "0"),
    "an Inverse3 (`haply:`)": ("haply", "--ws", "0"),
    "a FireFader (`firefader:`)": ("firefader", "--pty"),
    "the finger of a pointer (`page:`, `keys:`, `midi:`, `osc:`, `gamepad:`)": None,
}

Floats = NDArray[np.float64]


def effects() -> dict[str, str]:
    """The scores of the page by their names."""
    yaml_blocks = [block for block in blocks(PAGE) if block.language == "yaml"]
    return {Path(block.note("file") or "").stem: block.text for block in yaml_blocks}


def force(text: str, strokes: float) -> tuple[Floats, Floats]:
    """Positions [m] and forces on the hand [N] of one stroke there and back, `strokes` a second."""
    loaded = load("effect.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece, planned=True, real_hands={_PLAYER: None})
    (hand,) = staged.live_hands
    tick = hand.tick_frames / staged.rate
    out = np.zeros((hand.tick_frames, staged.simulation.n_out))
    n_ticks = round((_SETTLED + 1) / strokes / tick)
    positions = REACH * np.sin(2.0 * np.pi * strokes * tick * np.arange(n_ticks))
    forces = []
    for x in positions:
        staged.simulation.hold(hand.index, x)
        staged.simulation.process(out)
        forces.append(staged.simulation.hand_force(hand.index))
    first = round(_SETTLED / strokes / tick)
    return positions[first:], np.array(forces[first:])


def picture(name: str, text: str) -> str:
    """Force against position, slowly and fast, as SVG."""
    curves = []
    for words, strokes in (("0.5 strokes a second", SLOW), ("4 strokes a second", FAST)):
        x, newtons = force(text, strokes)
        step = max(1, len(x) // 500)
        curves.append(Curve(words, tuple(1e3 * x[::step]), tuple(newtons[::step])))
    labels = {"t_label": "position [mm]", "x_label": "force [N]"}
    return plot(curves, title=name, width=560, height=300, **labels)


@contextmanager
def emulated(options: tuple[str, ...] | None) -> Iterator[str]:
    """The address of a device."""
    if not options:
        yield "emul:" if options == () else "osc:/x?port=9071"
        return
    command = [sys.executable, "-m", "ergon", "emulate", *options, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield str(json.loads(process.stdout.readline())["url"])
        finally:
            process.kill()


def borne(options: tuple[str, ...] | None) -> float:
    """The greatest stiffness [N/m] at which a device and a spring are stable without scaling."""
    with tempfile.TemporaryDirectory() as folder, emulated(options) as url:
        score = Path(folder) / "spring.yaml"
        stiffness = 20.0
        while True:
            score.write_text(_SPRING.replace("STIFFNESS ", f"{stiffness:g}"))
            asked = PlayOptions(live=[f"{_PLAYER}={url}"], audio="null", gain="0dB", unchecked=True)
            ready = prepare(score, asked, Report())
            performance = begin(ready.stage, ready.config, Report())
            (limit,) = performance.hand_limits()
            performance.panic()
            performance.stop()
            performance.close(1.0)
            ready.close()
            if limit.scale < 1.0:
                return limit.limit
            stiffness *= 2.0


def table() -> str:
    """The stiffness that devices bear, in Markdown."""
    rows = [f"| {name} | {borne(options):.0f} N/m |" for name, options in _DEVICES.items()]
    return "\n".join([_HEAD, "|---|---|", *rows]) + "\n"


def main() -> None:
    """Write the pictures and the table."""
    module_arguments()
    for name, text in effects().items():
        (PAGE.parent / f"haptic-{name}.svg").write_text(picture(name, text))
    before, _, rest = PAGE.read_text().partition(_HEAD)
    PAGE.write_text(before + table() + rest[rest.index("\n\n") + 1 :])


if __name__ == "__main__":
    main()
