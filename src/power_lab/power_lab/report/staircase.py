"""Staircase of the error: the steps by which a model became what it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel, over_meters
from wattwalk_core.pages.plot_style import Figure

from power_lab.report import figures


@dataclass(frozen=True)
class Stairs:
    """Held-out errors of one kind on the same recordings, step by step."""

    steps: tuple[str, ...]
    errors: tuple[float, ...]  # W, over the meters
    noise: float  # W, of the sensors

    @classmethod
    def of(
        cls,
        history: Sequence[Mapping[str, Any]],
        judged: Sequence[JudgedModel],
        loaded: Loaded,
        noise: NDArray[np.float64],
    ) -> 'Stairs':
        """Make a staircase of a model's history and of models as they are judged now.

        The first of these is the model, whose errors the history ends with. Steps whose errors are
        of other recordings or meters, or were held out in another way, are left out. noise: of the
        meters, W [M].
        """
        former = [entry for entry in history[:-1] if _comparable(entry, judged[0], loaded)]
        last = [entry for entry in history[-1:] if _comparable(entry, judged[0], loaded)]
        names = [
            ', '.join(entry.get('added', ())) or str(entry.get('step'))
            for entry in (*former, *last)
        ]
        errors = [over_meters(entry['rmse_w'].values()) for entry in former]
        return cls(
            (*names, *(one.name for one in judged[len(last) :])),
            (*errors, *(one.rms_w for one in judged)),
            float(np.sqrt(np.nan_to_num(np.square(noise)).mean())),
        )

    def __str__(self) -> str:
        return '\n'.join(
            f'{error:8.2f} W  {step}' for step, error in zip(self.steps, self.errors, strict=True)
        )

    def figure(self, lines: Mapping[str, float] | None = None) -> Figure:
        """Draw it; lines: errors of other models, W."""
        return figures.staircase(
            self.steps, self.errors, {'sensor noise': self.noise, **(lines or {})}
        )


def _comparable(entry: Mapping[str, Any], judged: JudgedModel, loaded: Loaded) -> bool:
    return (
        entry.get('held_out') == judged.held_out
        and all(entry.get(key) == own for key, own in loaded.judged_on.items())
        and {*entry.get('rmse_w', ())} == {*judged.rmse}
    )
