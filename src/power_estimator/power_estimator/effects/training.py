"""Fit a model of named effects to recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError

from power_estimator.drive_types import DriveType, assign, infer_types
from power_estimator.effects import Catalogue, builtin_catalogue
from power_estimator.effects.fit.blocks import Blocks
from power_estimator.effects.fit.candidate_screener import shaped
from power_estimator.effects.fit.design import Active, BasePower, Prior, Structure
from power_estimator.effects.fit.fitter import Fit, Fitter, measurement_terms
from power_estimator.effects.fit.folds import Folds
from power_estimator.effects.fit.settings import FitSettings
from power_estimator.effects.fit.whole_robot import column_of, expanded, share_of
from power_estimator.effects.model_file.model import DriveGroup, EffectModel, FittedValue
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.signals.prepared import Prepared, prepare

LEAST_SECONDS = 20.0
"""Less than this says nothing of what is missing: walking repeats every second or two."""
LEAST_TO_FIT = 1.5
"""Seconds for a fit of a few coefficients, whose intervals then say how little is known."""
LEAST_POINTS = 20
"""Operating points for a fit: four in each fold, as many as a model without much in it has."""
_ENDS = 1.0  # s, more than filters take off both ends of a recording
_LEAST_WINDOWS = 2 * FitSettings.folds  # each fold has two
_LEAST_SPEED, _LEAST_TORQUE = 0.05, 0.3  # rad/s, N·m, standard deviations


@dataclass(frozen=True)
class Material:
    """Prepared signals of recordings, with all that a fit to them needs.

    types: drives that share coefficients; base_power: of the model that effects are added to.
    """

    prepared: Prepared
    types: tuple[DriveType, ...]
    base_power: BasePower | None = None
    settings: FitSettings = field(default_factory=FitSettings)

    def structure(self, actives: Sequence[Active]) -> Structure:
        """Return the structure of the effects; for a robot with one meter, by drive."""
        if self.prepared.whole:
            return Structure(expanded(actives, self.prepared.signals))
        return Structure(tuple(actives))

    def fitter(self, *, per_drive: bool = False, prior: Prior | None = None) -> Fitter:
        """Return a fitter with a prior; drives of a type share coefficients unless per_drive."""
        prepared, base, settings = self.prepared, self.base_power, self.settings
        if prepared.whole:
            return Fitter(prepared, base=base, settings=settings)
        columns = assign(prepared.names, self.types)
        groups = None if per_drive else [own for own in columns.values() if own]
        return Fitter(prepared, groups=groups, base=base, settings=settings, prior=prior)

    def at_most(self, seconds: float) -> 'Material':
        """Return the material cut to so many seconds, in pieces spread over all recordings."""
        prepared, base = pieces(self.prepared, seconds), self.base_power
        if base is not None and prepared.part is not None:
            base = replace(base, power=base.power[prepared.part.samples])
        return replace(self, prepared=prepared, base_power=base)


def material(
    data: AlignedDataset,
    *,
    per: str = 'type',
    base: Singles | None = None,
    catalogue: Catalogue | None = None,
    least: float = LEAST_TO_FIT,
    window: float = 0.0,
    settings: FitSettings | None = None,
    prepared: Prepared | None = None,
) -> Material:
    """Prepare aligned data (400 Hz, not smoothed) for fitting and diagnosis.

    per: `type` or `drive`, which share coefficients. base: power of the model that effects are
    added to, W [T, D] for the drives of data. least: s, in place of which operating points need
    LEAST_POINTS. window: as in `prepare`. prepared: the result of that for these data; not used
    with a base. InputError, which says what is missing, for data too short or too still to decide
    anything.
    """
    settings = settings or FitSettings()
    if base is not None:
        known = np.where(np.isfinite(base), data.power, np.nan).astype(np.float32)
        prepared = prepare(replace(data, power=known), window)
    elif prepared is None:
        prepared = prepare(data, window)
    _require_excitation(prepared, least)
    if window:
        _require_windows(prepared, window, settings)
    drives = prepared.signals.names
    types = infer_types(drives)
    if per == 'drive' or prepared.whole:
        types = tuple(DriveType(name, (name,)) for name in drives)
    base_power = None
    if base is not None:
        columns = [data.names.index(name) for name in drives]
        power = np.nan_to_num(np.asarray(base[:, columns], dtype=np.float64))
        if len(power) != len(prepared.signals.time):
            raise InputError('the recording has samples without position, velocity or torque')
        base_power = BasePower(power, _copper(prepared, catalogue, settings))
    return Material(prepared, types, base_power, settings)


def fit_model(
    name: str,
    material: Material,
    effects: Sequence[Active],
    catalogue: Catalogue,
    *,
    base: str | None = None,
    fitted_on: Sequence[Mapping[str, str]] = (),
    seed: int = 0,
    prior: Prior | None = None,
) -> tuple[EffectModel, Fit]:
    """Fit effects with errors of measurement beside them; return the model and the fit behind it.

    base: spec of the base model; fitted_on: name and sha256 of the recordings; prior: expected
    coefficients, for drives with a meter each. Shapes that an effect leaves open are searched.
    Coefficients get 95 % intervals. InputError for effects that the recordings cannot show.
    """
    _require_usable(material.prepared, effects)
    structure, steady = material.structure(effects), material.prepared.steady
    terms = measurement_terms(catalogue, shaft='shaft' in structure.names, steady=steady)
    if prior and material.prepared.whole:
        raise InputError('the prior is of one drive, and these drives share one meter')
    fitter = material.fitter(prior=prior)
    whole = shaped(fitter, Folds.of(fitter.blocks, fitter.settings), structure.plus(*terms))
    fit = fitter.fit(whole, iterations=12)
    intervals = fitter.intervals(fit, seed)
    shapes = {active.name: active.shape for active in whole.actives}
    chosen = Structure(
        tuple(replace(active, shape=shapes.get(active.name, active.shape)) for active in effects)
    )
    model = EffectModel(
        name=name,
        structure=chosen,
        groups=_groups(material, fit, intervals, chosen),
        base=base,
        metered='robot' if material.prepared.whole else 'drives',
        fitted_on=tuple(fitted_on),
        prior=prior or {},
    )
    return model, fit


def _groups(
    material: Material, fit: Fit, intervals: Floats, chosen: Structure
) -> tuple[DriveGroup, ...]:
    prepared, signals = material.prepared, material.prepared.signals
    voltage = np.median(signals.voltage, axis=0)
    groups = []
    for kind in material.types:
        own = assign(signals.names, material.types)[kind.name]
        if not own:
            continue
        first = own[0]
        meter = 0 if prepared.whole else first

        def value(column: int, share: float = 1.0, meter: int = meter) -> FittedValue:
            low, high = (share * float(bound) for bound in intervals[meter, column])
            found = share * float(fit.coefficients[meter, column])
            ends = min(low, found), max(high, found)
            return FittedValue(found, ends, fit.at_bound(meter, column))

        coefficients = {}
        for active in chosen.free:
            share = share_of(active.effect, prepared, first).tolist()
            coefficients[active.name] = tuple(
                value(column_of(fit.structure, active.name, signals.names[first], term), factor)
                for term, factor in enumerate(share)
            )
        measurement = {
            active.name: value(fit.structure.columns_of(active.name)[0])
            for active in fit.structure.free
            if active.effect.kind == 'measurement'
        }
        if not prepared.steady:
            measurement['time_offset'] = FittedValue(fit.delay, (fit.delay, fit.delay))
        copper = 0.0 if material.base_power is None else float(material.base_power.copper[first])
        constant = float(prepared.torque_constant[first])
        groups.append(
            DriveGroup(
                type=kind,
                coefficients=coefficients,
                measurement=measurement,
                velocity_lag=float(np.mean(prepared.lag[own])),
                voltage=float(np.mean(voltage[own])),
                copper=copper,
                scale=signals.scale.of(first),
                torque_constant=constant if np.isfinite(constant) else None,
            )
        )
    return tuple(groups)


def _require_usable(prepared: Prepared, effects: Sequence[Active]) -> None:
    signals = prepared.signals
    for active in effects:
        if signals.at_motor.all() and active.effect.needs_joint_torque:
            raise InputError(
                f"{active.name}: the torque of {', '.join(prepared.names)} is the motor's "
                '(card.yaml), which has it in already; leave it out, or say `torque: joint` in '
                'the card if a sensor at the joint measured it'
            )
        shapes = active.effect.shapes_of(prepared.scale)
        if any(active.effect.usable(signals, **shape) for shape in shapes):
            continue
        if signals.steady:
            raise InputError(
                f'{active.name}: it shows while something changes, and operating points are all '
                f'that {", ".join(prepared.recordings)} holds; leave it out, or record motion'
            )
        raise InputError(
            f'{active.name}: {", ".join(prepared.recordings)} cannot show it, by its formula '
            f'({active.effect.formula}); leave it out'
        )


def _require_excitation(prepared: Prepared, least: float) -> None:
    if prepared.steady and len(prepared.time) < LEAST_POINTS:
        raise InputError(
            f'{", ".join(prepared.recordings)}: {prepared.extent} decide nothing; '
            f'{LEAST_POINTS} or more do, at several speeds and loads'
        )
    if not prepared.steady and prepared.seconds < least:
        raise InputError(
            f'{", ".join(prepared.recordings)}: {prepared.seconds:.1f} s without gaps decide '
            f'nothing; record {least + _ENDS:g} s or more (a few minutes are better)'
        )
    speed = prepared.signals.velocity.std(axis=0)
    torque = prepared.signals.torque.std(axis=0)
    still = (speed < _LEAST_SPEED) & (torque < _LEAST_TORQUE)
    if still.all():
        raise InputError(
            f'{", ".join(prepared.recordings)}: no drive moves or is loaded (speed varies by '
            f'{speed.max():.2f} rad/s, torque by {torque.max():.2f} N·m); record motion at '
            'several speeds and loads'
        )


def _require_windows(prepared: Prepared, window: float, settings: FitSettings) -> None:
    count = int(Blocks.of(prepared, settings).valid.any(axis=1).sum())
    if count < _LEAST_WINDOWS:
        raise InputError(
            f'{", ".join(prepared.recordings)}: its slow meter is judged by the energy over '
            f'windows of {window:.3g} s; {count} of them decide nothing, record '
            f'{(_LEAST_WINDOWS + 2) * window:.0f} s or more'
        )


def _copper(prepared: Prepared, catalogue: Catalogue | None, settings: FitSettings) -> Floats:
    """Return the copper loss, W/(N·m)² [D], of a baseline model fitted for that alone."""
    known = catalogue or builtin_catalogue()
    names = ('shaft', 'copper_loss', 'viscous_friction', 'coulomb_friction', 'idle')
    structure = Structure(tuple(Active.of(known[name]) for name in names))
    fitter = Fitter(prepared, settings=settings)
    fit = fitter.fit(structure.plus(*measurement_terms(known, shaft=True)))
    column = fit.structure.columns_of('copper_loss')[0]
    found = fit.coefficients[:, column]
    return np.array(np.broadcast_to(found, len(prepared.signals.names)))  # of a robot: one for all
