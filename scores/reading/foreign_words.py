"""Words that composers know from other programs: what a score has in their place.

`MEANT` are other names of a field, `ELSEWHERE` what no field of the table is, each with what to
write; both by tables.
"""

from __future__ import annotations

from collections.abc import Mapping

_MUTE = (
    "an instrument is silent without its route, or with `gain: x0` there; at the prompt "
    "`mute bell` and `solo bell`"
)
_MUTE_STRIKES = (
    "to leave strikes out, put '#' before their lines; at the prompt `mute NAME` and `solo NAME`"
)
_PEDAL = (
    "a score has no pedal: strokes of a rhythm last as `do: legato 1` says, notes of a MIDI file "
    "until its pedal (controller 64) comes up, and other strokes have no end"
)
_LASTING = (
    "what is struck sounds until it has died away (its `t60`); in a rhythm `do: legato 1` ends "
    "notes, on an instrument whose `play` has a `release`"
)
_METER = "a meter stands in the tempo: `tempo: {bpm: 96, meter: 3/4}`"
OTHER_METER = f"{_METER}; `meter: {{from: tune.mid}}` takes over those of a file"
_BPM = "write `tempo: {bpm: 96}`; with changes `tempo: [{bpm: 96}, {at: 9|1, bpm: 60}]`"
_RATE = "write `rates: {audio: 48kHz}` as a section of the score"
_ROOM_ADVICE = (
    "a reverberation is a room: `mix: {rooms: {hall: {size: 12m, t60: 2s}}}`, with "
    "`send: {hall: -6dB}` in a route"
)
_LOOP = "write how often, `times: 4`, or until when, `until: 9|1`"
_LENGTH_ADVICE = (
    "a piece ends after its last event and `render: {tail: 2s}`; `ergon render --until 30s` "
    "renders a part"
)
_LOUDNESS = "write it in the mix: `mix: {master: {loudness: -20LUFS}}`"
_LEVEL = "the level is that of its route: `mix: {route: [{from: bell, to: 1, gain: -6dB}]}`"
_CREDIT = "put it into `title`, or behind '#' as a comment"

_SILENT_ADVICE = dict.fromkeys(("mute", "solo"), _MUTE)
_METERS = dict.fromkeys(("time", "time_signature", "timesignature", "time-signature"), _METER)
_RATES = dict.fromkeys(("rate", "samplerate", "sample_rate", "sample-rate", "sr"), _RATE)
_ROOMS = dict.fromkeys(("reverb", "wet", "fx", "effects"), _ROOM_ADVICE)
_LASTS = dict.fromkeys(("duration", "dur", "length", "lasting", "legato"), _LASTING)
_PEDALS = dict.fromkeys(("pedal", "sustain"), _PEDAL)

MEANT: Mapping[str, Mapping[str, str]] = {
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
ELSEWHERE: Mapping[str, Mapping[str, str]] = {
    "score": {
        **_SILENT_ADVICE,
        **_PEDALS,
        **_METERS,
        **_RATES,
        **_ROOMS,
        "bpm": _BPM,
        "key": "a score has no key: notes have their own signs, such as F#4 and Bb3; the keys of "
        "hands stand in `keys`",
        "length": _LENGTH_ADVICE,
        "duration": _LENGTH_ADVICE,
        "volume": _LOUDNESS,
        "gain": _LOUDNESS,
        **dict.fromkeys(("author", "composer", "artist", "date", "comment", "notes"), _CREDIT),
    },
    "strikes": {
        **_PEDALS,
        **_LASTS,
        "loop": _LOOP,
        "gain": _LEVEL,
        "volume": _LEVEL,
        **dict.fromkeys(_SILENT_ADVICE, _MUTE_STRIKES),
    },
    "strike": _LASTS,
    "route": {
        **_SILENT_ADVICE,
        **_ROOMS,
        "eq": "write `lowpass`, `highpass`, `lowshelf` or `highshelf`",
    },
    "render": {
        **_RATES,
        **dict.fromkeys(("length", "duration", "until", "end"), _LENGTH_ADVICE),
        **dict.fromkeys(("loudness", "normalise", "normalize", "gain"), _LOUDNESS),
        "format": "the ending of `file` says it: .wav or .flac",
    },
    "tempo entry": _METERS,
    "phrase": {
        **_LASTS,
        "loop": "a phrase is repeated where it is played: `times: 4` in `strikes`",
        "file": "a file of notes is a take: `takes: {tune: {file: tune.mid}}`, which strikes play "
        "as `play: tune`",
    },
}
