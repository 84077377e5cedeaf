import numpy as np
from power_recordings.reading.reader import Recording
from sim_bridge.commands.arguments import sim as sim_main


def test_a_command_that_is_held_turns_the_robot_on_the_spot(tmp_path, capsys):
    bag = tmp_path / 'turn'
    options = ['--offline', '--velocity=0,0,0.7', '--duration', '6', '-o', str(bag)]
    assert sim_main(options) == 0
    found = Recording.open(bag)
    assert found.card.other['velocity'] == [0.0, 0.0, 0.7]
    np.testing.assert_allclose(found.cmd_vel().velocity[-1], [0.0, 0.0, 0.7], atol=1e-6)
    assert np.mean(found.odom().angular_velocity[-200:, 2]) > 0.3
    for wrong in ('0,0', '0,0,9', 'left'):
        assert sim_main(['--offline', f'--velocity={wrong}', '-o', str(tmp_path / 'x')]) == 2
    assert 'expected VX,VY,YAW' in capsys.readouterr().err
