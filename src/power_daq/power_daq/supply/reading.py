"""One reading of a bench supply."""

from typing import NamedTuple


class Reading(NamedTuple):
    """
    Voltage (V), current (A, positive out of the supply) and power (W, None if not given).

    stamp: ROS time in ns halfway between question and answer; steady: the same instant on the
    steady clock; round_trip: s between them, so the stamp is off by at most half of it.
    """

    stamp: int
    steady: int
    voltage: float
    current: float
    power: float | None
    round_trip: float
