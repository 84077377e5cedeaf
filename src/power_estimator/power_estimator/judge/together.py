"""Several recordings of one robot, judged together: own meter errors, common coefficients."""

from collections.abc import Collection
from dataclasses import replace

from wattwalk_core.arrays import Floats

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms
from power_estimator.effects.fit.per_recording import OWN_TERMS, in_step, own_delays, own_terms
from power_estimator.effects.signals.prepared import Prepared
from power_estimator.effects.training import Material

_LIKE_A_DELAY = ('rotor_inertia', 'spring')


def together(
    own: Material, structure: Structure, catalogue: Catalogue, apart: Collection[str] = OWN_TERMS
) -> tuple[Material, tuple[Active, ...], Floats]:
    """
    Recordings in step, the terms of their measurement, and their own delays, s [R].

    Delays and the terms that are named apart are each recording's own.
    """
    prepared = own.prepared
    steady = prepared.steady
    terms = measurement_terms(catalogue, shaft='shaft' in structure.names, steady=steady)
    alike = [
        catalogue[name]
        for name in _LIKE_A_DELAY
        if name in catalogue
        and not any(known.partition('@')[0] == name for known in structure.names)
        and catalogue[name].usable(prepared.signals)
    ]
    whole = structure.plus(*own.structure([Active.of(effect) for effect in alike]).actives, *terms)

    def fitter(alone: Prepared) -> Fitter:
        return replace(own, prepared=alone).fitter(per_drive=True)

    delays = own_delays(prepared, whole, fitter)
    aligned = replace(own, prepared=in_step(prepared, delays))
    return aligned, own_terms(terms, len(prepared.recordings), apart), delays
