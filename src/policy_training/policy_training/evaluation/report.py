"""Offline HTML page of an evaluation."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from wattwalk_core.pages.page import Page, escape

from policy_training.evaluation import figures
from policy_training.evaluation.figures import PARTS
from policy_training.evaluation.gait_cycle import Cycle

_AXES: Final = {'vx': 'vx error m/s', 'vy': 'vy error m/s', 'yaw': 'yaw rate error rad/s'}


def write_report(
    path: Path,
    result: Mapping[str, Any],
    cycles: Mapping[str, Mapping[str, Cycle]],
    curves: Mapping[str, Sequence[Mapping[str, float]]],
) -> None:
    """
    Write the page of an evaluation.

    result: as in its JSON. cycles: by task, then by policy. curves: of training, by policy.
    """
    entries = result['policies']
    title = 'Power and gait of the policies'
    page = Page(title, [f'<h1>{escape(title)}</h1>'])
    for sentence in result['verdict']:
        page.text(sentence)
    page.heading('Power by parts')
    page.text(
        'Mean over steady walking. Supply is measured at the battery terminals. Electronics is '
        'the part of it that does not reach the drives, idle the power of the drives at rest, '
        'and each joint type the power of its four drives beyond that. The mark across a bar is '
        'the estimate.'
    )
    page.add(page.figure(figures.power_bars(entries), 'power of each policy and task, by parts'))
    _table(
        page,
        ('policy', 'task', 'supply W', *(f'{p} W' for p in PARTS), 'estimated W', 'CoT', 'falls'),
        [
            (
                *(e['name'], e['task'], e['power_w']['supply']),
                *(e['power_w'][part] for part in PARTS),
                *(e['estimated_w'], e['cost_of_transport'], e['falls']),
            )
            for e in entries
            if e['power_w']
        ],
    )
    page.heading('Tracking')
    _table(
        page,
        ('policy', 'task', *_AXES.values(), 'steady s'),
        [(e['name'], e['task'], *map(e['tracking'].get, _AXES), e['steady_s']) for e in entries],
    )
    front = figures.pareto_front(entries)
    page.add(page.figure(front, 'supply power against tracking error'))
    if result['trials']:
        page.heading('Robustness on rough ground, with pushes and changing commands')
        _table(
            page,
            ('policy', 'follows', 'robots', 'falls', *_AXES.values()),
            [
                (
                    *(name, 'yes' if t['following'] else 'no', t['robots'], t['falls']),
                    *map(t['mean_error'].get, _AXES),
                )
                for name, t in result['trials'].items()
            ],
        )
        falls = figures.falls_front(entries, result['trials'])
        page.add(page.figure(falls, 'mean supply power against robots that fell'))
    page.heading('Gait')
    _table(
        page,
        (
            *('policy', 'task', 'stride s', 'swing s', 'stance s', 'impact N', 'loudness dB'),
            *('torque RMS N·m', 'KFE speed RMS rad/s', 'KFE torque above 20 Hz'),
        ),
        [_gait_row(entry) for entry in entries if entry.get('gait')],
    )
    for task, found in cycles.items():
        page.text(f'Mean gait cycle of LF_KFE on {task}; stance is shaded.')
        label = f'gait cycle of LF_KFE on {task}'
        page.add(page.figure(figures.gait_cycles(found), label, size='large'))
    if any(curves.values()):
        page.heading('Training')
        page.add(page.figure(figures.learning_curves(curves), 'learning curves', size='tall'))
    page.write(path)


def _gait_row(entry: Mapping[str, Any]) -> tuple[object, ...]:
    gait, smooth = entry['gait'], entry['smoothness']
    return (
        *(entry['name'], entry['task'], gait['stride_s'], gait['swing_s'], gait['stance_s']),
        *(gait['impact_n'], gait['impact_rate_db'], smooth['torque_rms_nm']),
        *(smooth['kfe_velocity_rms'], smooth['kfe_torque_above_20_hz']),
    )


def _table(page: Page, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    texts = [[_text(cell) for cell in row] for row in rows]
    page.table(columns, texts, numbers=range(2, len(columns)))


def _text(cell: object) -> str:
    if cell is None:
        return '–'
    if isinstance(cell, float):
        return f'{cell:.0f}' if abs(cell) >= 100 else f'{cell:.2f}'
    return str(cell)
