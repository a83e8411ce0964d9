"""Lines of a session and their replies: the example session, and every other form."""

import dataclasses
from pathlib import Path

import pytest

from ergon.notation.clock.meter import Meter
from ergon.notation.clock.positions import Length, Position, parse_position
from ergon.notation.tables.strengths import MEZZO_FORTE, Level
from ergon.repl.language import commands as c
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import Scope, scope_of
from ergon.repl.language.triggers import parse_condition, parse_every
from ergon.scores.gesture import notation
from ergon.scores.gesture.transforms import parse_chain
from ergon.scores.reading.load import load
from ergon.scores.reading.playing import NO_OPTIONS, PlayingOptions

ROOT = Path(__file__).parents[2]
ONE = Length(beats=1.0)


def _scope() -> Scope:
    piece = load(ROOT / "tests/data/duet-2.2.yaml").piece
    assert piece is not None
    known = scope_of(piece)
    added = {
        "takes": {**known.takes, "solo": "take"},
        "blocks": {"fill": "block, 1 line"},
        "rooms": {"hall": "room"},
        "phrases": {"tune": "phrase"},
        "strikes": {**known.strikes, "rain": "strikes"},
        "acts": {**known.acts, "gong": ("strike",)},
    }
    return dataclasses.replace(known, **added)


SCOPE = _scope()


def one(line: str) -> c.Command:
    (command,) = parse(line, SCOPE)
    return command


def refused(text: str) -> Refusal:
    with pytest.raises(Refusal) as caught:
        parse(text, SCOPE)
    return caught.value


def chain(text: str, start: int = 0):
    return tuple(
        dataclasses.replace(transform, offset=transform.offset + start)
        for transform in parse_chain(text)
    )


def plays(what: str, **more) -> c.Plays:
    nothing = dict.fromkeys(("every", "times", "until"))
    return c.Plays("ada", what, **{**nothing, "do": (), "manner": NO_OPTIONS, **more})


