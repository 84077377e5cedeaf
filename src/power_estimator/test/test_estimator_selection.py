import json

import numpy as np
import pytest
from power_estimator.commands.arguments import distil as distil_command
from power_estimator.commands.arguments import sweep as sweep_command
from power_estimator.commands.arguments import train as train_command
from power_estimator.drive_types import infer_types
from power_estimator.evaluation.cost import policy_step_cost, sample_cost
from power_estimator.judge.recordings import Loaded
from power_estimator.loader import load_model
from power_estimator.network.checkpoint import TrainingRecording
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.recordings import TrainingSet
from power_estimator.training.sweep import Result, Sweep, SweepPoint, points
from power_estimator.training.trainer_config import TrainerConfig
from wattwalk_core.errors import InputError

SWEEP = ['--hidden', '4', '--history', '0.05', '--epochs', '2', '--drives', 'LF_HAA']


@pytest.fixture(scope='module')
def swept(bag, tmp_path_factory):
    output = tmp_path_factory.mktemp('runs') / 'sweep'
    assert sweep_command([str(bag), '-o', str(output), *SWEEP]) == 0
    return output


def test_a_sweep_always_holds_the_papers_choice():
    found = points([8], [0.1])
    assert found == (SweepPoint(8), SweepPoint(100), SweepPoint(100, 20), SweepPoint(100, 60))
    with pytest.raises(InputError, match='hidden: expected a whole number from 1 to 1024'):
        points([0], [0.1])
    with pytest.raises(InputError, match='history: expected a whole number from 4'):
        points([8], [0.01])


def test_windows_are_trained_on_as_they_are_used():
    base = TrainerConfig()
    assert SweepPoint(100).training(base) == base
    short, long = (SweepPoint(100, n).training(base) for n in (10, 100))
    assert short.reset_probability == long.reset_probability == 1.0
    assert (short.chunk, long.chunk) == (20, 100)
    assert short.chunk * short.batch == pytest.approx(long.chunk * long.batch, rel=0.05)
    assert SweepPoint(100, 10).network().warm_up < 10


def test_a_sweep_leaves_table_picture_and_costs(swept, capsys):
    table = json.loads((swept / 'table.json').read_text())['points']
    assert [(p['hidden'], p['history'], p['form']) for p in table] == [
        (4, None, 'carried'),
        (100, None, 'carried'),
        (100, 0.05, 'windowed'),
        (100, 0.3, 'windowed'),
    ]
    assert all(p['types']['HAA']['r2'] <= 1 for p in table)
    assert table[1]['us_per_sample'] > table[0]['us_per_sample'] > 0
    assert table[3]['us_per_sample'] > table[2]['us_per_sample']
    assert (swept / 'sweep.png').read_bytes()[:4] == b'\x89PNG'
    assert not (swept / 'state').exists()


def test_a_stopped_sweep_goes_on_and_ends_with_the_same_points(
    swept, bag, tmp_path, monkeypatch, capsys
):
    output = tmp_path / 'sweep'
    judge, calls = Sweep._test, []

    def stop_at_the_third(self, *given):
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return judge(self, *given)

    monkeypatch.setattr(Sweep, '_test', stop_at_the_third)
    command = [str(bag), '-o', str(output), *SWEEP]
    assert sweep_command(command) == 130
    monkeypatch.undo()
    assert 'goes on with the same command and --resume' in capsys.readouterr().out
    kept = (output / 'points' / '4_carried' / 'point.json').stat().st_mtime_ns
    assert sweep_command([*command, '--resume']) == 0
    assert (output / 'points' / '4_carried' / 'point.json').stat().st_mtime_ns == kept
    tables = [json.loads((run / 'table.json').read_text())['points'] for run in (swept, output)]
    assert [p['types'] for p in tables[0]] == [p['types'] for p in tables[1]]
    assert sweep_command([*command, '--resume', '--seed', '7']) == 2
    assert 'was started with training' in capsys.readouterr().err


