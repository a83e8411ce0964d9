"""The verbs: how each is written, what it does, and what it becomes. Help comes from here too."""

from __future__ import annotations

from collections.abc import Callable

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import commands as c
from ergon.repl.language import forms
from ergon.repl.language import values as v
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.playing import PLAYING, plays
from ergon.repl.language.values import Completion, Value

_OVER = Slot("over", v.LENGTH, "over", optional=True)
_PLAYER = Slot("player", v.PLAYER)
_K = Slot("stiffness", v.STIFFNESS, "K=", optional=True)
_Z = Slot("viscosity", v.DAMPING, "Z=", optional=True)
VERB = Value(
    "a verb",
    lambda text, *_: find_verb(text),
    lambda _: (Completion(form.verb, form.effect) for form in FORMS),
)


def _form(
    verb: str,
    written: str,
    effect: str,
    example: str,
    make: Callable[..., c.Command],
    *slots: Slot,
    timed: bool = True,
    subject: bool = False,
) -> Form:
    return Form(verb, written, effect, example, make, slots, timed, subject)


# By what they are about, in the order of the help.
GROUPS: dict[str, tuple[Form, ...]] = {
    "what is played": (
        _form(
            "plays",
            "PLAYER plays NAME [from TIME] [every LENGTH] [times N] [until WHERE] [do …] [touch …]",
            "a gesture or a take, in place of what was played",
            "ada plays knock every 1 times 8",
            plays,
            _PLAYER,
            Slot("play", PLAYING, many=True),
            subject=True,
        ),
        _form(
            "do",
            "PLAYER do TRANSFORMATION, …",
            "done to what is played, after what is done already",
            "ada do scale 1.2, mirror",
            c.Do,
            _PLAYER,
            Slot("do", v.DO, many=True),
            subject=True,
        ),
        _form(
            "=",
            "NAME = NOTATION",
            "defines or redefines a gesture, also while it sounds",
            "knock = 0@0 smooth 7@1/8 smooth 0@1/4",
            c.Define,
            Slot("name", v.GESTURE_NAME),
            Slot("notation", v.NOTATION, many=True),
            subject=True,
        ),
    ),
    "stopping": (
        _form(
            "rest",
            "rest PLAYER|all",
            "the player finishes this gesture and begins no other",
            "rest ada",
            c.Rest,
            Slot("player", v.PLAYER_OR_ALL),
        ),
        _form("hush", "hush", "hands lift; what sounds rings out", "hush", c.Hush),
        _form(
            "damp",
            "damp TIME",
            "more viscosity everywhere, then silence",
            "damp 3s",
            c.Damp,
            Slot("time", v.DURATION),
        ),
        _form(
            "panic", "panic", "silence at once, no force on any key", "panic", c.Panic, timed=False
        ),
        _form(
            "release",
            "release",
            "sound and forces again, after a panic",
            "release",
            c.Release,
            timed=False,
        ),
    ),
    "time": (
        _form(
            "play",
            "play [from WHERE]",
            "the piece runs",
            "play from B",
            c.Play,
            Slot("start", v.POSITION, "from", optional=True),
            timed=False,
        ),
        _form("stop", "stop", "the piece stands still", "stop", c.Stop),
        _form(
            "tempo",
            "tempo BPM | BPM -> BPM over LENGTH",
            "a tempo, or a way from one to another",
            "tempo 60 -> 84 over 4bar",
            forms.tempo,
            Slot("bpm", v.BPM, many=True),
            _OVER,
        ),
        _form("tap", "tap", "a beat is now; four of them are a tempo", "tap", c.Tap, timed=False),
        _form(
            "nudge",
            "nudge TIME",
            "the beat comes so much later, or earlier with a minus",
            "nudge -10ms",
            c.Nudge,
            Slot("by", v.SHIFT),
            timed=False,
        ),
        _form(
            "quant",
            "quant now|beat|bar|LENGTH",
            "where lines act that do not say when",
            "quant 2bar",
            c.Quant,
            Slot("grid", v.GRID),
            timed=False,
        ),
    ),
    "matter": (
        _form(
            "set",
            "set PATH VALUE|xFACTOR [over LENGTH]",
            "a physical parameter glides to a value or by a factor",
            "set bell.m.K x1.5 over 2bar",
            forms.change,
            Slot("target", v.TARGET),
            Slot("change", v.CHANGE),
            _OVER,
        ),
        _form(
            "couple",
            "couple KEY KEY K=STIFFNESS [Z=VISCOSITY]",
            "two keys feel each other",
            "couple k1 k2 K=40N/m",
            forms.couple,
            Slot("a", v.KEY),
            Slot("b", v.OTHER_KEY),
            _K,
            _Z,
        ),
        _form(
            "uncouple",
            "uncouple KEY KEY",
            "they no longer do",
            "uncouple k1 k2",
            c.Uncouple,
            Slot("a", v.KEY),
            Slot("b", v.OTHER_KEY),
        ),
    ),
    "hands": (
        _form(
            "record",
            "record PLAYER as NAME",
            "a real key is captured as a take",
            "record remi as solo",
            c.Record,
            _PLAYER,
            Slot("take", v.NEW_NAME, "as"),
        ),
        _form(
            "record",
            "record off",
            "the recording ends",
            "record off",
            c.RecordOff,
            Slot("", None, "off"),
        ),
        _form(
            "guide",
            "guide PLAYER PLAYER [K=STIFFNESS] [Z=VISCOSITY]",
            "a real hand is led along what another player plays",
            "guide remi ada K=30N/m",
            c.Guide,
            _PLAYER,
            Slot("by", v.OTHER_PLAYER),
            _K,
            _Z,
        ),
        _form(
            "guide",
            "guide PLAYER off",
            "the hand is free again",
            "guide remi off",
            c.Guide,
            _PLAYER,
            Slot("", None, "off"),
        ),
    ),
    "mix": (
        _form(
            "gain",
            "gain [NAME] LEVEL|xFACTOR",
            "the level of an instrument or a player, or of everything",
            "gain bell -6dB",
            c.Gain,
            Slot("name", v.SOUNDING, optional=True),
            Slot("ratio", v.LEVEL),
        ),
        _form(
            "mute", "mute NAME", "it is not heard", "mute bell", c.Mute, Slot("name", v.SOUNDING)
        ),
        _form(
            "solo", "solo NAME", "only it is heard", "solo bell", c.Solo, Slot("name", v.SOUNDING)
        ),
        _form(
            "unmute",
            "unmute [NAME]",
            "it, or everything, is heard again",
            "unmute bell",
            c.Unmute,
            Slot("name", v.SOUNDING, optional=True),
        ),
        _form("meters", "meters", "the level of every channel", "meters", c.Meters, timed=False),
    ),
    "versions and files": (
        _form("undo", "undo", "the version before", "undo", c.Undo),
        _form("redo", "redo", "the version that was undone", "redo", c.Redo),
        _form("back", "back N", "so many versions back", "back 3", c.Back, Slot("count", v.COUNT)),
        _form(
            "history", "history", "the versions, with their bars", "history", c.History, timed=False
        ),
        _form(
            "keep",
            "keep LENGTH as NAME",
            "what was played last gets a name",
            "keep 8bar as verse-2",
            c.Keep,
            Slot("length", v.LENGTH),
            Slot("name", v.NEW_NAME, "as"),
            timed=False,
        ),
        _form(
            "save",
            "save [FILE]",
            "writes the score, comments and all",
            "save scores/duet-live.yaml",
            c.Save,
            Slot("file", v.FILE, optional=True),
            timed=False,
        ),
        _form("load", "load FILE", "another score", "load duet.yaml", c.Load, Slot("file", v.FILE)),
        _form("reload", "reload", "reads the file again; what differs changes", "reload", c.Reload),
        _form(
            "seed",
            "seed N",
            "the number that every chance derives from",
            "seed 7",
            c.Seed,
            Slot("seed", v.SEED),
        ),
    ),
    "looking": (
        _form(
            "?",
            "? NAME",
            "what a name is, drawn; nothing is played",
            "? lean",
            c.Look,
            Slot("name", v.LOOKED_AT),
            timed=False,
        ),
        _form(
            "show",
            "show [NAME]",
            "what plays, or all about a name",
            "show ada",
            c.Show,
            Slot("name", v.LOOKED_AT, optional=True),
            timed=False,
        ),
        _form(
            "scope",
            "scope NAME",
            "how a key or an instrument moves now",
            "scope ada",
            c.Trace,
            Slot("name", v.MOVING),
            timed=False,
        ),
        _form(
            "help",
            "help [VERB]",
            "the verbs, or one of them",
            "help plays",
            c.Help,
            Slot("verb", VERB, optional=True),
            timed=False,
        ),
        _form(
            "py",
            "py EXPRESSION",
            "a Python expression over the session",
            "py piece.seed",
            c.Py,
            Slot("expression", v.EXPRESSION, many=True),
            timed=False,
        ),
        _form("quit", "quit", "hands lift, the session ends", "quit", c.Quit, timed=False),
    ),
}
FORMS: tuple[Form, ...] = tuple(form for some in GROUPS.values() for form in some)

