"""Predicted electrical power of simulated robots, as a module of plain torch.

This file and a `power_term.safetensors` beside it need torch and safetensors, nothing else of
wattwalk. `ros2 run power_estimator export` writes both.

    term = PowerTerm.load('power_term.safetensors', joint_names, sample_rate=200.0).to('cuda')
    watts = term(position_error, torque, velocity)  # [N, D]
    reward -= 4e-4 * step_time * watts.sum(dim=1)
    term.reset(ids)  # of the robots that start anew

`PowerReward` is the same as a reward term of mjlab and of Isaac Lab.

Tensors of the file, by drive type (float32; gates in the order input, forget, cell, output; SI
units in, watts out):
    TYPE/input [4H, 3], TYPE/recurrent [4H, H], TYPE/bias [4H], TYPE/output [H],
    TYPE/output_bias [1]
Its metadata `power_term` is JSON: format, rate (Hz), warm_up (samples), types {TYPE: patterns of
drive names}, features.
"""

import json
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

FORMAT = 'wattwalk_power_term/1'
PARTS = ('input', 'recurrent', 'bias', 'output', 'output_bias')
FEATURES = ('position_error', 'torque', 'velocity')  # rad (target − position), N·m, rad/s


class DriveTypeLstm(nn.Module):
    """Network of one drive type, with the state of each of its drives on each robot."""

    h: Tensor
    c: Tensor
    columns: Tensor

    def __init__(self, columns: Sequence[int], tensors: dict[str, Tensor]) -> None:
        super().__init__()
        self.hidden = tensors['output'].shape[0]
        with torch.random.fork_rng(devices=[]):  # a training with the term starts as without
            self.lstm = nn.LSTM(len(FEATURES), self.hidden)
            self.output = nn.Linear(self.hidden, 1)
        with torch.no_grad():
            self.lstm.weight_ih_l0.copy_(tensors['input'])  # type: ignore[operator]
            self.lstm.weight_hh_l0.copy_(tensors['recurrent'])  # type: ignore[operator]
            self.lstm.bias_ih_l0.copy_(tensors['bias'])  # type: ignore[operator]
            self.lstm.bias_hh_l0.zero_()  # type: ignore[operator]
            self.output.weight.copy_(tensors['output'][None])
            self.output.bias.copy_(tensors['output_bias'])
        self.requires_grad_(False)
        self.register_buffer('columns', torch.tensor(list(columns)), persistent=False)
        self.register_buffer('h', torch.zeros(1, 0, self.hidden), persistent=False)
        self.register_buffer('c', torch.zeros(1, 0, self.hidden), persistent=False)

    def begin(self, robots: int) -> None:
        """Set the state to zero, for this many robots."""
        shape = [1, robots * self.columns.numel(), self.hidden]
        self.h = torch.zeros(shape, dtype=torch.float32, device=self.columns.device)
        self.c = torch.zeros(shape, dtype=torch.float32, device=self.columns.device)

    def forget(self, robots: Tensor) -> None:
        """Forget the past of the robots marked in [N]."""
        rows = robots.repeat_interleave(self.columns.numel())
        self.h = torch.where(rows[None, :, None], torch.zeros_like(self.h), self.h)
        self.c = torch.where(rows[None, :, None], torch.zeros_like(self.c), self.c)

    def forward(self, features: Tensor) -> Tensor:
        """Return the mean power in W [N, k] of the type's k drives over S samples [S, N, D, 3]."""
        own = features.index_select(2, self.columns)
        samples, robots, drives = own.shape[0], own.shape[1], own.shape[2]
        rows = own.reshape(samples, robots * drives, 3)
        hidden, (self.h, self.c) = self.lstm(rows, (self.h, self.c))
        return self.output(hidden).mean(dim=0).reshape(robots, drives)


