"""A model as a score under `units: ca`, which sounds the same sample for sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations

from ergon.models import places
from ergon.models.errors import ModelError
from ergon.models.grammar import MESHES, NAMES, STRINGS
from ergon.models.kicks import Begin, kick
from ergon.models.laws import LINKS, Laws, Link, which
from ergon.models.model import Model, Point, Statement
from ergon.models.naming import Names, Params, metres
from ergon.models.page import RATE, Input, Line, Out, Page, gain, number
from ergon.models.proxies import Along, along, moving, signals_in, still
from ergon.models.refused import REFUSED
from ergon.notation.text.errors import quote

_FARTHEST, _FASTEST = 1e3, 1e6  # [m], [m/s] of a score
_HELD = "1e9"  # mass of what is moved whatever pushes it: no link is too stiff for it


@dataclass(slots=True)
class _Writing:
    """A score in the making."""

    model: Model
    laws: Laws
    inputs: Mapping[str, Input]
    params: Params
    names: Names = field(default_factory=Names)
    modules: list[Line] = field(default_factory=list)
    targets: dict[str, str] = field(default_factory=dict)  # of masses
    macros: dict[str, places.Macro] = field(default_factory=dict)
    links: list[tuple[Statement, str]] = field(default_factory=list)  # with the module's name
    outs: list[Out] = field(default_factory=list)
    begins: dict[str, Begin] = field(default_factory=dict)  # of masses and inputs
    held: set[str] = field(default_factory=set)  # what no force moves
    kicks: dict[str, float] = field(default_factory=dict)  # forces in the first sample
    proxies: dict[tuple[object, ...], str] = field(default_factory=dict)  # by where they are
    guides: dict[str, str] = field(default_factory=dict)  # what has the value of a signal

    def add(self, name: str, text: str, comment: str = "") -> None:
        """A module."""
        self.modules.append(Line(name, f"{{{text}}}", comment))

    def text(self, one: Statement, name: str, default: str = "0") -> str:
        """A value as an expression of the score."""
        expression = one.values.get(name, default)
        for signal in signals_in(self.model, expression):
            message = REFUSED["signal"].format(name=quote(signal), value=name)
            raise ModelError(message, one.line)
        return self.params.written(expression)

    def value(self, one: Statement, name: str, default: float = 0.0) -> float:
        """A value as a number."""
        self.text(one, name)
        return self.model.value(one, name, default)


def written(
    model: Model, laws: Laws = "head", inputs: Mapping[str, Input] | None = None, title: str = ""
) -> str:
    """The text of a score that sounds as a model. Raises ModelError with the line at fault.

    `laws`: those that mi-gen had in 2019, for which older models were made, or today's.
    """
    params = (one.name for one in model.of("param") if one.name not in model.signals)
    own = _Writing(model, laws, inputs or {}, Params(params))
    try:
        for one in model.of("mass", "macro", "input"):
            _MAKERS[one.keyword](own, one)
        for one in model.of("input"):
            _push(own, one)
        heard = _heard_ends(own)
        for one in model.of("link"):
            _link(own, one, heard)
        for one in model.of("output"):
            _output(own, one)
    except ModelError as error:
        error.file = model.file
        raise
    for macro in own.macros.values():
        if macro.is_joined:
            place = "" if macro.height == "0" else f"X0: {metres(macro.height)}"
            own.add(macro.edge, f"SOL: {{{place}}}", f"the fixed points of {macro.name}")
    return _page(own, title).written()


# --- masses -------------------------------------------------------------------------------------


def _start(own: _Writing, one: Statement, k: float = 0.0, z: float = 0.0) -> tuple[str, str]:
    """X0 and V0: a score begins where the model is after its first step, in which no link acts."""
    mass, gravity = own.value(one, "M", 1.0), _gravity(own, one)
    x0 = own.value(one, "x0")
    before = x0 - own.value(one, "v0") / RATE
    if "before" in one.values:
        before = own.value(one, "before")
    first = (2.0 - (k + z) / mass) * x0 + (z / mass - 1.0) * before - gravity / mass
    _within(one, "x0", first, _FARTHEST)
    _within(one, "the first step", (first - x0) * RATE, _FASTEST)
    own.begins[one.name] = Begin(first, first - x0)
    if first == x0:
        return (f"X0: {metres(own.text(one, 'x0'))}" if x0 else ""), ""
    return (f"X0: {first!r}m" if first else ""), f"V0: {(first - x0) * RATE!r}m/s"


def _within(one: Statement, name: str, value: float, most: float) -> None:
    if not abs(value) <= most:
        raise ModelError(REFUSED["far"].format(name=name, value=value, most=most), one.line)


def _mass(own: _Writing, one: Statement) -> None:
    name = own.targets[one.name] = own.names.new(one.name)
    if one.keyword == "ground":
        x0 = own.value(one, "x0")
        _within(one, "x0", x0, _FARTHEST)
        own.begins[one.name] = Begin(x0)
        own.held.add(name)
        own.add(name, f"SOL: {{X0: {metres(own.text(one, 'x0'))}}}" if x0 else "SOL: {}")
        return
    _heavy(own, one)
    ties = [value for value in ("K", "Z") if value in one.values]
    for tie in ties:
        _not_negative(own, one, tie)
    k, z = own.value(one, "K"), own.value(one, "Z")
    fields = [f"{value}: {own.text(one, value)}" for value in ("M", *ties)]
    fields += [text for text in _start(own, one, k, z) if text]
    own.add(name, f"{'CEL' if ties else 'MAS'}: {{{', '.join(fields)}}}")
    if gravity := _gravity(own, one):
        weight = own.names.new(f"{name}_weight")
        own.add(weight, f"ENF: {{to: {name}, from: {-gravity!r}N}}", f"gravity {gravity:g}")


def _gravity(own: _Writing, one: Statement) -> float:
    text = one.values.get("gravity")
    if text is None or own.model.dialect == "v1":
        return own.value(one, "gravity")
    # mi-gen writes its factor behind the text, and so divides only b of a + b.
    what = f"gravity of {quote(one.name)}"
    return own.model.number(f"{text}/{RATE}", what, one.line)


def _heavy(own: _Writing, one: Statement) -> None:
    mass = own.value(one, "M")
    if mass <= 0.0:
        raise ModelError(REFUSED["no mass"].format(value=mass), one.line)


def _not_negative(own: _Writing, one: Statement, name: str) -> None:
    value = own.value(one, name)
    if value < 0.0:
        raise ModelError(REFUSED["negative"].format(name=name, value=value), one.line)


def _macro(own: _Writing, one: Statement) -> None:
    _heavy(own, one)
    ties = [name for name in ("K", "K2", "Z", "Zo") if name in one.values]
    for name in ties:
        _not_negative(own, one, name)
    if one.keyword in ("string", "stiffString") and own.value(one, "v0"):
        raise ModelError(REFUSED["pulling string"], one.line)
    rows, columns = places.size(one)
    name = own.names.new(one.name)
    x0 = own.value(one, "x0")
    _within(one, "x0", x0, _FARTHEST)
    macro = own.macros[one.name] = places.Macro(
        one,
        name,
        rows,
        columns,
        {value: own.text(one, value) for value in ("M", *ties)},
        _start(own, one, 0.0, own.value(one, "Zo")),
        own.text(one, "x0") if x0 else "0",
        own.names.new(f"{name}_edge"),
    )
    own.held.add(macro.edge)
    places.build(macro, own.laws == "2019")
    for nth, (module, text) in enumerate(macro.modules):
        own.names.taken.add(module)
        own.add(module, text, "" if nth else f"{one.keyword} of {rows * columns} points")


def _input(own: _Writing, one: Statement) -> None:
    if one.keyword == "frcInput":
        return
    fed = own.inputs.get(one.name)
    name = own.targets[one.name] = _fed(own, one.name, one.name)
    first = 0.0 if fed is None else fed.first
    own.held.add(name)
    own.begins[one.name] = Begin(first, jump=first - own.value(one, "x0"))


def _fed(own: _Writing, wanted: str, source: str) -> str:
    """A point that has the values of an input; its name."""
    fed, name = own.inputs.get(source), own.names.new(wanted)
    if fed is None:
        own.add(name, "SOL: {}", "an input that nothing is connected to is 0")
        return name
    x0 = "" if fed.first == 0.0 else f", X0: {fed.first!r}m"
    own.add(name, f"MAS: {{M: {_HELD}{x0}}}", "its mass says nothing, for its path is imposed")
    path = own.names.new(f"{name}_path")
    own.add(path, f"ENX: {{to: {name}, from: {source}, at: 0s}}")
    return name


def _push(own: _Writing, one: Statement) -> None:
    if one.keyword != "frcInput":
        return
    for share, target in _points(own, one, one.points[0]):
        if one.name in own.inputs:
            name = own.names.new(f"{one.name}_push")
            scale = "" if share == 1.0 else f", scale: {share!r}"
            own.add(name, f"ENF: {{to: {target}, from: {one.name}, at: 0s{scale}}}")


_MAKERS = {
    **dict.fromkeys(("ground", "mass", "massG", "osc"), _mass),
    **dict.fromkeys(STRINGS + MESHES, _macro),
    **dict.fromkeys(("posInput", "frcInput"), _input),
}


# --- links --------------------------------------------------------------------------------------


def _points(own: _Writing, one: Statement, point: Point) -> list[tuple[float, str]]:
    """What a point is: a module, or members of a macro with the share of each."""
    macro = own.macros.get(point.name)
    if macro is None:
        return [(1.0, own.targets[point.name])]
    sides = along(own.model, point, one.line)
    if any(side.signal for side in sides):
        return [(1.0, _moving(own, macro, sides))]
    return _shares(own, one, point)


def _shares(own: _Writing, one: Statement, point: Point) -> list[tuple[float, str]]:
    """The masses that feel what happens at a point in the first step."""
    macro = own.macros.get(point.name)
    if macro is None:
        return [(1.0, own.targets[point.name])]
    firsts = {
        signal: own.inputs[source].first if source in own.inputs else 0.0
        for signal, source in own.model.signals.items()
    }
    sides = [
        side.start + side.slope * firsts.get(side.signal or "", 0.0)
        for side in along(own.model, point, one.line)
    ]
    return macro.points(sides, is_2019=own.laws == "2019", line=one.line)


def _moving(own: _Writing, macro: places.Macro, sides: list[Along]) -> str:
    """A point that signals move; its name."""
    guides = []
    for side in sides:
        known = side.signal or f"a place at {side.start!r}"
        if known not in own.guides and side.signal:
            own.guides[known] = _fed(own, known, own.model.signals[known])
        elif known not in own.guides:
            own.guides[known] = own.names.new(f"{macro.name}_place")
            own.add(own.guides[known], f"SOL: {{X0: {side.start!r}m}}")
        guides.append(own.guides[known])
    key = (macro.name, *sides)
    if key not in own.proxies:
        own.proxies[key] = own.names.new(f"{macro.name}_point")
        text = moving(macro, sides, guides, is_2019=own.laws == "2019")
        own.add(own.proxies[key], text, f"a point of {macro.name}, which a signal moves")
    return own.proxies[key]


def _still(own: _Writing, point: Point, shares: list[tuple[float, str]]) -> str:
    """A point between masses; its name."""
    key = tuple(shares)
    if key not in own.proxies:
        own.proxies[key] = own.names.new(f"{own.macros[point.name].name}_point")
        own.add(own.proxies[key], still(shares), f"a point of {point.name}")
    return own.proxies[key]


def _link(own: _Writing, one: Statement, heard: Mapping[int, str]) -> None:
    values = {name: own.value(one, name) for name in one.values}
    law = LINKS[own.laws][which(one.keyword, values)]
    points = [_points(own, one, point) for point in one.points]
    signed = ("K", "Z") if law.kind != "LNL" else ("Q",) if "sqrt" in law.law else ()
    for name in signed:
        _not_negative(own, one, name)
    if "scale" in values and values["scale"] <= 0.0:
        raise ModelError(REFUSED["scale"].format(value=values["scale"]), one.line)
    twice = own.model.dialect == "v1" and one.keyword == "nlSpring3"
    if law.damping or values.get("Z"):
        _first_step(own, one)
        felt = [_shares(own, one, point) for point in one.points]
        a, b = (_begin(own, *end) for end in zip(one.points, felt, strict=True))
        force = kick(law, values, a, b)
        _strike(own, felt, 2.0 * force if twice else force)
    share = "2*" if twice else ""
    fields = {}
    for letter, name in law.fields.items():
        text = own.text(one, name)
        fields[letter] = f"{share}({text})" if twice else text
    if law.kind in ("LNL", "BUT"):
        ends_of = zip(one.points, points, strict=True)
        points = [
            [(1.0, _still(own, point, shares))] if len(shares) > 1 else shares
            for point, shares in ends_of
        ]
    if max(map(len, points)) > 1:
        _between(own, one, law, points, heard.get(id(one), ""))
        return
    ends = [targets[0][1] for targets in points]
    side = ""
    if heard.get(id(one)) == one.points[0].name:  # its force on the first end is heard
        ends.reverse()
        side = ", side: above" if law.kind == "BUT" else ""
        if not law.turns and law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(one.name))
            raise ModelError(message, one.line)
    said = [f"between: [{', '.join(ends)}]"]
    for word, text in (("law", law.law), ("damping", law.damping)):
        said += [f'{word}: "{text}"'] if text else []
    said += [f"{letter}: {text}" for letter, text in fields.items()]
    if law.rest:
        said += [f"rest: {metres(own.text(one, law.rest))}"] if law.rest in values else []
    if law.kind == "BUT" and values.get("thresh"):
        said.append("gap: " + metres(f"-({own.text(one, 'thresh')})"))
    name = own.names.new(one.name)
    own.links.append((one, name))
    comment = "MIMS adds the force of its nlSpring3 twice" if twice else ""
    own.add(name, f"{law.kind}: {{{', '.join(said)}{side}}}", comment)


def _between(
    own: _Writing, one: Statement, law: Link, points: list[list[tuple[float, str]]], heard: str
) -> None:
    """A spring between points between masses, as springs between any two of these masses.

    Its force K·Σcx, with c the share of a mass in the first point less that in the second, is
    divided by the same shares: -c_i·K·Σcx is the sum of springs -c_i·c_j·K, for the c add up to 0.
    """
    shares: dict[str, float] = {}
    for sign, targets in zip((1.0, -1.0), points, strict=True):
        for share, target in targets:
            shares[target] = shares.get(target, 0.0) + sign * share
    whose = own.targets.get(heard)
    comment = f"{one.keyword} of {quote(one.name)}, between masses"
    for (p, a), (q, b) in combinations(shares.items(), 2):
        ends = [q, p] if p == whose else [p, q]  # a force is heard at the second end
        name = own.names.new(one.name)
        if not heard or whose in (p, q):
            own.links.append((one, name))
        fields = {tie: f"{-a * b!r}*({own.text(one, tie)})" for tie in law.fields}
        said = ", ".join(f"{tie}: {text}" for tie, text in fields.items())
        kind = law.kind
        if a * b > 0.0:  # below 0, as no spring is by itself; all of them together are none
            kind = "LNL"
            law_of = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
            laws = [law_of[tie] for tie in fields]
            said = ", ".join([*laws, *(f"{tie.lower()}: {text}" for tie, text in fields.items())])
        own.add(name, f"{kind}: {{between: [{', '.join(ends)}], {said}}}", comment)
        comment = ""


def _first_step(own: _Writing, one: Statement) -> None:
    """What a damper feels before the first step is what a score's does."""
    for point in one.points:
        macro = own.macros.get(point.name)
        if macro is not None and macro.height != "0":
            raise ModelError(REFUSED["late point"], one.line)


