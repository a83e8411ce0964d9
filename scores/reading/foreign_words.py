"""Words that composers know from other programs: what a score has in their place.

`FIELD_SYNONYMS` are other names of fields. `ADVICE_BY_WORD` has words that no field of a table
replaces, each with what to write. Both are by tables.
"""

from __future__ import annotations

from collections.abc import Mapping

_MUTE_ADVICE = (
    "an instrument is silent without its route, or with `gain: x0` there; at the prompt "
    "`mute bell` and `solo bell`"
)
_MUTE_STRIKES_ADVICE = (
    "to leave strikes out, put '#' before their lines; at the prompt `mute NAME` and `solo NAME`"
)
_PEDAL_ADVICE = (
    "a score has no pedal: strokes of a rhythm last as `do: legato 1` says, notes of a MIDI file "
    "until its pedal (controller 64) comes up, and other strokes have no end"
)
_DURATION_ADVICE = (
    "what is struck sounds until it has died away (its `t60`); in a rhythm `do: legato 1` ends "
    "notes, on an instrument whose `play` has a `release`"
)
_METER_ADVICE = "a meter stands in the tempo: `tempo: {bpm: 96, meter: 3/4}`"
METER_SECTION_ADVICE = f"{_METER_ADVICE}; `meter: {{from: tune.mid}}` takes over those of a file"
_BPM_ADVICE = "write `tempo: {bpm: 96}`; with changes `tempo: [{bpm: 96}, {at: 9|1, bpm: 60}]`"
_RATE_ADVICE = "write `rates: {audio: 48kHz}` as a section of the score"
_ROOM_ADVICE = (
    "a reverberation is a room: `mix: {rooms: {hall: {size: 12m, t60: 2s}}}`, with "
    "`send: {hall: -6dB}` in a route"
)
_REPETITION_ADVICE = "write how often, `times: 4`, or until when, `until: 9|1`"
_LENGTH_ADVICE = (
    "a piece ends after its last event and `render: {tail: 2s}`; `ergon render --until 30s` "
    "renders a part"
)
_LOUDNESS_ADVICE = "write it in the mix: `mix: {master: {loudness: -20LUFS}}`"
_LEVEL_ADVICE = "the level is that of its route: `mix: {route: [{from: bell, to: 1, gain: -6dB}]}`"
_CREDIT_ADVICE = "put it into `title`, or behind '#' as a comment"

_MUTE_WORDS = dict.fromkeys(("mute", "solo"), _MUTE_ADVICE)
_METER_WORDS = dict.fromkeys(
    ("time", "time_signature", "timesignature", "time-signature"), _METER_ADVICE
)
_RATE_WORDS = dict.fromkeys(
    ("rate", "samplerate", "sample_rate", "sample-rate", "sr"), _RATE_ADVICE
)
_ROOM_WORDS = dict.fromkeys(("reverb", "wet", "fx", "effects"), _ROOM_ADVICE)
_DURATION_WORDS = dict.fromkeys(
    ("duration", "dur", "length", "lasting", "legato"), _DURATION_ADVICE
)
_PEDAL_WORDS = dict.fromkeys(("pedal", "sustain"), _PEDAL_ADVICE)

FIELD_SYNONYMS: Mapping[str, Mapping[str, str]] = {
    "strikes": {
        "repeat": "times",
        "start": "at",
        "end": "until",
        **dict.fromkeys(("velocity", "level", "force", "dynamics", "amp"), "impulse"),
    },
    "strike": dict.fromkeys(("velocity", "level", "force", "dynamics", "amp"), "impulse")
    | dict.fromkeys(("note", "notes", "pitch"), "what"),
    "route": dict.fromkeys(("volume", "amp"), "gain")
    | {"instrument": "from", "channel": "to", "output": "to", "panning": "pan"},
    "render": {"output": "file", "bit_depth": "bits", "bitdepth": "bits"},
}
ADVICE_BY_WORD: Mapping[str, Mapping[str, str]] = {
    "score": {
        **_MUTE_WORDS,
        **_PEDAL_WORDS,
        **_METER_WORDS,
        **_RATE_WORDS,
        **_ROOM_WORDS,
        "bpm": _BPM_ADVICE,
        "key": "a score has no key: notes have their own signs, such as F#4 and Bb3; the keys of "
        "hands stand in `keys`",
        "length": _LENGTH_ADVICE,
        "duration": _LENGTH_ADVICE,
        "volume": _LOUDNESS_ADVICE,
        "gain": _LOUDNESS_ADVICE,
        **dict.fromkeys(
            ("author", "composer", "artist", "date", "comment", "notes"), _CREDIT_ADVICE
        ),
    },
    "strikes": {
        **_PEDAL_WORDS,
        **_DURATION_WORDS,
        "loop": _REPETITION_ADVICE,
        "gain": _LEVEL_ADVICE,
        "volume": _LEVEL_ADVICE,
        **dict.fromkeys(_MUTE_WORDS, _MUTE_STRIKES_ADVICE),
    },
    "strike": _DURATION_WORDS,
    "route": {
        **_MUTE_WORDS,
        **_ROOM_WORDS,
        "eq": "write `lowpass`, `highpass`, `lowshelf` or `highshelf`",
    },
    "render": {
        **_RATE_WORDS,
        **dict.fromkeys(("length", "duration", "until", "end"), _LENGTH_ADVICE),
        **dict.fromkeys(("loudness", "normalise", "normalize", "gain"), _LOUDNESS_ADVICE),
        "format": "the ending of `file` says it: .wav or .flac",
    },
    "tempo entry": _METER_WORDS,
    "phrase": {
        **_DURATION_WORDS,
        "loop": "a phrase is repeated where it is played: `times: 4` in `strikes`",
        "file": "a file of notes is a take: `takes: {tune: {file: tune.mid}}`, which strikes play "
        "as `play: tune`",
    },
}
