"""CSV, TSV and other delimited text, streamed with pyarrow."""

import codecs
import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import RecordBatch, Table
from pyarrow import compute as pc
from pyarrow import csv as arrow_csv
from wattwalk_core.errors import InputError, printable

from power_recordings.importing.sources.heads import THOUSANDS, Head, find_head, is_number
from power_recordings.importing.sources.source import (
    MOST_COLUMNS,
    LogBlock,
    LogColumn,
    LogSource,
    Progress,
)

_MARKS: Final = (
    (codecs.BOM_UTF8, 'utf8'),
    (codecs.BOM_UTF16_LE, 'utf-16-le'),
    (codecs.BOM_UTF16_BE, 'utf-16-be'),
)
_HIGH = re.compile(rb'[\x80-\xff]+')
_PAIRED: Final = 0.8  # share of runs of high bytes that are of even length in Chinese text
_LINE = re.compile(r'[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+')


def decoded(raw: bytes, whole: bool) -> tuple[list[str], str, int]:
    """Return a text's first lines with line ends, its encoding, and the byte-order mark's length.

    raw: the file's first bytes; unless they are the `whole` file, the last line, which may be cut,
    is left out. Other than UTF-8 and UTF-16, text is GB18030 if high bytes pair up, else Latin-1.
    """
    mark, encoding = next(((m, e) for m, e in _MARKS if raw.startswith(m)), (b'', ''))
    raw = raw[len(mark) :]
    runs = _HIGH.findall(raw)
    in_pairs = sum(len(run) % 2 == 0 for run in runs) >= _PAIRED * len(runs)
    likely = ['utf8', 'gb18030'] if in_pairs else ['utf8']
    if encoding.startswith('utf-16'):
        likely = [encoding]
    for encoding in (*likely, 'latin-1'):  # the last of which decodes anything
        with suppress(UnicodeDecodeError):
            text = codecs.getincrementaldecoder(encoding)().decode(raw)
            break
    if not whole:
        text = text[: max(text.rfind('\n'), text.rfind('\r')) + 1]
    return _LINE.findall(text), encoding, len(mark)


_HEAD: Final = 256 << 10  # bytes that are looked at to find the dialect
_LONGEST_LINE: Final = 16 << 20
_BLOCK: Final = 1 << 20  # bytes; fits the cache
_BATCHES: Final = 8  # of such blocks that are converted at once
_LINES: Final = 8  # in a block, at least
_DELIMITERS: Final = (',', ';', '\t', '|', ' ')
_COMMENTS: Final = ('#', '%', '//')
_NOTHING: Final = ['', 'nan', 'NaN', 'NAN', 'null', 'NULL', 'None', 'NA', 'N/A', 'n/a', '-', 'OL']
_SPACES = re.compile(rb'[ \t]+')
_EDGES = re.compile(rb'(?m)^[ \t]+|[ \t]+$')


@dataclass(frozen=True)
class TableDialect:
    """Dialect of a delimited file; `decimal` is its decimal mark."""

    encoding: str
    delimiter: str
    decimal: str
    head: Head
    skip: int  # bytes before the first row of values
    longest: int  # bytes of a line


