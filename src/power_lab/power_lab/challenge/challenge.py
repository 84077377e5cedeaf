"""Recordings with a hidden effect: the answer is drawn from a seed and sealed in the bag."""

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sim_bridge.plant.parameters import Plant
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

SEALED = 'answer.sealed'
ALWAYS = ('copper_loss', 'rotor_inertia', 'idle')
SOMETIMES = ('viscous_friction', 'coulomb_friction')
HIDDEN = (
    'viscous_friction',
    'coulomb_friction',
    'stribeck_friction',
    'load_friction',
    'iron_loss',
    'inverter_loss',
    'line_resistance',
    'regeneration_efficiency',
    'winding_heating',
    'spring',
)
UNMODELLED = ('position_rub', 'fan', 'cross_talk')
STRENGTHS = (1.0, 1.5, 2.5)
_NOTHING = 0.12  # share of challenges that hide nothing
_UNMODELLED_SHARE = 0.12  # that hide an unmodelled effect
_TOP_STRENGTH = {'cross_talk': 1.5}
_LEAST_STRENGTH = {
    'iron_loss': 2.5,
    'inverter_loss': 1.5,
    'line_resistance': 6.0,
    'winding_heating': 2.5,
}
"""Where the usual size puts on less than a diagnosis names, so that no riddle lacks an answer."""


@dataclass(frozen=True)
class Challenge:
    """Hidden effects of a challenge, and those that the model may know."""

    hidden: tuple[str, ...]
    strength: float  # times the usual size of the hidden effect
    known: tuple[str, ...]  # effects of the base model
    unit: int

    @property
    def expected(self) -> str:
        """The verdict that a perfect judge gives."""
        if not self.hidden:
            return 'no_evidence'
        return 'none_of_the_above' if self.hidden[0] in UNMODELLED else 'named'

    def plant(self, base: Plant) -> Plant:
        """The base plant with the known effects and the hidden one, and nothing else."""
        effects: dict[str, Any] = {name: False for name, _ in base.effects}
        effects.update(dict.fromkeys((*ALWAYS, *self.known), True))
        effects.pop('shaft', None)
        for name in self.hidden:
            effects[name] = self.strength
        return base.unit(self.unit).with_effects(**effects)

    @classmethod
    def of(cls, answer: Mapping[str, Any]) -> 'Challenge':
        """Build from the content of an unsealed answer."""
        hidden, known = tuple(answer['hidden']), tuple(answer['known'])
        return cls(hidden, float(answer['strength']), known, int(answer['unit']))

    def content(self) -> dict[str, Any]:
        """Return the answer as JSON-compatible values."""
        lists = {'hidden': list(self.hidden), 'known': list(self.known)}
        return {**vars(self), **lists, 'expected': self.expected}


def draw(seed: int) -> Challenge:
    """Draw a challenge from a seed, the same for the same seed."""
    random = np.random.default_rng([seed, 2024])
    kind = random.uniform()
    known = [*ALWAYS, *(name for name in SOMETIMES if random.uniform() < 0.7)]
    strength = float(random.choice(STRENGTHS))
    hidden: tuple[str, ...] = ()
    if kind >= _NOTHING + _UNMODELLED_SHARE:
        choices = [name for name in HIDDEN if name not in known]
        hidden = (str(random.choice(choices)),)
        strength = max(strength, _LEAST_STRENGTH.get(hidden[0], strength))
    elif kind >= _NOTHING:
        hidden = (str(random.choice(UNMODELLED)),)
        strength = min(strength, _TOP_STRENGTH.get(hidden[0], strength))
    unit = int(random.integers(1, 1000))
    return Challenge(hidden, strength if hidden else 1.0, ('shaft', *known), unit)


def seal(content: Mapping[str, Any], folder: Path) -> Path:
    """Write an answer into a bag or folder, unreadable at a glance; return its path.

    It guards against looking by accident, not against wanting to know.
    """
    path = folder / SEALED
    packed = zlib.compress(json.dumps(content).encode())
    write_whole(path, base64.b64encode(_mixed(packed)).decode() + '\n')
    return path


def unseal(bag: Path) -> dict[str, Any]:
    """Read the sealed answer of a challenge; InputError without one or where it is damaged."""
    path = bag / SEALED
    try:
        packed = _mixed(base64.b64decode(path.read_text(encoding='ascii').strip(), validate=True))
        answer = json.loads(zlib.decompress(packed))
    except OSError as error:
        raise InputError(f'{bag} is no challenge: it has no {SEALED}') from error
    except (ValueError, zlib.error) as error:
        raise InputError(f'{path}: the seal is damaged') from error
    if not isinstance(answer, dict) or 'hidden' not in answer:
        raise InputError(f'{path}: the seal is damaged')
    return answer


def score(answer: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> str:
    """Grade a diagnosis by the answer: `right`, `in the set`, `part`, `missed` or `wrong`.

    in the set: the hidden effect is one of several plausible ones; part: not all are named;
    missed: none is.
    """
    hidden, found = set(answer['hidden']), set(diagnosis.get('effects', []))
    verdict = diagnosis.get('verdict')
    if answer['expected'] != 'named':
        if verdict == answer['expected']:
            return 'right'
        return 'missed' if verdict == 'no_evidence' else 'wrong'
    if verdict == 'named':
        return 'right' if found == hidden else 'part' if found < hidden else 'wrong'
    if verdict == 'ambiguous':
        return 'in the set' if hidden <= found else 'wrong'
    return 'missed'


def _mixed(data: bytes) -> bytes:
    block, stream = b'power_lab challenge', bytearray()
    while len(stream) < len(data):
        block = hashlib.sha256(block).digest()
        stream += block
    return bytes(byte ^ other for byte, other in zip(data, stream, strict=False))
