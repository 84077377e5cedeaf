"""Pictures inside a page, for light and dark."""

import base64
import io
from collections.abc import Callable

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from wattwalk_core.pages.page import escape


def embedded(draw: Callable[[bool], Figure], words: str) -> str:
    """Markup of a picture that follows the page's colours.

    draw: makes the figure, given whether it is for a dark page. words: for those who cannot see.
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
