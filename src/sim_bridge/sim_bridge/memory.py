"""A simulated run as arrays, with the methods by which recordings on disk are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_daq.recording.samples import (
    CmdVelSamples,
    DriveSamples,
    FootForceSamples,
    JointSamples,
    SupplySamples,
)

from sim_bridge.robot import FOOT_NAMES
from sim_bridge.session import Event
from sim_bridge.telemetry import Rows, Telemetry


@dataclass(frozen=True)
class SimulatedRecording:
    """Topics of a run in memory; None for what the world does not have."""

    path: str
    drives: DriveSamples
    states: JointSamples
    commands: JointSamples
    battery: SupplySamples
    feet: FootForceSamples | None
    velocity: CmdVelSamples | None
    events: tuple[Event, ...]

    def drive_supply(self) -> DriveSamples:
        """Electrical samples of the measured drives."""
        return self.drives

    def joint_states(self) -> JointSamples:
        """What the joints reported."""
        return self.states

    def joint_commands(self) -> JointSamples:
        """What they were commanded."""
        return self.commands

    def supply(self) -> SupplySamples:
        """The whole robot's supply."""
        return self.battery

    def foot_force(self) -> FootForceSamples | None:
        """Normal forces on the feet."""
        return self.feet

    def cmd_vel(self) -> CmdVelSamples | None:
        """Velocity commands."""
        return self.velocity

    @classmethod
    def gather(
        cls, stretches: Sequence[Telemetry], joints: Sequence[str], measured: Sequence[str]
    ) -> 'SimulatedRecording':
        """From the stretches of one run; joints and measured name the columns."""
        electrical = _join(stretches, lambda t: t.electrical)
        states = _join(stretches, lambda t: t.joints)
        commands = _join(stretches, lambda t: t.commands)
        supply = _join(stretches, lambda t: t.supply)
        assert electrical
        assert states
        assert commands
        assert supply
        feet = _join(stretches, lambda t: t.foot_force)
        velocity = _join(stretches, lambda t: t.cmd_vel)
        v = electrical.values
        count = len(electrical.stamp_ns)
        return cls(
            path='simulation',
            drives=DriveSamples(
                stamp_ns=electrical.stamp_ns,
                names=tuple(measured),
                sequence=np.arange(count, dtype=np.uint64),
                device_time=v['device_ns'].astype(np.uint64),
                voltage=_float32(v['voltage']),
                current=_float32(v['current']),
                temperature=_float32(v['temperature']),
                status=v['status'].astype(np.uint8),
            ),
            states=_joint_samples(states, joints),
            commands=_joint_samples(commands, joints),
            battery=SupplySamples(
                supply.stamp_ns,
                _float32(supply.values['voltage']),
                _float32(supply.values['current']),
            ),
            feet=feet
            and FootForceSamples(feet.stamp_ns, FOOT_NAMES, _float32(feet.values['effort'])),
            velocity=velocity
            and CmdVelSamples(velocity.stamp_ns, _float32(velocity.values['velocity'])),
            events=tuple(event for stretch in stretches for event in stretch.events),
        )


def _join(stretches: Sequence[Telemetry], pick: Callable[[Telemetry], Rows | None]) -> Rows | None:
    found = [rows for rows in map(pick, stretches) if rows is not None]
    if not found:
        return None
    names = found[0].values
    return Rows(
        np.concatenate([rows.stamp_ns for rows in found]),
        {name: np.concatenate([rows.values[name] for rows in found]) for name in names},
    )


def _joint_samples(rows: Rows, joints: Sequence[str]) -> JointSamples:
    absent = np.full((len(rows.stamp_ns), len(joints)), np.nan, dtype=np.float32)
    found = (rows.values.get(name) for name in ('position', 'velocity', 'effort'))
    return JointSamples(
        rows.stamp_ns, tuple(joints), *(absent if v is None else _float32(v) for v in found)
    )


def _float32(values: Any) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)
