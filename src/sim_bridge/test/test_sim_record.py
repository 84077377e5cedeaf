import numpy as np
import pytest
import yaml
from power_recordings.reading.reader import Recording
from sim_bridge.commands.arguments import SECONDS
from sim_bridge.commands.arguments import record as record_command
from sim_bridge.commands.record import plans
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.errors import InputError


@pytest.fixture(scope='module')
def paper(tmp_path_factory):
    folder = tmp_path_factory.mktemp('sets') / 'paper'
    assert record_command(['paper', '-o', str(folder), '--seconds', '2']) == 0
    return folder


def test_the_papers_set_meters_one_drive_of_each_type_on_rough_ground_with_pushes(paper):
    assert sorted(bag.name for bag in paper.iterdir()) == ['HAA', 'HFE', 'KFE']
    seeds = set()
    for kind in ('HAA', 'HFE', 'KFE'):
        recording = Recording.open(paper / kind)
        assert recording.drive_supply().names == (f'LF_{kind}',)
        assert recording.joint_states().names == JOINT_NAMES
        assert recording.duration == pytest.approx(2.0, abs=0.01)
        assert recording.card.terrain == 'rough'
        assert 'pushes' in recording.card.notes
        seeds.add(recording.card.seed)
    assert len(seeds) == 3


def test_each_policy_walks_the_papers_set_by_seeds_of_its_own(tmp_path, capsys):
    folder, policies = tmp_path / 'paper', ['trot', 'pmp']
    arguments = ['paper', '-o', str(folder), '--seconds', '1', '--controllers', *policies]
    assert record_command(arguments) == 0
    cards = {bag.name: Recording.open(bag).card for bag in folder.iterdir()}
    kinds = ('HAA', 'HFE', 'KFE')
    assert sorted(cards) == sorted(f'{kind}_{name}' for kind in kinds for name in policies)
    assert {cards[f'KFE_{name}'].controller for name in policies} == set(policies)
    assert len({card.seed for card in cards.values()}) == 6
    capsys.readouterr()
    assert record_command([*arguments, '--fastest', '1,1']) == 2
    assert "--fastest is '1,1'; expected VX,VY,YAW" in capsys.readouterr().err
    assert record_command([*arguments, '--fastest', '1,1,1.5']) == 2
    assert 'was recorded with plan' in capsys.readouterr().err
    assert record_command(['robustness', '-o', str(folder), '--controllers', 'pmp']) == 2
    assert '--controllers belongs to the set paper' in capsys.readouterr().err


def test_the_papers_set_may_walk_faster_and_is_kept_as_it_was_recorded(tmp_path, capsys):
    arguments = ['paper', '-o', str(tmp_path), '--seconds', '12', '--fastest', '0.2,0.9,1.8']
    assert record_command(arguments) == 0
    capsys.readouterr()
    assert record_command(arguments) == 0
    assert capsys.readouterr().out.count('there already') == 3
    commands = [
        np.abs(Recording.open(tmp_path / kind).cmd_vel().velocity)
        for kind in ('HAA', 'HFE', 'KFE')
    ]
    vx, vy, yaw = np.concatenate(commands).max(axis=0)
    assert vx <= 0.2
    assert 0.35 < vy <= 0.9
    assert 0.7 < yaw <= 1.8


def test_the_robustness_set_has_other_gaits_and_another_unit(tmp_path, capsys):
    folder = tmp_path / 'set'
    assert record_command(['robustness', '-o', str(folder), '--seconds', '1']) == 0
    cards = {bag.name: Recording.open(bag).card for bag in folder.iterdir()}
    assert {name: card.controller for name, card in cards.items()} == {
        'trot_slow': 'trot_slow',
        'trot_high': 'trot_high',
        'unit': 'trot',
    }
    assert cards['unit'].unit != cards['trot_slow'].unit
    assert all(card.drives == JOINT_NAMES for card in cards.values())
    assert {card.terrain for card in cards.values()} == {'flat'}
    assert f'benchmark {folder / "trot_slow"}' in capsys.readouterr().out


