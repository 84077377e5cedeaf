from dataclasses import replace
from pathlib import Path

import pytest
from power_recordings.card import Card
from power_recordings.writing.metadata import CardFile
from wattwalk_core.errors import InputError
from wattwalk_core.files import RecordingError

CARD = Card(
    robot='anymal_c',
    unit='A',
    drives=('LF_HAA', 'LF_HFE', 'LF_KFE'),
    controller='trot',
    terrain='flat',
    notes='zweite Fahrt: kälter',
    seed=7,
    created='2025-01-02T03:04:05+00:00',
    other={'load_kg': 4.5, 'crew': ['A', 'B']},
)


def test_a_card_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    CARD.save(tmp_path)
    assert Card.load(tmp_path) == CARD
    assert Card.load(tmp_path / 'card.yaml') == CARD
    assert [p.name for p in tmp_path.iterdir()] == ['card.yaml']


def test_drive_types_follow_from_the_names() -> None:
    card = Card(drives=('LF_HAA', 'RH_KFE', 'bench'))
    assert card.drive_types == {'LF_HAA': 'HAA', 'RH_KFE': 'KFE', 'bench': 'bench'}


def test_keys_that_are_not_known_are_kept(tmp_path: Path) -> None:
    (tmp_path / 'card.yaml').write_text('robot: dog\nunit: 3\ncreated: 2025-01-02\nfans: [1, 2]\n')
    card = Card.load(tmp_path)
    assert (card.robot, card.unit, card.created) == ('dog', '3', '2025-01-02')
    assert card.other == {'fans': [1, 2]}
    card.save(tmp_path)
    assert Card.load(tmp_path) == card


def test_a_card_with_one_value_at_two_places_can_be_read_again(tmp_path: Path) -> None:
    legs = ['LF', 'RF']
    Card(other={'front': legs, 'driven': legs}).save(tmp_path)
    assert Card.load(tmp_path).other == {'front': legs, 'driven': legs}


def test_what_a_source_tells_is_on_disk_at_once_and_what_the_user_says_stands(
    tmp_path: Path,
) -> None:
    file = CardFile(Card(robot='dog'), tmp_path)
    assert Card.load(tmp_path) == Card(robot='dog')
    told = Card.of_source({'M1': 'motor'}, {'M1': 'A'}, ('M1',))
    file.add_source(Card.parse(replace(told, calibration='a.yaml').text(), 'topic card'))
    file.add_source(Card.of_source({'M2': 'joint'}, {}))
    file.add_source(Card(calibration='b.yaml'))
    file.add_drives(('M1', 'M2'))
    card = Card.load(tmp_path)
    assert (card.torque, card.torque_unit) == ({'M1': 'motor', 'M2': 'joint'}, {'M1': 'A'})
    assert (card.robot, card.drives) == ('dog', ('M1', 'M2'))
    assert (card.calibration, card.derived_velocity) == ('a.yaml, b.yaml', ('M1',))
    file.add_mark(1_700_000_000_000_000_000, 'slipped')
    assert [mark.text for mark in Card.load(tmp_path).marks] == ['slipped']
    assert Card.load(tmp_path).torque == card.torque

    said = Card(torque={'M1': 'joint'}, calibration='mine', drives=('M1',))
    file = CardFile(said, tmp_path)
    file.add_source(replace(told, calibration='a.yaml'))
    file.add_drives(('M1', 'M2'))
    assert Card.load(tmp_path) == said.with_derived_velocity(('M1',))


def test_a_source_that_tells_another_place_of_torque_is_refused() -> None:
    with pytest.raises(InputError, match=r"topic card: torque\.M1: .*'moon'"):
        Card.parse('torque: {M1: moon}', 'topic card')


def test_an_empty_card_is_a_card(tmp_path: Path) -> None:
    (tmp_path / 'card.yaml').write_text('# nothing yet\nunit:\n')
    assert Card.load(tmp_path) == Card()


@pytest.mark.parametrize(
    ('text', 'error'),
    [
        ('[1, 2]', r'expected keys with values, there is \[1, 2\]'),
        ('robot: [a', r'is no valid YAML'),
        ('robot: {a: 1}', r"robot: expected text, there is \{'a': 1\}"),
        ('drives: LF_HAA', r"drives: expected a list, there is 'LF_HAA'"),
        ('drives: [LF_HAA, LF_HAA]', r"drives: 'LF_HAA' is empty or there twice"),
        ('drives: [1]', r'drives\[0\]: expected text, there is 1'),
        ('seed: soon', r"seed: expected a whole number, there is 'soon'"),
        ('seed: true', r'seed: expected a whole number, there is True'),
        ('robot: !!python/object/apply:os.getcwd []', r'tags .* are not allowed'),
    ],
)
def test_a_card_that_makes_no_sense_is_refused(tmp_path: Path, text: str, error: str) -> None:
    (tmp_path / 'card.yaml').write_text(text)
    with pytest.raises(InputError, match=error) as caught:
        Card.load(tmp_path)
    assert str(tmp_path / 'card.yaml') in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_card_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'cannot read .*card\.yaml: No such file'):
        Card.load(tmp_path)


def test_saving_where_it_is_not_possible_says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match='there is no such folder'):
        CARD.save(tmp_path / 'nowhere')
