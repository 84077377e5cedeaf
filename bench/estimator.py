"""Cost of the Power Prediction Network: training, live estimate, replay.

Signals and weights are random numbers; the cost does not depend on them.

    python bench/estimator.py [--seconds 20] [--epochs N]
    python bench/estimator.py --long BAG… --model ppn:RUN   (carried state over all of the bags)
"""

import argparse
import os
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import rclpy
import torch
from power_estimator.drive_types import DriveType
from power_estimator.evaluation.cost import policy_step_cost
from power_estimator.live.estimator import LiveEstimator
from power_estimator.loader import load_model
from power_estimator.network.checkpoint import Checkpoint, Network, NetworkConfig
from power_estimator.network.features import Scaling
from power_estimator.network.lstm import LstmBank, Weights
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.training.trainer import Tracks, Trainer
from power_estimator.training.trainer_config import TrainerConfig
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.processes import ChildProcess

from drive_power_msgs.msg import PowerEstimate
from power_estimator import recordings

JOINTS = list(JOINT_NAMES)
HIDDEN = 100
START = 1_700_000_000_000_000_000


def network(hidden: int = HIDDEN) -> Checkpoint:
    """Return random networks for the three drive types of a leg; hidden: units of the LSTM."""
    random = np.random.default_rng(0)

    def weights() -> Weights:
        shapes = ((4 * hidden, 3), (4 * hidden, hidden), (4 * hidden,), (hidden,), (1,))
        return Weights(*(random.normal(0, 0.1, s).astype(np.float32) for s in shapes))

    scaling = Scaling((0.0, 0.0, 0.0), (0.1, 15.0, 3.0), 40.0, 50.0)
    types = [DriveType(name, (f'*_{name}',)) for name in ('HAA', 'HFE', 'KFE')]
    bounds = ((-9.0, -900.0, -90.0), (9.0, 900.0, 90.0))
    return Checkpoint(
        NetworkConfig(hidden=hidden), tuple(Network(t, scaling, *bounds, weights()) for t in types)
    )


def row(label: str, reached: str, target: str, ratio: float | None = None) -> None:
    """Print a row of the table; ratio > 1 is better than the target."""
    print(f'{label:<46}{reached:>18}{target:>14}{"" if ratio is None else f"{ratio:>8.1f}"}')


