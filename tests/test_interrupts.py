"""Nodes interrupted at random moments from their start on end in good order."""

import interrupts
import pytest


@pytest.fixture
def fed(node_process):
    """Messages at 1 kHz in the test's domain."""
    node_process.python(interrupts.__file__)


@pytest.mark.parametrize('node', interrupts.CHEAP)
def test_a_node_ends_without_a_traceback_and_accounts_for_its_samples(fed, node):
    endings = [interrupts.interrupted(node, seed) for seed in range(8)]
    wrong = [ending for ending in endings if ending.how not in interrupts.GOOD]
    assert wrong == []
    assert any(ending.how == 'in order' for ending in endings)
