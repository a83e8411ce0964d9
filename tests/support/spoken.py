"""Lines of a session and their replies: the example session, and every other form."""

import dataclasses
from pathlib import Path

import pytest

from ergon.notation.clock.meter import Meter
from ergon.notation.clock.positions import Length, Position, parse_position
from ergon.notation.tables.strengths import MEZZO_FORTE, Level
from ergon.repl.language.automating import Automate, StopLfo
from ergon.repl.language.blocks import DefineBlock, RunBlock, RunByRule, StopBlock
from ergon.repl.language.commands import NOW, Command, Sync
from ergon.repl.language.hearing import Hear
from ergon.repl.language.levels import (
    Gain,
    GainStrikes,
    Meters,
    Mute,
    MuteStrikes,
    Solo,
    SoloStrikes,
    Unmute,
    UnmuteStrikes,
)
from ergon.repl.language.library import ListGestures, ListInstruments, ListScenes, Show, Use
from ergon.repl.language.looking import Help, Look, Py, Quit, Trace, TraceOn
from ergon.repl.language.mapping import Learn, MapControl, MapNotes, Maps, Monitor, Unmap
from ergon.repl.language.matter import Build, Couple, Link, Remove, Rename, Set, Takes, Uncouple
from ergon.repl.language.mixing import Fade, Filter, MovePan, Room, Route
from ergon.repl.language.parse import parse
from ergon.repl.language.phrases import DefinePhrase
from ergon.repl.language.playing import Define, Do, Plays
from ergon.repl.language.recording import Guide, Record, RecordAudio, RecordOff
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.retuning import Retune
from ergon.repl.language.scope import Scope, scope_of
from ergon.repl.language.stopping import Damp, Hush, Panic, Release, Rest
from ergon.repl.language.striking import DoStrikes, StrikeModules
from ergon.repl.language.transport import Nudge, Play, Quant, SetMeter, Stop, Tap, Tempo
from ergon.repl.language.triggers import parse_condition, parse_every
from ergon.repl.language.versions import (
    Back,
    History,
    KeepAsScore,
    Load,
    Redo,
    Reload,
    Save,
    Scene,
    Seed,
    Undo,
)
from ergon.scores.gesture import notation
from ergon.scores.gesture.transforms import parse_chain
from ergon.scores.reading.load import load
from ergon.scores.reading.playing import NO_OPTIONS, PlayingOptions

ROOT = Path(__file__).parents[2]
BEAT = Length(beats=1.0)


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


def parsed(line: str) -> Command:
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


def plays(what: str, **more) -> Plays:
    nothing = dict.fromkeys(("every", "times", "until"))
    return Plays("ada", what, **{**nothing, "do": (), "manner": NO_OPTIONS, **more})


