"""Positions of signals in the payload of CAN frames, and fast access to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cantools.database.can.signal import Signal
from numpy.typing import ArrayLike, NDArray
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

_EXACT_BITS = 53
_FLOATS = {32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


def frame_length(size: int) -> int:
    """Return the least length of a CAN FD payload that has room for so many bytes, 0 … 64."""
    return next(length for length in _FD_LENGTHS if length >= size)


class LayoutError(InputError):
    """A signal of a form that cannot be read."""


def bit_positions(signal: Signal) -> list[int]:
    """Return the bits of a signal in the payload, least significant first.

    Bit b of byte n is number 8·n + b; cantools' start is the least significant bit of a
    little-endian signal and the most significant one of a big-endian signal.
    """
    if signal.byte_order == 'little_endian':
        return list(range(signal.start, signal.start + signal.length))
    bits = [signal.start]
    for _ in range(signal.length - 1):
        bits.append(bits[-1] + 15 if bits[-1] % 8 == 0 else bits[-1] - 1)
    return bits[::-1]


@dataclass(frozen=True)
class Field:
    """An unsigned integer inside a payload, for counters, clocks and selectors."""

    first: int
    last: int
    big_endian: bool
    shift: int
    bits: int

    @classmethod
    def of(cls, signal: Signal) -> 'Field':
        """Return the field of a signal; LayoutError unless it is an unsigned integer."""
        if signal.is_float or signal.is_signed:
            raise LayoutError(f'signal {signal.name!r} is not an unsigned integer')
        positions = bit_positions(signal)
        ends = positions[0] // 8, positions[-1] // 8
        big = signal.byte_order == 'big_endian'
        return cls(min(ends), max(ends) + 1, big, positions[0] % 8, signal.length)

    def read(self, payload: bytes | bytearray) -> int:
        """Return the raw value, 0 … 2**bits − 1."""
        octets = payload[self.first : self.last]
        raw = int.from_bytes(octets, 'big' if self.big_endian else 'little')
        return raw >> self.shift & (1 << self.bits) - 1


class SignalLayout:
    """Decoder and encoder of S linear signals of one payload, of one or several frames.

    Each signal is read by gathering the eight bytes that start at its least significant one, so
    that decoding takes a few numpy calls for any number of signals.

    placed: signals, each with the first byte of its frame; size: bytes of the payload; factors:
    from each signal's unit to SI (S values, default 1).
    Raises LayoutError for a signal that is too long, does not fit or has a scale of 0, or a float
    that does not start on a byte.
    """

    def __init__(
        self,
        placed: Sequence[tuple[Signal, int]],
        size: int,
        factors: Sequence[float] | float = 1.0,
    ) -> None:
        self.size = size
        signals = [signal for signal, _ in placed]
        positions = [[8 * base + bit for bit in bit_positions(signal)] for signal, base in placed]
        for signal, bits in zip(signals, positions, strict=True):
            _check(signal, bits, size)
        si = np.asarray(factors, float)
        self._scale = np.array([float(s.scale) for s in signals]) * si
        self._offset = np.array([float(s.offset) for s in signals]) * si
        self._floats = tuple(
            (np.flatnonzero([s.is_float and s.length == bits for s in signals]), unsigned, real)
            for bits, (unsigned, real) in _FLOATS.items()
            if any(s.is_float and s.length == bits for s in signals)
        )
        length = np.array([s.length for s in signals], np.uint64)
        signed = np.array([bool(s.is_signed) for s in signals])
        self._shift = np.array([bits[0] % 8 for bits in positions], np.uint64)
        self._mask = ~np.uint64(0) >> (np.uint64(64) - length)
        self._sign = np.where(signed, np.uint64(1) << (length - np.uint64(1)), np.uint64(0))
        half = 2.0 ** (length.astype(float) - 1)
        self._minimum = np.where(signed, -half, 0.0)
        self._maximum = np.where(signed, half, 2 * half) - 1
        first = np.array([bits[0] // 8 for bits in positions], np.intp)
        step = np.array([1 if s.byte_order == 'little_endian' else -1 for s in signals], np.intp)
        places = first[:, None] + step[:, None] * np.arange(8)
        self._gather = np.where((places >= 0) & (places < size), places, size)
        self._target = np.array([bit for bits in positions for bit in bits], np.intp)
        self._source = np.array(
            [64 * row + bit for row, bits in enumerate(positions) for bit in range(len(bits))],
            np.intp,
        )

    def decode(self, payload: bytes) -> Floats:
        """Return the values [S] in SI units of a payload of `size` bytes."""
        octets = np.frombuffer(payload + b'\0', np.uint8)
        raw: NDArray[np.uint64] = octets.take(self._gather).view(np.uint64)[:, 0]
        raw = raw >> self._shift & self._mask
        numbers = ((raw ^ self._sign) - self._sign).view(np.int64).astype(np.float64)
        for index, unsigned, real in self._floats:
            numbers[index] = raw[index].astype(unsigned).view(real)
        return numbers * self._scale + self._offset

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Least and greatest value [S] of the signals; infinite for floats."""
        ends = np.stack([self._minimum, self._maximum]) * self._scale + self._offset
        least, greatest = ends.min(axis=0), ends.max(axis=0)
        for index, _, _ in self._floats:
            least[index], greatest[index] = -np.inf, np.inf
        return least, greatest

    def _numbers(self, values: ArrayLike) -> Floats:
        numbers = (np.asarray(values, float) - self._offset) / self._scale
        wire = np.minimum(np.maximum(np.rint(numbers), self._minimum), self._maximum)
        wire[np.isnan(wire)] = 0
        for index, _, real in self._floats:
            wire[..., index] = numbers[..., index].astype(real)
        return wire

    def quantise(self, values: ArrayLike) -> Floats:
        """Return values [..., S] as after encode and decode; NaN in an integer is raw 0."""
        return self._numbers(values) * self._scale + self._offset

    def encode(self, values: ArrayLike) -> bytes:
        """Return the payload of `size` bytes for values [S], clipped to the signals' ranges."""
        numbers = self._numbers(values)
        raw = numbers.astype(np.int64) if not self._floats else self._mixed(numbers)
        bits = np.unpackbits(raw.view(np.uint8), bitorder='little')
        payload = np.zeros(8 * self.size, np.uint8)
        payload[self._target] = bits[self._source]
        return np.packbits(payload, bitorder='little').tobytes()

    def _mixed(self, numbers: Floats) -> NDArray[np.int64]:
        """Return the raw values where some signals are floats, which may be NaN or too large."""
        with np.errstate(invalid='ignore'):
            raw = numbers.astype(np.int64)
        for index, unsigned, real in self._floats:
            raw[index] = numbers[index].astype(real).view(unsigned).astype(np.int64)
        return raw


def _check(signal: Signal, bits: list[int], size: int) -> None:
    if signal.is_float and (signal.length not in _FLOATS or bits[0] % 8):
        raise LayoutError(
            f'signal {signal.name!r} is a float of {signal.length} bits at bit {bits[0]}; '
            'only 32 and 64 bits that start on a byte can be read'
        )
    if not signal.is_float and signal.length > _EXACT_BITS:
        raise LayoutError(
            f'signal {signal.name!r} has {signal.length} bits; at most {_EXACT_BITS} can be read'
        )
    if not signal.scale:
        raise LayoutError(f'signal {signal.name!r} has a scale of 0')
    if min(bits) < 0 or max(bits) >= 8 * size:
        raise LayoutError(f'signal {signal.name!r} does not fit into its frame')