# The example session of the design, and every form that it does not use.
KNOCK = "0@0 smooth 7@1/8 smooth 0@1/4"
SESSION = [
    ("play", c.Play(None)),
    ("ada plays knock every 1                  # at the next bar", plays("knock", every=ONE)),
    (f"knock = {KNOCK}     # while sounding", c.Define("knock", notation.parse(KNOCK))),
    ("? lean                                   # draws it", c.Look("lean")),
    ("ada plays lean now                       # overrides quant", plays("lean", when=c.NOW)),
    ("ada do mirror, scale 1.2", c.Do("ada", chain("mirror, scale 1.2"))),
    ("set bell.m.K x1.5 over 2bar   # glides", c.Set("bell.m.K", None, 1.5, Length(bars=2))),
    ("tempo 60 -> 84 over 4bar", c.Tempo(60, 84, Length(bars=4))),
    ("couple k1 k2 K=40N/m", c.Couple("k1", "k2", 40.0, 0.0)),
    ("record remi as solo-2", c.Record("remi", "solo-2")),
    ("record off", c.RecordOff()),
    (
        "ada plays solo from 4 stretch 2",
        plays("solo", do=(*chain("from 4", 5), *chain("stretch 2", 12))),
    ),
    ("undo                                     # at the next bar", c.Undo()),
    ("keep 8bar as verse-2", c.Keep(Length(bars=8), "verse-2")),
    ("hush", c.Hush()),
    ("damp 3s", c.Damp(3.0)),
    ("save scores/duet-live.yaml               # comments kept", c.Save("scores/duet-live.yaml")),
    ("quit", c.Quit()),
]
OTHERS = [
    (
        "map cc 21 bell.m.K 1kN/m..9kN/m",
        c.MapControl("cc 21", "bell.m.K", (1000.0, 9000.0), "N/m"),
    ),
    ("map cc 7 gain bell -40dB..0dB", c.MapControl("cc 7", None, (-40.0, 0.0), "dB", "bell")),
    ("map cc 7 gain -40dB..6dB", c.MapControl("cc 7", None, (-40.0, 6.0), "dB")),
    ("map note C3..Bb4 sky.all 1mNs..20mNs", c.MapNotes(48, 70, "sky.all", (0.001, 0.02))),
    ("map note 127 bell.m 1mNs now", c.MapNotes(127, 127, "bell.m", (0.001, 0.001), when=c.NOW)),
    ("unmap cc 21", c.Unmap("cc 21")),
    ("unmap note C3..C4", c.Unmap("note 48..60")),
    ("maps", c.Maps()),
    ("record audio evening.wav", c.RecordAudio("evening.wav")),
    ("record audio off", c.RecordAudio(None)),
    ("play from B+2", c.Play(parse_position("B+2"))),
    ("stop at C", c.Stop(when=parse_position("C"))),
    ("set bell.m.K 900N/m in 2", c.Set("bell.m.K", 900.0, None, None, when=Length(beats=2))),
    ("set bell.tuning edo 19 over 1bar", c.Retune("bell.tuning", {"edo": "19"}, Length(bars=1))),
    ("set tuning off", c.Retune("tuning", {}, None)),
    ("set k1.M 350g", c.Set("k1.M", 0.35, None, None)),
    ("set gong.f A1", c.Set("gong.f", 55.0, None, None)),
    ("tempo 72", c.Tempo(72)),
    ("meter 3/4", c.SetMeter(Meter(3, 4, (3,)))),
    ("tap", c.Tap()),
    ("nudge -10ms", c.Nudge(Length(seconds=-0.01))),
    ("quant now", c.Quant(c.NOW)),
    ("quant 2bar", c.Quant(Length(bars=2))),
    ("uncouple k1 k2 at 9|1", c.Uncouple("k1", "k2", when=parse_position("9|1"))),
    ("couple k1 k2 Z=0.2Ns/m K=1kN/m", c.Couple("k1", "k2", 1000.0, 0.2)),
    ("guide remi ada K=30N/m", c.Guide("remi", "ada", 30.0)),
    ("guide remi off", c.Guide("remi", None)),
    ("gain ada x0.5", c.Gain("ada", 0.5)),
    ("gain 0dB", c.Gain(None, 1.0)),
    ("mute bell", c.Mute("bell")),
    ("solo gong now", c.Solo("gong", when=c.NOW)),
    ("unmute", c.Unmute(None)),
    ("unmute bell", c.Unmute("bell")),
    ("gain rain -20dB", c.GainStrikes("rain", 0.1)),
    ("mute rain now", c.MuteStrikes("rain", when=c.NOW)),
    ("solo rain", c.SoloStrikes("rain")),
    ("unmute rain", c.UnmuteStrikes("rain")),
    ("meters", c.Meters()),
    ("rest ada", c.Rest("ada")),
    ("rest all", c.Rest(None)),
    (
        "bell notes A3 C4 (E4 A4) euclid 5 8 chance 0.8",
        c.StrikeModules(
            "bell",
            {
                "to": "bell",
                "notes": "A3 C4 (E4 A4)",
                "euclid": "5 8",
                "chance": "0.8",
                "impulse": "1mNs",
            },
        ),
    ),
    (
        "set bell.m.f A3 (C4 E4) every 1 at B",
        c.Automate("bell.m.f", "set", {"to": "A3 (C4 E4)", "every": "1"}, when=parse_position("B")),
    ),
    (
        "lfo bell.m.K 0.8..1.2 period 4bar shape triangle",
        c.Automate("bell.m.K", "lfo", {"range": "0.8..1.2", "period": "4bar", "shape": "triangle"}),
    ),
    ("lfo bell.m.K off", c.StopLfo("bell.m.K")),
    (
        "rain strikes bell.m gong every 1/2 impulse 2mNs euclid 3 8 rotate 2 at B",
        c.StrikeModules(
            "rain",
            {"to": "bell.m gong", "every": "1/2", "impulse": "2mNs", "euclid": "3 8 rotate 2"},
            when=parse_position("B"),
        ),
    ),
    ("hear gong", c.Hear("gong", (), MEZZO_FORTE)),
    ("hear gong.strike C4 eb4 v127", c.Hear("gong.strike", ("C4", "Eb4"), Level(1.0, 1.0, True))),
    ("hear bell.m 2mNs", c.Hear("bell.m", (), Level(0.002, 0.002))),
    (
        "map cc 1/33 bell.m.K 1kN/m..9kN/m",
        c.MapControl("cc 1/33", "bell.m.K", (1000.0, 9000.0), "N/m"),
    ),
    ("map bend tempo 60..180", c.MapControl("bend", None, (60.0, 180.0), "bpm")),
    ("map pressure gain ada 0dB", c.MapControl("pressure", None, (0.0, 0.0), "dB", "ada")),
    (
        "map pressure C4 gain 0dB now",
        c.MapControl("pressure 60", None, (0.0, 0.0), "dB", when=c.NOW),
    ),
    ("unmap pressure C4", c.Unmap("pressure 60")),
    (
        "map learn bell.m.M 1g..2g",
        c.Learn(c.MapControl("learn", "bell.m.M", (0.001, 0.002), "kg")),
    ),
    ("map learn note fill", c.Learn(c.MapNotes(0, 0, "fill", None))),
    ("unmap learn", c.Learn(None)),
    ("monitor on", c.Monitor(True)),
    ("monitor off", c.Monitor(False)),
    (
        "map note 60 bell.m 1mNs curve root",
        c.MapNotes(60, 60, "bell.m", (0.001, 0.001), None, "root"),
    ),
    ("map note D2 ada knock", c.MapNotes(38, 38, "ada", None, "knock")),
    ("map note D2 fill", c.MapNotes(38, 38, "fill", None)),
    ("map cc 1 tempo 60..180 now", c.MapControl("cc 1", None, (60.0, 180.0), "bpm", when=c.NOW)),
    ("map note C4 gong.strike", c.MapNotes(60, 60, "gong.strike", None)),
    ("rain do off 1/8 transpose 7st", c.DoStrikes("rain", "off 1/8 transpose 7st")),
    ("rain do none now", c.DoStrikes("rain", "none", when=c.NOW)),
    (
        'd1 = "bell.m*2 ~ <bell.m gong>" 2mNs cycle 2 do rev at B',
        c.StrikeModules(
            "d1",
            {
                "rhythm": "bell.m*2 ~ <bell.m gong>",
                "impulse": "2mNs",
                "cycle": "2",
                "do": "rev",
            },
            when=parse_position("B"),
        ),
    ),
    (
        "hook strikes tune every 2bar transpose -3st do scale 0.5, from 2",
        c.StrikeModules(
            "hook",
            {"play": "tune", "every": "2bar", "transpose": "-3st", "do": "scale 0.5, from 2"},
        ),
    ),
    (
        "phrase air 0 C4 1mNs, 1/2 E4 bell.m to bell length 4",
        c.DefinePhrase(
            "air",
            (
                {"at": "0", "impulse": "1mNs", "what": "C4"},
                {"at": "1/2", "what": "E4 bell.m"},
            ),
            "bell",
        ),
    ),
    ("def tilt: ada plays lean", c.DefineBlock("tilt", ("ada plays lean",))),
    ("fill", c.RunBlock("fill")),
    ("fill 16 n=3 now", c.RunBlock("fill", ("16", "n=3"), when=c.NOW)),
    ("stop sync rain", c.Stop(when=c.Sync("rain"))),
    (
        "def tilt n=2: ada plays lean times $n",
        c.DefineBlock("tilt", ("$n = 2", "ada plays lean times $n")),
    ),
    ("run fill at B", c.RunBlock("fill", when=parse_position("B"))),
    ("fill every 4bar", c.RunByRule("fill", parse_every("4bar"))),
    (
        "when bar % 4 == 3 fill now",
        c.RunByRule("fill", parse_condition("bar % 4 == 3"), when=c.NOW),
    ),
    ("stop fill", c.StopBlock("fill")),
    ("panic now", c.Panic()),
    ("release", c.Release()),
    ("redo", c.Redo()),
    ("history", c.History()),
    ("back 3", c.Back(3)),
    ("save", c.Save(None)),
    ('load "my pieces/duet.yaml" at C', c.Load("my pieces/duet.yaml", when=parse_position("C"))),
    ("scene verse-2", c.Scene("verse-2")),
    ("scene verse-2 over 2bar now", c.Scene("verse-2", None, Length(bars=2), when=c.NOW)),
    ("sce a -> b over 4bar", c.Scene("b", "a", Length(bars=4))),
    ("bell2=bell/bell", c.Build("bell2", "bell/bell", 0.0, {})),
    (
        "gong2 = gong/plate f=C2 transpose -5.5st at C",
        c.Build("gong2", "gong/plate", -5.5, {"f": "C2"}, when=parse_position("C")),
    ),
    (
        "link k1 bell.m BUT K=4kN/m gap=1mm now",
        c.Link("k1", "bell.m", "BUT", {"K": "4kN/m", "gap": "1mm"}, when=c.NOW),
    ),
    ("use skins", c.Use("skins", "instruments/skins.yaml")),
    ("use my/drums.yaml at C", c.Use("drums", "my/drums.yaml", when=parse_position("C"))),
    ("mia takes k3", c.Takes("mia", "k3")),
    ("mia takes k3 like k1 in 2", c.Takes("mia", "k3", "k1", when=Length(beats=2))),
    ("route bell 3 4 gain -6dB", c.Route("bell", ("3", "4"), pytest.approx(0.501187, rel=1e-4))),
    ("route gong nearest", c.Route("gong", ("nearest",))),
    ("route bell 1 2 pan -0.3", c.Route("bell", ("1", "2"), pan=-0.3)),
    ("route bell pan 0.5", c.Route("bell", None, pan=0.5)),
    ("route bell gain x0.5", c.Route("bell", None, 0.5)),
    ("route bell send hall -12dB", c.Route("bell", None, send=("hall", "-12dB"))),
    ("room hall t60=2s size=12m", c.Room("hall", {"t60": "2s", "size": "12m"})),
    ("pan bell 0.8 over 4bar", c.MovePan("bell", 0.8, Length(bars=4.0))),
    ("filter bell lowpass 2kHz", c.Filter("bell", "lowpass", {"": "2kHz"})),
    (
        "filter bell lowshelf 200Hz -3dB",
        c.Filter("bell", "lowshelf", {"f": "200Hz", "gain": "-3dB"}),
    ),
    ("filter bell delay off", c.Filter("bell", "delay", {})),
    ("fade bell out over 8bar", c.Fade("bell", False, Length(bars=8.0))),
    ("fade master in over 2bar", c.Fade(None, True, Length(bars=2.0))),
    ("remove bell.b", c.Remove("bell.b")),
    ("rename lean tilt", c.Rename("lean", "tilt")),
    ("reload", c.Reload()),
    ("seed 18446744073709551615", c.Seed(2**64 - 1)),
    ("show", c.Show(None)),
    ("voices", c.Show(None)),
    ("instruments", c.ListInstruments(None)),
    ("instruments skins", c.ListInstruments("skins")),
    ("gestures", c.ListGestures()),
    ("scenes", c.ListScenes()),
    ("show ada", c.Show("ada")),
    ("scope k1", c.Trace("k1")),
    ("scope ada on", c.TraceOn("ada")),
    ("sc off", c.TraceOn()),
    ("help", c.Help(None)),
    ("help te", c.Help("tempo")),
    ("help record", c.Help("record")),
    ("py [x for x in 'a # b']", c.Py("[x for x in 'a # b']")),
    ("knock=0@0 7@1/8", c.Define("knock", notation.parse("0@0 7@1/8"))),
    ("new = 0@0 7@1/8 at B", c.Define("new", notation.parse("0@0 7@1/8"), when=Position("B"))),
    ("?lean", c.Look("lean")),
    ("? bell.m.K", c.Look("bell.m.K")),
    ("ada p knock", plays("knock")),
    (
        "ada plays knock at 3|1 every 1/2 times 8 until C layer touch tracked grain 5ms",
        plays(
            "knock",
            every=Length(beats=0.5),
            times=8,
            until=parse_position("C"),
            manner=PlayingOptions(touch="tracked", grain=0.005, layer=True),
            when=parse_position("3|1"),
        ),
    ),
]
