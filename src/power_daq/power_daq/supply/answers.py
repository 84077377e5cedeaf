"""Strict parsing of a bench supply's answers.

The dialect is that of EA's PSB, PSI and PS series: a number with its unit (`48.02 V`), three of
them for `MEAS:ARR?` (`48.02 V, 3.14 A, 150.8 W`), and errors as `-113,"Undefined header"`
(SCPI-99, volume 2, chapter 21). Current and power of a two-quadrant supply are negative while it
takes power in.
"""

import re
from typing import NamedTuple

_LONGEST_SHOWN = 40
_QUANTITY = re.compile(
    r'\s*(?P<number>[+-]?\d{1,12}(?:\.\d{0,12})?(?:[eE][+-]?\d{1,2})?)'
    r'\s*(?P<prefix>[mk]?)(?P<unit>[VAW])\s*',
    re.ASCII,
)
_SCALE = {'': 1.0, 'm': 1e-3, 'k': 1e3}
_ERROR = re.compile(r'\s*(?P<code>[+-]?\d{1,5})\s*,\s*"?(?P<text>[^"]*)"?\s*', re.ASCII)
_IDENTITY_PARTS = 2


class AnswerError(ValueError):
    """An answer that does not fit the question; the message quotes it."""

    def __init__(self, answer: str, wanted: str) -> None:
        shown = answer if len(answer) <= _LONGEST_SHOWN else answer[:_LONGEST_SHOWN] + '…'
        super().__init__(f'expected {wanted}, the answer is {shown!r}')


class SupplyMeasurement(NamedTuple):
    """Terminal voltage (V), current out of the supply (A) and its power (W), None if not given."""

    voltage: float
    current: float
    power: float | None


class ScpiError(NamedTuple):
    """An entry of the error queue; code 0 means no error."""

    code: int
    text: str

    def __str__(self) -> str:
        return f'{self.code} {self.text}'


class InstrumentIdentity(NamedTuple):
    """Answer to `*IDN?`; parts that an instrument omits are empty."""

    maker: str
    model: str
    serial: str
    firmware: str


def quantity(answer: str, unit: str) -> float:
    """Parse a number in V, A or W; AnswerError for another unit or none."""
    found = _QUANTITY.fullmatch(answer)
    if found is None or found['unit'] != unit:
        raise AnswerError(answer, f'a number in {unit}')
    return float(found['number']) * _SCALE[found['prefix']]


def measured(answer: str) -> SupplyMeasurement:
    """Parse the answer to `MEAS:ARR?`: V, A and W in this order; else AnswerError."""
    parts = answer.split(',')
    if len(parts) != len(SupplyMeasurement._fields):
        raise AnswerError(answer, 'a voltage, a current and a power')
    try:
        return SupplyMeasurement(
            *(quantity(part, unit) for part, unit in zip(parts, 'VAW', strict=True))
        )
    except AnswerError as error:
        raise AnswerError(answer, 'a voltage, a current and a power') from error


def scpi_error(answer: str) -> ScpiError:
    """Parse the answer to `SYST:ERR?`; AnswerError for another one, such as a measurement."""
    found = _ERROR.fullmatch(answer)
    if found is None:
        raise AnswerError(answer, 'a number and a text in quotes')
    return ScpiError(int(found['code']), found['text'].strip())


def identity(answer: str) -> InstrumentIdentity:
    """Parse maker, model, serial number and firmware; AnswerError for less than two of them."""
    parts = [part.strip() for part in answer.split(',')]
    if len(parts) < _IDENTITY_PARTS or not all(parts[:_IDENTITY_PARTS]):
        raise AnswerError(answer, 'maker, model, serial number and firmware')
    parts += [''] * (len(InstrumentIdentity._fields) - len(parts))
    return InstrumentIdentity(parts[0], parts[1], parts[2], ', '.join(parts[3:]))


def switch(answer: str) -> bool:
    """Parse the answer to `OUTP?`: ON or OFF, also 1 or 0; else AnswerError."""
    word = answer.strip().upper()
    if word not in ('ON', 'OFF', '1', '0'):
        raise AnswerError(answer, 'ON or OFF')
    return word in ('ON', '1')


class Reading(NamedTuple):
    """Voltage (V), current (A, positive out of the supply) and power (W, None if not given).

    stamp: ROS time in ns halfway between question and answer; steady: the same instant on the
    steady clock; round_trip: s between them, so the stamp is off by at most half of it.
    """

    stamp: int
    steady: int
    voltage: float
    current: float
    power: float | None
    round_trip: float
