"""Features of models that no score can express yet: a sentence for each, reported with its line."""

REFUSED = {
    "pulling string": "a string with a v0 whose Z follows a signal is not built yet; write v0 as 0",
    "signal": "{name} follows a signal, which {value} of this word cannot do in a score",
    "silent mass": (
        "M is {value:g} in the first sample or later, and a mass is above 0; "
        "M follows a signal, which --feed NAME=FILE.wav feeds"
    ),
    "many signals": "{count} values follow signals, and of a law of a score at most {most} do",
    "two signals": "{what}: {text} follows two signals; a value of a score follows one",
    "curved": "{what}: {text} is not a straight line of its signal, as a value of a score must be",
    "macro force": "the force at a point of a macro is 0 at all times; remove this output",
    "pushed force": "the force on a mass that an input pushes too is not built yet",
    "still force": "no link ends on this mass, so that its force is 0; remove this output",
    "both ends": (
        "forces are heard at one end of a link, and another output hears {link} at its other end"
    ),
    "negative": "{name} is {value:g}: below 0 it makes energy, which a score does not allow",
    "no mass": "M is {value:g}: a mass is above 0",
    "far": "{name} is {value:g}: a score holds up to {most:g}",
    "few": "a {keyword} has {least} points or more",
    "scale": "scale is {value:g}: a width is above 0",
}
