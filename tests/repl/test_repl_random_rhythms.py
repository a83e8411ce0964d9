"""Sessions of random lines with rhythms, strengths and families: each is its journal's render."""

from __future__ import annotations

import random
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped
from sweep import few

SCORE = """\
ergon: 1
seed: 4
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 180}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  kick: {CEL: {M: 5g, f: 90Hz, t60: 0.2s}, play: {strike: {impulse: 1mNs..16mNs}}, out: {SOX: kick}}
  hat:
    modules:
      top: {CEL: {M: 1g, f: 900Hz, t60: 50ms}}
      rim: {CEL: {M: 1g, f: 700Hz, t60: 0.1s}}
    play:
      strike: {at: top, impulse: 1mNs..4mNs}
      click: {at: [rim, top], impulse: 0.1mNs..1mNs}
      rub:
        at: bow
        impulse: 0.1mNs..2mNs
        turns: true
        with: {bow: {MAS: {M: 10g}}, hair: {FRO: {between: [bow, top], Z: 20mNs/m}}}
    out: {SOX: [top, rim]}
  bar:
    f: A4
    modules: {m: {CEL: {M: 1g, f: A4, t60: 0.5s}}}
    notes: C4..C5
    play:
      strike:
        at: m
        impulse: 1mNs..4mNs
        release: {at: damper, impulse: 20mNs}
        with:
          damper: {MAS: {M: 10g, X0: 5mm}}
          stand: {SOL: {}}
          guide: {FRO: {between: [stand, damper], Z: 4Ns/m}}
          pad:
            LNL:
              between: [stand, m]
              damping: z*v
              follows: {z: {of: damper, from: 0Ns/m, to: 0.02Ns/m, span: 5mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}
players: {ada: {key: k1}}
mix: {channels: 3, route: [{from: kick, to: [1]}, {from: hat, to: [2]}, {from: bar, to: [3]}]}
"""
WORDS = ("kick", "hat", "hat:p", "kick:2mNs", "hat.click", "hat.rub", "~", "[kick hat]", "kick?")
NOTES = ("c4", "e4", "<g4 a4>", "~", "[c4,e4]", "b4*2", "c5?0.3", "[d4|f4]")
SIGNS = ("", "", "*2", "!2", "@2", "(3,8)", "/2")
CHANGES = (
    *("rev", "every 2 rev", "ply 2", "degrade 0.4", "fast 2", "slow 2", "late 1/8", "swing 4"),
    *("off 1/8 rev", "palindrome", "sometimes ply 2", "iter 4", "scale 0.5", "none"),
)


class Typist:
    """Draws the lines of a session."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)

    def any_of(self, *choices: str) -> str:
        return self.draw.choice(choices)

    def rhythm(self, words: tuple[str, ...]) -> str:
        count = self.draw.randint(1, 5)
        return " ".join(self.any_of(*words) + self.any_of(*SIGNS) for _ in range(count))

    def line(self) -> str:
        voice = self.any_of("d1", "d2", "d3")
        level = self.any_of("", " f", " p mf", " ppp..f", " 1mNs")
        cycle = self.any_of("", "", " cycle 3/2", " cycle 2bar", " times 3", " for 2bar")
        do = self.any_of("", "", " do rev", " do every 3 ply 2", " do degrade")
        text = self.any_of(
            *3 * [f'{voice} = "{self.rhythm(WORDS)}"{level}{cycle}{do}'],
            *2 * [f'bar = "{self.rhythm(NOTES)}"{level}{cycle}{do}'],
            f"{voice} strikes {self.any_of('kick', 'hat', 'hat.click')}{level} every 1/2",
            f"bar notes C4 (E4 G4) ~{level} every {self.any_of('1', '1/2')}",
            *2 * [f"{voice} do {self.any_of(*CHANGES)}"],
            f"bar do {self.any_of(*CHANGES)}",
            f"mute {voice}",
            f"unmute {self.any_of(voice, '')}",
            f"solo {voice}",
            f"gain {voice} {self.any_of('-6dB', 'x0.5', '3dB')}",
            f"rest {self.any_of(voice, 'all')}",
            f"remove {voice}",
            "use plucked",
            f"{voice} strikes guitar p every 2",
            f"rename {self.any_of('hat hut', 'hut hat', 'kick bd', 'bd kick')}",
            f"map note {self.any_of('C4..C5 bar', 'C2 kick', 'D2 hat.click')}",
            f"tempo {self.draw.randint(90, 300)}",
            f"meter {self.any_of('3/4', '4/4', '5/8')}",
            "ada plays knock every 1",
            *("undo", "undo", "redo", "back 2", "hush", "reload", "save", "keep 2bar as kept"),
            *("scene kept", "stop", "play", "play from 2|1", "seed 9"),
        )
        return text + self.any_of("", "", " now", " in 1")


def check_session(seed: int, folder: Path) -> None:
    """One session; what it played is what its journal renders, and what its score plays reads."""
    typist = Typist(seed)
    with closing(Stepped(SCORE, folder)) as session:
        session.ok("play")
        for _ in range(25):
            session.type(typist.line())
            session.run(typist.draw.uniform(0.05, 0.6))
        session.close()
        assert np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize("seed", few(range(300), 2))
def test_journals_of_random_rhythm_sessions(seed: int, tmp_path: Path):
    check_session(seed, tmp_path)
