"""One short simulated recording of a leg with hidden load friction."""

import pytest


@pytest.fixture(scope='session')
def bag(tmp_path_factory):
    """A walk of 45 s of one leg with load friction hidden, from sim_bridge."""
    from sim_bridge.offline.run import run_offline
    from sim_bridge.plant.parameters import Plant

    plant = Plant.load('anymal_c').unit(3)
    known = ('copper_loss', 'viscous_friction', 'coulomb_friction', 'rotor_inertia', 'idle')
    effects: dict[str, bool | float] = {name: name in known for name, _ in plant.effects}
    effects['load_friction'] = 2.5
    path = tmp_path_factory.mktemp('bags') / 'walk'
    return run_offline(
        path,
        duration=45.0,
        seed=3,
        plant=plant.with_effects(**effects),
        drives=('LF_HAA', 'LF_HFE', 'LF_KFE'),
    )
