"""What a learned policy sees: one definition for training and for the robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError

from policy_runner.policies.gait_phase import COMMAND_SLEW, HURRY, check_hurry

Floats = NDArray[np.float64]

SIZES: Final = MappingProxyType(
    {
        'base_velocity': 3,
        'angular_velocity': 3,
        'gravity': 3,
        'command': 3,
        'joint_position': 12,
        'joint_velocity': 12,
        'last_action': 12,
        'gait_clock': 2,
    }
)
"""
Numbers per term. base_velocity m/s, angular_velocity rad/s and gravity (unit vector) are in the
base's frame; command is vx, vy in m/s and yaw rate in rad/s; joint_position is relative to the
policy's default pose, rad; joint_velocity rad/s; last_action is what the network said before, as
it said it; gait_clock is the sine and cosine of a stride's phase, see `pacing.GaitPhase`. Joints
come in the policy's own order.
"""


@dataclass(frozen=True)
class Term:
    """One part of an observation; scale is one number, or one per entry."""

    name: str
    scale: tuple[float, ...]

    def __post_init__(self) -> None:
        size = SIZES.get(self.name)
        if size is None:
            raise InputError(f'no observation {self.name!r}; there are {", ".join(SIZES)}')
        if len(self.scale) not in (1, size) or not np.isfinite(self.scale).all():
            raise InputError(
                f'scale of observation {self.name} is {list(self.scale)}; '
                f'give one finite number, or {size}'
            )

    @property
    def size(self) -> int:
        """Numbers in this term."""
        return SIZES[self.name]


@dataclass(frozen=True)
class Observation:
    """
    Terms in the order in which the network takes them, scaled, then clipped to ±clip.

    stride_frequency: of gait_clock, Hz. hurry: how that clock hurries, see `pacing.stride_rate`,
    or nothing for never. command_slew: the fastest that the policy is shown a command to change,
    m/s², m/s² and rad/s², or nothing for at once. InputError for no terms, a term twice, a clip
    that is not positive, a frequency that is not in 0.2..5 Hz, a hurry that does not fit, or a
    slew that is not three numbers in 0.1..100.
    """

    terms: tuple[Term, ...]
    clip: float = 100.0
    stride_frequency: float = 1.9
    hurry: tuple[float, ...] = ()
    command_slew: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        names = [term.name for term in self.terms]
        if not names or len(set(names)) != len(names):
            raise InputError(f'observation terms are {names}; name each once, and at least one')
        if not (np.isfinite(self.clip) and self.clip > 0.0):
            raise InputError(f'observation clip is {self.clip!r}; it must be more than 0')
        if not 0.2 <= self.stride_frequency <= 5.0:
            raise InputError(
                f'stride_frequency is {self.stride_frequency!r}; it must lie in 0.2..5 Hz'
            )
        check_hurry(self.hurry, self.stride_frequency)
        slew = self.command_slew
        if slew and (len(slew) != 3 or not all(0.1 <= limit <= 100.0 for limit in slew)):
            raise InputError(
                f'command_slew is {list(slew)}; it must be three numbers in 0.1..100 '
                '(m/s², m/s², rad/s²)'
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Terms in order."""
        return tuple(term.name for term in self.terms)

    @property
    def size(self) -> int:
        """Numbers in all."""
        return sum(term.size for term in self.terms)

    def part(self, name: str) -> slice:
        """Where a term stands in the observation; KeyError if it has none of that name."""
        start = 0
        for term in self.terms:
            if term.name == name:
                return slice(start, start + term.size)
            start += term.size
        raise KeyError(name)

    def scales(self) -> Floats:
        """Factor of each number, [size]."""
        return np.concatenate([np.broadcast_to(term.scale, term.size) for term in self.terms])

    def assemble(self, values: Mapping[str, Floats]) -> NDArray[np.float32]:
        """Terms by name, [..., size of the term] in SI units, as an observation [..., size]."""
        joined = np.concatenate([values[name] for name in self.names], axis=-1) * self.scales()
        return np.clip(joined, -self.clip, self.clip).astype(np.float32)

    @classmethod
    def parse(cls, content: Any) -> 'Observation':
        """From `{clip, terms: [{name, scale}]}`; InputError says what is wrong."""
        if not isinstance(content, Mapping) or not isinstance(content.get('terms'), Sequence):
            raise InputError(f'observation must be a mapping with terms, not {content!r}')
        unknown = set(content) - {'clip', 'stride_frequency', 'hurry', 'command_slew', 'terms'}
        if unknown:
            raise InputError(f'an observation has no {sorted(unknown)[0]!r}')
        terms = []
        for entry in content['terms']:
            if not isinstance(entry, Mapping) or 'name' not in entry:
                raise InputError(f'an observation term needs a name and a scale, not {entry!r}')
            terms.append(Term(str(entry['name']), _numbers(entry.get('scale', 1.0))))
        return cls(
            tuple(terms),
            _number(content.get('clip', 100.0)),
            _number(content.get('stride_frequency', 1.9)),
            _numbers(content.get('hurry', ())),
            _numbers(content.get('command_slew', ())),
        )

    def content(self) -> dict[str, Any]:
        """What `parse` reads."""
        terms = [
            {
                'name': term.name,
                'scale': term.scale[0] if len(term.scale) == 1 else list(term.scale),
            }
            for term in self.terms
        ]
        clock = {'stride_frequency': self.stride_frequency} if 'gait_clock' in self.names else {}
        hurry = {'hurry': list(self.hurry)} if self.hurry else {}
        slew = {'command_slew': list(self.command_slew)} if self.command_slew else {}
        return {'clip': self.clip, **clock, **hurry, **slew, 'terms': terms}


def _number(value: Any) -> float:
    values = _numbers(value)
    if len(values) != 1:
        raise InputError(f'{value!r} is not a number')
    return values[0]


def _numbers(value: Any) -> tuple[float, ...]:
    values = value if isinstance(value, list | tuple) else [value]
    try:
        return tuple(float(item) for item in values)
    except (TypeError, ValueError):
        raise InputError(f'{value!r} is not a number or a list of numbers') from None


STANDARD: Final = Observation(
    (
        Term('base_velocity', (2.0,)),
        Term('angular_velocity', (0.25,)),
        Term('gravity', (1.0,)),
        Term('command', (2.0, 2.0, 0.25)),
        Term('joint_position', (1.0,)),
        Term('joint_velocity', (0.05,)),
        Term('last_action', (1.0,)),
    )
)
"""The 48 numbers of legged_gym's flat ANYmal, which the paper's baseline takes [14]."""
CLOCKED: Final = Observation(
    (*STANDARD.terms, Term('gait_clock', (1.0,))), hurry=HURRY, command_slew=COMMAND_SLEW
)
"""
The same and a clock of the gait that hurries, 50 numbers, with commands that come gradually:
what the policies that are trained here see.
"""
