"""The table of verbs, from which grammar, help, completion, colours and the Python API derive."""

from __future__ import annotations

from collections.abc import Callable

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import (
    automating,
    blocks,
    forms,
    hearing,
    library,
    midi,
    mixing,
    phrases,
    retuning,
    rhythms,
)
from ergon.repl.language import commands as c
from ergon.repl.language import structure as s
from ergon.repl.language import values as v
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.playing import PLAYING, plays
from ergon.repl.language.striking import NAMED, NOTES, PLAYED_ON, STRIKING, strikes
from ergon.repl.language.values import Completion, Value

VERB = Value(
    "a verb",
    lambda text, *_: find_verb(text),
    lambda _: (Completion(form.verb, form.effect) for form in FORMS),
)
_PLAYER = Slot("player", "PLAYER", v.PLAYER)
_KEYS = Slot("a", "KEY", v.KEY), Slot("b", "KEY", v.OTHER_KEY)
_LINK = (
    Slot("stiffness", "STIFFNESS", v.STIFFNESS, "K=", optional=True),
    Slot("viscosity", "VISCOSITY", v.DAMPING, "Z=", optional=True),
)
_OVER = Slot("over", "LENGTH", v.LENGTH, "over", optional=True)
_OFF = Slot("", "", None, "off")
_SOUNDING = Slot("name", "NAME", v.WITH_LEVEL)
_SOUNDING_OR_ALL = Slot("name", "NAME", v.WITH_LEVEL, optional=True)
_STRIKES = Slot("name", "STRIKES", v.STRIKES)
_SHOWN_OR_ALL = Slot("name", "NAME", v.NAME_OR_PARAMETER, optional=True)
_SOURCE = Slot("source", "cc N|bend|pressure [NOTE]|learn", midi.SOURCE)
_NOTES = Slot("notes", "NOTE|NOTE..NOTE", midi.NOTES, "note")
_CURVE = Slot("curve", "square|root|even", midi.CURVE, "curve", optional=True)
_PLAY = "NAME … [from TIME] [every LENGTH] [times N] [until WHERE] [chance P] [do …] [touch …]"


def _form(
    verb: str,
    short: str,
    effect: str,
    example: str,
    make: Callable[..., c.Command],
    *slots: Slot,
    timed: bool = True,
    subject: bool = False,
    quoted: bool = False,
) -> Form:
    return Form(verb, short, effect, example, make, slots, timed, subject, quoted)


