"""`ergon lsp`: the language server of scores."""

from __future__ import annotations

import click

from .outcome import Refused


@click.command()
def lsp() -> None:
    """Serve an editor: mistakes as one types, completion, explanations.

    The server speaks the Language Server Protocol on stdin and stdout; an editor starts it.
    """
    try:
        import pygls  # noqa: F401
    except ImportError:
        from ergon.common.extras import install_command

        raise Refused(f"`ergon lsp` needs pygls: {install_command('lsp')}") from None
    from ergon.workshop.lsp.server import serve

    raise click.exceptions.Exit(serve())
