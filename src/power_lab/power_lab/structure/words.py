"""Names of effects in words."""

IN_WORDS = {
    'shaft': 'mechanical power at the joint',
    'copper_loss': 'copper loss in the winding',
    'winding_heating': 'heating of the winding',
    'viscous_friction': 'viscous friction',
    'coulomb_friction': 'Coulomb friction',
    'stribeck_friction': 'Stribeck friction',
    'load_friction': 'friction that grows with load',
    'iron_loss': 'iron loss',
    'inverter_loss': 'inverter loss',
    'idle': 'idle draw',
    'regeneration_efficiency': 'losses on the way back (regeneration efficiency)',
    'regeneration_limit': 'blocked regeneration',
    'field_weakening': 'field weakening',
    'rotor_inertia': 'rotor inertia',
    'spring': 'the series spring',
    'cogging': 'cogging',
    'line_resistance': 'line resistance',
    'torque_bias': "a constant torque (the torque sensor's zero, or friction in one direction)",
}


def in_words(name: str) -> str:
    """The effect in everyday words."""
    return IN_WORDS.get(name, name.replace('_', ' '))