def bench_training(epochs: int) -> None:
    """Time the training of one fold of 30 min of one drive type, on one thread."""
    torch.set_num_threads(1)
    random = np.random.default_rng(1)
    samples = 30 * 60 * 200

    def tracks(count: int, pieces: int) -> Tracks:
        edges = np.linspace(0, count, pieces + 1).astype(np.intp)
        x = random.normal(size=(2, count, 3)).astype(np.float32)
        return Tracks(x, random.normal(size=count).astype(np.float32), edges)

    trainer = Trainer(
        tracks(samples * 8 // 10, 12),
        tracks(samples // 10, 6),
        hidden=HIDDEN,
        warm_up=15,
        block=4,
        config=TrainerConfig(epochs=epochs, patience=epochs),
    )
    wall, cpu = time.perf_counter(), time.process_time()
    while not trainer.done:
        trainer.epoch()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    label = f'training, 30 min of a drive type, {epochs} epochs'
    row(f'{label}, wall', f'{wall:.0f} s', '< 180 s', 180 / wall)
    row('  CPU time, on one core', f'{cpu:.0f} s', '')
    row('  samples seen per CPU second', f'{0.8 * samples * epochs / cpu / 1e3:.0f} k', '')


def bench_arithmetic(checkpoint: Checkpoint) -> None:
    """Time one step for twelve drives, and an estimate by each of the two forms."""
    bank = PowerPredictionNetwork(checkpoint).stream(JOINTS)
    x = np.random.default_rng(2).normal(size=(12, 3)).astype(np.float32)
    costs = []
    for _ in range(3000):
        started = time.perf_counter()
        bank.step(x)
        costs.append(time.perf_counter() - started)
    step = 1e6 * float(np.median(costs))
    row('one step of 12 drives', f'{step:.0f} µs', '')
    first = checkpoint.networks[0]
    windows = LstmBank({'a': (first.weights, first.scaling)}, {'a': range(12)}, 12)
    window = np.random.default_rng(3).normal(size=(60, 12, 3)).astype(np.float32)
    started = time.perf_counter()
    for _ in range(50):
        windows.run(window)
    windowed = (time.perf_counter() - started) / 50
    row('an estimate, windowed (60 steps)', f'{1e3 * windowed:.2f} ms', '')
    row('an estimate, carried state (4 steps)', f'{4e-3 * step:.2f} ms', '')


def bench_batch() -> None:
    """Time a policy step of 20 ms (four samples) of many robots with twelve drives each."""
    torch.set_num_threads(1)
    for hidden, sizes in ((32, (64, 512, 4096)), (HIDDEN, (64, 512))):
        model = PowerPredictionNetwork(network(hidden))
        for robots in sizes:
            cost = policy_step_cost(model, JOINTS, robots)
            row(f'policy step of a robot, LSTM{hidden}, {robots} at once', f'{cost:.1f} µs', '')


def bench_long(spec: str, bags: list[Path]) -> None:
    """Compare the state carried through all bags with 64-bit arithmetic and with a restart."""
    model = load_model(spec)
    assert isinstance(model, PowerPredictionNetwork)
    given = recordings.training_set(bags)
    x = np.nan_to_num(given.live)
    names = given.data.names
    long = model.stream(names).run(x)
    row('carried state', f'{len(x) / 12_000:.1f} min', '')
    late = x[-6000:]
    apart = np.abs(long[-6000:] - model.stream(names).run(late))
    for seconds in (0.3, 1.0, 5.0):
        label = f'  off from a state begun anew, {seconds:g} s later'
        row(label, f'{np.nanmax(apart[round(200 * seconds) :]):.6f} W', '')
    double = model.stream(names)
    for name in ('_input', '_recurrent', '_bias', '_output', '_offset', '_h', '_c'):
        setattr(double, name, getattr(double, name).astype(np.float64))
    apart = np.abs(long - double.run(x.astype(np.float64)))
    row('  off from 64 bit, first minute', f'{np.nanmax(apart[:12_000]):.6f} W', '')
    row('  off from 64 bit, last minute', f'{np.nanmax(apart[-12_000:]):.6f} W', '')


def bench_stream(checkpoint: Checkpoint) -> None:
    """Time the work of `replay` without the bag: 60 s of joint states at 400 Hz."""
    live = LiveEstimator(PowerPredictionNetwork(checkpoint), JOINTS)
    signals = np.random.default_rng(4).normal(size=(24_000, 4, 12))
    costs = []
    cpu = time.process_time()
    for index, (position, velocity, torque, command) in enumerate(signals):
        stamp = START + index * 2_500_000
        started = time.perf_counter()
        if index % 4 == 0:
            live.command(stamp, command)
        if live.joint_state(stamp, position, velocity, torque) is not None:
            costs.append(time.perf_counter() - started)
    ratio = 60 / (time.process_time() - cpu)
    row('replay, 12 drives', f'{ratio:.0f} x real time', '> 50 x', ratio / 50)
    row('estimate within the process, p99', f'{1e3 * np.percentile(costs, 99):.2f} ms', '')


def bench_node(checkpoint: Checkpoint, seconds: float) -> None:
    """Time the node in a separate process, from a joint state sent to its estimate received."""
    os.environ.setdefault('ROS_DOMAIN_ID', '93')
    with tempfile.TemporaryDirectory() as folder:
        checkpoint.save(Path(folder) / 'model.safetensors')
        code = 'from power_estimator.commands.arguments import estimate; exit(estimate())'
        command = [sys.executable, '-c', code, '--ros-args', '-p', f'model:=ppn:{folder}']
        node = ChildProcess(command, Path(folder) / 'node.log')
        rclpy.init()
        robot = rclpy.create_node('bench')
        qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        states = robot.create_publisher(JointState, 'joint_states', qos)
        commands = robot.create_publisher(JointState, 'joint_commands', qos)
        ages: list[float] = []

        def heard(message: PowerEstimate) -> None:
            now = time.time_ns()
            stamp = message.header.stamp
            if message.status != PowerEstimate.INPUT_STALE:
                ages.append((now - stamp.sec * 1_000_000_000 - stamp.nanosec) / 1e6)

        robot.create_subscription(PowerEstimate, 'power_estimate', heard, qos)

        def spin() -> None:
            with suppress(ExternalShutdownException):
                rclpy.spin(robot)

        thread = threading.Thread(target=spin, daemon=True)
        thread.start()
        signals = np.random.default_rng(5).normal(size=(400, 4, 12)).tolist()
        begin = time.monotonic()
        index, measuring, used = 0, None, 0.0
        while measuring is None or time.monotonic() - measuring < seconds:
            due = begin + index * 0.0025
            time.sleep(max(0.0, due - time.monotonic()))
            position, velocity, torque, target = signals[index % 400]
            state = JointState(name=JOINTS, position=position, velocity=velocity, effort=torque)
            command = JointState(name=JOINTS, position=target)
            for message in (command, state):
                now = time.time_ns()
                message.header.stamp.sec = now // 1_000_000_000
                message.header.stamp.nanosec = now % 1_000_000_000
            if index % 4 == 0:
                commands.publish(command)
            states.publish(state)
            index += 1
            if measuring is None and len(ages) > 50:
                measuring, used = time.monotonic(), node.cpu_seconds()
                ages.clear()
            if measuring is None and time.monotonic() - begin > 60:
                node.end(10.0)
                raise SystemExit(f'the node gave no estimate:\n{node.output}')
        share = (node.cpu_seconds() - used) / (time.monotonic() - measuring)
        found = list(ages)
        node.end(10.0)
        robot.destroy_node()
        rclpy.try_shutdown()
        thread.join(5)
    p50, p99, worst = np.percentile(found, [50, 99, 100])
    row('live node: last joint state sent to estimate heard', '', '')
    row('  median', f'{p50:.2f} ms', '')
    row('  p99', f'{p99:.2f} ms', '< 5 ms', 5 / p99)
    row('  longest', f'{worst:.2f} ms', '')
    row(f'  estimates heard of {seconds * 50:.0f}', f'{len(found)}', f'{seconds * 50:.0f}', None)
    row('  share of a core', f'{100 * share:.1f} %', '< 15 %', 15 / (100 * share))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='of the live node')
    parser.add_argument('--epochs', type=int, default=20, help='of training')
    parser.add_argument(
        '--long', nargs='+', type=Path, metavar='BAG', help='carry a state through'
    )
    parser.add_argument('--model', default='ppn:bags/ppn_small', help='for --long')
    options = parser.parse_args()
    if options.long:
        bench_long(options.model, options.long)
        return
    checkpoint = network()
    print(f'{"":<46}{"reached":>18}{"target":>14}{"ratio":>8}')
    bench_arithmetic(checkpoint)
    bench_batch()
    bench_stream(checkpoint)
    bench_node(checkpoint, options.seconds)
    bench_training(options.epochs)


if __name__ == '__main__':
    main()
