"""The workbench shows the figures of the judge."""

from pathlib import Path

import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import load
from power_workbench.sessions.source import Source
from power_workbench.sessions.steps import SessionStep
from power_workbench.sessions.worker import SessionWorker

WALK = Path(__file__).resolve().parents[3] / 'bags' / 'walk_small'


def test_a_models_error_is_the_judges(tmp_path):
    step = SessionStep('fit', effects=('shaft', 'copper_loss', 'idle'))
    source = Source((str(WALK),), sha256=(load([WALK]).identities[0]['sha256'],))
    work, path = SessionWorker(), tmp_path / 'model.yaml'
    view = work.shape(lambda *told: None, source, '', step, path)['view']
    model = read_model(path, builtin_catalogue())
    judged = Judge(load([WALK])).score(model)
    shown = {meter: scores['rmse_w'] for meter, scores in view.content['drives'].items()}
    assert shown == pytest.approx(judged.rmse, abs=1e-6)
    assert model.history[-1]['rmse_w'] == pytest.approx(judged.rmse, abs=1e-6)
    line = work.line(lambda *told: None, source, str(path))
    assert line['rmse_w'] == pytest.approx(judged.rms_w, abs=1e-6)
