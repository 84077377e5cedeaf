"""Mutated tables: one line of error and nothing written, or the recording that it should be."""

import pytest
from import_fuzz import MUTATIONS, fault, mutated

COUNT, BLOCKS = 300, 6


@pytest.mark.parametrize('block', range(BLOCKS))
def test_a_mutated_table_is_imported_as_it_is_or_refused_in_one_line(tmp_path, block):
    wrong = []
    for seed in range(block, COUNT, BLOCKS):
        table = mutated(seed)
        _, found = fault(table, tmp_path / str(seed))
        wrong += [f'seed {seed} ({", ".join(table.done)}): {found}'] if found else []
    assert wrong == []


def test_every_mutation_is_drawn():
    assert {name for seed in range(COUNT) for name in mutated(seed).done} == set(MUTATIONS)
