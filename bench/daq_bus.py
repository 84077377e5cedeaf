"""
Cost of a frame from the drives to a stamped sample, and accuracy of the stamps.

    python bench/daq_bus.py [--seconds 60]
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import can
import cantools
import numpy as np
from numpy.typing import NDArray
from power_daq.acquisition.receiver import Receiver
from power_daq.bus.description import DEFAULT_DBC, BusDescription
from power_daq.bus.unix_socket import UnixSocketBus
from power_daq.clock.mapping import ClockMapping, RosTime
from rich.console import Console
from rich.table import Table

REPEATS, BATCH = 4000, 40
STAMP_TARGET_US = 200.0


def microseconds(
    body: Callable[[], object], per_call: int = 1, tidy: Callable[[], object] = lambda: None
) -> float:
    """CPU time of a call, or of each of the things that it does, in µs; tidy is not counted."""
    spent = 0.0
    for _ in range(REPEATS // BATCH):
        begin = time.process_time()
        for _ in range(BATCH):
            body()
        spent += time.process_time() - begin
        tidy()
    return 1e6 * spent / REPEATS / per_call


def frame_costs(bus: BusDescription) -> list[tuple[str, float]]:
    """Rows of (what, µs)."""
    wave = np.sin(np.arange(12.0))
    supply = bus.encode_electrical(1, 1000, 48 + wave, wave)
    joints = bus.encode_joints(1, 1000, wave, wave, wave)
    millisecond = bus.encode_sync(1, 1000) + supply + joints[:2]
    database = cantools.database.load_file(DEFAULT_DBC)
    payload = bytes(supply[0].data)
    groups = bus.groups
    rows = [
        (
            'encode the electrical frame',
            microseconds(lambda: bus.encode_electrical(1, 1, wave, wave)),
        ),
        (
            'encode four joint frames',
            microseconds(lambda: bus.encode_joints(1, 1, wave, wave, wave)),
        ),
        (
            'decode the electrical frame',
            microseconds(lambda: groups['electrical'].decode([payload])),
        ),
        ('the same by cantools', microseconds(lambda: database.decode_message(256, payload))),
        (
            'decode four joint frames',
            microseconds(lambda: groups['joints'].decode([bytes(m.data) for m in joints])),
        ),
    ]
    with (
        tempfile.TemporaryDirectory(prefix='wattwalk') as folder,
        UnixSocketBus(str(Path(folder) / 'bus'), host=True) as host,
        UnixSocketBus(str(Path(folder) / 'bus')) as client,
    ):
        frames = len(millisecond)

        def drain() -> None:
            while client.recv(0) is not None:
                pass

        def one_by_one() -> None:
            for message in millisecond:
                host.send(message)

        def there_and_back() -> None:
            host.send_all(millisecond)
            for _ in range(frames):
                client.recv(1.0)

        time.sleep(0.01)
        one, together = f'send, one by one ({frames} a ms)', 'send together'
        rows += [
            (one, microseconds(one_by_one, frames, drain)),
            (together, microseconds(lambda: host.send_all(millisecond), frames, drain)),
            ('send together and receive', microseconds(there_and_back, frames)),
        ]
    return [*rows, ('frame to stamped sample', receiver_cost(bus))]


def receiver_cost(bus: BusDescription, milliseconds: int = 3000) -> float:
    """CPU time in µs per frame of the receiver: clocks, assembly, decoding, stamps."""
    wave = np.sin(np.arange(12.0))
    arrivals: list[tuple[can.Message, int]] = []
    for k in range(milliseconds):
        messages = bus.encode_sync(k, 1000 * k) + bus.encode_electrical(k, 1000 * k, wave, wave)
        if k % 5 in (0, 3):
            index = 2 * k // 5
            messages += bus.encode_joints(index, 2500 * index, wave, wave, wave)
        arrivals += [(message, 1_000_000 * k + 50_000) for message in messages]
    receiver = Receiver(bus, RosTime())
    begin = time.process_time()
    for message, arrival in arrivals:
        receiver.take(message, arrival)
    return 1e6 * (time.process_time() - begin) / len(arrivals)


def stamp_errors(
    seconds: float, drift: float, mean_delay: float, bursts: float, seed: int
) -> NDArray[np.float64]:
    """
    Errors of the stamps in µs, for frames each ms that arrive late by a random delay.

    Delays are 50 µs at least, exponential beyond, and all frames wait out bursts of 5 to 20 ms.
    The 50 µs are part of the error: no receiver can see them.
    """
    rng = np.random.default_rng(seed)
    truth = np.arange(0.0, seconds, 1e-3)
    arrival = truth + 50e-6 + rng.exponential(mean_delay, len(truth))
    for at in rng.uniform(0, seconds, rng.poisson(bursts * seconds)):
        end = at + rng.uniform(5e-3, 20e-3)
        arrival[(arrival > at) & (arrival < end)] = end
    arrival = np.maximum.accumulate(arrival)
    raw = np.round((4290.0 + (1 + drift) * truth) * 1e6).astype(np.int64) % 2**32
    mapping = ClockMapping(1000.0, 32)
    errors = []
    times = np.round(1e9 * arrival).astype(np.int64)
    for ticks, time_ns, at in zip(raw.tolist(), times.tolist(), truth.tolist(), strict=True):
        device = mapping.update(ticks, time_ns)
        if mapping.settled:
            errors.append(1e-3 * mapping.to_steady(device) - 1e6 * at)
    return np.array(errors)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0, help='simulated, per row of stamps')
    options = parser.parse_args()
    console = Console()
    table = Table('per frame', 'µs of CPU', title='CAN FD frames of 12 drives')
    for name, cost in frame_costs(BusDescription.load()):
        table.add_row(name, f'{cost:.1f}')
    console.print(table)
    table = Table(
        *('mean delay ms', 'bursts /s', 'drift ppm', 'p50 µs', 'p99 µs', 'max µs'),
        f'p99 / {STAMP_TARGET_US:.0f} µs',
        title='Error of the stamps, the least delay of 50 µs included',
    )
    for mean_delay, bursts in ((0.1e-3, 0.0), (0.5e-3, 0.5), (1e-3, 2.0)):
        for drift in (-100e-6, 0.0, 100e-6):
            errors = np.abs(stamp_errors(options.seconds, drift, mean_delay, bursts, seed=1))
            middle, high = np.percentile(errors, [50, 99])
            table.add_row(
                *(f'{1e3 * mean_delay:.1f}', f'{bursts:.1f}', f'{1e6 * drift:.0f}'),
                *(f'{middle:.0f}', f'{high:.0f}', f'{errors.max():.0f}'),
                f'{high / STAMP_TARGET_US:.2f}',
            )
    console.print(table)


if __name__ == '__main__':
    main()
