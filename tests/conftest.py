"""What tests of several nodes share."""

import pytest
from supply_bench import Bench


@pytest.fixture
def bench():
    """A supply's poller and the simulated instrument that it asks."""
    bench = Bench()
    yield bench
    bench.close()
