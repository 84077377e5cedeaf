import json
import shutil

import numpy as np
import pytest
import yaml
from power_estimator.commands.arguments import benchmark as benchmark_command
from power_estimator.commands.arguments import replay as replay_command
from power_estimator.commands.arguments import train as train_command
from power_estimator.network.checkpoint import Checkpoint
from power_estimator.proxies import PROXIES
from power_estimator.training.cross_validation import CrossValidation
from power_recordings.reading.reader import Recording

QUICK = ['--folds', '2', '--epochs', '4', '--hidden', '12', '--workers', '1']


@pytest.fixture(scope='module')
def trained(bag, tmp_path_factory):
    output = tmp_path_factory.mktemp('runs') / 'first'
    assert train_command([str(bag), '-o', str(output), *QUICK]) == 0
    return output


def test_a_run_folder_holds_all_that_is_needed_to_judge_and_to_repeat_it(trained, bag):
    assert sorted(p.name for p in trained.iterdir()) == [
        'config.yaml',
        'curves.json',
        'folds',
        'model.safetensors',
        'r2.png',
        'recordings.yaml',
        'table.json',
        'traces.png',
    ]
    assert yaml.safe_load((trained / 'config.yaml').read_text())['network']['hidden'] == 12
    (card,) = yaml.safe_load((trained / 'recordings.yaml').read_text())
    assert card['name'] == bag.name
    assert len(card['sha256']) == 64
    curves = json.loads((trained / 'curves.json').read_text())
    assert [len(curves[f'{t}-{f}']) for t in ('HAA', 'HFE') for f in (0, 1)] == [4, 4, 4, 4]


def test_the_table_lists_the_network_and_all_proxies_per_drive_and_type(trained):
    models = json.loads((trained / 'table.json').read_text())['models']
    assert [m['name'] for m in models] == ['ppn', *PROXIES, 'plain']
    for model in models:
        assert set(model['drives']) == {'LF_HAA', 'LF_HFE'}
        assert set(model['types']) == {'HAA', 'HFE'}
        assert {'r2', 'r2_std', 'rmse_w', 'energy_error'} <= set(model['drives']['LF_HAA'])
        assert model['supply']['r2'] <= 1


def test_train_prints_the_table_and_what_to_type_next(bag, tmp_path, capsys):
    output = tmp_path / 'run'
    assert train_command([str(bag), '-o', str(output), *QUICK, '--folds', '1']) == 0
    printed = capsys.readouterr().out
    assert 'torque_squared' in printed
    assert f'ros2 run power_estimator estimate --ros-args -p model:=ppn:{output}' in printed


def test_training_on_some_drives_only(bag, tmp_path):
    output = tmp_path / 'run'
    options = [*QUICK, '--folds', '1', '--drives', '*_HFE']
    assert train_command([str(bag), '-o', str(output), *options]) == 0
    assert [n.type.name for n in Checkpoint.load(output).networks] == ['HFE']


def test_a_stopped_training_is_resumed_to_the_same_network(bag, trained, tmp_path, monkeypatch):
    output = tmp_path / 'run'
    command = [str(bag), '-o', str(output), *QUICK]
    epoch = CrossValidation.trainer
    begun = []

    def interrupt_the_third(self, job):
        begun.append(job)
        if len(begun) == 3:
            raise KeyboardInterrupt
        return epoch(self, job)

    monkeypatch.setattr(CrossValidation, 'trainer', interrupt_the_third)
    assert train_command(command) == 130
    monkeypatch.undo()
    assert not (output / 'model.safetensors').exists()
    assert train_command([*command, '--resume']) == 0
    one, other = (Checkpoint.load(run) for run in (trained, output))
    for a, b in zip(one.networks, other.networks, strict=True):
        assert np.array_equal(a.weights.recurrent, b.weights.recurrent)
    assert (trained / 'table.json').read_text() == (output / 'table.json').read_text()


