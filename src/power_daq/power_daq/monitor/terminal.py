"""Output of the live view: a terminal screen, lines of a log, or a picture."""

import io
import re
import time
from pathlib import Path

from rich.console import Console
from rich.live import Live
from wattwalk_core.files import write_whole

from power_daq.monitor.screen import Screen, line
from power_daq.monitor.state import View


class Terminal:
    """A screen on a terminal, else a line for each view; period: s between views."""

    def __init__(self) -> None:
        console = Console()
        self._screen = Screen()
        self._on_screen = console.is_terminal and not console.is_dumb_terminal
        self._live = Live(self._screen, console=console, screen=True, auto_refresh=False)
        self._last = ''
        self.period = 0.5 if self._on_screen else 1.0

    def start(self) -> None:
        """Take over the screen, where there is one."""
        if self._on_screen:
            self._live.start()

    def show(self, view: View) -> None:
        """Show a view."""
        clock = time.strftime('%H:%M:%S')
        self._screen.update(view, clock)
        self._last = line(view, clock)
        if self._on_screen:
            self._live.refresh()
        else:
            print(self._last, flush=True)

    def stop(self) -> None:
        """Give the screen back and leave the last view as a line."""
        self._live.stop()
        if self._on_screen and self._last:
            print(self._last)

    def save(self, path: Path) -> None:
        """Write the last view as an SVG file."""
        recorder = Console(record=True, width=80, file=io.StringIO(), force_terminal=True)
        recorder.print(self._screen)
        picture = recorder.export_svg(title='ros2 run power_daq watch')
        own_fonts = re.sub(r'@font-face \{.*?\}', '', picture, flags=re.DOTALL)
        write_whole(path, own_fonts.replace('Fira Code', 'DejaVu Sans Mono, Menlo, Consolas'))
