"""Switching a supply's output on: only on request, within limits, and each step read back."""

from dataclasses import dataclass

from power_daq.cli import InputError
from power_daq.supply.answers import AnswerError, quantity, switch
from power_daq.supply.instrument import Instrument

LARGEST_VOLTAGE = 60.0
LARGEST_CURRENT = 120.0
_READ_BACK = 0.002


@dataclass(frozen=True)
class OutputRequest:
    """
    An output to be switched on, with its voltage (V) and the current it may give (A).

    InputError for one that is not wholly given or beyond 60 V (touch-safe DC) and 120 A.
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
        """
        Set voltage and current, read them back, switch on; a sentence that says what is on.

        The output stays off with InputError where the supply refuses or reads back otherwise.
        """
        for value, rated, unit in (
            (self.voltage, instrument.rated_voltage, 'V'),
            (self.current, instrument.rated_current, 'A'),
        ):
            if value > rated:
                raise InputError(
                    f'{value:g} {unit} is more than the {rated:g} {unit} that '
                    f'{instrument.identity.model} is made for'
                )
        instrument.errors()
        instrument.tell('SYST:LOCK ON')
        owner = instrument.ask('SYST:LOCK:OWN?').strip().upper()
        if owner != 'REMOTE':
            raise InputError(f'the supply is controlled by {owner}: release it at its panel')
        try:
            self._set(instrument)
        finally:
            instrument.tell('SYST:LOCK OFF')
        model = instrument.identity.model
        return f'output of {model} switched on: {self.voltage:g} V, at most {self.current:g} A'

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
        instrument.tell('OUTP ON')
        _check(instrument, 'OUTP ON')
        answer = instrument.ask('OUTP?')
        if not switch(answer):
            raise AnswerError(answer, 'ON')


def _check(instrument: Instrument, command: str) -> None:
    errors = instrument.errors()
    if errors:
        raise InputError(f'the supply refuses {command}: {", ".join(map(str, errors))}')
