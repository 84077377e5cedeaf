"""
Verdicts on all of a long recording and on pieces of it.

    python bench/lab_pieces.py [--seconds 600] [--most 240 150 120] [--count 24] [--out FILE.jsonl]

Ten minutes of three drives from the circuit of the blind benchmark, in random order of scenarios;
each is judged on all of it and on pieces of so many seconds. What is in FILE is not run again.
"""

import argparse
import json
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from lab import CATALOGUE
from lab_scenarios import Scenario, random_order, scenarios
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.fitter import Fitter, measurement_terms
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.signals.prepared import Prepared, prepare
from power_lab.diagnose.diagnosis import Diagnoser
from rich.console import Console
from rich.progress import track
from rich.table import Table


def judged(prepared: Prepared, scenario: Scenario) -> dict[str, Any]:
    """Verdict, effects and the time that it took."""
    structure = Structure(tuple(Active.of(CATALOGUE[name]) for name in scenario.known))
    whole = structure.plus(*measurement_terms(CATALOGUE, shaft=True))
    start = time.process_time()
    found = Diagnoser(Fitter(prepared), whole, CATALOGUE).run()
    wrong = sorted(set(found.effects) - scenario.truth) if found.verdict == 'named' else []
    return {
        'verdict': found.verdict,
        'effects': sorted(found.effects),
        'wrong': wrong,
        'cpu_s': round(time.process_time() - start, 1),
    }


def main() -> int:
    """Run what is not in the file, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--seconds', type=float, default=600.0)
    add('--most', type=float, nargs='+', default=[240.0, 150.0, 120.0])
    add('--count', type=int, default=24)
    add('--seed', type=int, default=0)
    add('--out', type=Path, default=Path('runs/lab_pieces.jsonl'))
    options = parser.parse_args()
    every = scenarios([options.seed], sources=['circuit'], quick=True)
    chosen = [replace(s, seconds=options.seconds) for s in random_order(every)[: options.count]]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    lines = options.out.read_text().splitlines() if options.out.exists() else []
    rows = {row['key']: row for row in map(json.loads, lines)}
    for scenario in track(chosen, 'scenarios'):
        if scenario.key in rows:
            continue
        prepared = prepare(scenario.record())
        row = {'key': scenario.key, 'all': judged(prepared, scenario)}
        for most in options.most:
            row[f'{most:g}'] = judged(pieces(prepared, most), scenario)
        rows[scenario.key] = row
        with options.out.open('a') as file:
            file.write(json.dumps(row) + '\n')
    table = Table(title=f'{options.seconds:g} s of three drives, {len(chosen)} scenarios')
    for column in ('judged on', 'same verdict and names', 'named wrongly', 'CPU'):
        table.add_column(column, justify='right')
    own = [rows[scenario.key] for scenario in chosen]
    for most in ('all', *(f'{most:g}' for most in options.most)):
        same = sum(
            (row[most]['verdict'], row[most]['effects'])
            == (row['all']['verdict'], row['all']['effects'])
            for row in own
        )
        wrong = sum(bool(row[most]['wrong']) for row in own)
        cpu = sum(row[most]['cpu_s'] for row in own) / len(own)
        table.add_row(most, f'{same} of {len(own)}', str(wrong), f'{cpu:.1f} s')
    console = Console()
    console.print(table)
    for row in own:
        for most in (f'{most:g}' for most in options.most):
            before, after = row['all'], row[most]
            if (before['verdict'], before['effects']) != (after['verdict'], after['effects']):
                console.print(row['key'], most, before, after)
    console.print(Counter(row['all']['verdict'] for row in own))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
