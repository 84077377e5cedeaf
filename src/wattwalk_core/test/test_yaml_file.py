import os
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import SIZE, parse_yaml, read_yaml, shipped_file

BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + '\n'.join(
    f'{chr(98 + i)}: &{chr(98 + i)} [{", ".join([f"*{chr(97 + i)}"] * 9)}]' for i in range(8)
)


def test_plain_values_are_read_as_yaml_has_them():
    content = parse_yaml('a: 1\nb: [1.5, x, true, null]\nc: {d: -2e3, e: 2026-11-22}\n', 'file')
    assert content['a'] == 1
    assert content['b'] == [1.5, 'x', True, None]
    assert content['c']['e'].isoformat() == '2026-11-22'


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        (BOMB, 'file: line 2: aliases (*name) are not allowed'),
        ('a: &x {b: 1}\nc: {<<: {d: 2}}', 'file: line 2: merge keys (<<) are not allowed'),
        ('a: ' + '[' * 900, 'file: line 1: more than 32 levels'),
        ('a: ' + '9' * 400, 'file: line 1: a number of 400 digits'),
        ('a: ' + '9' * 400 + '.0', 'file: line 1: a number of 402 digits'),
        ('a: 1\na: 2', "file: line 2: key 'a' is there twice"),
        ('? [1, 2]\n: 3', 'file: line 1: a key is a list or a mapping'),
        ('a: !!python/object/apply:os.system [echo]', 'file: line 1: tags (!!python/object/app'),
        ('a: [1, 2', "file is no valid YAML: line 2: did not find expected ',' or ']'"),
        ('a: "\x00"', 'file: unacceptable character'),
        ('a: 2026-99-99', 'file is no valid YAML: month must be in 1..12'),
        ('a: !!int ""', 'file: line 1: tags (!!int) are not allowed'),
    ],
)
def test_anything_else_is_refused_in_one_line(text, line):
    with pytest.raises(InputError) as raised:
        parse_yaml(text, 'file')
    assert str(raised.value).startswith(line)
    assert '\n' not in str(raised.value)
    assert len(str(raised.value)) < 300


@given(st.text(alphabet=st.characters(codec='utf-8'), max_size=200))
def test_any_text_is_parsed_or_refused(text):
    with suppress(InputError):
        parse_yaml(text, 'file')


def test_only_regular_files_of_bounded_size_are_opened(tmp_path):
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    large = tmp_path / 'large'
    large.write_bytes(b'#' * (SIZE + 1))
    binary = tmp_path / 'binary'
    binary.write_bytes(b'a: \xff')
    for path, reason in (
        (pipe, 'not a regular file'),
        (tmp_path, 'not a regular file'),
        ('/dev/zero', 'not a regular file'),
        (large, 'larger than 1024 KiB'),
        (binary, 'not UTF-8 text'),
        (tmp_path / 'absent', 'No such file'),
        (tmp_path / ('x' * 5000), 'File name too long'),
    ):
        with pytest.raises(InputError, match=reason):
            read_yaml(type(tmp_path)(path), 'card')


def test_a_shipped_file_goes_by_its_name_and_an_unknown_one_lists_those_shipped(tmp_path):
    (tmp_path / 'walk.yaml').write_text('a: 1')
    assert shipped_file('walk', tmp_path, 'plan') == tmp_path / 'walk.yaml'
    own = tmp_path / 'own.yaml'
    own.write_text('a: 2')
    assert shipped_file(own, tmp_path, 'plan') == own
    with pytest.raises(InputError, match=r"no plan 'run'; give a file, or one of own, walk"):
        shipped_file('run', tmp_path, 'plan')
