"""Launch descriptions for ROS 2, from the settings and the set of nodes that `live` has."""

import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from wattwalk_bringup import tether
from wattwalk_bringup.node_group import PATIENCE, SOUND_ENDS
from wattwalk_bringup.node_set import NodeCommand, commands
from wattwalk_bringup.settings import BringupSettings, arguments, as_text

_INTERRUPT, _TERMINATE = (str(seconds) for _, seconds in PATIENCE)
_PREFIX: Final = f"'{sys.executable}' -SE '{tether.__file__}' {os.getpid()}"


class NodeFailedError(Exception):
    """A node of a launch has failed: raised in the launch, it ends it with exit code 1."""


def launch_description(name: str) -> Any:
    """Return the launch description of shipped settings, `sim` or `robot`; each is an argument."""
    from launch import LaunchDescription  # on ROS 2 alone
    from launch.actions import DeclareLaunchArgument, OpaqueFunction

    settings = BringupSettings.shipped(name)
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=as_text(getattr(settings, argument.name)),
            description=argument.description,
            choices=argument.choices or None,
        )
        for argument in arguments(settings.robot)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=partial(_start, settings))])


def _start(base: BringupSettings, context: Any) -> list[Any]:
    from launch.substitutions import LaunchConfiguration  # on ROS 2 alone

    given = {
        argument.name: LaunchConfiguration(argument.name).perform(context)
        for argument in arguments(base.robot)
    }
    settings = base.changed(given)
    actions = [_node(command) for command in commands(settings)]
    if settings.duration and not settings.record_counts:
        from launch.actions import Shutdown, TimerAction  # on ROS 2 alone

        end = Shutdown(reason=f'{settings.duration:g} s are over')
        actions.append(TimerAction(period=settings.duration, actions=[end]))
    return actions


def _node(command: NodeCommand) -> Any:
    from launch.actions import ExecuteProcess  # on ROS 2 alone
    from launch_ros.actions import Node

    common = {
        'output': 'screen',
        'on_exit': _on_exit(command.name),
        'sigterm_timeout': _INTERRUPT,
        'sigkill_timeout': _TERMINATE,
        'prefix': _PREFIX,
    }
    if command.package == 'ros2':
        return ExecuteProcess(cmd=command.line(), name=command.name, **common)
    return Node(
        package=command.package,
        executable=command.executable,
        exec_name=command.name,
        arguments=list(command.arguments),
        parameters=[dict(command.parameters)] if command.parameters else [],
        remappings=list(command.remappings.items()),
        **common,
    )


def _on_exit(name: str) -> Callable[[Any, Any], Sequence[Any] | None]:
    """Return the end of the whole launch at the end of a node: an error if the node failed."""

    def end(event: Any, context: Any) -> Sequence[Any] | None:
        from launch.actions import Shutdown  # on ROS 2 alone

        if context.is_shutdown:
            return None
        if event.returncode in SOUND_ENDS:
            return [Shutdown(reason=f'{name} has ended')]
        raise NodeFailedError(f'{name} failed with code {event.returncode}')

    return end