class DelimitedFile(LogSource):
    """A table of delimited text, all in one stream."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.dialect = sniff(path)

    def columns(self) -> Sequence[LogColumn]:
        """Return all columns."""
        head = self.dialect.head
        return [LogColumn(n, '', u) for n, u in zip(head.names, head.units, strict=True)]

    def read(self, addresses: Sequence[str], progress: Progress) -> Iterator[LogBlock]:
        """Yield blocks of rows; InputError for a file that is cut off in a row or malformed."""
        wanted = list(dict.fromkeys(addresses))
        skipped: list[int] = []
        done = 0
        try:
            first = next(self._batches(dict.fromkeys(wanted, pa.string()), progress, []), None)
            kinds = {
                name: pa.string() if values.dtype.kind == 'O' else pa.float64()
                for name, values in (self._numbers(first).items() if first is not None else ())
            }
            try:
                for batch in self._batches(kinds, progress, skipped):
                    yield LogBlock('', self._numbers(batch))
                    done += batch.num_rows
            except pa.ArrowInvalid:  # a field that is no number: read what is left as texts
                skipped.clear()
                for batch in self._batches(dict.fromkeys(wanted, pa.string()), progress, skipped):
                    fresh, done = batch.slice(max(0, done)), done - batch.num_rows
                    if fresh.num_rows:
                        yield LogBlock('', self._numbers(fresh))
        except (pa.ArrowInvalid, UnicodeDecodeError) as error:
            why = printable(str(error))
            if 'straddling' in why:
                why = 'a line far longer than those at its beginning'
            raise InputError(f'{self.path}: {why}') from None
        if skipped:
            note = f'{len(skipped)} rows of another number of fields left out'
            yield LogBlock('', {name: np.zeros(0) for name in wanted}, notes=(note,))

    def _batches(
        self, kinds: Mapping[str, Any], progress: Progress, skipped: list[int]
    ) -> Iterator[Table]:
        """Yield columns of Arrow types `kinds`; add the rows that do not fit to `skipped`."""

        def skip_row(row: Any) -> str:
            skipped.append(row.number or 0)
            return 'skip'

        with self.path.open('rb') as file:
            reader = arrow_csv.open_csv(
                pa.PythonFile(_Rows(file, self.dialect), 'r'),
                arrow_csv.ReadOptions(
                    column_names=list(self.dialect.head.names),
                    block_size=max(_BLOCK, _LINES * self.dialect.longest),
                    encoding=self.dialect.encoding,
                ),
                arrow_csv.ParseOptions(
                    delimiter=self.dialect.delimiter, invalid_row_handler=skip_row
                ),
                arrow_csv.ConvertOptions(
                    include_columns=list(kinds),
                    column_types=kinds,
                    decimal_point=self.dialect.decimal,
                    null_values=_NOTHING,
                    strings_can_be_null=False,
                ),
            )
            waiting: list[RecordBatch] = []
            for batch in reader:
                waiting.append(batch)
                if len(waiting) == _BATCHES:
                    progress(file.tell())
                    yield pa.Table.from_batches(waiting)
                    waiting = []  # before the next are read
            if waiting:
                yield pa.Table.from_batches(waiting)

    def _numbers(self, table: Table) -> dict[str, np.ndarray]:
        return {
            name: column.to_numpy()
            if pa.types.is_floating(column.type)
            else _column(column, self.dialect.decimal)
            for name, column in zip(table.column_names, table.columns, strict=True)
        }


def _column(texts: Any, decimal: str) -> np.ndarray:
    """Texts as float64, or as they are where most are no numbers, as dates are."""
    texts = _without_thousands(pc.utf8_trim_whitespace(texts), decimal)
    if decimal == ',':
        texts = pc.replace_substring(texts, ',', '.')
    texts = pc.if_else(pc.is_in(texts, pa.array(_NOTHING)), pa.scalar(None, pa.string()), texts)
    with suppress(pa.ArrowInvalid):
        return np.asarray(pc.cast(texts, pa.float64()).to_numpy())
    number = pc.match_substring_regex(texts, r'^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$')
    share = pc.mean(pc.cast(pc.fill_null(number, True), pa.float64())).as_py()
    if share is None or share < 0.5:
        return np.asarray(texts.to_numpy())
    texts = pc.if_else(number, texts, pa.scalar(None, pa.string()))
    return np.asarray(pc.cast(texts, pa.float64()).to_numpy())


def _without_thousands(texts: Any, decimal: str) -> Any:
    """Take out the marks between thousands; where all have one, it may be one of decimals."""
    grouped = pc.match_substring_regex(texts, f'^({THOUSANDS[decimal]})$')
    share = pc.mean(pc.cast(pc.fill_null(grouped, False), pa.float64())).as_py() or 0.0
    marked = pc.match_substring_regex(texts, rf"[,'.]\d+{re.escape(decimal)}")
    if not share > 0.0 or (share == 1.0 and not pc.any(marked).as_py()):
        return texts
    between = "[,']" if decimal == '.' else "['.]"
    return pc.if_else(grouped, pc.replace_substring_regex(texts, between, ''), texts)


class _Rows(io.RawIOBase):
    """The rows of values of a file; runs of spaces become one where spaces delimit."""

    def __init__(self, file: IO[bytes], dialect: TableDialect) -> None:
        self._file = file
        self._fold = dialect.delimiter == ' '
        file.seek(dialect.skip)

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        if self._fold and data:
            data += self._file.readline(_LONGEST_LINE)
            data = _SPACES.sub(b' ', _EDGES.sub(b'', data))
        return data


def sniff(path: Path) -> TableDialect:
    """Find the dialect of a delimited file; InputError where it has no rows of numbers."""
    with path.open('rb') as file:
        raw = file.read(_HEAD)
        if b'\n' not in raw and b'\r' not in raw:
            raw += file.readline(_LONGEST_LINE)
        whole = not file.read(1)
    lines, encoding, mark = decoded(raw, whole)
    if any('\0' in line for line in lines[:50]):
        raise InputError(f'{path}: a binary file, not delimited text')
    sizes = [len(line.encode(encoding)) for line in lines]
    lines = [line.rstrip('\r\n') for line in lines]
    comments = [i for i, line in enumerate(lines) if line.lstrip().startswith(_COMMENTS)]
    marked = set(comments)
    plain = [i for i, line in enumerate(lines) if line.strip() and i not in marked]
    begin = plain[0] if plain else 0
    best: TableDialect | None = None
    most = 0.0
    longest = max(sizes, default=0)
    for delimiter in _DELIMITERS:
        rows = [_split(line, delimiter) for line in lines[begin : begin + 200]]
        notes = [lines[i].lstrip().lstrip('#%/') for i in comments if i < begin]
        above = [_split(note, delimiter) for note in notes]
        head = find_head(rows, above, [note.split() for note in notes])
        if head is None or len(head.names) < 2:
            continue
        values = rows[head.first_row : head.first_row + 50]
        numeric = _numeric_columns(values, len(head.names))
        # A comma between decimals also splits rows, but into fields that are no numbers.
        if numeric**2 / len(head.names) > most:
            most = numeric**2 / len(head.names)
            comma = delimiter != ',' and _has_decimal_comma(values)
            skip = mark + sum(sizes[: begin + head.first_row])
            best = TableDialect(encoding, delimiter, ',' if comma else '.', head, skip, longest)
    if best is None:
        raise InputError(f'{path}: no rows of numbers found; expected delimited text with a head')
    best.head.check(path)
    if len(best.head.names) > MOST_COLUMNS:
        raise InputError(
            f'{path}: {len(best.head.names)} columns; at most {MOST_COLUMNS} are read'
        )
    return best


def _has_decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    """Tell whether commas stand before decimals, and not between thousands."""
    fields = [field for row in rows for field in row if ',' in field and is_number(field)]
    return bool(fields) and all(f.rfind('.') < f.rfind(',') for f in fields)


def _numeric_columns(rows: Sequence[Sequence[str]], width: int) -> int:
    """Return the number of columns in which most fields are numbers or empty."""
    whole = [row for row in rows if len(row) == width]
    good = ([is_number(f) or f.strip() in _NOTHING for f in row] for row in whole)
    return sum(2 * sum(column) > len(whole) for column in zip(*good, strict=True))


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == ' ':
        return line.split()
    with suppress(csv.Error):
        return next(csv.reader([line], delimiter=delimiter), [])
    return []
