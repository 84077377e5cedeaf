"""Networks trained on the workers of a real scheduler on loopback."""

import json
from dataclasses import replace

import numpy as np
import pytest
from distributed import LocalCluster
from power_estimator.commands.arguments import sweep as sweep_command
from power_estimator.commands.arguments import train as train_command
from power_estimator.drive_types import infer_types
from power_estimator.network.checkpoint import NetworkConfig
from power_estimator.recordings import training_set
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.on_workers import NetworkTask, train_network
from power_estimator.training.protocol import Protocol
from power_estimator.training.run_folder import NetworkRunFolder
from power_estimator.training.trainer_config import TrainerConfig
from wattwalk_core.errors import InputError

TRAIN = ['--folds', '2', '--epochs', '2', '--hidden', '8', '--drives', 'LF_HAA']
SWEEP = ['--hidden', '4', '--history', '0.05', '--epochs', '2', '--drives', 'LF_HAA']


@pytest.fixture(scope='module')
def scheduler():
    made = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address='127.0.0.1:0', memory_limit=0
    )
    with made:
        yield ['--scheduler', made.scheduler_address]


@pytest.fixture(scope='module')
def given(bag):
    return training_set([bag], ['LF_HAA'])


@pytest.fixture
def validation(given):
    return CrossValidation(
        given.data,
        infer_types(given.data.names),
        network=NetworkConfig(hidden=8),
        training=TrainerConfig(epochs=4),
        protocol=Protocol(6, 1, NetworkConfig().history),
        others=[given.live],
        recordings=given.recordings,
    )


@pytest.fixture
def task(given, validation, tmp_path):
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, (), resume=False)
    return NetworkTask.of(given, validation, validation.jobs[0], folder)


def test_a_scheduler_trains_the_same_networks_as_threads(bag, scheduler, tmp_path):
    runs = [tmp_path / 'threads', tmp_path / 'scheduler']
    for run, place in zip(runs, (['--workers', '1'], scheduler), strict=True):
        assert train_command([str(bag), '-o', str(run), *TRAIN, *place]) == 0
    for file in ('model.safetensors', 'folds/1.safetensors', 'table.json', 'curves.json'):
        assert (runs[0] / file).read_bytes() == (runs[1] / file).read_bytes()
    assert not (runs[1] / 'state').exists()


def test_a_scheduler_sweeps_to_the_same_scores_as_threads(bag, scheduler, tmp_path):
    runs = [tmp_path / 'threads', tmp_path / 'scheduler']
    for run, place in zip(runs, (['--workers', '1'], scheduler), strict=True):
        assert sweep_command([str(bag), '-o', str(run), *SWEEP, *place]) == 0
    tables = [json.loads((run / 'table.json').read_text())['points'] for run in runs]
    assert [point['types'] for point in tables[0]] == [point['types'] for point in tables[1]]


def test_a_task_that_was_cut_off_goes_on_from_its_last_epoch(validation, task):
    whole = train_network(task)
    assert whole['history'].shape == (4, 3)
    folder = NetworkRunFolder(task.folder.parent / 'cut_off')
    folder.open({}, (), resume=False)
    epochs = []

    def ended(trainer):
        epochs.append(len(trainer.history))

    validation.train(task.job, folder, ended, lambda: epochs == [1])
    resumed = train_network(replace(task, folder=folder.path))
    assert epochs == [1]
    differing = [k for k in whole if not np.array_equal(whole[k].ravel(), resumed[k].ravel())]
    assert differing == []


def test_a_recording_that_differs_on_a_worker_is_refused(task):
    other = replace(task, hashes=('0' * 64,))
    with pytest.raises(InputError, match='is another recording here than where the command runs'):
        train_network(other)
