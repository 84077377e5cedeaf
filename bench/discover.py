"""Blind benchmark of `power_lab discover`: hidden effects that no catalogue has, and nulls.

    python bench/discover.py [--seeds 0 1 …] [--only NAME …] [--out FILE.jsonl]

Truths are circuits (bench/discover_truth.py), whose shapes are not those of the grammar. Each is
recorded twice: discover learns from one recording, `add` fits what it wrote to the same one, and
the error is judged on the other. Results are appended to FILE; what is there is not run again.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from discover_truth import HIDDEN, recorded
from lab_scenarios import BASES, FAULTS
from power_estimator.effects import load_catalogue
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.discover.effect_file import effect_source
from power_lab.discover.found import Discovery
from power_recordings.alignment.dataset import AlignedDataset
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits
from truth_circuit import Faults

from power_lab import Session

KNOWN = ('shaft', *BASES['core'])
SECONDS = 150.0
_OTHER = 5000  # seed of the other recording


def scenarios(seeds: Sequence[int]) -> list[tuple[str, str, str, int]]:
    """Return (`hidden` or `null`, hidden effect or fault, motion, seed) of each scenario."""
    out = []
    for seed in seeds:
        for name, hidden in HIDDEN.items():
            out += [('hidden', name, motion, seed) for motion in hidden.motions]
        out += [('null', '', motion, seed) for motion in ('walk', 'ladder')]
        faults = list(FAULTS)
        picked = [faults[(2 * seed + i) % len(faults)] for i in range(2)]
        out += [('null', fault, ('walk', 'ladder')[seed % 2], seed) for fault in picked]
    return out


def judge(group: str, name: str, motion: str, seed: int) -> dict[str, Any]:
    """Simulate one scenario, run discover and return the scores as a row of the file."""
    row: dict[str, Any] = {'group': group, 'name': name, 'motion': motion, 'seed': seed}
    hidden = name if group == 'hidden' else ''
    faults = Faults(**FAULTS[name]) if group == 'null' and name else None
    given = {'unit': seed + 50, 'seconds': SECONDS}
    try:
        data = recorded(hidden, motion, seed=seed, faults=faults, **given)
        with threadpool_limits(limits=1):
            lab = Session(Judge(Loaded.of(data))).fit(KNOWN)
            start = time.process_time()
            discovery = lab.discover().discovery
            row['cpu_s'] = round(time.process_time() - start, 1)
            row |= told(discovery)
            if hidden:
                other = recorded(hidden, motion, seed=seed + _OTHER, **given)
                row |= elsewhere(lab, discovery, other)
    except Exception as failure:  # one broken scenario must not end the benchmark
        row['error'] = f'{type(failure).__name__}: {failure}'
    return row


def told(discovery: Discovery) -> dict[str, Any]:
    """Return the parts of a discovery that are scored, by name."""
    return {
        'kinds': [one.kind for one in discovery.found],
        'names': [one.name for one in discovery.found],
        'named': [one.name for one in discovery.named],
        'formulas': [one.formula.text() if one.formula else '' for one in discovery.found],
        'explains_w': [round(one.explains, 3) for one in discovery.found],
        'kept': [round(one.kept, 3) for one in discovery.found],
        'drives': [list(one.drives) for one in discovery.found],
        'nothing': discovery.nothing,
        'chance': discovery.chance,
        'rmse_w': np.round(discovery.base.rmse, 3).tolist(),
        'after_w': np.round(discovery.best.rmse, 3).tolist(),
        'rivals': [list(one.rivals) for one in discovery.found],
    }


def elsewhere(lab: Session, discovery: Discovery, other: AlignedDataset) -> dict[str, float]:
    """Return RMS errors in W on another recording, before and after adding written effects."""
    written = [one.written for one in discovery.found if one.written is not None]
    before = error(lab, other)
    if not written:
        return {'other_before_w': before, 'other_after_w': before}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'effect.py'
        path.write_text(effect_source(written, ['bench']), encoding='utf-8')
        judge = Judge(lab.recordings, load_catalogue([path]))
        after = error(Session(judge).fit([*KNOWN, *(one.name for one in written)]), other)
    return {'other_before_w': before, 'other_after_w': after}


def error(lab: Session, other: AlignedDataset) -> float:
    """Return the RMS error in W, on another recording, of a session's model."""
    judge = Judge(Loaded.of(other), lab.judge.catalogue)
    return round(judge.score(lab.model).rms_w, 4)


