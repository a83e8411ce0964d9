"""The table of verbs, from which grammar, help, completion, colours and the Python API derive."""

from __future__ import annotations

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import (
    automating,
    blocks,
    hearing,
    levels,
    library,
    looking,
    matter,
    midi,
    mixing,
    phrases,
    playing,
    recording,
    retuning,
    rhythms,
    stopping,
    striking,
    transport,
    values,
    versions,
)
from ergon.repl.language.forms import Form, Slot, form
from ergon.repl.language.values import Completion, Value

VERB_VALUE = Value(
    "a verb",
    lambda text, *_: find_verb(text),
    lambda _: (Completion(form.verb, form.effect) for form in FORMS),
)
HELP_FORM = form(
    "help",
    "he",
    "lists the verbs, or explains one",
    "help plays",
    looking.Help,
    Slot("verb", "VERB", VERB_VALUE, optional=True),
    takes_time=False,
)
# All forms by what they are about, in the order of the help. A verb is declared in the file of its
# form: how it is written, what makes its command, and the command.
GROUPS: dict[str, tuple[Form, ...]] = {
    "what is played": (
        playing.PLAYS_FORM,
        striking.STRIKES_FORM,
        phrases.PHRASE_STRIKES_FORM,
        hearing.HEAR_FORM,
        phrases.PHRASE_FORM,
        striking.NOTES_FORM,
        playing.DO_FORM,
        rhythms.DO_STRIKES_FORM,
        rhythms.RHYTHM_FORM,
        playing.DEFINE_FORM,
    ),
    "stopping": (
        stopping.REST_FORM,
        stopping.HUSH_FORM,
        stopping.DAMP_FORM,
        stopping.PANIC_FORM,
        stopping.RELEASE_FORM,
    ),
    "time": (
        transport.PLAY_FORM,
        transport.STOP_FORM,
        transport.TEMPO_FORM,
        transport.METER_FORM,
        transport.TAP_FORM,
        transport.NUDGE_FORM,
        transport.QUANT_FORM,
    ),
    "blocks": (
        blocks.DEF_FORM,
        blocks.RUN_FORM,
        blocks.EVERY_FORM,
        blocks.WHEN_FORM,
        blocks.STOP_BLOCK_FORM,
    ),
    "matter": (
        automating.SET_PATTERN_FORM,
        automating.SET_FILE_FORM,
        retuning.SET_TUNING_FORM,
        matter.SET_FORM,
        automating.LFO_FORM,
        automating.LFO_OFF_FORM,
        matter.COUPLE_FORM,
        matter.BUILD_FORM,
        library.USE_FORM,
        matter.LINK_FORM,
        matter.TAKES_FORM,
        mixing.ROUTE_FORM,
        mixing.ROUTE_GAIN_FORM,
        mixing.ROUTE_PAN_FORM,
        mixing.PAN_FORM,
        mixing.MOVE_PAN_FORM,
        mixing.FILTER_FORM,
        mixing.SEND_FORM,
        mixing.ROOM_FORM,
        mixing.FADE_FORM,
        matter.REMOVE_FORM,
        matter.RENAME_FORM,
        matter.UNCOUPLE_FORM,
    ),
    "hands": (
        recording.RECORD_FORM,
        recording.RECORD_OFF_FORM,
        recording.GUIDE_FORM,
        recording.GUIDE_OFF_FORM,
    ),
    "sound in a file": (recording.RECORD_AUDIO_OFF_FORM, recording.RECORD_AUDIO_FORM),
    "controllers and notes": (
        midi.MAP_PARAMETER_FORM,
        midi.MAP_GAIN_FORM,
        midi.MAP_MASTER_FORM,
        midi.MAP_TEMPO_FORM,
        midi.MAP_GESTURE_FORM,
        midi.MAP_STRIKES_FORM,
        midi.MAP_NOTES_FORM,
        midi.MAP_LEARN_FORM,
        midi.MAPS_FORM,
        midi.UNMAP_FORM,
        midi.UNMAP_NOTES_FORM,
        midi.MONITOR_FORM,
        midi.MONITOR_OFF_FORM,
    ),
    "mix": (
        levels.GAIN_FORM,
        levels.GAIN_STRIKES_FORM,
        levels.MUTE_FORM,
        levels.MUTE_STRIKES_FORM,
        levels.SOLO_FORM,
        levels.SOLO_STRIKES_FORM,
        levels.UNMUTE_FORM,
        levels.UNMUTE_STRIKES_FORM,
        levels.METERS_FORM,
    ),
    "versions and files": (
        versions.UNDO_FORM,
        versions.REDO_FORM,
        versions.BACK_FORM,
        versions.HISTORY_FORM,
        versions.KEEP_FORM,
        versions.SCENE_FORM,
        versions.SAVE_FORM,
        versions.LOAD_FORM,
        versions.RELOAD_FORM,
        versions.SEED_FORM,
    ),
    "looking": (
        looking.LOOK_FORM,
        library.SHOW_FORM,
        library.VOICES_FORM,
        library.INSTRUMENTS_FORM,
        library.GESTURES_FORM,
        library.SCENES_FORM,
        looking.SCOPE_FORM,
        looking.SCOPE_ON_FORM,
        looking.SCOPE_OFF_FORM,
        HELP_FORM,
        looking.PY_FORM,
        looking.QUIT_FORM,
    ),
}
FORMS: tuple[Form, ...] = tuple(form for group_forms in GROUPS.values() for form in group_forms)
# Verbs that take something away or end something: a word that only resembles one does not
# suggest it.
REMOVING_VERBS = frozenset(
    (
        *("remove", "undo", "back", "load", "reload", "stop", "panic", "quit", "unmap", "uncouple"),
        *("rest", "hush", "damp", "release", "seed"),
    )
)
# Words of other programs, and the verb that does it here: by its letters `quiet` would be `quit`.
VERB_BY_SYNONYM = {
    **dict.fromkeys(("quiet", "silence"), "hush"),
    **dict.fromkeys(("exit", "bye", "close"), "quit"),
    **dict.fromkeys(("delete", "del", "kill", "clear"), "remove"),
    **dict.fromkeys(("volume", "vol", "level", "louder", "softer", "quieter"), "gain"),
    **dict.fromkeys(("bpm", "speed", "faster", "slower"), "tempo"),
    **dict.fromkeys(("reverb", "hall"), "room"),
    **dict.fromkeys(("send", "output", "channel"), "route"),
    **dict.fromkeys(("start", "go", "resume", "continue"), "play"),
    **dict.fromkeys(("pause", "halt"), "stop"),
    **dict.fromkeys(("import", "add", "new", "instrument"), "use"),
    **dict.fromkeys(("eq", "lowpass", "highpass", "delay"), "filter"),
    **dict.fromkeys(("status", "list", "who"), "voices"),
    "write": "save",
    "open": "load",
    "unsolo": "unmute",
}
SHORT_FORM_BY_VERB = {form.verb: form.short for form in FORMS}
SUBJECT_VERBS = tuple(
    dict.fromkeys(form.verb for form in FORMS if form.begins_with_subject and form.verb != "=")
)
LEADING_VERBS = tuple(
    dict.fromkeys(form.verb for form in FORMS if not form.begins_with_subject)
)  # they begin a line


