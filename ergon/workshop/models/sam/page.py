"""The rest of a score of a Synth-A-Modeler model, around its modules."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.workshop.models.page import Line, Page
from ergon.workshop.models.sam.network import Start
from ergon.workshop.models.sam.reading import ports
from ergon.workshop.models.sam.words import RATE
from ergon.workshop.models.sam.writing import Writing, target


def page(writing: Writing, score_title: str, start_state: Start, n_channels: int) -> Page:
    """A score that begins as the model does."""
    fed_names = [name for name in ports(writing.sheet) if name in writing.inputs]
    return Page(
        head=_head(writing, score_title),
        parameters=writing.parameters.values(),
        inputs={name: writing.inputs[name] for name in fed_names},
        modules=writing.modules,
        tail=writing.sheet.tail,
        outs=writing.outs,
        n_channels=n_channels,
        before_strikes=[
            "In its first samples the model's masses jump from 0 to where they begin, which its",
            "dampers feel.",
        ],
        strikes=list(_kicks(writing, start_state)),
    )


def _kicks(writing: Writing, begin: Start) -> Iterator[Line]:
    for mass_name, force in begin.kicks.items():
        impulse = f"{force / RATE!r}Ns"
        text = f"{{to: model.{target(writing, mass_name)}, at: 0s, impulse: {impulse}}}"
        yield Line(writing.names.new(f"{writing.targets[mass_name]}_kick"), text)


def _head(writing: Writing, title: str) -> Iterator[str]:
    yield f"From {title or 'a model'}, a model of Synth-A-Modeler."
    yield f"One sample is 1/{RATE} s. M is in kg*fs*fs, K in N/m, Z in N/(m/s)*fs: the numbers of"
    yield "the discrete network."
    unfed_names = [name for name in ports(writing.sheet) if name not in writing.inputs]
    if unfed_names:
        yield f"Where a haptic device was ({_some(unfed_names)}) nothing moves."
        port = unfed_names[0]
        yield f"--feed {port}=FILE.wav moves it. To play it, write a key in place of its SOL:"
        yield f"keys: {{{writing.targets[port]}: {{M: 50g, K: 100N/m, Z: 1Ns/m}}}}"
    if writing.hears_forces:
        yield "Forces are heard one sample before the model's own."
    head_lines = list(writing.sheet.head)
    while head_lines and not head_lines[-1]:
        head_lines.pop()
    if head_lines:
        yield ""
    yield from head_lines


def _some(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
