"""Plot style of figures, light or dark, and their files."""

import base64
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.pages.page import escape

BLUE = {False: '#0072B2', True: '#56B4E9'}
"""Blue of estimates and of our own measurement, on a light page and (True) on a dark one."""
OTHERS = ('#E69F00', '#009E73', '#CC79A7', '#D55E00', '#999999')
"""Colours beside blue that the colour-blind tell apart."""
_LIGHT = {'figure.facecolor': '#ffffff', 'axes.facecolor': '#ffffff', 'text.color': '#1a1a1a'}
_DARK = {'figure.facecolor': '#1c1f24', 'axes.facecolor': '#1c1f24', 'text.color': '#e8e8e8'}


@contextmanager
def style(dark: bool) -> Iterator[str]:
    """Set the style of pictures within `with`; gives the colour of text and measurements."""
    colours = _DARK if dark else _LIGHT
    ink = colours['text.color']
    settings: Any = {
        **colours,
        **dict.fromkeys(('axes.labelcolor', 'xtick.color', 'ytick.color', 'axes.edgecolor'), ink),
        'font.size': 10,
        'axes.spines.top': False,
        'axes.spines.right': False,
        'axes.grid': True,
        'axes.axisbelow': True,
        'grid.color': ink,
        'grid.alpha': 0.12,
        'savefig.facecolor': colours['figure.facecolor'],
    }
    with mpl.rc_context(settings):
        yield ink


def save_figure(figure: Figure, path: Path) -> None:
    """Write a picture in the format of path's suffix, or nothing; InputError if it cannot."""
    FigureCanvasAgg(figure)
    stream = io.BytesIO()
    try:
        figure.savefig(stream, dpi=150, format=path.suffix[1:])
    except ValueError as error:
        raise InputError(f'{path}: {error}') from None
    write_whole(path, stream.getvalue())


def embedded(draw: Callable[[bool], Figure], words: str) -> str:
    """Return the HTML of a picture that follows the page's colours, light or dark.

    draw: makes the figure, for a dark page if given True. words: alternative text.
    """
    light, dark = (_data(draw(it)) for it in (False, True))
    return (
        '<picture>'
        f'<source media="(prefers-color-scheme: dark)" srcset="{dark}">'
        f'<img src="{light}" alt="{escape(words)}" style="width:100%;height:auto">'
        '</picture>'
    )


def _data(figure: Figure) -> str:
    FigureCanvasSVG(figure)
    file = io.BytesIO()
    figure.savefig(file, format='svg')
    return 'data:image/svg+xml;base64,' + base64.b64encode(file.getvalue()).decode()
