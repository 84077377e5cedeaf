"""`ros2 run power_lab diagnose`: which physical effect a model misses."""

import argparse
import shlex
from pathlib import Path

from drive_bench.motion.joint_limits import limits_of
from wattwalk_core.console import write_json
from wattwalk_core.files import together

from power_lab.commands import options as common
from power_lab.report.page import write_diagnosis
from power_lab.report.tables import balance_lines, power_balances, print_outcome


def run(options: argparse.Namespace) -> None:
    with common.opened(options, [options.model, *options.also]) as (lab, show):
        show('diagnosing')
        outcome = lab.load(options.model).diagnose(options.seed, show)
        loaded, content = lab.recordings, outcome.json()
    with together():
        write_json(options.json, content)
        if options.motion:
            motion = outcome.motion
            if options.limits is not None:
                limits = limits_of(motion.drives, Path(options.limits) if options.limits else None)
                motion = motion.within(limits)
            motion.save(options.motion)
        if options.report:
            write_diagnosis(options.report, outcome, options.also, lab.judge.catalogue)
    for line in balance_lines(loaded.data, power_balances(loaded.data)):
        print(line)
    print_outcome(common.console(), outcome)
    if options.motion:
        print(f'to record next: {options.motion}')
    if options.report:
        print(f'report: {options.report}')
    if outcome.next_effects and options.model.endswith('.yaml'):
        model = ('--to', options.model, '-o', common.unused('better.yaml'))
        print(common.next_command('add', options, *outcome.next_effects, *model))
    elif outcome.to_learn:
        learned = ('--model', options.model, '-o', common.unused('effect.py'))
        print(common.next_command('discover', options, *learned))
    elif options.motion:
        print(f'next: ros2 run drive_bench run {shlex.quote(str(options.motion))} --record')
    else:
        asked = ('--model', options.model, '--motion', common.unused('next.yaml'))
        print(common.next_command('diagnose', options, *asked))
