"""A session for programs: the verbs are methods, each of which submits a line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ergon.common.errors import ErgonError
from ergon.repl.language import building
from ergon.repl.language.verbs import forms_of
from ergon.repl.session_protocol import Reply, SessionProtocol, State

if TYPE_CHECKING:
    from ergon.repl.session.verb_methods import VerbMethods
else:
    VerbMethods = object  # `__getattr__` makes each method when it is called


class NotTaken(ErgonError):
    """A line was refused and has changed nothing; `reply` says why."""

    def __init__(self, reply: Reply) -> None:
        """Take the message from a reply, with the line to type instead if there is one."""
        super().__init__(reply.text + (f"; try: {reply.try_}" if reply.try_ else ""))
        self.reply = reply


class SessionProxy(VerbMethods):
    """A callable session: `s("ada plays knock every 1")` is `s.plays("ada", "knock", every=1)`.

    Every verb is a method; `NAME = NOTATION` is `define`, `? NAME` is `look`.
    """

    def __init__(self, session: SessionProtocol) -> None:
        """Wrap a session, which `close` ends."""
        self._session = session

    def __call__(self, line: str) -> Reply:
        """Do a line, or a block of lines as one version. Raises NotTaken."""
        reply = self._session.submit(line)
        if not reply.taken:
            raise NotTaken(reply)
        if reply.leaves:
            self.close()
        return reply

    if not TYPE_CHECKING:  # a checker knows the verbs from the stub alone

        def __getattr__(self, verb_name: str) -> Callable[..., Reply]:
            """The method of a verb."""
            verb = building.VERB_BY_FUNCTION.get(verb_name)
            if verb is None:
                raise AttributeError(
                    f"a session has no verb '{verb_name}'", name=verb_name, obj=self
                )

            def call(*arguments: object, **keyword_arguments: object) -> Reply:
                return self(building.build_line(verb, arguments, keyword_arguments))

            call.__name__ = call.__qualname__ = verb_name
            call.__doc__ = "\n\n".join(
                f"{form.usage}: {form.effect}.\n\nAs a line: {form.example}"
                for form in forms_of(verb)
            )
            return call

    def __dir__(self) -> list[str]:
        """List the verbs too, for completion."""
        return sorted({*super().__dir__(), *building.VERB_BY_FUNCTION})

    @property
    def state(self) -> State:
        """Position, tempo, what plays, load and level."""
        return self._session.state()

    def messages(self) -> Sequence[str]:
        """Messages since the last call, one sentence each."""
        return self._session.messages()

    def close(self) -> None:
        """End the session; a session in another process goes on."""
        self._session.close()

    def __enter__(self) -> Self:
        """The proxy itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the session."""
        self.close()