def right_kind(row: Mapping[str, Any]) -> bool:
    """Return whether the first effect found is of a kind that describes the hidden one."""
    return bool(row['kinds']) and row['kinds'][0] in HIDDEN[row['name']].kinds


def halved(row: Mapping[str, Any]) -> bool:
    """Return whether the error on the other recording fell to half or less."""
    return bool(row['other_after_w'] <= 0.5 * row['other_before_w'])


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return, line by line, the goals of the benchmark with the figures reached."""
    good = [row for row in rows if 'error' not in row]
    hidden = [row for row in good if row['group'] == 'hidden']
    state = [row for row in hidden if HIDDEN[row['name']].in_state]
    alone = [row for row in hidden if not HIDDEN[row['name']].in_state]
    nulls = [row for row in good if row['group'] == 'null']
    sold = [row for row in alone if any(kind != 'time' for kind in row['kinds'])]
    quiet = [row for row in nulls if not row['kinds']]
    extra = [row for row in state if len(row['kinds']) > 1]
    falls = [1 - row['other_after_w'] / row['other_before_w'] for row in state]
    lines = [
        _goal('kind right', sum(map(right_kind, hidden)), len(hidden), '≥ 90 %'),
        _goal('error elsewhere halved, state', sum(map(halved, state)), len(state), '≥ 80 %'),
        _goal('nothing proposed on nulls', len(quiet), len(nulls), '≥ 95 %'),
        _goal('time sold as physics', len(sold), len(alone), '0'),
        _goal('more than one proposed for one', len(extra), len(state), '–'),
    ]
    if falls:
        lines.append(f'fall of the error elsewhere: median {np.median(falls):.0%}')
    times = [row['cpu_s'] for row in good]
    if times:
        lines.append(f'CPU s a discovery: median {np.median(times):.1f}, most {max(times):.1f}')
    return '\n'.join(lines)


def _goal(name: str, count: int, of: int, goal: str) -> str:
    share = 100 * count / of if of else float('nan')
    return f'{name}: {count} of {of} ({share:.0f} %; goal {goal})'


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """Return a table of verdicts by hidden effect and motion."""
    columns = ('hidden', 'motion', 'runs', 'kind right', 'halved', 'said')
    made = Table(*columns, title='blind benchmark of discover')
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        if 'error' not in row:
            what = row['name'] if row['group'] == 'hidden' else f'null {row["name"]}'
            groups[what, row['motion']].append(row)
    for (name, motion), own in sorted(groups.items()):
        hidden = own[0]['group'] == 'hidden'
        said = Counter(' + '.join(row['names']) or 'nothing' for row in own)
        made.add_row(
            name,
            motion,
            str(len(own)),
            str(sum(map(right_kind, own))) if hidden else '',
            str(sum(map(halved, own))) if hidden and HIDDEN[name].in_state else '',
            ', '.join(f'{text} {count}' for text, count in said.most_common()),
        )
    return made


def main() -> int:
    """Run what is not in the file yet, then print the table and the goals."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='example: python bench/discover.py --seeds 10 11 --out runs/discover.jsonl',
    )
    add = parser.add_argument
    add('--seeds', type=int, nargs='+', default=[0])
    add('--only', nargs='+', default=[], metavar='NAME', help='only these hidden effects')
    add('--out', type=Path, default=Path('runs/discover.jsonl'))
    options = parser.parse_args()
    os.nice(10)
    todo = [s for s in scenarios(options.seeds) if not options.only or s[1] in options.only]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if options.out.exists():
        rows = [json.loads(line) for line in options.out.read_text().splitlines()]
    done = {(r['group'], r['name'], r['motion'], r['seed']) for r in rows}
    with options.out.open('a') as file:
        for count, scenario in enumerate(todo):
            if scenario in done:
                continue
            row = judge(*scenario)
            rows.append(row)
            file.write(json.dumps(row) + '\n')
            file.flush()
            print(f'{count + 1}/{len(todo)}', *scenario, row.get('names'), file=sys.stderr)
    Console().print(table(rows))
    print(summary(rows))
    broken = [row for row in rows if 'error' in row]
    for row in broken[:5]:
        print(f'{row["name"]}, {row["motion"]}: {row["error"]}', file=sys.stderr)
    return 1 if broken else 0


if __name__ == '__main__':
    raise SystemExit(main())