# The example session of the design, and every form that it does not use.
KNOCK = "0@0 smooth 7@1/8 smooth 0@1/4"
SESSION = [
    ("play", Play(None)),
    ("ada plays knock every 1                  # at the next bar", plays("knock", every=BEAT)),
    (f"knock = {KNOCK}     # while sounding", Define("knock", notation.parse(KNOCK))),
    ("? lean                                   # draws it", Look("lean")),
    ("ada plays lean now                       # overrides quant", plays("lean", when=NOW)),
    ("ada do mirror, scale 1.2", Do("ada", chain("mirror, scale 1.2"))),
    ("set bell.m.K x1.5 over 2bar   # glides", Set("bell.m.K", None, 1.5, Length(bars=2))),
    ("tempo 60 -> 84 over 4bar", Tempo(60, 84, Length(bars=4))),
    ("couple k1 k2 K=40N/m", Couple("k1", "k2", 40.0, 0.0)),
    ("record remi as solo-2", Record("remi", "solo-2")),
    ("record off", RecordOff()),
    (
        "ada plays solo from 4 stretch 2",
        plays("solo", do=(*chain("from 4", 5), *chain("stretch 2", 12))),
    ),
    ("undo                                     # at the next bar", Undo()),
    ("keep 8bar as verse-2", KeepAsScore(Length(bars=8), "verse-2")),
    ("hush", Hush()),
    ("damp 3s", Damp(3.0)),
    ("save scores/duet-live.yaml               # comments kept", Save("scores/duet-live.yaml")),
    ("quit", Quit()),
]
OTHERS = [
    (
        "map cc 21 bell.m.K 1kN/m..9kN/m",
        MapControl("cc 21", "bell.m.K", (1000.0, 9000.0), "N/m"),
    ),
    ("map cc 7 gain bell -40dB..0dB", MapControl("cc 7", None, (-40.0, 0.0), "dB", "bell")),
    ("map cc 7 gain -40dB..6dB", MapControl("cc 7", None, (-40.0, 6.0), "dB")),
    ("map note C3..Bb4 sky.all 1mNs..20mNs", MapNotes(48, 70, "sky.all", (0.001, 0.02))),
    ("map note 127 bell.m 1mNs now", MapNotes(127, 127, "bell.m", (0.001, 0.001), when=NOW)),
    ("unmap cc 21", Unmap("cc 21")),
    ("unmap note C3..C4", Unmap("note 48..60")),
    ("maps", Maps()),
    ("record audio evening.wav", RecordAudio("evening.wav")),
    ("record audio off", RecordAudio(None)),
    ("play from B+2", Play(parse_position("B+2"))),
    ("stop at C", Stop(when=parse_position("C"))),
    ("set bell.m.K 900N/m in 2", Set("bell.m.K", 900.0, None, None, when=Length(beats=2))),
    ("set bell.tuning edo 19 over 1bar", Retune("bell.tuning", {"edo": "19"}, Length(bars=1))),
    ("set tuning off", Retune("tuning", {}, None)),
    ("set k1.M 350g", Set("k1.M", 0.35, None, None)),
    ("set gong.f A1", Set("gong.f", 55.0, None, None)),
    ("tempo 72", Tempo(72)),
    ("meter 3/4", SetMeter(Meter(3, 4, (3,)))),
    ("tap", Tap()),
    ("nudge -10ms", Nudge(Length(seconds=-0.01))),
    ("quant now", Quant(NOW)),
    ("quant 2bar", Quant(Length(bars=2))),
    ("uncouple k1 k2 at 9|1", Uncouple("k1", "k2", when=parse_position("9|1"))),
    ("couple k1 k2 Z=0.2Ns/m K=1kN/m", Couple("k1", "k2", 1000.0, 0.2)),
    ("guide remi ada K=30N/m", Guide("remi", "ada", 30.0)),
    ("guide remi off", Guide("remi", None)),
    ("gain ada x0.5", Gain("ada", 0.5)),
    ("gain 0dB", Gain(None, 1.0)),
    ("mute bell", Mute("bell")),
    ("solo gong now", Solo("gong", when=NOW)),
    ("unmute", Unmute(None)),
    ("unmute bell", Unmute("bell")),
    ("gain rain -20dB", GainStrikes("rain", 0.1)),
    ("mute rain now", MuteStrikes("rain", when=NOW)),
    ("solo rain", SoloStrikes("rain")),
    ("unmute rain", UnmuteStrikes("rain")),
    ("meters", Meters()),
    ("rest ada", Rest("ada")),
    ("rest all", Rest(None)),
    (
        "bell notes A3 C4 (E4 A4) euclid 5 8 chance 0.8",
        StrikeModules(
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
        Automate("bell.m.f", "set", {"to": "A3 (C4 E4)", "every": "1"}, when=parse_position("B")),
    ),
    (
        "lfo bell.m.K 0.8..1.2 period 4bar shape triangle",
        Automate("bell.m.K", "lfo", {"range": "0.8..1.2", "period": "4bar", "shape": "triangle"}),
    ),
    ("lfo bell.m.K off", StopLfo("bell.m.K")),
    (
        "rain strikes bell.m gong every 1/2 impulse 2mNs euclid 3 8 rotate 2 at B",
        StrikeModules(
            "rain",
            {"to": "bell.m gong", "every": "1/2", "impulse": "2mNs", "euclid": "3 8 rotate 2"},
            when=parse_position("B"),
        ),
    ),
    ("hear gong", Hear("gong", (), MEZZO_FORTE)),
    ("hear gong.strike C4 eb4 v127", Hear("gong.strike", ("C4", "Eb4"), Level(1.0, 1.0, True))),
    ("hear bell.m 2mNs", Hear("bell.m", (), Level(0.002, 0.002))),
    (
        "map cc 1/33 bell.m.K 1kN/m..9kN/m",
        MapControl("cc 1/33", "bell.m.K", (1000.0, 9000.0), "N/m"),
    ),
    ("map bend tempo 60..180", MapControl("bend", None, (60.0, 180.0), "bpm")),
    ("map pressure gain ada 0dB", MapControl("pressure", None, (0.0, 0.0), "dB", "ada")),
    (
        "map pressure C4 gain 0dB now",
        MapControl("pressure 60", None, (0.0, 0.0), "dB", when=NOW),
    ),
    ("unmap pressure C4", Unmap("pressure 60")),
    (
        "map learn bell.m.M 1g..2g",
        Learn(MapControl("learn", "bell.m.M", (0.001, 0.002), "kg")),
    ),
    ("map learn note fill", Learn(MapNotes(0, 0, "fill", None))),
    ("unmap learn", Learn(None)),
    ("monitor on", Monitor(True)),
    ("monitor off", Monitor(False)),
    (
        "map note 60 bell.m 1mNs curve root",
        MapNotes(60, 60, "bell.m", (0.001, 0.001), None, "root"),
    ),
    ("map note D2 ada knock", MapNotes(38, 38, "ada", None, "knock")),
    ("map note D2 fill", MapNotes(38, 38, "fill", None)),
    ("map cc 1 tempo 60..180 now", MapControl("cc 1", None, (60.0, 180.0), "bpm", when=NOW)),
    ("map note C4 gong.strike", MapNotes(60, 60, "gong.strike", None)),
    ("rain do off 1/8 transpose 7st", DoStrikes("rain", "off 1/8 transpose 7st")),
    ("rain do none now", DoStrikes("rain", "none", when=NOW)),
    (
        'd1 = "bell.m*2 ~ <bell.m gong>" 2mNs cycle 2 do rev at B',
        StrikeModules(
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
        StrikeModules(
            "hook",
            {"play": "tune", "every": "2bar", "transpose": "-3st", "do": "scale 0.5, from 2"},
        ),
    ),
    (
        "phrase air 0 C4 1mNs, 1/2 E4 bell.m to bell length 4",
        DefinePhrase(
            "air",
            (
                {"at": "0", "impulse": "1mNs", "what": "C4"},
                {"at": "1/2", "what": "E4 bell.m"},
            ),
            "bell",
        ),
    ),
    ("def tilt: ada plays lean", DefineBlock("tilt", ("ada plays lean",))),
    ("fill", RunBlock("fill")),
    ("fill 16 n=3 now", RunBlock("fill", ("16", "n=3"), when=NOW)),
    ("stop sync rain", Stop(when=Sync("rain"))),
    (
        "def tilt n=2: ada plays lean times $n",
        DefineBlock("tilt", ("$n = 2", "ada plays lean times $n")),
    ),
    ("run fill at B", RunBlock("fill", when=parse_position("B"))),
    ("fill every 4bar", RunByRule("fill", parse_every("4bar"))),
    (
        "when bar % 4 == 3 fill now",
        RunByRule("fill", parse_condition("bar % 4 == 3"), when=NOW),
    ),
    ("stop fill", StopBlock("fill")),
    ("panic now", Panic()),
    ("release", Release()),
    ("redo", Redo()),
    ("history", History()),
    ("back 3", Back(3)),
    ("save", Save(None)),
    ('load "my pieces/duet.yaml" at C', Load("my pieces/duet.yaml", when=parse_position("C"))),
    ("scene verse-2", Scene("verse-2")),
    ("scene verse-2 over 2bar now", Scene("verse-2", None, Length(bars=2), when=NOW)),
    ("sce a -> b over 4bar", Scene("b", "a", Length(bars=4))),
    ("bell2=bell/bell", Build("bell2", "bell/bell", 0.0, {})),
    (
        "gong2 = gong/plate f=C2 transpose -5.5st at C",
        Build("gong2", "gong/plate", -5.5, {"f": "C2"}, when=parse_position("C")),
    ),
    (
        "link k1 bell.m BUT K=4kN/m gap=1mm now",
        Link("k1", "bell.m", "BUT", {"K": "4kN/m", "gap": "1mm"}, when=NOW),
    ),
    ("use skins", Use("skins", "instruments/skins.yaml")),
    ("use my/drums.yaml at C", Use("drums", "my/drums.yaml", when=parse_position("C"))),
    ("mia takes k3", Takes("mia", "k3")),
    ("mia takes k3 like k1 in 2", Takes("mia", "k3", "k1", when=Length(beats=2))),
    ("route bell 3 4 gain -6dB", Route("bell", ("3", "4"), pytest.approx(0.501187, rel=1e-4))),
    ("route gong nearest", Route("gong", ("nearest",))),
    ("route bell 1 2 pan -0.3", Route("bell", ("1", "2"), pan=-0.3)),
    ("route bell pan 0.5", Route("bell", None, pan=0.5)),
    ("route bell gain x0.5", Route("bell", None, 0.5)),
    ("route bell send hall -12dB", Route("bell", None, send=("hall", "-12dB"))),
    ("room hall t60=2s size=12m", Room("hall", {"t60": "2s", "size": "12m"})),
    ("pan bell 0.8 over 4bar", MovePan("bell", 0.8, Length(bars=4.0))),
    ("filter bell lowpass 2kHz", Filter("bell", "lowpass", {"": "2kHz"})),
    (
        "filter bell lowshelf 200Hz -3dB",
        Filter("bell", "lowshelf", {"f": "200Hz", "gain": "-3dB"}),
    ),
    ("filter bell delay off", Filter("bell", "delay", {})),
    ("fade bell out over 8bar", Fade("bell", False, Length(bars=8.0))),
    ("fade master in over 2bar", Fade(None, True, Length(bars=2.0))),
    ("remove bell.b", Remove("bell.b")),
    ("rename lean tilt", Rename("lean", "tilt")),
    ("reload", Reload()),
    ("seed 18446744073709551615", Seed(2**64 - 1)),
    ("show", Show(None)),
    ("voices", Show(None)),
    ("instruments", ListInstruments(None)),
    ("instruments skins", ListInstruments("skins")),
    ("gestures", ListGestures()),
    ("scenes", ListScenes()),
    ("show ada", Show("ada")),
    ("scope k1", Trace("k1")),
    ("scope ada on", TraceOn("ada")),
    ("sc off", TraceOn()),
    ("help", Help(None)),
    ("help te", Help("tempo")),
    ("help record", Help("record")),
    ("py [x for x in 'a # b']", Py("[x for x in 'a # b']")),
    ("knock=0@0 7@1/8", Define("knock", notation.parse("0@0 7@1/8"))),
    ("new = 0@0 7@1/8 at B", Define("new", notation.parse("0@0 7@1/8"), when=Position("B"))),
    ("?lean", Look("lean")),
    ("? bell.m.K", Look("bell.m.K")),
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
