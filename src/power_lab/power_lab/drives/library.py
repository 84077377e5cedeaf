"""The library of identified real drives.

Each is a folder of `identified/`: `model.yaml` (effects with intervals), `drive.yaml` (what was
recorded, by whom, what it does not determine) and `drive.png`. The logs are not in it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from power_estimator.effects import builtin_catalogue
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.effects.model_file.yaml_file import read_model
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
    torque_over_speed: Annotated[tuple[tuple[_Positive, _Positive], ...], Length(1)]
    does_not_determine: Annotated[tuple[str, ...], Length(1)]
    findings: tuple[str, ...] = ()
    gear_ratio: _Positive = 1.0
    frictionloss: _Positive | None = None  # N·m
    damping: _Positive | None = None  # N·m·s/rad
    format: Literal['drive/1'] = 'drive/1'


@dataclass(frozen=True)
class LibraryDrive:
    """An identified drive."""

    name: str
    card: DriveCard
    model: EffectModel

    @property
    def picture(self) -> Path:
        """Measured against model, and the efficiency map with the measured points."""
        return FOLDER / self.name / 'drive.png'


def names() -> tuple[str, ...]:
    """Names of the drives, in order."""
    return tuple(sorted(card.parent.name for card in FOLDER.glob('*/drive.yaml')))


def load_drive(name: str) -> LibraryDrive:
    """Read a drive by name, with or without `drive:`; InputError for one that is not there."""
    name = name.removeprefix(PREFIX)
    if name not in names():
        raise InputError(f'no drive {quoted(name)} in the library; there are {", ".join(names())}')
    card = read(DriveCard, FOLDER / name / 'drive.yaml', 'drive')
    return LibraryDrive(name, card, read_model(FOLDER / name / 'model.yaml', builtin_catalogue()))
