"""
What a policy did before PPO, and goes on doing where robots are out of balance.

A few hundred robots fall too seldom for PPO to learn from it what keeps a robot up: it trades
that for a little less torque while nothing disturbs it. So it improves the gait of every day,
and out of balance the policy is led back to its first gait, which was hard to push over.
"""

import copy
from typing import Any, Final

import torch
from policy_runner.policies.gait_phase import capture_point_error, urgency
from policy_runner.policies.observations import Observation
from torch import nn

_BATCHES: Final = 4


class FirstGait:
    """
    Holds a network (observations [n, size] → actions [n, 12]) to what it is now.

    It does so where robots are out of balance, in proportion to the urgency that
    `observation.cadence_adaptation` gives there: by how they really are, where their gait phases
    go by what sensors say. within: how far actions may be from what they were, in their own
    units. rate: of learning.
    """

    def __init__(
        self, actor: nn.Module, observation: Observation, *, within: float, rate: float
    ) -> None:
        self.actor = actor
        self._first = copy.deepcopy(actor).requires_grad_(False)
        self._optimiser = torch.optim.Adam(actor.parameters(), lr=rate)
        self._observation = observation
        self._within = within

    def hold(self, seen: torch.Tensor, state: torch.Tensor) -> tuple[float, float]:
        """
        Lead the network back on what was seen out of balance.

        seen: observations [n, size]; state: what was so, without noise [n, size or more].
        Returns the share of rows that count, and how far actions are from the first gait's
        there before this, root mean square by weight.
        """
        weight = torch.from_numpy(self._haste(state)).float().to(seen.device)
        chosen = weight > 0.0
        seen, weight = seen[chosen], weight[chosen, None]
        if not len(seen):
            return 0.0, 0.0
        with torch.no_grad():
            wanted = self._first(seen)
            squares = weight * (self.actor(seen) - wanted).square()
            left = float((squares.mean() / weight.mean()).sqrt())
        size = -(-len(seen) // _BATCHES)
        for part in torch.randperm(len(seen), device=seen.device).split(size):
            away = (self.actor(seen[part]) - wanted[part]).abs()
            loss = (weight[part] * (away - self._within).clamp_min(0.0).square()).mean()
            if not loss.item():
                continue  # or the optimiser's momentum would go on
            self._optimiser.zero_grad()
            loss.backward()
            self._optimiser.step()
        return float(chosen.float().mean()), left

    def content(self) -> dict[str, Any]:
        """Tensors and numbers that `take` takes."""
        return {'network': self._first.state_dict(), 'optimiser': self._optimiser.state_dict()}

    def take(self, content: dict[str, Any], *, go_on: bool) -> None:
        """Hold to the first gait of another run or, to go on, of this one's checkpoint."""
        self._first.load_state_dict(content['network'])
        if go_on:
            rates = [group['lr'] for group in self._optimiser.param_groups]
            self._optimiser.load_state_dict(content['optimiser'])
            for group, rate in zip(self._optimiser.param_groups, rates, strict=True):
                group['lr'] = rate

    def _haste(self, state: torch.Tensor) -> Any:
        """How far strides are from calm (0) to as fast as they get (1), [n]."""
        seen = self._observation
        values = state[:, : seen.size].cpu().numpy() / seen.scales()

        def plane(name: str) -> Any:
            start = seen.part(name).start
            return values[:, start : start + 2]

        away = capture_point_error(plane('command') - plane('base_velocity'), plane('gravity'))
        return urgency(seen.cadence_adaptation, away)
