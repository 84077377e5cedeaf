"""Policies by name or by folder, with one interface."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Protocol

from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError, quoted

from policy_runner.policies.folder import CARD
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.learned import LearnedPolicy
from policy_runner.policies.trot import TROTS, ScriptedTrot

SHIPPED: Final = Path(__file__).parents[1] / 'shipped'
"""Folder of the learned policies that come with this package."""
EXPORTED: Final = 'policy'  # folder of the exported policy in that of its training


class Policy(Protocol):
    """Policy from measurements and a velocity command to joint position targets.

    rate: Hz of the calls of step(). ramp: s after reset() during which it moves from
    the present pose to standing and takes no commands.
    """

    rate: float
    ramp: float

    def reset(self) -> None:
        """Reset; the next step begins to stand up from the measured pose."""

    def take_over(self) -> float:
        """Reset on a standing robot; return the s during which the policy takes no commands."""

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Return joint targets, rad [12]; command: vx, vy, yaw rate [3]; velocity m/s or None."""


def shipped() -> tuple[str, ...]:
    """Return the names of the learned policies that come with this package."""
    return tuple(sorted(card.parent.name for card in SHIPPED.glob(f'*/{CARD}')))


POLICIES: Final = (*TROTS, *shipped())  # names of all policies


def load_policy(source: str, *, trust_code: bool = False) -> Policy:
    """Load the policy of a name, of a folder, or of a TorchScript file.

    TorchScript is code and may do anything: it is loaded only with trust_code. Raises InputError,
    with the policies there are, if there is none, and with the fault of a bad one.
    """
    if source in TROTS:
        return ScriptedTrot(TROTS[source])
    if source not in POLICIES and os.path.isfile(source):
        from policy_runner.policies.torchscript import SUFFIXES, load_torchscript  # torch

        path = Path(source)
        if path.suffix in SUFFIXES:
            return load_torchscript(path, trust_code=trust_code)
    return LearnedPolicy.load(learned_folder(source))


def by_short_name(sources: Sequence[str]) -> dict[str, str]:
    """Return sources by the name of the policy, of its folder, or of the training it is in.

    InputError for two of one name.
    """
    named = {}
    for source in sources:
        path = Path(source)
        named[(path.parent if path.name == EXPORTED else path).name] = source
    if len(named) < len(sources):
        raise InputError(f'two of {", ".join(sources)} are called the same; rename a folder')
    return named


def learned_folder(source: str) -> Path:
    """Return the folder of a learned policy by name or folder; InputError without one."""
    if source in shipped():
        return SHIPPED / source
    if source in TROTS:
        raise InputError(
            f'{quoted(source)} is a scripted trot; learned policies are {", ".join(shipped())}, '
            'or give a policy folder'
        )
    if os.path.isdir(source):
        return Path(source)
    raise InputError(
        f'no policy {quoted(source)}; there are {", ".join(POLICIES)}, or give a policy folder'
    )
