"""Points and links as a Faust program, which steps them as the engine does."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from ergon.workshop.models.naming import Names
from ergon.workshop.models.programs.derivative import differentiated
from ergon.workshop.models.programs.elements import Link, Point, Stepped
from ergon.workshop.models.programs.faust_law import Laws
from ergon.workshop.models.programs.faust_law import number as _number

_NO_LETTER = re.compile(r"\W", re.ASCII)


def program(network: Stepped, program_title: str) -> str:
    """The text of a program: an audio input for each input, an audio output for each output.

    The state of a point is its displacement from its start, and its step minus its first step,
    because a delay of Faust begins at 0.
    """
    return "\n".join(_lines(network, program_title)) + "\n"


def _lines(network: Stepped, program_title: str) -> Iterator[str]:
    names = Names()
    point_words = [names.new(_word(point.name)) for point in network.points]
    link_words = [names.new(_word(link.name)) for link in network.links]
    laws = Laws()
    law_names = {
        word: laws.name(link.law, word)
        for word, link in zip(link_words, network.links, strict=True)
        if link.law is not None
    }
    input_names = [f"in_{number}" for number in range(1, len(network.inputs) + 1)]
    output_names = [f"out_{number}" for number in range(1, len(network.outputs) + 1)]
    yield f"// {plain(program_title)}, made by ergon: a network that is stepped sample by sample."
    yield f"// Its numbers hold at {network.rate!r} Hz alone. Compile it with -double."
    for section_kind, section_words in (
        ("input", [port.name for port in network.inputs]),
        ("output", [port.name for port in network.outputs]),
    ):
        yield from (
            f"// {section_kind} {number}: {plain(word)}"
            for number, word in enumerate(section_words, 1)
        )
    yield from (f"// Left out: {plain(port)}" for port in network.left_out)
    yield f'declare name "{plain(program_title)}";'
    yield ""
    for point_word, mass_point in zip(point_words, network.points, strict=True):
        yield from _constants(point_word, mass_point)
    for point_word, model_link in zip(link_words, network.links, strict=True):
        yield from _link_constants(point_word, model_link)
    yield from laws.written()
    yield ""
    yield f"process({', '.join(input_names)}) = " if input_names else "process = "
    named_outputs = zip(output_names, network.outputs, strict=True)
    yield "  " + ",\n  ".join(differentiated(w, o.order, network.rate) for w, o in named_outputs)
    yield "letrec {"
    for point_word, mass_point in zip(point_words, network.points, strict=True):
        if _moves(mass_point):
            yield f"  'u_{point_word} = u_{point_word} + y_{point_word};"
            yield f"  'e_{point_word} = y_{point_word} - D0_{point_word};"
    for point_word, port in zip(output_names, network.outputs, strict=True):
        # The force heard is that on the second end of a link.
        terms = [f"(0.0 - f_{link_words[link]})" for link in port.links]
        output_words = [point_words[point] for point in port.points]
        # A differentiated signal stood still before it began. Without X0 it is 0 then, as Faust's
        # delays are.
        terms += [
            f"(x_{output} - X0_{output})" if port.order else f"x_{output}"
            for output in output_words
        ]
        yield f"  '{point_word} = {' + '.join(terms) or '0.0'};"
    yield "where"
    for point_word, mass_point in zip(point_words, network.points, strict=True):
        yield from _state(point_word, mass_point, point_words)
    for point_word, model_link in zip(link_words, network.links, strict=True):
        yield from _force(point_word, model_link, point_words, law_names)
    links_by_point = _ends(network)
    passed: list[list[str]] = [[] for _ in point_words]  # forces that proxies pass to their masses
    for item_number, (point_word, mass_point) in enumerate(
        zip(point_words, network.points, strict=True)
    ):
        if mass_point.shares:
            force_terms = [
                f"{sign} f_{link_words[link]}" for link, sign in links_by_point[item_number]
            ]
            force_terms += [f"+ {input_names[number]}" for number in mass_point.forces]
            yield f"  g_{point_word} = 0.0 {' '.join(force_terms)};"
            for mass_index, share in mass_point.shares:
                passed[mass_index].append(f"+ {share!r}*g_{point_word}")
    for item_number, (point_word, mass_point) in enumerate(
        zip(point_words, network.points, strict=True)
    ):
        if _moves(mass_point):
            terms = [f"{sign} f_{link_words[link]}" for link, sign in links_by_point[item_number]]
            terms += [f"+ {input_names[number]}" for number in mass_point.forces]
            terms += [f"+ W_{point_word}"] if mass_point.weight else []
            terms += passed[item_number]
            yield f"  y_{point_word} = {_step(point_word, mass_point, terms)};"
    yield "};"


def _moves(point: Point) -> bool:
    return bool(point.mass) and point.fed is None


def _constants(point_word: str, mass_point: Point) -> Iterator[str]:
    yield f"// {plain(mass_point.name)}: {mass_point.comment}"
    yield f"X0_{point_word} = {_number(mass_point.x0)}; // [m] where it starts"
    if _moves(mass_point):
        yield f"D0_{point_word} = {_number(mass_point.d0)}; // [m] its step before it starts"
        if mass_point.weight:
            weight = _number(mass_point.weight)
            yield f"W_{point_word} = {weight}; // [N] a force that never changes"
        yield f"G_{point_word} = {_number(mass_point.gain)}; // [m/N] step for a force"
        if mass_point.kappa or mass_point.zeta:
            yield (
                f"K_{point_word} = {_number(mass_point.kappa)}; // of its way from its rest, in a "
                "step"
            )
            yield f"Z_{point_word} = {_number(mass_point.zeta)}; // of its last step"
            yield f"R_{point_word} = {_number(mass_point.rest)}; // [m] its rest"


def _link_constants(link_word: str, model_link: Link) -> Iterator[str]:
    yield f"// {plain(model_link.name)}: {plain(model_link.comment)}"
    if model_link.law is not None:
        yield f"L_{link_word} = {_number(model_link.offset)}; // [m]"
        return
    yield (
        f"K_{link_word} = {_number(model_link.K)}; // "
        f"[N/m{'' if model_link.exponent in (None, 1.0) else '^n'}]"
    )
    yield f"Z_{link_word} = {_number(model_link.z)}; // [N/m] for a step of 1 m"
    yield f"L_{link_word} = {_number(model_link.offset)}; // [m]"


def _state(point_word: str, mass_point: Point, point_words: Sequence[str]) -> Iterator[str]:
    if mass_point.shares:
        for letter in "xd":
            terms = (
                f"{share!r}*{letter}_{point_words[point_index]}"
                for point_index, share in mass_point.shares
            )
            yield f"  {letter}_{point_word} = {' + '.join(terms)};"
        return
    if mass_point.fed is not None:
        input_name = f"in_{mass_point.fed + 1}"
        yield f"  x_{point_word} = {input_name};"
        yield f"  d_{point_word} = ({input_name} - {input_name}') * 1';"
    elif mass_point.mass:
        yield f"  x_{point_word} = X0_{point_word} + u_{point_word};"
        yield f"  d_{point_word} = D0_{point_word} + e_{point_word};"
    else:
        yield f"  x_{point_word} = X0_{point_word};"
        yield f"  d_{point_word} = 0.0;"


def _force(
    link_word: str, model_link: Link, point_words: Sequence[str], laws: Mapping[str, str]
) -> Iterator[str]:
    """The force that pulls the first end of a link towards the second."""
    a, b = point_words[model_link.a], point_words[model_link.b]
    if model_link.law is not None:
        per_step = "" if model_link.law.per_step == 1.0 else f"*{model_link.law.per_step!r}"
        yield f"  p_{link_word} = x_{b} - x_{a} - L_{link_word};"
        yield f"  f_{link_word} = {laws[link_word]}(p_{link_word}, (d_{b} - d_{a}){per_step});"
        return
    if model_link.exponent is None:
        yield (
            f"  f_{link_word} = K_{link_word}*(x_{b} - x_{a} - L_{link_word}) + "
            f"Z_{link_word}*(d_{b} - d_{a});"
        )
        return
    first_word, second_word = (a, b) if model_link.side > 0 else (b, a)
    yield f"  p_{link_word} = x_{first_word} - x_{second_word} - L_{link_word};"
    penetration_power = (
        f"p_{link_word}"
        if model_link.exponent == 1.0
        else f"pow(max(p_{link_word}, 0.0), {model_link.exponent!r})"
    )
    push = f"K_{link_word}*{penetration_power} + Z_{link_word}*(d_{first_word} - d_{second_word})"
    push = f"max({push}, 0.0)" if model_link.is_clamped else f"({push})"
    sign = "0.0 -" if model_link.side > 0 else ""
    yield f"  f_{link_word} = {sign} (p_{link_word} > 0.0)*{push};".replace("=  ", "= ")


def _step(point_word: str, point: Point, terms: Sequence[str]) -> str:
    step_word = f"d_{point_word}"
    if point.kappa or point.zeta:
        step_word += (
            f" - Z_{point_word}*d_{point_word} - K_{point_word}*(x_{point_word} - R_{point_word})"
        )
    return f"{step_word} + G_{point_word}*(0.0 {' '.join(terms)})" if terms else step_word


def _ends(network: Stepped) -> list[list[tuple[int, str]]]:
    """The links of each point, and the sign of their force there."""
    links_by_point: list[list[tuple[int, str]]] = [[] for _ in network.points]
    for number, link in enumerate(network.links):
        links_by_point[link.a].append((number, "+"))
        links_by_point[link.b].append((number, "-"))
    return links_by_point


def _word(name: str) -> str:
    """A name of a score as part of a Faust identifier."""
    return _NO_LETTER.sub("_", name)


def plain(text: str) -> str:
    """A text that can end neither a comment nor a string."""
    return "".join(c if c.isprintable() and c not in '"\\' else " " for c in text)
