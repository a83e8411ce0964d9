"""What a model can say and no score does yet: a sentence for each, told with its line."""

REFUSED = {
    "late point": (
        "in the first step a point on a macro begins at 0, wherever the macro is: with viscosity "
        "and an x0 other than 0 this gives a push that no score says"
    ),
    "pulling string": (
        "a string with a v0 pulls at its own fixed ends for ever, which no score says; write 0"
    ),
    "signal": (
        "{name} follows a signal, which moves points on macros alone: it "
        "cannot be a {value} of a module"
    ),
    "two signals": "{text} follows two signals; a place follows one",
    "curved": "{text} is not a straight line of its signal, as a place on a macro must be",
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
