"""Posterior of a power model's effects: what is missing, how sure that is, and coefficients.

A linear Gaussian model by meter (Kennedy and O'Hagan 2001): effects with broad priors, errors of
the measurement with priors from what such sensors are known for, departures of each effect from
its formula, and a smooth discrepancy over causes (torque, speed, position, their rates, time)
whose size the marginal likelihood gives. Scores of blocks of 2 s temper the likelihood.

A set of effects is judged at its own point: linearised about another set's coefficients, friction
that is twice as large costs hundreds of nats, as the copper loss of its torque is quadratic.
"""
