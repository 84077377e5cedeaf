"""Results of a sound analysis: sentences, tables and plain values for JSON."""

from dataclasses import asdict
from typing import Any

from wattwalk_core.console import finite

from sound_levels.levels.analysis import Analysis
from sound_levels.levels.statistics import ENOUGH, Levels

LEVEL_COLUMNS = ('policy', 'files', 'counted s', 'Leq', 'L10', 'L50', 'L90', 'max')


def level_rows(analysis: Analysis) -> list[list[str]]:
    """Return the cells of LEVEL_COLUMNS for each policy."""
    rows = []
    for name in analysis.policies:
        takes = analysis.of(name)
        seconds, *figures = asdict(analysis.levels(takes)).values()
        cells = (f'{figure:.1f}' for figure in figures)
        rows.append([name, str(len(takes)), f'{seconds:.0f}', *cells])
    return rows


def sentences(analysis: Analysis) -> list[str]:
    """Return a sentence on the level difference of each other policy from the first."""
    first, found = analysis.policies[0], []
    for name, (figures, _) in analysis.differences().items():
        leq = figures['leq']
        low, high = leq.interval
        direction = 'louder' if low > 0 else 'quieter' if high < 0 else ''
        span = f'95 % interval {low:+.1f} to {high:+.1f} dB'
        text = (
            f'{name} is {abs(leq.value):.1f} dB {direction} than {first} (Leq, {span}).'
            if direction
            else f'{name} and {first} cannot be told apart: {leq.value:+.1f} dB (Leq, {span}).'
        )
        fewest = min(len(analysis.of(name)), len(analysis.of(first)))
        if fewest == 1:
            text += (
                ' With a single file of either, the interval does not include differences between '
                f'files: record at least {ENOUGH} of each.'
            )
        elif fewest < ENOUGH:
            text += (
                f' {fewest} files tell little of the differences between files, so that the '
                f'interval is wide: record at least {ENOUGH} of each.'
            )
        found.append(text)
    return found


def summary(analysis: Analysis) -> dict[str, Any]:
    """Return the analysis as plain values for JSON."""
    settings, tone = analysis.settings, analysis.tone
    return {
        'unit': analysis.unit,
        'weighting': settings.weighting,
        'time_weighting': settings.time,
        'calibration': None if tone is None else asdict(tone),
        'files': [
            {
                'path': str(take.path),
                'policy': take.policy,
                'rate_hz': take.sound.rate,
                'seconds': take.sound.seconds,
                'counted': take.why,
                **_levels(analysis.levels([take])),
                'recording': None if take.recording is None else str(take.recording),
                'alignment': take.alignment and finite(asdict(take.alignment)),
                'warnings': list(take.warnings),
            }
            for take in analysis.takes
        ],
        'policies': [
            {
                'name': name,
                'files': [str(take.path) for take in analysis.of(name)],
                **_levels(analysis.levels(analysis.of(name))),
                'third_octaves': {f'{k:g}': round(v, 2) for k, v in analysis.bands(name).items()},
            }
            for name in analysis.policies
        ],
        'differences': [
            {
                'name': name,
                'against': analysis.policies[0],
                'interval_by': 'blocks' if block is not None else 'files',
                'block_s': block,
                **{
                    key: {
                        'value': round(d.value, 3),
                        'interval': [round(x, 3) for x in d.interval],
                    }
                    for key, d in found.items()
                },
            }
            for name, (found, block) in analysis.differences().items()
        ],
        'warnings': list(analysis.warnings),
    }


def _levels(found: Levels) -> dict[str, Any]:
    named = {k: round(v, 3) for k, v in asdict(found).items() if k != 'seconds'}
    return {'counted_s': round(found.seconds, 3), **named}
