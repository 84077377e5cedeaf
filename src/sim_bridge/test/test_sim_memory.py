import numpy as np
from sim_bridge.offline.telemetry import Rows, Telemetry, gather


def stretch(first, **commands):
    rows = Rows(np.arange(first, first + 2), {k: np.full((2, 1), v) for k, v in commands.items()})
    return Telemetry({'joint_commands': rows})


def test_a_run_that_changes_its_mode_of_command_is_one_recording():
    run = [stretch(0, position=0.5), stretch(2, effort=3.0, velocity=1.0)]
    held = gather('mixed', run, ['LF_KFE'], []).joint_commands()
    np.testing.assert_array_equal(held.position[:, 0], [0.5, 0.5, np.nan, np.nan])
    np.testing.assert_array_equal(held.velocity[:, 0], [np.nan, np.nan, 1.0, 1.0])
    np.testing.assert_array_equal(held.effort[:, 0], [np.nan, np.nan, 3.0, 3.0])
