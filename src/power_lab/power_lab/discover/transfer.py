"""Check of a discovered effect on a recording that it was not learned from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.training import Material, fit_model
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import prepare
from power_recordings.alignment.dataset import AlignedDataset

Floats = NDArray[np.float64]
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

    @property
    def fall(self) -> float:
        """Share of the error that it takes off, over its drives."""
        before, after = (float(np.sqrt(np.mean(np.square(x)))) for x in (self.before, self.after))
        return 1.0 - after / max(before, 1e-9)


@dataclass(frozen=True)
class ModelElsewhere:
    """A fitted model on another recording."""

    residual: Floats  # W [N, D]
    estimated: Floats  # W [N, D]
    measured: Floats  # W [N, D]


class OtherRecording:
    """Another recording of the robot, on which models fitted to the first are judged."""

    def __init__(self, data: AlignedDataset, own: Material, catalogue: Catalogue) -> None:
        self.data = data
        self.prepared = prepare(data)
        self.blocks = Blocks.of(self.prepared)
        self.own, self.catalogue = own, catalogue

    def judge(self, effects: Sequence[Active], base: Floats | None = None) -> ModelElsewhere:
        """Fit effects to the first recording, and set them against this one."""
        catalogue = self.catalogue
        model, fit = fit_model('trial', self.own, effects, catalogue)
        names = self.prepared.names
        data = self.data.drives(names)
        estimated = self.prepared.reduced(_predicted(model, data, base))
        measured = self.prepared.power_at(fit.delay)
        residual = np.where(self.prepared.resolved, measured - estimated, np.nan)
        return ModelElsewhere(residual, estimated, measured)

    def transfer(
        self, drives: Sequence[str], before: ModelElsewhere, after: ModelElsewhere, explains: float
    ) -> Transfer:
        """Say whether what the effect explains is borne out on the named drives."""
        shared = [name for name in drives if name in self.prepared.names]
        columns = [self.prepared.names.index(name) for name in shared]
        errors = [
            tuple(float(np.sqrt(np.nanmean(np.square(j.residual[:, c])))) for c in columns)
            for j in (before, after)
        ]
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
        before: ModelElsewhere,
        after: ModelElsewhere,
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


def _predicted(model: EffectModel, data: AlignedDataset, base: Floats | None) -> Floats:
    return np.asarray(model.predict(data, as_measured=True, base=base), dtype=np.float64)
