"""The loop in about ten minutes, from a robot's energy budget to hidden effects that are found.

Two policies walk, and a budget says where the watts go and which of them one policy saves: the
first result, after a minute or two, with which --quick ends. Then the robot is measured live, a
network learns and estimates, policies that save are compared, a model of effects is completed by
the one that it misses, and an effect that no catalogue has is learned and written down.

Everything runs as a user would run it: by `ros2 run`, each node in a process of its own.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path

from power_estimator.judge.result import over_meters
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from wattwalk_core.processes import PATIENCE, ChildProcess, ProcessError, find_program

ROOT = Path(__file__).resolve().parent
DOMAIN = '83'
SAVING = ('baseline', 'economy')  # policies, before and after
PLANT = 'anymal_c_published'  # on which they were trained
BAR = 40  # characters, of the largest error
PROXIES = (
    'torque_squared',
    'torque_abs',
    'mechanical_power',
    'mechanical_power_positive',
    'acceleration_squared',
)


class DemoError(Exception):
    """A step of the demo failed; the message says which."""


class Demo:
    """The steps, their results and their logs, in one folder."""

    def __init__(self, output: Path, console: Console) -> None:
        self.output, self.console = output, console
        self._ros2 = find_program('ros2')
        self._logs = output / 'logs'
        self._logs.mkdir(parents=True)
        self._started = time.monotonic()

    def title(self, text: str) -> None:
        """Announce a step."""
        minutes, seconds = divmod(int(time.monotonic() - self._started), 60)
        self.console.print(f'\n[bold]{text}[/]  [dim]{minutes}:{seconds:02d}[/]')

    def run(self, package: str, executable: str, *arguments: str | Path) -> None:
        """Run a command in the foreground, its output on the screen."""
        command = ['ros2', 'run', package, executable, *map(str, arguments)]
        shown = ' '.join(_short(part) for part in command)
        self.console.print(f'[cyan]$ {shown}[/]', soft_wrap=True)
        code = subprocess.run([self._ros2, *command[1:]], check=False).returncode
        if code != 0:
            raise DemoError(f'`{" ".join(command)}` ended with code {code}')

    @contextmanager
    def node(
        self, log: str, package: str, executable: str, *arguments: str
    ) -> Iterator[ChildProcess]:
        """Run a node in the background until the block ends."""
        command = [self._ros2, 'run', package, executable, *arguments]
        node = ChildProcess(command, self._logs / f'{log}_{executable}.log')
        try:
            yield node
        finally:
            node.end(8.0)

    def live(
        self, name: str, policy: str, seconds: float, seed: int, model: Path | None = None
    ) -> Path:
        """Walk live with every node in its own process; returns the recording."""
        bag = self.output / name
        with tempfile.TemporaryDirectory(prefix='wattwalk') as folder, ExitStack() as stack:
            bus = ['-p', 'interface:=unixsocket', '-p', f'channel:={folder}/bus']
            own = ('-p', f'plant:={PLANT}', '-p', f'seed:={seed}', '-p', 'reset_after_fall:=1.0')
            start = stack.enter_context
            nodes = [
                start(self.node(name, 'sim_bridge', 'sim', '--ros-args', *bus, *own)),
                start(self.node(name, 'power_daq', 'daq', '--ros-args', *bus)),
            ]
            if model is not None:
                estimate = ('estimate', '--ros-args', '-p', f'model:=ppn:{model}')
                nodes.append(start(self.node(name, 'power_estimator', *estimate)))
            walk = ('--policy', policy, '--start', '--random-commands', '--restart-after', '1')
            runner = start(self.node(name, 'policy_runner', 'run', *walk, '--seed', str(seed)))
            nodes.append(runner)
            runner.wait_for_line('running', 4 * PATIENCE)
            card = ('--card', 'robot=anymal_c', f'controller={policy}', 'notes=demo, simulated')
            record = ('-o', str(bag), '--duration', str(seconds), *card)
            recorder = start(self.node(name, 'power_daq', 'record', *record))
            self._watch(recorder, nodes, seconds)
            recorder.succeed()
        return bag

    def _watch(
        self, recorder: ChildProcess, nodes: Sequence[ChildProcess], seconds: float
    ) -> None:
        columns = (
            TextColumn('recording'),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn('{task.description}'),
        )
        with Progress(*columns, console=self.console) as progress:
            task = progress.add_task(f'{len(nodes) + 1} nodes', total=seconds)
            while recorder.running:
                for node in nodes:
                    node.check()
                time.sleep(0.5)
                progress.update(task, advance=0.5)

    def offline(
        self, name: str, policies: Sequence[str], seconds: float, seeds: Sequence[int]
    ) -> list[Path]:
        """Simulate a recording of each policy side by side, faster than real time."""
        bags = [self.output / f'{name}_{policy}' for policy in policies]
        with ExitStack() as stack, self.console.status('simulating'):
            nodes = [
                stack.enter_context(
                    self.node(
                        bag.name,
                        'sim_bridge',
                        'sim',
                        '--offline',
                        '--pushes',
                        '--plant',
                        PLANT,
                        '--controller',
                        policy,
                        '--seed',
                        str(seed),
                        '--duration',
                        str(seconds),
                        '-o',
                        str(bag),
                    )
                )
                for policy, bag, seed in zip(policies, bags, seeds, strict=True)
            ]
            for node in nodes:
                node.succeed(60 * PATIENCE)
        return bags


def _short(part: str) -> str:
    path = Path(part)
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else part


def run(demo: Demo, options: argparse.Namespace) -> None:
    """Account for the power of two policies, record live, train, estimate, compare, find."""
    live, seed = options.live, options.seed
    energy_budget(demo, options.walk, seed)
    if options.quick:
        return
    demo.title(
        f'2/8  ANYmal walks for {live:.0f} s, simulated; its 12 drives are metered at 1 kHz'
    )
    first = demo.live('live_1', 'baseline', live, seed)

    demo.title('3/8  More walking, faster than real time')
    offline = demo.offline(
        'offline', ['trot', 'baseline'], options.offline, [100 * seed, 100 * seed + 1]
    )

    demo.title('4/8  A network per drive type learns watts from position error, torque and speed')
    network = demo.output / 'ppn'
    demo.run('power_estimator', 'train', first, *offline, '-o', network, '--folds', '1')

    demo.title(f'5/8  The network estimates live while another policy walks {live:.0f} s')
    second = demo.live('live_2', 'pmp', live, seed + 1, network)
    picture = demo.output / 'live.png'
    demo.run(
        *(
            'power_estimator',
            'benchmark',
            second,
            '--models',
            'recorded',
            f'ppn:{network}',
            *PROXIES,
        ),
        *('--picture', picture),
    )
    demo.title('6/8  Policies that save, at the same speeds: how much, and where?')
    page = demo.output / 'policies.html'
    demo.run(
        *('policy_training', 'evaluate', '--policies', 'baseline', 'pmp', 'economy'),
        *('--tasks', 'forward', 'turn', '--trials', '0', '--models', f'ppn:{network}'),
        *('--report', page),
    )
    better, errors = hidden_effect(demo, options.challenge)
    unnamed = unnamed_effect(demo, options.unnamed)
    demo.title('Done')
    demo.console.print(f'recordings  {_short(str(first))}, {_short(str(second))}')
    demo.console.print(f'network     {_short(str(network))}')
    demo.console.print(f'picture     {_short(str(picture))}')
    pages = 'budget.html, why.html and compare.html beside it'
    demo.console.print(f'reports     {_short(str(page))}; {pages}')
    if better is not None:
        demo.console.print(f'model       {_short(str(better))}')
    if unnamed is not None:
        demo.console.print(f'new effect  {_short(str(unnamed))}; unnamed.html beside it')
    demo.console.print(
        'next, play the recording through the live estimator, or judge another model:'
    )
    demo.console.print(
        f'  .venv/bin/ros2 run power_estimator replay {_short(str(second))} '
        f'--model ppn:{_short(str(network))} -o runs/replayed',
        soft_wrap=True,
    )
    if errors:
        demo.console.print('\nerror of the model of step 7 on another walk, W rms of a drive')
        demo.console.print(falling(errors))


def energy_budget(demo: Demo, seconds: float, seed: int) -> None:
    """Walk by two policies on the same commands, and say where the watts go and what is saved."""
    demo.title(f'1/8  Where do the watts go? Two policies walk {seconds:.0f} s, simulated')
    bags = demo.offline('walk', SAVING, seconds, [seed] * len(SAVING))
    page = demo.output / 'budget.html'
    demo.run('power_lab', 'budget', *bags, '--battery', '907Wh', '--report', page)


def falling(errors: Mapping[str, float]) -> str:
    """Errors by step as bars of characters, W."""
    width, most = max(map(len, errors)), max(errors.values())
    return '\n'.join(
        f'  {step:<{width}}  {error:6.2f}  {"█" * max(1, round(BAR * error / most))}'
        for step, error in errors.items()
    )


def hidden_effect(demo: Demo, seed: int) -> tuple[Path | None, dict[str, float]]:
    """Hide an effect in the drives, find it, add it, and judge all models on another walk.

    Returns the better model, and the error in W rms after each step.
    """
    demo.title('7/8  An effect is hidden in the drives of another robot: which one?')
    riddle, other = demo.output / 'riddle', demo.output / 'riddle_again'
    base, why = demo.output / 'base.yaml', demo.output / 'why.json'
    may_know = demo.output / 'riddle.json'
    demo.run('power_lab', 'challenge', '--seed', str(seed), '-o', riddle, '--json', may_know)
    demo.run('power_lab', 'challenge', '--seed', str(seed), '--walk', '1', '-o', other)
    known = ','.join(json.loads(may_know.read_text(encoding='utf-8'))['known'])
    demo.run('power_lab', 'fit', riddle, '--effects', known, '-o', base)
    pages = ('--json', why, '--report', demo.output / 'why.html')
    demo.run('power_lab', 'diagnose', riddle, '--model', base, *pages)
    found = json.loads(why.read_text(encoding='utf-8'))
    models = {'known effects': base}
    for number, effect in enumerate(found['effects'] if found['verdict'] == 'named' else []):
        grown = demo.output / f'better_{number + 1}.yaml'
        before = [*models.values()][-1]
        demo.run('power_lab', 'add', effect, '--to', before, '--bag', riddle, '-o', grown)
        models[f'+ {effect.replace("_", " ")}'] = grown
    errors: dict[str, float] = {}
    if len(models) > 1:
        told = demo.output / 'compare.json'
        page = ('--json', told, '--report', demo.output / 'compare.html')
        demo.run('power_lab', 'compare', other, '--models', *models.values(), *page)
        judged = json.loads(told.read_text(encoding='utf-8'))['models']
        drives = [one['drives'].values() for one in judged[: len(models)]]
        rms = [over_meters(drive['rmse_w'] for drive in own) for own in drives]
        errors = dict(zip(models, rms, strict=True))
    demo.run('power_lab', 'reveal', riddle, '--diagnosis', why)
    return ([*models.values()][-1] if len(models) > 1 else None), errors


def unnamed_effect(demo: Demo, seed: int) -> Path | None:
    """Learn an effect that no catalogue has, write it down, add it, and judge another walk."""
    demo.title('8/8  Something that no catalogue has is hidden in a third robot: what is it?')
    strange, other = demo.output / 'strange', demo.output / 'strange_again'
    base, effect = demo.output / 'strange_base.yaml', demo.output / 'effect.py'
    may_know, told = demo.output / 'strange.json', demo.output / 'unnamed.json'
    demo.run('power_lab', 'challenge', '--seed', str(seed), '-o', strange, '--json', may_know)
    demo.run('power_lab', 'challenge', '--seed', str(seed), '--walk', '1', '-o', other)
    known = ','.join(json.loads(may_know.read_text(encoding='utf-8'))['known'])
    demo.run('power_lab', 'fit', strange, '--effects', known, '-o', base)
    pages = ('--json', told, '--report', demo.output / 'unnamed.html')
    learned = ('discover', strange, '--test', other, '--model', base, '-o', effect)
    demo.run('power_lab', *learned, *pages)
    found = json.loads(told.read_text(encoding='utf-8'))['found']
    names = [one['name'] for one in found if one['in_file']]
    if names:
        own = ('--effects-path', effect)
        grown = demo.output / 'strange_better.yaml'
        demo.run('power_lab', 'add', *names, '--to', base, '--bag', strange, '-o', grown, *own)
        demo.run('power_lab', 'compare', other, '--models', base, grown, *own)
    demo.run('power_lab', 'reveal', strange)
    return effect if names else None


def parse(args: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, epilog='example: make demo')
    parser.add_argument('--output', type=Path, help='new folder for all results (runs/demo_…)')
    parser.add_argument('--quick', action='store_true', help='end with the first result')
    parser.add_argument('--walk', type=float, default=60.0, help='s of the walks of the budget')
    parser.add_argument('--live', type=float, default=35.0, help='s of live walking, twice')
    parser.add_argument('--offline', type=float, default=150.0, help='s of each offline run')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--challenge', type=int, default=66, help='seed of the hidden effect')
    parser.add_argument('--unnamed', type=int, default=157, help='seed of one in no catalogue')
    return parser.parse_args(args)


def main(args: Sequence[str] | None = None) -> int:
    """Run the demo: 0 done, 1 a step failed, 2 bad input, 130 stopped from outside."""
    options = parse(args)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    output = options.output or ROOT / 'runs' / f'demo_{datetime.now():%Y%m%d_%H%M%S}'
    if output.exists():
        print(f'demo: {output} exists; name another folder', file=sys.stderr)
        return 2
    os.environ.setdefault('ROS_DOMAIN_ID', DOMAIN)
    console = Console()
    try:
        run(Demo(output.resolve(), console), options)
    except (DemoError, ProcessError) as error:
        console.print(f'[bold red]demo stopped:[/] {error}')
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
