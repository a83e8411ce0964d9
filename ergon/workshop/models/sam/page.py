"""The rest of a score of a Synth-A-Modeler model, around its modules."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.workshop.models.page import Line, Page
from ergon.workshop.models.sam.network import InitialState
from ergon.workshop.models.sam.reading import ports
from ergon.workshop.models.sam.words import RATE
from ergon.workshop.models.sam.writing import ScoreDraft, target_text


def page(draft: ScoreDraft, score_title: str, initial_state: InitialState, n_channels: int) -> Page:
    """A score that begins as the model does."""
    fed_names = [name for name in ports(draft.sheet) if name in draft.inputs]
    return Page(
        header=_header(draft, score_title),
        parameters=draft.parameters.values(),
        inputs={name: draft.inputs[name] for name in fed_names},
        modules=draft.modules,
        module_comments=draft.sheet.footer,
        outputs=draft.outputs,
        n_channels=n_channels,
        strike_comments=[
            "In its first samples the model's masses jump from 0 to where they begin, which its",
            "dampers feel.",
        ],
        strikes=list(_strikes(draft, initial_state)),
    )


def _strikes(draft: ScoreDraft, initial_state: InitialState) -> Iterator[Line]:
    for mass_name, force in initial_state.forces.items():
        impulse = f"{force / RATE!r}Ns"
        text = f"{{to: model.{target_text(draft, mass_name)}, at: 0s, impulse: {impulse}}}"
        yield Line(draft.names.new(f"{draft.module_names[mass_name]}_kick"), text)


def _header(draft: ScoreDraft, title: str) -> Iterator[str]:
    yield f"From {title or 'a model'}, a model of Synth-A-Modeler."
    yield f"One sample is 1/{RATE} s. M is in kg*fs*fs, K in N/m, Z in N/(m/s)*fs: the numbers of"
    yield "the discrete network."
    unfed_names = [name for name in ports(draft.sheet) if name not in draft.inputs]
    if unfed_names:
        yield f"Where a haptic device was ({_first_names(unfed_names)}) nothing moves."
        port = unfed_names[0]
        yield f"--feed {port}=FILE.wav moves it. To play it, write a key in place of its SOL:"
        yield f"keys: {{{draft.module_names[port]}: {{M: 50g, K: 100N/m, Z: 1Ns/m}}}}"
    if draft.hears_forces:
        yield "Forces are heard one sample before the model's own."
    head_lines = list(draft.sheet.header)
    while head_lines and not head_lines[-1]:
        head_lines.pop()
    if head_lines:
        yield ""
    yield from head_lines


def _first_names(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
