"""Recordings of a session as its worker reads them, and what a diagnosis of them finds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from power_estimator.effects import Catalogue, load_catalogue

from power_workbench.sessions.steps import SessionStep
from power_workbench.views.view import Singles


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
    def of(cls, opened: SessionStep, effect_files: Sequence[str] = ()) -> 'Source':
        """Recordings of a step `open`."""
        how = (opened.recordings, opened.drives, opened.slow, opened.anyway, opened.without)
        return cls(*how, opened.sha256, tuple(effect_files))

    @property
    def unchecked(self) -> 'Source':
        """The same recordings, whatever effects may be run."""
        return replace(self, sha256=(), effect_files=())

    @property
    def whole(self) -> 'Source':
        """The same recordings with nothing left out."""
        return replace(self, without=())

    def catalogue(self) -> Catalogue:
        """Shipped effects and the user's own."""
        return load_catalogue([Path(file) for file in self.effect_files])
