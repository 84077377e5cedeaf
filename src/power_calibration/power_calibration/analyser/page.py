"""A calibration as one HTML page that needs no network."""

from pathlib import Path

from wattwalk_core.pages.embedded_figure import embedded
from wattwalk_core.pages.page import Page, escape

from power_calibration.analyser.comparison import Comparison
from power_calibration.analyser.figure import draw
from power_calibration.analyser.summary import rows, sentences


def write_page(path: Path, found: Comparison) -> None:
    """Verdict, picture, table, how it was found."""
    page = Page(f'Calibration of {found.measured.drive}')
    page.add(f'<h1>{escape(page.title)}</h1>')
    for sentence in sentences(found):
        page.text(sentence)
    page.add(embedded(lambda dark: draw(found, dark=dark), 'our power over the analyser’s'))
    page.heading('What is off')
    page.table(('', 'value', '95 % from', 'to'), rows(found), numbers=(1, 2, 3))
    page.text(
        'True value = gain · measured + offset. The time offset is added to the analyser’s time, '
        'in the middle of the overlap, to make it that of the recording; a positive drift is an '
        'analyser whose clock runs too fast.'
    )
    page.heading('How this was found')
    page.text(
        f'{found.measured.path} and {found.log.path} ({len(found.log.time)} rows at '
        f'{found.log.rate:g} Hz) were laid on each other by correlation, then offset, drift, '
        f'gains and offsets were fitted together. Intervals are of 95 %: a jackknife that leaves '
        f'out one of {found.fit.blocks} consecutive blocks at a time, so that errors which last '
        'within a block do not pass for independent ones.'
    )
    for note in found.notes:
        page.text(note, faint=True)
    page.text('A calibrated meter is taken with -p calibration:=FILE of the DAQ node.', faint=True)
    page.write(path)