def test_all_points_are_judged_on_the_same_samples_of_their_test_part(drives):
    data = drives(60.0, ('LF_HAA',))
    loaded = Loaded.of(data)
    known = tuple(TrainingRecording(**one) for one in loaded.identities)
    given = TrainingSet(data, np.zeros((*data.power.shape, 3), np.float32), known)
    wanted = points([4], [0.05])
    training = TrainerConfig(epochs=1)
    sweep = Sweep(given, infer_types(data.names), wanted, training, recordings=loaded)
    counted = []
    for point in wanted:
        validation = sweep.validation(point)
        (job,) = validation.jobs
        found = sweep.judged(point, validation.checkpoint(0, {job: validation.trainer(job)}))
        assert found.held_out == 'its test part'
        counted.append(found.rows)
    assert all((rows == counted[0]).all() for rows in counted)
    assert 100 < counted[0].sum() < 0.1 * 50 * 60


def test_a_damaged_point_is_refused_by_name(swept, bag, capsys):
    file = swept / 'points' / '4_carried' / 'point.json'
    whole = file.read_bytes()
    file.write_bytes(whole[:10])
    assert sweep_command([str(bag), '-o', str(swept), *SWEEP, '--resume']) == 2
    assert 'point.json is damaged' in capsys.readouterr().err
    file.write_bytes(whole)


def test_a_point_that_cannot_be_read_is_not_called_damaged(tmp_path):
    file = tmp_path / 'point.json'
    with pytest.raises(InputError, match=r'cannot read point .*point.json: No such file'):
        Result.load(file, SweepPoint(4))
    file.write_bytes(b'\xff')
    with pytest.raises(InputError, match='is damaged; remove it'):
        Result.load(file, SweepPoint(4))
    file.unlink()
    file.mkdir()
    with pytest.raises(InputError, match=r'point .*point.json: not a regular file'):
        Result.load(file, SweepPoint(4))


@pytest.fixture(scope='module')
def teacher(bag, tmp_path_factory):
    output = tmp_path_factory.mktemp('runs') / 'teacher'
    options = ['--folds', '1', '--epochs', '12', '--hidden', '24', '--workers', '1']
    assert train_command([str(bag), '-o', str(output), *options]) == 0
    return output


@pytest.fixture(scope='module')
def student(teacher, bag, tmp_path_factory):
    output = tmp_path_factory.mktemp('runs') / 'student'
    options = ['--hidden', '16', '--epochs', '20', '--workers', '1', '--robots', '2', '8']
    assert distil_command([str(teacher), str(bag), '-o', str(output), *options]) == 0
    return output


def test_a_student_learns_from_the_teacher_and_loads_like_any_network(student, teacher, bag):
    model = load_model(f'ppn:{student}')
    assert isinstance(model, PowerPredictionNetwork)
    assert model.checkpoint.config.hidden == 16
    assert model.checkpoint.training['teacher'] == str(teacher)
    table = json.loads((student / 'table.json').read_text())
    assert [m['name'] for m in table['models']] == ['teacher', 'student']
    assert [m['name'] for m in table['live']] == ['teacher', 'student']
    for kind in ('HAA', 'HFE'):
        assert table['student_against_teacher'][kind] > 0.5
        big, small = (m['types'][kind]['r2'] for m in table['models'])
        assert small > big - 0.3
    cost = table['us_per_robot_and_policy_step']
    assert set(cost['student']) == {'2', '8'}
    assert all(us > 0 for model in cost.values() for us in model.values())


def test_the_student_is_kept_from_what_the_teacher_has_not_seen(student, teacher):
    big, small = (
        load_model(f'ppn:{run}').checkpoint.recordings[0].held_out for run in (teacher, student)
    )
    assert big == small


def test_a_student_is_smaller_than_its_teacher(teacher, bag, tmp_path, capsys):
    out = str(tmp_path / 'run')
    assert distil_command([str(teacher), str(bag), '-o', out, '--hidden', '24']) == 2
    assert 'hidden = 24 is not below the 24 of the teacher' in capsys.readouterr().err
    assert distil_command([str(tmp_path / 'none'), str(bag), '-o', out]) == 2
    assert 'no such file' in capsys.readouterr().err


def test_costs_are_measured(checkpoint):
    assert 0 < sample_cost(8) < 1e5
    assert 0 < sample_cost(8, 20) < 1e6
    assert 0 < policy_step_cost(PowerPredictionNetwork(checkpoint), ('LF_HAA',), 4) < 1e6


@pytest.mark.parametrize('main', [sweep_command, distil_command])
def test_help_of_selection_shows_an_example(main, capsys):
    with pytest.raises(SystemExit) as end:
        main(['--help'])
    assert end.value.code == 0
    assert 'example: ros2 run power_estimator' in ' '.join(capsys.readouterr().out.split())
