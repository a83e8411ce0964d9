"""From a text to the messages of a pmpd object, each with its line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import DialectError, ModelError
from ergon.workshop.models.pmpd.words import FORMS, OBJECTS, REFUSED, Object

MESSAGES_MAX = 200_000  # messages, masses, links
_SEPARATOR = re.compile(r"\\?[;,]")
_LINE_END = re.compile(r"\r\n|\r|\n")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_OTHER_OBJECT = re.compile(r"pmpd[23]d~?")
_PATCH_OBJECT = re.compile(r"#X obj -?[0-9]+ -?[0-9]+ (pmpd[23]?d?~?)(?=[ ;,])")
_WORDS_MAX = 20_000  # words of a message, such as the values of an array


@dataclass(frozen=True, slots=True)
class Message:
    """A word and its arguments."""

    word: str
    arguments: tuple[str, ...]
    line: int


def is_list(text: str) -> bool:
    """Whether a text is a list of messages: its first word is one of pmpd's."""
    for message in messages(text, n_max=1):
        known_words = {
            *OBJECTS,
            *REFUSED,
            *(word_of_form for form_words in FORMS.values() for word_of_form in form_words),
        }
        return message.word in known_words or bool(_OTHER_OBJECT.fullmatch(message.word))
    return False


def is_patch(text: str) -> bool:
    """Whether a text is a patch of Pure Data."""
    return text.lstrip().startswith("#N canvas")


def patch_refusal(text: str) -> str:
    """A sentence on the pmpd objects of a patch, with advice."""
    objects = sorted({*_PATCH_OBJECT.findall(text)})
    object_text = f" with {', '.join(objects)}" if objects else " without an object of pmpd"
    return (
        f"it is a patch of Pure Data{object_text}, and in which order its messages are sent is "
        "known "
        "only when it runs; write the messages that its pmpd object gets into a text, one a line, "
        "and import that"
    )


def messages(text: str, n_max: int = MESSAGES_MAX + 1) -> Iterator[Message]:
    """Split a text into messages, at `;` and `,`, and at line ends if there is no `;`.

    Lines that begin with `#` and a space are comments. Raises ModelError.
    """
    lines = _LINE_END.split(text)
    numbered_lines = [
        (line_number, line)
        for line_number, line in enumerate(lines, 1)
        if not re.match(r"\s*#(\s|$)", line)
    ]
    has_semicolons = any(";" in line for _, line in numbered_lines)
    message_words: list[str] = []
    first_line, n_messages = 0, 0
    for line_number, line in numbered_lines:
        message_texts = _SEPARATOR.split(line)
        for text_index, message_text in enumerate(message_texts):
            words = message_text.split()
            first_line = line_number if words and not message_words else first_line
            message_words += words
            if len(message_words) > _WORDS_MAX:
                raise ModelError(f"a message has at most {_WORDS_MAX:,} words", first_line)
            if message_words and (text_index + 1 < len(message_texts) or not has_semicolons):
                yield Message(message_words[0], tuple(message_words[1:]), first_line)
                message_words, n_messages = [], n_messages + 1
                if n_messages >= n_max:
                    return
    if message_words:
        yield Message(message_words[0], tuple(message_words[1:]), first_line)


def parse(text: str, dialect: Object | None) -> tuple[Object, list[Message]]:
    """The object that messages are for, and the messages. Raises ModelError and DialectError."""
    all_messages = list(messages(text))
    if len(all_messages) > MESSAGES_MAX:
        raise ModelError(f"it has more than {MESSAGES_MAX:,} messages", all_messages[-1].line)
    for message in all_messages:
        for word in (message.word, *message.arguments):
            if word.startswith("#"):
                refusal = "this is a patch; write the messages to its object in the order in which"
                raise ModelError(f"{refusal} they are sent, one a line", message.line)
            if "$" in word:
                refusal = f"{quote(word)} stands for a number that a patch gives; write the number"
                raise ModelError(refusal, message.line)
    return _object(all_messages, dialect), all_messages


def _object(messages: list[Message], dialect: Object | None) -> Object:
    if messages and messages[0].word in OBJECTS:
        named_object: Object = "pmpd~" if messages[0].word == "pmpd~" else "pmpd"
        if dialect not in (None, named_object):
            raise ModelError(f"these messages are for [{named_object}]", messages[0].line)
        return named_object
    if messages and _OTHER_OBJECT.fullmatch(messages[0].word):
        raise ModelError("of pmpd the objects of one dimension are read", messages[0].line)
    if dialect is not None:
        return dialect
    special_words = {
        name: set(FORMS[name]) - set(FORMS[other_name])
        for name, other_name in (OBJECTS, OBJECTS[::-1])
    }
    words_used = {message.word for message in messages}
    has_class = any(
        message.word in ("mass", "link")
        and message.arguments
        and parse_number(message.arguments[0]) is None
        for message in messages
    )
    is_control = has_class or bool(words_used & special_words["pmpd"])
    is_audio = bool(words_used & special_words["pmpd~"])
    if is_control == is_audio:
        message = "it may be for [pmpd] or for [pmpd~]; write the object as the first line, "
        raise DialectError(f"{message}or --dialect pmpd, --dialect pmpd~", 1)
    return "pmpd" if is_control else "pmpd~"


def parse_number(word: str) -> float | None:
    """The number that a word is; None if it is not a number."""
    parsed_number = float(word) if _NUMBER.fullmatch(word) else None
    return parsed_number if parsed_number is None or isfinite(parsed_number) else None
