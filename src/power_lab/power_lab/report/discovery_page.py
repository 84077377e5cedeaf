"""The page of a discovery."""

from pathlib import Path

from wattwalk_core.pages.page import Page, escape

from power_lab.discover.outcome import DiscoveryOutcome


def write_discovery(path: Path, outcome: DiscoveryOutcome) -> None:
    """Write the page of `discover`."""
    page = Page('Discovery')
    page.add(f'<h1 id="verdict">{escape(outcome.sentence)}</h1>')
    page.write(path)