# The shortest beginning by which each is understood. Fixed: a verb that is added later gets
# one that leaves these alone, so that what fingers have learnt stays true.
SHORTEST = {
    "plays": "p",  # after a player
    "do": "d",  # after a player
    "=": "=",
    "?": "?",
    "rest": "res",
    "hush": "hu",
    "damp": "d",
    "panic": "pa",
    "release": "rele",
    "play": "pl",
    "stop": "st",
    "tempo": "te",
    "tap": "ta",
    "nudge": "n",
    "quant": "qua",
    "set": "set",
    "couple": "c",
    "uncouple": "unc",
    "record": "rec",
    "guide": "gu",
    "gain": "ga",
    "mute": "mu",
    "solo": "so",
    "unmute": "unm",
    "meters": "me",
    "undo": "und",
    "redo": "red",
    "back": "b",
    "history": "hi",
    "keep": "k",
    "save": "sa",
    "load": "lo",
    "reload": "relo",
    "seed": "see",
    "show": "sh",
    "scope": "sc",
    "help": "he",
    "py": "py",
    "quit": "qui",
}
SUBJECT_VERBS = tuple(
    dict.fromkeys(form.verb for form in FORMS if form.subject and form.verb != "=")
)
VERBS = tuple(
    dict.fromkeys(form.verb for form in FORMS if not form.subject)
)  # those that begin a line
NOT_BUILT = {"link": "sharing tempo with other machines (link) is not built yet"}


def forms_of(verb: str) -> tuple[Form, ...]:
    """All ways to write a verb."""
    return tuple(form for form in FORMS if form.verb == verb)


def verbs_matching(word: str, among: tuple[str, ...]) -> tuple[str, ...]:
    """The verbs that a word may be the beginning of; one where it is long enough for one."""
    if word in among:
        return (word,)
    begun = tuple(verb for verb in among if verb.startswith(word))
    sure = tuple(verb for verb in begun if len(word) >= len(SHORTEST[verb]))
    return sure or begun


def find_verb(word: str) -> str:
    """The verb that is asked about. Raises TextError."""
    every = (*VERBS, *SUBJECT_VERBS, "=")
    some = verbs_matching(word, every)
    if len(some) > 1:
        message = f"{quote(word)} may be {' or '.join(some)}"
        raise TextError(message, length=len(word))
    if not some:
        raise v.unknown(word, "a verb", every)
    return some[0]
