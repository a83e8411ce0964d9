"""Points and links as a model of mi-gen (v2), the format that `ergon import` reads."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from ergon.notation.text.values import Place
from ergon.workshop.models.exact_numbers import nudge_to_goal
from ergon.workshop.models.mims.laws import LINKS
from ergon.workshop.models.naming import Names
from ergon.workshop.models.page import RATE
from ergon.workshop.models.programs.elements import Body, Link, MixedOutput, Point, SteppedNetwork
from ergon.workshop.models.programs.network import refusal
from ergon.workshop.models.programs.places_back import position_on_body

NETWORK_MAX = 20_000  # points
_CHANNELS = 99
_NO_LETTER = re.compile(r"\W", re.ASCII)
_SPACES = re.compile(r"\s+")


def model_text(network: SteppedNetwork, model_title: str) -> str:
    """The text of a model. Raises ModelError with the places of all that the format cannot
    express.
    """
    return _ModelDraft(network).text(model_title)


@dataclass(slots=True)
class _ModelDraft:
    network: SteppedNetwork
    names: Names = field(default_factory=Names)
    lines: list[str] = field(default_factory=list)
    refusals: list[tuple[Place, str]] = field(default_factory=list)
    point_texts: dict[int, str] = field(default_factory=dict)  # how each point is written in a link
    body_by_first_point: dict[int, Body] = field(default_factory=dict)  # by their first points
    name_by_first_point: dict[int, str] = field(default_factory=dict)  # names of these
    links_by_point: dict[int, list[int]] = field(default_factory=dict)  # links of each point
    body_links: set[int] = field(default_factory=set)  # within bodies that are written as a whole

    def text(self, title: str) -> str:
        network = self.network
        if network.rate != RATE:
            first_place = network.points[0].place
            reason = (
                f"a model of mi-gen is for {RATE:,} Hz, and this score has {network.rate:,g} Hz"
            )
            raise refusal([(first_place, f"{reason}; write rates: {{audio: {RATE}Hz}}")])
        for link_index, link in enumerate(network.links):
            for end in {link.a, link.b}:
                self.links_by_point.setdefault(end, []).append(link_index)
        input_names = _channels("in", [port.take for port in network.inputs])
        wanted_names = [port.name.split(" ")[0].rpartition(".")[2] for port in network.outputs]
        output_names = _channels("out", wanted_names)
        self.names.used_names |= {*input_names, *output_names}
        if max(len(input_names), len(output_names)) > _CHANNELS:
            self.refuse(network.points[0].place, f"a model has at most {_CHANNELS} channels")
        self._find_bodies()
        self._add_masses(input_names)
        for link_index, link in enumerate(network.links):
            if link_index not in self.body_links:
                self._add_link(link)
        self._add_force_inputs(input_names)
        for name, port in zip(output_names, network.outputs, strict=True):
            self._add_output(name, port)
        if self.refusals:
            raise refusal(list(dict.fromkeys(self.refusals)))
        return "\n".join([*self._heading(title, input_names, output_names), *self.lines]) + "\n"

    def refuse(self, place: Place, reason: str) -> None:
        self.refusals.append((place, reason))

    def _heading(
        self, title: str, input_names: list[str], output_names: list[str]
    ) -> Iterator[str]:
        yield f"# {_plain(title)}, made by ergon: a model of mi-gen (v2), laws of today."
        yield f"# One sample is 1/{RATE} s. M is in kg {RATE}^2, K in N/m, Z in N {RATE}/(m/s), x0"
        yield "# in m, v0 in m/s; of a network under units: ca the numbers are its own."
        for port_name, input in zip(input_names, self.network.inputs, strict=True):
            source_text = f", from {_plain(input.take)}" if input.take else ""
            yield f"# {port_name}: {_plain(input.name)}{source_text}"
        for port_name, output_port in zip(output_names, self.network.outputs, strict=True):
            yield f"# {port_name}: {_plain(output_port.name)}"
        yield from (f"# Left out: {_plain(output_port)}" for output_port in self.network.omissions)
        yield ""

    # --- masses ---

    def _unique_name(self, text: str) -> str:
        """A name of the score; the name of its part is left out if the rest is unique."""
        short_name = text.partition(".")[2] or text
        short_word = _NO_LETTER.sub("_", short_name)
        if short_word in self.names.used_names:
            short_word = _NO_LETTER.sub("_", text)
        return self.names.new(short_word if short_word[:1].isalpha() else f"m{short_word}")

    def _find_bodies(self) -> None:
        for body in self.network.bodies:
            points = [self.network.points[point_index] for point_index in body.points]
            is_at_rest = not any(
                point.x0 or point.d0 or point.weight or point.position_input is not None
                for point in points
            )
            if is_at_rest and body.K >= 0.0 and body.z >= 0.0:
                self.body_by_first_point[body.points[0]] = body
                self.body_links.update(body.links)

    def _add_masses(self, inputs: list[str]) -> None:
        last_mass = -1
        for point_number, point in enumerate(self.network.points):
            if point_number in self.body_by_first_point:
                body = self.body_by_first_point[point_number]
                self._add_body(body)
                last_mass = body.points[-1]
            elif point_number > last_mass:
                self._add_mass(point_number, point, inputs)

    def _add_body(self, body: Body) -> None:
        name, (n_columns, n_rows) = self._unique_name(body.name), body.mass_counts
        mass = self._mass_in_model(self.network.points[body.points[0]])
        n_fixed = 2 * body.is_held
        link_values = f"{_number(body.K)} {_number(body.z)} 0 0"
        if body.kind == "STRING":
            n_members = n_columns
            mass = nudge_to_goal(mass, lambda m: n_members * m / n_members, mass)
            self.name_by_first_point[body.points[0]] = name
            keyword = "string" if body.is_held else "chain"
            self.lines.append(
                f"@{name} {keyword} {n_members + n_fixed} {_number(mass)} {link_values}"
            )
            for member_index in range(n_members):
                share = _position_text(member_index + body.is_held, n_members + n_fixed)
                self.point_texts[body.points[member_index]] = f"[@{name} {share}]"
        else:
            keyword = "closedMesh" if body.is_held else "mesh"
            mesh_size = f"{n_rows + n_fixed} {n_columns + n_fixed}"
            self.name_by_first_point[body.points[0]] = name
            self.lines.append(f"@{name} {keyword} {mesh_size} {_number(mass)} {link_values}")
            for member_index in range(n_columns * n_rows):
                row, column_index = divmod(member_index, n_columns)
                shares = (
                    _position_text(row + body.is_held, n_rows + n_fixed),
                    _position_text(column_index + body.is_held, n_columns + n_fixed),
                )
                self.point_texts[body.points[member_index]] = f"[@{name} {' '.join(shares)}]"

    def _proxy_place(self, point: Point) -> str:
        """A point between masses as a place on their macro; empty if there is no such place."""
        mass_indices = [mass for mass, _ in point.shares]
        bodies = [
            body
            for body in self.body_by_first_point.values()
            if set(body.points) & set(mass_indices)
        ]
        if len(bodies) != 1:
            return ""
        place = position_on_body(bodies[0], point.shares, lambda mass: self.network.points[mass])
        name = self.name_by_first_point[bodies[0].points[0]]
        return f"[@{name} {' '.join(_number(share) for share in place)}]" if place else ""

    def _mass_in_model(self, point: Point) -> float:
        return point.mass if point.is_ca else point.mass * self.network.rate * self.network.rate

    def _add_mass(self, number: int, point: Point, inputs: list[str]) -> None:
        if point.position_input is not None:
            mass_name = inputs[point.position_input]
            self.lines.append(f"@{mass_name} posInput {_number(point.x0)}")
            self.point_texts[number] = f"@{mass_name}"
            return
        if point.shares:
            self.point_texts[number] = self._proxy_place(point) or "@"
            if self.point_texts[number] == "@":
                reason = "a PROXY that lies at no place of one whole STRING or rectangle at rest"
                self.refuse(point.place, f"{point.name}: {reason}")
            return
        mass_name = self._unique_name(point.name)
        self.point_texts[number] = f"@{mass_name}"
        if not point.mass:
            self.lines.append(f"@{mass_name} ground {_number(point.x0)}")
            return
        m = self._mass_in_model(point)
        if point.rest and (point.kappa or point.zeta):
            self._add_tied_mass(mass_name, number, point, m)
            return
        stiffness = nudge_to_goal(point.kappa * m, lambda stiffness: stiffness / m, point.kappa)
        viscosity = nudge_to_goal(point.zeta * m, lambda viscosity: viscosity / m, point.zeta)
        if stiffness < 0.0 or viscosity < 0.0:
            self.refuse(point.place, f"{point.name}: {_NEGATIVE}")
        text = (
            f"osc {_number(m)} {_number(stiffness)} {_number(viscosity)}"
            if stiffness or viscosity
            else f"mass {_number(m)}"
        )
        self._add_mass_line(mass_name, text, point, m, stiffness, viscosity)

    def _add_tied_mass(self, mass_name: str, point_number: int, point: Point, m: float) -> None:
        """Write a CEL whose rest is not 0 as a mass tied to a ground there."""
        self._add_mass_line(mass_name, f"mass {_number(m)}", point, m, 0.0, 0.0)
        ground_name, tie_name = (
            self._unique_name(f"{point.name}_rest"),
            self._unique_name(f"{point.name}_tie"),
        )
        self.lines.append(f"@{ground_name} ground {_number(point.rest)}")
        tie_values = f"{_number(point.kappa * m)} {_number(point.zeta * m)}"
        self.lines.append(f"@{tie_name} springDamper @{ground_name} @{mass_name} {tie_values}")
        self.links_by_point.setdefault(point_number, []).append(-1)

    def _add_mass_line(
        self, name: str, word: str, point: Point, m: float, k: float, z: float
    ) -> None:
        """Write a mass that is where the score begins after its first step, in which no link
        acts.
        """
        if z == m:
            self.refuse(point.place, f"{point.name}: it is damped within one sample")
            return
        gravity = nudge_to_goal(-point.weight * RATE, lambda g: g / RATE, -point.weight)
        step = point.d0
        x0 = nudge_to_goal(point.x0 - step, lambda x: (point.x0 - x) * RATE / RATE, step)
        first_step = (step + (gravity / RATE + k * x0) / m) / (1.0 - z / m)

        def position_after_first_step(v0: float) -> float:
            previous_position = x0 - v0 / RATE
            return (2.0 - (k + z) / m) * x0 + (z / m - 1.0) * previous_position - gravity / RATE / m

        v0 = nudge_to_goal(first_step * RATE, position_after_first_step, point.x0)
        gravity_text = f" {_number(gravity)}" if gravity else ""
        self.lines.append(f"@{name} {word}{gravity_text} {_number(x0)} {_number(v0)}")

    # --- links and ports ---

    def _add_link(self, link: Link) -> None:
        first_name, second_name = self.point_texts[link.a], self.point_texts[link.b]
        link_name = self._unique_name(link.name)
        if link.law is not None:
            self._add_law(link_name, link, f"{first_name} {second_name}")
        elif link.exponent is not None:
            if link.K < 0.0 or link.z < 0.0:
                self.refuse(link.place, f"{link.name}: {_NEGATIVE}")
                return
            if link.exponent != 1.0 or link.is_clamped:
                missing_feature = "an exponent" if link.exponent != 1.0 else "a clamp"
                self.refuse(
                    link.place, f"{link.name}: mi-gen has no contact with {missing_feature}"
                )
                return
            end_names = (
                f"{first_name} {second_name}" if link.side > 0 else f"{second_name} {first_name}"
            )
            contact_values = f"{_number(link.K)} {_number(link.z)} {_number(-link.offset)}"
            self.lines.append(f"@{link_name} contact {end_names} {contact_values}")
        elif link.offset:
            self.refuse(link.place, f"{link.name}: a spring of mi-gen has no length at rest")
        elif link.K < 0.0 or link.z < 0.0:
            self._add_linear(link_name, f"{first_name} {second_name}", link.K, link.z)
        else:
            link_values = [_number(constant) for constant in (link.K, link.z) if constant] or ["0"]
            keyword = "springDamper" if len(link_values) == 2 else "damper" if link.z else "spring"
            self.lines.append(
                f"@{link_name} {keyword} {first_name} {second_name} {' '.join(link_values)}"
            )

    def _add_law(self, name: str, link: Link, end_names: str) -> None:
        assert link.law is not None
        law_fields, per_step = link.law.fields, link.law.per_step
        law_pair = _without_spaces(law_fields["law"]), _without_spaces(law_fields["damping"])
        k_name, has_plain_damping = (_LINEAR_LAWS.get(law_pair[0]), law_pair[1] in ("", "z*v"))
        if (
            k_name is not None
            and has_plain_damping
            and not link.offset
            and not law_fields["points"]
        ):
            k, z = (law_fields["constants"].get(constant, 0.0) for constant in (k_name, "z"))
            self._add_linear(name, end_names, k, z * per_step)
            return
        word = _WORD_BY_LAW.get(law_pair)
        if word is None or law_fields["points"]:
            reason = f"{link.name}: its law is none of mi-gen's; docs/import.md has them"
            self.refuse(link.place, reason)
            return
        head_link = LINKS["head"][word]
        if link.offset and head_link.rest_name != "thresh":
            self.refuse(link.place, f"{link.name}: a {word} of mi-gen has no rest")
            return
        keyword = word.split()[-1]
        values_by_name = {
            value: law_fields["constants"][letter] for letter, value in head_link.fields.items()
        }
        if per_step != 1.0:
            if "0.3" in head_link.damping:
                self.refuse(link.place, f"{link.name}: this law is written under units: ca alone")
                return
            if "Z" in values_by_name:
                values_by_name["Z"] *= per_step
            if keyword == "nlBow":
                values_by_name["scale"] /= per_step
        value_names = _VALUE_ORDER[word]
        values_by_name.setdefault("thresh", link.offset)
        values_text = " ".join(
            _number(float(values_by_name.get(constant, _DEFAULTS.get(constant, 0.0))))
            for constant in value_names
        )
        self.lines.append(f"@{name} {keyword} {end_names} {values_text}")

    def _add_linear(self, name: str, end_names: str, K: float, z: float) -> None:
        """Write K·d + Z·v, of any sign, as a law whose cubic part is 0."""
        k = _number(K)
        self.lines.append(f"@{name} nlSpringDamper {end_names} {k} 0 {k} {_number(z)}")

    def _add_force_inputs(self, inputs: list[str]) -> None:
        for input_number, input_name in enumerate(inputs):
            pushed_indices = [
                point_index
                for point_index, point in enumerate(self.network.points)
                if input_number in point.force_inputs
            ]
            if len(pushed_indices) == 1:
                self.lines.append(f"@{input_name} frcInput {self.point_texts[pushed_indices[0]]}")
            elif pushed_indices:
                pushed_point = self.network.points[pushed_indices[0]]
                reason = (
                    f"{self.network.inputs[input_number].name}: an input of mi-gen pushes one mass"
                )
                self.refuse(pushed_point.place, reason)

    def _add_output(self, name: str, output: MixedOutput) -> None:
        output_name = output.name.split(" ")[0]
        if output.order:
            self.refuse(
                output.place, f"{output_name}: mi-gen hears positions and forces (SOX, SOF) alone"
            )
        elif output.links:
            self._add_force_output(name, output_name, output)
        elif len(output.points) != 1:
            self.refuse(output.place, f"{output_name}: an output of mi-gen hears one point")
        else:
            self.lines.append(f"@{name} posOutput {self.point_texts[output.points[0]]}")

    def _add_force_output(self, name: str, output_name: str, output: MixedOutput) -> None:
        """Write the force on a mass as an output. mi-gen hears all links of a mass together, or
        none.
        """
        end_masses = {self.network.links[link].b for link in output.links}
        (mass_index,) = end_masses if len(end_masses) == 1 else (-1,)
        hears_all_links = sorted(self.links_by_point.get(mass_index, [])) == sorted(output.links)
        if (
            not hears_all_links
            or self.network.points[mass_index].force_inputs
            or self.network.points[mass_index].position_input is not None
        ):
            reason = f"{output_name}: mi-gen hears the force of all links of one mass together"
            self.refuse(output.place, f"{reason}, and here they are others")
        elif self.point_texts[mass_index].startswith("["):
            self.refuse(output.place, f"{output_name}: mi-gen hears no force on a member of a body")
        else:
            self.lines.append(f"@{name} frcOutput {self.point_texts[mass_index]}")


_NEGATIVE = "a stiffness or a viscosity below 0"
_LINEAR_LAWS = {"k*d": "k", "lim*d": "lim", "": "k"}
_DEFAULTS = {"smooth": 1.0}
_VALUE_NAMES = {
    "nlContact": "K Q lim Z thresh",
    "nlSpring2": "K Q Z",
    "nlSpring3": "K Q Z",
    "nlSpringDamper": "K Q lim Z",
    "nlBow": "Z scale",
    "smooth nlBow": "Z scale smooth",
    "nlPluck": "K scale",
    "damped nlPluck": "K scale Z",
}
_VALUE_ORDER: Mapping[str, list[str]] = {word: text.split() for word, text in _VALUE_NAMES.items()}


def _without_spaces(text: str | None) -> str:
    return _SPACES.sub("", text or "")


_WORD_BY_LAW = {
    (_without_spaces(LINKS["head"][word].law), _without_spaces(LINKS["head"][word].damping)): word
    for word in _VALUE_ORDER
}


def _channels(prefix: str, wanted_names: list[str]) -> list[str]:
    """Channel names such as `in1`: wanted names that are free, else the lowest numbers that are
    left.
    """
    pattern = re.compile(rf"{prefix}[1-9]\d?")
    names = [name if pattern.fullmatch(name) else "" for name in wanted_names]
    names = [name if name not in names[:index] else "" for index, name in enumerate(names)]
    free_names = (f"{prefix}{n}" for n in range(1, 10_000) if f"{prefix}{n}" not in names)
    return [name or next(free_names) for name in names]


def _position_text(index: int, n_points: int) -> str:
    return _number(index / (n_points - 1)) if n_points > 1 else "0"


def _number(number: float) -> str:
    """A number without `+`, which mi-gen would read as a sum."""
    if number == int(number) and abs(number) < 1e15:
        return str(int(number))
    return repr(number).replace("+", "")


def _plain(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
