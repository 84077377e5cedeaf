"""
Blind benchmark of power_lab: hidden and unmodelled effects, nulls and faults of the meter.

    python bench/lab.py [--seeds 0 1 …] [--sources circuit sim] [--quick] [--out FILE.jsonl]

Truths are circuits (bench/truth_circuit.py) and sim_bridge's plants, never the
lab's own formulas. Results are appended to FILE, and what is there is not run again.
"""

import argparse
import hashlib
import json
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lab_scenarios import UNMODELLED, Scenario, random_order, scenarios
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active
from power_estimator.effects.signals.prepared import prepare
from power_estimator.effects.training import fit_model, material
from power_estimator.judge.judge import Judge
from power_estimator.judge.recordings import Loaded
from power_lab.diagnose.diagnosis import diagnosed
from power_lab.diagnose.findings import Diagnosis
from power_recordings.alignment.dataset import AlignedDataset
from rich.console import Console
from rich.progress import track
from rich.table import Table
from threadpoolctl import threadpool_limits
from wattwalk_core.engine.options import Workplace, add_workplace
from wattwalk_core.engine.task_engine import TaskEngine

HERE = Path(__file__).resolve().parent
CATALOGUE = builtin_catalogue()
DETECTABLE = 0.15
"""W, rms over the drives: an effect that puts on more counts as detectable."""


def judge(scenario: Scenario) -> dict[str, Any]:
    """Simulate, diagnose and score one scenario."""
    row = scenario.content() | {'key': scenario.key, 'followed_up': scenario.followed_up}
    try:
        data = scenario.record()
        with threadpool_limits(limits=1):
            start = time.monotonic()
            diagnosis = examined(data, scenario.known)
            row['seconds_taken'] = round(time.monotonic() - start, 1)
            row |= told(diagnosis)
            row['unabsorbed_w'] = unabsorbed(diagnosis, scenario.truth)
            row['hidden_w'] = hidden(scenario, data)
            if scenario.followed_up and diagnosis.verdict == 'named':
                row['fall'] = fall(scenario, data, diagnosis.effects)
    except Exception as error:  # one broken scenario must not end the benchmark
        row['error'] = f'{type(error).__name__}: {error}'
    return row


def examined(data: AlignedDataset, known: Sequence[str]) -> Diagnosis:
    """Judge a model with the known effects."""
    actives = [Active.of(CATALOGUE[name]) for name in known]
    return diagnosed(material(data, per='drive'), actives, CATALOGUE)


def hidden(scenario: Scenario, data: AlignedDataset) -> float | None:
    """
    W rms over the drives by which the smallest hidden effect changes the power below 12.5 Hz.

    By the truth with it and without it on the same motion; None in sim_bridge, where the motion
    changes with the effect.
    """
    if scenario.source != 'circuit' or not scenario.truth:
        return None
    power = prepare(data).power_at(0.0)
    sizes = []
    for name in scenario.truth:
        without = prepare(scenario.record(without=(name,))).power_at(0.0)
        sizes.append(float(np.sqrt(np.nanmean(np.square(power - without)))))
    return round(min(sizes), 4)


def unabsorbed(diagnosis: Diagnosis, truth: Iterable[str]) -> float:
    """W rms over the drives that the model cannot absorb of the smallest hidden effect."""
    watts = [one.explains[1] for one in diagnosis.candidates if one.name in truth]
    return round(min(watts, default=0.0), 4)


def told(diagnosis: Diagnosis) -> dict[str, Any]:
    """The parts of a diagnosis that are scored."""
    left = diagnosis.residual
    return {
        'verdict': diagnosis.verdict,
        'effects': list(diagnosis.effects),
        'probability': {one.name: round(one.probability, 4) for one in diagnosis.candidates},
        'residual_w': 0.0 if left is None else round(left.rms_w, 4),
        'over': [] if left is None else list(left.over),
        'rmse_w': np.round(diagnosis.base.rmse, 3).tolist(),
        'rmse_after_w': np.round(diagnosis.best.rmse, 3).tolist(),
    }


def fall(scenario: Scenario, data: AlignedDataset, named: Sequence[str]) -> float:
    """Share of what the hidden effect put on that `add` takes off on another recording."""
    other = scenario.record(other=True)
    base = _error(data, other, scenario.known)
    better = _error(data, other, (*scenario.known, *named))
    least = _error(
        scenario.record(without=tuple(scenario.hidden)),
        scenario.record(other=True, without=tuple(scenario.hidden)),
        scenario.known,
    )
    return round((base - better) / max(base - least, 1e-9), 3)


def _error(fitted_on: AlignedDataset, judged_on: AlignedDataset, effects: Sequence[str]) -> float:
    actives = [Active.of(CATALOGUE[name]) for name in effects]
    model, _ = fit_model('trial', material(fitted_on), actives, CATALOGUE)
    return Judge(Loaded.of(judged_on), CATALOGUE).score(model).rms_w


