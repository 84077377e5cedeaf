"""Choice of what the missing power depends on, and of the smallest formula that says so."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from power_lab.discover.formula import Formula, Place
from power_lab.discover.grammar import PRIMITIVES
from power_lab.discover.search import Expression
from power_lab.structure.drivers import Family
from power_lab.structure.shapes import LearnedShape

KEEPS = 0.9  # share of the shape's gain that a formula must keep to be called one
CLOSE = 0.85  # share of the best score from which on an option comes into question
_NEAR_BEST, _LEAST_OF_BEST = 0.995, 0.95
"""
Share of the best formula's gain that a smaller one must keep, or all but what is too small to be
judged, if that is not more than a twentieth.
"""
_HANDICAP = {'other_drive': 0.85}
"""Factor on the gain of another drive, which must explain more than the own state."""
_MEMORY_HANDICAP = 0.93
_WAVE_HANDICAP = 0.97
_ASYMMETRIC, _ASYMMETRY_HANDICAP = ('speed', 'torque', 'acceleration'), 0.995

Explained = Mapping[int, Sequence[tuple[LearnedShape, Sequence[Expression]]]]
"""By drive: shapes with their formulas."""


@dataclass(frozen=True)
class Option:
    """One family over all drives."""

    formula: Formula
    shape_gain: float
    score: float
    shapes: Mapping[int, LearnedShape]

    @property
    def kept(self) -> float:
        """Share of the shape's gain that the formula keeps."""
        return self.formula.gain / max(self.shape_gain, 1e-12)


def options(
    explained: Explained, least: Mapping[int, float], floor: Mapping[int, float]
) -> list[Option]:
    """Families in the order of what they explain, each with its formula.

    least: W² by drive that counts as explained at all; floor: W² that can be judged.
    """
    groups: dict[tuple[str, ...], dict[int, list[tuple[LearnedShape, Sequence[Expression]]]]]
    groups = defaultdict(lambda: defaultdict(list))
    for drive, rows in explained.items():
        for shape, expressions in rows:
            groups[shape.family.group][drive].append((shape, expressions))
    found = [_option(by_drive, least, floor) for by_drive in groups.values()]
    return sorted((one for one in found if one is not None), key=lambda one: -one.score)


def without_known(
    ranked: Sequence[Option], term_of: Callable[[Formula], str]
) -> tuple[list[Option], str]:
    """Options that repeat no term of the model, and the first term that one repeats ('' for none).

    None are left where those that repeat a term explain clearly more.
    """
    terms = [term_of(one.formula) for one in ranked]
    new = [one for one, term in zip(ranked, terms, strict=True) if not term]
    repeated = next((term for term in terms if term), '')
    if new and new[0].score < CLOSE * ranked[0].score:
        return [], repeated
    return new, repeated


def _option(
    by_drive: Mapping[int, Sequence[tuple[LearnedShape, Sequence[Expression]]]],
    least: Mapping[int, float],
    floor: Mapping[int, float],
) -> Option | None:
    shapes = {d: max((s for s, _ in rows), key=lambda s: s.gain) for d, rows in by_drive.items()}
    candidates: dict[str, dict[int, Place]] = defaultdict(dict)
    for drive, rows in by_drive.items():
        for shape, expressions in rows:
            for one in expressions:
                known = candidates[one.primitive.name].get(drive)
                if one.gain >= least[drive] and (known is None or one.gain > known.gain):
                    place = Place(shape.family, one.parameters, one.gain)
                    candidates[one.primitive.name][drive] = place
    formulas = [
        Formula(PRIMITIVES[name], places, 0.0) for name, places in candidates.items() if places
    ]
    if not formulas:
        return None
    best = max(formula.gain * _weight(formula) for formula in formulas)
    judged = sum(floor[drive] for drive in shapes)
    enough = min(_NEAR_BEST * best, max(best - judged, _LEAST_OF_BEST * best))
    near = [f for f in formulas if f.gain * _weight(f) >= enough]
    chosen = min(near, key=lambda f: (f.primitive.complexity, -f.gain))
    shape_gain = sum(max(shapes[d].gain, place.gain) for d, place in chosen.places.items())
    formula = Formula(chosen.primitive, chosen.places, shape_gain)
    family = formula.family
    score = handicap(family) * max(formula.gain, 0.8 * shape_gain)
    return Option(formula, shape_gain, score, {d: shapes[d] for d in chosen.places})


def handicap(family: Family) -> float:
    """Factor on what a family explains: simpler causes come first."""
    own = _MEMORY_HANDICAP if family.driver.memory else 1.0
    if family.driver.name in _ASYMMETRIC:
        own *= _ASYMMETRY_HANDICAP
    return own * _HANDICAP.get(family.kind, 1.0)


def _weight(formula: Formula) -> float:
    return _WAVE_HANDICAP if formula.primitive.terms > 1 else 1.0
