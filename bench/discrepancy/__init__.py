"""
A judge with a learned discrepancy, beside today's lab in the benchmark of reliability.

    python bench/reliability.py --judge discrepancy:judged --families … --out FILE.jsonl

A linear Gaussian model by drive (Kennedy and O'Hagan 2001): effects with broad priors; errors of
the measurement with priors from what such sensors are known for; departures of each effect from
its textbook formula with the priors of DEPARTURES; a smooth discrepancy over causes (torque,
speed, position, their rates, time), its size learned by the marginal likelihood. An effect that
is not in a set may still explain SPIKE of the power: less is not worth a name. The likelihood is
tempered by the scores of blocks of 2 s, as neighbouring errors are no independent evidence.

A set of effects is judged at its own point: linearised about another set's coefficients, friction
that is twice as large costs hundreds of nats, as the copper loss of its torque is quadratic.
"""

from discrepancy.search import judged

__all__ = ['judged']
