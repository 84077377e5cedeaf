"""Rendering of a view on a terminal of at least 60 columns, or as one line."""

import io
import re
import time
from collections.abc import Mapping, Sequence
from math import floor, isfinite, log10
from pathlib import Path

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.table import Table
from rich.text import Text
from wattwalk_core.files import write_whole
from wattwalk_core.recent_power import SECONDS

from power_daq.monitor.state import StatusReport, View

_EIGHTHS = ' ▏▎▍▌▋▊▉'
_LEAST_BAR, _SIDE, _LINE = 6, 34, 200
_BUDGET = f'{SECONDS:.0f} s    '
_BLUE, _ORANGE, _FAINT = 'blue', 'dark_orange', 'dim'


class Screen:
    """Renderable for rich that shows a view, as wide as the console; bar scales only grow."""

    def __init__(self) -> None:
        self._view: View | None = None
        self._scale = 10.0
        self.clock = ''

    def update(self, view: View, clock: str) -> None:
        """Replace the view; clock: the time of day as text."""
        self._view, self.clock = view, clock
        largest = max((abs(d.power) for d in view.drives if isfinite(d.power)), default=0.0)
        self._scale = max(self._scale, _round_up(largest))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the rows of the view."""
        view = self._view
        if view is None:
            return
        plain = not options.encoding.lower().startswith('utf')
        width = options.max_width
        watched = f'{self.clock}  watching for {_duration(view.seconds)}'
        yield Text(f'{"wattwalk":<{max(9, width - len(watched))}}{watched}', style='bold')
        yield self._drives(view, width, plain)
        yield from _sums(view, width)
        yield _sides(view, width)
        for warning in _fitting(view.warnings):
            yield Text('! ' + warning, style='bold ' + _ORANGE, no_wrap=True, overflow='ellipsis')

    def _drives(self, view: View, width: int, plain: bool) -> Table:
        names = max((len(d.name) for d in view.drives), default=6)
        status = max((len(d.status) for d in view.drives), default=2)
        bar = max(_LEAST_BAR, width - max(names, 6) - max(status, 6) - 9 - 9 - 6 - 5)
        table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=True)
        table.add_column('drive', no_wrap=True)
        table.add_column('measured', justify='right', no_wrap=True)
        table.add_column(f'0 … {self._scale:g} W', no_wrap=True, width=bar, header_style=_FAINT)
        table.add_column('estimate', justify='right', no_wrap=True)
        table.add_column('°C', justify='right', no_wrap=True)
        table.add_column('status', no_wrap=True, overflow='ellipsis')
        for drive in view.drives:
            good = drive.status in ('ok', '')
            table.add_row(
                drive.name,
                _watts(drive.power),
                _bar(drive.power, self._scale, bar, plain),
                _watts(drive.estimate),
                _number(drive.temperature, 1),
                Text(drive.status or '-', style='' if good else 'bold ' + _ORANGE),
            )
        return table


def line(view: View, clock: str) -> str:
    """Return a view as one line for a log."""
    supply = next(topic for topic in view.topics if topic.name == 'drive_supply')
    parts = [
        clock,
        f'drives {_watts(view.total)} of supply {_watts(view.supply)}',
        f'electronics {_watts(view.electronics)}',
        f'energy {_joules(view.drive_energy)} of {_joules(view.supply_energy)}',
    ]
    if view.model:
        parts.append(f'estimate {_watts(view.estimate)} ({view.estimate_status})')
    if budget := view.budget.words(_LINE):
        parts.append(f'in {SECONDS:.0f} s: {budget}')
    if hours := _hours(view):
        parts.append(hours)
    parts += [
        f'drive_supply {supply.rate:.0f} Hz, age {_age(supply.age)}, {view.missed} missed here',
        f'recorder {_recorder(view)}',
        *(f'{d.name} {d.status}' for d in view.drives if d.status not in ('ok', '')),
        *view.warnings,
    ]
    return ' | '.join(parts)


def _fitting(warnings: Sequence[str]) -> Sequence[str]:
    """Return at most one line: of several, all but the first by name alone."""
    if len(warnings) <= 1:
        return warnings
    names = ', '.join(warning.split(':', 1)[0] for warning in warnings[1:])
    return (f'{warnings[0]}, and {len(warnings) - 1} more: {names}',)


def _sums(view: View, width: int) -> RenderResult:
    estimate = ''
    if view.model:
        estimate = f'  estimate {_watts(view.estimate)}, {view.estimate_status}  {view.model}'
    shown = _FAINT if view.estimate_status == 'ok' else _ORANGE
    yield _row('drives  ', f'{_watts(view.total):>9}', (estimate, shown))
    yield _row(
        'supply  ',
        f'{_watts(view.supply):>9}',
        f'  {_number(view.voltage, 2)} V  {_number(view.current, 2)} A',
        f'  electronics {_watts(view.electronics)}',
        (' = supply - drives', _FAINT),
    )
    yield _row(
        'energy  ',
        f'{_joules(view.drive_energy):>9} drives  {_joules(view.supply_energy)} supply',
        (f'  since {_duration(view.seconds)}', _FAINT),
        f'  {_hours(view)}' if _hours(view) else '',
    )
    yield _row(_BUDGET, view.budget.words(width - len(_BUDGET)) or 'nothing is metered')


def _row(name: str, *parts: str | tuple[str, str]) -> Text:
    return Text.assemble((name, 'bold'), *parts, no_wrap=True, overflow='ellipsis')


def _hours(view: View) -> str:
    return f'battery {view.hours:.2f} h left' if isfinite(view.hours) else ''


def _sides(view: View, width: int) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, width=_SIDE)
    table.add_column(no_wrap=True, overflow='ellipsis', width=max(10, width - _SIDE - 2))
    bus, segment = _of(view.reports, 'bus'), _of(view.reports, 'segment')
    good = sum(report.level == 0 for report in view.reports.values())
    nodes = f'{good} of {len(view.reports)} statuses ok' if view.reports else 'no diagnostics'
    right = [
        ('segment' if segment and not bus else 'bus', _devices(bus, segment)),
        ('clock', _clock(bus)),
        ('lost', _losses(view, bus, segment)),
        ('recorder', _recorder(view)),
        ('nodes', nodes),
    ]
    for topic, (name, text) in zip(view.topics, right, strict=True):
        stale = topic.age is None or topic.age > 2.0
        style = _ORANGE if stale and topic.name == 'drive_supply' else _FAINT if stale else ''
        left = f'{topic.name:<14}{topic.rate:7.1f} Hz {_age(topic.age):>8}'
        table.add_row(Text(left, style=style), Text.assemble((f'{name:<9}', 'bold'), text))
    return table


def _devices(bus: StatusReport | None, segment: StatusReport | None) -> str:
    """Return the state of the CAN bus, of the EtherCAT segment, or of both where two DAQs run."""
    found = []
    if bus is not None:
        load = bus.figures.get('bus load [%]')
        state = bus.figures.get('bus state', '?')
        found.append(f'{state}, load {load} %' if load else state)
    if segment is not None:
        state = segment.figures.get('segment state', '?')
        found.append(f'segment {state}' if found else state)
    return ', '.join(found) or 'no diagnostics of the DAQ'


def _clock(report: StatusReport | None) -> str:
    """Return offset, drift and worst delay of the first mapped clock."""
    figures = {} if report is None else report.figures
    for key in figures:
        if key.startswith('clock ') and key.endswith(' offset [s]'):
            name = key.removesuffix('offset [s]')
            offset = _text(figures, key, 3)
            drift = _text(figures, f'{name}drift [ppm]', 1)
            return f'{offset} s, {drift} ppm, {_text(figures, f"{name}worst delay [us]", 0)} us'
    return '-'


def _text(figures: Mapping[str, str], key: str, digits: int) -> str:
    try:
        return f'{float(figures[key]):.{digits}f}'
    except (KeyError, ValueError):
        return '-'


def _losses(view: View, bus: StatusReport | None, segment: StatusReport | None) -> str:
    lost = [f'bus {bus.figures.get("electrical lost", "-")}'] if bus else []
    if segment is not None:
        lost.append(f'cycles {segment.figures.get("cycles lost", "-")}')
    bag = _of(view.reports, 'bag')
    in_bag = '' if bag is None else f', recorder {bag.figures.get("samples lost", "-")}'
    return f'{", ".join(lost) or "bus -"}, this view {view.missed}{in_bag}'


def _recorder(view: View) -> str:
    report = _of(view.reports, 'bag')
    if report is None:
        return 'not running'
    if report.level:
        return report.sentence
    size = report.figures.get('size [B]', '0')
    return f'{report.sentence}, {int(size) / 1e6:.1f} MB' if size.isdigit() else report.sentence


def _of(reports: Mapping[str, StatusReport], part: str) -> StatusReport | None:
    found = [report for name, report in reports.items() if name.endswith(f': {part}')]
    return max(found, key=lambda report: report.time) if found else None


def _bar(value: float, scale: float, width: int, plain: bool) -> Text:
    """Return a bar to the right, hollow for negative values."""
    if not isfinite(value):
        return Text('')
    length = min(abs(value) / scale, 1.0) * width
    if plain:
        return Text(('#' if value >= 0 else '-') * round(length))
    if value < 0:
        return Text('░' * max(1, round(length)), style=_ORANGE)
    whole = int(length)
    return Text('█' * whole + _EIGHTHS[int(8 * (length - whole))].strip(), style=_BLUE)


def _round_up(value: float) -> float:
    """Return the next of 10, 20, 50, 100 and so on."""
    power = 10.0 ** max(1, floor(log10(value))) if value > 10.0 else 10.0
    return next(power * step for step in (1.0, 2.0, 5.0, 10.0) if power * step >= value)


def _number(value: float, digits: int) -> str:
    return f'{value:.{digits}f}' if isfinite(value) else '-'


def _watts(value: float) -> str:
    return f'{value:.1f} W' if isfinite(value) else '-'


def _joules(value: float) -> str:
    if not isfinite(value):
        return '-'
    steps = ((1e3, 1.0, 'J'), (1e6, 1e3, 'kJ'), (float('inf'), 1e6, 'MJ'))
    divisor, unit = next((divisor, unit) for limit, divisor, unit in steps if abs(value) < limit)
    return f'{value / divisor:.4g} {unit}'


def _age(age: float | None) -> str:
    if age is None:
        return 'never'
    return f'{1e3 * age:.0f} ms' if age < 1.0 else f'{age:.0f} s'


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f'{hours} h {minutes:02d} min' if hours else f'{minutes}:{rest:02d} min'


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