def score(row: dict[str, Any]) -> str:
    """
    Named, in the set, part, missed, none of the above, FALSE ALARM or WRONG.

    `named` is right with just what was hidden, and part of it where some of it was named; a set of
    which one is missing is right where it holds what was hidden. What a constant torque imitates
    has no name.
    """
    truth = {name for name in row['hidden'] if name not in UNMODELLED}
    unmodelled = any(name in UNMODELLED for name in row['hidden'])
    verdict, effects = row['verdict'], set(row['effects'])
    if verdict in ('named', 'ambiguous') and row['group'] == 'constant':
        return 'WRONG'
    if verdict == 'named':
        return 'named' if effects == truth else 'part' if effects < truth else 'WRONG'
    if verdict == 'ambiguous':
        return 'in the set' if effects & truth else 'WRONG'
    if verdict == 'no_evidence':
        return 'no evidence' if not truth and not unmodelled else 'missed'
    return 'none of the above' if truth or unmodelled else 'FALSE ALARM'


DESCRIBED = {'position_rub': 'position', 'fan': 'time'}
"""Causes that the remainder of an unmodelled effect follows."""


def described(row: dict[str, Any]) -> str:
    """Verdict on whether the remainder was said to follow what was hidden."""
    causes = tuple(DESCRIBED[name] for name in row['hidden'] if name in DESCRIBED)
    follows = any(cause.startswith(causes) for cause in row['over'])
    return 'described' if follows else 'not described'


