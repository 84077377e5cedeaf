"""Files of a search for a gait, and gaits by name or file."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from policy_runner.policies.gait_phase import CADENCE_ADAPTATION
from policy_runner.policies.trot_gait import TROTS, GaitTable, TrotConfig
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Printable, Quantity, parse, read, schema
from wattwalk_core.yaml_file import dump_yaml, read_yaml

from policy_training.config import TrainingConfig, gait_names, gait_path
from policy_training.evaluation.task_trial import TrialScore
from policy_training.learning.gait_search import RANGES, GaitSearch, GaitSearchConfig

SEARCH: Final = 'search.yaml'
GENERATIONS: Final = 'generations.jsonl'
GAIT: Final = 'gait.yaml'
_CLOCK: Final = ('frequency', 'frequency_per_speed')


Values = dict[str, Annotated[float, Quantity(-1e3, 1e3)]]


@schema
class CommandGait:
    """Own values of a gait at a velocity command: vx, vy in m/s, yaw rate in rad/s."""

    command: tuple[
        Annotated[float, Quantity(-3.0, 3.0)],
        Annotated[float, Quantity(-3.0, 3.0)],
        Annotated[float, Quantity(-3.0, 3.0)],
    ]
    values: Values


@schema
class GaitFile:
    """A gait as a change of a named one.

    values: entries of `TrotConfig` by name. by_command: what differs at two or more commands,
    between which gaits are blended. found: what the search measured, for people.
    """

    base: Annotated[str, Printable(1)]
    values: Values
    by_command: tuple[CommandGait, ...] = ()
    found: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.base not in TROTS:
            raise InputError(f'base is {self.base!r}; it must be one of {", ".join(TROTS)}')
        for values in (self.values, *(own.values for own in self.by_command)):
            unknown = next((name for name in values if name not in RANGES), None)
            if unknown is not None:
                raise InputError(f'values has {unknown!r}; a gait has {", ".join(RANGES)}')
        for own in self.by_command:
            clock = next((name for name in own.values if name in _CLOCK), None)
            if clock is not None:
                raise InputError(
                    f'by_command has {clock!r}; give it once in values, for all commands'
                )

    def gait(self, own: Mapping[str, float] | None = None) -> TrotConfig:
        """Return the gait, or that of a command by its own values."""
        return replace(TROTS[self.base], **(self.values | dict(own or {})))  # type: ignore[arg-type]


def load_gait(source: str) -> TrotConfig:
    """Return a gait by name or from a file; InputError names what is missing or out of range."""
    return TROTS[source] if source in TROTS else _read(source)[0]


def load_gait_table(source: str) -> GaitTable | None:
    """Return the gaits by command of a file, None for a gait that has none; InputError so."""
    return None if source in TROTS else _read(source)[1]


def _read(source: str) -> tuple[TrotConfig, GaitTable | None]:
    path = gait_path(source)
    if os.path.isdir(path):
        path = path / GAIT
    if not os.path.isfile(path):
        raise InputError(
            f'no gait {source!r}; there are {", ".join(gait_names())}, or give a file of '
            'optimise_gait'
        )
    found = read(GaitFile, path, 'gait')
    try:
        if not found.by_command:
            return found.gait(), None
        commands = tuple((x, y, yaw) for x, y, yaw in (own.command for own in found.by_command))
        gaits = tuple(found.gait(own.values) for own in found.by_command)
        return found.gait(), GaitTable(commands, gaits)
    except InputError as error:
        raise InputError(f'gait {path}: {error}') from None


def with_clock_of_gait(config: TrainingConfig) -> TrainingConfig:
    """Return a config whose gait clock is that of the gait it imitates, if a file gives it."""
    if config.imitation.gait in TROTS:
        return config
    gait = load_gait(config.imitation.gait)
    return config.with_values(
        {
            'stride_frequency': gait.frequency,
            'frequency_per_speed': gait.frequency_per_speed,
            'cadence_adaptation': gait.cadence_adaptation or CADENCE_ADAPTATION,
        }
    )


def join_searches(folders: Sequence[Path]) -> dict[str, Any]:
    """Return the content of a gait file from searches of one task each.

    The clock has one line over speed, the nearest to the frequencies of all. InputError for fewer
    than two searches, one of all tasks, two of the same, and those of different bases.
    """
    own, bases = [], set()
    for folder in folders:
        config, base = GaitSearchFolder(folder).resume()
        if not config.task:
            raise InputError(f'{folder} searched all tasks; give searches of one --task each')
        bases.add(base)
        own.append((config.tasks[0], load_gait(str(folder))))
    if len(bases) > 1 or len({task for task, _ in own}) < max(len(own), 2):
        raise InputError('give two or more searches, of different tasks and from one gait')
    speeds = np.array([np.hypot(*task.command[:2]) for task, _ in own])
    frequencies = np.array([gait.frequency for _, gait in own])
    rise = float(np.cov(speeds, frequencies, bias=True)[0, 1] / max(speeds.var(), 1e-9))
    rise = float(np.clip(rise, *RANGES['frequency_per_speed']))
    names = [name for name in RANGES if name not in _CLOCK]
    return {
        'base': bases.pop(),
        'values': {
            'frequency': round(float(frequencies.mean() - rise * speeds.mean()), 4),
            'frequency_per_speed': round(rise, 4),
        },
        'by_command': [
            {
                'command': list(task.command),
                'values': {
                    name: round(float(value), 4)
                    for name in names
                    if (value := getattr(gait, name)) is not None
                },
            }
            for task, gait in own
        ],
    }


class GaitSearchFolder:
    """Files of one search: its settings, a line for each generation, and the gait so far."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def start(self, config: GaitSearchConfig, base: str) -> None:
        """Begin a search; InputError for a folder that holds one."""
        if (self.path / SEARCH).exists():
            raise InputError(f'{self.path} holds a search; --resume goes on with it')
        self.path.mkdir(parents=True, exist_ok=True)
        content = {'base': base, **asdict(config)}  # type: ignore[call-overload]
        write_whole(self.path / SEARCH, dump_yaml(content))

    def resume(self) -> tuple[GaitSearchConfig, str]:
        """Return settings and base of the search here; InputError if there is none."""
        if not (self.path / SEARCH).exists():
            raise InputError(f'{self.path} holds no search to resume')
        content = read_yaml(self.path / SEARCH, 'search')
        base = content.pop('base', '') if isinstance(content, dict) else ''
        return parse(GaitSearchConfig, content, f'search {self.path / SEARCH}'), str(base)

    def replay(self, search: GaitSearch) -> None:
        """Tell a new search the costs of the generations done, up to a line cut off by a kill."""
        path = self.path / GENERATIONS
        for line in path.read_text(encoding='utf-8').splitlines() if path.exists() else ():
            try:
                costs = [float(cost) for cost in json.loads(line)['costs']]
            except (json.JSONDecodeError, KeyError, TypeError, ValueError):
                break
            if len(costs) != search.config.population:
                raise InputError(f'{path} has {len(costs)} costs in a line; begin anew')
            search.ask()
            search.tell(costs)
        self._keep(search.generation)

    def add(
        self, generation: int, scores: Sequence[TrialScore], centre: TrotConfig, base: str
    ) -> None:
        """Append a generation and replace the gait."""
        best = min(scores, key=lambda score: score.cost)
        row = {
            'generation': generation,
            'costs': [score.cost for score in scores],
            'best': asdict(best),
        }
        with (self.path / GENERATIONS).open('a', encoding='utf-8') as stream:
            stream.write(json.dumps(row) + '\n')
        values: Mapping[str, float] = {
            name: round(float(getattr(centre, name)), 4) for name in RANGES
        }
        content = {
            'base': base,
            'values': dict(values),
            'found': {'generation': generation, 'best': _rounded(asdict(best))},
        }
        write_whole(self.path / GAIT, dump_yaml(content))

    def _keep(self, generations: int) -> None:
        path = self.path / GENERATIONS
        if path.exists():
            lines = path.read_text(encoding='utf-8').splitlines()[:generations]
            write_whole(path, ''.join(line + '\n' for line in lines))


def _rounded(content: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _rounded(value) if isinstance(value, dict) else round(float(value), 4)
        for key, value in content.items()
    }
