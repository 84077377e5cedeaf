"""A model of effects and a file of effects, as small as they can be."""

MODEL = """
format: power_model/1
name: base
effects: {shaft: null, copper_loss: null, idle: null, iron_loss: {carried: 1.0}}
drives:
  KFE:
    patterns: ['*_KFE']
    velocity_lag: 0.002
    voltage: 48.0
    copper: 0.01
    scale: {torque: 1.0, speed: 1.0, power: 1.0, voltage: 1.0, gain: 1.0}
    torque_constant: 0.1
    coefficients:
      copper_loss: [{symbol: k, unit: W/(N·m)², value: 0.02, interval: [0.01, 0.03]}]
      idle: [{symbol: P0, unit: W, value: 8.0, interval: [7.0, 9.0], at_bound: upper}]
      iron_loss: [{value: 0.1}, {value: 0.01}]
    measurement: {power_gain: {value: 0.01, interval: [0.0, 0.02]}}
fitted_on: [{name: walk, sha256: ab}]
"""
EFFECT = """
from power_estimator.effects import Effect, Term

class Fan(Effect):
    name = 'fan'
    physics = 'a fan'
    formula = 'f·|w|³'
    terms = (Term('f', 'W·s³/rad³', 0.0, 10.0),)

    def regressors(self, signals, **shape):
        return abs(signals.velocity)[..., None] ** 3
"""
