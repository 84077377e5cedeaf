"""The simulated robot: plant, DAQ, policy runner, estimator and recorder."""

from typing import Any

from wattwalk_bringup.launch_files import launch_description


def generate_launch_description() -> Any:
    """Return the nodes and their arguments."""
    return launch_description('sim')
