import numpy as np
import pytest
from policy_training.config import TrainingConfig
from power_estimator.drive_types import DriveType
from power_estimator.network.checkpoint import FILE, Checkpoint, Network, NetworkConfig
from power_estimator.network.features import Scaling
from power_estimator.network.lstm import Weights


@pytest.fixture
def tiny():
    """A config of few robots and short rounds."""
    return TrainingConfig().with_values(
        {
            'physics.environments': 4,
            'physics.threads': 1,
            'physics.plant': 'anymal_c',
            'ppo.steps': 6,
            'ppo.minibatches': 2,
            'ppo.epochs': 1,
            'ppo.hidden': (16,),
            'steps': 48,
        }
    )


@pytest.fixture(scope='session')
def network_run(tmp_path_factory):
    """A run folder of a Power Prediction Network with random weights."""
    random, hidden = np.random.default_rng(0), 8
    shapes = ((4 * hidden, 3), (4 * hidden, hidden), (4 * hidden,), (hidden,), (1,))
    weights = Weights(*(random.normal(0, 0.3, shape).astype(np.float32) for shape in shapes))
    scaling = Scaling((0.0, 0.0, 0.0), (0.1, 15.0, 3.0), 40.0, 50.0)
    bounds = ((-9.0, -900.0, -90.0), (9.0, 900.0, 90.0))
    networks = tuple(
        Network(DriveType(kind, (f'*_{kind}',)), scaling, *bounds, weights)
        for kind in ('HAA', 'HFE', 'KFE')
    )
    run = tmp_path_factory.mktemp('ppn')
    Checkpoint(NetworkConfig(hidden=hidden, history=20), networks).save(run / FILE)
    return run
