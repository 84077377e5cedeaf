"""Values of users and files quoted in errors: one line, short, without control characters."""

import reprlib

_LONGEST = 60
_quote = reprlib.Repr()
_quote.maxstring = _quote.maxother = _LONGEST
_quote.maxlong, _quote.maxlevel, _quote.maxdict = 24, 2, 3
_quote.maxlist = _quote.maxtuple = _quote.maxset = 4


def quoted(value: object) -> str:
    """Quote a value as Python writes it, cut to at most about 60 characters a part."""
    text = _quote.repr(value)
    return text if len(text) <= 2 * _LONGEST else f'{text[: 2 * _LONGEST]}…'


def printable(text: str, longest: int = 200) -> str:
    """Replace line breaks by spaces and escape control characters; shorten long texts."""
    line = ' '.join(text.split())
    line = ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in line)
    return line if len(line) <= longest else f'{line[:longest]}…'
