"""Models of other programs as scores, compared with the interpreters of `oracle`."""

import re
from collections.abc import Mapping

import numpy as np
from imported import rendered
from numpy.typing import NDArray
from oracle import miphysics, pmpd, sam
from planned_sound import ready

from ergon import _core
from ergon.workshop.models.miphysics.reading import parse as miphysics_network
from ergon.workshop.models.miphysics.score import score_text as miphysics_score_text
from ergon.workshop.models.page import Input
from ergon.workshop.models.pmpd.interpreter import network
from ergon.workshop.models.pmpd.reading import parse as pmpd_messages
from ergon.workshop.models.pmpd.score import score_text as pmpd_score_text
from ergon.workshop.models.pmpd.words import Object
from ergon.workshop.models.sam.reading import parse as sam_sheet
from ergon.workshop.models.sam.score import score_text as sam_score_text
from ergon.workshop.models.sam.words import LINKS

RATE = 44_100
Floats = NDArray[np.float64]


def off(sound: Floats, exact: Floats) -> float:
    """The largest error over the largest value of its channel; an absolute error for a channel that
    is 0 throughout.
    """
    sizes = np.abs(exact).max(axis=0)
    return float((np.abs(sound - exact).max(axis=0) / np.where(sizes > 0.0, sizes, 1.0)).max())


# --- Synth-A-Modeler ---


def sam_score(text: str, **given: float) -> str:
    """A model as a score, its ports at 0."""
    return sam_score_text(sam_sheet(text), {}, given, "a model")


def sam_off(text: str, seconds: float, ports: Mapping[str, Floats] = {}) -> float:
    """The largest error of all positions and forces of a model, whether its outputs use them or
    not.

    The signals of `ports` are also written to files of their names.
    """
    text = re.sub(r"^\s*(audioout|display)\b.*$", "", text, flags=re.MULTILINE)
    message = sam_sheet(text).statements
    masses = [one.name for one in message if one.word in ("mass", "resonators")]
    links = [one.name for one in message if one.word in LINKS]
    listened = "".join(
        f"\naudioout,z{index},{name};" for index, name in enumerate([*masses, *links])
    )
    inputs = {name: Input(f"{name}.wav", float(x[0])) for name, x in ports.items()}
    score = sam_score_text(sam_sheet(text + listened), inputs, {}, "a model")
    sound = rendered(score, seconds)
    # A score's file begins at the model's second sample.
    moved = {name: [0.0, *x[:-1]] for name, x in ports.items()}
    exact = sam.played(text, len(sound), moved)
    errors = [off(sound[:, index], exact[name]) for index, name in enumerate(masses)]
    for index, name in enumerate(links, len(masses)):
        # A force is heard a sample early; strikes in the first sample are not forces of a link.
        errors.append(off(sound[1:-1, index], exact[name][2:]))
    assert max(np.ptp(exact[name]) for name in (*masses, *links)) > 1e-5, "nothing moves"
    return max(errors)


# --- pmpd ---


def pmpd_score(text: str, kind: Object | None = None) -> str:
    """A list of messages as a score, its inlets at 0."""
    result, messages = pmpd_messages(text, kind)
    return pmpd_score_text(network(result, messages), {}, "a list")


def pmpd_off(text: str, kind: Object, n_frames: int, inlets: Mapping[str, Floats] = {}) -> float:
    """The largest error of all outputs of a list of messages.

    The signals of `inlets` (in0 …) of pmpd~ are also written to files of their names.
    """
    if kind == "pmpd~":
        result, messages = pmpd_messages(text, kind)
        inputs = {name: Input(f"{name}.wav", float(x[0])) for name, x in inlets.items()}
        score = pmpd_score_text(network(result, messages), inputs, "a list")
        fed = {int(name[2:]): x for name, x in inlets.items()}
        exact = pmpd.audio(text, n_frames, fed)
        assert np.ptp(exact, axis=0).min() > 1e-3, "nothing moves"
        # The first sample of the score is the object's initial state.
        return off(rendered(score, (n_frames + 1) / RATE)[1:], exact)
    built = network(*pmpd_messages(text, kind))
    listened = [at for one in built.requests for at in one.masses]
    exact = pmpd.bangs(text, n_frames)[:, listened]
    return off(rendered(pmpd_score(text, kind), n_frames / RATE), exact)


# --- miPhysics ---


def miphysics_motion(text: str, n_frames: int, rate: int = RATE) -> dict[str, Floats]:
    """Places of all masses of a score, (n, 3) in space and (n, 1) on one axis."""
    network = miphysics_network(text)
    score = miphysics_score_text(network, "a model", rate)
    names = {one.name: one.kind for one in network.masses if not one.kind.startswith("Ground")}
    outs: dict[str, list[str]] = {"space": [], "axis": []}
    for name, kind in names.items():
        is_space = kind.endswith("3D")
        axes = ("x", "y", "z") if is_space else ("",)
        listened = [f"{name}.{axis}".rstrip(".") for axis in axes]
        outs["space" if is_space else "axis"] += listened
    head, *parts = re.split(r"^    out: .*\n", score.split("mix:")[0], flags=re.MULTILINE)
    for where, rest in zip([key for key in outs if outs[key]], parts, strict=True):
        listed = "".join(f"      {where}{i}: {{SOX: {p}}}\n" for i, p in enumerate(outs[where]))
        head += f"    out:\n{listed}{rest}"
    stage = ready(head + "accuracy: {method: ca}\n")
    plan = _core.Plan(stage.network, stage.timeline, method="ca")
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((n_frames, simulation.n_out))
    simulation.process(sound)
    result, position = {}, 0
    for name, kind in sorted(names.items(), key=lambda one: one[1].endswith("1D")):
        n = 3 if kind.endswith("3D") else 1
        result[name] = sound[:, position : position + n] * (1e3 if n == 3 else 1.0)
        position += n
    return result


def miphysics_off(
    text: str, n_frames: int, rate: int = RATE, *, along: bool = False, played_text: str = ""
) -> float:
    """The largest error over the largest displacement of any mass.

    `played_text`: the same model an element a line, where `text` is laid out otherwise.
    """
    result = miphysics_motion(text, n_frames, rate)
    exact = miphysics.played(played_text or text, n_frames, rate, along=along)
    exact = {name: exact[name] if one.shape[1] == 3 else exact[name][:, 2:]
             for name, one in result.items()}  # fmt: skip
    method = max(float(np.ptp(one, axis=0).max()) for one in exact.values())
    assert method > 1e-4, "nothing moves"
    return max(float(np.abs(result[name] - exact[name]).max()) for name in result) / method
