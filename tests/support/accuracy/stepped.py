"""The reference of a score under `units: ca`: its network, stepped by its numbers.

The numbers are those of the discrete network, which is the instrument: no differential equation
stands behind them. `oracle` steps the network in plain loops, without any code of the engine. A key
in SI units is stepped at the same rate, with exactly its pitch and decay.
"""

from typing import Any

import numpy as np
import yaml
from oracle.bodies import string_edges
from oracle.engine import simulate
from oracle.laws import make
from oracle.scene import Link, Mat, Scene

from accuracy.equations import number
from accuracy.reference import Reference

# Between two motions whose starts, strikes and gestures differ by this ratio: what rounding does.
_ROUNDING = 1e-13


def is_stepped(text: str) -> bool:
    """Whether the instruments of a score are discrete networks."""
    instruments = yaml.safe_load(text).get("instruments", {}).values()
    return any(instrument.get("units") == "ca" for instrument in instruments)


def solve(text: str, n_frames: int) -> Reference:
    """The outputs of a scene at its rate, and those of a motion larger by rounding."""
    rate = number(yaml.safe_load(text)["rates"]["audio"])
    exact, other = (simulate(_scene(text, by), rate, n_frames).out for by in (1.0, 1 + _ROUNDING))
    return Reference(exact, other / (1 + _ROUNDING))


def _scene(text: str, size: float) -> Scene:
    """The network and its events, with all that sets it going multiplied by `size`."""
    score = yaml.safe_load(text)
    scene, names = Scene(), {}
    for name, key in score.get("keys", {}).items():
        scene.part(name)
        numbers = {field: number(key[field]) for field in ("M", "K", "Z")}
        names[name] = scene.cel(name, **numbers)
        _play(scene, score, name, scene.key(name, names[name]), size)
    for part, instrument in score["instruments"].items():
        scene.part(part, ca_rate=number(instrument["at"]))
        for name, module in instrument["modules"].items():
            ((kind, fields),) = module.items()
            _module(scene, names, part, name, kind, fields or {}, size)
        for name, output in instrument.get("out", {}).items():
            scene.listen(name, positions=[(_mat(names, part, output["SOX"]), 1.0)])
    for strike in score.get("strikes", {}).values():
        scene.strike(
            names[strike["to"]], number(strike["at"]), impulse=size * number(strike["impulse"])
        )
    return scene


def _mat(names: dict[str, Mat], part: str, name: str) -> Mat:
    inside = f"{part}.{name}"
    return names[inside if inside in names else name]


def _module(
    scene: Scene,
    names: dict[str, Mat],
    part: str,
    name: str,
    kind: str,
    fields: dict[str, Any],
    size: float,
) -> None:
    value = {field: number(fields[field]) for field in fields if _is_number(fields[field])}
    label = f"{part}.{name}"
    start = {field: size * value[field] for field in ("X0", "V0") if field in value}
    if kind == "SOL":
        names[label] = scene.sol(label)
    elif kind == "MAS":
        names[label] = scene.mas(label, M=value["M"], **start)
    elif kind == "CEL":
        names[label] = scene.cel(label, M=value["M"], K=value["K"], Z=value["Z"], **start)
    elif kind == "STRING":
        _string(scene, names, label, fields)
    else:
        a, b = (_mat(names, part, end) for end in fields["between"])
        _link(scene, label, kind, a, b, fields, value, size)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    return isinstance(value, int | float) or (isinstance(value, str) and value[:1].isdigit())


def _string(scene: Scene, names: dict[str, Mat], label: str, fields: dict[str, Any]) -> None:
    """The masses of a string, and a link for each of its edges with the K and Z that it has."""
    n = fields["masses"]
    for i in range(n):
        names[f"{label}.{i}"] = scene.mas(f"{label}.{i}", M=number(fields["M"]) / n)
    ground = scene.sol(f"{label}.ground")
    for k, (i, j, factor) in enumerate(string_edges(n, "fixed", 0.0)):
        ends = (names[f"{label}.{i}"] if i >= 0 else ground, names[f"{label}.{j}"])
        K, Z = (factor * number(fields[field]) for field in ("K", "Z"))
        scene.ref(f"{label}.link{k}", *ends, K=K, Z=Z)


def _link(
    scene: Scene,
    label: str,
    kind: str,
    a: Mat,
    b: Mat,
    fields: dict[str, Any],
    value: dict[str, float],
    size: float,
) -> None:
    if kind in ("REF", "FRO"):
        scene.ref(label, a, b, K=value.get("K", 0.0), Z=value["Z"])
    elif kind == "BUT":
        method = {"plain": "but", "exact": "exact"}[fields.get("contact", "plain")]
        link = Link(method, a, b, value["K"], value["Z"], size * value["gap"], ca=True)
        link.clamp = fields["clamp"]
        scene.lias.append(link)
    else:
        assert (kind, fields["damping"]) == ("LNL", "bow"), f"{kind} is not known here"
        # The law of the oracle slides the other way.
        law = make("bow", F=size * value["F"], a=value["a"], u=-value["u"])
        scene.lnl(label, a, b, law)


def _play(scene: Scene, score: dict[str, Any], name: str, key: int, size: float) -> None:
    """The gestures of a key."""
    for player, events in score.get("parts", {}).items():
        if score["players"][player]["key"] != name:
            continue
        for event in events:
            gesture = score["gestures"][event["play"]]
            words = [word for word in gesture["notation"].split() if word != "smooth"]
            points = [word.split("@") for word in words]
            t = np.array([number(point[1]) for point in points]) + number(event["at"])
            x = [size * number(point[0]) for point in points]
            scene.gesture(key, t, x, ["smooth"] * len(t), touch=gesture["touch"])
