"""An identified drive as an actuator of MuJoCo or mjlab, with its power."""

from collections.abc import Callable, Mapping
from typing import Final

from power_estimator.effects.signals.scale import VOLTAGE
from wattwalk_core.errors import InputError

from power_lab.drives.library import LibraryDrive

_WATTS: Final[Mapping[str, Callable[..., str]]] = {
    'shaft': lambda: 'm * w',
    'copper_loss': lambda k: f'{k:.6g} * m**2',
    'inverter_loss': lambda a, s: f'({a:.6g} + {s / VOLTAGE:.6g} * voltage) * abs(m)',
    'iron_loss': lambda h, e, carried=0.0: f'{h:.6g} * abs(w) + {e:.6g} * w**2',
    'idle': lambda p: f'{p:.6g}',
    'winding_heating': lambda c, c0, time_constant=0.0: (
        f'{c * 0.0039:.6g} * m**2 * (temperature - 25.0)'
    ),
    'saturation': lambda c: f'{c:.6g} * m**4',
    'motor_saturation': lambda s: f'-{s:.6g} * m**3 * w',
    'magnet_heating': lambda alpha: f'-{alpha:.6g} * (temperature - 25.0) * m * w',
    'field_weakening': lambda c, per_volt: (
        f'{c:.6g} * max(0.0, abs(w) - {per_volt:.6g} * voltage) ** 2'
    ),
}
"""W of an effect by its coefficients and shape, m: torque of the motor, w: speed."""


def power_function(drive: LibraryDrive) -> str:
    """Source of a function of torque, speed, voltage and temperature that returns W."""
    (group,) = drive.model.groups
    terms = []
    for active in drive.model.structure.actives:
        if active.name not in _WATTS:
            raise InputError(f'{drive.name}: {active.name} has no form outside of the lab')
        values = [one.value for one in group.coefficients.get(active.name, ())]
        terms.append(f'        {_WATTS[active.name](*values, **active.parameters)}')
    return (
        f'def power(m, w, voltage={group.voltage:.6g}, temperature=25.0):\n'
        f'    """W drawn at N·m of the {drive.card.torque} and rad/s of the joint."""\n'
        '    return (\n' + ' +\n'.join(terms) + '\n    )\n'
    )


def exported(drive: LibraryDrive, form: str) -> str:
    """Text of an actuator; form: `mujoco` (MJCF) or `mjlab` (Python)."""
    return {'mujoco': _mujoco, 'mjlab': _mjlab}[form](drive)


def _largest(drive: LibraryDrive) -> float:
    """N·m that were seen: the drive may be able to do more."""
    return max(torque for _speed, torque in drive.card.torque_over_speed)


def _joint(drive: LibraryDrive) -> dict[str, float]:
    """Attributes of the joint that the logs determine."""
    (group,) = drive.model.groups
    found = {'frictionloss': drive.card.frictionloss, 'damping': drive.card.damping}
    effects = {
        'frictionloss': 'coulomb_friction',
        'damping': 'viscous_friction',
        'armature': 'rotor_inertia',
    }
    for key, effect in effects.items():
        if effect in group.coefficients:
            found[key] = group.coefficients[effect][0].value
    return {key: value for key, value in found.items() if value}


def _head(drive: LibraryDrive, mark: str) -> list[str]:
    card = drive.card
    over_speed = ', '.join(f'{t:.3g} at {w:.3g}' for w, t in card.torque_over_speed)
    lacking = [key for key in ('armature', 'damping', 'frictionloss') if key not in _joint(drive)]
    lines = [
        f'{drive.name}: {card.title}',
        f'identified by wattwalk from {card.source} ({card.licence})',
        f'torque in N·m seen over speed in rad/s: {over_speed}',
        f'not determined by the logs: {", ".join(lacking)}' if lacking else '',
    ]
    return [f'{mark}{line}' for line in lines if line]


def _mujoco(drive: LibraryDrive) -> str:
    torque = _largest(drive)
    joint = ''.join(f' {key}="{value:.6g}"' for key, value in _joint(drive).items())
    power = '\n'.join(f'      {line}' for line in power_function(drive).splitlines())
    head = '\n'.join(f'      {line}' for line in _head(drive, ''))
    return (
        f'<mujoco>\n  <!--\n{head}\n{power}\n  -->\n  <default>\n'
        f'    <default class="{drive.name}">\n      <joint{joint}/>\n'
        f'      <motor forcerange="{-torque:.6g} {torque:.6g}"/>\n    </default>\n'
        '  </default>\n</mujoco>\n'
    )


def _mjlab(drive: LibraryDrive) -> str:
    joint = _joint(drive)
    seen = ''.join(f'    ({w:.6g}, {t:.6g}),\n' for w, t in drive.card.torque_over_speed)
    fields = ''.join(
        f'    {key}={joint[key]:.6g},\n' for key in ('armature', 'frictionloss') if key in joint
    )
    if 'damping' in joint:
        fields += f'    # of the joint itself: damping {joint["damping"]:.6g} N·m·s/rad\n'
    return (
        '\n'.join(_head(drive, '# ')) + '\n\nfrom mjlab.actuator import IdealPdActuatorCfg\n\n'
        f'{drive.name.upper()} = IdealPdActuatorCfg(\n'
        "    target_names_expr=('.*',),\n    stiffness=0.0,  # of your controller\n"
        '    damping=0.0,  # of your controller\n'
        f'    effort_limit={_largest(drive):.6g},\n{fields})\n'
        f'TORQUE_OVER_SPEED = (  # N·m that were seen up to rad/s\n{seen})\n\n\n'
        + power_function(drive)
    )
