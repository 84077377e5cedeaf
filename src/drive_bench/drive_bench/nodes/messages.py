"""What an excitation is told and says, as ROS messages."""

import argparse
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from policy_runner.supervisor.safety import SafetyConfig
from sensor_msgs.msg import JointState

from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import limits_of
from drive_bench.nodes.excite_options import mounting_of
from drive_bench.run.drive_names import resolve
from drive_bench.run.monitor import JointInputs
from drive_bench.run.motion_run import Command, ExcitationRun


def run_of(
    message: JointState,
    motion: MotionFile,
    drives: Sequence[str],
    options: argparse.Namespace,
    config: SafetyConfig,
) -> ExcitationRun:
    """The run of a motion on the joints that joint_states names; InputError as of the run."""
    names = tuple(message.name)
    read = JointInputs(joint_names=names)
    read.on_joint_states(0, names, message.position, message.velocity, message.effort, 0.0)
    return ExcitationRun(
        motion,
        names,
        resolve(drives, names, read.there),
        mounting_of(options),
        limits_of(names, options.limits),
        config,
        damp_others=options.damp_others,
        fit=options.fit,
    )


def command_message(command: Command, stamp: Any) -> JointState:
    """A command for joint_commands."""
    message = JointState(name=list(command.names))
    message.header.stamp = stamp
    for field in ('position', 'velocity', 'effort'):
        values = getattr(command, field)
        if values is not None:
            setattr(message, field, list(values))
    return message


def diagnosis(run: ExcitationRun, now: float, stamp: Any) -> DiagnosticArray:
    """How it stands, for diagnostics."""
    waits = not run.active and run.code is None
    why = run.unsound(now) if waits else ''
    calm = DiagnosticStatus.WARN if why else DiagnosticStatus.OK
    status = DiagnosticStatus(
        level=DiagnosticStatus.ERROR if run.code == 1 else calm,
        name='policy_runner',
        message=f'not ready: {why}' if why else run.reason,
        values=[KeyValue(key=key, value=value) for key, value in run.figures(now).items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
