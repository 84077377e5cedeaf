"""Check of a discovered effect on a recording that it was not learned from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.design import Active
from power_estimator.effects.training import Material, fit_model
from power_estimator.judge.held_out import fitted_base
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import on_base
from wattwalk_core.arrays import Floats

_BOOTSTRAPS = 400
_LEAST_FALL = 0.05  # of the squared error, to be borne out
_LEAST_SHOWN = 0.15  # of what it explains in its own recording, for the other to tell


@dataclass(frozen=True)
class Transfer:
    """Errors on another recording without and with the effect, W by drive."""

    drives: tuple[str, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    transfers: bool | None  # None where the other recording does not show it
    reason: str
    time: Floats  # s [N]
    measured: Floats  # W [N, d]
    residuals: tuple[Floats, Floats]  # W [N, d], without and with it


class OtherRecording:
    """Another recording of the robot, on which models fitted to the first are judged."""

    def __init__(
        self,
        judge: Judge,
        own: Material,
        learned_on: Loaded,
        base: str | None,
    ) -> None:
        """judge: of the other recording. own: what was learned on, on a base model or none."""
        self.judge = judge
        self.prepared = judge.prepared
        self.blocks = Blocks.of(judge.prepared, judge.settings.fit)
        self._under = None if base is None else fitted_base(learned_on, base)
        self._own, self._base, self._known = own, base, learned_on.identities

    def score(self, effects: Sequence[Active]) -> JudgedModel:
        """Fit effects to the first recording, and judge them on this one."""
        model, _ = fit_model(
            'trial',
            self._own,
            effects,
            self.judge.catalogue,
            base=self._base,
            fitted_on=self._known,
        )
        return self.judge.score(on_base(model, self._under))

    def transfer(
        self, drives: Sequence[str], before: JudgedModel, after: JudgedModel, explains: float
    ) -> Transfer:
        """Say whether what the effect explains is borne out on the named drives."""
        shared = [name for name in drives if name in self.prepared.names]
        columns = [self.prepared.names.index(name) for name in shared]
        errors = [tuple(j.drives[name].rmse_w for name in shared) for j in (before, after)]
        parts = (before.residual[:, columns], after.residual[:, columns])
        verdict, reason = self._verdict(parts, before, after, columns, explains)
        return Transfer(
            tuple(shared),
            errors[0],
            errors[1],
            verdict,
            reason,
            self.prepared.time,
            before.measured[:, columns],
            parts,
        )

    def _verdict(
        self,
        parts: tuple[Floats, Floats],
        before: JudgedModel,
        after: JudgedModel,
        columns: list[int],
        explains: float,
    ) -> tuple[bool | None, str]:
        if not columns:
            return None, 'the other recording has none of its drives'
        moved = np.nanstd((after.estimated - before.estimated)[:, columns])
        if moved < _LEAST_SHOWN * explains:
            return None, f'the other recording hardly shows it ({moved:.2f} W)'
        rows = self.blocks.rows
        fall = np.square(parts[0]) - np.square(parts[1])
        by_block = np.nanmean(fall[rows].reshape(len(rows), -1), axis=1)
        by_block = by_block[np.isfinite(by_block)]
        random = np.random.default_rng(0)
        size = min(5, len(by_block))
        starts = random.integers(
            0, len(by_block) - size + 1, (_BOOTSTRAPS, -(-len(by_block) // size))
        )
        drawn = by_block[(starts[..., None] + np.arange(size)).reshape(_BOOTSTRAPS, -1)].mean(
            axis=1
        )
        whole = float(np.nanmean(np.square(parts[0])))
        share = float(by_block.mean()) / max(whole, 1e-12)
        if float(np.quantile(drawn, 0.025)) > 0.0 and share >= _LEAST_FALL:
            return True, f'it takes {share:.0%} off the squared error of the other recording'
        return False, (
            f'it changes the squared error of the other recording by {-share:+.0%}: not borne out'
        )
