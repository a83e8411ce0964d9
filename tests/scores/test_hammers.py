"""Hammers of the library: soft strokes arrive, repeated ones as the first; none strikes twice."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from sweep import few

from docs.generators.cards import BESIDE, play
from ergon.notation.tables.notes import read_note
from ergon.notation.tables.quantities import IMPULSE, quantity
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

LIBRARY = Path(__file__).parents[2] / "instruments" / "library"
FAMILIES = ("bells", "bars", "strings", "skins", "plates", "found")
HAMMERS: dict[str, tuple[str, dict[str, Any]]] = {
    name: (family, instrument)
    for family in FAMILIES
    # All workers read these as they collect the tests: by libyaml.
    for name, instrument in yaml.load((LIBRARY / f"{family}.yaml").read_text(), yaml.CSafeLoader)[
        "instruments"
    ].items()
    if instrument["play"].get("strike", {}).get("at") == "hammer"
}
# One whose body hardly moves, a skin, a string with a rail, a heavy plate with one.
SOME = ("church", "marimba", "snare", "kick", "piano", "thunder")
# These swing so far at fff that they meet the hammer where it rests.
SWING = ("cable", "thunder", "bloom", "cymbal", "spring", "timpani")


def reach(name: str) -> tuple[float, float]:
    """The impulses of the softest and the hardest stroke [N·s]."""
    soft, hard = HAMMERS[name][1]["play"]["strike"]["impulse"].split("..")
    return quantity(soft, IMPULSE), quantity(hard, IMPULSE)


def peak(name: str, impulse: float) -> float:
    """Of one stroke [dB]."""
    text = f"ergon: 1\ninstruments: {{x: {{from: {HAMMERS[name][0]}/{name}}}}}\n"
    text += f"strikes: {{s: {{to: x.hammer, at: 0s, impulse: {impulse!r}Ns}}}}\n"
    sounds, _ = play(text + "render: {tail: 0.5s}\n", 0.5)
    return float(20 * np.log10(np.max(np.abs(sounds)) + 1e-15))


def contact_force(name: str, impulse: float, times: int, seconds: float) -> NDArray[np.float64]:
    """The force of the hammer on all that it strikes, frame by frame, of strokes 125 ms apart."""
    family, instrument = HAMMERS[name]
    contacts = [
        link
        for link, kinds in instrument["modules"].items()
        if kinds.get("BUT", {}).get("between", [""])[0] == "hammer"
    ]
    outs = ", ".join(f"{link}: {{SOF: {{BUT: {link}}}}}" for link in contacts)
    text = (
        "ergon: 1\ntempo: {bpm: 60}\n"
        f"instruments: {{x: {{from: {family}/{name}, out: {{{outs}}}}}}}\n"
        f"strikes: {{s: {{to: x.hammer, at: 0, every: 1/8, times: {times}, "
        f"impulse: {impulse!r}Ns}}}}\n"
        f"render: {{tail: {seconds}s}}\n"
    )
    loaded = load(BESIDE, text=text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    frames = np.zeros((round(seconds * staged.rate), staged.simulation.n_out))
    staged.simulation.process(frames)
    return np.abs(frames).sum(axis=1)


@pytest.mark.parametrize("name", few(list(HAMMERS), SOME))
def test_hammer_stroke_softer_than_ppp_arrives(name):
    soft, _ = reach(name)
    # 6 dB, and a colour that follows; the jingles of a tambourine catch some of it.
    assert 5.0 <= peak(name, soft) - peak(name, soft / 2) <= 16.0


@pytest.mark.parametrize("name", few([n for n in HAMMERS if n not in SWING], SOME[:-1]))
def test_hammer_hardest_stroke_touches_once(name):
    force = contact_force(name, reach(name)[1], 1, 1.5)
    touching = np.flatnonzero(force > 1e-6 * force.max())
    assert touching[-1] < 0.06 * 44100


@pytest.mark.parametrize("name", few(list(HAMMERS), SOME))
def test_hammer_repeated_strokes_equal_the_first(name):
    soft, hard = reach(name)
    force = contact_force(name, soft * (hard / soft) ** (4 / 7), 4, 0.5)
    strokes = force[: 4 * 5512].reshape(4, 5512)  # 125 ms each
    arrivals = [np.flatnonzero(stroke > 1e-3 * force.max())[0] / 44.1 for stroke in strokes]
    momenta = strokes.sum(axis=1)
    assert np.ptp(arrivals) < 3.0  # ms
    assert momenta == pytest.approx(np.full(4, momenta[0]), rel=0.3)


@pytest.mark.parametrize("note", ["D2", "D3", "C4"])
def test_reed_pitch_equals_its_note(note):
    text = f"ergon: 1\ninstruments: {{x: {{from: friction/reed, f: {note}}}}}\n"
    (sound,), rate = play(text + "strikes: {s: {to: x, at: 0s}}\nrender: {tail: 0.9s}\n", 0.9)
    steady = sound[int(0.3 * rate) :]
    n = len(steady)
    magnitude = np.abs(np.fft.rfft(steady * np.hanning(n), 16 * n))
    asked = 440.0 * 2.0 ** ((read_note(note) - 69) / 12)
    near = np.arange(int(0.95 * asked * 16 * n / rate), int(1.05 * asked * 16 * n / rate))
    sounding = near[np.argmax(magnitude[near])] * rate / (16 * n)
    assert abs(1200 * np.log2(sounding / asked)) < 5.0
