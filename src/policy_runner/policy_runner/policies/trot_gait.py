"""Configuration and gait cycle of the scripted trot."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.anymal import FOOT_RADIUS, FRONT, LEFT

Floats = NDArray[np.float64]

_OFFSETS: Final = np.array([0.0, 0.5, 0.5, 0.0])
_SHIFT_WEIGHT: Final = 0.06


def _check(config: Any, bounds: Mapping[str, tuple[float, float]]) -> None:
    for name, (low, high) in bounds.items():
        value = getattr(config, name)
        if not low <= value <= high:
            raise ValueError(f'trot {name} is {value!r}; it must lie in {low}..{high}')


@dataclass(frozen=True)
class Feedback:
    """
    Gains that keep the body level, high and on course; ValueError for one out of bounds.

    foothold: m of foot placement per m/s of velocity error, s. velocity: N·s/m, of stance feet.
    yaw: N·m·s/rad. tilt: N·m/rad. tilt_rate: N·m·s/rad. height: N/m. yielding: share of the
    velocity error that stance feet give way to. settle: rate at which uneven feet come back to
    level, 1/s. trim: rate at which lasting velocity errors are taken out, 1/s.
    """

    foothold: float = 0.12
    velocity: float = 180.0
    yaw: float = 80.0
    tilt: float = 600.0
    tilt_rate: float = 70.0
    height: float = 3000.0
    yielding: float = 0.25
    settle: float = 4.0
    trim: float = 0.5

    def __post_init__(self) -> None:
        bounds = {item.name: (0.0, np.inf) for item in fields(self)}
        _check(self, bounds | {'foothold': (0.0, 0.4), 'yielding': (0.0, 1.0)})


@dataclass(frozen=True)
class TrotConfig:
    """
    Shape of the gait and gains of the drives; ValueError for a value out of bounds.

    frequency: stride frequency at rest, Hz. cadence_adaptation: see
    `gait_phase.CADENCE_ADAPTATION`; empty for none. stance_speed: velocity of stance feet over the
    command. duty: share of a stride that a foot is on the ground. height: base over ground, m.
    swing_height, urgent_swing_height: m, at rest and at full urgency. foot_x, foot_y: feet from
    the base's centre, m. max_forward, max_lateral, max_yaw: limits of commands, m/s and rad/s.
    ramp: s from the measured pose to standing. stiffness: position gain of the drives, N·m/rad.
    damping: their velocity gain and viscous gear friction that targets compensate, N·m·s/rad.
    friction: Coulomb friction that they compensate, N·m. Both are below the drives' own, since
    overcompensation makes the joints oscillate.
    """

    frequency: float = 1.9
    cadence_adaptation: tuple[float, ...] = ()
    stance_speed: float = 1.0
    duty: float = 0.58
    height: float = 0.52
    swing_height: float = 0.07
    urgent_swing_height: float = 0.07
    foot_x: float = 0.40
    foot_y: float = 0.28
    max_forward: float = 0.8
    max_lateral: float = 0.6
    max_yaw: float = 0.9
    ramp: float = 1.5
    stiffness: float = 80.0
    damping: float = 3.5
    friction: float = 1.2
    feedback: Feedback = field(default_factory=Feedback)

    def __post_init__(self) -> None:
        _check(
            self,
            {
                'frequency': (0.8, 3.0),
                'stance_speed': (0.5, 1.5),
                'duty': (0.5, 0.85),
                'height': (0.40, 0.58),
                'swing_height': (0.02, 0.2),
                'urgent_swing_height': (0.02, 0.2),
                'foot_x': (0.25, 0.5),
                'foot_y': (0.2, 0.36),
                'max_forward': (0.0, 1.5),
                'max_lateral': (0.0, 1.0),
                'max_yaw': (0.0, 2.0),
                'ramp': (0.1, 10.0),
                'stiffness': (20.0, 400.0),
                'damping': (0.0, 30.0),
                'friction': (0.0, 10.0),
            },
        )

    @property
    def footholds(self) -> Floats:
        """Feet of a standing robot in the base's frame, m [4, 3]."""
        depth = np.full(4, FOOT_RADIUS - self.height)
        return np.column_stack([self.foot_x * FRONT, self.foot_y * LEFT, depth])


DEFAULT_TROT: Final = TrotConfig()
TROTS: Final[Mapping[str, TrotConfig]] = MappingProxyType(
    {
        'trot': DEFAULT_TROT,
        'trot_slow': TrotConfig(frequency=1.5, duty=0.64, height=0.50),
        'trot_high': TrotConfig(frequency=2.0, height=0.55, swing_height=0.10, foot_y=0.30),
        'trot_even': TrotConfig(
            frequency=1.7,
            stance_speed=0.75,
            height=0.56,
            swing_height=0.05,
            urgent_swing_height=0.10,
            feedback=Feedback(trim=0.0),
        ),
    }
)
"""
Gaits by name: three that load the drives differently, and one that policies imitate. That one
tracks its command without an integrator, whose state is no input of a network.
"""


class GaitCycle:
    """Gait cycle of the trot: when to walk, and the phase of each foot, diagonal pairs in turn."""

    def __init__(self, config: TrotConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Stand."""
        self.walking = False
        self.phase = np.zeros(4)  # share of the stride since touchdown
        self.swinging = np.zeros(4, dtype=bool)
        self.load = np.ones(4)  # share of the weight that a foot may bear, 0..1
        self._stride = 0.0
        self._settled_time = 0.0

    @property
    def stride(self) -> float:
        """Phase of the first pair of legs, 0..1; the second pair is half a stride ahead."""
        return self._stride

    @property
    def swing_progress(self) -> Floats:
        """Share of the swing that is over [4]; meaningful for swinging feet."""
        duty = self._config.duty
        return (self.phase - duty) / (1.0 - duty)

    def advance(self, dt: float, frequency: float, *, requested: bool, settled: bool) -> None:
        """
        Advance by dt s at a stride frequency, Hz.

        requested: a command or a disturbance asks for steps. settled: body and feet are where they
        should be, so that standing is safe. Walking ends with all feet down, after half a
        settled stride.
        """
        if self.walking:
            self._advance_stride(dt, frequency, settled and not requested)
        elif requested:
            self.walking = True
            self._stride = self._settled_time = 0.0
        if self.walking:
            self.phase = (self._stride + _OFFSETS) % 1.0
            self.swinging = self.phase >= self._config.duty
            border = np.minimum(self.phase, self._config.duty - self.phase) / _SHIFT_WEIGHT
            load = np.minimum(np.maximum(border, 0.0), 1.0)
        else:
            self.phase = np.zeros(4)
            self.swinging = np.zeros(4, dtype=bool)
            load = np.ones(4)
        self.load = self.load + min(1.0, dt / 0.015) * (load - self.load)
        self.load[self.swinging] = 0.0

    def _advance_stride(self, dt: float, frequency: float, settled: bool) -> None:
        before = self._stride
        self._stride = (self._stride + frequency * dt) % 1.0
        self._settled_time = self._settled_time + dt if settled else 0.0
        touchdown = self._stride % 0.5 < before % 0.5
        if touchdown and self._settled_time > 0.5 / self._config.frequency:
            self.walking = False
