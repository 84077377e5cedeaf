"""Errors that the user can correct."""

from wattwalk_core.quoting import printable

_LONGEST = 800


class InputError(Exception):
    """
    Bad input from the user; the message is one line with the remedy.

    Line breaks and control characters, as names in files of others may have them, are escaped and
    what is too long is cut in its middle, so that the message may go to a terminal.
    """

    def __init__(self, message: object) -> None:
        super().__init__(_cut(printable(_cut(str(message)), 10 * _LONGEST)))


def _cut(text: str) -> str:
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f'{text[:half]}…{text[-half:]}'
