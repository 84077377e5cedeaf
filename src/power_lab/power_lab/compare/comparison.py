"""Models against measurements, on held-out data only, and where each fails."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_estimator.judge.result import JudgedModel
from power_estimator.loader import load_model
from power_estimator.model import PowerModel
from power_estimator.proxies import Proxy
from wattwalk_core.arrays import Floats

from power_lab.compare.both_sides import BothSides, both_sides
from power_lab.compare.regimes import Regime, worst_regimes


@dataclass(frozen=True)
class Comparison:
    """Held-out errors of models on the same samples, and the regimes in which each is worst."""

    prepared: Prepared
    models: tuple[JudgedModel, ...]
    regimes: tuple[tuple[Regime, ...], ...]  # of each model, the worst first
    state: Mapping[str, Floats]  # signals by name [N, D]
    labels: Mapping[str, NDArray[np.str_]]
    both: Mapping[str, BothSides]  # of drives with torque at the joint and motor current

    def __str__(self) -> str:
        return '\n'.join(f'{judged.rms_w:8.2f} W  {judged.name}' for judged in self.models)

    def json(self) -> dict[str, Any]:
        """Return JSON-compatible values, as `compare --json` writes them."""
        noise = zip(self.prepared.names, self.prepared.noise.tolist(), strict=True)
        return {
            'models': [
                {
                    'name': judged.name,
                    'effects': list(judged.effects),
                    'held_out': judged.held_out,
                    'time_offset': round(judged.delay, 6),
                    'drives': {meter: score.json() for meter, score in judged.drives.items()},
                    'total': judged.total.json() if judged.total else None,
                    'regimes': [regime.json() for regime in regimes],
                    'at_bound': list(judged.at_bound),
                }
                for judged, regimes in zip(self.models, self.regimes, strict=True)
            ],
            'drives': list(self.prepared.names),
            'seconds': round(self.prepared.seconds, 2),
            'both_sides': {name: one.json() for name, one in self.both.items()},
            'operating_points': len(self.prepared.time) if self.prepared.steady else None,
            'extent': self.prepared.extent,
            'sensor_noise_w': {
                name: float(f'{watts:.6g}') if np.isfinite(watts) else None
                for name, watts in noise
            },
        }


def compare(loaded: Loaded, specs: Sequence[str], catalogue: Catalogue) -> Comparison:
    """Judge models on recordings by file or name, and find where each fails.

    specs: `model.yaml`, `ppn:RUN` or a proxy each. InputError for one that cannot be loaded.
    """
    models = [load_model(spec, catalogue) for spec in specs]
    return comparison(Judge(loaded, catalogue), models, specs)


def comparison(
    judge: Judge, models: Sequence[PowerModel], specs: Sequence[str] = ()
) -> Comparison:
    """Judge loaded models and find where each fails; specs: names to show for networks."""
    shown = [
        model.name if isinstance(model, EffectModel | Proxy) else spec
        for model, spec in zip(models, specs or [m.name for m in models], strict=True)
    ]
    judged, prepared = judge.compare(models, shown), judge.prepared
    state, labels = describe_state(prepared, judge.recordings)
    regimes = [
        worst_regimes(
            by_drive(one.residual, prepared),
            state,
            prepared.signals.names,
            labels,
            scale=prepared.signals.scale,
        )
        for one in judged
    ]
    worst = tuple(map(tuple, regimes))
    return Comparison(prepared, judged, worst, state, labels, both_sides(judge))


def by_drive(residual: Floats, prepared: Prepared) -> Floats:
    """Broadcast values of the meters [N, M] to the drives [N, D]; M is D, or 1 for one meter."""
    return np.broadcast_to(residual, (len(residual), len(prepared.signals.names)))


def describe_state(
    prepared: Prepared, loaded: Loaded
) -> tuple[dict[str, Floats], dict[str, NDArray[np.str_]]]:
    """Return signals, and labels (`phase`, `controller`), to bin errors by; [N, D] each, 50 Hz."""
    state = prepared.state()
    shape = state['torque'].shape
    if prepared.steady:
        del state['acceleration'], state['torque_rate']
    else:
        since = prepared.time - prepared.time[0]
        state['time'] = np.broadcast_to(since[:, None], shape)
    labels: dict[str, NDArray[np.str_]] = {}
    force = loaded.data.extras.get('foot_force')
    if force is not None and (part := prepared.part) is not None:
        past = prepared.signals.past
        whole = past is not None and len(force) == len(past.time)
        force = force[part.samples] if whole else None
    if force is not None and len(force) == len(prepared.signals.time):
        loads = prepared.reduced(np.nan_to_num(np.asarray(force, dtype=np.float64)))
        words = np.full(shape, '', dtype='<U6')
        for drive, name in enumerate(prepared.signals.names):
            leg = name.split('_')[0].upper()
            if leg in _LEGS and loads.shape[1] == len(_LEGS):
                stands = loads[:, _LEGS.index(leg)] > _STANCE
                words[:, drive] = np.where(stands, 'stance', 'swing')
        labels['phase'] = words
    if len(set(loaded.controllers)) > 1:
        names = np.array(loaded.controllers)[prepared.recording]
        labels['controller'] = np.broadcast_to(names[:, None], shape)
    return state, labels


_LEGS = ('LF', 'RF', 'LH', 'RH')
_STANCE = 20.0  # N
