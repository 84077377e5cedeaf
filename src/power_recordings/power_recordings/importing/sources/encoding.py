"""Encoding of delimited text: byte-order marks, UTF-8, GB18030 and Latin-1."""

import codecs
import re
from typing import Final

_MARKS: Final = (
    (codecs.BOM_UTF8, 'utf8'),
    (codecs.BOM_UTF16_LE, 'utf-16-le'),
    (codecs.BOM_UTF16_BE, 'utf-16-be'),
)
_HIGH = re.compile(rb'[\x80-\xff]+')
_PAIRED: Final = 0.8  # share of runs of high bytes that are of even length in Chinese text
_LINE = re.compile(r'[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+')


def decoded(raw: bytes, whole: bool) -> tuple[list[str], str, int]:
    """
    Return the lines of the beginning of a text, with their ends, its encoding, and its mark.

    raw: the first bytes; not `whole`, the line that they end in is left out. The mark is the
    number of bytes of a byte-order mark. What is no UTF-8 is GB18030 where its high bytes come in
    pairs, else Latin-1.
    """
    mark, encoding = next(((m, e) for m, e in _MARKS if raw.startswith(m)), (b'', ''))
    raw = raw[len(mark) :]
    text = None
    for name in (encoding,) if encoding.startswith('utf-16') else ('utf8', 'gb18030'):
        if name == 'gb18030' and not _in_pairs(raw):
            continue
        try:
            text, encoding = codecs.getincrementaldecoder(name)().decode(raw), name
            break
        except UnicodeDecodeError:
            continue
    if text is None:
        text, encoding = raw.decode('latin-1'), 'latin-1'
    if not whole:
        text = text[: max(text.rfind('\n'), text.rfind('\r')) + 1]
    return _LINE.findall(text), encoding, len(mark)


def _in_pairs(raw: bytes) -> bool:
    runs = _HIGH.findall(raw)
    return sum(len(run) % 2 == 0 for run in runs) >= _PAIRED * len(runs)
