"""A real robot: DAQ, policy runner, estimator, recorder and bench supply."""

from typing import Any

from wattwalk_bringup.launch_files import launch_description


def generate_launch_description() -> Any:
    """Return the nodes and their arguments."""
    return launch_description('robot')
