"""Recording of a motion: start of the recorder, supervision and filing."""

import signal
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final, TextIO

from diagnostic_msgs.msg import DiagnosticArray
from power_recordings.card import Card
from wattwalk_core.console import write_json
from wattwalk_core.errors import InputError
from wattwalk_core.processes import ChildProcess

from drive_bench.run.motion_run import MotionRun
from drive_bench.run.options import PATIENCE, RunOptions
from drive_bench.run.recording_check import check, check_table

NAME: Final = 'bench_recorder'
_RUN: Final = (
    'import sys; from power_daq.commands.arguments import record as main; sys.exit(main())'
)
_PATIENCE: Final = 30.0  # s to close a bag


class RecorderProcess:
    """Child process of `ros2 run power_daq record`, in a session without the terminal's Ctrl-C.

    It ends on `stop`, or after `longest` s if this process is killed. card: entries by key; ros:
    further arguments for ROS.
    """

    def __init__(
        self, bag: Path, card: Mapping[str, str], longest: float, ros: Sequence[str] = ()
    ) -> None:
        self.bag = bag
        self._folder = tempfile.TemporaryDirectory()
        words = [f'{key}={value}' for key, value in card.items()]
        command = [sys.executable, '-c', _RUN, '-o', str(bag), '--duration', f'{longest:.0f}']
        command += ['--card', *words, '--ros-args', *ros, '-r', f'__node:={NAME}']
        self._process = ChildProcess(command, Path(self._folder.name) / 'recorder.log')

    @property
    def ended(self) -> str:
        """Reason for the recorder's end, '' while it runs."""
        code = self._process.returncode
        if code is None:
            return ''
        if code < 0:
            return f'the recorder was ended by {signal.Signals(-code).name}'
        last = self._process.last_line
        return f'the recorder ended: {last.partition("record: ")[2] or last}'

    def stop(self) -> tuple[str, ...]:
        """End the recorder with SIGINT and return the lines of its summary."""
        place = len(self._process.output)
        self._process.end(_PATIENCE, [signal.SIGINT])
        lines = self._process.output[place:].splitlines()
        return tuple(line for line in lines if line.strip())


def file_away(
    run: MotionRun, recorder: RecorderProcess, reason: str, report: Path | None, out: TextIO
) -> int:
    """End the recorder, write the card, check the bag and print the table to `out`.

    reason: why the motion ended. report: JSON file for the check. Returns 1 if unusable, else 0.
    """
    died = recorder.ended
    summary = recorder.stop()
    complete = run.code == 0 and not died
    drive, bag = run.drives[0], recorder.bag
    found = check(bag, run.motion, drive, run.limits[drive], complete)
    try:
        card = Card.load(bag)
        told = {
            'complete': complete,
            'ended': 'done' if complete else reason,
            'fitted': list(run.notes),
            'check': {
                name: None if value is None else round(value, 4)
                for name, value in found.figures.items()
            },
            'amiss': list(found.amiss),
        }
        replace(card, drives=run.drives, other={**card.other, **told}).save(bag)
    except InputError as error:
        print(f'the card could not be written: {error}', file=out)
    for line in summary:
        print(line, file=out)
    print(f'\n{check_table(found.rows)}\n', file=out)
    content = {
        'bag': str(bag),
        'complete': complete,
        'ended': reason,
        'figures': found.figures,
        'rows': [asdict(row) for row in found.rows],
    }
    write_json(report, content)
    if not complete:
        print(f'{bag} is kept, incomplete: {reason}', file=out)
        return 1
    if run.repetition:
        print(run.repetition, file=out)
    drives = ' '.join(run.drives)
    analysis = f'ros2 run power_lab diagnose {bag} --model base.yaml --drives {drives}'
    print(f'{bag}\nnext: {analysis}', file=out)
    return 0 if found.usable else 1


_NEEDED: Final = ('drive_supply', 'joint_states')
_LEAD: Final = 1.0  # s that are recorded before the drive moves
_SPARE: Final = 600.0  # s by which a recorder outlasts its motion at most, if this process dies


class MotionRecording:
    """Recording of one motion; `advance` is called at 10 Hz.

    ros: arguments for ROS that the recorder gets, such as its namespace.
    """

    def __init__(self, options: RunOptions, ros: Sequence[str] = ()) -> None:
        self._options, self._ros = options, ros
        self._patience = PATIENCE if options.patience is None else options.patience
        self._recorder: RecorderProcess | None = None
        self._began = time.monotonic()
        self._recording_since: float | None = None
        self._counts: dict[str, int] = {}
        self._reason = 'ended before it began'
        self._moved = False

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Read the recorder's message counts from a message of `diagnostics`."""
        for status in message.status:
            if status.name == f'{NAME}: bag':
                self._counts = {
                    pair.key.removesuffix(' messages').rsplit('/', 1)[-1]: int(pair.value)
                    for pair in status.values
                    if pair.key.endswith(' messages')
                }

    def advance(self, run: MotionRun | None, now: float, supplied: bool) -> str:
        """Start the recorder, then the motion, once each can; return what it waits for, or ''.

        now: s on the clock of the run. supplied: whether drive_supply has a publisher. InputError
        if they cannot start. A recorder that ends during the motion damps the drives.
        """
        try:
            if self._recorder is None:
                return self._start_recorder(run, now, supplied)
            if self._recorder.ended and not self._moved:
                raise InputError(self._recorder.ended)
            if run is not None and self._recorder.ended:
                run.monitor.interlock = self._recorder.ended
            elif run is not None and not self._moved:
                self._start_motion(run, now)
        except InputError as error:
            self._reason = str(error)
            raise
        return ''

    def _start_recorder(self, run: MotionRun | None, now: float, supplied: bool) -> str:
        missing = 'joint_states never came'
        if run is not None:
            missing = run.unsound(now) if supplied else 'nobody publishes drive_supply'
        if run is None or missing:
            if time.monotonic() - self._began > self._patience:
                raise InputError(
                    f'{missing} within {self._patience:g} s; is ros2 run power_daq daq running, '
                    'and the drive on?'
                )
            return missing
        run.plan()
        bag = self._options.bag(run.motion, run.drives)
        card = self._options.card_entries(run.motion, run.drives)
        longest = 2.0 * run.policy.left + _SPARE
        self._recorder = RecorderProcess(bag, card, longest, self._ros)
        self._began = time.monotonic()
        return ''

    def _start_motion(self, run: MotionRun, now: float) -> None:
        time_now = time.monotonic()
        missing = [topic for topic in _NEEDED if not self._counts.get(topic)]
        if missing:
            if time_now - self._began > self._patience:
                raise InputError(f'the recorder receives nothing of {", ".join(missing)}')
            return
        self._recording_since = self._recording_since or time_now
        if time_now - self._recording_since >= _LEAD:
            self._moved, reason = run.start(now)
            if not self._moved:
                raise InputError(reason)

    def finish(self, run: MotionRun | None) -> int:
        """End the recorder and check the bag; return 1 if it is unusable, 0 if good or absent."""
        if run is None or self._recorder is None:
            return 0
        reason = run.reason if run.code is not None else self._reason
        return file_away(run, self._recorder, reason, self._options.json, sys.stdout)
