"""`ergon help`: the help of a command, or a page of the manual."""

from __future__ import annotations

import click

from ergon.common.terminal import clean
from ergon.notation.text.spelling import nearest

from . import manual
from .outcome import Refused

_OTHER_PAGES_MAX = 8  # other pages about a topic, of many
_TOPIC_MAX = 80  # letters; what is longer is no topic


@click.command("help")
@click.argument("words", metavar="[COMMAND|TOPIC]...", nargs=-1)
@click.pass_context
def help_command(ctx: click.Context, words: tuple[str, ...]) -> None:
    """Show the help of a command, or a page of the manual.

    TOPIC is the name of a page (`ergon help rhythm`), the code of a mistake (`ergon help E204`),
    or what a page is about (`ergon help tuning`); the first line then names other pages about it.
    Where a page is called as a command, `ergon help view.md` shows the page. Without a topic, all
    commands and pages are listed.
    """
    root_context = ctx.find_root()
    if not " ".join(words).strip():
        click.echo(root_context.get_help())
        click.echo(
            f"\nPages (ergon help PAGE):\n{_pages_text(manual.pages(), _commands(root_context))}"
        )
        return
    pages = manual.pages()
    topic = " ".join(words)
    command = _command(root_context, words)
    if command is not None:
        click.echo(command.get_help())
        if topic in pages:
            click.echo(f"\nA page of the manual: ergon help {topic}.md")
        return
    topic = topic.removesuffix(".md")
    page = pages.get(topic) or pages.get(topic.upper()) or pages.get(f"howto/{topic}")
    if page is not None:
        manual.show(page.text)
        return
    matches = manual.matches(topic, pages) if len(topic) <= _TOPIC_MAX else []
    if not matches:
        raise Refused(_unknown_message(topic, pages, root_context))
    (page, _), *other_matches = matches
    other_lines = "\n".join(
        f"  ergon help {_page_topic(other_page, root_context):24} {heading}"
        for other_page, heading in other_matches[:_OTHER_PAGES_MAX]
    )
    others_heading = f" Others about {clean(topic)}:" if other_lines else ""
    introduction = f"The page {_page_topic(page, root_context)}.{others_heading}\n{other_lines}"
    manual.show(f"{introduction.rstrip()}\n\n{page.text}")


def _command(root: click.Context, command_words: tuple[str, ...]) -> click.Context | None:
    """The context of a command that words name (`take trim`); None if they do not."""
    context, command = root, root.command
    for command_word in command_words:
        if not isinstance(command, click.Group):
            return None
        subcommand = command.get_command(context, command_word)
        if subcommand is None:
            return None
        command = subcommand
        context = click.Context(command, parent=context, info_name=command_word)
    return context


def _page_topic(page: manual.Page, root: click.Context) -> str:
    """What shows a page after `ergon help`."""
    return f"{page.name}.md" if _command(root, (page.name,)) else page.name


def _pages_text(pages: dict[str, manual.Page], commands: list[str]) -> str:
    names = [name for name, page in pages.items() if not page.is_mistake and "/" not in name]
    names = [f"{name}.md" if name in commands else name for name in names]
    return click.wrap_text(", ".join(names), 78, "  ", "  ")


def _unknown_message(topic: str, pages: dict[str, manual.Page], root: click.Context) -> str:
    suggestion = nearest(topic, (*_commands(root), *pages))
    hint = (
        f"did you mean '{suggestion}'?" if suggestion else "`ergon help` lists commands and pages"
    )
    return f"no command and no page is called '{clean(topic)}'; {hint}"


def _commands(root: click.Context) -> list[str]:
    command = root.command
    return command.list_commands(root) if isinstance(command, click.Group) else []