def forms_of(verb: str) -> tuple[Form, ...]:
    """All forms of a verb."""
    return tuple(form for form in FORMS if form.verb == verb)


def verbs_matching(verb_start: str, candidates: tuple[str, ...]) -> tuple[str, ...]:
    """The verbs that begin with a word; only those for which it is long enough, if there are
    any.
    """
    if verb_start in candidates:
        return (verb_start,)
    matching_verbs = tuple(verb for verb in candidates if verb.startswith(verb_start))
    long_enough_verbs = tuple(
        verb for verb in matching_verbs if len(verb_start) >= len(SHORT_FORM_BY_VERB[verb])
    )
    return long_enough_verbs or matching_verbs


def find_verb(verb_word: str) -> str:
    """The verb that a word means. Raises TextError."""
    all_verbs = (*LEADING_VERBS, *SUBJECT_VERBS, "=")
    matching_verbs = verbs_matching(verb_word, all_verbs)
    if len(matching_verbs) > 1:
        raise ambiguous_verb_error(verb_word, matching_verbs)
    if not matching_verbs:
        raise values.unknown_name_error(verb_word, "a verb", all_verbs)
    return matching_verbs[0]


def ambiguous_verb_error(word: str, verbs: tuple[str, ...], offset: int = 0) -> TextError:
    """The error for a word with which several verbs begin."""
    message = f"{quote(word)} may be {' or '.join(verbs)}: write more of it"
    return TextError(message, offset=offset, length=len(word))
