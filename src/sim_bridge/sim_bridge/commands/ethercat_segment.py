"""`ros2 run sim_bridge ethercat_segment`: emulate a coupler and EL3102 terminals."""

import argparse
import time
from collections.abc import Callable, Sequence

from wattwalk_core.command import command, command_parser, own_arguments
from wattwalk_core.errors import InputError

from sim_bridge.instruments.ethercat.terminals import EK1100, EL3102, Volts
from sim_bridge.instruments.ethercat.wire import EmulatedSegment

_EXAMPLE = """
Needs root, for raw sockets. example, on a cable of two virtual ends:
  ip link add ecat0 type veth peer name ecat1
  ip link set ecat0 up; ip link set ecat1 up
  ros2 run sim_bridge ethercat_segment --interface ecat1 --volts 4.8 0.4
  ros2 run power_daq daq --ros-args -p interface:=ethercat -p channel:=ecat0 \\
      -p mapping:=ethercat.yaml
"""


def parse(args: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command from its own arguments."""
    parser = command_parser(
        'sim_bridge ethercat_segment',
        'Emulates an EK1100 and an EL3102 for each two voltages, to try power_daq '
        'without hardware.',
        _EXAMPLE,
    )
    parser.add_argument('--interface', required=True, metavar='NAME', help='such as ecat1')
    parser.add_argument(
        *('--volts', '-v'),
        type=float,
        nargs='+',
        default=[4.8, 0.4],
        metavar='V',
        help='at the inputs, two for each terminal',
    )
    return parser.parse_args(args)


def _constant(volts: Volts) -> Callable[[], Volts]:
    return lambda: volts


@command
def main(args: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C; 2 for an interface that cannot be used."""
    options = parse(own_arguments(args))
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
