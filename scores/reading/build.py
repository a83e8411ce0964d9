"""Makes what moves and plays in a piece from the values that were read, and checks their fields
together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from ergon.common.foreign_files import foreign_form
from ergon.instruments.model import Module, Target
from ergon.instruments.read import make_module
from ergon.instruments.read import read_modules as read_modules
from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import parse_with_names
from ergon.notation.tables.strengths import MEZZO_FORTE, Levels
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.document import Scalar
from ergon.notation.text.errors import TextError
from ergon.notation.text.files import Files
from ergon.scores.gesture import notation, note_files, space_path, take_file
from ergon.scores.pattern.order import Group, single_name_pattern
from ergon.scores.pattern.values import Amount, parse_values
from ergon.scores.reading import calibration
from ergon.scores.reading.automatable import amount_reader
from ergon.scores.reading.gesture_tables import OSC
from ergon.scores.reading.patterns import PATTERN_FIELDS, PatternValues, pattern_of
from ergon.scores.reading.piece import Hit, Strikes, TempoEntry
from ergon.scores.reading.playing import Coupling, Gesture, Key, Player, SoundInput, TakeFile
from ergon.scores.reading.playing_options import OptionValues, playing_options
from ergon.scores.reading.sweep_fields import read_passing

BEGINNING = Position()


def has_single(values: Values, *groups: tuple[str, ...]) -> bool:
    """Whether fields of exactly one group are written; reports two, or none."""
    present = [group for group in groups if values.written(*group)]
    if len(present) > 1:
        a, b = values.written(*present[0])[0], values.written(*present[1])[0]
        values.error(
            "E111", f"{values.context.label(b)}: {a} is written too; keep one of the two", b
        )
    elif not present:
        alternatives = " or ".join(group[0] for group in groups)
        values.error("E103", f"{values.context.label('')} needs {alternatives}")
    return len(present) == 1


def key(values: Values, files: Files) -> Key:
    """A key; `calib:` supplies what is not written here."""
    measured = calibration.measured_values(values, files)
    if measured is not None:
        values = calibration.with_measured_fields(values, measured)
    cel = ("M", "K", "Z", "f", "t60")
    modules: tuple[Module, ...] = ()
    if values.written("modules"):
        if contrary_fields := values.written(*cel):
            message = (
                f"{values.context.label(contrary_fields[0])}: `modules` is written too; "
                "keep one of the two"
            )
            values.error("E111", message, contrary_fields[0])
        if not values.written("struck"):
            message = (
                f"{values.context.label('')} has no `struck`; write the module that ergons strike"
            )
            values.error("E103", message)
        modules = read_modules(values)
    else:
        if not values.written("M"):
            values.error("E103", f"{values.context.label('')} has no 'M': its mass, such as 400g")
        has_single(values, ("K", "Z"), ("f", "t60"))
        fields = {name: values[name] for name in (*cel, "rest", "X0", "V0")}
        places = {name: node.place for name, node in values.nodes.items()}
        modules = (Module("", "CEL", fields, values.place, places),)
        if measured is not None and not values["simple"]:
            end = calibration.resting_end(values, measured)
            modules = calibration.key_modules(modules[0], measured, end)
    travel = values["travel"]
    if travel is not None and not travel[0] <= values["X0"] <= travel[1]:
        message = f"{values.context.label('X0')}: the key begins outside its travel"
        values.error("E202", message, "X0")
    struck = values["struck"] or ""
    constants = None if measured is None else calibration.key_constants(measured)
    delay = values["delay"]
    if delay is None and constants is not None and not values["simple"]:
        delay = constants[2]
    if constants is not None:
        constants = *constants[:2], delay
    arguments = values.context.name, modules, struck, travel, values["reach"], values.place
    return Key(*arguments, measured=constants, delay=delay or 0.0)


def gestures(values: Values, room: int = notation.MAX_EVENTS) -> dict[str, Gesture] | None:
    """Gestures with at most `room` points: one by the name "", or one for each axis of a path in
    space.

    None if an error was reported.
    """
    if not has_single(values, ("notation",), ("points",)):
        return None
    name = values.written("notation", "points")[0]
    text = values.by_name.get(name)
    if not isinstance(text, Scalar):
        return None

    def parse(source: str) -> tuple[notation.Notation, ...]:
        if name == "notation" and space_path.axes(source) > 1:
            return space_path.parse(source, values["curve"], room)
        parse_one = notation.parse if name == "notation" else notation.parse_table
        return (parse_one(source, values["curve"], room),)

    try:
        read = parse_with_names(
            text,
            lambda gesture_text: [
                _is_at_start(gesture, gesture_text, text) for gesture in parse(gesture_text)
            ],
        )
    except TextError as error:
        values.context.text_error(error, text, "")
        return None
    manner = playing_options(cast("OptionValues", values.by_name))
    options = values["do"] or (), manner, values.place, text
    parsed = [
        Gesture(values.context.name, gesture.points, gesture.bar_checks, *options)
        for gesture in read
    ]
    return {"": parsed[0]} if len(parsed) == 1 else dict(zip(AXES, parsed, strict=False))


_INPUT_HIGHPASS_HZ = 20.0  # of an input [Hz]
_INPUT_GLIDE_SECONDS = 0.02  # from one value by OSC to the next [s]
_INPUT_GLIDE_SECONDS_MAX = 60.0  # [s]
_INPUT_NAMES = ("gain", "highpass", "clamp", "glide")
_MIDI_NAMES = ("velocity", "depth", "curve")
_NOT_OF_INPUTS = (*_MIDI_NAMES, "trim", "smooth", "rate", "unit")


def take(values: Values, files: Files) -> TakeFile | None:
    """A take; its file must exist, and its content is read when it is played."""
    v, label = values, f"{values.context.label('file')}: "
    if v.written("input"):
        return _sound_input(v, files, label)
    for name in v.written(*_INPUT_NAMES):
        v.error("E111", f"{v.context.label(name)}: belongs to a take with `input`", name)
    if v["file"] is None:
        message = f"{v.context.label('')} has neither a file nor an input; write `file` or `input`"
        v.context.error("E103", message, v.place)
        return None
    file, folder = v["file"], v.nodes["file"].document.folder
    path = folder / file
    if path.suffix.lower() == ".gms":
        v.error("E108", f"{label}ergon does not read GMS files yet", "file")
    elif path.suffix.lower() not in (*take_file.SUFFIXES, *note_files.SUFFIXES):
        forms = f"a take is a {', '.join(take_file.SUFFIXES)}, .mid or .musicxml file"
        v.error("E206", f"{label}{foreign_form(b'', path) or forms}", "file")
    else:
        path = files.locate(file, folder, v.place_of("file"), label, is_text=False) or path
    is_midi = path.suffix.lower() in note_files.SUFFIXES
    for name in v.written(*(("trim", "smooth", "rate", "unit") if is_midi else _MIDI_NAMES)):
        source_noun = "a file of notes" if is_midi else "a take that is not a MIDI or MusicXML file"
        v.error("E111", f"{v.context.label(name)}: {source_noun} has no {name}; remove it", name)
    if note_files.is_musicxml(path) and v.written("bend"):
        message = f"{v.context.label('bend')}: a MusicXML file has no pitch wheel; remove it"
        v.error("E111", message, "bend")
    return TakeFile(
        name=v.context.name,
        path=path,
        channel=v["channel"],
        trim=v["trim"],
        smooth=v["smooth"],
        rate=v["rate"],
        unit=v["unit"],
        place=v.place,
        places={name: node.place for name, node in v.nodes.items()},
    )


def _sound_input(v: Values, files: Files, label: str) -> TakeFile | None:
    """An input; missing fields and those that do not belong to it are reported."""
    for name in v.written(*_NOT_OF_INPUTS):
        v.error("E111", f"{v.context.label(name)}: an input has no {name}; remove it", name)
    is_osc = v["input"] == OSC
    if v["gain"] is None or v["input"] is None:
        if not v.written("gain"):
            message = (
                f"{v.context.label('')} has no 'gain': what full scale is, such as 2mN or 0.1mm"
            )
            v.context.error("E103", message, v.place)
        return None
    gain, is_force = v["gain"]
    clamp, is_clamp_force = v["clamp"] or (abs(gain), is_force)
    if is_clamp_force != is_force:
        unit = "a force" if is_force else "a length"
        v.error("E111", f"{v.context.label('clamp')}: `gain` is {unit}, so `clamp` is one", "clamp")
    elif clamp < 0.0:
        v.error(
            "E202",
            f"{v.context.label('clamp')}: this limit acts in both directions; write it "
            "without a sign",
            "clamp",
        )
    path = None
    if v["file"] is not None:
        folder = v.nodes["file"].document.folder
        path = folder / v["file"]
        if path.suffix.lower() != ".wav":
            v.error("E206", f"{label}what an input hears is a .wav file", "file")
        else:
            path = files.locate(v["file"], folder, v.place_of("file"), label, is_text=False) or path
    elif v["channel"] is not None:
        message = f"{v.context.label('channel')}: is of a file, and the input has none; remove it"
        v.error("E111", message, "channel")
    highpass = _INPUT_HIGHPASS_HZ if v["highpass"] is None else v["highpass"]
    glide = _INPUT_GLIDE_SECONDS if v["glide"] is None else v["glide"]
    for name in v.written("highpass" if is_osc else "glide"):
        source_noun = "an input by OSC" if is_osc else "an input of the sound card"
        v.error("E111", f"{v.context.label(name)}: {source_noun} has no {name}; remove it", name)
    if glide > _INPUT_GLIDE_SECONDS_MAX:
        message = f"{v.context.label('glide')}: the longest glide is {_INPUT_GLIDE_SECONDS_MAX:g} s"
        v.error("E202", message, "glide")
    return TakeFile(
        name=v.context.name,
        path=path,
        channel=v["channel"],
        trim=None,
        smooth=None,
        rate=None,
        unit=None,
        place=v.place,
        places={name: node.place for name, node in v.nodes.items()},
        input=SoundInput(
            None if is_osc else v["input"],
            gain,
            is_force,
            None if is_osc else highpass,
            clamp,
            glide if is_osc else None,
        ),
    )


def strikes(values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes on the targets that their names reach."""
    v = values
    _check_force(v)
    if v.written("rate") and (contrary_fields := v.written("every", "times")):
        v.error(
            "E111",
            f"{v.context.label(contrary_fields[0])}: `rate` is written too; keep one of the two",
            contrary_fields[0],
        )
    if v.written("for") and v.written("until"):
        v.error(
            "E111",
            f"{v.context.label('until')}: `for` is written too; keep one of the two",
            "until",
        )
    if v.written("rate") and not v.written("for", "until"):
        v.error(
            "E103",
            f"{v.context.label('rate')}: the strikes have no end; write `for` or `until`",
            "rate",
        )
    if v.written("rate") and (contrary_fields := v.written(*PATTERN_FIELDS, "notes")):
        v.error(
            "E111",
            f"{v.context.label(contrary_fields[0])}: strikes by chance have no steps; write "
            "`every` instead of `rate`",
            contrary_fields[0],
        )
    if (contrary_fields := v.written("notes", "chance", "swing", "skip")) and not v.written(
        "rate", "every", "euclid"
    ):
        message = (
            f"{v.context.label(contrary_fields[0])}: the length of a step is missing; write `every`"
        )
        v.error("E103", message, contrary_fields[0])
    if not v.written("rate", "every", "euclid") and (many := v.written("times", "for", "until")):
        message = (
            f"{v.context.label(many[0])}: the time between strikes is missing; "
            "write `every`, or `rate` for strikes by chance"
        )
        v.error("E103", message, many[0])
    order = single_name_pattern(v.context.name)
    notes: Mapping[str, Amount] = {}
    if v["notes"] is not None:
        node = v.nodes["notes"]
        assert isinstance(node, Scalar)
        try:
            order, notes = parse_with_names(node, _value_pattern)
        except TextError as error:
            v.context.text_error(error, node, "notes")
    has_pattern = v.written(*PATTERN_FIELDS, "notes")
    written = cast("PatternValues", v.by_name)
    pattern = pattern_of(written, order) if has_pattern else None
    strikes_without_notes = _common_strikes(v, to)
    return replace(
        strikes_without_notes, span=v["for"], rate=v["rate"], pattern=pattern, notes=notes
    )


