"""Interpreter of pmpd's messages: the masses, links and ports that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.pmpd.network import PORTS_MAX, Link, Mass, Network, Port, Request
from ergon.workshop.models.pmpd.reading import MESSAGES_MAX, Message, parse_number
from ergon.workshop.models.pmpd.words import FORMS, OBJECTS, REFUSED, Object, Value, usage_text

_ANY_TIME = ("bang", "print", "infosL", "reset")
_KINDS = {"mass": "masses", "link": "links", "NLlink": "nl_links"}


def network(object_kind: Object, messages: Sequence[Message]) -> Network:
    """The masses and links that messages make. Raises ModelError with the line at fault."""
    empty_network = Network(object_kind)
    arrays = {
        message.arguments[index]
        for message in messages
        if message.word == "tabLink"
        for index in (3, 5)
        if index < len(message.arguments)
    }
    for position, message in enumerate(messages):
        if position == 0 and message.word in OBJECTS:
            _set_ports(empty_network, message)
        elif object_kind == "pmpd" and message.word in arrays:
            _set_array(empty_network, message)
        else:
            _execute(empty_network, message)
    if not empty_network.masses:
        raise ModelError("it makes no mass", messages[-1].line if messages else 0)
    return empty_network


def _set_ports(network: Network, message: Message) -> None:
    """Create the object as a patch writes it: `pmpd~ 1 2` has one inlet and two outlets."""
    sizes = [parse_number(word) for word in message.arguments]
    if network.kind == "pmpd":
        return  # how many masses and links it has room for
    if message.arguments[:1] == ("-m",):
        sizes = sizes[1:]
    if None in sizes:
        raise ModelError("pmpd~ is written pmpd~ [inlets] [outlets]", message.line)
    counts = [int(value or 0.0) for value in sizes]
    inlets, outlets, loops = (max(1, count) for count in (*counts, *[1] * 3)[:3])
    if loops > 1:
        problem = f"{loops} steps in a sample are not built yet; a score has one"
        raise ModelError(problem, message.line)
    network.n_ports = min(inlets, PORTS_MAX), min(outlets, PORTS_MAX)


def _set_array(network: Network, message: Message) -> None:
    """Set an array as Pure Data does: `NAME resize 5`, or `NAME 0 1 2` for values from an index
    on.
    """
    first_word, *value_words = message.arguments or ("",)
    values = [parse_number(word) for word in value_words]
    index_number = parse_number(first_word)
    array = network.arrays.setdefault(message.word, [])
    if first_word == "resize" and len(values) == 1 and values[0] is not None:
        size = _integer(values[0], 1, MESSAGES_MAX, "a size", message.line)
        array[size:] = []
        array += [0.0] * (size - len(array))
    elif index_number is not None and None not in values:
        first_index = _integer(index_number, 0, MESSAGES_MAX, "an index", message.line)
        array += [0.0] * (min(first_index + len(values), MESSAGES_MAX) - len(array))
        array[first_index : first_index + len(values)] = [
            value for value in values if value is not None
        ]
    else:
        example = f"{message.word} resize 3; {message.word} 0 0.5 1 2"
        raise ModelError(f"an array is written {example}", message.line)


def _execute(network: Network, message: Message) -> None:
    forms = FORMS[network.kind]
    form = forms.get(message.word)
    line = message.line
    if form is None:
        if message.word in REFUSED:
            raise ModelError(f"{message.word}: {REFUSED[message.word]}", line)
        if parse_number(message.word) is not None:
            raise ModelError("a message begins with a word, and this one with a number", line)
        (opposite_kind,) = (name for name in OBJECTS if name != network.kind)
        opposite_text = (
            f"; it is one of [{opposite_kind}]" if message.word in FORMS[opposite_kind] else ""
        )
        suggestion = None if opposite_text else nearest(message.word, forms)
        raise ModelError(
            f"{quote(message.word)} is not a word of [{network.kind}]{opposite_text}",
            line,
            suggestion,
        )
    n_min = sum(value.default is None for value in form)
    if not n_min <= len(message.arguments) <= len(form):
        usage = f"{usage_text(message.word, form)}; here it has {len(message.arguments)} values"
        raise ModelError(f"{message.word} is written {usage}", line)
    if network.has_run and message.word not in _ANY_TIME and not _is_query(message.word):
        reason = "masses and links that change while it plays are not built yet"
        raise ModelError(f"{message.word} behind the first bang: {reason}", line)
    values = [
        _read_value(
            network,
            value,
            message.arguments[index] if index < len(message.arguments) else value.default,
            line,
        )
        for index, value in enumerate(form)
    ]
    _HANDLERS[network.kind, message.word](network, message.word, line, *values)


def _is_query(word: str) -> bool:
    return word.startswith("mass") and word != "mass"


def _read_value(network: Network, form_value: Value, word: str | None, line: int) -> Any:
    """The value of a word, by the kind of value that is expected."""
    if not word:  # left out: all masses, or nothing
        return list(range(len(network.masses))) if form_value.kind == "masses" else None
    literal = parse_number(word)
    if form_value.kind == "class":
        if literal is not None:
            raise ModelError(f"{quote(word)}: a class is a word, and a number names none", line)
        return word
    if form_value.kind == "array":
        return word
    list_name = {"masses": "masses", "links": "links"}.get(form_value.kind)
    if list_name is not None:
        elements = getattr(network, list_name)
        if literal is None:
            matching = [
                index for index, element in enumerate(elements) if element.class_name == word
            ]
            if not matching:
                suggestion = nearest(word, {element.class_name for element in elements})
                raise ModelError(f"no {list_name} are called {quote(word)}", line, suggestion)
            return matching
        return [_index(network, list_name, literal, line)]
    if literal is None:
        raise ModelError(f"{form_value.name} is {quote(word)}, which is not a number", line)
    if form_value.kind in _KINDS:
        return _index(network, _KINDS[form_value.kind], literal, line)
    if form_value.kind == "port":
        port_max = network.n_ports[form_value.name == "outlet"]
        return _integer(literal, 0, port_max - 1, f"{form_value.name}", line)
    return literal


def _index(network: Network, list_name: str, index_value: float, line_number: int) -> int:
    elements = getattr(network, list_name)
    noun = {"masses": "mass", "links": "link", "nl_links": "NLlink"}[list_name]
    if not elements:
        raise ModelError(f"there is no {noun} yet", line_number)
    return _integer(index_value, 0, len(elements) - 1, noun, line_number)


def _integer(number: float, value_min: int, value_max: int, label: str, line: int) -> int:
    if number != int(number) or not value_min <= number <= value_max:
        raise ModelError(
            f"{label} is {number:g}: a whole number from {value_min} to {value_max:,}", line
        )
    return int(number)


# --- what each word does ------------------------------------------------------------------------


def _check_count(elements: Sequence[object], line: int) -> None:
    if len(elements) >= MESSAGES_MAX:
        raise ModelError(f"there are more than {MESSAGES_MAX:,} masses or links", line)


def _mass_audio(network: Network, word: str, line: int, M: float, x: float) -> None:
    _check_count(network.masses, line)
    network.masses.append(Mass("mass", M > 0.0, M, x, line))


def _mass(
    network: Network,
    word: str,
    line_number: int,
    class_name: str,
    mobile: float,
    M: float,
    x: float,
) -> None:
    _check_count(network.masses, line_number)
    network.masses.append(Mass(class_name, int(mobile) > 0, M if M > 0.0 else 1.0, x, line_number))


def _link_audio(
    network: Network,
    word: str,
    line: int,
    first_mass: int,
    second_mass: int,
    K: float,
    D: float,
    *optional_values: float,
) -> None:
    Pow, L, length_min, length_max = optional_values or (1.0, 0.0, -1e6, 1e6)
    elements = network.nl_links if word == "NLlink" else network.links
    _check_count(elements, line)
    if first_mass == second_mass:
        raise ModelError(f"{word} joins mass {first_mass} to itself", line)
    elements.append(
        Link(
            word,
            f"{word}~",
            first_mass,
            second_mass,
            K,
            D,
            Pow,
            L,
            length_min,
            length_max,
            0.0,
            line,
        )
    )


def _mass_pairs(
    network: Network, first_masses: list[int], second_masses: list[int], line: int
) -> Iterator[tuple[int, int]]:
    """All pairs of masses of two classes; within one class, each pair once."""
    if len(first_masses) == len(second_masses) == 1 and first_masses == second_masses:
        raise ModelError(f"a link joins mass {first_masses[0]} to itself", line)
    is_same = first_masses == second_masses
    for first_mass in first_masses:
        for second_mass in second_masses:
            if first_mass != second_mass and not (is_same and first_mass > second_mass):
                _check_count(network.links, line)
                yield first_mass, second_mass


def _link(
    network: Network,
    word: str,
    line: int,
    class_name: str,
    first_masses: list[int],
    second_masses: list[int],
    *values: float,
) -> None:
    K, D, Pow, length_min, length_max = values
    for first_mass, second_mass in _mass_pairs(network, first_masses, second_masses, line):
        L = network.masses[first_mass].x - network.masses[second_mass].x
        network.links.append(
            Link(
                class_name,
                "link",
                first_mass,
                second_mass,
                K,
                D,
                Pow,
                L,
                length_min,
                length_max,
                L,
                line,
            )
        )


def _table_link(
    network: Network,
    word: str,
    line: int,
    class_name: str,
    first_masses: list[int],
    second_masses: list[int],
    *values: Any,
) -> None:
    array_k, length_k, array_d, length_d = values
    tables = (
        array_k,
        (length_k if length_k > 0 else 1.0),
        array_d,
        (length_d if length_d > 0 else 1.0),
    )
    for first_mass, second_mass in _mass_pairs(network, first_masses, second_masses, line):
        L = network.masses[first_mass].x - network.masses[second_mass].x
        link = Link(
            class_name,
            "table",
            first_mass,
            second_mass,
            1.0,
            1.0,
            1.0,
            L,
            -1e6,
            1e6,
            L,
            line,
            tables,
        )
        network.links.append(link)


def _port(network: Network, word: str, line: int, port_number: int, mass: int, gain: float) -> None:
    network.ports.append(Port(word.removesuffix("X"), port_number, mass, gain, line))


def _add_request(network: Network, word: str, line: int, masses: list[int]) -> None:
    network.requests.append(Request(word, tuple(masses), line))


def _bang(network: Network, word: str, line: int) -> None:
    network.has_run = network.kind == "pmpd"


def _reset(network: Network, word: str, line: int) -> None:
    """Reset everything except arrays and the number of ports, which do not belong to the object."""
    reset_network = Network(network.kind, arrays=network.arrays, n_ports=network.n_ports)
    for field in fields(Network):
        setattr(network, field.name, getattr(reset_network, field.name))


def _ignore(network: Network, word: str, line: int) -> None:
    """It prints, and changes nothing."""


def _setter(list_name: str, field_name: str) -> Callable[..., None]:
    """A setter of one value of some masses or links; an omitted value is left as it is."""

    def change(
        network: Network, word: str, line: int, indices: int | list[int], set_value: float
    ) -> None:
        for index in [indices] if isinstance(indices, int) else indices:
            setattr(getattr(network, list_name)[index], field_name, set_value)

    return change


def _adder(list_name: str, field_name: str) -> Callable[..., None]:
    def change(
        network: Network, word: str, line: int, indices: int | list[int], added_value: float
    ) -> None:
        for index in [indices] if isinstance(indices, int) else indices:
            element = getattr(network, list_name)[index]
            setattr(element, field_name, getattr(element, field_name) + added_value)

    return change


def _set_mass(network: Network, word: str, line: int, indices: int | list[int], M: float) -> None:
    for mass_index in [indices] if isinstance(indices, int) else indices:
        if network.kind == "pmpd~":
            network.masses[mass_index].is_mobile = M > 0.0
        if M > 0.0:
            network.masses[mass_index].M = M


def _set_position(network: Network, word: str, line: int, masses: list[int], x: float) -> None:
    """Put masses at `x` and stop them."""
    for index in masses:
        mass = network.masses[index]
        mass.x, mass.v, mass.f = x, 0.0, 0.0


def _set_nl_k(
    network: Network, word: str, line: int, link_index: int, K: float, Pow: float | None
) -> None:
    network.nl_links[link_index].K = K
    if Pow is not None:
        network.nl_links[link_index].Pow = Pow


def _set_mobile(network: Network, word: str, line: int, masses: list[int]) -> None:
    for mass_index in masses:
        network.masses[mass_index].is_mobile = word == "setMobile"


def _words(text: str, maker: Callable[..., None]) -> dict[str, Callable[..., None]]:
    return dict.fromkeys(text.split(), maker)


_AUDIO: Mapping[str, Callable[..., None]] = {
    "mass": _mass_audio,
    **_words("link NLlink", _link_audio),
    **_words("inPos inPosX inForce inForceX outPos outPosX outSpeed outSpeedX", _port),
    **_words("pos posX", _setter("masses", "x")),
    **_words("force forceX", _adder("masses", "f")),
    "setM": _set_mass,
    "setK": _setter("links", "K"),
    "setD": _setter("links", "D"),
    "setNLK": _set_nl_k,
    "setNLD": _setter("nl_links", "D"),
    "setNLKPow": _setter("nl_links", "Pow"),
    "setNLL": _setter("nl_links", "L"),
    "setNLLMin": _setter("nl_links", "Lmin"),
    "setNLLMax": _setter("nl_links", "Lmax"),
    "reset": _reset,
    **_words("print bang", _ignore),
}
_CONTROL: Mapping[str, Callable[..., None]] = {
    "mass": _mass,
    "link": _link,
    "tabLink": _table_link,
    **_words("pos posX setPos setPosX", _set_position),
    **_words("addPos addPosX", _adder("masses", "x")),
    **_words("force forceX", _adder("masses", "f")),
    **_words("setForce setForceX", _setter("masses", "f")),
    **_words("setSpeed setSpeedX", _setter("masses", "v")),
    "setM": _set_mass,
    "setDEnv": _setter("masses", "air_damping"),
    **_words("setFixed setMobile", _set_mobile),
    "setK": _setter("links", "K"),
    "setD": _setter("links", "D"),
    "setPow": _setter("links", "Pow"),
    "setL": _setter("links", "L"),
    "addL": _adder("links", "L"),
    **_words("massPos massPosL massPosXL massSpeed massSpeedL massSpeedXL", _add_request),
    **_words("massPosMean massSpeedMean", _add_request),
    "reset": _reset,
    **_words("print infosL", _ignore),
    "bang": _bang,
}
_HANDLERS = {
    **{("pmpd~", word): maker for word, maker in _AUDIO.items()},
    **{("pmpd", word): maker for word, maker in _CONTROL.items()},
}
