"""Settings of a sound level measurement, without heavy imports."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from wattwalk_core.errors import InputError
from wattwalk_core.schema import Quantity

WEIGHTINGS: Final = ('A', 'C', 'Z')
TIMES: Final = {'fast': 0.125, 'slow': 1.0}  # time constants of IEC 61672-1, s
METHODS: Final = ('auto', 'clap', 'step', 'gait', 'none')
_LIMITS: Final = {
    'level': ('--level', Quantity(40.0, 160.0, 'dB')),
    'tone': ('--tone', Quantity(60.0, 4000.0, 'Hz')),
    'clap_at': ('--clap-at', Quantity(0.0, 86_400.0, 's')),
    'start': ('--from', Quantity(0.0, 86_400.0, 's')),
    'stop': ('--to', Quantity(0.0, 86_400.0, 's')),
}


@dataclass(frozen=True)
class Settings:
    """Weighting A, C or Z, time weighting fast or slow, channel from 1 (None: all).

    align: a method of `alignment`; clap_at: s after a recording's start. start, stop: part of each
    file that is evaluated, s, None for its ends. level, tone: of the calibrator, dB SPL and Hz.
    """

    weighting: str = 'A'
    time: str = 'fast'
    channel: int | None = None
    align: str = 'auto'
    clap_at: float | None = None
    start: float | None = None
    stop: float | None = None
    level: float = 94.0
    tone: float = 1000.0

    def __post_init__(self) -> None:
        for name, (option, limits) in _LIMITS.items():
            value = getattr(self, name)
            try:
                value is None or limits.check(value)
            except ValueError as error:
                raise InputError(f'{option}: {error}') from None


@dataclass(frozen=True)
class Entry:
    """A sound file to analyse, of a policy (empty: the recording's card, or the file's name)."""

    path: Path
    policy: str = ''
    recording: Path | None = None
