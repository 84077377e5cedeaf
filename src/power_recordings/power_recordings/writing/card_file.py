"""The card of a recording under way: on disk from the moment that a fact is known."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from power_recordings.card import Card


class CardFile:
    """
    `card.yaml` in the folder of a recording, written anew with each fact that comes.

    given: the user's entries, which go before what sources tell. RecordingError where the disk
    refuses.
    """

    def __init__(self, given: Card, folder: Path) -> None:
        self._given, self._folder = given, folder
        self._sources: list[Card] = []
        self._drives: tuple[str, ...] = ()
        self._saved = given
        given.save(folder)

    def add_source(self, source: Card) -> None:
        """Take what a source tells of its drives: torque, velocity and calibration."""
        if source not in self._sources:
            self._sources.append(source)
            self._save()

    def add_mark(self, stamp_ns: int, text: str) -> None:
        """Take a note of the time stamp_ns."""
        self._given = self._given.with_mark(stamp_ns, text)
        self._save()

    def add_drives(self, measured: Sequence[str]) -> None:
        """Take the names of the measured drives."""
        self._drives = tuple(measured)
        self._save()

    def _save(self) -> None:
        card = self._given
        applied = ', '.join(dict.fromkeys(s.calibration for s in self._sources if s.calibration))
        if not card.torque and not card.torque_unit:
            torque = {drive: at for s in self._sources for drive, at in s.torque.items()}
            unit = {drive: name for s in self._sources for drive, name in s.torque_unit.items()}
            card = replace(card, torque=torque, torque_unit=unit)
        card = replace(
            card, drives=card.drives or self._drives, calibration=card.calibration or applied
        )
        derived = [drive for s in self._sources for drive in s.derived_velocity]
        card = card.with_derived_velocity(derived)
        if card != self._saved:
            card.save(self._folder)
            self._saved = card
