"""Choice of a model for a recording that comes without one."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from power_estimator.effects import Catalogue
from power_estimator.effects.fit.candidate_screener import CandidateScreener
from power_estimator.effects.fit.design import Active
from power_estimator.effects.fit.fitter import measurement_terms
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.training import Material
from power_estimator.judge.judge import Judge
from power_estimator.judge.result import over_meters

from power_lab.compare.fitting import fitted, named_effects

_SURE: Final = ('shaft', 'copper_loss', 'idle')  # every drive has these
_MAYBE: Final = (
    *('coulomb_friction', 'viscous_friction', 'load_friction', 'rotor_inertia', 'iron_loss'),
    *('inverter_loss', 'spring', 'line_resistance', 'regeneration_efficiency'),
)
_DRIVE_SECONDS: Final = 1200.0  # that a model is chosen, fitted and judged on
_FEWEST: Final = 8  # pieces: two strides or more of each fold
_PIECE: Final = 12.0  # s
_LEAST: Final = 0.02  # by which an effect lowers the log of the held-out squared error: 1 % rms


def chosen_effects(judge: Judge) -> list[str]:
    """Effects that a recording shows, of those that most drives have.

    Shaft, copper loss and idle are taken as they are; each other one is added while it lowers the
    held-out error by 1 % or more, the best first.
    """
    material, known = judge.material(), judge.catalogue
    effects = list(_SURE)
    if material.prepared.whole:
        return effects
    screener = _screener(material, known)
    found: list[Active] = []
    best, left = screener.screen(), list(screener.candidates)
    while left:
        trials = screener.screened([[*found, active] for active in left])
        at = min(range(len(left)), key=lambda index: trials[index].loss)
        if best.loss - trials[at].loss < _LEAST * len(material.prepared.names):
            break
        best = trials[at]
        found.append(left[at])
        left = [active for active in left if active.name != left[at].name]
    return [*effects, *(active.name for active in found)]


def chosen_model(judge: Judge, seed: int = 0) -> EffectModel:
    """Fit the chosen effects; the last are dropped while the held-out error rises by at most 1 %.

    Errors are those of whole fits, with errors of the meter by recording. The model has no
    intervals: a budget draws its own.
    """

    def of(names: Sequence[str]) -> EffectModel:
        actives = named_effects(names, judge.catalogue)
        return fitted(judge, actives, 'chosen', seed=seed, intervals=False)

    effects = chosen_effects(judge)
    model = of(effects)
    while len(effects) > len(_SURE):
        fewer = of(effects[:-1])
        if not held_out_w(fewer) <= (1.0 + _LEAST / 2.0) * held_out_w(model):
            break
        effects, model = effects[:-1], fewer
    return model


def held_out_w(model: EffectModel) -> float:
    """Held-out error of a fitted model over its drives, W rms."""
    return over_meters(model.history[-1]['rmse_w'].values())


def judge_of_pieces(judge: Judge) -> Judge:
    """Judge of 12 s pieces spread evenly over long recordings; the given judge for short ones."""
    loaded = judge.recordings
    data = loaded.data
    length = round(_PIECE * data.rate)
    count = max(_FEWEST, int(_DRIVE_SECONDS / _PIECE / len(data.names)))
    if loaded.window or data.steady or len(data.time) <= count * length:
        return judge
    starts = np.linspace(0, len(data.time) - length, count).astype(np.intp)
    rows = (starts[:, None] + np.arange(length)).ravel()
    marks = np.stack([data.segment[rows], np.repeat(np.arange(count), length)])
    _, segment = np.unique(marks, axis=1, return_inverse=True)
    pieces = replace(data.rows(rows), segment=segment.reshape(-1).astype(np.int32))
    return Judge(replace(loaded, data=pieces), judge.catalogue, judge.settings)


def _screener(material: Material, known: Catalogue) -> CandidateScreener:
    fitter = material.fitter()
    structure = material.structure([Active.of(known[name]) for name in _SURE])
    fit = fitter.fit(structure.plus(*measurement_terms(known, shaft=True)), iterations=4)
    candidates = [
        Active.of(known[name], shape)
        for name in _MAYBE
        for shape in known[name].tried_on(fitter.prepared.signals)
    ]
    return CandidateScreener(fitter, Folds.of(fitter.blocks, fitter.settings), fit, candidates)
