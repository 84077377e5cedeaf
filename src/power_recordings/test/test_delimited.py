from pathlib import Path

import numpy as np
import pytest
from power_recordings.importing.sources.delimited import DelimitedFile

TIME = np.arange(300) * 0.001
VOLTS = 48.0 - 0.5 * np.sin(0.31 * np.arange(300))
AMPS = 1.0 + np.sin(0.17 * np.arange(300))


@pytest.mark.parametrize(
    ('delimiter', 'comma'),
    [(',', False), *((text, comma) for text in ';\t| ' for comma in (False, True))],
)
@pytest.mark.parametrize('columns', [2, 3])
def test_delimiter_and_decimal_mark_are_told_apart(
    tmp_path: Path, delimiter: str, comma: bool, columns: int
) -> None:
    table = np.column_stack([TIME, VOLTS, AMPS])[:, :columns]
    names = ['time', 'voltage', 'current'][:columns]
    rows = [delimiter.join(f'{value:.5f}' for value in row) for row in table]
    rows = [row.replace('.', ',') for row in rows] if comma else rows
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([delimiter.join(names), *rows]) + '\n')
    file = DelimitedFile(path)
    assert [column.address for column in file.columns()] == names
    blocks = list(file.read(names, lambda size: None))
    for index, name in enumerate(names):
        values = np.concatenate([block.values[name] for block in blocks])
        np.testing.assert_allclose(values, table[:, index], atol=1e-5)


def test_a_column_of_dates_does_not_hide_the_delimiter(tmp_path: Path) -> None:
    path = tmp_path / 'log.csv'
    rows = [f'15.06.2025 14:00:00.{i:03d};48,{i:03d};1,{i:03d}' for i in range(300)]
    path.write_text('\n'.join(['Zeit;Spannung;Strom', *rows]) + '\n')
    assert DelimitedFile(path).dialect.delimiter == ';'


@pytest.mark.parametrize(
    ('text', 'values'),
    [
        ('a;b\n1.234,5;2\n999,25;3\n', [1234.5, 999.25]),
        ('a\tb\n1,234.5\t2.5\n999.25\t3\n', [1234.5, 999.25]),
        ('a,b\n"1,234.5",2\n"12,999",3\n', [1234.5, 12999.0]),
        ("a;b\n1'234.5;2\n999.25;3\n", [1234.5, 999.25]),
    ],
)
def test_marks_between_thousands_are_no_decimals(tmp_path, text, values):
    (tmp_path / 'log.csv').write_text(text)
    blocks = list(DelimitedFile(tmp_path / 'log.csv').read(['a'], lambda done: None))
    assert np.concatenate([block.values['a'] for block in blocks]).tolist() == values


def test_a_preamble_with_a_row_of_numbers_and_names_above_comments_is_read(tmp_path):
    text = 'Samples\t40\t40\t\n***End***\t\t\t\nX_Value\tTorque [Nm]\tI [A]\tComment\n'
    text += ''.join(f'{i / 10}\t{i}\t2\t\n' for i in range(9))
    (tmp_path / 'log.lvm').write_text(text)
    columns = DelimitedFile(tmp_path / 'log.lvm').columns()
    assert [column.address for column in columns][:3] == ['X_Value', 'Torque [Nm]', 'I [A]']


@pytest.mark.parametrize('note', [' (0..360)', ' (x' * 33_000 + ')', ' ' * 50_000 + '(wrapped)'])
def test_a_unit_is_read_before_a_note_of_any_length(tmp_path, note):
    """Up to 100 kB in one field, in the time that a pass over it takes."""
    rows = ''.join(f'{i / 10},{i},2\n' for i in range(9))
    (tmp_path / 'log.csv').write_text(f't,q,n\ns,deg{note},rpm\n{rows}')
    columns = DelimitedFile(tmp_path / 'log.csv').columns()
    assert [column.unit for column in columns] == ['s', 'deg', 'rpm']