# By what they are about, in the order of the help. Each: the verb, the shortest beginning by which
# it is understood, its effect, an example, what makes its command, its places. A short form is
# fixed: a verb that is added later gets one that leaves these alone, so that habits stay true.
# fmt: off
GROUPS: dict[str, tuple[Form, ...]] = {
    "what is played": (
        _form("plays", "p", "the player plays a gesture, take or pattern from here on",
              "ada plays knock every 1 times 8", plays,
              _PLAYER, Slot("play", _PLAY, PLAYING, many=True), subject=True),
        _form("strikes", "str", "strikes modules without a key",
              "rain strikes bell every 1 impulse 2mNs", strikes,
              Slot("name", "NAME", NAMED),
              Slot("fields", "MODULE … [every LENGTH] [impulse …] [chance P] [euclid N N] [do …] …",
                   STRIKING, many=True), subject=True),
        _form("strikes", "str", "plays a phrase on what it strikes",
              "hook strikes tune transpose 3st", strikes,
              Slot("name", "NAME", NAMED),
              Slot("fields", "PHRASE [every LENGTH] [times N] [transpose Nst] [do …]",
                   phrases.PLAYED, many=True), subject=True),
        _form("hear", "hea", "strikes once, now: an instrument, an act or a module",
              "hear gong f", hearing.hear,
              Slot("stroke", "INSTRUMENT[.ACT]|MODULE [NOTE …] [LEVEL]", hearing.STROKE, many=True),
              timed=False),
        _form("phrase", "ph", "defines or redefines a phrase: when, what, how strongly",
              "phrase tune 0 C4, 1/2 E4 to bell", phrases.define_phrase,
              Slot("name", "NAME", phrases.NEW_PHRASE),
              Slot("entries", "TIME NOTE … [IMPULSE], …", phrases.ENTRIES, many=True),
              Slot("to", "INSTRUMENT", phrases.TO, "to", optional=True),
              Slot("length", "LENGTH", v.LENGTH, "length", optional=True)),
        _form("notes", "no", "strikes an instrument at the pitches of a pattern",
              "bell notes A3 C4 E4 euclid 5 8", strikes,
              Slot("name", "INSTRUMENT", PLAYED_ON),
              Slot("fields", "NOTE … [every LENGTH] [euclid N N] [impulse …] [chance P] [do …] …",
                   NOTES, many=True), subject=True),
        _form("do", "d", "transforms further what the player plays",
              "ada do scale 1.2, mirror", c.Do,
              Slot("player", "PLAYER", v.DOING_PLAYER),
              Slot("do", "TRANSFORMATION, …", v.DO, many=True), subject=True),
        _form("do", "d", "transforms further what strikes play; `none` ends that",
              "rain do every 4 rev, ply 2", c.DoStrikes,
              Slot("name", "NAME", v.DOING_STRIKES),
              Slot("do", "TRANSFORMATION, …|none", rhythms.DO, many=True), subject=True),
        _form("=", "=", "plays a rhythm again and again, from here on",
              'd1 = "bell*2 ~ bell" 2mNs', rhythms.rhythm,
              Slot("name", "NAME", NAMED),
              Slot("fields", '"RHYTHM" [LEVEL …] [to INSTRUMENT] [cycle LENGTH] [do …] …',
                   rhythms.RHYTHM, many=True), subject=True,
              quoted=True),
        _form("=", "=", "defines or redefines a gesture, also while it sounds",
              "knock = 0@0 smooth 7@1/8 smooth 0@1/4", c.Define,
              Slot("name", "NAME", v.GESTURE_NAME),
              Slot("notation", "NOTATION", v.NOTATION, many=True), subject=True),
    ),
    "stopping": (
        _form("rest", "res", "the player finishes this gesture and begins no other",
              "rest ada", c.Rest, Slot("player", "PLAYER|all", v.PLAYER_OR_ALL)),
        _form("hush", "hu", "all hands lift; what sounds rings out", "hush", c.Hush),
        _form("damp", "d", "adds viscosity everywhere until all is silent",
              "damp 3s", c.Damp, Slot("time", "TIME", v.DURATION)),
        _form("panic", "pa", "silence at once, no force on any key",
              "panic", c.Panic, timed=False),
        _form("release", "rele", "switches sound and forces on again, after a stop",
              "release", c.Release, timed=False),
    ),
    "time": (
        _form("play", "pl", "starts the piece at a position, or where it was stopped",
              "play from B", c.Play,
              Slot("start", "WHERE", v.POSITION, "from", optional=True), timed=False),
        _form("stop", "st", "stops the piece where it is", "stop", c.Stop),
        _form("tempo", "te", "sets the tempo, or a ramp from one tempo to another",
              "tempo 60 -> 84 over 4bar", forms.tempo,
              Slot("bpm", "BPM|BPM -> BPM", v.BPM, many=True), _OVER),
        _form("meter", "meter", "sets the meter from the next bar on", "meter 3+2+2/8",
              c.SetMeter, Slot("meter", "BEATS/UNIT", v.METER)),
        _form("tap", "ta", "marks a beat; two or more taps set the tempo",
              "tap", c.Tap, timed=False),
        _form("nudge", "n", "delays the beat, or with a minus brings it forward",
              "nudge -10ms", c.Nudge, Slot("by", "TIME", v.SHIFT), timed=False),
        _form("quant", "qua", "sets where lines take effect that do not say when",
              "quant 2bar", c.Quant, Slot("grid", "now|beat|bar|LENGTH", v.GRID), timed=False),
    ),
    "blocks": (
        _form("def", "de", "gives one line a name, or those below it up to `end`",
              "def fill: ada plays lean times 2", blocks.define,
              Slot("name", "NAME [NAME=VALUE …]:", blocks.NEW_BLOCK),
              Slot("lines", "LINE …", blocks.LINES, many=True), timed=False),
        _form("run", "ru", "does all lines of a block; its name alone does the same",
              "run fill", blocks.run, Slot("name", "NAME", blocks.BLOCK),
              Slot("values", "VALUE|NAME=VALUE …", blocks.VALUES, optional=True, many=True)),
        _form("every", "ev", "runs a block again and again, the first time from here on",
              "fill every 4bar", blocks.run_every, Slot("name", "NAME", blocks.BLOCK),
              Slot("trigger", "LENGTH", blocks.EVERY), subject=True),
        _form("when", "w", "runs a block where a condition on bar or beat is true",
              "when bar % 4 == 3 fill", blocks.run_when,
              Slot("rule", "CONDITION NAME", blocks.RULE, many=True)),
        _form("stop", "st", "stops a block that runs by itself", "stop fill", c.StopBlock,
              Slot("name", "NAME", blocks.BLOCK)),
    ),
    "matter": (
        _form("set", "set", "a parameter follows a pattern of values, or a curve",
              "set bell.m.f A3 C4 E4 every 1", automating.automate,
              Slot("target", "PATH", automating.AUTOMATED_TARGET),
              Slot("fields", "VALUE … every LENGTH …", automating.AUTOMATION_VALUES, many=True)),
        _form("set", "set", "a parameter follows a MIDI file",
              "set bell.m.K from tune.mid by cc 1/33 range 0.5..2", automating.follow_file,
              Slot("target", "PATH", automating.AUTOMATED_TARGET),
              Slot("file", "FILE", automating.MIDI_FILE, "from"),
              Slot("source", "cc N|bend|pressure [NOTE]", automating.FILE_SOURCE, "by"),
              Slot("ends", "LOW..HIGH", automating.FILE_RANGE, "range"),
              Slot("channel", "N", automating.CHANNEL, "channel", optional=True),
              Slot("start", "QUARTERS", automating.FILE_START, "start", optional=True),
              Slot("until", "WHERE", v.POSITION, "until", optional=True)),
        _form("set", "set", "an instrument, or the score, goes by another tuning",
              "set bell.tuning edo 19", retuning.retune,
              Slot("target", "INSTRUMENT.tuning|tuning", retuning.TARGET),
              Slot("fields", "edo N|A4 HERTZ|scale FILE [keys FILE]|off …", retuning.FIELDS,
                   many=True), _OVER),
        _form("set", "set", "a physical parameter glides to a value, or by a factor",
              "set bell.m.K x1.5 over 2bar", forms.set_parameter,
              Slot("target", "PATH", v.TARGET), Slot("change", "VALUE|xFACTOR", v.CHANGE), _OVER),
        _form("lfo", "lf", "a parameter swings between two values",
              "lfo bell.m.K 0.8..1.2 period 4bar", automating.automate_lfo,
              Slot("target", "PATH", automating.AUTOMATED_TARGET),
              Slot("fields", "LOW..HIGH period LENGTH [shape SHAPE] …", automating.LFO,
                   many=True)),
        _form("lfo", "lf", "a parameter has its own value again",
              "lfo bell.m.K off", automating.stop_lfo,
              Slot("target", "PATH", automating.AUTOMATED_TARGET), _OFF),
        _form("couple", "c", "joins two keys by a spring and a damper",
              "couple k1 k2 K=40N/m", forms.couple, *_KEYS, *_LINK),
        _form("=", "=", "adds an instrument like another, or from a file",
              "bell2 = bell/bell transpose 7st", forms.build,
              Slot("name", "NAME", s.PART_NAME),
              Slot("base", "INSTRUMENT|FILE/NAME [transpose Nst] [FIELD=VALUE …]", s.BASE,
                   many=True), subject=True),
        _form("use", "us", "brings in a family, so that its instruments can be played",
              "use skins", library.use, Slot("family", "FAMILY|FILE", library.FAMILY)),
        _form("link", "li", "joins two modules, or a key and a module, by a link",
              "link k1 bell.m BUT K=4kN/m", c.Link,
              Slot("a", "MODULE", s.LINK_END), Slot("b", "MODULE", s.OTHER_END),
              Slot("kind", "KIND", s.LINK_KIND),
              Slot("fields", "FIELD=VALUE …", s.LINK_FIELDS, many=True)),
        _form("takes", "t", "the player takes a key; who and what is new is added",
              "mia takes k3 like k1", c.Takes,
              Slot("player", "NAME", s.PLAYER_NAME), Slot("key", "KEY", s.KEY_NAME),
              Slot("like", "KEY", v.KEY, "like", optional=True), subject=True),
        _form("route", "ro", "an instrument sounds from these channels, and no others",
              "route bell 3 4 gain -6dB pan -0.3", mixing.route,
              Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("channels", "CHANNEL …|nearest", s.CHANNELS, many=True),
              Slot("gain", "LEVEL", v.LEVEL, "gain", optional=True),
              Slot("pan", "PLACE", mixing.PAN, "pan", optional=True)),
        _form("route", "ro", "an instrument has this level where it sounds",
              "route bell gain -6dB", mixing.route, Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("gain", "LEVEL", v.LEVEL, "gain")),
        _form("route", "ro", "an instrument sounds from here between its two channels",
              "route bell pan -0.3", mixing.route, Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("pan", "PLACE", mixing.PAN, "pan")),
        _form("pan", "pan", "an instrument sounds from here between its two channels",
              "pan bell -0.3", mixing.route, Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("pan", "PLACE", mixing.PAN)),
        _form("pan", "pan", "an instrument moves to here between its two channels",
              "pan bell 0.8 over 4bar", c.MovePan, Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("pan", "PLACE", mixing.PAN), Slot("over", "LENGTH", v.LENGTH, "over")),
        _form("filter", "fil", "a filter or a delay on what is heard; off: without",
              "filter bell lowpass 2kHz", mixing.filtered,
              Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("kind", "lowpass|highpass|lowshelf|highshelf|delay", mixing.FILTER_KIND),
              Slot("fields", "VALUE [LEVEL]|off", mixing.FILTER_FIELDS, many=True)),
        _form("route", "ro", "an instrument sounds in a room too",
              "route bell send hall -12dB", mixing.route, Slot("name", "INSTRUMENT", s.INSTRUMENT),
              Slot("send", "ROOM LEVEL", mixing.SEND, "send", many=True)),
        _form("room", "roo", "adds a room that routes send to, or changes one",
              "room hall t60=2s size=12m", c.Room,
              Slot("name", "NAME", mixing.ROOM_NAME),
              Slot("fields", "FIELD=VALUE …", mixing.ROOM_FIELDS, many=True)),
        _form("fade", "fa", "fades an instrument or everything in or out",
              "fade bell out over 8bar", mixing.fade,
              Slot("name", "INSTRUMENT|master", mixing.FADED),
              Slot("way", "in|out", mixing.FADE_DIRECTION),
              Slot("over", "LENGTH", v.LENGTH, "over")),
        _form("remove", "rem", "removes what has a name, and what belongs to it alone",
              "remove bell", c.Remove, Slot("name", "NAME", s.REMOVABLE)),
        _form("rename", "ren", "gives what has a name another name",
              "rename lean tilt", c.Rename,
              Slot("old", "NAME", s.RENAMED), Slot("name", "NAME", v.NEW_NAME)),
        _form("uncouple", "unc", "removes what joins two keys",
              "uncouple k1 k2", c.Uncouple, *_KEYS),
    ),
    "hands": (
        _form("record", "rec", "records a real hand as a take",
              "record remi as solo", c.Record, _PLAYER, Slot("take", "NAME", v.NEW_NAME, "as")),
        _form("record", "rec", "ends the recording", "record off", c.RecordOff, _OFF),
        _form("guide", "gu", "guides a real hand along what another player plays",
              "guide remi ada K=30N/m", c.Guide,
              _PLAYER, Slot("by", "PLAYER", v.OTHER_PLAYER), *_LINK),
        _form("guide", "gu", "ends the guidance of a hand",
              "guide remi off", c.Guide, _PLAYER, _OFF),
    ),
    "sound in a file": (
        _form("record", "rec", "ends the file of what is heard", "record audio off",
              forms.record_audio, Slot("", "", None, "audio"), _OFF, timed=False),
        _form("record", "rec", "records what is heard in a file", "record audio evening.wav",
              forms.record_audio, Slot("", "", None, "audio"), Slot("file", "FILE", v.FILE),
              timed=False),
    ),
    "controllers and notes": (
        _form("map", "map", "a MIDI controller moves a parameter",
              "map cc 21 bell.m.K 1kN/m..9kN/m", midi.map_control,
              _SOURCE, Slot("target", "PATH", v.TARGET),
              Slot("range", "VALUE..VALUE", midi.RANGE)),
        _form("map", "map", "a MIDI controller moves a level, in dB",
              "map cc 7 gain bell -40dB..0dB", midi.map_gain,
              _SOURCE, Slot("sounding", "NAME", v.SOUNDING, "gain"),
              Slot("range", "LEVEL..LEVEL", midi.LEVELS)),
        _form("map", "map", "a MIDI controller moves the level of everything",
              "map cc 8 gain -40dB..0dB", midi.map_gain,
              _SOURCE, Slot("", "", None, "gain"),
              Slot("range", "LEVEL..LEVEL", midi.LEVELS)),
        _form("map", "map", "a MIDI controller sets the tempo",
              "map cc 1 tempo 60..180", midi.map_tempo,
              _SOURCE, Slot("range", "BPM..BPM", midi.TEMPOS, "tempo")),
        _form("map", "map", "MIDI notes let a player play a gesture",
              "map note D2 ada knock", midi.map_gesture,
              _NOTES, _PLAYER, Slot("gesture", "GESTURE", v.PLAYED)),
        _form("map", "map", "MIDI notes strike modules, by their velocity",
              "map note C3..C5 bell.m 1mNs..20mNs", midi.map_notes,
              _NOTES, Slot("target", "MODULE", midi.STRUCK),
              Slot("impulse", "IMPULSE..IMPULSE", midi.IMPULSES), _CURVE),
        _form("map", "map", "MIDI notes play an instrument or run a block",
              "map note C3..C5 gong curve square", midi.map_notes,
              _NOTES, Slot("target", "INSTRUMENT|BLOCK", midi.PLAYED_BY_NOTES), _CURVE),
        _form("map", "map", "the next MIDI note plays an instrument or runs a block",
              "map learn note gong", midi.learn_note, Slot("", "", None, c.LEARN),
              Slot("target", "INSTRUMENT|BLOCK", midi.PLAYED_BY_NOTES, "note")),
        _form("maps", "maps", "lists the maps, and what came and has none", "maps", c.Maps,
              timed=False),
        _form("unmap", "unma", "ends the map of a controller, or lets none be learnt",
              "unmap cc 21", midi.unmap_control, _SOURCE),
        _form("unmap", "unma", "ends a map of notes", "unmap note C3..C5", midi.unmap_notes,
              _NOTES),
        _form("monitor", "mon", "prints MIDI messages as they come", "monitor on",
              lambda **more: midi.monitor(True, **more), Slot("", "", None, "on"), timed=False),
        _form("monitor", "mon", "ends that", "monitor off", midi.monitor, _OFF, timed=False),
    ),
    "mix": (
        _form("gain", "ga", "sets the level of an instrument, a player or everything",
              "gain bell -6dB", c.Gain,
              _SOUNDING_OR_ALL, Slot("ratio", "LEVEL|xFACTOR", v.GAIN)),
        _form("gain", "ga", "scales the impulses of strikes", "gain rain -6dB", c.GainStrikes,
              _STRIKES, Slot("ratio", "LEVEL|xFACTOR", v.GAIN)),
        _form("mute", "mu", "silences an instrument or a player", "mute bell", c.Mute, _SOUNDING),
        _form("mute", "mu", "lets strikes go on without striking", "mute rain", c.MuteStrikes,
              _STRIKES),
        _form("solo", "so", "silences everything but an instrument or a player",
              "solo bell", c.Solo, _SOUNDING),
        _form("solo", "so", "silences all other strikes, and players", "solo rain",
              c.SoloStrikes, _STRIKES),
        _form("unmute", "unm", "ends mute and solo, of one or of everything",
              "unmute bell", c.Unmute, _SOUNDING_OR_ALL),
        _form("unmute", "unm", "lets strikes strike again", "unmute rain", c.UnmuteStrikes,
              _STRIKES),
        _form("meters", "me", "shows the level of every channel",
              "meters", c.Meters, timed=False),
    ),
    "versions and files": (
        _form("undo", "und", "returns to the version before", "undo", c.Undo),
        _form("redo", "red", "restores the version that was undone", "redo", c.Redo),
        _form("back", "b", "goes back by a number of versions",
              "back 3", c.Back, Slot("count", "N", v.COUNT)),
        _form("history", "hi", "lists the versions, with their bars",
              "history", c.History, timed=False),
        _form("keep", "k", "writes what was played last as a score of its own",
              "keep 8bar as verse-2", c.Keep, Slot("length", "LENGTH", v.LENGTH),
              Slot("name", "NAME", v.NEW_NAME, "as"), timed=False),
        _form("scene", "sce", "plays kept bars from their beginning, again and again",
              "scene verse-2 -> refrain over 4bar", forms.scene,
              Slot("names", "NAME|NAME -> NAME", v.SCENES, many=True), _OVER),
        _form("save", "sa", "writes the score, comments and all",
              "save scores/duet-live.yaml", c.Save,
              Slot("file", "FILE", v.FILE, optional=True), timed=False),
        _form("load", "lo", "opens another score in place of this one",
              "load duet.yaml", c.Load, Slot("file", "FILE", v.FILE)),
        _form("reload", "relo", "reads the score's files again; what differs changes",
              "reload", c.Reload),
        _form("seed", "see", "sets the number from which all chance derives",
              "seed 7", c.Seed, Slot("seed", "N", v.SEED)),
    ),
    "looking": (
        _form("?", "?", "draws a gesture, a name's definition, or alone two bars",
              "? lean", c.Look, _SHOWN_OR_ALL, timed=False),
        _form("show", "sh", "lists who plays what, or shows where a name is defined",
              "show ada", c.Show, _SHOWN_OR_ALL, timed=False),
        _form("voices", "vo", "lists who plays what, and what is muted", "voices",
              library.voices, timed=False),
        _form("instruments", "ins", "lists the instruments of the score or of a family",
              "instruments skins", c.ListInstruments,
              Slot("family", "FAMILY", library.LISTED, optional=True), timed=False),
        _form("gestures", "ge", "lists the gestures and the takes", "gestures", c.ListGestures,
              timed=False),
        _form("scenes", "scenes", "lists the scenes beside the score", "scenes", c.ListScenes,
              timed=False),
        _form("scope", "sc", "draws where a player's key was in the last two seconds",
              "scope ada", c.Trace, Slot("name", "NAME", v.PLAYER_KEY_OR_INSTRUMENT), timed=False),
        _form("scope", "sc", "keeps that drawing above the status line",
              "scope remi on", c.TraceOn, Slot("name", "NAME", v.PLAYER_KEY_OR_INSTRUMENT),
              Slot("", "", None, "on"), timed=False),
        _form("scope", "sc", "ends it", "scope off", c.TraceOn, _OFF, timed=False),
        _form("help", "he", "lists the verbs, or explains one",
              "help plays", c.Help, Slot("verb", "VERB", VERB, optional=True), timed=False),
        _form("py", "py", "evaluates Python in which `session` and `piece` are known",
              "py session.state().tempo", c.Py,
              Slot("expression", "EXPRESSION", v.EXPRESSION, many=True), timed=False),
        _form("quit", "qui", "all hands lift, and the session ends",
              "quit", c.Quit, timed=False),
    ),
}
# fmt: on
FORMS: tuple[Form, ...] = tuple(form for some in GROUPS.values() for form in some)
# Verbs that take something away or end something: a word that only resembles one does not
# suggest it.
TAKING_AWAY = frozenset(
    (
        *("remove", "undo", "back", "load", "reload", "stop", "panic", "quit", "unmap", "uncouple"),
        *("rest", "hush", "damp", "release", "seed"),
    )
)
# What other programs call some verbs; by its letters `quiet` would be `quit`.
MEANT = {"quiet": "hush", "silence": "hush", "exit": "quit", "delete": "remove"}
SHORTEST = {form.verb: form.short for form in FORMS}
SUBJECT_VERBS = tuple(
    dict.fromkeys(form.verb for form in FORMS if form.subject and form.verb != "=")
)
VERBS = tuple(dict.fromkeys(form.verb for form in FORMS if not form.subject))  # they begin a line


def forms_of(verb: str) -> tuple[Form, ...]:
    """All forms of a verb."""
    return tuple(form for form in FORMS if form.verb == verb)


def verbs_matching(word: str, among: tuple[str, ...]) -> tuple[str, ...]:
    """The verbs that begin with a word; only those for which it is long enough, if there are
    any.
    """
    if word in among:
        return (word,)
    begun = tuple(verb for verb in among if verb.startswith(word))
    sure = tuple(verb for verb in begun if len(word) >= len(SHORTEST[verb]))
    return sure or begun


def find_verb(word: str) -> str:
    """The verb that a word stands for. Raises TextError."""
    every = (*VERBS, *SUBJECT_VERBS, "=")
    some = verbs_matching(word, every)
    if len(some) > 1:
        raise ambiguous(word, some)
    if not some:
        raise v.unknown_name(word, "a verb", every)
    return some[0]


def ambiguous(word: str, verbs: tuple[str, ...], offset: int = 0) -> TextError:
    """The error for a word with which several verbs begin."""
    message = f"{quote(word)} may be {' or '.join(verbs)}: write more of it"
    return TextError(message, offset=offset, length=len(word))
