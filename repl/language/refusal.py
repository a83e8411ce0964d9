"""The refusal of a line that cannot be read."""

from ergon.common.errors import ErgonError
from ergon.common.terminal import printable


class Refusal(ErgonError):
    """One sentence, the characters at fault, and the whole text to type instead, if one is near."""

    def __init__(
        self, message: str, offset: int = 0, length: int = 1, try_: str | None = None
    ) -> None:
        """Keep the place: `offset` and `length` count characters of the submitted text."""
        super().__init__(printable(message))
        self.message = printable(message)
        self.offset = offset
        self.length = length
        self.try_ = try_
