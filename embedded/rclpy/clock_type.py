"""The kinds of clocks."""

from enum import IntEnum


class ClockType(IntEnum):
    """Types of clocks: ROS time follows /clock under `use_sim_time`; steady time never steps."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3
