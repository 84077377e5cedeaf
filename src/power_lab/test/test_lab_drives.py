"""The library of identified real drives: reading, actuators, priors."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.yaml_file import read_model, write_model
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.commands.arguments import drives
from power_lab.compare.fitting import fitted, named_effects
from power_lab.drives.library import exported, load_drive, names, power_function
from power_recordings.alignment.dataset import AlignedDataset

KNOWN = builtin_catalogue()


@pytest.fixture(params=names())
def drive(request):
    return load_drive(f'drive:{request.param}')


def points(torque, speed, power):
    rows = np.arange(len(torque))
    columns = {'torque': torque, 'velocity': speed, 'power': power}
    data = AlignedDataset.blank(
        400.0, ('MOTOR',), rows / 400.0, 'table', voltage=48.0,
        **{name: np.asarray(own, float)[:, None] for name, own in columns.items()},
    )  # fmt: skip
    return replace(data, steady=True, segment=rows.astype(np.int32))


def test_every_drive_says_who_recorded_it_and_what_it_does_not_determine(drive):
    assert drive.card.source.startswith('github.com/')
    assert drive.card.does_not_determine
    assert drive.picture.stat().st_size > 10_000
    assert drive.card.r2 > 0.9
    for group in drive.model.groups:
        for own in (value for values in group.coefficients.values() for value in values):
            assert own.interval[0] <= own.value <= own.interval[1]


def test_the_exported_power_is_that_of_the_model(drive):
    space = {}
    exec(power_function(drive), space)
    (group,) = drive.model.groups
    data = points([0.1, 0.2, 0.05], [3.0, 20.0, 0.5], [1.0, 1.0, 1.0])
    data = replace(data, names=(group.type.patterns[0],), motor_torque=frozenset())
    if drive.card.torque == 'motor':
        data = replace(data, motor_torque=frozenset(data.names))
    expected = drive.model.predict(replace(data, voltage=data.voltage * 0 + group.voltage))[:, 0]
    found = [space['power'](m, w) for m, w in zip([0.1, 0.2, 0.05], [3.0, 20.0, 0.5], strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_the_actuator_is_read_by_mujoco_and_by_python(drive):
    mujoco.MjModel.from_xml_string(exported(drive, 'mujoco'))
    compile(exported(drive, 'mjlab'), drive.name, 'exec')
    largest = max(torque for _speed, torque in drive.card.torque_over_speed)
    assert f'effort_limit={largest:.6g}' in exported(drive, 'mjlab')


def test_the_command_lists_shows_and_refuses(capsys):
    assert drives([]) == 0
    told = capsys.readouterr().out
    assert all(name[:10] in told for name in names())
    assert drives(['mn8014_sspg_7']) == 0
    assert 'torque scale or gear loss' in capsys.readouterr().out
    assert drives(['none_such']) == 2
    assert 'there are ev_pmsm_335v' in capsys.readouterr().err


def test_a_prior_decides_what_the_recording_does_not(tmp_path):
    """At standstill the power says nothing of iron loss; copper loss of 0.1 it tells itself."""
    torque = np.tile(np.linspace(2.0, 40.0, 40), 3)
    still = points(torque, np.full(120, 1e-3), 0.1 * torque**2 + 20.0)
    effects = named_effects(['shaft copper_loss iron_loss idle'], KNOWN)
    prior = {'copper_loss': ((0.05, 0.01),), 'iron_loss': ((0.5, 0.1), (0.0, np.inf))}
    judge = Judge(Loaded.of(still), KNOWN)
    model = fitted(judge, effects, 'with', prior=prior)
    (group,) = model.groups
    assert group.coefficients['iron_loss'][0].value == pytest.approx(0.5, rel=0.05)
    assert group.coefficients['copper_loss'][0].value == pytest.approx(0.1, rel=0.02)
    (alone,) = fitted(judge, effects, 'without').groups
    assert np.ptp(alone.coefficients['iron_loss'][0].interval) > 0.9  # of the 1 that is allowed
    write_model(model, tmp_path / 'm.yaml')
    assert read_model(tmp_path / 'm.yaml', KNOWN).prior == model.prior
    assert judge.score(model).drives['MOTOR'].r2 > 0.999


def test_a_drive_expects_nothing_of_what_stood_at_a_bound():
    prior = load_drive('mn8014_sspg_7').model.as_prior()
    (k, spread), *_ = prior['copper_loss']
    assert 0.2 * k <= spread < k  # a torque sensor may be off by a tenth
    assert prior['iron_loss'][1] == (0.0, np.inf)
