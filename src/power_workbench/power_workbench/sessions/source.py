"""Recordings of a session as its worker reads them, and what a diagnosis of them finds."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from power_estimator.effects import Catalogue, load_catalogue
from wattwalk_core.errors import InputError

from power_workbench.sessions.steps import SessionRecord
from power_workbench.views.view import PowerView, Singles


@dataclass(frozen=True)
class Findings:
    """A diagnosis as the page shows it."""

    content: Mapping[str, Any]  # as `diagnose --json` writes it, with the effects in words
    explained: Mapping[str, Singles]  # W [N, M] by candidate, less of the residual with it


@dataclass(frozen=True)
class Source:
    """Recordings of a session as they are read, and the files of effects that may be run."""

    recordings: tuple[str, ...]
    drives: tuple[str, ...] = ()
    slow: bool = False
    anyway: bool = False
    without: tuple[str, ...] = ()  # seconds that are left out
    sha256: tuple[str, ...] = ()  # of the recordings, where they were read before
    effect_files: tuple[str, ...] = ()

    @classmethod
    def of(cls, record: SessionRecord) -> 'Source':
        """Return what a session has open; InputError before it has opened a recording."""
        opened = record.opened
        if opened is None:
            raise InputError('no recording is open; choose one first')
        how = (opened.recordings, opened.drives, opened.slow, opened.anyway, opened.without)
        return cls(*how, opened.sha256, record.effect_files)

    @property
    def unchecked(self) -> 'Source':
        """The same recordings without hashes and files of effects, for comparison."""
        return replace(self, sha256=(), effect_files=())

    @property
    def whole(self) -> 'Source':
        """The same recordings with nothing left out."""
        return replace(self, without=())

    def catalogue(self) -> Catalogue:
        """Return the shipped effects and those of effect_files, which are run."""
        return load_catalogue([Path(file) for file in self.effect_files])


Key = tuple[Source, str]
"""Recordings and a model."""
_KEPT = 4  # views


@dataclass
class SeenModels:
    """Views and budgets of the last models, the last diagnosis and result of `discover`."""

    views: dict[Key | None, PowerView] = field(default_factory=dict)
    found: dict[Key | None, Findings] = field(default_factory=dict)
    learned: dict[Key | None, Mapping[str, Any]] = field(default_factory=dict)
    budgets: dict[Key | None, Mapping[str, Any]] = field(default_factory=dict)
    lines: dict[Source, list[Mapping[str, Any]]] = field(default_factory=dict)

    def keep(self, key: Key, view: PowerView) -> None:
        """Keep a view as the latest."""
        _keep(self.views, key, view)

    def keep_budget(self, key: Key, budget: Mapping[str, Any]) -> None:
        """Keep a budget as the latest, unless it is a first look and a whole one is known."""
        known = self.budgets.get(key)
        is_worse = known is not None and budget.get('first') and not known.get('first')
        _keep(self.budgets, key, known if is_worse else budget)

    def keep_line(self, source: Source, line: Mapping[str, Any]) -> None:
        """Keep name and error of another model, in place of a former entry of that name."""
        others = [one for one in self.lines.get(source, []) if one['name'] != line['name']]
        self.lines[source] = [*others, line]

    def carry(self, before: Key | None, key: Key | None) -> None:
        """Keep under `key` what is known of the model under `before`, if both are given."""
        if before is None or key is None:
            return
        if before in self.views:
            self.views[key] = self.views[before]
        if before in self.learned:
            self.learned[key] = self.learned[before]


def _keep(kept: dict[Key | None, Any], key: Key, value: Any) -> None:
    """Keep a value as the latest; the eldest of four gives way."""
    kept.pop(key, None)
    while len(kept) >= _KEPT:
        kept.pop(next(iter(kept)))
    kept[key] = value
