import subprocess
import sys
from dataclasses import field, replace
from typing import Annotated, ClassVar, Literal

import pytest
from wattwalk_core.errors import InputError
from wattwalk_core.schema import (
    CheckedFields,
    Length,
    Name,
    Quantity,
    check,
    parse,
    read,
    schema,
)


@schema
class Winding:
    resistance: Annotated[float, Quantity(0.01, 10.0, 'ohm', 'at 25 °C')] = 0.5


@schema
class Drive:
    kind: Literal['HAA', 'HFE', 'KFE']
    winding: Winding = field(default_factory=Winding)
    poles: Annotated[int, Quantity(2, 64)] = 8
    names: tuple[str, ...] = ()
    braked: bool = False
    crew: Annotated[tuple[Name, ...], Length(1)] = ('A',)
    limits: dict[str, Annotated[float, Quantity(0.0, 100.0, 'N·m')]] = field(default_factory=dict)

    def __post_init__(self):
        if self.braked and self.poles == 2:
            raise InputError('a braked drive has more than 2 poles')


def test_content_becomes_a_frozen_dataclass_with_its_defaults():
    drive = parse(Drive, {'kind': 'KFE', 'names': ['a', 'b'], 'limits': {'a': 3}}, 'drive x.yaml')
    assert drive == Drive('KFE', names=('a', 'b'), limits={'a': 3.0})
    assert isinstance(drive.limits['a'], float)
    assert replace(drive, poles=4).poles == 4


@pytest.mark.parametrize(
    ('content', 'line'),
    [
        ({}, "'kind' is missing"),
        ({'kind': 'XYZ'}, "kind: expected 'HAA', 'HFE' or 'KFE', there is 'XYZ'"),
        (
            {'kind': 'HAA', 'winding': {'resistance': 11}},
            'winding.resistance: expected 0.01 to 10 ohm, there is 11',
        ),
        (
            {'kind': 'HAA', 'winding': {'ohm': 1}},
            "winding: unknown key 'ohm'; there can be resistance",
        ),
        ({'kind': 'HAA', 'winding': 3}, 'winding: expected keys with values, there is 3'),
        ({'kind': 'HAA', 'poles': 2.5}, 'poles: expected a whole number from 2 to 64, there is 2'),
        (
            {'kind': 'HAA', 'poles': True},
            'poles: expected a whole number from 2 to 64, there is T',
        ),
        ({'kind': 'HAA', 'names': 'a'}, "names: expected a list, there is 'a'"),
        ({'kind': 'HAA', 'names': ['a', 1]}, 'names[1]: expected text, there is 1'),
        ({'kind': 'HAA', 'crew': []}, 'crew: expected at least 1 values, there are 0'),
        ({'kind': 'HAA', 'crew': ['']}, 'crew[0]: expected a name of 1 to 200 printable'),
        ({'kind': 'HAA', 'crew': ['\x1b[31m']}, 'crew[0]: expected a name of 1 to 200 printable'),
        ({'kind': 'HAA', 'braked': 1}, 'braked: expected true or false, there is 1'),
        ({'kind': 'HAA', 'limits': {'a': -1}}, 'limits.a: expected 0 to 100 N·m, there is -1'),
        ({'kind': 'HAA', 'limits': {'a': float('nan')}}, 'limits.a: expected 0 to 100 N·m'),
        ({'kind': 'HAA', 'limits': {'a': float('inf')}}, 'limits.a: expected 0 to 100 N·m'),
        ({'kind': 'HAA', 'braked': True, 'poles': 2}, 'a braked drive has more than 2 poles'),
        ([], 'expected keys with values, there is []'),
        (None, 'expected keys with values, there is None'),
    ],
)
def test_an_error_is_one_line_with_file_entry_value_and_what_is_allowed(content, line):
    with pytest.raises(InputError) as raised:
        parse(Drive, content, 'drive x.yaml')
    assert str(raised.value).startswith(f'drive x.yaml: {line}')
    assert '\n' not in str(raised.value)


def test_a_value_of_a_megabyte_is_quoted_short():
    with pytest.raises(InputError) as raised:
        parse(Drive, {'kind': 'x' * 1_000_000}, 'drive')
    assert len(str(raised.value)) < 200


def test_a_list_that_is_too_short_or_long_is_refused_with_its_length():
    with pytest.raises(InputError, match=r'^x: expected more values, there are 1'):
        parse(tuple[float, float], [1.0], 'x')
    with pytest.raises(InputError, match=r'^x: expected at most 2 values, there are 3'):
        parse(tuple[float, float], [1.0, 2.0, 3.0], 'x')


@schema
class Gait:
    RENAMED: ClassVar = {'hurry': 'cadence'}
    cadence: float = 1.0


def test_a_former_key_is_read_as_the_present_one():
    assert parse(tuple[Gait, ...], [{'hurry': 2}, {'cadence': 3}], 'gaits') == (Gait(2), Gait(3))
    with pytest.raises(InputError, match=r"gaits: \[0\]: 'cadence' is there twice, once by its"):
        parse(tuple[Gait, ...], [{'hurry': 2.0, 'cadence': 2.0}], 'gaits')
    with pytest.raises(InputError, match=r"gait: cadence: expected a number, there is 'fast'"):
        parse(Gait, {'hurry': 'fast'}, 'gait')


def test_an_error_of_the_class_itself_has_the_place_of_the_entry():
    drives = [{'kind': 'HAA'}, {'kind': 'HAA', 'braked': True, 'poles': 2}]
    with pytest.raises(InputError, match=r'^drives: \[1\]: a braked drive has more than 2 poles'):
        parse(tuple[Drive, ...], drives, 'drives')
    with pytest.raises(InputError, match=r'^a braked drive'):
        Drive('HAA', braked=True, poles=2)


def test_an_instance_made_by_code_is_checked_like_a_file():
    check(Winding(0.01), 'winding')
    with pytest.raises(InputError, match=r'winding: resistance: expected 0\.01 to 10 ohm'):
        check(Winding(0.001), 'winding')


def test_a_file_is_read_and_named_in_errors(tmp_path):
    path = tmp_path / 'drive.yaml'
    path.write_text('kind: HFE\npoles: 4\n')
    assert read(Drive, path, 'drive') == Drive('HFE', poles=4)
    path.write_text('kind: HFE\npoles: 400\n')
    with pytest.raises(InputError, match=f'drive {path}: poles: .* there is 400'):
        read(Drive, path, 'drive')


def test_importing_a_schema_does_not_import_pydantic():
    code = 'import sys, wattwalk_core.schema; print("pydantic" in sys.modules)'
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == 'False'


@schema
class Timing(CheckedFields):
    rate: Annotated[float, Quantity(10.0, 1000.0, 'Hz')] = 200.0
    block: Annotated[int, Quantity(1, 100)] = 4

    def __post_init__(self):
        super().__post_init__()


def test_an_instance_made_by_code_may_check_its_own_quantities():
    assert Timing(block=5.0).block == 5
    with pytest.raises(InputError, match='block: expected a whole number from 1 to 100, there is'):
        Timing(block=0)
    with pytest.raises(InputError, match=r'^timing: rate: expected 10 to 1000 Hz, there is nan'):
        parse(Timing, {'rate': float('nan')}, 'timing')
