"""Points and links as a Faust program, which steps them as the engine does."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from ergon.workshop.models.naming import Names
from ergon.workshop.models.programs.derivative import differentiated
from ergon.workshop.models.programs.faust_law import Laws
from ergon.workshop.models.programs.faust_law import number as _number
from ergon.workshop.models.programs.network import Link, Point, Stepped

_NO_LETTER = re.compile(r"\W", re.ASCII)


def program(network: Stepped, title: str) -> str:
    """The text of a program: an audio input for each input, an audio output for each output.

    The state of a point is its displacement from its start, and its step minus its first step,
    because a delay of Faust begins at 0.
    """
    return "\n".join(_lines(network, title)) + "\n"


def _lines(network: Stepped, title: str) -> Iterator[str]:
    names = Names()
    point_words = [names.new(_word(point.name)) for point in network.points]
    link_words = [names.new(_word(link.name)) for link in network.links]
    laws = Laws()
    law_names = {
        word: laws.name(link.law, word)
        for word, link in zip(link_words, network.links, strict=True)
        if link.law is not None
    }
    inputs = [f"in_{number}" for number in range(1, len(network.inputs) + 1)]
    outputs = [f"out_{number}" for number in range(1, len(network.outputs) + 1)]
    yield f"// {plain(title)}, made by ergon: a network that is stepped sample by sample."
    yield f"// Its numbers hold at {network.rate!r} Hz alone. Compile it with -double."
    for kind, words in (
        ("input", [port.name for port in network.inputs]),
        ("output", [port.name for port in network.outputs]),
    ):
        yield from (f"// {kind} {number}: {plain(word)}" for number, word in enumerate(words, 1))
    yield from (f"// Left out: {plain(port)}" for port in network.left_out)
    yield f'declare name "{plain(title)}";'
    yield ""
    for word, point in zip(point_words, network.points, strict=True):
        yield from _constants(word, point)
    for word, link in zip(link_words, network.links, strict=True):
        yield from _link_constants(word, link)
    yield from laws.written()
    yield ""
    yield f"process({', '.join(inputs)}) = " if inputs else "process = "
    named_outputs = zip(outputs, network.outputs, strict=True)
    yield "  " + ",\n  ".join(differentiated(w, o.order, network.rate) for w, o in named_outputs)
    yield "letrec {"
    for word, point in zip(point_words, network.points, strict=True):
        if _moves(point):
            yield f"  'u_{word} = u_{word} + y_{word};"
            yield f"  'e_{word} = y_{word} - D0_{word};"
    for word, port in zip(outputs, network.outputs, strict=True):
        # The force heard is that on the second end of a link.
        terms = [f"(0.0 - f_{link_words[link]})" for link in port.links]
        output_words = [point_words[point] for point in port.points]
        # A differentiated signal stood still before it began. Without X0 it is 0 then, as Faust's
        # delays are.
        terms += [
            f"(x_{output} - X0_{output})" if port.order else f"x_{output}"
            for output in output_words
        ]
        yield f"  '{word} = {' + '.join(terms) or '0.0'};"
    yield "where"
    for word, point in zip(point_words, network.points, strict=True):
        yield from _state(word, point, point_words)
    for word, link in zip(link_words, network.links, strict=True):
        yield from _force(word, link, point_words, law_names)
    links_by_point = _ends(network)
    passed: list[list[str]] = [[] for _ in point_words]  # to masses of proxies
    for number, (word, point) in enumerate(zip(point_words, network.points, strict=True)):
        if point.shares:
            force_terms = [f"{sign} f_{link_words[link]}" for link, sign in links_by_point[number]]
            force_terms += [f"+ {inputs[number]}" for number in point.forces]
            yield f"  g_{word} = 0.0 {' '.join(force_terms)};"
            for mass_index, share in point.shares:
                passed[mass_index].append(f"+ {share!r}*g_{word}")
    for number, (word, point) in enumerate(zip(point_words, network.points, strict=True)):
        if _moves(point):
            terms = [f"{sign} f_{link_words[link]}" for link, sign in links_by_point[number]]
            terms += [f"+ {inputs[number]}" for number in point.forces]
            terms += [f"+ W_{word}"] if point.weight else []
            terms += passed[number]
            yield f"  y_{word} = {_step(word, point, terms)};"
    yield "};"


def _moves(point: Point) -> bool:
    return bool(point.mass) and point.fed is None


def _constants(word: str, point: Point) -> Iterator[str]:
    yield f"// {plain(point.name)}: {point.comment}"
    yield f"X0_{word} = {_number(point.x0)}; // [m] where it starts"
    if _moves(point):
        yield f"D0_{word} = {_number(point.d0)}; // [m] its step before it starts"
        if point.weight:
            yield f"W_{word} = {_number(point.weight)}; // [N] a force that never changes"
        yield f"G_{word} = {_number(point.gain)}; // [m/N] step for a force"
        if point.kappa or point.zeta:
            yield f"K_{word} = {_number(point.kappa)}; // of its way from its rest, in a step"
            yield f"Z_{word} = {_number(point.zeta)}; // of its last step"
            yield f"R_{word} = {_number(point.rest)}; // [m] its rest"


def _link_constants(word: str, link: Link) -> Iterator[str]:
    yield f"// {plain(link.name)}: {plain(link.comment)}"
    if link.law is not None:
        yield f"L_{word} = {_number(link.offset)}; // [m]"
        return
    yield f"K_{word} = {_number(link.K)}; // [N/m{'' if link.exponent in (None, 1.0) else '^n'}]"
    yield f"Z_{word} = {_number(link.z)}; // [N/m] for a step of 1 m"
    yield f"L_{word} = {_number(link.offset)}; // [m]"


def _state(word: str, point: Point, point_words: Sequence[str]) -> Iterator[str]:
    if point.shares:
        for letter in "xd":
            terms = (
                f"{share!r}*{letter}_{point_words[point_index]}"
                for point_index, share in point.shares
            )
            yield f"  {letter}_{word} = {' + '.join(terms)};"
        return
    if point.fed is not None:
        input_name = f"in_{point.fed + 1}"
        yield f"  x_{word} = {input_name};"
        yield f"  d_{word} = ({input_name} - {input_name}') * 1';"
    elif point.mass:
        yield f"  x_{word} = X0_{word} + u_{word};"
        yield f"  d_{word} = D0_{word} + e_{word};"
    else:
        yield f"  x_{word} = X0_{word};"
        yield f"  d_{word} = 0.0;"


def _force(
    word: str, link: Link, point_words: Sequence[str], laws: Mapping[str, str]
) -> Iterator[str]:
    """The force that pulls the first end of a link towards the second."""
    a, b = point_words[link.a], point_words[link.b]
    if link.law is not None:
        per_step = "" if link.law.per_step == 1.0 else f"*{link.law.per_step!r}"
        yield f"  p_{word} = x_{b} - x_{a} - L_{word};"
        yield f"  f_{word} = {laws[word]}(p_{word}, (d_{b} - d_{a}){per_step});"
        return
    if link.exponent is None:
        yield f"  f_{word} = K_{word}*(x_{b} - x_{a} - L_{word}) + Z_{word}*(d_{b} - d_{a});"
        return
    first_word, second_word = (a, b) if link.side > 0 else (b, a)
    yield f"  p_{word} = x_{first_word} - x_{second_word} - L_{word};"
    penetration_power = (
        f"p_{word}" if link.exponent == 1.0 else f"pow(max(p_{word}, 0.0), {link.exponent!r})"
    )
    push = f"K_{word}*{penetration_power} + Z_{word}*(d_{first_word} - d_{second_word})"
    push = f"max({push}, 0.0)" if link.is_clamped else f"({push})"
    sign = "0.0 -" if link.side > 0 else ""
    yield f"  f_{word} = {sign} (p_{word} > 0.0)*{push};".replace("=  ", "= ")


def _step(word: str, point: Point, terms: Sequence[str]) -> str:
    step = f"d_{word}"
    if point.kappa or point.zeta:
        step += f" - Z_{word}*d_{word} - K_{word}*(x_{word} - R_{word})"
    return f"{step} + G_{word}*(0.0 {' '.join(terms)})" if terms else step


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
