"""Priority of the processes of a live test over other work of the machine."""

import os
from contextlib import suppress
from typing import Any


def prefer(*nodes: Any) -> None:
    """Put nodes before other work of the machine, where the system allows it."""
    for node in nodes:
        with suppress(PermissionError, ProcessLookupError):
            os.setpriority(os.PRIO_PGRP, node.pid, -15)
