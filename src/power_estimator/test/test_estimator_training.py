from dataclasses import replace

import numpy as np
import pytest
from power_estimator.drive_types import infer_types
from power_estimator.evaluation.benchmark import table
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.network.checkpoint import NetworkConfig, TrainingRecording
from power_estimator.network.features import Scaling, features
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import PROXIES
from power_estimator.scores import r2
from power_estimator.training.cross_validation import CrossValidation
from power_estimator.training.protocol import Part, Protocol
from power_estimator.training.run_folder import NetworkRunFolder
from power_estimator.training.trainer import Tracks, plan
from power_estimator.training.trainer_config import TrainerConfig
from wattwalk_core.errors import InputError

SMALL = NetworkConfig(hidden=12)
QUICK = TrainerConfig(epochs=3, batch=4, chunk=40)


def cross_validation(data, *, config=SMALL, training=QUICK, folds=1, others=()):
    return CrossValidation(
        data,
        infer_types(data.names),
        network=config,
        training=training,
        protocol=Protocol(folds=folds, margin=config.history),
        others=others,
        recordings=[TrainingRecording(**one) for one in Loaded.of(data).identities],
    )


def judged(validation, checkpoint):
    """Scores of a fold by model."""
    judge = Judge(Loaded.of(validation.data))
    return {one.name: one for one in validation.test(checkpoint, judge)}


def test_the_network_beats_every_proxy_on_drives_with_memory(drives, tmp_path):
    validation = cross_validation(
        drives(120.0),
        config=NetworkConfig(hidden=24),
        training=TrainerConfig(epochs=10, batch=8, chunk=50),
    )
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    checkpoint = validation.checkpoint(0, validation.run(folder))
    scores = judged(validation, checkpoint)
    for kind in ('HAA', 'HFE'):
        assert scores['ppn'].types[kind].r2 > 0.6
        for proxy in PROXIES:
            assert scores['ppn'].types[kind].r2 > scores[proxy].types[kind].r2 + 0.2
    assert scores['ppn'].total.r2 > 0.6
    assert scores['ppn'].supply.score.r2 > 0.6


def test_an_arm_of_three_joints_trains_by_the_same_code(drives, tmp_path):
    validation = cross_validation(drives(40.0, ('joint_1', 'joint_2', 'wrist')))
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    checkpoint = validation.checkpoint(0, validation.run(folder))
    scores = judged(validation, checkpoint)
    assert list(scores['ppn'].drives) == ['joint_1', 'joint_2', 'wrist']
    assert np.isfinite([s.r2 for s in scores['ppn'].drives.values()]).all()


def mirrored(data):
    """The same motion of a drive that is built in the other way round."""
    return replace(
        data,
        position=-data.position,
        command=-data.command,
        velocity=-data.velocity,
        torque=-data.torque,
    )


def test_a_network_trained_on_one_leg_knows_the_legs_that_are_its_mirror_image(drives):
    data = drives(90.0, ('LF_HAA',))
    lean = np.float32(25.0)  # the torque of the left leg is mostly positive, as when it stands
    data = replace(data, torque=data.torque + lean)
    network, training = NetworkConfig(hidden=24), TrainerConfig(epochs=8, batch=8, chunk=50)
    found = {}
    for mirror in (True, False):
        config = replace(training, mirror=mirror)
        validation = cross_validation(data, config=network, training=config)
        (job,) = validation.jobs
        trainer = validation.trainer(job)
        while not trainer.done:
            trainer.epoch()
        checkpoint = validation.checkpoint(0, {job: trainer})
        (haa,) = checkpoint.networks
        assert (haa.low == tuple(-x for x in haa.high)) == mirror
        model = PowerPredictionNetwork(checkpoint)
        found[mirror] = [r2(data.power, model.predict(d)) for d in (data, mirrored(data))]
    assert found[True][0] == pytest.approx(found[True][1], abs=0.1)
    assert found[True][1] > 0.6
    assert found[False][1] < found[True][1] - 0.2


def train(validation, epochs):
    trainer = validation.trainer(validation.jobs[0])
    for _ in range(epochs):
        trainer.epoch()
    return trainer


def test_the_same_seed_gives_the_same_network_and_another_seed_another(drives):
    data = drives(40.0, ('LF_HAA',))
    first, second = (train(cross_validation(data), 2).network.weights() for _ in range(2))
    assert np.array_equal(first.recurrent, second.recurrent)
    other = train(cross_validation(data, training=replace(QUICK, seed=1)), 2).network.weights()
    assert not np.array_equal(first.recurrent, other.recurrent)


