"""Sound files read in blocks, with warnings about their defects."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import soundfile
from scipy.ndimage import binary_opening
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

SLOWEST, FASTEST = 8_000, 192_000  # Hz
_BLOCK = 1 << 16  # samples
_RUN = 3  # samples at full scale in a row are clipped
_BITS: Final = {'PCM_S8': 8, 'PCM_U8': 8, 'PCM_16': 16, 'PCM_24': 24, 'PCM_32': 32}
_FLOATING: Final = ('FLOAT', 'DOUBLE')


class SoundFile:
    """A wav, flac or other file of libsndfile, read once from front to back.

    channel: from 1; None takes all, whose energies are averaged. `warnings` is complete once
    `blocks` is exhausted, and so are `seconds` and `clipped`. Raises InputError for a file that
    is not there, no sound, of a rate outside 8–192 kHz, or without that channel.
    """

    def __init__(self, path: Path, channel: int | None = None) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.clipped = 0
        self.frames = 0
        if not path.is_file():
            raise InputError(f'there is no sound file {path}')
        try:
            with soundfile.SoundFile(path) as file:
                self.rate = int(file.samplerate)
                self.channels = int(file.channels)
                self.subtype = str(file.subtype)
                self.promised = int(file.frames)
                said = str(file.extra_info)
        except soundfile.LibsndfileError as error:
            raise InputError(
                f'{path} is no sound file that can be read ({error.error_string.rstrip(".")}); '
                'convert it to wav first, such as with ffmpeg'
            ) from None
        if not SLOWEST <= self.rate <= FASTEST:
            raise InputError(
                f'{path} has a rate of {self.rate} Hz; it must lie in {SLOWEST}..{FASTEST} Hz'
            )
        if channel is not None and not 1 <= channel <= self.channels:
            raise InputError(f'{path} has {self.channels} channels; there is no channel {channel}')
        if self.subtype not in _BITS and self.subtype not in _FLOATING:
            self.warnings.append(f'compressed with loss ({self.subtype}): levels are approximate')
        if re.search(r'^\s*data\s*:.*should be', said, re.MULTILINE):
            self.warnings.append('cut off: the file is shorter than its header says')
        self._channel = channel

    @property
    def seconds(self) -> float:
        """Duration read so far, s."""
        return self.frames / self.rate

    def blocks(self) -> Iterator[Floats]:
        """Yield samples [N, channels], full scale 1, and count frames and clipped samples.

        Damage behind the first frames ends it with a warning. InputError for NaN, or a file of
        which nothing can be read.
        """
        bits = _BITS.get(self.subtype)
        top = 1.0 if bits is None else 1.0 - 1.5 / 2.0 ** (bits - 1)
        try:
            with soundfile.SoundFile(self.path) as file:
                while len(block := file.read(_BLOCK, dtype='float64', always_2d=True)):
                    if self._channel is not None:
                        block = block[:, self._channel - 1 : self._channel]
                    self._check(block)
                    self.clipped += _clipped(block, top)
                    self.frames += len(block)
                    yield block
        except soundfile.LibsndfileError as error:
            what = error.error_string.rstrip('.')
            if not self.frames:
                raise InputError(f'{self.path} is damaged: {what}') from None
            self.warnings.append(
                f'damaged after {self.seconds:.1f} s ({what}); the rest is missing'
            )
        else:
            if self.frames < self.promised:
                rest = (self.promised - self.frames) / self.rate
                self.warnings.append(f'damaged: the last {rest:.1f} s cannot be read')
        if self.clipped:
            self.warnings.append(
                f'clipped in {self.clipped} samples: true levels are higher; '
                'record again with less gain'
            )

    def _check(self, block: Floats) -> None:
        bad = ~np.isfinite(block).all(axis=1)
        if bad.any():
            at = (self.frames + int(np.argmax(bad))) / self.rate
            raise InputError(f'{self.path} has values that are no number, the first at {at:.3f} s')


def _clipped(block: Floats, top: float) -> int:
    """Count samples in runs of at least three at full scale; above 1.0 floats are not clipped."""
    full = (np.abs(block) >= top) & (np.abs(block) <= 1.0)
    return int(binary_opening(full, np.ones((_RUN, 1))).sum()) if full.any() else 0