def test_benchmark_judges_a_network_on_what_it_was_not_trained_on(trained, bag, tmp_path, capsys):
    file = tmp_path / 'b.json'
    picture = tmp_path / 'b.png'
    command = [str(bag), '--models', f'ppn:{trained}', 'torque_squared', '--json', str(file)]
    assert benchmark_command([*command, '--picture', str(picture)]) == 0
    assert 'held out' in capsys.readouterr().out
    models = json.loads(file.read_text())['models']
    assert [m['name'] for m in models] == [f'ppn:{trained}', 'torque_squared']
    # one tenth of 40 s at 50 Hz, less margins
    assert models[0]['drives']['LF_HAA']['samples'] < 200
    assert picture.read_bytes()[:4] == (tmp_path / 'b_r2.png').read_bytes()[:4] == b'\x89PNG'


def test_the_table_of_train_and_benchmark_agree(bag, tmp_path):
    run, file = tmp_path / 'run', tmp_path / 'b.json'
    assert train_command([str(bag), '-o', str(run), *QUICK, '--folds', '1']) == 0
    command = [str(bag), '--models', f'ppn:{run}', *PROXIES, 'plain', '--json', str(file)]
    assert benchmark_command(command) == 0
    trained, benchmarked = (
        json.loads(path.read_text())['models'] for path in (run / 'table.json', file)
    )
    for one, other in zip(trained, benchmarked, strict=True):
        assert one | {'name': ''} == other | {'name': ''}


def test_benchmark_judges_on_all_of_a_recording_that_is_new(trained, bags, tmp_path, capsys):
    other = bags(tmp_path / 'other', 20.0, seed=5)
    file = tmp_path / 'b.json'
    command = [str(other), '--models', f'ppn:{trained}', *PROXIES, '--json', str(file)]
    assert benchmark_command(command) == 0
    models = json.loads(file.read_text())['models']
    assert models[0]['drives']['LF_HAA']['samples'] > 900
    best = max(m['types']['HAA']['r2'] for m in models)
    assert models[0]['types']['HAA']['r2'] == best


def test_benchmark_measures_the_coverage_of_intervals(trained, bag, tmp_path):
    file = tmp_path / 'b.json'
    spec = f'ppn:{trained}'
    assert benchmark_command([str(bag), '--models', spec, 'plain', '--json', str(file)]) == 0
    network, plain = json.loads(file.read_text())['models']
    (kept,) = json.loads((trained / 'table.json').read_text())['models'][:1]
    for score in (network['drives']['LF_HAA'], network['types']['HAA'], kept['types']['HAA']):
        assert {'coverage', 'interval_w'} <= set(score)
    assert plain['name'] == 'plain'
    assert plain['drives']['LF_HAA']['coverage'] is None
    assert plain['types']['HAA']['r2'] < 1


def test_the_plain_model_is_fitted_where_no_network_tells_what_to_leave_out(bags, tmp_path):
    file, other = tmp_path / 'b.json', bags(tmp_path / 'other', 30.0, seed=5)
    assert benchmark_command([str(other), '--models', 'plain', '--json', str(file)]) == 0
    (plain,) = json.loads(file.read_text())['models']
    assert plain['types']['HFE']['r2'] > 0.2
    assert abs(plain['types']['HFE']['bias_w']) < 1


def test_an_arm_of_three_joints_trains_by_the_same_command(bags, tmp_path, capsys):
    arm = bags(tmp_path / 'arm', 38.0, names=('shoulder', 'elbow', 'wrist'))
    output = tmp_path / 'run'
    assert train_command([str(arm), '-o', str(output), *QUICK, '--folds', '1']) == 0
    types = [n.type.name for n in Checkpoint.load(output).networks]
    assert types == ['shoulder', 'elbow', 'wrist']
    (ppn, *_) = json.loads((output / 'table.json').read_text())['models']
    assert set(ppn['drives']) == set(types)
    estimate = tmp_path / 'estimate'
    assert replay_command([str(arm), '--model', f'ppn:{output}', '-o', str(estimate)]) == 0
    assert Recording.open(estimate).power_estimate().names == ('shoulder', 'elbow', 'wrist')


