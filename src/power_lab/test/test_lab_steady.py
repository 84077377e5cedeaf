"""Tables of operating points through the lab's commands."""

import json

import numpy as np
import pytest
from power_estimator.commands.arguments import benchmark
from power_lab.commands.arguments import add, budget, compare, fit
from table_log import csv, run

MAP = """
format: import/1
time: {steady: true}
drives:
  MOTOR:
    velocity: {from: w, unit: rad/s}
    torque: {from: trq, unit: N*m, at: joint}
    voltage: {value: 48, unit: V}
    power: {from: p, unit: W}
card: {robot: bench}
"""


@pytest.fixture
def table(tmp_path):
    """P = τω + 0.05 τ² + 0.4 |ω| + 20 at 12 torques and 10 speeds."""
    tau, w = (x.ravel() for x in np.meshgrid(np.linspace(2, 40, 12), np.linspace(1, 10, 10)))
    rows = np.stack([w, tau, tau * w + 0.05 * tau**2 + 0.4 * w + 20], axis=1)
    assert run(csv(tmp_path / 'points.csv', rows, 'w,trq,p'), MAP, tmp_path / 'points') == 0
    return tmp_path / 'points'


def test_fit_add_and_compare_take_a_table_and_count_its_points(table, tmp_path, capsys):
    base, better, result = (tmp_path / name for name in ('base.yaml', 'better.yaml', 'c.json'))
    assert fit([str(table), '--effects', 'shaft,copper_loss,idle', '-o', str(base)]) == 0
    told = capsys.readouterr().out
    assert '120 operating points' in told
    assert 'not offered are rotor_inertia, spring, cogging, velocity_lag' in told
    assert add(['iron_loss', '--to', str(base), '--bag', str(table), '-o', str(better)]) == 0
    page = tmp_path / 'page.html'
    models = ['--models', str(better), str(base), '--json', str(result), '--report', str(page)]
    assert compare([str(table), *models]) == 0
    assert 'held-out errors over 120 operating points' in capsys.readouterr().out
    content = json.loads(result.read_text())
    assert content['operating_points'] == 120
    assert content['models'][0]['drives']['MOTOR']['rmse_w'] < 0.2
    assert content['models'][0]['drives']['MOTOR']['energy_j'] is None
    assert not any('time' in regime['bounds'] for regime in content['models'][1]['regimes'])
    assert 'operating points by power' in page.read_text()


def test_a_benchmark_of_a_table_has_no_energies(table, capsys):
    assert benchmark([str(table), '--models', 'mechanical_power', 'plain']) == 0
    told = capsys.readouterr().out
    assert '120 operating points held out' in told


def test_a_budget_of_a_table_adds_up_at_its_mean_point(table, tmp_path, capsys):
    model, result = tmp_path / 'm.yaml', tmp_path / 'b.json'
    fit([str(table), '--effects', 'shaft,copper_loss,iron_loss,idle', '-o', str(model)])
    assert budget([str(table), '--model', str(model), '--json', str(result)]) == 0
    rows = json.loads(result.read_text())['rows']
    watts = {row['effect']: row['mean_w'] for row in rows if row['phase'] == 'all'}
    tau, w = np.meshgrid(np.linspace(2, 40, 12), np.linspace(1, 10, 10))
    assert watts['shaft'] == pytest.approx((tau * w).mean(), rel=0.01)
    assert watts['copper_loss'] == pytest.approx(0.05 * (tau**2).mean(), rel=0.05)
    assert watts['idle'] == pytest.approx(20.0, rel=0.05)
