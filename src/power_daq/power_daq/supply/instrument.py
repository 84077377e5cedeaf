"""The connection to a bench supply: SCPI over a TCP socket, by pyvisa."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import inf
from typing import Any

import pyvisa
from pyvisa.constants import BufferOperation
from pyvisa.errors import VisaIOError
from pyvisa.resources import MessageBasedResource
from wattwalk_core.errors import InputError

from power_daq.supply.answers import (
    AnswerError,
    InstrumentIdentity,
    ScpiError,
    SupplyMeasurement,
    identity,
    measured,
    quantity,
    scpi_error,
    switch,
)

_MS = 1000
_HEADROOM = 1.1
_MOST_ERRORS = 16
_MOST_LINES = 16
_LOST = (VisaIOError, OSError)


class LostError(Exception):
    """No answer within the time limit, or no connection."""


@dataclass(frozen=True)
class InstrumentSettings:
    """Address of the supply and form of the queries.

    timeout: s until an answer counts as missing; separate: query voltage and current one after
    the other, for supplies without `MEAS:ARR?`.
    """

    host: str
    port: int = 5025
    timeout: float = 0.5
    separate: bool = False

    def __post_init__(self) -> None:
        if not self.host or '::' in self.host or any(c.isspace() for c in self.host):
            raise InputError(
                f'host is {self.host!r}; give the name or IPv4 address of the supply, such as '
                '-p host:=192.168.0.42'
            )

    @property
    def resource(self) -> str:
        """VISA name of the instrument."""
        return f'TCPIP::{self.host}::{self.port}::SOCKET'


class Instrument:
    """Connected supply.

    Only `tell` changes its state, and only `OutputRequest.switch_on` uses it for that. Methods
    raise LostError if the connection can no longer be used, AnswerError for an answer that does
    not fit.
    """

    def __init__(self, settings: InstrumentSettings) -> None:
        """Connect and query identity and ratings."""
        self.settings = settings
        self._manager = pyvisa.ResourceManager('@py')
        try:
            self._resource = self._connect()
            self.identity: InstrumentIdentity = identity(self.ask('*IDN?'))
            self.rated_voltage = self._rating('SYST:NOM:VOLT?', 'V')
            self.rated_current = self._rating('SYST:NOM:CURR?', 'A')
            self.errors()
        except BaseException:
            self.close()
            raise

    def _connect(self) -> MessageBasedResource:
        settings = self.settings
        options: dict[str, Any] = {
            'open_timeout': round(_MS * max(settings.timeout, 1.0)),
            'timeout': round(_MS * settings.timeout),
            'read_termination': '\n',
            'write_termination': '\n',
        }
        try:
            resource = self._manager.open_resource(settings.resource, **options)
        except Exception as error:  # pyvisa-py raises a bare Exception where nobody answers
            raise LostError(f'{settings.host}:{settings.port} does not answer') from error
        if not isinstance(resource, MessageBasedResource):
            raise LostError(f'{settings.resource} is no socket')
        return resource

    def close(self) -> None:
        """Close the connection; the instrument stays as it is."""
        with suppress(*_LOST):
            self._manager.close()

    def tell(self, command: str) -> None:
        """Send a command that has no answer; LostError if the connection is lost."""
        try:
            self._resource.flush(BufferOperation.discard_read_buffer_no_io)
            self._resource.write(command)
        except _LOST as error:
            raise LostError(f'connection lost at {command}: {_reason(error)}') from error

    def ask(self, question: str) -> str:
        """Send a question and return the line that answers it; LostError without an answer."""
        self.tell(question)
        return self._line(question)

    def _line(self, question: str) -> str:
        try:
            return str(self._resource.read(encoding='ascii')).rstrip('\r')
        except UnicodeDecodeError as error:
            raise AnswerError(repr(error.object), 'ASCII') from error
        except _LOST as error:
            raise LostError(f'no answer to {question}: {_reason(error)}') from error

    def measure(self) -> SupplyMeasurement:
        """Measure voltage, current and power; AnswerError also for values beyond the ratings."""
        if self.settings.separate:
            voltage = quantity(self.ask('MEAS:VOLT?'), 'V')
            found = SupplyMeasurement(voltage, quantity(self.ask('MEAS:CURR?'), 'A'), None)
        else:
            found = measured(self.ask('MEAS:ARR?'))
        for value, rated, unit in (
            (found.voltage, self.rated_voltage, 'V'),
            (found.current, self.rated_current, 'A'),
        ):
            if abs(value) > _HEADROOM * rated:
                raise AnswerError(f'{value:g} {unit}', f'at most {_HEADROOM:g} · {rated:g} {unit}')
        return found

    def errors(self) -> list[ScpiError]:
        """Empty the error queue and return its entries, oldest first."""
        found: list[ScpiError] = []
        while len(found) < _MOST_ERRORS:
            error = scpi_error(self.ask('SYST:ERR?'))
            if not error.code:
                break
            found.append(error)
        return found

    def resynchronise(self) -> None:
        """Discard lines until the identity arrives, so that answers belong to questions again.

        LostError if it does not arrive.
        """
        self.tell('*IDN?')
        for _ in range(_MOST_LINES):
            with suppress(AnswerError):
                if identity(self._line('*IDN?')) == self.identity:
                    return
        raise LostError(f'{_MOST_LINES} lines came and none was the answer to *IDN?')

    def _rating(self, question: str, unit: str) -> float:
        """Return a rated value; infinite for a supply that does not give it."""
        try:
            return quantity(self.ask(question), unit)
        except AnswerError:
            return inf
        except LostError:
            self.resynchronise()
            return inf


def _reason(error: Exception) -> str:
    if isinstance(error, VisaIOError):
        return error.description.rstrip('.').lower()
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


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
        for value, rated, unit in (
            (self.voltage, instrument.rated_voltage, 'V'),
            (self.current, instrument.rated_current, 'A'),
        ):
            if value > rated:
                raise InputError(
                    f'{value:g} {unit} is more than the {rated:g} {unit} that '
                    f'{instrument.identity.model} is made for'
                )
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
    if errors := instrument.errors():
        raise InputError(f'the supply refuses {command}: {", ".join(map(str, errors))}')
