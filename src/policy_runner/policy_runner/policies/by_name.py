"""Policies by name or by folder, behind one interface."""

import os
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from wattwalk_core.errors import InputError
from wattwalk_core.quoting import quoted

from policy_runner.policies.folder import CARD
from policy_runner.policies.inputs import Inputs
from policy_runner.policies.learned import LearnedPolicy
from policy_runner.policies.trot import TROTS, ScriptedTrot

Floats = NDArray[np.float64]

SHIPPED: Final = Path(__file__).parents[1] / 'shipped'
"""Folder of the learned policies that come with this package."""


class Policy(Protocol):
    """
    Turns measurements and a velocity command into joint position targets.

    rate: Hz at which step() wants to be called. ramp: s after reset() during which it moves from
    the present pose to standing and takes no commands.
    """

    rate: float
    ramp: float

    def reset(self) -> None:
        """Forget the past, before activation."""

    def take_over(self) -> float:
        """Forget the past, to go on from a standing robot; s for which it takes no commands."""

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Joint targets, rad [12]; command: vx, vy, yaw rate [3]; velocity None if not known."""


class TrotPolicy:
    """The scripted trot as a policy."""

    rate = 200.0

    def __init__(self, trot: ScriptedTrot) -> None:
        self._trot = trot
        self.ramp = trot.config.ramp

    def reset(self) -> None:
        """Forget the past."""
        self._trot.reset()

    def take_over(self) -> float:
        """Forget the past; it ramps in from any pose."""
        self._trot.reset()
        return self.ramp

    def step(
        self, time: float, command: Floats, inputs: Inputs, base_velocity: Floats | None
    ) -> Floats:
        """Joint targets, rad [12]."""
        return self._trot.step(
            time, command, inputs.position, inputs.gravity, inputs.spin, base_velocity
        )


def shipped() -> tuple[str, ...]:
    """Names of the learned policies that come with this package."""
    return tuple(sorted(card.parent.name for card in SHIPPED.glob(f'*/{CARD}')))


POLICIES: Final = (*TROTS, *shipped())
"""Names of the policies there are."""


def load_policy(source: str, *, trust_code: bool = False) -> Policy:
    """
    Load the policy of a name, of a folder, or of a TorchScript file.

    TorchScript is code and may do anything: it is loaded only with trust_code. Raises InputError,
    with the policies there are, if there is none, and with the fault of a bad one.
    """
    if source in TROTS:
        return TrotPolicy(ScriptedTrot(TROTS[source]))
    if source in POLICIES:
        return LearnedPolicy.load(SHIPPED / source)
    path = Path(source)
    if os.path.isdir(path):
        return LearnedPolicy.load(path)
    if os.path.isfile(path):
        from policy_runner.policies.torchscript import SUFFIXES, load_torchscript

        if path.suffix in SUFFIXES:
            return load_torchscript(path, trust_code=trust_code)
    raise InputError(
        f'no policy {quoted(source)}; there are {", ".join(POLICIES)}, or give a policy folder'
    )
