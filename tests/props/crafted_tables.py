"""Hostile tables made on purpose: bombs, lies, loops and names."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from hostile_files import LONG, RED


def delimited_files() -> Iterator[tuple[str, bytes]]:
    head, row = b't,pos,vel,iq,v,i\n', b'%d,1,2,3,24,%d\n'
    rows = b''.join(row % (i, i % 7) for i in range(50))
    yield from (
        ('nothing but a head', head),
        ('spaces', b' ' * 10_000),
        ('blank lines', b'\n' * 100_000),
        ('a million columns', b','.join(b'c%d' % i for i in range(10**6)) + b'\n' + b'1,' * 10**6),
        ('200,000 columns of 5 rows', (b','.join(b'1' for _ in range(200_000)) + b'\n') * 5),
        (
            '30,000 columns',
            b','.join(b'a_%x' % i for i in range(30_000)) + b'\n' + b'1,' * 29_999 + b'1\n',
        ),
        ('one line of 30 MB', b'1,' * (15 << 20)),
        ('one word of 30 MB', b'x' * (30 << 20)),
        ('one line of 30 MB in its middle', head + rows + b'7,' * (15 << 20) + b'\n' + rows),
        ('NUL bytes', head + rows + bytes(5000) + rows),
        ('NUL bytes first', bytes(5000) + head + rows),
        ('a quote never closed', head + rows + b'"' + rows * 50),
        ('quotes everywhere', (b'"' * 6 + b'\n') * 500),
        ('UTF-16', ('t,pos\n' + '1,2\n' * 50).encode('utf-16')),
        ('no UTF-8', head + rows + b'\xff\xfe\xfd' * 50),
        ('only NaN', head + b'nan,nan,nan,nan,nan,nan\n' * 50),
        ('only infinities', head + b'inf,inf,inf,inf,inf,inf\n' * 50),
        ('one time', head + b'1,1,1,1,1,1\n' * 50),
        ('times that go back', head + b''.join(row % (-i, 1) for i in range(50))),
        ('times that go to and fro', head + b''.join(row % (i * 7 % 13, 1) for i in range(50))),
        (
            'times beyond all',
            head + b''.join(b'%d,1,2,3,24,1\n' % (i * 10**17) for i in range(50)),
        ),
        (
            'numbers of 400 digits',
            head + b''.join(b'%d,1,2,3,24,%s\n' % (i, b'9' * 400) for i in range(50)),
        ),
        ('exponents of 400', head + b''.join(b'%d,1,2,3,24,1e400\n' % i for i in range(50))),
        ('texts', head + b'a,b,c,d,e,f\n' * 50),
        ('names in red', f'{RED},{RED},{RED}\n'.encode() + b'1,2,3\n' * 50),
        ('long names', f'{LONG},{LONG}x,t\n'.encode() + b'1,2,3\n' * 50),
        (
            'units that compute',
            b't,a [9**9**9**9],b [10^10^10],c (1e9**1e9)\n' + b'1,2,3,4\n' * 50,
        ),
        (
            'units that call',
            b't,a [__import__("os")],b [exec],c [lambda: 0]\n' + b'1,2,3,4\n' * 50,
        ),
        ('the same names', b't,t,t,t,t,t\n' + rows),
        ('a byte-order mark alone', b'\xef\xbb\xbf'),
        ('a formula', head + rows + b'=cmd|" /C calc"!A0,1,2,3,4,5\n'),
        ('other numbers of fields', head + rows + b'1,2\n1,2,3,4,5,6,7,8\n' * 50),
        ('carriage returns', (head + rows).replace(b'\n', b'\r') + b'\r' * 5000),
        ('comments without end', b'# nothing\n' * 20_000),
    )


def json_files() -> Iterator[tuple[str, bytes]]:
    yield 'nesting', b'[' * 100_000 + b']' * 100_000
    yield 'nested objects', b'{"a":' * 100_000 + b'1' + b'}' * 100_000
    yield 'never closed', b'{"t": [1, 2, 3'
    yield 'a scalar', b'7'
    yield 'digits', b'{"t": [' + b'9' * 10_000 + b', 1]}'
    yield 'infinities', b'{"t": [1e400, -1e400, NaN, Infinity]}'
    yield 'ragged', json.dumps({'t': [[1], [1, 2], 'x', None, {}]}).encode()
    yield (
        'keys that differ in each record',
        json.dumps([{f'k{i}': i} for i in range(30_000)]).encode(),
    )
    yield 'a long key', json.dumps({LONG: [1, 2, 3]}).encode()
    yield 'a key in red', json.dumps({RED: [1, 2, 3], 'pos': [1, 2, 3]}).encode()
    yield 'empty lists', json.dumps([[]] * 100_000).encode()
    yield 'lists of lists', json.dumps([[[[[[1]]]]]] * 1000).encode()
    yield 'surrogates', b'{"\\ud800": [1, 2, 3]}'
    yield 'no UTF-8', b'{"t": [1, 2], "\xff": 3}'


def workbooks() -> Iterator[tuple[str, bytes]]:
    from openpyxl import Workbook

    book = Workbook()
    book.active.append(['t', 'pos'])
    for i in range(30):
        book.active.append([i, i])
    made = io.BytesIO()
    book.save(made)
    sheet = 'xl/worksheets/sheet1.xml'
    space = 'http://schemas.openxmlformats.org/spreadsheetml/2006/main'

    def with_part(name: str, content: bytes) -> bytes:
        result = io.BytesIO()
        with (
            zipfile.ZipFile(made) as old,
            zipfile.ZipFile(result, 'w', zipfile.ZIP_DEFLATED) as new,
        ):
            for part in old.namelist():
                if part != name:
                    new.writestr(part, old.read(part))
            new.writestr(name, content)
        return result.getvalue()

    def rows(inner: str, before: str = '', dimension: str = 'A1:B3') -> bytes:
        return (
            f'<?xml version="1.0"?>{before}<worksheet xmlns="{space}">'
            f'<dimension ref="{dimension}"/><sheetData>{inner}</sheetData></worksheet>'
        ).encode()

    cells = '<row r="1"><c r="A1"><v>1</v></c><c r="B1"><v>2</v></c></row>'
    laughs = '<!DOCTYPE a [<!ENTITY a0 "ha">' + ''.join(
        f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12)
    )
    outside = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    for name, content in (
        ('a sheet of zeros', bytes(100 << 20)),
        ('a sheet of spaces', b' ' * (30 << 20)),
        ('no XML', b'nothing'),
        (
            'entities without end',
            rows('<row r="1"><c r="A1"><v>&a11;</v></c></row>', laughs + ']>'),
        ),
        ('a file from outside', rows('<row r="1"><c r="A1"><v>&x;</v></c></row>', outside)),
        (
            'a row far away',
            rows(cells + '<row r="999999999"><c r="A999999999"><v>1</v></c></row>'),
        ),
        ('a column far away', rows('<row r="1"><c r="ZZZ1"><v>1</v></c></row>')),
        ('a column beyond', rows('<row r="1"><c r="AAAAAAAA1"><v>1</v></c></row>')),
        ('a size that lies', rows(cells, dimension='A1:XFD1048576')),
        ('rows that go back', rows('<row r="-5"/><row r="0"/>' + cells)),
        ('a type that is none', rows('<row r="1"><c r="A1" t="zz"><v>1</v></c></row>')),
        ('texts that are not there', rows('<row r="1"><c r="A1" t="s"><v>99999</v></c></row>')),
        ('nested', b'<a>' * 100_000),
    ):
        yield name, with_part(sheet, content)
    yield 'texts of zeros', with_part('xl/sharedStrings.xml', bytes(100 << 20))
    yield 'no workbook', with_part('xl/workbook.xml', b'<a/>')
    yield 'an empty archive', b'PK\x05\x06' + bytes(18)


def hdf5_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    import h5py

    def made(fill: Callable[[h5py.File], object]) -> bytes:
        path = folder / 'made.h5'
        with h5py.File(path, 'w') as file:
            fill(file)
        return path.read_bytes()

    chunked = {'chunks': (1 << 16,), 'dtype': 'f8'}
    zeros = {**chunked, 'compression': 'gzip', 'data': np.zeros(1 << 24)}
    yield 'a dataset of nothing', made(lambda f: f.create_dataset('t', (1 << 40,), **chunked))
    yield 'zeros', made(lambda f: f.create_dataset('t', **zeros))
    yield (
        'a million columns',
        made(
            lambda f: f.create_dataset('t', (2000, 1000, 1000), chunks=(1, 1000, 1000), dtype='f4')
        ),
    )
    yield (
        'data in another file',
        made(lambda f: f.create_dataset('t', (1000,), 'f8', external=[('/etc/passwd', 0, 8000)])),
    )
    layout = h5py.VirtualLayout((1000,), 'f8')
    layout[:] = h5py.VirtualSource('/etc/passwd', 't', (1000,))
    yield 'data that is virtual', made(lambda f: f.create_virtual_dataset('t', layout))
    yield 'links in a ring', made(lambda f: f.update({'a': h5py.SoftLink('/a')}))
    yield 'groups in a ring', made(lambda f: f.create_group('a').__setitem__('b', f['a']))
    yield 'a link outside', made(lambda f: f.update({'a': h5py.ExternalLink('/dev/zero', 'x')}))
    yield 'a name in red', made(lambda f: f.update({RED: np.zeros(5)}))
    yield 'nothing', made(lambda f: None)
    yield 'texts', made(lambda f: f.update({'t': ['a', 'b']}))
    yield 'a signature alone', b'\x89HDF\r\n\x1a\n' + bytes(100)


def arrow_files() -> Iterator[tuple[str, bytes]]:
    import pyarrow as pa
    from pyarrow import feather, parquet

    for name, table in (
        ('16 million zeros', pa.table({'t': pa.array(np.zeros(16_000_000))})),
        ('no columns', pa.table({})),
        ('no rows', pa.table({'t': pa.array([], pa.float64())})),
        ('a name in red', pa.table({RED: [1.0, 2.0], 't': [1.0, 2.0]})),
        ('the same names', pa.table([[1.0], [2.0]], names=['t', 't'])),
        ('lists', pa.table({'t': [[1.0], [1.0, 2.0]]})),
        ('texts', pa.table({'t': ['x', 'y'], 'pos': ['a', None]})),
        ('25,000 columns', pa.table({f'c{i}': [1.0] for i in range(25_000)})),
    ):
        sink = io.BytesIO()
        parquet.write_table(table, sink, compression='zstd')
        yield f'parquet: {name}', sink.getvalue()
        if table.num_columns == len(set(table.column_names)):
            sink = io.BytesIO()
            feather.write_feather(table, sink, compression='zstd')
            yield f'feather: {name}', sink.getvalue()
    yield 'parquet: magic alone', b'PAR1' + bytes(50) + b'PAR1'
    yield 'parquet: a foot of 2 GB', b'PAR1' + bytes(50) + struct.pack('<I', 2**31 - 1) + b'PAR1'
    yield 'feather: magic alone', b'ARROW1\0\0' + bytes(50) + b'ARROW1'


def mat_files() -> Iterator[tuple[str, bytes]]:
    head = b'MATLAB 5.0 MAT-file'.ljust(124) + b'\x00\x01IM'
    yield 'a head alone', head
    yield 'an element of 4 GB', head + struct.pack('<II', 14, 2**32 - 1) + bytes(100)
    yield 'zeros, packed', head + struct.pack('<II', 15, 20_000) + zlib.compress(bytes(20 << 20))
    yield 'version 4, huge', struct.pack('<5I', 0, 2**31 - 1, 2**31 - 1, 0, 2) + b't\0' + bytes(50)
    yield 'a function', head + struct.pack('<II', 14, 16) + struct.pack('<IIII', 6, 8, 16, 0)
