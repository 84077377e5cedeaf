"""The library of identified real drives.

Each is a folder of `identified/`: `model.yaml` (effects with intervals), `drive.yaml` (what was
recorded, by whom, what it does not determine) and `drive.png`. The logs are not in it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.model import DriveGroup, EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
from power_estimator.effects.signals.scale import STANDSTILL, VOLTAGE
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.schema import Length, Quantity, read, schema

FOLDER: Final = Path(__file__).parent / 'identified'
PREFIX: Final = 'drive:'
_Positive = Annotated[float, Quantity(0.0, 1e6)]
_Text = Annotated[str, Length(1)]


@schema
class DriveCard:
    """Origin and limits of an identified drive; torque and speed at the joint."""

    title: _Text
    recorded: _Text
    logs: _Text  # pattern of their names
    source: _Text
    licence: _Text
    torque: Literal['joint', 'motor']  # of which the model is a function
    extent: _Text  # what was fitted, in s or operating points
    r2: Annotated[float, Quantity(-1e6, 1.0)]  # held out
    rmse_w: _Positive
    torque_over_speed: Annotated[tuple[tuple[_Positive, _Positive], ...], Length(1)]  # rad/s, N·m
    does_not_determine: Annotated[tuple[str, ...], Length(1)]
    findings: tuple[str, ...] = ()
    gear_ratio: _Positive = 1.0
    frictionloss: _Positive | None = None  # N·m
    damping: _Positive | None = None  # N·m·s/rad
    format: Literal['drive/1'] = 'drive/1'


@dataclass(frozen=True)
class LibraryDrive:
    """Identified drive with its card and its model."""

    name: str
    card: DriveCard
    model: EffectModel

    @property
    def picture(self) -> Path:
        """Path of the picture: measured power against the model, and the efficiency map."""
        return FOLDER / self.name / 'drive.png'


def names() -> tuple[str, ...]:
    """Names of the drives in the library, sorted."""
    return tuple(sorted(card.parent.name for card in FOLDER.glob('*/drive.yaml')))


def load_drive(name: str) -> LibraryDrive:
    """Read a drive by name, with or without `drive:`; InputError for one that is not there."""
    name = name.removeprefix(PREFIX)
    if name not in names():
        raise InputError(f'no drive {quoted(name)} in the library; there are {", ".join(names())}')
    card = read(DriveCard, FOLDER / name / 'drive.yaml', 'drive')
    return LibraryDrive(name, card, read_model(FOLDER / name / 'model.yaml', builtin_catalogue()))


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
    """Python source of a function power(m, w, voltage, temperature), in W.

    m: torque in N·m of the side that the card names; w: speed of the joint in rad/s. InputError
    for an effect without such a form.
    """
    (group,) = drive.model.groups
    terms = []
    for active in drive.model.structure.actives:
        if active.name not in _WATTS:
            raise InputError(f'{drive.name}: {active.name} has no form outside of the lab')
        values = [one.value for one in group.coefficients.get(active.name, ())]
        terms.append(f'        {_WATTS[active.name](*values, **active.parameters)}')
        if active.parameters.get('carried') and drive.card.torque == 'joint':
            terms += _carried(group, *values)
    head = 'from math import tanh\n\n\n' if any('tanh(' in term for term in terms) else ''
    return (
        f'{head}def power(m, w, voltage={group.voltage:.6g}, temperature=25.0):\n'
        f'    """W drawn at N·m of the {drive.card.torque} and rad/s of the joint."""\n'
        '    return (\n' + ' +\n'.join(terms) + '\n    )\n'
    )


def _carried(group: DriveGroup, h: float, e: float) -> list[str]:
    """Watts that the winding's current loses for the torque of iron loss, as terms of Python."""
    torque, speed, *_ = group.scale
    (copper,) = (one.value for one in group.coefficients['copper_loss'])
    cost = f'{2.0 * copper:.6g} * m'
    if 'inverter_loss' in group.coefficients:
        a, s = (one.value for one in group.coefficients['inverter_loss'])
        slope = f'({a:.6g} + {s / VOLTAGE:.6g} * voltage)'
        cost += f' + {slope} * tanh(m / {0.5 * torque:.6g})'
    sign = f'tanh(w / {STANDSTILL * speed:.6g})'
    return [f'        ({cost}) * ({h:.6g} * {sign} + {e:.6g} * w)']


def exported(drive: LibraryDrive, form: str) -> str:
    """Text of an actuator: `mujoco` (MJCF) or `mjlab` (Python); InputError as `power_function`."""
    largest = max(torque for _speed, torque in drive.card.torque_over_speed)  # that was seen
    return {'mujoco': _mujoco, 'mjlab': _mjlab}[form](drive, largest)


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
    lines = [
        f'{drive.name}: {card.title}',
        f'identified by wattwalk from {card.source} ({card.licence})',
        f'torque in N·m seen over speed in rad/s: {over_speed}',
    ]
    lacking = [key for key in ('armature', 'damping', 'frictionloss') if key not in _joint(drive)]
    if lacking:
        lines.append(f'not determined by the logs: {", ".join(lacking)}')
    return [f'{mark}{line}' for line in lines]


def _mujoco(drive: LibraryDrive, torque: float) -> str:
    joint = ''.join(f' {key}="{value:.6g}"' for key, value in _joint(drive).items())
    power = '\n'.join(f'      {line}' for line in power_function(drive).splitlines())
    head = '\n'.join(f'      {line}' for line in _head(drive, ''))
    return (
        f'<mujoco>\n  <!--\n{head}\n{power}\n  -->\n  <default>\n'
        f'    <default class="{drive.name}">\n      <joint{joint}/>\n'
        f'      <motor forcerange="{-torque:.6g} {torque:.6g}"/>\n    </default>\n'
        '  </default>\n</mujoco>\n'
    )


def _mjlab(drive: LibraryDrive, torque: float) -> str:
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
        f'    effort_limit={torque:.6g},\n{fields})\n'
        f'TORQUE_OVER_SPEED = (  # N·m that were seen up to rad/s\n{seen})\n\n\n'
        + power_function(drive)
    )
