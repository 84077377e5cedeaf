"""Views and findings of models on recordings, for as long as the server runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from power_workbench.sessions.source import Findings, Source
from power_workbench.views.view import PowerView

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
        """Keep a view as the latest; the eldest gives way."""
        self.views.pop(key, None)
        while len(self.views) >= _KEPT:
            self.views.pop(next(iter(self.views)))
        self.views[key] = view

    def keep_budget(self, key: Key, budget: Mapping[str, Any]) -> None:
        """Keep a budget as the latest; the eldest gives way, and no first look to a whole one."""
        known = self.budgets.pop(key, None)
        if known is not None and budget.get('first') and not known.get('first'):
            budget = known
        while len(self.budgets) >= _KEPT:
            self.budgets.pop(next(iter(self.budgets)))
        self.budgets[key] = budget

    def keep_line(self, source: Source, line: Mapping[str, Any]) -> None:
        """Keep the error of another model on recordings, in place of a former one."""
        others = [one for one in self.lines.get(source, []) if one['name'] != line['name']]
        self.lines[source] = [*others, line]

    def carry(self, before: Key | None, key: Key | None) -> None:
        """Keep what is known of a model: effects that may be run do not change it."""
        if before is None or key is None:
            return
        if before in self.views:
            self.views[key] = self.views[before]
        if before in self.learned:
            self.learned[key] = self.learned[before]
