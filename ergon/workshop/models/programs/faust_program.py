"""Points and links as a Faust program, which steps them as the engine does."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from ergon.workshop.models.naming import Names
from ergon.workshop.models.programs.derivative import differentiated
from ergon.workshop.models.programs.elements import Link, Point, SteppedNetwork
from ergon.workshop.models.programs.faust_law import Laws
from ergon.workshop.models.programs.faust_law import number_text as _number

_NO_LETTER = re.compile(r"\W", re.ASCII)


def program(network: SteppedNetwork, program_title: str) -> str:
    """The text of a program: an audio input for each input, an audio output for each output.

    The state of a point is its displacement from its start, and its step minus its first step,
    because a delay of Faust begins at 0.
    """
    return "\n".join(_lines(network, program_title)) + "\n"


def _lines(network: SteppedNetwork, program_title: str) -> Iterator[str]:
    names = Names()
    point_names = [names.new(_word(point.name)) for point in network.points]
    named_points = list(zip(point_names, network.points, strict=True))
    link_names = [names.new(_word(link.name)) for link in network.links]
    laws = Laws()
    law_names = {
        name: laws.function_name(link.law, name)
        for name, link in zip(link_names, network.links, strict=True)
        if link.law is not None
    }
    input_signals = [f"in_{number}" for number in range(1, len(network.inputs) + 1)]
    output_signals = [f"out_{number}" for number in range(1, len(network.outputs) + 1)]
    yield f"// {plain(program_title)}, made by ergon: a network that is stepped sample by sample."
    yield f"// Its numbers hold at {network.rate!r} Hz alone. Compile it with -double."
    for port_kind, names_of_ports in (
        ("input", [port.name for port in network.inputs]),
        ("output", [port.name for port in network.outputs]),
    ):
        yield from (
            f"// {port_kind} {port_number}: {plain(name)}"
            for port_number, name in enumerate(names_of_ports, 1)
        )
    yield from (f"// Left out: {plain(omission)}" for omission in network.omissions)
    yield f'declare name "{plain(program_title)}";'
    yield ""
    for point_name, point in named_points:
        yield from _constant_lines(point_name, point)
    for link_name, model_link in zip(link_names, network.links, strict=True):
        yield from _link_constants(link_name, model_link)
    yield from laws.program_lines()
    yield ""
    yield f"process({', '.join(input_signals)}) = " if input_signals else "process = "
    outputs_by_signal = zip(output_signals, network.outputs, strict=True)
    yield "  " + ",\n  ".join(
        differentiated(signal, output.order, network.rate) for signal, output in outputs_by_signal
    )
    yield "letrec {"
    for point_name, point in named_points:
        if _moves(point):
            yield f"  'u_{point_name} = u_{point_name} + y_{point_name};"
            yield f"  'e_{point_name} = y_{point_name} - D0_{point_name};"
    for output_signal, output in zip(output_signals, network.outputs, strict=True):
        # The force heard is that on the second end of a link.
        terms = [f"(0.0 - f_{link_names[link]})" for link in output.links]
        mixed_points = [point_names[point] for point in output.points]
        # A differentiated signal stood still before it began. Without X0 it is 0 then, as Faust's
        # delays are.
        terms += [
            f"(x_{mixed_point} - X0_{mixed_point})" if output.order else f"x_{mixed_point}"
            for mixed_point in mixed_points
        ]
        yield f"  '{output_signal} = {' + '.join(terms) or '0.0'};"
    yield "where"
    for point_name, point in named_points:
        yield from _state_lines(point_name, point, point_names)
    for link_name, model_link in zip(link_names, network.links, strict=True):
        yield from _force_lines(link_name, model_link, point_names, law_names)
    links_by_point = _links_by_point(network)
    # For each point, the forces that proxies pass to it.
    proxy_forces: list[list[str]] = [[] for _ in point_names]
    for point_index, (point_name, point) in enumerate(named_points):
        if point.shares:
            force_terms = [
                f"{sign} f_{link_names[link]}" for link, sign in links_by_point[point_index]
            ]
            force_terms += [f"+ {input_signals[input_index]}" for input_index in point.force_inputs]
            yield f"  g_{point_name} = 0.0 {' '.join(force_terms)};"
            for mass_index, share in point.shares:
                proxy_forces[mass_index].append(f"+ {share!r}*g_{point_name}")
    for point_index, (point_name, point) in enumerate(named_points):
        if _moves(point):
            terms = [f"{sign} f_{link_names[link]}" for link, sign in links_by_point[point_index]]
            terms += [f"+ {input_signals[input_index]}" for input_index in point.force_inputs]
            terms += [f"+ W_{point_name}"] if point.weight else []
            terms += proxy_forces[point_index]
            yield f"  y_{point_name} = {_step(point_name, point, terms)};"
    yield "};"


def _moves(point: Point) -> bool:
    return bool(point.mass) and point.position_input is None


def _constant_lines(point_name: str, point: Point) -> Iterator[str]:
    yield f"// {plain(point.name)}: {point.comment}"
    yield f"X0_{point_name} = {_number(point.x0)}; // [m] where it starts"
    if _moves(point):
        yield f"D0_{point_name} = {_number(point.d0)}; // [m] its step before it starts"
        if point.weight:
            weight = _number(point.weight)
            yield f"W_{point_name} = {weight}; // [N] a force that never changes"
        yield f"G_{point_name} = {_number(point.gain)}; // [m/N] step for a force"
        if point.kappa or point.zeta:
            yield (
                f"K_{point_name} = {_number(point.kappa)}; // of its way from its rest, in a step"
            )
            yield f"Z_{point_name} = {_number(point.zeta)}; // of its last step"
            yield f"R_{point_name} = {_number(point.rest)}; // [m] its rest"


def _link_constants(link_name: str, link: Link) -> Iterator[str]:
    yield f"// {plain(link.name)}: {plain(link.comment)}"
    if link.law is not None:
        yield f"L_{link_name} = {_number(link.offset)}; // [m]"
        return
    yield (
        f"K_{link_name} = {_number(link.K)}; // [N/m{'' if link.exponent in (None, 1.0) else '^n'}]"
    )
    yield f"Z_{link_name} = {_number(link.z)}; // [N/m] for a step of 1 m"
    yield f"L_{link_name} = {_number(link.offset)}; // [m]"


def _state_lines(point_name: str, point: Point, point_names: Sequence[str]) -> Iterator[str]:
    if point.shares:
        for letter in "xd":
            terms = (
                f"{share!r}*{letter}_{point_names[point_index]}"
                for point_index, share in point.shares
            )
            yield f"  {letter}_{point_name} = {' + '.join(terms)};"
        return
    if point.position_input is not None:
        input_name = f"in_{point.position_input + 1}"
        yield f"  x_{point_name} = {input_name};"
        yield f"  d_{point_name} = ({input_name} - {input_name}') * 1';"
    elif point.mass:
        yield f"  x_{point_name} = X0_{point_name} + u_{point_name};"
        yield f"  d_{point_name} = D0_{point_name} + e_{point_name};"
    else:
        yield f"  x_{point_name} = X0_{point_name};"
        yield f"  d_{point_name} = 0.0;"


def _force_lines(
    link_name: str, link: Link, point_names: Sequence[str], law_names: Mapping[str, str]
) -> Iterator[str]:
    """The force that pulls the first end of a link towards the second."""
    a, b = point_names[link.a], point_names[link.b]
    if link.law is not None:
        per_step = "" if link.law.per_step == 1.0 else f"*{link.law.per_step!r}"
        yield f"  p_{link_name} = x_{b} - x_{a} - L_{link_name};"
        yield f"  f_{link_name} = {law_names[link_name]}(p_{link_name}, (d_{b} - d_{a}){per_step});"
        return
    if link.exponent is None:
        yield (
            f"  f_{link_name} = K_{link_name}*(x_{b} - x_{a} - L_{link_name}) + "
            f"Z_{link_name}*(d_{b} - d_{a});"
        )
        return
    upper_name, lower_name = (a, b) if link.side > 0 else (b, a)
    yield f"  p_{link_name} = x_{upper_name} - x_{lower_name} - L_{link_name};"
    elastic_term = (
        f"p_{link_name}"
        if link.exponent == 1.0
        else f"pow(max(p_{link_name}, 0.0), {link.exponent!r})"
    )
    push_expression = (
        f"K_{link_name}*{elastic_term} + Z_{link_name}*(d_{upper_name} - d_{lower_name})"
    )
    push_expression = f"max({push_expression}, 0.0)" if link.is_clamped else f"({push_expression})"
    sign = "0.0 -" if link.side > 0 else ""
    yield f"  f_{link_name} = {sign} (p_{link_name} > 0.0)*{push_expression};".replace("=  ", "= ")


def _step(point_name: str, point: Point, force_terms: Sequence[str]) -> str:
    step_expression = f"d_{point_name}"
    if point.kappa or point.zeta:
        step_expression += (
            f" - Z_{point_name}*d_{point_name} - K_{point_name}*(x_{point_name} - R_{point_name})"
        )
    return (
        f"{step_expression} + G_{point_name}*(0.0 {' '.join(force_terms)})"
        if force_terms
        else step_expression
    )


def _links_by_point(network: SteppedNetwork) -> list[list[tuple[int, str]]]:
    """The links of each point, and the sign of their force there."""
    links_by_point: list[list[tuple[int, str]]] = [[] for _ in network.points]
    for link_index, link in enumerate(network.links):
        links_by_point[link.a].append((link_index, "+"))
        links_by_point[link.b].append((link_index, "-"))
    return links_by_point


def _word(name: str) -> str:
    """A name of a score as part of a Faust identifier."""
    return _NO_LETTER.sub("_", name)


def plain(text: str) -> str:
    """A text that can end neither a comment nor a string."""
    return "".join(c if c.isprintable() and c not in '"\\' else " " for c in text)
