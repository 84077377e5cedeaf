"""Who is judged on which samples."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.drive_types import infer_types
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import write_model
from power_estimator.effects.training import fit_model, material
from power_estimator.judge.held_out import base_power
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_estimator.loader import load_model
from power_estimator.network.checkpoint import (
    Checkpoint,
    Network,
    NetworkConfig,
    TrainingRecording,
)
from power_estimator.network.features import Scaling
from power_estimator.network.lstm import Weights
from power_lab.compare.comparison import compare
from power_lab.diagnose.outcome import diagnose
from wattwalk_core.errors import InputError

CATALOGUE = builtin_catalogue()
KNOWN = tuple(Active.of(CATALOGUE[name]) for name in ('shaft', 'copper_loss', 'idle'))


@pytest.fixture(scope='module')
def loaded(bag):
    return load([bag])


@pytest.fixture(scope='module')
def networks(loaded, tmp_path_factory):
    """Writes untrained networks that say to know the bag, all but the seconds of a span."""
    random = np.random.default_rng(0)
    shapes = {'input': (8, 3), 'recurrent': (8, 2), 'bias': 8, 'output': 2, 'output_bias': 1}
    scaling = Scaling((0.0,) * 3, (0.1, 20.0, 3.0), 20.0, 30.0)
    weights = Weights(
        **{name: random.normal(size=size).astype(np.float32) for name, size in shapes.items()}
    )
    types = infer_types(loaded.data.names)
    known = loaded.identities[0]

    def write(start, stop):
        spans = [[float(loaded.data.time[0]) + start, float(loaded.data.time[0]) + stop]]
        checkpoint = Checkpoint(
            NetworkConfig(hidden=2),
            tuple(Network(t, scaling, (-9.0,) * 3, (9.0,) * 3, weights) for t in types),
            (
                TrainingRecording(
                    known['name'], known['sha256'], {}, {t.name: spans for t in types}
                ),
            ),
        )
        file = tmp_path_factory.mktemp('networks') / 'model.safetensors'
        checkpoint.save(file)
        return f'ppn:{file}'

    return write


@pytest.fixture(scope='module')
def saved(loaded, tmp_path_factory):
    """Fits effects to the bag, on a base or none, and says where the model is."""

    def write(name, base=None, fitted_on=loaded.identities):
        under = None if base is None else base_power(loaded, load_model(base), base).power
        own = material(loaded.data, base=under, catalogue=CATALOGUE)
        actives = KNOWN[2:] if base else KNOWN
        model, _ = fit_model(name, own, actives, CATALOGUE, base=base, fitted_on=fitted_on)
        path = tmp_path_factory.mktemp('models') / f'{name}.yaml'
        write_model(model, path)
        return str(path)

    return write


def test_what_stands_on_a_network_is_judged_where_that_was_not_trained(loaded, networks, saved):
    spec = networks(8.0, 32.0)
    specs = [spec, saved('own', spec), saved('others', spec, fitted_on=())]
    for one, how in zip(
        specs,
        ('its test part', 'cross-validated on the test part of its base', 'test part of its base'),
        strict=True,
    ):
        found = compare(loaded, [one], CATALOGUE)
        judged = found.models[0]
        since = found.prepared.time - loaded.data.time[0]
        used = since[np.isfinite(judged.residual).all(axis=1)]
        assert judged.held_out == how
        assert 8.0 < used.min() < 9.5
        assert 30.5 < used.max() < 32.0


def test_a_test_part_too_short_to_judge_on_is_said_in_a_line(loaded, networks):
    spec = networks(8.0, 20.0)
    with pytest.raises(InputError, match=r'its test part leaves 11 s of LF_HAA to judge on'):
        diagnose(Judge(loaded, CATALOGUE), EffectModel('none', Structure(()), base=spec), spec)
    known = load_model(networks(0.0, 99.0))
    assert np.isfinite(base_power(loaded, known, 'ppn').power).mean() > 0.9


def test_a_diagnosis_of_a_network_that_knows_the_recording_is_of_its_test_part(loaded, networks):
    spec = networks(8.0, 40.0)
    one = replace(loaded, data=loaded.data.drives(['LF_KFE']))
    found = diagnose(Judge(one, CATALOGUE), EffectModel('none', Structure(()), base=spec), spec)
    prepared = found.prepared
    since = prepared.time - loaded.data.time[0]
    seen = since[prepared.measured[:, 0]]
    assert 8.0 < seen.min() < 9.0
    assert 39.0 < seen.max() < 40.0
    assert np.isfinite(found.diagnosis.base.rmse).all()


def test_a_models_figures_do_not_depend_on_which_others_are_compared(loaded, networks, saved):
    own, others = saved('own'), saved('others', fitted_on=())
    specs = [others, 'mechanical_power']
    alone = [compare(loaded, [spec], CATALOGUE) for spec in specs]
    together = compare(loaded, [*specs, own, networks(0.0, 99.0)], CATALOGUE)
    for one, found in zip(alone, together.json()['models'], strict=False):
        assert one.json()['models'][0] == found
    hard = ~together.prepared.resolved & together.prepared.measured
    judged = np.isfinite(together.models[0].residual)
    assert hard.sum() > 50
    assert judged[hard].mean() > 0.9


def test_a_proxy_is_judged_at_its_own_best_delay(loaded):
    late = np.roll(loaded.data.power, 3, axis=0)
    delayed = replace(loaded, data=replace(loaded.data, power=late))
    before, after = (
        compare(one, ['mechanical_power_positive'], CATALOGUE).models[0]
        for one in (loaded, delayed)
    )
    assert after.delay - before.delay == pytest.approx(3 / 400, abs=1e-3)
