"""Random scenes of a family and a seed: the same pair gives the same text."""

from collections.abc import Callable
from typing import Any

import yaml

from accuracy.changing_scenes import follow_scene, glide_scene, proxy_scene
from accuracy.contact_scenes import (
    bridge_scene,
    chain_scene,
    few_scene,
    hammer_scene,
    rattle_scene,
    stretch_scene,
)
from accuracy.dice import Dice, Modules
from accuracy.discrete_scenes import discrete_scene
from accuracy.key_scenes import key_scene, keys_scene, rates_scene
from accuracy.law_scenes import bow_scene, bristle_scene, dry_scene, hard_scene, law_scene
from accuracy.linear_scenes import damped_body_scene, linear_scene, mesh_scene

_UNITS = (
    ("M", "kg"),
    ("f", "Hz"),
    ("t60", "s"),
    ("gap", "m"),
    ("rest", "m"),
    ("V0", "m/s"),
    ("X0", "m"),
)


def text(family: str, seed: int) -> str:
    """The score of a scene."""
    dice = Dice(family, seed)
    score: dict[str, Any] = {
        "ergon": 1,
        "title": f"{family}-{seed}",
        "rates": {"audio": f"{dice.choose(32000, 44100, 48000)}Hz"},
        "tempo": [{"at": "1|1", "bpm": 60, "meter": "4/4"}],
        "render": {"bits": "float", "tail": f"{dice.between(0.2, 0.5):.3f}s"},
    }
    instrument: dict[str, Any] = {"modules": {}, "out": {}}
    score["instruments"] = {"s": instrument}
    FAMILIES[family](dice, score, instrument["modules"], instrument["out"])
    for part in score["instruments"].values():
        # Under `units: ca` M is a number of the network.
        units = [pair for pair in _UNITS if pair[0] != "M" or "units" not in part]
        for module in part["modules"].values():
            for fields in module.values():
                bare = [(n, u) for n, u in units if isinstance(fields.get(n), int | float)]
                fields |= {name: f"{fields[name]!r}{unit}" for name, unit in bare}
    for key in score.get("keys", {}).values():
        key |= {"M": f"{key['M']!r}kg"} if "M" in key else {}
    n_out = len(instrument["out"])
    route = [{"from": f"s.{name}", "to": [i + 1]} for i, name in enumerate(instrument["out"])]
    score["mix"] = {"channels": n_out, "route": route}
    return str(yaml.safe_dump(score, sort_keys=False, default_flow_style=None, width=1000))


FAMILIES: dict[str, Callable[[Dice, Modules, Modules, Modules], None]] = {
    "mesh": mesh_scene,
    "body": damped_body_scene,
    "linear": linear_scene,
    "hammer": hammer_scene,
    "bridge": bridge_scene,
    "chain": chain_scene,
    "bow": bow_scene,
    "hard": hard_scene,
    "law": law_scene,
    "dry": dry_scene,
    "bristle": bristle_scene,
    "key": key_scene,
    "few": few_scene,
    "stretch": stretch_scene,
    "rattle": rattle_scene,
    "keys": keys_scene,
    "rates": rates_scene,
    "units-ca": discrete_scene,
    "glide": glide_scene,
    "follow": follow_scene,
    "proxy": proxy_scene,
}
