"""Help: all verbs on one screen, one verb in full, and a sheet to print."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from ergon.common.module_arguments import module_arguments
from ergon.repl.language.midi import SOURCES
from ergon.repl.language.playing import OPTION_HINTS
from ergon.repl.language.verbs import GROUPS, SHORT_FORM_BY_VERB, forms_of
from ergon.scores.gesture.transforms import EXAMPLES
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.turn_chain import TURN_FORMS
from ergon.scores.pattern.words import OPTION_EXAMPLES

TIME_WORDS = (
    ("", "at the next boundary of `quant`: the next bar, unless it was set"),
    ("now", "at the next tick"),
    ("at C, at 9|1, at B+2", "at a mark, at a bar and beat, some beats after a mark"),
    ("in 2, in 1bar", "this many beats or bars later"),
    ("sync d1", "where other strikes or a player begin again: a cycle, a round, else a stroke"),
)
NOTATION = (
    ("6mm@1/8", "a point: 6 mm at an eighth of a beat; bare numbers are mm and beats"),
    ("6@+1/8", "an eighth after the point before"),
    ("smooth, line, hold, throw", "the curve to the points that follow; smooth if none is written"),
    ("( … )*4", "four times, each after the end of the one before"),
)
PATTERNS = (
    ("knock lean ~", "one after the other, a step each; ~ rests"),
    ("knock (lean lean)", "a group shares one step evenly"),
    ("(knock lean)*2", "written out twice: four steps"),
    ("choose knock lean", "one of them in each round"),
    ("walk knock lean tap", "the first; then the same or a neighbour of the one before"),
    ("shuffle knock lean tap", "all, in an order of its own in each round"),
    ("every 4th do mirror", "every fourth round is transformed"),
)
RHYTHM_EXAMPLES = tuple((form.example, form.description) for form in FORM_BY_WORD.values())
KEYS = (
    ("F12", "panic"),
    ("Tab", "takes the line that was suggested, or completes the word"),
    ("Ctrl-C", "clears the line, or cancels the one that is being computed; the sound goes on"),
    ("Ctrl-D", "on an empty line: all hands lift, and the session ends"),
    ("`\\` at the end", "continues the line in the next one"),
    ("#", "begins a comment"),
)


def overview() -> tuple[str, ...]:
    """One example of every form, in lines of at most 100 characters."""
    help_lines = []
    for title, group_forms in GROUPS.items():
        help_lines.append(f"{title}:")
        help_lines += [f"  {form.example:<39} {form.effect}" for form in group_forms]
    help_lines.append("a line may end in now, at C, in 2 or sync d1; `help VERB` explains one verb")
    return tuple(help_lines)


def verb_help(verb: str) -> tuple[str, ...]:
    """One verb: how it is written, what it does, and the words that belong to it."""
    help_lines = []
    for form in forms_of(verb):
        time_text = " [now | at WHERE | in LENGTH | sync NAME]" if form.takes_time else ""
        help_lines += [f"{form.usage}{time_text}", f"  {form.effect}", f"  {form.example}"]
    if SHORT_FORM_BY_VERB[verb] != verb:
        help_lines.append(f"  in short: {SHORT_FORM_BY_VERB[verb]}")
    return (*help_lines, *(f"  {word:<25} {meaning}" for word, meaning in _verb_words(verb)))


def _verb_words(verb: str) -> tuple[tuple[str, str], ...]:
    if verb == "map":
        return tuple(SOURCES.items())
    if verb == "plays":
        options = tuple(
            (f"{option_name} {OPTION_EXAMPLES[option_name] or ''}", hint)
            for option_name, hint in OPTION_HINTS.items()
        )
        return (*options, *PATTERNS)
    if verb == "do":
        plays_words = tuple((example, "of plays of gestures") for example in EXAMPLES.values())
        plays_words += tuple(
            (form.example, f"of plays: {form.description}") for form in TURN_FORMS.values()
        )
        return (
            *plays_words,
            *((example, f"of strikes: {line}") for example, line in RHYTHM_EXAMPLES),
        )
    return NOTATION if verb == "=" else ()


def cheat_sheet() -> str:
    """The cheat sheet in Markdown."""
    sheet_lines = [
        "# The prompt on one page",
        "",
        "Made from the table of verbs by `make docs`.",
        "",
    ]
    sheet_lines += ["A verb may be cut down to its short form; the short forms stay.", ""]
    for title, group_forms in GROUPS.items():
        rows = (
            (form.usage, form.effect, form.example, _shortest_form(form.verb))
            for form in group_forms
        )
        sheet_lines += _markdown_table(title, ("write", "effect", "example", "in short"), rows)
    sheet_lines += _markdown_table("when a line acts", ("at its end", "effect"), TIME_WORDS)
    sheet_lines += _markdown_table("notation", ("write", "meaning"), NOTATION)
    option_lines = (
        (f"{word} {OPTION_EXAMPLES[word] or ''}".strip(), hint)
        for word, hint in OPTION_HINTS.items()
    )
    sheet_lines += _markdown_table("further words of plays", ("write", "meaning"), option_lines)
    sheet_lines += _markdown_table("what moves, for map", ("write", "meaning"), SOURCES.items())
    sheet_lines += _markdown_table("patterns", ("write", "meaning"), PATTERNS)
    sheet_lines += _markdown_table(
        "transformations of rhythms", ("write", "meaning"), RHYTHM_EXAMPLES
    )
    sheet_lines += _markdown_table("keys", ("key", "effect"), KEYS)
    return "\n".join(sheet_lines).rstrip() + "\n"


def _shortest_form(verb: str) -> str:
    return SHORT_FORM_BY_VERB[verb] if SHORT_FORM_BY_VERB[verb] != verb else ""


def _markdown_table(
    title: str, column_titles: tuple[str, ...], table_rows: Iterable[tuple[str, ...]]
) -> Iterator[str]:
    """A table whose cells are set as code, except those of the second column."""
    yield f"## {title.capitalize()}"
    yield ""
    yield "| " + " | ".join(column_titles) + " |"
    yield "|---" * len(column_titles) + "|"
    for row in table_rows:
        cells = (cell.replace("|", "\\|") for cell in row)
        cell_texts = (
            f"`{cell_text}`"
            if cell_text and column_index != 1 and "`" not in cell_text
            else cell_text
            for column_index, cell_text in enumerate(cells)
        )
        yield "| " + " | ".join(cell_texts) + " |"
    yield ""


if __name__ == "__main__":
    path = Path(module_arguments("PAGE")[0])
    path.write_text(cheat_sheet(), encoding="utf-8")
