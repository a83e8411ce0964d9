"""Models of miPhysics (XML) played step by step, from the equations of its classes alone.

numpy in double precision. It reads correct files only, one element a line.
"""

import re
from typing import Any

import numpy as np

_MASSES = ("Ground3D", "Mass3D", "Ground1D", "Mass1D", "Osc1D")
_LINKS = ("Spring3D", "Damper3D", "SpringDamper3D", "Rope3D", "Bubble3D", "Contact3D")
_KINDS = (*_MASSES, *_LINKS, "PlaneContact3D", "SpringDamper1D")


def played(
    text: str, n_frames: int, rate: float = 44_100.0, *, along: bool = False
) -> dict[str, np.ndarray]:
    """Places of all masses before each step, (n_frames, 3) each.

    miPhysics damps the change of a distance in a step; `along`: the step along the line instead.
    """
    gravity, friction, kind = 0.0, 0.0, ""
    masses: list[tuple[str, dict[str, Any]]] = []
    links: list[tuple[str, dict[str, Any]]] = []
    for line in text.splitlines():
        arguments: dict[str, Any] = dict(re.findall(r'([\w.]+)="([^"]*)"', line))
        tag = re.match(r"\s*<(\w+)", line)
        if tag is None:
            continue
        if tag[1] in _KINDS:
            kind = tag[1]
        elif tag[1] == "gravity":
            gravity = float(arguments["gravity"])
        elif tag[1] == "friction":
            friction = float(arguments["friction"])
        elif tag[1].startswith(("mass_", "interaction_")):
            (masses if tag[1].startswith("mass_") else links).append((kind, arguments))

    def vector(given: dict[str, Any], name: str) -> list[float]:
        return [float(given.get(f"{name}.{axis}", 0.0)) for axis in "xyz"]

    index = {arguments["name"]: i for i, (_, arguments) in enumerate(masses)}
    x = np.array([vector(arguments, "initPos") for _, arguments in masses])
    before = x - np.array([vector(arguments, "initVel") for _, arguments in masses]) / rate
    moves = np.array([not kind.startswith("Ground") for kind, _ in masses])
    from_z = np.array([kind.endswith("1D") for kind, _ in masses])
    inverse = np.array([1.0 / float(arguments.get("mass", 1.0)) for _, arguments in masses])
    tie = np.array([float(arguments.get("stiffness", 0.0)) for _, arguments in masses])
    loss = np.array([float(arguments.get("damping", 0.0)) for _, arguments in masses]) + friction
    home = x.copy()
    home[[kind != "Osc1D" for kind, _ in masses]] = 0.0
    a = np.array([index[arguments["m1"]] for _, arguments in links], int)
    b = np.array([index.get(arguments["m2"], 0) for _, arguments in links], int)
    k, z, rest, plane = (
        np.array([float(arguments.get(name, 0.0)) for _, arguments in links])
        for name in ("stiffness", "damping", "drest", "position")
    )
    axis = np.array([int(arguments.get("orientation", 0)) for _, arguments in links], int)

    def kind_mask(*wanted: str) -> np.ndarray:
        return np.array([one in wanted for one, _ in links], bool)

    is_flat, is_line = kind_mask("PlaneContact3D"), kind_mask("SpringDamper1D")
    pulls, pushes = kind_mask("Rope3D", "Bubble3D"), kind_mask("Contact3D")
    rows = np.arange(len(links))
    places = np.empty((n_frames, len(masses), 3))
    for n in range(n_frames):
        places[n] = x
        forces = np.zeros_like(x)
        if links:
            apart = x[a] - x[b]
            length = np.sqrt((apart**2).sum(1))
            last = np.sqrt(((before[a] - before[b]) ** 2).sum(1))
            if along:
                steps = apart - before[a] + before[b]
                last = length - (steps * apart).sum(1) / np.where(length > 0.0, length, 1.0)
            force = -(length - rest) * k - (length - last) * z
            force[pulls & ~(length > rest) | pushes & ~(length < rest) | is_flat | is_line] = 0.0
            pull = apart / np.where(length > 0.0, length, 1.0)[:, None] * force[:, None]
            line = -((apart[:, 2] - rest) * k + (apart - before[a] + before[b])[:, 2] * z)
            pull[is_line] = 0.0
            pull[is_line, 2] = line[is_line]
            np.add.at(forces, a, pull)
            np.subtract.at(forces, b, pull)
            above = x[a, axis] - plane - rest
            flat = -above * k - (x[a, axis] - before[a, axis]) * z
            met = is_flat & (above < 0.0)
            np.add.at(forces, (a[met], axis[rows[met]]), flat[met])
        y, past = x - home, before - home
        new = (2.0 - inverse * (tie + loss))[:, None] * y - (1.0 - inverse * loss)[:, None] * past
        new += forces * inverse[:, None] + home
        new[:, 2] -= gravity
        new[from_z, :2] = x[from_z, :2]
        new[~moves] = x[~moves]
        x, before = new, x
    return {name: places[:, i] for name, i in index.items()}