def test_a_resumed_training_ends_where_an_unbroken_one_does(drives, tmp_path):
    validation = cross_validation(drives(40.0, ('LF_HAA',)))
    unbroken = train(validation, 3)
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    folder.save_state('HAA-0', train(validation, 1).state())
    resumed = validation.trainer(validation.jobs[0])
    resumed.restore(folder.load_state('HAA-0'))
    while not resumed.done:
        resumed.epoch()
    assert resumed.history == unbroken.history
    assert np.array_equal(resumed.best.recurrent, unbroken.best.recurrent)


def test_a_finished_job_is_not_trained_again(drives, tmp_path):
    validation = cross_validation(drives(40.0, ('LF_HAA',)))
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    first = validation.run(folder)
    seen = []
    again = validation.run(folder, lambda job, trainer: seen.append(len(trainer.history)))
    (job,) = validation.jobs
    assert seen == [3]
    assert again[job].history == first[job].history


def test_state_of_another_network_is_refused(drives, tmp_path):
    data = drives(40.0, ('LF_HAA',))
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    folder.save_state('HAA-0', train(cross_validation(data), 1).state())
    with pytest.raises(InputError, match='state of HAA-0 does not fit'):
        cross_validation(data, config=NetworkConfig(hidden=13)).run(folder)


def test_damaged_state_is_refused_by_name(tmp_path):
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({}, [], resume=False)
    (tmp_path / 'run' / 'state' / 'HAA-0.safetensors').write_bytes(b'\x00' * 20)
    with pytest.raises(InputError, match=r'HAA-0.safetensors: is damaged'):
        folder.load_state('HAA-0')


def test_a_run_is_not_overwritten_and_resumes_only_as_it_was_started(tmp_path):
    folder = NetworkRunFolder(tmp_path / 'run')
    walk, other = (TrainingRecording('walk', sha256) for sha256 in 'ab')
    folder.open({'hidden': 100}, [walk], resume=False)
    with pytest.raises(InputError, match='exists already: give --resume'):
        folder.open({'hidden': 100}, [], resume=False)
    folder.open({'hidden': 100}, [walk], resume=True)
    with pytest.raises(InputError, match='was started with hidden = 100, not 64'):
        folder.open({'hidden': 64}, [walk], resume=True)
    with pytest.raises(InputError, match='was started on other recordings'):
        folder.open({'hidden': 100}, [other], resume=True)
    with pytest.raises(InputError, match='is no run to resume'):
        NetworkRunFolder(tmp_path / 'none').open({}, [], resume=True)


def test_of_two_runs_begun_at_once_in_a_folder_the_later_is_refused(tmp_path, monkeypatch):
    folder = NetworkRunFolder(tmp_path / 'run')
    folder.open({'hidden': 100}, [], resume=False)
    monkeypatch.setattr(type(tmp_path), 'exists', lambda path: False)  # as it was when it looked
    with pytest.raises(InputError, match='run cannot be made: File exists'):
        folder.open({'hidden': 64}, [], resume=False)


@pytest.mark.parametrize(
    ('numbers', 'problem'),
    [((0.0, np.nan, 0.0), 'not eight finite numbers'), ((1.0, 0.0, 1.0), 'is not positive')],
)
def test_a_scaling_that_nothing_can_be_learned_with_is_refused(numbers, problem):
    with pytest.raises(InputError, match=problem):
        Scaling((0.0, 0.0, 0.0), numbers, 40.0, 50.0)


def test_training_stops_early_when_validation_no_longer_improves(drives):
    config = replace(QUICK, epochs=200, patience=2, learning_rate=1e-6, final_learning_rate=0.0)
    trainer = cross_validation(drives(40.0, ('LF_HAA',)), training=config).trainer
    network = trainer(cross_validation(drives(40.0, ('LF_HAA',)), training=config).jobs[0])
    network.validate = lambda: 0.5
    while not network.done:
        network.epoch()
    assert len(network.history) == 3


def test_the_best_weights_are_kept_not_the_last(drives):
    validation = cross_validation(drives(40.0, ('LF_HAA',)), training=replace(QUICK, epochs=4))
    trainer = validation.trainer(validation.jobs[0])
    scores = iter([0.1, 0.9, 0.2, 0.3])
    trainer.validate = lambda: next(scores)
    trainer.epoch()
    trainer.epoch()
    best = trainer.network.weights()
    trainer.epoch()
    trainer.epoch()
    assert np.array_equal(trainer.best.recurrent, best.recurrent)
    assert not np.array_equal(trainer.network.weights().recurrent, best.recurrent)


