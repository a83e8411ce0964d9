"""The input of a random session: lines, MIDI and edits of its files, drawn from a seed."""

from __future__ import annotations

import random
from pathlib import Path

from tests.repl.test_repl_session import SCORE

OTHER = SCORE.replace("60N/m", "80N/m").replace("A3", "C4").replace("bpm: 120", "bpm: 100")
TABLE = SCORE.replace("  ada: []\n", "  ada: |\n    2|1 knock every 1 until 4|1\n    5|1 lean\n")
MONO = SCORE.replace("channels: 2", "channels: 1").replace("to: [2]", "to: [1]")
VERSE = OTHER.replace("  ada: []", "  ada: [{at: 1|1, play: knock, every: 1, times: 7}]")
SCENES = {"other": OTHER, "table": TABLE, "mono": MONO, "verse": VERSE}
PLAYERS, GESTURES = ("ada", "leo"), ("knock", "knock", "lean", "lean", "far")
NOTES = ("A3", "C4", "E4", "~", "(A3 G3)", "D4", "A3.minor")


class Player:
    """Draws the lines typed in a session, and the edits of its files."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)

    def choose(self, *of: str) -> str:
        return self.draw.choice(of)

    def number(self, low: float, high: float) -> str:
        return f"{self.draw.uniform(low, high):.4g}"

    def when(self) -> str:
        at = f"at {self.draw.randint(1, 60)}|{self.draw.randint(1, 4)}"
        return self.choose("", "", "", " now", " now", f" in {self.draw.randint(1, 5)}", f" {at}")

    def line(self) -> str:
        """A line of any verb; some are refused."""
        player, gesture = self.choose(*PLAYERS), self.choose(*GESTURES)
        part = self.choose("bell", "drum", "ada", "leo", "nobody")
        how = self.choose(
            "",
            "",
            " every 1",
            " every 1/2 times 5",
            " every 2",
            " layer",
            f" until {self.number(2, 9)}|1",
        )
        do = self.choose("", "", " do mirror", " do scale 0.5, jitter 4ms 0.2mm", " do from 1/4")
        point = f"{self.number(-9, 12)}@{self.choose('1/8', '60ms', '1/4')}"
        curve = self.choose("smooth", "smooth", "smooth", "linear", "throw", "hold")
        pattern, rhythm = self.pattern(), self.rhythm()
        timed = (
            *4 * [f"{player} plays {pattern}{rhythm}{do}"],
            f"{player} plays {pattern}{rhythm} every {self.choose('2nd', '3rd', '4th')} do mirror",
            *2 * [f"{self.choose('rain', 'hail')} strikes {self.struck()}{rhythm}{self.impulse()}"],
            f"{self.choose('bell', 'drum')} notes {self.notes()}{rhythm}{self.impulse()}",
            f"set {self.choose('bell', 'drum')}.m.f {self.notes()}{rhythm}",
            f"set {self.choose('bell.m.t60', 'drum.m.t60')} x1 x0.4 x{self.number(0.2, 2)}{rhythm}",
            f"lfo {self.swung()} period {self.choose('1', '3', '1bar', '2bar')}"
            + self.choose("", " shape sine", " shape triangle", " shape ramp", " shape square"),
            f"lfo {self.choose('bell.m.K', 'bell.m.f', 'drum.m.K')} off",
            f"rest {self.choose('rain', 'hail', 'bell', 'drum')}",
            f"map note {self.choose('60', '48..72')} {self.struck()}"
            f" 0.1mNs..{self.number(0.2, 2)}mNs",
            f"map cc 21 {self.choose('bell.m.K 1kN/m..9kN/m', 'drum.m.t60 0.1s..2s')}",
            f"map cc {self.choose('7 gain bell', '21 gain', '7 gain drum')} -30dB..0dB",
            f"unmap {self.choose('cc 7', 'cc 21', 'note 60', 'note 48..72')}",
            f"{player} plays {gesture}{how}{do}",
            f"{player} plays {gesture}{how}{do}",
            f"{player} do {self.choose('scale 0.7', 'mirror', 'shift 1/8', 'stretch 1.5')}",
            f"rest {self.choose('ada', 'leo', 'all')}",
            f"{gesture} = 0@0 {curve} {point} smooth 0@1/2",
            f"tempo {self.number(60, 300)}",
            f"tempo {self.number(60, 300)} -> 90 over {self.choose('1bar', '2', '3s')}",
            f"nudge {self.choose('-10ms', '20ms', '1s')}",
            f"set {self.choose('bell.m.t60', 'drum.m.t60')} {self.number(0.1, 3)}s",
            f"set bell.b.K x{self.number(0.5, 2)} over {self.choose('1bar', '1s')}",
            f"set k1.M {self.number(200, 600)}g",
            f"set drum.m.f {self.number(50, 200)}Hz",
            f"couple k1 k2 K={self.number(1, 60)}N/m Z=0.2Ns/m",
            "uncouple k1 k2",
            f"b2 = {self.choose('bell', 'drum')} transpose {self.draw.randint(-5, 9)}st"
            "\nroute b2 2",
            f"link {self.choose('k1', 'k2', 'bell.m')} {self.choose('b2.m', 'drum.m')} "
            + self.choose("BUT K=300N/m gap=1mm", "REF K=20N/m Z=0.1Ns/m", "RES K=2kN/m"),
            f"remove {self.choose('b2', 'links.but-1', 'links.ref-1', 'links', 'far', 'mia')}",
            f"{self.choose('mia', 'leo')} takes {self.choose('k1', 'k2', 'k3')}",
            f"rename {self.choose('knock far2', 'far2 knock', 'leo leo2', 'leo2 leo')}",
            f"rename {self.choose('bell chime', 'chime bell', 'k1 pedal', 'pedal k1', 'b2 bell')}",
            f"route {self.choose('bell', 'drum')} {self.choose('1', '2', '1 2', '3')}",
            f"fade {self.choose('master', 'bell', 'drum')} {self.choose('in', 'out')} over "
            + self.choose("1bar", "1", "2bar"),
            f"set {self.choose('bell', 'chime', 'b2', 'drum')}.f "
            + self.choose("A4 over 1bar", "x1.5", "x0.7 over 2", "C4 E4 every 1", "B3"),
            f"lfo {self.choose('bell', 'b2')}.f 0.9..1.1 period 1bar",
            f"phrase tune 0 bell.m {self.number(0.1, 1)}mNs, 1/2 drum.m, 2 bell.m drum.m"
            + self.choose("", " length 3", " length 1bar"),
            f"hook strikes tune{self.choose('', ' every 1bar', ' every 2 times 5')}"
            + self.choose("", " do stretch 0.5", " do scale 0.5, from 1/2", " do reverse"),
            "rest hook",
            f"gain {part} {self.number(-20, 3)}dB",
            f"mute {part}",
            f"solo {part}",
            "unmute",
            f"seed {self.draw.randint(0, 99)}",
            "undo",
            "undo",
            "redo",
            f"back {self.draw.randint(1, 5)}",
            "hush",
            f"damp {self.number(0.2, 3)}s",
            "reload",
            f"load {self.choose('other', 'table', 'mono', 'nothing', 'score')}.yaml",
            "stop",
        )
        others = (
            f"play from {self.draw.randint(1, 400)}|{self.draw.randint(1, 4)}",
            "play",
            "play",
            f"quant {self.choose('bar', '2bar', 'beat', 'now')}",
            "panic",
            "release",
            "save",
            f"save {self.choose('one', 'two', 'score')}",
            f"scene {self.choose('kept', 'more', 'verse', 'verse', 'table')}",
            f"scene {self.choose('kept', 'verse')} -> {self.choose('table', 'verse')} over 1bar",
            f"keep {self.draw.randint(1, 8)}bar as {self.choose('kept', 'more')}",
            "history",
            "tap",
            "maps",
            self.choose(
                "?", "? bell", "? far", "show rain", "show bell.m", "scope ada on", "scope off"
            ),
            self.choose("record audio heard.wav", "record audio off", "record ada as solo"),
            self.choose(
                "show", "show ada", "? knock", "scope ada", "meters", "help", "py piece.seed"
            ),
            self.choose(
                "py 1/0", "ada plyas lean", "= =", "guide ada leo K=3N/m", "load /dev/zero"
            ),
            f"set bell.m.t60 2s now\n{player} plays {gesture} every 1",
        )
        if self.draw.random() < 0.8:
            return self.choose(*timed) + self.when()
        return self.choose(*others)

    def pattern(self) -> str:
        """The steps of a player's pattern."""
        names = [
            self.choose(*GESTURES, "knock", "lean", "~") for _ in range(self.draw.randint(1, 4))
        ]
        if self.draw.random() < 0.3:
            names.append(f"({self.choose('knock', 'lean')} {self.choose('lean', '~', 'knock')})")
        if self.draw.random() < 0.2:
            names = [f"({' '.join(names)})*2"]
        return self.choose("", "", "choose ", "walk ", "shuffle ") + " ".join(names)

    def notes(self) -> str:
        names = [self.choose(*NOTES) for _ in range(self.draw.randint(2, 4))]
        return self.choose("", "", "choose ", "walk ", "shuffle ") + " ".join(names)

    def rhythm(self) -> str:
        """When a pattern's steps fall."""
        pulses = self.draw.randint(1, 8)
        euclid = f" euclid {pulses} {self.draw.randint(pulses, 8)}"
        when = self.choose(
            " every 1", " every 1/2", " every 1/3 times 4", euclid, euclid + " rotate 2"
        )
        chance = self.choose("", "", f" chance {self.number(0, 1)}", " chance 60%")
        return when + chance + self.choose("", "", "", " swing 0.6", " swing 2/3", " skip 3")

    def struck(self) -> str:
        return self.choose("bell.m", "drum.m", "bell", "b2.m", "bell.m drum.m")

    def impulse(self) -> str:
        return self.choose(" impulse 0.1mNs..1mNs", f" impulse {self.number(0.05, 2)}mNs")

    def swung(self) -> str:
        return self.choose("bell.m.K 0.8..1.2", "bell.m.f 200Hz..240Hz", "drum.m.K 0.5..2")

    def packet(self) -> bytes:
        """A MIDI message: a note, or the movement of a controller."""
        if self.draw.random() < 0.6:
            note = self.draw.choice((60, 60, 50, 72, 90))
            return bytes([0x90, note, self.draw.randint(0, 127)])
        return bytes([0xB0, self.draw.choice((7, 21, 99)), self.draw.randint(0, 127)])

    def edit(self, folder: Path) -> None:
        """Edit the score's file as an editor does; the result may be wrong."""
        path = folder / "score.yaml"
        text = path.read_text()
        old, new = self.draw.choice(
            [
                ("t60: 0.3s", f"t60: {self.number(0.1, 1)}s"),
                ("smooth 3mm@1", f"smooth {self.number(1, 6)}mm@1"),
                ("smooth 6mm@1/8", f"smooth {self.number(1, 6)}mm@1/8"),
                ("seed: 7", f"seed: {self.draw.randint(0, 99)}"),
                ("  lean:", "  tilt:"),
                ("bpm: 120", f"bpm: {self.draw.randint(60, 200)}"),
                ("ada: []", "ada: [{at: 3|1, play: knock, every: 1, times: 3}]"),
                ("gestures:\n", "gestures:\n  new: 0mm@0 smooth 2mm@1/4 smooth 0mm@1/2\n"),
                ("\n", "\n# remark\n"),
                ("{SOX: m}", "{SOX: q}"),
            ]
        )
        path.write_text(text.replace(old, new, 1))