def test_replay_writes_a_bag_of_estimates_that_plays_beside_the_original(trained, bag, tmp_path):
    output = tmp_path / 'estimate'
    assert replay_command([str(bag), '--model', f'ppn:{trained}', '-o', str(output)]) == 0
    original, replayed = Recording.open(bag), Recording.open(output)
    found = replayed.power_estimate()
    assert found.names == ('LF_HAA', 'LF_HFE')
    assert len(found) == pytest.approx(40 * 50, abs=5)
    assert original.start_ns < replayed.start_ns < replayed.end_ns <= original.end_ns
    assert np.diff(found.stamp_ns).min() == np.diff(found.stamp_ns).max() == 20_000_000
    assert found.total[10] == pytest.approx(found.power[10].sum(), rel=1e-4)
    assert set(found.status[:4]) == {1}
    assert replay_command([str(bag), '--model', f'ppn:{trained}', '-o', str(output)]) == 2


def test_replay_of_a_recording_with_a_damaged_card_writes_no_bag(trained, bag, tmp_path, capsys):
    damaged, output = tmp_path / 'damaged', tmp_path / 'estimate'
    shutil.copytree(bag, damaged)
    (damaged / 'card.yaml').write_text('robot: [')
    refused(replay_command, damaged, '--model', f'ppn:{trained}', '-o', output)
    assert 'card.yaml' in capsys.readouterr().err
    assert not output.exists()


def refused(main, *args):
    assert main([str(a) for a in args]) == 2


def one_line(capsys):
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1, error
    return error


def test_bad_input_ends_with_code_2_and_one_line(trained, bag, tmp_path, capsys):
    missing, run = tmp_path / 'none', tmp_path / 'run'
    train, benchmark, replay = train_command, benchmark_command, replay_command
    cases = [
        (train, (missing, '-o', run), 'none'),
        (train, (bag, '-o', run, '--hidden', '0'), 'hidden: expected'),
        (train, (bag, '-o', run, '--folds', '11'), 'folds: expected'),
        (train, (bag, bag, '-o', run), 'given twice'),
        (train, (bag, '-o', trained, *QUICK), 'exists already'),
        (train, (bag, '-o', trained, '--resume', '--hidden', '13'), 'was started with'),
        (train, (bag, '-o', run, '--drives', '*_KFE'), '*_KFE'),
        (train, (bag, '-o', run, '--type', 'HAA'), 'NAME=PATTERN'),
        (train, (bag, '-o', run, '--segments', '20'), 'training needs'),
        (benchmark, (bag, '--models', 'nonsense'), 'nonsense'),
        (benchmark, (bag, '--models', f'ppn:{missing}'), 'no such file'),
        (benchmark, (bag, '--models', 'torque_abs', 'torque_abs'), 'twice'),
        (benchmark, (missing, '--models', 'torque_abs'), 'none'),
        (benchmark, (bag, '--models', 'torque_abs', '--picture', 'x.doc'), 'x.doc'),
        (replay, (missing, '--model', f'ppn:{trained}', '-o', run), 'none'),
        (replay, (bag, '--model', 'torque_abs', '-o', run), 'its factor to watts needs power'),
    ]
    for main, arguments, quoted in cases:
        refused(main, *arguments)
        assert quoted in one_line(capsys)
    assert not run.exists()


@pytest.mark.parametrize('main', [train_command, benchmark_command, replay_command])
def test_help_shows_an_example(main, capsys):
    with pytest.raises(SystemExit) as end:
        main(['--help'])
    assert end.value.code == 0
    assert 'example: ros2 run power_estimator' in ' '.join(capsys.readouterr().out.split())
