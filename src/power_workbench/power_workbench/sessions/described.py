"""Models, learned shapes and recordings as the page shows them."""

from typing import TYPE_CHECKING, Any

from power_estimator.effects import Catalogue
from power_estimator.effects.fit.design import Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.loader import load_model
from power_lab.structure.words import coefficient_in_words, in_words
from power_recordings.quality.check import check_recording
from power_recordings.reading.reader import Recording
from wattwalk_core.console import finite

from power_workbench.views import maps

if TYPE_CHECKING:
    from power_lab.discover.outcome import DiscoveryOutcome


def described_model(spec: str, catalogue: Catalogue) -> dict[str, Any]:
    """Return a model's content for the page: effects in words, coefficients by drive type.

    Each coefficient has symbol, unit, value, 95 % interval, and the bound it stands at, if any. A
    model of another kind is the base, with no effects. InputError for a spec that cannot be
    loaded.
    """
    model = load_model(spec, catalogue)
    if not isinstance(model, EffectModel):
        model = EffectModel(model.name, Structure(()), base=spec)
    effects = []
    for active in model.structure.actives:
        rows = []
        for group in model.groups if active in model.structure.free else ():
            values = group.coefficients[active.name]
            for term, value in zip(active.effect.terms, values, strict=True):
                rows.append(
                    {
                        'group': group.type.name,
                        'symbol': term.symbol,
                        'words': coefficient_in_words(active.name, term.symbol),
                        'unit': term.unit,
                        'value': value.value,
                        'interval': list(value.interval),
                        'at_bound': value.at_bound or None,
                    }
                )
        effects.append(
            {
                'name': active.name,
                'words': in_words(active.name),
                'physics': active.effect.physics,
                'formula': active.effect.formula,
                'fixed': active.effect.fixed,
                'coefficients': rows,
            }
        )
    return {
        'name': model.name,
        'base': model.base,
        'effects': effects,
        'at_bound': list(model.at_bound),
        'fitted': model.fitted,
        'history': [dict(entry) for entry in model.history],
    }


def described_shapes(outcome: 'DiscoveryOutcome') -> list[dict[str, Any]]:
    """Return learned shapes, formulas and errors as JSON content, one per effect and drive."""
    from power_lab.report.discovery_page import (  # slow to import: plots
        formula_over_shape,
        standard_error,
    )

    names, out = outcome.own.prepared.names, []
    for one in outcome.discovery.found:
        if one.formula is None or one.shapes is None or one.coefficients is None:
            continue
        for drive in one.formula.places:
            shape = one.shapes[drive]
            drawn, axes = formula_over_shape(one, drive)
            out.append(
                {
                    'name': one.name,
                    'drive': names[drive],
                    'formula': one.formula.text(drive),
                    'axes': list(axes),
                    'x': maps.rounded(shape.nodes),
                    'shape': maps.rounded(shape.values),
                    'error': maps.rounded(2.0 * standard_error(shape)),
                    'drawn': maps.rounded(drawn),
                }
            )
    return out


def described_recording(recording: Recording) -> dict[str, Any]:
    """Return card, rates (Hz), drives and quality findings of a recording as content of JSON."""
    quality, card = check_recording(recording), recording.card
    return {
        'path': str(recording.path),
        'name': recording.path.name,
        'seconds': round(recording.duration, 2),
        'card': {
            name: getattr(card, name)
            for name in ('robot', 'unit', 'controller', 'terrain', 'notes')
            if getattr(card, name)
        },
        'notes': [{'time': mark.time, 'text': mark.text} for mark in card.marks],
        'rates': {name: round(float(t.rate), 2) for name, t in quality.topics.items()},
        'torque': dict(quality.torque_at),
        'drives': [
            {'name': name, 'updates_hz': finite(round(float(one.updates_hz), 2))}
            for name, one in quality.drives.items()
        ],
        'findings': [
            {'severity': one.severity, 'drive': one.drive, 'text': one.text}
            for one in quality.findings
        ],
        'problems': list(recording.problems),
    }
