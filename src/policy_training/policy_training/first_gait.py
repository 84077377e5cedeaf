"""
What a policy did before PPO, and goes on doing where robots are out of balance.

A few hundred robots fall too seldom for PPO to learn from it what keeps a robot up: it trades
that for a little less torque while nothing disturbs it. So it improves the gait of every day,
and where strides hurry the policy is led back to its first gait, which was hard to push over.
"""

import copy
from typing import Any, Final

import torch
from policy_runner.observations import Observation
from policy_runner.pacing import off_balance
from torch import nn

_EPOCHS: Final = 2
_BATCHES: Final = 4


class FirstGait:
    """
    Holds a network (observations [n, size] → actions [n, 12]) to what it is now.

    above: m/s, out of balance by how much it does. rate: of learning.
    """

    def __init__(
        self, actor: nn.Module, observation: Observation, *, above: float, rate: float
    ) -> None:
        self._actor = actor
        self._first = copy.deepcopy(actor).requires_grad_(False)
        self._optimiser = torch.optim.Adam(actor.parameters(), lr=rate)
        self._observation = observation
        self._above = above

    def hold(self, seen: torch.Tensor, state: torch.Tensor) -> tuple[float, float]:
        """
        Lead the network back on what was seen out of balance.

        seen: observations [n, size]; state: what was so, without noise [n, size or more].
        Returns the share of rows that count, and how far actions are from the first gait's
        there, root mean square, before this.
        """
        away = torch.from_numpy(self._away(state))
        seen = seen[(away > self._above).to(seen.device)]
        if not len(seen):
            return 0.0, 0.0
        with torch.no_grad():
            wanted = self._first(seen)
            left = float((self._actor(seen) - wanted).square().mean().sqrt())
        size = -(-len(seen) // _BATCHES)
        for _ in range(_EPOCHS):
            for part in torch.randperm(len(seen), device=seen.device).split(size):
                loss = nn.functional.mse_loss(self._actor(seen[part]), wanted[part])
                self._optimiser.zero_grad()
                loss.backward()
                self._optimiser.step()
        return len(seen) / len(away), left

    def content(self) -> dict[str, Any]:
        """Tensors and numbers that `restore` takes back."""
        return {'network': self._first.state_dict(), 'optimiser': self._optimiser.state_dict()}

    def restore(self, content: dict[str, Any]) -> None:
        """Go on as before a checkpoint."""
        self.take(content)
        self._optimiser.load_state_dict(content['optimiser'])

    def take(self, content: dict[str, Any]) -> None:
        """Hold to the first gait of another run."""
        self._first.load_state_dict(content['network'])

    def _away(self, state: torch.Tensor) -> Any:
        size, scales = self._observation.size, self._observation.scales()
        values = state[:, :size].cpu().numpy() / scales

        def plane(name: str) -> Any:
            start = self._observation.part(name).start
            return values[:, start : start + 2]

        return off_balance(plane('command') - plane('base_velocity'), plane('gravity'))
