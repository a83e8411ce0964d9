"""Finds which instruments can be computed before a performance: those that no live hand can feel.

Nothing passes between two islands of a network, so modules that links connect are frozen
together or not at all. A fixed or imposed point ends an island, but a live hand's key does not,
because the hand feels the force. `ergon/rendering/frozen.py` writes the parts.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ergon.instruments import proxies
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Module, Target
from ergon.instruments.module_kinds import LINK_KINDS
from ergon.instruments.spread import single_links
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.built_network import add_parts
from ergon.scores.staging.listening import audible_outputs, targets_of


class Link(NamedTuple):
    """A link as the composer wrote it."""

    name: str
    place: Place

    def __str__(self) -> str:
        """The link with its place: `gong.b (piece.yaml:12:7)`."""
        return f"{self.name} ({self.place})"


@dataclass(frozen=True, slots=True)
class FreezeObstacle:
    """Why `part` cannot be frozen: `links` lead from it to a live `player`, or to another
    instrument `other_part`.
    """

    part: str
    links: tuple[Link, ...]
    player: str | None = None
    key: str | None = None
    other_part: str | None = None

    def __str__(self) -> str:
        """The reason as a sentence that names the links."""
        path_text = ", ".join(map(str, self.links))
        if self.player is not None:
            if not path_text:
                reason = f"its output listens to {self.key}, the key of {self.player}"
                return f"{self.part} cannot be frozen: {reason}"
            return f"{self.part} cannot be frozen: {self.player} can feel it through {path_text}"
        path_text = (
            f"{path_text} connects them" if len(self.links) == 1 else f"{path_text} connect them"
        )
        path_text = path_text if self.links else "both listen to one module"
        return f"{self.part} cannot be frozen without {self.other_part}: {path_text}"


def freeze_obstacles(
    piece: Piece, frozen_parts: Collection[str], players: Iterable[str]
) -> list[FreezeObstacle]:
    """Reasons why instruments cannot be frozen; empty if they can. `players` have live hands."""
    graph = _LinkGraph(piece)
    hand_by_mat = {}
    for player in players:
        key = piece.keys[piece.players[player].key]
        hand_by_mat[graph.assembly.mats[key.name, key.struck]] = (player, key.name)
    part_by_mat = {
        mat: part
        for part in dict.fromkeys(instrument.name for _, instrument, _ in audible_outputs(piece))
        if part not in frozen_parts
        for mat in graph.audible_points(piece, part)
    }
    obstacles = (
        graph.first_obstacle(part, graph.audible_points(piece, part), hand_by_mat, part_by_mat)
        for part in frozen_parts
    )
    return [obstacle for obstacle in obstacles if obstacle is not None]


class _LinkGraph:
    """Points and the links between them, as a graph.

    A string, a plate or a module in space is one point, because it moves as a whole.
    """

    def __init__(self, piece: Piece) -> None:
        self.assembly = Assembly(seed=piece.seed)
        add_parts(piece, self.assembly)
        self._rigid_modules: set[tuple[str, str]] = set()
        self._links: dict[int, list[tuple[int, Link]]] = {}
        self._link_mats: dict[tuple[str, str], set[int]] = {}
        piece_modules = [*piece.modules()]
        for part_name, part_module in piece_modules:
            if part_module.kind in ("STRING", "PLATE") or "axes" in part_module.fields:
                self._rigid_modules.add((part_name, part_module.name))
        self._fixed_mats = {
            mat
            for part, module in piece_modules
            if module.kind == "SOL" or (module.kind == "ENX" and self._is_separate(module))
            for mat in self._imposed_points(part, module)
        }
        for part_name, part_module in piece_modules:
            if part_module.kind in LINK_KINDS:
                link = Link(
                    ".".join(filter(None, (part_name, part_module.name))), part_module.place
                )
                mat_pairs = dict.fromkeys(
                    self._end_points(single_link) for single_link in single_links(part_module)
                )
                self._link_mats[part_name, part_module.name] = {
                    end for pair in mat_pairs for end in pair
                }
                for pair in mat_pairs:
                    self._add_edge(link, *pair)
            elif part_module.kind == "PROXY":
                link = Link(
                    ".".join(filter(None, (part_name, part_module.name))), part_module.place
                )
                module_mat = self.assembly.mats[part_name, part_module.name]
                for target in proxies.targets(part_module.fields):
                    for mat in self._points(target):
                        self._add_edge(link, module_mat, mat)
            elif part_module.kind == "SURFACE":
                link = Link(
                    ".".join(filter(None, (part_name, part_module.name))), part_module.place
                )
                module_mat = self.assembly.mats[part_name, part_module.name]
                self._add_edge(link, module_mat, self._points(part_module.fields["of"])[0])
        for coupling in piece.duet:
            first_point, second_point = (
                self._points(target)[0] for target in (coupling.a, coupling.b)
            )
            name = f"the coupling of {coupling.a.part} and {coupling.b.part}"
            self._add_edge(Link(name, coupling.place), first_point, second_point)

    def _end_points(self, link: Module) -> tuple[int, int]:
        first_point, second_point = (self._points(target)[0] for target in link.ends)
        return first_point, second_point

    def _add_edge(self, link: Link, a: int, b: int) -> None:
        self._links.setdefault(a, []).append((b, link))
        self._links.setdefault(b, []).append((a, link))

    def _is_separate(self, module: Module) -> bool:
        """Whether the imposed point is a point of its own here, not part of a whole module."""
        target = module.driven_mat
        return (target.part, target.module) not in self._rigid_modules

    def _imposed_points(self, part_name: str, part_module: Module) -> range:
        if part_module.kind == "ENX":
            return self._points(part_module.driven_mat)
        first_mat = self.assembly.mats[part_name, part_module.name]
        return range(first_mat, first_mat + 1)

    def _points(self, target: Target) -> range:
        if (target.part, target.module) in self._rigid_modules:
            first_mat = self.assembly.mats[target.part, target.module]
            return range(first_mat, first_mat + 1)
        return self.assembly.members(target)

    def audible_points(self, piece: Piece, part_name: str) -> set[int]:
        """Points whose movement an instrument's outputs give."""
        audible_mats: set[int] = set()
        for _, instrument, part_output in audible_outputs(piece):
            if instrument.name != part_name:
                continue
            for output_target in targets_of(instrument, part_output):
                if (output_target.part, output_target.module) in self._link_mats:
                    audible_mats.update(self._link_mats[output_target.part, output_target.module])
                else:
                    audible_mats.update(self._points(output_target))
        return audible_mats - self._fixed_mats

    def first_obstacle(
        self,
        part_name: str,
        start_mats: set[int],
        hand_by_mat: Mapping[int, tuple[str, str]],
        part_by_mat: Mapping[int, str],
    ) -> FreezeObstacle | None:
        """The shortest path to a live hand, or else to an instrument that is not frozen."""
        previous_by_mat: dict[int, tuple[int, Link] | None] = dict.fromkeys(sorted(start_mats))
        queue = deque(previous_by_mat)
        part_obstacle = None
        while queue:
            mat = queue.popleft()
            if mat in hand_by_mat:
                return FreezeObstacle(part_name, _path_to(mat, previous_by_mat), *hand_by_mat[mat])
            if mat in part_by_mat and part_obstacle is None:
                part_obstacle = FreezeObstacle(
                    part_name, _path_to(mat, previous_by_mat), other_part=part_by_mat[mat]
                )
            if mat in self._fixed_mats:
                continue
            for other_mat, link in self._links.get(mat, ()):
                if other_mat not in previous_by_mat:
                    previous_by_mat[other_mat] = mat, link
                    queue.append(other_mat)
        return part_obstacle


def _path_to(mat: int, previous_by_mat: Mapping[int, tuple[int, Link] | None]) -> tuple[Link, ...]:
    """The links on the path from the start of the search to a point."""
    links: list[Link] = []
    while (step := previous_by_mat[mat]) is not None:
        mat, link = step
        links.append(link)
    return tuple(reversed(links))
