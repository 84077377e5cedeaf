"""The set of nodes of a bring-up as commands: what `live` and the launch files start."""

import json
import os
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import yaml
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.installed_commands import installed_commands
from wattwalk_core.processes import ProcessError, find_program
from wattwalk_core.yaml_file import read_yaml

from wattwalk_bringup.settings import FOLDER, RANDOM, BringupSettings

QOS: Final = FOLDER.parent / 'rosbag2_qos.yaml'
_OTHER_TOPICS: Final = ('/cmd_vel', '/diagnostics')
Value = bool | int | float | str


@dataclass(frozen=True)
class NodeCommand:
    """Executable of a package, the node's name, and its arguments, parameters and remappings."""

    name: str
    package: str
    executable: str
    arguments: tuple[str, ...] = ()
    parameters: Mapping[str, Value] = field(default_factory=dict)
    remappings: Mapping[str, str] = field(default_factory=dict)

    def line(self) -> list[str]:
        """Return the command line; InputError where the package is not installed."""
        ros = [f'{name}:={_text(value)}' for name, value in self.parameters.items()]
        given = [part for text in ros for part in ('-p', text)]
        given += [part for old, new in self.remappings.items() for part in ('-r', f'{old}:={new}')]
        return [*self._program(), *self.arguments, *(['--ros-args', *given] if given else [])]

    def _program(self) -> list[str]:
        if self.package == 'ros2':
            try:
                return [find_program('ros2'), *self.executable.split()]
            except ProcessError as error:
                raise InputError(str(error)) from None
        # Not by `ros2 run`: on ROS 2 it is a process in between, which passes no signal on.
        prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))]
        for prefix in (*prefixes, sys.prefix):
            path = Path(prefix, 'lib', self.package, self.executable)
            if os.access(path, os.X_OK):
                return [str(path)]
        if self.executable in installed_commands().get(self.package, {}):
            module = installed_commands.__module__
            return [sys.executable, '-m', module, self.package, self.executable]
        raise InputError(
            f'no executable {self.executable} of package {self.package} in '
            f'{os.pathsep.join((*prefixes, sys.prefix))}: build or install it'
        )


def commands(settings: BringupSettings) -> tuple[NodeCommand, ...]:
    """Return the commands of a bring-up's nodes; InputError for paths that cannot be used."""
    _check_paths(settings)
    made = {
        'sim': _sim,
        'daq': _daq,
        'supply': _supply,
        'policy': _policy,
        'estimator': _estimator,
        'recorder': _recorder,
    }
    return tuple(made[name](settings) for name in settings.nodes())


def _check_paths(settings: BringupSettings) -> None:
    if settings.record and Path(settings.record).expanduser().exists():
        raise InputError(f'record: {quoted(settings.record)} exists; give a new folder')
    if settings.model.startswith('ppn:'):
        network = Path(settings.model.removeprefix('ppn:')).expanduser()
        # A name without folders is a shipped network's.
        if len(network.parts) > 1 and not network.exists():
            raise InputError(
                f'model: no network {quoted(str(network))} here; give another, '
                'or none to estimate nothing'
            )
    if settings.recorder == 'rosbag2' and settings.record:
        if settings.namespace:
            raise InputError("recorder: 'rosbag2' records in the root namespace; use power_daq")
        if 'ROS_DISTRO' not in os.environ:
            raise InputError("recorder: 'rosbag2' needs ROS 2; source it, or use power_daq")


def _command(
    settings: BringupSettings,
    name: str,
    program: str,
    parameters: Mapping[str, Value] | None = None,
    own: tuple[str, ...] = (),
    remappings: Mapping[str, str] | None = None,
) -> NodeCommand:
    package, _, executable = program.partition(' ')
    set_here = {key: value for key, value in (parameters or {}).items() if value != ''}
    return NodeCommand(
        name,
        package,
        executable,
        (*own, *settings.arguments.get(name, ())),  # type: ignore[call-overload]
        {**set_here, **settings.parameters.get(name, {})},  # type: ignore[call-overload]
        {**(remappings or {}), **({'__ns': settings.namespace} if settings.namespace else {})},
    )


def _on_bus(settings: BringupSettings, *others: str) -> dict[str, Value]:
    """Settings of the bus, and others, that are parameters of the same names."""
    names = ('interface', 'channel', 'dbc', 'mapping', *others)
    return {name: getattr(settings, name) for name in names}


def _sim(settings: BringupSettings) -> NodeCommand:
    parameters = _on_bus(settings, 'plant', 'terrain')
    # The bench supply's readings take the place of the simulated ones.
    remapped = {'supply': 'simulated_supply'} if settings.supply else {}
    return _command(settings, 'sim', 'sim_bridge sim', parameters, remappings=remapped)


def _daq(settings: BringupSettings) -> NodeCommand:
    parameters = _on_bus(settings, 'calibration', 'bus', 'drives')
    return _command(settings, 'daq', 'power_daq daq', parameters)


def _supply(settings: BringupSettings) -> NodeCommand:
    return _command(settings, 'supply', 'power_daq supply', {'host': settings.supply})


def _policy(settings: BringupSettings) -> NodeCommand:
    own = ['--policy', settings.policy]
    if settings.start:
        own.append('--start')
    if settings.restart_after:
        own += ['--restart-after', f'{settings.restart_after:g}']
    if settings.velocity == RANDOM:
        own.append('--random-commands')
    elif settings.velocity:
        own.append(f'--velocity={settings.velocity}')
    return _command(settings, 'policy', 'policy_runner run', own=tuple(own))


def _estimator(settings: BringupSettings) -> NodeCommand:
    parameters = {'model': settings.model}
    return _command(settings, 'estimator', 'power_estimator estimate', parameters)


def _recorder(settings: BringupSettings) -> NodeCommand:
    if settings.recorder == 'rosbag2':
        topics = (*read_yaml(QOS, 'QoS'), *_OTHER_TOPICS)
        own = (
            *('-s', 'mcap', '--storage-preset-profile', 'zstd_fast'),
            *('--qos-profile-overrides-path', str(QOS)),
            *('-o', settings.record, '--topics', *topics),
        )
        return _command(settings, 'recorder', 'ros2 bag record', own=own)
    own = ('-o', settings.record)
    if settings.duration:
        # On a busy machine a simulated robot may take half a minute to begin.
        own += ('--wait', '--duration', f'{settings.duration:g}')
    if card := _card(settings):
        own += ('--card', *card)
    return _command(settings, 'recorder', 'power_daq record', own=own)


def _card(settings: BringupSettings) -> tuple[str, ...]:
    known = {'controller': settings.policy, 'calibration': settings.calibration}
    if settings.robot == 'simulated':
        known |= {'robot': settings.plant, 'terrain': settings.terrain}
    filled = (f'{key}={value}' for key, value in known.items() if value)
    try:
        # Later entries replace earlier ones.
        return (*filled, *shlex.split(settings.card))
    except ValueError as error:
        raise InputError(f'card: {quoted(settings.card)}: {error}') from None


def _text(value: Value) -> str:
    """Return a parameter's value as YAML, quoted where a text could be read as something else."""
    if isinstance(value, str):
        try:
            if yaml.safe_load(value) == value:
                return value
        except yaml.YAMLError:
            pass
    return json.dumps(value, ensure_ascii=False)
