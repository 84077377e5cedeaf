"""Switching a supply's output on: on request only, within limits, each step read back."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from wattwalk_core.errors import InputError

from power_daq.supply.answers import AnswerError, quantity, switch
from power_daq.supply.instrument import Instrument, LostError

LARGEST_VOLTAGE = 60.0
LARGEST_CURRENT = 120.0
_READ_BACK = 0.002


@dataclass(frozen=True)
class OutputRequest:
    """An output to be switched on, with its voltage (V) and the current it may give (A).

    InputError for a missing value or one beyond 60 V (touch-safe DC) or 120 A.
    """

    voltage: float
    current: float

    def __post_init__(self) -> None:
        for name, value, most, unit in (
            ('set_voltage', self.voltage, LARGEST_VOLTAGE, 'V'),
            ('set_current', self.current, LARGEST_CURRENT, 'A'),
        ):
            if not 0.0 < value <= most:
                raise InputError(
                    f'{name} is {value:g} {unit}; to switch the output on give more than 0 and '
                    f'at most {most:g} {unit}'
                )

    def switch_on(self, instrument: Instrument) -> str:
        """Set voltage and current, read them back, switch on; return a sentence for the log.

        Only an output that is off is changed. Each failure, lost connections included, is an
        InputError that gives the state of the output; after `OUTP ON` the output is switched off
        again and read back.
        """
        self._check_ratings(instrument)
        with _told('nothing was set or switched'):
            instrument.errors()
            if switch(instrument.ask('OUTP?')):
                raise InputError(
                    f'the output of {instrument.identity.model} is on already: switch it off at '
                    'its panel first, or leave out switch_output_on to read only'
                )
            instrument.tell('SYST:LOCK ON')
            owner = instrument.ask('SYST:LOCK:OWN?').strip().upper()
            if owner != 'REMOTE':
                raise InputError(f'the supply is controlled by {owner}: release it at its panel')
        try:
            with _told('the output was not switched on'):
                self._set(instrument)
            _switch(instrument)
        except InputError:
            with suppress(LostError):
                instrument.tell('SYST:LOCK OFF')
            raise
        with _told('the output is ON, and the panel may still be locked'):
            instrument.tell('SYST:LOCK OFF')
        model = instrument.identity.model
        return f'output of {model} switched on: {self.voltage:g} V, at most {self.current:g} A'

    def _check_ratings(self, instrument: Instrument) -> None:
        for value, rated, unit in (
            (self.voltage, instrument.rated_voltage, 'V'),
            (self.current, instrument.rated_current, 'A'),
        ):
            if value > rated:
                raise InputError(
                    f'{value:g} {unit} is more than the {rated:g} {unit} that '
                    f'{instrument.identity.model} is made for'
                )

    def _set(self, instrument: Instrument) -> None:
        for command, value, unit, rated in (
            ('VOLT', self.voltage, 'V', instrument.rated_voltage),
            ('CURR', self.current, 'A', instrument.rated_current),
        ):
            instrument.tell(f'{command} {value:.3f}')
            _check(instrument, f'{command} {value:.3f}')
            found = quantity(instrument.ask(f'{command}?'), unit)
            if abs(found - value) > _READ_BACK * min(rated, 10 * value):
                raise InputError(f'{command} {value:g} {unit} was set, {found:g} {unit} read back')


@contextmanager
def _told(state: str) -> Iterator[None]:
    """Turn every failure into an InputError that gives the state of the output."""
    try:
        yield
    except (LostError, AnswerError, InputError) as error:
        raise InputError(f'{error}; {state}') from error


def _switch(instrument: Instrument) -> None:
    """Switch on, or off again if that fails."""
    try:
        instrument.tell('OUTP ON')
        _check(instrument, 'OUTP ON')
        if not switch(instrument.ask('OUTP?')):
            raise InputError('the output went off at once after OUTP ON')
    except (LostError, AnswerError, InputError) as error:
        raise InputError(f'{error}; {_switch_off(instrument)}') from error


def _switch_off(instrument: Instrument) -> str:
    """Switch off, read back and return the state of the output in words."""
    try:
        instrument.tell('OUTP OFF')
        instrument.resynchronise()
        if switch(instrument.ask('OUTP?')):
            return 'the output is ON although OUTP OFF was sent: switch it off at its panel'
    except (LostError, AnswerError) as error:
        return f'the output may be ON ({error}): look at its panel'
    return 'the output was switched off and is off'


def _check(instrument: Instrument, command: str) -> None:
    errors = instrument.errors()
    if errors:
        raise InputError(f'the supply refuses {command}: {", ".join(map(str, errors))}')