class PowerTerm(nn.Module):
    """Watts of D drives on N robots; state is carried from call to call.

    N is that of the first call; with another one all robots begin anew. During the warm-up after
    a reset, and from a sample that is not finite until the next reset, a robot's watts are 0, so
    that a reward leaves them out. Gives no gradient. `torch.jit.script` takes it.
    """

    age: Tensor
    lost: Tensor

    def __init__(self, types: Sequence[DriveTypeLstm], drives: int, warm_up: int, hold: int):
        super().__init__()
        self.types = nn.ModuleList(types)
        self.drives = drives
        self.warm_up = warm_up
        self.hold = hold
        self.register_buffer('age', torch.zeros(0, dtype=torch.int64), persistent=False)
        self.register_buffer('lost', torch.zeros(0, dtype=torch.bool), persistent=False)

    @staticmethod
    def load(file: str | Path, drives: Sequence[str], sample_rate: float) -> 'PowerTerm':
        """Read a power term for these drives, whose order is that of the columns.

        sample_rate: in Hz, of the samples that it will be given: the network's own rate (200 Hz as
        a rule), or a whole part of it such as 50 Hz, where each sample is held. ValueError for
        another rate, a drive of no type, or another file.
        """
        from safetensors import SafetensorError, safe_open  # only files of tensors need it

        try:
            with safe_open(str(file), framework='pt') as content:
                card = json.loads((content.metadata() or {}).get('power_term', '{}'))
                tensors = {name: content.get_tensor(name) for name in content.keys()}  # noqa: SIM118
        except (SafetensorError, json.JSONDecodeError) as error:
            raise ValueError(f'{file}: is no power term: {error}') from None
        if card.get('format') != FORMAT:
            raise ValueError(f'{file}: format {card.get("format")!r} is not {FORMAT!r}')
        hold = round(card['rate'] / sample_rate) if sample_rate > 0 else 0
        if hold < 1 or abs(hold * sample_rate - card['rate']) > 1e-3 * card['rate']:
            raise ValueError(
                f'sample_rate = {sample_rate} Hz is no whole part of {card["rate"]} Hz'
            )
        columns: dict[str, list[int]] = {name: [] for name in card['types']}
        for column, drive in enumerate(drives):
            owner = [
                name
                for name, patterns in card['types'].items()
                if any(fnmatchcase(drive, pattern) for pattern in patterns)
            ]
            if not owner:
                known = ', '.join(p for patterns in card['types'].values() for p in patterns)
                raise ValueError(f'{file}: drive {drive!r} is none of {known}')
            columns[owner[0]].append(column)
        parts = [
            DriveTypeLstm(own, {part: tensors[f'{name}/{part}'] for part in PARTS})
            for name, own in columns.items()
            if own
        ]
        return PowerTerm(parts, len(drives), card['warm_up'], hold)

    @torch.jit.export
    def reset(self, ids: Tensor | None = None) -> None:
        """Forget the past of the robots with these numbers [n], or of all."""
        gone = torch.ones_like(self.lost)
        if ids is not None:
            gone = torch.zeros_like(self.lost)
            gone[ids] = True
        for part in self.types:
            part.forget(gone)  # type: ignore[operator]
        self.age = torch.where(gone, torch.zeros_like(self.age), self.age)
        self.lost = self.lost & ~gone

    def forward(self, position_error: Tensor, torque: Tensor, velocity: Tensor) -> Tensor:
        """Return the mean power in W [N, D] over the samples [N, S, D] or one sample [N, D].

        position_error: target − position, rad; torque: N·m; velocity: rad/s.
        """
        with torch.no_grad():
            features = torch.stack([position_error, torque, velocity], dim=-1)
            features = features.to(torch.float32)
            if features.dim() == 3:
                features = features[:, None]
            if features.dim() != 4 or features.shape[2] != self.drives:
                raise ValueError(f'inputs are not [N, S, {self.drives}] or [N, {self.drives}]')
            robots = features.shape[0]
            if self.age.shape[0] != robots:
                self.age = torch.zeros(robots, dtype=torch.int64, device=features.device)
                self.lost = torch.zeros(robots, dtype=torch.bool, device=features.device)
                for part in self.types:
                    part.begin(robots)  # type: ignore[operator]
            finite = torch.isfinite(features).all(dim=3).all(dim=2).all(dim=1)
            self.lost = self.lost | ~finite
            features = torch.where(
                self.lost[:, None, None, None], torch.zeros_like(features), features
            )
            samples = features.transpose(0, 1).repeat_interleave(self.hold, dim=0)
            watts = torch.zeros(robots, self.drives, device=features.device)
            for part in self.types:
                watts[:, part.columns] = part(samples)  # type: ignore[index]
            self.age = self.age + samples.shape[0]
            ready = (self.age > self.warm_up) & ~self.lost
            return torch.where(ready[:, None], watts, torch.zeros_like(watts))


class PowerReward:
    """Predicted watts of all drives [N], a reward term of mjlab or Isaac Lab; weight it below 0.

    mjlab (tried with 1.6):
        cfg.rewards['power'] = RewardTermCfg(func=PowerReward, weight=-4e-4,
                                             params={'file': 'power_term.safetensors'})
        cfg.metrics['watts'] = MetricsTermCfg(func=PowerReward,  # logs W, without a reward too
                                              params={'file': 'power_term.safetensors'})
    Isaac Lab wants its own base class:
        class Power(PowerReward, ManagerTermBase): ...
        power = RewTerm(func=Power, weight=-4e-4, params={'file': 'power_term.safetensors'})

    params: file; optional `asset` ('robot') and `joints` ('.*', patterns of joint names). Both
    frameworks compute rewards once per environment step, so the samples are held at its rate.
    Both multiply a reward by the length of a step: 4e-4 (the paper's) is per watt and second
    (mjlab's `scale_rewards_by_dt=False` turns that off). A term of weight 0 is not computed.
    Only for actions that are joint positions: others leave joint_pos_target as it is. mjlab's
    torque is that of the last physics step, so older than position and velocity by one.
    """

    def __init__(self, cfg: Any, env: Any) -> None:
        self.cfg, self._env = cfg, env
        asset = env.scene[cfg.params.get('asset', 'robot')]
        pattern = cfg.params.get('joints', '.*')
        columns, names = asset.find_joints(pattern)
        self._joints = torch.as_tensor(columns, device=env.device)  # else copied at every use
        term = PowerTerm.load(cfg.params['file'], names, sample_rate=1.0 / env.step_dt)
        self._term = term.to(env.device)
        self._asset = asset

    def reset(self, env_ids: Tensor | Sequence[int] | slice | None = None) -> None:
        """Forget the past of these environments, or of all."""
        if env_ids is None or isinstance(env_ids, slice):
            robots = torch.arange(self._env.num_envs, device=self._env.device)
            env_ids = robots if env_ids is None else robots[env_ids]
        if self._term.age.numel():
            self._term.reset(torch.as_tensor(env_ids, device=self._env.device))

    def __call__(
        self, env: Any, file: str, asset: str = 'robot', joints: str | Sequence[str] = '.*'
    ) -> Tensor:
        """Return the watts of all drives [N]; arguments after env are the term's params."""
        data, own = self._asset.data, self._joints
        torque = data.applied_torque if hasattr(data, 'applied_torque') else data.qfrc_actuator
        error = data.joint_pos_target[:, own] - data.joint_pos[:, own]
        watts: Tensor = self._term(error, torque[:, own], data.joint_vel[:, own])
        return watts.sum(dim=1)