def _begin(own: _Writing, point: Point, targets: list[tuple[float, str]]) -> Begin:
    begin = own.begins[point.name]
    if point.name in own.macros:  # its fixed points stand still
        moving = sum(share for share, target in targets if target not in own.held)
        return Begin(0.0, moving * begin.step)
    return begin


def _strike(own: _Writing, points: list[list[tuple[float, str]]], force: float) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for sign, targets in zip((force, -force), points, strict=True):
        for share, target in targets:
            if force and target not in own.held:
                own.kicks[target] = own.kicks.get(target, 0.0) + sign * share


# --- what is heard ------------------------------------------------------------------------------


def _ending(own: _Writing, name: str) -> Iterator[Statement]:
    return (one for one in own.model.of("link") if any(point.name == name for point in one.points))


def _heard_ends(own: _Writing) -> dict[int, str]:
    """Links of which a force is heard, and the mass on which it is. Raises ModelError."""
    heard: dict[int, str] = {}
    for one in own.model.of("output"):
        name = one.points[0].name
        if one.keyword != "frcOutput":
            continue
        if name in own.macros:
            raise ModelError(REFUSED["macro force"], one.line)
        pushes = (i for i in own.model.of("input") if i.name in own.inputs)
        if any(point.name == name for push in pushes for point in push.points):
            raise ModelError(REFUSED["pushed force"], one.line)
        links = list(_ending(own, name))
        if not links:
            raise ModelError(REFUSED["still force"], one.line)
        for link in links:
            if heard.setdefault(id(link), name) != name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, one.line)
    return heard


