"""A calibration as one HTML page that needs no network."""

from pathlib import Path

from wattwalk_core.pages.embedded_figure import embedded
from wattwalk_core.pages.page import Page, escape

from power_calibration.analyser.comparison import AnalyserComparison
from power_calibration.analyser.figure import draw_calibration
from power_calibration.analyser.summary import COLUMNS, calibration_sentences, rows


def write_calibration_page(path: Path, found: AnalyserComparison) -> None:
    """Write errors, figure, table of corrections, and method."""
    page = Page(f'Calibration of {found.measured.drive}')
    page.add(f'<h1>{escape(page.title)}</h1>')
    for sentence in calibration_sentences(found):
        page.text(sentence)
    page.add(
        embedded(lambda dark: draw_calibration(found, dark=dark), 'our power over the analyser’s')
    )
    page.heading('Corrections')
    page.table(COLUMNS, rows(found), numbers=(1, 2, 3))
    page.text(
        'True value = gain · measured + offset. The time offset, added to the analyser’s time in '
        'the middle of the overlap, gives the time of the recording. Drift is positive if the '
        'analyser’s clock runs too fast.'
    )
    page.heading('Method')
    page.text(
        f'{found.measured.path} and {found.log.path} ({len(found.log.time)} rows at '
        f'{found.log.rate:g} Hz) were aligned by correlation; then time offset, drift, gains and '
        'offsets were fitted together. Intervals (95 %) are those of a jackknife that leaves out '
        f'one of {found.fit.blocks} consecutive blocks at a time, so that errors within a block '
        'may be correlated.'
    )
    for note in found.notes:
        page.text(note, faint=True)
    page.text(
        'The DAQ node applies the calibration file given as -p calibration:=FILE.', faint=True
    )
    page.write(path)
