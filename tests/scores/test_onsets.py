"""Strokes begin without a click: what is above 16 kHz in the first 2 ms."""

from typing import Any

import numpy as np
import pytest

from docs.generators.cards import click, play

# A bell heard as a speed, where it is struck.
BELL = "ergon: 1\ninstruments: {b: {CEL: {M: 2g, f: 500Hz, t60: 1s}, out: {SOV: b}}}\n"


def bell_struck(strikes: str) -> float:
    sounds, rate = play(f"{BELL}strikes: {{s: {{{strikes}}}}}\nrender: {{tail: 0.3s}}\n", 0.3)
    return click(sounds[0], rate)


@pytest.mark.parametrize(
    "strikes",
    [
        "to: b, at: 50ms, impulse: 1mNs",
        "to: b, at: 50.01ms, impulse: 1mNs",
        "to: b, at: 0.1, for: 2, rate: 50Hz, impulse: 1mNs",
        "entries: [{at: 0.1, what: b, impulse: 1mNs}]",
        "at: 0.1, rhythm: b, times: 1, impulse: 1mNs",
        "to: b, at: 50ms, impulse: 1mNs, lasts: 1ms",
    ],
)
def test_stroke_onset_of_each_kind_without_click(strikes: str):
    assert bell_struck(strikes) < -60.0


def test_stroke_lasting_zero_seconds_clicks():
    assert bell_struck("to: b, at: 50ms, impulse: 1mNs, lasts: 0s") > -30.0


def test_stroke_duration_of_instrument_act():
    bell = BELL.replace("out:", "play: {hit: {impulse: 0.1mNs..2mNs, lasts: 0s}}, out:")

    def sound(text: str, more: str = "") -> Any:
        strikes = f"strikes: {{s: {{to: b, at: 50ms, impulse: 1mNs{more}}}}}\n"
        return play(f"{text}{strikes}render: {{tail: 0.3s}}\n", 0.3)[0]

    assert np.array_equal(sound(bell), sound(BELL, ", lasts: 0s"))
    assert np.array_equal(sound(bell, ", lasts: 0.19ms"), sound(BELL))


def test_stroke_under_ca_is_one_step():
    cell = "units: ca, at: 44100Hz, CEL: {M: 2, K: 0.01, Z: 0.0001}"
    bell = f"ergon: 1\ninstruments: {{b: {{{cell}, out: {{SOX: b}}}}}}\n"
    strikes = "strikes: {s: {to: b, at: 0s, impulse: 1mNs}}\nrender: {tail: 0.1s}\n"
    sounds, _ = play(bell + strikes, 0.1)
    # x[1] = T F/M with F = p/T: the whole impulse acts in the first step.
    assert sounds[0, 1] != 0.0
    assert sounds[0, 2] / sounds[0, 1] == pytest.approx(2.0 - 0.01 / 2 - 0.0001 / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("family", "name"),
    [("bell", "bell"), ("gong", "plate"), ("gong", "sheet"), ("bank", "sky"), ("bank", "scale")],
)
def test_stroke_onset_of_instruments_without_cards(family: str, name: str):
    text = f"ergon: 1\nuse: [instruments/{family}.yaml]\nrender: {{tail: 0.2s}}\n"
    strikes = f"strikes: {{s: {{to: {name}, at: 50ms, impulse: fff}}}}\n"
    sounds, rate = play(f"{text}{strikes}mix: {{route: [{{from: {name}, to: 1}}]}}\n", 0.2)
    assert click(sounds[0], rate) < -60.0