def test_finished_recordings_are_kept_and_broken_ones_are_made_anew(paper, tmp_path):
    kept, broken = paper / 'HAA', paper / 'KFE'
    before = {bag: (bag / f'{bag.name}_0.mcap').stat() for bag in (kept, broken)}
    whole = (broken / f'{broken.name}_0.mcap').read_bytes()
    (broken / 'card.yaml').unlink()
    (broken / f'{broken.name}_0.mcap').write_bytes(whole[:5000])
    assert record_command(['paper', '-o', str(paper), '--seconds', '2']) == 0
    assert (kept / 'HAA_0.mcap').stat().st_mtime_ns == before[kept].st_mtime_ns
    assert (broken / 'KFE_0.mcap').read_bytes() == whole


def test_a_set_that_stopped_before_its_card_was_complete_is_made_anew(paper):
    card = yaml.safe_load((paper / 'HFE' / 'card.yaml').read_text())
    del card['plan']
    (paper / 'HFE' / 'card.yaml').write_text(yaml.safe_dump(card))
    assert record_command(['paper', '-o', str(paper), '--seconds', '2']) == 0
    assert 'plan' in yaml.safe_load((paper / 'HFE' / 'card.yaml').read_text())


@pytest.mark.parametrize(
    ('options', 'quoted'),
    [
        (['--seconds', '3'], 'seconds = 2.0, not 3.0'),
        (['--seconds', '2', '--seed', '5'], "'seed': 5"),
        (['--seconds', '0.5'], '--seconds is 0.5'),
        (['--seconds', '2', '--plant', 'nowhere.yaml'], 'nowhere.yaml'),
    ],
)
def test_bad_input_ends_with_code_2_and_one_line(paper, capsys, options, quoted):
    assert record_command(['paper', '-o', str(paper), *options]) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert quoted in error


def test_help_shows_an_example(capsys):
    with pytest.raises(SystemExit) as end:
        record_command(['--help'])
    assert end.value.code == 0
    assert 'ros2 run sim_bridge record paper -o' in capsys.readouterr().out


def test_seeds_of_the_two_sets_differ():
    seeds = [plan.seed for which in SECONDS for plan in plans(which)]
    assert len(np.unique(seeds)) == 6


@pytest.mark.parametrize('which', ['papers', 'ageing'])
def test_an_unknown_set_is_refused_from_python_too(which):
    with pytest.raises(InputError, match=f"set '{which}' is not one of paper, robustness"):
        plans(which)


def test_two_controllers_of_one_name_are_refused_before_they_walk():
    with pytest.raises(
        InputError, match='two of a/trot, b/trot are called the same; rename a folder'
    ):
        plans('paper', 0, ['a/trot', 'b/trot'])


def test_recordings_made_side_by_side_are_those_of_one_worker(tmp_path, capsys):
    for workers in ('1', '2'):
        folder = tmp_path / workers
        run = ['paper', '-o', str(folder), '--seconds', '1', '--seed', '4', '--workers', workers]
        assert record_command(run) == 0
        assert '3 of 3: ' in capsys.readouterr().out
    for kind in ('HAA', 'HFE', 'KFE'):
        one, two = (tmp_path / workers / kind for workers in ('1', '2'))
        for file in (f'{kind}_0.mcap', 'card.yaml'):
            assert (one / file).read_bytes() == (two / file).read_bytes()


def test_no_workers_and_an_error_in_one_of_several_are_told_in_one_line(tmp_path, capsys):
    run = ['paper', '-o', str(tmp_path / 'set')]
    assert record_command([*run, '--workers', '0']) == 2
    assert '--workers is 0; it must lie in 1..256' in capsys.readouterr().err
    assert record_command([*run, '--seconds', '0.5', '--workers', '2']) == 2
    assert '--seconds is 0.5; it must lie in 1..36000' in capsys.readouterr().err
    assert not (tmp_path / 'set').exists()
