"""`ros2 run sim_bridge ethercat_segment`: emulate a coupler and EL3102 terminals."""

import argparse
import time
from collections.abc import Callable

from wattwalk_core.errors import InputError

from sim_bridge.instruments.ethercat.terminals import EK1100, EL3102, EmulatedSegment, Volts


def _constant(volts: Volts) -> Callable[[], Volts]:
    return lambda: volts


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C; 2 for an interface that cannot be used."""
    if len(options.volts) % 2:
        raise InputError(f'--volts has {len(options.volts)} numbers; give two for each terminal')
    pairs = list(zip(options.volts[::2], options.volts[1::2], strict=True))
    try:
        segment = EmulatedSegment(
            options.interface, [EK1100(), *(EL3102(_constant(pair)) for pair in pairs)]
        )
    except OSError as error:
        raise InputError(
            f'cannot use {options.interface}: {error.strerror}; it must exist, and raw sockets '
            'need root'
        ) from error
    print(f'EK1100 and {len(pairs)} EL3102 on {options.interface}; Ctrl-C ends it', flush=True)
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return 0
    finally:
        segment.close()
