"""Settings of a bring-up: what they start, and the line that says what is amiss."""

import subprocess
import sys

import pytest
from wattwalk_bringup.commands.arguments import live as main
from wattwalk_bringup.node_set import NodeCommand, commands
from wattwalk_bringup.settings import NODES, BringupSettings, arguments, as_text
from wattwalk_core.errors import InputError


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a network, as the shipped settings name it."""
    (tmp_path / 'bags' / 'ppn_small').mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def by_name(settings):
    return {command.name: command for command in commands(settings)}


@pytest.mark.parametrize('name', ['sim', 'robot'])
def test_shipped_settings_are_sound_and_read_the_same_unchecked(name):
    assert BringupSettings.load(name) == BringupSettings.shipped(name)


def test_the_simulated_robot_needs_no_bench_supply_and_no_recorder(here):
    assert [*by_name(BringupSettings.load('sim'))] == ['sim', 'daq', 'policy', 'estimator']


def test_a_real_robot_does_not_walk_before_it_is_told_to():
    found = by_name(BringupSettings.load('robot'))
    assert [*found] == ['daq', 'policy']
    assert '--start' not in found['policy'].arguments


def test_all_nodes_share_the_bus_and_the_card_tells_what_walked(here):
    given = {'channel': '/tmp/b', 'record': 'bag', 'supply': '10.0.0.2', 'policy': 'pmp'}
    found = by_name(BringupSettings.load('sim').changed({**given, 'card': 'unit=A policy="b c"'}))
    assert [*found] == [*NODES]
    assert found['sim'].parameters['channel'] == found['daq'].parameters['channel'] == '/tmp/b'
    assert found['sim'].remappings == {'supply': 'simulated_supply'}
    assert found['supply'].parameters == {'host': '10.0.0.2'}
    recorder = found['recorder'].arguments
    assert {'controller=pmp', 'robot=anymal_c', 'unit=A', 'policy=b c'} < {*recorder}


def test_a_recorder_that_is_told_nothing_for_its_card_can_be_started():
    found = by_name(BringupSettings.load('robot').changed({'policy': '', 'record': 'bag'}))
    assert found['recorder'].arguments == ('-o', 'bag')


def test_parameters_and_arguments_of_a_file_are_added_to_those_of_the_settings(here):
    path = here / 'own.yaml'
    path.write_text(
        'format: bringup/1\nrobot: real\nvelocity: 0.4,0,0\nrestart_after: 2\n'
        'parameters: {daq: {samples_per_message: 10, channel: can7}}\n'
        'arguments: {policy: [--trust-code]}\n'
    )
    found = by_name(BringupSettings.load(str(path)))
    assert found['daq'].parameters == {
        'interface': 'socketcan',
        'channel': 'can7',
        'samples_per_message': 10,
    }
    assert found['policy'].arguments == (
        *('--policy', 'trot', '--restart-after', '2', '--velocity=0.4,0,0', '--trust-code'),
    )


def test_arguments_of_settings_that_were_not_checked_may_be_lists():
    given = {'policy': ['--trust-code']}  # as YAML gives them to `shipped`
    settings = BringupSettings(format='bringup/1', robot='real', arguments=given)
    assert by_name(settings)['policy'].arguments == ('--policy', 'trot', '--trust-code')


def test_a_command_line_keeps_texts_that_look_like_numbers_texts(tmp_path, monkeypatch):
    program = tmp_path / 'lib' / 'a' / 'b'
    program.parent.mkdir(parents=True)
    program.touch(0o755)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    given = {'text': '12', 'path': '/a b', 'odd': 'x: y: z', 'real': 1.0, 'flag': True}
    line = NodeCommand('n', 'a', 'b', ('--own',), given, {'old': 'new'}).line()
    assert line[:3] == [str(program), '--own', '--ros-args']
    assert line[4:13:2] == [
        'text:="12"',
        'path:=/a b',
        'odd:="x: y: z"',
        'real:=1.0',
        'flag:=true',
    ]
    assert line[-2:] == ['-r', 'old:=new']


def test_a_package_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', '/nowhere')
    with pytest.raises(InputError, match=r'no executable b of package a in /nowhere'):
        NodeCommand('n', 'a', 'b').line()


def test_none_is_the_word_for_a_setting_that_is_left_empty(here):
    found = BringupSettings.load('sim').changed({'model': 'none', 'policy': 'none'})
    assert found.nodes() == ('sim', 'daq')
    assert as_text(found.model) == 'none'


def test_all_nodes_are_in_the_namespace(here):
    settings = BringupSettings.load('sim').changed({'namespace': 'robot_1', 'record': 'bag'})
    assert {one.remappings['__ns'] for one in commands(settings)} == {'/robot_1'}


def test_rosbag2_gets_its_queues_and_compression(here, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    settings = BringupSettings.load('sim').changed({'record': 'bag', 'recorder': 'rosbag2'})
    line = ' '.join(by_name(settings)['recorder'].arguments)
    assert '-s mcap --storage-preset-profile zstd_fast --qos-profile-overrides-path /' in line
    assert '--topics /drive_supply ' in line


BAD = {
    'entry: unknown\n': "unknown key 'entry'",
    'policy: 5\n': 'policy: expected text, there is 5',
    'restart_after: -1\n': 'restart_after: expected 0 to 3600 s, there is -1',
    'parameters: {lidar: {a: 1}}\n': "'lidar'",
    'parameters: {sim: {a: 1}}\n': "parameters or arguments of 'sim', which is not brought up",
    'format: 1\n': "key 'format' is there twice",
}


@pytest.mark.parametrize('text', BAD)
def test_a_bad_file_is_one_line_and_code_2(text, tmp_path, capsys):
    path = tmp_path / 'own.yaml'
    path.write_text(f'format: bringup/1\nrobot: real\n{text}')
    assert main(['--config', str(path)]) == 2
    assert_one_line(capsys, BAD[text])


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        (['--terrain', 'hilly'], "terrain: expected flat or rough, there is 'hilly'"),
        (['--duration', 'soon'], "duration: expected 0 to 1e+07 s, there is 'soon'"),
        (['--model', 'ppn:runs/nowhere'], "model: no network 'runs/nowhere' here"),
        (['--namespace', 'a-b'], "namespace 'a-b': expected letters, digits and _"),
        (['--record', 'b', '--recorder', 'rosbag2', '--namespace', 'a'], 'in the root namespace'),
        (['--record', '.'], "record: '.' exists; give a new folder"),
        (['--record', 'bag', '--card', 'a="b'], "card: 'a=\"b': No closing quotation"),
        (['--config', 'no_such'], "no bring-up 'no_such'; give a file, or one of"),
    ],
)
def test_a_bad_argument_is_one_line_and_code_2(given, said, here, capsys):
    assert main(given) == 2
    assert_one_line(capsys, said)


def test_rosbag2_without_ros_is_told(here, monkeypatch, capsys):
    monkeypatch.delenv('ROS_DISTRO', raising=False)
    assert main(['--record', 'bag', '--recorder', 'rosbag2']) == 2
    assert_one_line(capsys, "recorder: 'rosbag2' needs ROS 2")


def assert_one_line(capsys, said):
    output, error = capsys.readouterr()
    assert output == ''
    assert len(error.splitlines()) == 1
    assert said in error


def test_every_setting_can_be_given_as_its_text_and_has_a_description():
    for robot in ('sim', 'robot'):
        settings = BringupSettings.load(robot)
        known = [*arguments(settings.robot)]
        assert all(argument.description for argument in known)
        given = {a.name: as_text(getattr(settings, a.name)) for a in known}
        assert settings.changed(given) == settings


def test_what_a_launch_file_reads_needs_only_what_the_python_of_ros_has(here):
    program = (
        'import sys\n'
        "sys.modules.update(dict.fromkeys(('pydantic', 'rich', 'numpy', 'rclpy', 'torch')))\n"
        'import wattwalk_bringup.launch_files\n'
        'from wattwalk_bringup.node_set import commands\n'
        'from wattwalk_bringup.settings import BringupSettings\n'
        "settings = BringupSettings.shipped('sim').changed({'start': 'false', 'record': 'bag'})\n"
        'print(*(command.name for command in commands(settings)))\n'
    )
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.stdout.split() == ['sim', 'daq', 'policy', 'estimator', 'recorder'], run.stderr


def test_a_robot_is_not_told_to_start_and_not_to(here, capsys):
    with pytest.raises(SystemExit):
        main(['--start', '--no-start'])
    assert 'argument --no-start: not allowed with argument --start' in capsys.readouterr().err
