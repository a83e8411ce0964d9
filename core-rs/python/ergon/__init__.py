"""Ergon: write the gesture, hear the matter."""

TYPE_CHECKING = False  # as `typing` has it, which would have to be imported
if TYPE_CHECKING:
    from ergon.cli.notebook import Session as Session
    from ergon.repl.session.api import NotTaken as NotTaken

# Where each is found when it is asked for: `ergon --help` needs none of them.
_PLACES = {"Session": "ergon.cli.notebook", "NotTaken": "ergon.repl.session.api"}


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module 'ergon' has no attribute '{name}'", name=name)
    from importlib import import_module

    found: object = getattr(import_module(_PLACES[name]), name)
    return found
