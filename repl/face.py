"""The earlier name of `SessionProtocol`, for cli/notebook.py until it moves."""

from ergon.repl.session_protocol import SessionProtocol as Face

__all__ = ["Face"]
