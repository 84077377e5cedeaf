"""Names of effects in words."""

IN_WORDS = {
    'shaft': 'mechanical power at the joint',
    'copper_loss': 'copper loss in the winding',
    'winding_heating': 'heating of the winding',
    'saturation': 'saturation of the torque constant',
    'motor_saturation': 'saturation of the torque constant',
    'magnet_heating': 'weakening of warm magnets',
    'viscous_friction': 'viscous friction',
    'coulomb_friction': 'Coulomb friction',
    'stribeck_friction': 'Stribeck friction',
    'load_friction': 'friction that grows with load',
    'iron_loss': 'iron loss',
    'inverter_loss': 'inverter loss',
    'idle': 'idle draw',
    'regeneration_efficiency': 'regeneration loss',
    'regeneration_limit': 'blocked regeneration',
    'field_weakening': 'field weakening',
    'rotor_inertia': 'rotor inertia',
    'spring': 'the series spring',
    'cogging': 'cogging',
    'line_resistance': 'line resistance',
    'torque_bias': "a constant torque (the torque sensor's zero, or friction in one direction)",
}

_COEFFICIENTS = {
    ('copper_loss', 'k'): 'loss per torque²',
    ('winding_heating', 'c'): 'growth with temperature',
    ('winding_heating', 'c0'): 'warmth at the start',
    ('saturation', 'c'): 'loss per torque⁴',
    ('motor_saturation', 's'): 'torque lost per torque²',
    ('magnet_heating', 'alpha'): 'torque lost per kelvin',
    ('viscous_friction', 'B'): 'friction per speed',
    ('coulomb_friction', 'Tc'): 'friction torque',
    ('stribeck_friction', 'Ts'): 'torque to break away',
    ('load_friction', 'c'): 'share of the load',
    ('iron_loss', 'h'): 'hysteresis',
    ('iron_loss', 'e'): 'eddy currents',
    ('inverter_loss', 'a'): 'conduction',
    ('inverter_loss', 's'): 'switching',
    ('idle', 'P0'): 'power at rest',
    ('regeneration_efficiency', '1 − eta'): 'share lost',
    ('regeneration_limit', 'b'): 'share burnt',
    ('field_weakening', 'c'): 'loss beyond base speed',
    ('rotor_inertia', 'J'): 'inertia',
    ('spring', '1/ks'): 'compliance',
    ('cogging', 'A·cos(phase)'): 'cosine part',
    ('cogging', 'A·sin(phase)'): 'sine part',
    ('line_resistance', 'Rl'): 'resistance',
    ('torque_bias', 'b'): 'torque',
}


def coefficient_in_words(effect: str, symbol: str) -> str:
    """A coefficient of an effect in everyday words, its symbol where there are none."""
    return _COEFFICIENTS.get((effect, symbol), symbol)


def verdict_in_words(verdict: str, found: int) -> str:
    """A verdict as a heading; found: number of effects that it names."""
    return {
        'named': f'Found: {found} missing effect{"" if found == 1 else "s"}',
        'ambiguous': 'Several effects are plausible',
        'none_of_the_above': 'Not fully explained by known effects',
        'no_evidence': 'No missing effect that this recording shows',
    }[verdict]


def in_words(name: str) -> str:
    """The effect in everyday words."""
    return IN_WORDS.get(name, name.replace('_', ' '))
