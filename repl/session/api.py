"""A session for programs: the verbs as methods, each a line that is typed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from ergon.common.errors import ErgonError
from ergon.repl.face import Face, Reply, State
from ergon.repl.language import building
from ergon.repl.language.verbs import ways


class NotTaken(ErgonError):
    """A line was refused, and nothing has changed; `reply` is what was said."""

    def __init__(self, reply: Reply) -> None:
        """Why, and what to type instead where that is known."""
        super().__init__(reply.text + (f"; try: {reply.try_}" if reply.try_ else ""))
        self.reply = reply


class Typed:
    """A session to call: `s("ada plays knock every 1")` is `s.plays("ada", "knock", every=1)`.

    Every verb is a method; `NAME = NOTATION` is `define`, `? NAME` is `look`.
    """

    def __init__(self, face: Face) -> None:
        """Over a face; whoever has this closes it."""
        self._face = face

    def __call__(self, line: str) -> Reply:
        """Do a line, or a block of lines as one version. Raises NotTaken."""
        reply = self._face.submit(line)
        if not reply.taken:
            raise NotTaken(reply)
        if reply.leaves:
            self.close()
        return reply

    def __getattr__(self, name: str) -> Callable[..., Reply]:
        """A verb."""
        verb = building.FUNCTIONS.get(name)
        if verb is None:
            raise AttributeError(f"a session has no verb '{name}'", name=name, obj=self)

        def call(*given: object, **named: object) -> Reply:
            return self(building.line(verb, given, named))

        call.__name__ = call.__qualname__ = name
        call.__doc__ = "\n\n".join(
            f"{form.written}: {form.effect}.\n\nAs a line: {form.example}" for form in ways(verb)
        )
        return call

    def __dir__(self) -> list[str]:
        """The verbs too, for who completes names."""
        return sorted({*super().__dir__(), *building.FUNCTIONS})

    @property
    def state(self) -> State:
        """Where it is and what is heard."""
        return self._face.state()

    def messages(self) -> Sequence[str]:
        """What happened since the last call, a sentence each."""
        return self._face.messages()

    def close(self) -> None:
        """End it; of one in another process, leave it."""
        self._face.close()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self.close()