def _output(own: _Writing, one: Statement) -> None:
    channel = int(one.name.removeprefix("out"))
    if one.keyword == "posOutput":
        points = _points(own, one, one.points[0])
        for nth, (share, target) in enumerate(points, 1):
            name = one.name if len(points) == 1 else f"{one.name}_{nth}"
            own.outs.append(Out(name, f"SOX: {target}", channel, gain(share)))
        return
    mass = one.points[0].name
    of = [name for link, name in own.links if any(p.name == mass for p in link.points)]
    kinds = {each.name: each.kind for each in own.modules}
    for nth, name in enumerate(of, 1):
        out = one.name if len(of) == 1 else f"{one.name}_{nth}"
        own.outs.append(Out(out, f"SOF: {{{kinds[name]}: {name}}}", channel))


# --- text ---------------------------------------------------------------------------------------


def _page(own: _Writing, title: str) -> Page:
    model = own.model
    of = "2019" if own.laws == "2019" else "today"
    params = {one.name: float(model.params[one.name].number) for one in model.of("param")}
    params = {name: value for name, value in params.items() if name not in model.signals}
    fed = [name for name in model.inputs if name in own.inputs]
    return Page(
        head=[
            f"From {title or 'a model'}, in the language of {NAMES[model.dialect]}, laws of {of}.",
            f"One sample is 1/{RATE} s; the numbers are those of the discrete network.",
        ],
        parameters=[Line(own.params.of[name], number(value)) for name, value in params.items()],
        inputs={name: own.inputs[name] for name in fed},
        modules=own.modules,
        outs=own.outs,
        before_strikes=["An input jumps to its first value, which the model's dampers feel."],
        strikes=list(_strikes(own)),
    )


def _strikes(own: _Writing) -> Iterator[Line]:
    for target, force in own.kicks.items():
        name = own.names.new(f"{target.replace('.', '_')}_kick")
        yield Line(name, f"{{to: model.{target}, at: 0s, impulse: {force / RATE!r}Ns}}")