def _common_strikes(v: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes with what every kind of them may have."""
    return Strikes(
        name=v.context.name,
        to=to,
        at=v["at"],
        until=v["until"],
        every=v["every"],
        times=v["times"],
        levels=v["impulse"] or (None if v.written("mass") else Levels((MEZZO_FORTE,))),
        mass=v["mass"],
        speed=v["speed"],
        place=v.place,
        lasts=v["lasts"],
    )


def _check_force(values: Values) -> None:
    """Check that strikes have `impulse`, both `mass` and `speed`, or neither; reports errors."""
    if values.written("impulse"):
        has_single(values, ("impulse",), ("mass", "speed"))
    if values.written("lasts"):
        has_single(values, ("lasts",), ("mass", "speed"))
    if len(force_fields := values.written("mass", "speed")) == 1:
        values.error(
            "E103", f"{values.context.label('')} needs both mass and speed", force_fields[0]
        )


def rhythm_strikes(values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes by a rhythm that is not read yet, on all that its words strike."""
    if values.written("for") and values.written("until"):
        message = f"{values.context.label('until')}: `for` is written too; keep one of the two"
        values.error("E111", message, "until")
    return replace(_common_strikes(values, to), span=values["for"])


def passing_strikes(values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes by a sweep or along a path, on the targets that their names reach."""
    _check_force(values)
    return replace(_common_strikes(values, to), length=values["for"], passing=read_passing(values))


def _is_at_start(read: notation.Notation, source: str, text: Scalar) -> notation.Notation:
    """The notation; its places are set to the beginning if names of values were replaced in the
    text.
    """
    if source == text.text:
        return read
    points = tuple(replace(point, offset=0, length=1) for point in read.points)
    checks = tuple(replace(check, offset=0) for check in read.bar_checks)
    return replace(read, points=points, bar_checks=checks)


def _value_pattern(text: str) -> tuple[Group, Mapping[str, Amount]]:
    return parse_values(text, amount_reader(k.PITCH.parse, "f"), is_pitch=True)


def melody(values: Values, hits: tuple[Hit, ...], length: Length | None) -> Strikes:
    """A melody whose strikes are known; `length` is that of a phrase."""
    v = values
    targets = dict.fromkeys(target for hit in hits for target in hit.to)
    return Strikes(
        name=v.context.name,
        to=tuple(targets),
        at=v["at"] or BEGINNING,
        until=v["until"],
        every=v["every"],
        times=v["times"],
        place=v.place,
        hits=hits,
        length=length,
        lasts=v["lasts"],
    )


def player(values: Values) -> Player:
    """A player; for a live one a note says what plays in its place."""
    v = values
    if v["hand"] == "live":
        substitute = f"its stand-in {v['standin']}" if v["standin"] else "its part"
        label = v.context.label("")
        message = f"{label}: {substitute} plays in place of a real hand; `ergon duet` connects one"
        v.error("N401", message, "hand")
    context = v.context
    return Player(context.name, v["hand"], v["key"], v["device"], v["standin"], v["tick"], v.place)


def coupling(values: Values, number: int) -> Coupling | None:
    """A coupling of two keys, whose names are not looked up yet."""
    v = values
    link = v.by_name.get(v.kind)
    if not isinstance(link, Values) or len(v["couple"]) != 2:
        return None
    a, b = v["couple"]
    link_module = make_module(f"duet{number}", v.kind, link)
    until = v["until"]
    begin = v["at"] or BEGINNING
    return Coupling(
        link_module, _unresolved_target(a), _unresolved_target(b), begin, until, v.node.place
    )


def _unresolved_target(name: Any) -> Target:
    return Target(str(name), "", 0, 1, str(name), name.place)


def tempo(values: Values, tempos: tuple[tuple[float, float], ...] = ()) -> TempoEntry:
    """A line of `tempo:`, with the tempos of the file that it names."""
    bpm, end = values["bpm"] or (None, None)
    place, over, meter = values.node.place, values["over"], values["meter"]
    return TempoEntry(values["at"] or BEGINNING, bpm, end, over, meter, place, tempos)