def test_sequences_follow_on_unless_the_state_is_dropped():
    edges = np.array([0, 1000, 1030, 2500])
    config = TrainerConfig(batch=3, chunk=50, reset_probability=0.2)
    starts, fresh = plan(edges, config, np.random.default_rng(0))
    assert fresh[0].all()
    follows = starts[1:] == starts[:-1] + config.chunk
    assert (fresh[1:] | follows).all()
    for row in starts.ravel():
        track = np.searchsorted(edges, row, side='right') - 1
        assert row + config.chunk <= edges[track + 1]
    assert len(np.unique(starts)) == starts.size


def test_the_test_part_leaves_no_trace_in_the_network(drives):
    data = drives(40.0, ('LF_HAA',))
    validation = cross_validation(data)
    test = validation.labels(validation.jobs[0]) == Part.TEST
    other = replace(
        data,
        power=np.where(test[:, None], 500, data.power).astype(np.float32),
        torque=np.where(test[:, None], -300, data.torque).astype(np.float32),
    )
    first, second = (train(cross_validation(d), 1) for d in (data, other))
    assert first.scaling == second.scaling
    assert np.array_equal(first.network.weights().recurrent, second.network.weights().recurrent)


def test_both_views_of_the_features_are_trained_on(drives):
    data, training = drives(40.0, ('LF_HAA',)), replace(QUICK, mirror=False)
    plain = cross_validation(data, training=training)
    both = cross_validation(data, training=training, others=[features(data) + 1])
    (job,) = plain.jobs
    means = [validation.trainer(job).scaling.mean[0] for validation in (plain, both)]
    assert means[1] == pytest.approx(means[0] + 0.5, abs=1e-4)


def test_drives_that_were_not_measured_are_not_trained_on(drives):
    data = drives(40.0)
    power = data.power.copy()
    power[:, 1] = np.nan
    assert [t.name for t in cross_validation(replace(data, power=power)).types] == ['HAA']


def test_recordings_of_different_drives_make_one_training_set(drives):
    data = drives(80.0)
    power = data.power.copy()
    power[:8000, 1] = np.nan
    power[8000:, 0] = np.nan
    validation = cross_validation(replace(data, power=power))
    haa, hfe = (validation.labels(job) for job in validation.jobs)
    assert set(np.unique(haa[:8000])) >= {0, 1, 2}
    assert (haa[8000:] == Part.UNUSED).all()
    assert (hfe[:8000] == Part.UNUSED).all()


def test_too_little_data_names_recording_type_and_need(drives):
    with pytest.raises(InputError, match=r'synthetic: HAA was measured for 20.0 s; .* needs 36 s'):
        cross_validation(drives(20.0, ('LF_HAA',)))


def test_nothing_measured_is_refused(drives):
    data = drives(40.0)
    with pytest.raises(InputError, match='synthetic: no drive has measured power'):
        cross_validation(replace(data, power=np.full_like(data.power, np.nan)))


@pytest.mark.parametrize(
    ('name', 'field'), [('torque', 'torque'), ('velocity', 'velocity'), ('power', 'power')]
)
def test_constant_signals_are_refused_by_recording_and_field(drives, name, field):
    data = drives(40.0, ('LF_HAA',))
    flat = replace(data, **{name: np.full_like(data.torque, 3.0)})
    validation = cross_validation(flat)
    with pytest.raises(InputError, match=f'synthetic: HAA: {field} is constant'):
        validation.trainer(validation.jobs[0])


@pytest.mark.parametrize('bad', [{'epochs': 0}, {'chunk': 5}, {'reset_probability': 1.5}])
def test_a_training_configuration_out_of_range_is_refused(bad):
    ((name, value),) = bad.items()
    with pytest.raises(InputError, match=f'{name}: expected .*, there is {value}'):
        TrainerConfig(**bad)


def test_a_table_holds_mean_and_spread_over_folds(drives):
    validation = cross_validation(drives(80.0), folds=2)
    tests = []
    for fold in range(2):
        trainers = {job: validation.trainer(job) for job in validation.jobs if job.fold == fold}
        tests.append(judged(validation, validation.checkpoint(fold, trainers)))
    (ppn, *_) = table([list(test.values()) for test in tests])['models']
    r2s = [t['ppn'].drives['LF_HAA'].r2 for t in tests]
    assert ppn['drives']['LF_HAA']['r2'] == pytest.approx(np.mean(r2s))
    assert ppn['drives']['LF_HAA']['r2_std'] == pytest.approx(np.std(r2s))


def test_tracks_need_at_least_one_stretch():
    with pytest.raises(InputError, match='no stretch of data is long enough'):
        Tracks.join([])
