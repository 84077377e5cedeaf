"""Errors that the user can correct."""

import reprlib

_SHOWN = 60
_quote = reprlib.Repr()
_quote.maxstring = _quote.maxother = _SHOWN
_quote.maxlong, _quote.maxlevel, _quote.maxdict = 24, 2, 3
_quote.maxlist = _quote.maxtuple = _quote.maxset = 4


def quoted(value: object) -> str:
    """Return a value's repr, with long parts cut to about 60 characters and the whole to 120."""
    text = _quote.repr(value)
    return text if len(text) <= 2 * _SHOWN else f'{text[: 2 * _SHOWN]}…'


def printable(text: str, longest: int = 200) -> str:
    """Return text as one line: blanks collapsed, control characters escaped, cut to `longest`."""
    line = ' '.join(text.split())
    line = ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in line)
    return line if len(line) <= longest else f'{line[:longest]}…'


_LONGEST = 800


class InputError(Exception):
    """Bad input from the user; the message is one line with the remedy.

    Line breaks and control characters, as names in files of others may have them, are escaped and
    what is too long is cut in its middle, so that the message may go to a terminal.
    """

    def __init__(self, message: object) -> None:
        super().__init__(_cut(printable(_cut(str(message)), 10 * _LONGEST)))


def _cut(text: str) -> str:
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f'{text[:half]}…{text[-half:]}'
