"""Tensors in files of others: read within limits, and never run as code.

safetensors and torch are imported by the functions that need them; packages that read tensors
depend on them.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wattwalk_core.arrays import Singles
from wattwalk_core.errors import InputError, printable, quoted
from wattwalk_core.files import read_bytes

SIZE: Final = 128 << 20  # bytes
_HEADER: Final = 1 << 20  # bytes, some ten thousand tensors

Tensors = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class TensorFile:
    """Content of a safetensors file: arrays by name, and its metadata texts."""

    tensors: dict[str, NDArray[Any]]
    texts: dict[str, str]


def read_tensors(path: Path, what: str, limit: int = SIZE) -> TensorFile:
    """Read a safetensors file of at most `limit` bytes; no code in it is run.

    Raises InputError, which calls the file `what`, for any other file.
    """
    from safetensors import SafetensorError  # only files of tensors need it
    from safetensors.numpy import load

    data = read_bytes(path, what, limit)
    where = f'{what} {path}'
    if data[8:9] != b'{' and (data[:2] == b'PK' or data[:1] == b'\x80'):
        raise InputError(
            f'{where}: is a pickle (torch.save); only safetensors is read, it runs no code'
        )
    length = int.from_bytes(data[:8], 'little')
    if length > _HEADER:
        raise InputError(
            f'{where}: is damaged or not safetensors (a header of {length} bytes; at most '
            f'{_HEADER} are read)'
        )
    try:
        tensors = load(data)
        texts = json.loads(data[8 : 8 + length]).get('__metadata__') or {}
    except (SafetensorError, KeyError, TypeError, ValueError, AttributeError) as error:
        reason = printable(str(error), 120)
        raise InputError(f'{where}: is damaged or not safetensors ({reason})') from None
    return TensorFile(dict(tensors), texts)


def checked_tensors(
    tensors: Tensors, shapes: Mapping[str, tuple[int, ...]], where: str
) -> dict[str, Singles]:
    """Return the tensors as float32; shapes: the expected names with their shapes.

    Raises InputError, which begins with `where`, for one that is missing, unknown, of another
    shape, or that holds anything but numbers that are finite in float32.
    """
    checked = {}
    for name, shape in shapes.items():
        if name not in tensors:
            raise InputError(f'{where} lacks {name!r}')
        values = tensors[name]
        if values.shape != shape:
            raise InputError(
                f'{where}: {name} has shape {list(values.shape)}, expected {list(shape)}'
            )
        with np.errstate(over='ignore'):
            checked[name] = np.ascontiguousarray(values, np.float32)
        if values.dtype.kind != 'f' or not np.isfinite(checked[name]).all():
            raise InputError(f'{where}: {name} holds values that are not finite float32 numbers')
    unknown = next((name for name in tensors if name not in shapes), None)
    if unknown is not None:
        raise InputError(f'{where} has {quoted(unknown)}, which is not expected there')
    return checked


def read_state(path: Path, what: str, limit: int = SIZE) -> Any:
    """Read what torch.save wrote, of at most `limit` bytes, also unpacked; no code in it is run.

    Raises InputError, which calls the file `what`, for anything but tensors and plain values.
    """
    import torch  # slow to import; numpy serves without

    data = read_bytes(path, what, limit)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(item.file_size for item in archive.infolist())
        if unpacked > limit:
            raise InputError(f'{what} {path}: unpacks to more than {limit >> 10} KiB')
        return torch.load(io.BytesIO(data), map_location='cpu', weights_only=True)
    except InputError:
        raise
    except Exception as error:  # torch names no narrower class for a damaged file
        reason = printable(str(error), 120)
        raise InputError(f'{what} {path}: is damaged ({reason})') from error
