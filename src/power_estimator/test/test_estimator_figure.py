from dataclasses import replace

import numpy as np
import pytest
from matplotlib import image
from power_estimator.evaluation.figure import draw_bars, draw_traces
from power_estimator.evaluation.traces import Traces
from power_estimator.judge.result import SupplyScore
from power_estimator.scores import Score
from wattwalk_core.errors import InputError

TIME = np.arange(100) / 50
TRACES = Traces(
    time=TIME,
    drive='LF_KFE',
    measured=50 + 40 * np.sin(9 * TIME),
    estimated=50 + 38 * np.sin(9 * TIME),
    r2=0.98,
    proxies={'torque_squared': 50 + 30 * np.cos(9 * TIME)},
    supply=SupplyScore(
        score=Score(r2=0.97, rmse_w=7.0, bias_w=0.0, energy_error=0.0, samples=100),
        measured=700 + 100 * np.sin(9 * TIME),
        estimated=700 + 90 * np.sin(9 * TIME),
        electronics=192.0,
        drives=12,
        lag=0.0,
    ),
)
TABLE = {
    'models': [
        {'name': 'ppn', 'types': {'HAA': {'r2': 0.9, 'r2_std': 0.01}, 'KFE': None}},
        {
            'name': 'torque_squared',
            'types': {'HAA': {'r2': -40.0, 'r2_std': None}, 'KFE': {'r2': None}},
        },
    ]
}


def pixels(path):
    return image.imread(path)[..., :3]


@pytest.mark.parametrize('dark', [False, True])
def test_pictures_have_an_opaque_ground_light_or_dark(tmp_path, dark):
    draw_traces(tmp_path / 'a.png', TRACES, dark=dark)
    draw_bars(tmp_path / 'b.png', TABLE, dark=dark)
    for name in ('a.png', 'b.png'):
        picture = pixels(tmp_path / name)
        assert (picture[0, 0].mean() < 0.2) == dark
        assert picture.std() > 0.05
    assert sorted(p.name for p in tmp_path.iterdir()) == ['a.png', 'b.png']


def test_without_a_supply_there_are_two_panels(tmp_path):
    draw_traces(tmp_path / 'three.png', TRACES)
    draw_traces(tmp_path / 'two.png', replace(TRACES, supply=None))
    three, two = (pixels(tmp_path / f'{name}.png').shape for name in ('three', 'two'))
    assert two[0] < three[0]
    assert two[1] == three[1]


def test_a_picture_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match='missing'):
        draw_traces(tmp_path / 'missing' / 'a.png', TRACES)
