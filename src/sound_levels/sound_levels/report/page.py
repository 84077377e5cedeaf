"""Report of a sound analysis as one page that needs no network."""

from pathlib import Path

from wattwalk_core.pages.embedded_figure import embedded
from wattwalk_core.pages.page import Page

from sound_levels.levels.analysis import Analysis, Take
from sound_levels.levels.summary import LEVEL_COLUMNS, level_cells, sentences
from sound_levels.report.figure import draw_alignment, draw_sound


def write_sound_report(path: Path, analysis: Analysis) -> None:
    """Write differences, levels over time, spectra, alignment and warnings."""
    settings = analysis.settings
    page = Page('Sound levels by policy')
    page.add('<h1>Sound levels by policy</h1>')
    for sentence in sentences(analysis):
        page.text(sentence)
    tone = analysis.tone
    page.facts(
        {
            'Levels': f'{analysis.unit}, {settings.time} time weighting',
            'Calibration': 'none: levels are relative to full scale (a sine at full scale is 0)'
            if tone is None
            else f'{tone.level:g} dB SPL at {tone.frequency:.0f} Hz, steady to '
            f'{tone.spread:.2f} dB for {tone.seconds:g} s',
        }
    )
    page.heading('Level over time, and third-octave spectrum')
    words = 'level over time and third-octave spectrum by policy'
    page.add(embedded(lambda dark: draw_sound(analysis, dark=dark), words))
    page.heading('Levels')
    rows = []
    for name in analysis.policies:
        found = analysis.levels(name)
        rows.append((name, f'{found.seconds:.0f}', *level_cells(found)))
    page.table(('policy', 'counted s', *LEVEL_COLUMNS), rows, numbers=range(1, 7))
    page.text(
        f'In {analysis.unit}. Leq is the mean by energy; L10, L50 and L90 are exceeded for 10, 50 '
        'and 90 % of the time.',
        faint=True,
    )
    louder = analysis.differences()
    if louder:
        page.heading('Difference from ' + analysis.policies[0])
        page.table(
            ('policy', 'figure', 'dB louder', '95 % interval', 'block s'),
            [
                (
                    *(name, key.title(), f'{d.value:+.2f}', _span(d.interval)),
                    'by files' if block is None else f'{block:.2f}',
                )
                for name, (figures, block) in louder.items()
                for key, d in figures.items()
            ],
            numbers=(2, 3, 4),
        )
        page.text(
            "With at least two files of both policies, intervals are Welch's t on the files' mean "
            'levels. With a single file, they are those of a block bootstrap whose blocks are as '
            'long as the level correlates, and do not include differences between set-ups, such '
            'as the position of the microphone: record each policy several times.',
            faint=True,
        )
    _alignments(page, analysis)
    page.heading('Files')
    page.table(
        ('file', 'policy', 'rate Hz', 's', 'evaluated', 'remarks'),
        [
            (
                *(take.path.name, take.policy, f'{take.sound.rate:.0f}'),
                *(f'{take.sound.seconds:.1f}', take.why, '; '.join(take.warnings) or 'none'),
            )
            for take in analysis.takes
        ],
        numbers=(2, 3),
    )
    for warning in analysis.warnings:
        page.text(warning)
    page.write(path)


def _alignments(page: Page, analysis: Analysis) -> None:
    takes = [take for take in analysis.takes if take.alignment is not None]
    if not takes:
        return
    page.heading('Alignment with recordings')
    page.table(
        ('file', 'recording', 'by', 'offset s', 'drift ppm', 'correlation', 'rival'),
        [
            (
                *(take.path.name, take.recording, take.alignment.method),
                *(f'{take.alignment.offset:+.3f}', f'{take.alignment.drift:+.0f}'),
                *(f'{take.alignment.correlation:.2f}', f'{take.alignment.rival:.2f}'),
            )
            for take in takes
            if take.alignment is not None
        ],
        numbers=(3, 4, 5, 6),
    )

    def close_up(take: Take) -> str:
        return embedded(lambda dark: draw_alignment(analysis, take, dark=dark), 'level, landings')

    page.tabs({take.path.name: close_up(take) for take in takes})
    page.text('Three seconds; vertical lines are landings of a foot by foot_force.', faint=True)


def _span(interval: tuple[float, float]) -> str:
    return f'{interval[0]:+.2f} … {interval[1]:+.2f}'
