"""One reading of a bench supply."""

from typing import NamedTuple


class Reading(NamedTuple):
    """
    What a supply measured; current in A is positive out of the supply.

    stamp: ROS time in ns of the middle between question and answer; steady: the same instant on
    the steady clock; round_trip: s between them, so the stamp is off by half of it at most.
    """

    stamp: int
    steady: int
    voltage: float
    current: float
    power: float | None
    round_trip: float