def main() -> int:
    """Run what is not in the file yet, then print the matrix and the gates."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='example: python bench/lab.py --seeds 0 1 2 --out runs/lab.jsonl',
    )
    add = parser.add_argument
    add('--seeds', type=int, nargs='+', default=[0])
    add('--sources', nargs='+', choices=('circuit', 'sim'), default=['circuit', 'sim'])
    add('--groups', nargs='+', default=[], help='only these: effect null pair unmodelled fault …')
    add('--quick', action='store_true', help='one strength and one base each')
    add('--limit', type=int, default=0, help='at most so many, a fair sample')
    add_workplace(parser, 'scenarios')
    add('--out', type=Path, default=Path('runs/lab.jsonl'))
    add('--markdown', type=Path, help='write matrix and gates there')
    options = parser.parse_args()
    os.nice(10)
    todo = random_order(scenarios(options.seeds, sources=options.sources, quick=options.quick))
    if options.groups:
        todo = [scenario for scenario in todo if scenario.group in options.groups]
    if options.limit:
        todo = todo[: options.limit]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    judged_by = judge_version()
    rows = _known(options.out, judged_by)
    done = {row['key'] for row in rows}
    todo = [scenario for scenario in todo if scenario.key not in done]
    with TaskEngine(Workplace.of(options)) as engine, options.out.open('a') as file:
        judged = engine.completed(judge, todo, ('power_lab', 'power_estimator', 'lab'))
        for _, judgement in track(judged, 'judging', total=len(todo)):
            row = judgement | {'judge': judged_by}
            rows.append(row)
            file.write(json.dumps(row) + '\n')
            file.flush()
    text = summary(rows)
    Console().print(table(rows))
    print(text)
    if options.markdown:
        options.markdown.write_text(markdown(rows) + '\n' + text + '\n', encoding='utf-8')
    broken = [row for row in rows if 'error' in row]
    for row in broken[:5]:
        print(f'{row["key"]}: {row["error"]}', file=sys.stderr)
    return 1 if broken else 0


def judge_version(*, bench: bool = True) -> str:
    """Hash of the sources that decide; rows of another judge are not mixed in."""
    digest = hashlib.sha256()
    root = HERE.parent
    folders = [root / 'src' / 'power_lab', root / 'src' / 'power_estimator']
    for folder in [*folders, HERE] if bench else folders:
        for path in sorted(folder.rglob('*.py')):
            if 'test' not in path.parts or path.name == 'truth_circuit.py':
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _known(path: Path, judged_by: str) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    own = [row for row in rows if row.get('judge') == judged_by and 'error' not in row]
    if len(own) < len(rows):
        print(f'{path}: {len(rows) - len(own)} rows of another judge, or broken, are run again')
    return own


COLUMNS = (
    'named',
    'in the set',
    'part',
    'missed',
    'no evidence',
    'none of the above',
    'FALSE ALARM',
    'WRONG',
)


def matrix(rows: Iterable[dict[str, Any]]) -> dict[tuple[str, str], Counter[str]]:
    """Scores by what was hidden; effects apart by whether they are detectable."""
    out: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for row in rows:
        if 'error' in row:
            continue
        hidden = ' + '.join(row['hidden']) or row['fault'] or 'nothing'
        group = row['group']
        if group in ('effect', 'pair'):
            group += ', detectable' if row['unabsorbed_w'] >= DETECTABLE else ', weak'
        out[group, hidden][score(row)] += 1
    return dict(sorted(out.items()))


def table(rows: Iterable[dict[str, Any]]) -> Table:
    """The matrix for a terminal."""
    made = Table(title='blind benchmark of power_lab')
    made.add_column('group')
    made.add_column('hidden')
    for column in COLUMNS:
        made.add_column(column, justify='right')
    for (group, hidden), counts in matrix(rows).items():
        made.add_row(group, hidden, *(str(counts[c] or '') for c in COLUMNS))
    return made


def markdown(rows: Iterable[dict[str, Any]]) -> str:
    """The matrix for the documentation."""
    lines = ['| group | hidden | ' + ' | '.join(COLUMNS) + ' |', '|---' * (len(COLUMNS) + 2) + '|']
    for (group, hidden), counts in matrix(rows).items():
        cells = ' | '.join(str(counts[c] or '') for c in COLUMNS)
        lines.append(f'| {group} | {hidden} | {cells} |')
    return '\n'.join(lines) + '\n'


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """The gates of issue and design, as reached."""
    good = [row for row in rows if 'error' not in row]
    scored = [(row, score(row)) for row in good]
    effects = [(r, s) for r, s in scored if r['group'] == 'effect']
    strong = [s for r, s in effects if r['unabsorbed_w'] >= DETECTABLE]
    large = [s for r, s in effects if (r['hidden_w'] or r['unabsorbed_w']) >= DETECTABLE]
    nulls = [s for r, s in scored if r['group'] == 'null']
    faults = [s for r, s in scored if r['group'] == 'fault']
    unmodelled = [s for r, s in scored if r['group'] == 'unmodelled']
    pairs = [s for r, s in scored if r['group'] == 'pair' and r['unabsorbed_w'] >= DETECTABLE]
    beside = [s for r, s in scored if r['group'] == 'beside']
    followed = [r for r, _ in effects if r['followed_up'] and r['unabsorbed_w'] >= DETECTABLE]
    falls = [row.get('fall', 0.0) for row in followed]
    named = [s for r, s in scored if r['verdict'] in ('named', 'ambiguous')]
    right = ('named', 'in the set')
    lines = [
        f'recordings judged: {len(good)}, of them with a name: {len(named)}',
        _gate('wrong name, of all recordings', [s for _, s in scored], ('WRONG',), '≤ 2 %'),
        _gate('nulls called no evidence', nulls, ('no evidence',), '≥ 95 %'),
        _gate('faults called no evidence', faults, ('no evidence',), '≥ 95 %'),
        _gate(f'truth named or in the set, {DETECTABLE} W not absorbed', strong, right, '≥ 95 %'),
        _gate('  of these named', strong, ('named',), '–'),
        _gate(f'the same, of all that change the power by {DETECTABLE} W', large, right, '–'),
        _gate(
            'unmodelled effects called none of the above',
            unmodelled,
            ('none of the above',),
            '≥ 90 %',
        ),
        _gate(
            'constant torques in a set or none of the above',
            [s for r, s in scored if r['group'] == 'constant'],
            ('in the set', 'none of the above'),
            'all',
        ),
        _gate('both of two named or in the set', pairs, right, '–'),
        _gate('  of these both named', pairs, ('named',), 'all'),
        _gate('an effect beside an unmodelled effect: its name', beside, right, '≥ 85 %'),
        _gate('  none of the above', beside, ('none of the above',), '–'),
        _gate(
            'what an unmodelled effect depends on, beside another or alone',
            [described(r) for r in good if {*r['hidden']} & {*DESCRIBED}],
            ('described',),
            '≥ 90 %',
        ),
    ]
    if falls:
        enough = sum(value >= 0.8 for value in falls)
        lines.append(
            f'error put on taken off by add, on another recording (0 where not named): median '
            f'{np.median(falls):.2f}, ≥ 0.8 in {enough} of {len(falls)}'
        )
    times = [row['seconds_taken'] for row in good]
    if times:
        lines.append(
            f'seconds per diagnosis: median {np.median(times):.1f}, most {max(times):.1f}'
        )
    return '\n'.join(lines)


def _gate(name: str, scores: Sequence[str], wanted: Sequence[str], gate: str) -> str:
    hits = sum(s in wanted for s in scores)
    share = 100 * hits / len(scores) if scores else float('nan')
    return f'{name}: {hits} of {len(scores)} ({share:.1f} %; gate {gate})'


if __name__ == '__main__':
    from lab import main as named  # workers import `judge` by the name of its module

    raise SystemExit(named())
