import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from power_estimator.effects.fit.bounded_lsq import bounded_solve
from scipy.optimize import lsq_linear


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), columns=st.integers(1, 9), tie=st.floats(0.0, 0.98))
def test_a_batch_agrees_with_scipy_one_by_one(seed, columns, tie):
    random = np.random.default_rng(seed)
    a = random.normal(size=(5, 60, columns))
    a += tie / (1 - tie) * random.normal(size=(5, 60, 1))
    b = random.normal(size=(5, 60)) * 3 + a.sum(axis=2)
    lower, upper = np.full(columns, -0.3), np.full(columns, 0.9)
    lower[0], upper[-1] = 0.0, np.inf
    gram = a.transpose(0, 2, 1) @ a
    moment = np.einsum('btm,bt->bm', a, b)
    found = bounded_solve(gram, moment, lower, upper)
    for problem in range(5):
        expected = lsq_linear(a[problem], b[problem], bounds=(lower, upper), tol=1e-12)
        cost = 0.5 * np.sum((a[problem] @ found[problem] - b[problem]) ** 2)
        assert cost == pytest.approx(expected.cost, rel=1e-5, abs=1e-7)


def test_bounds_hold_exactly():
    gram = np.array([[[2.0, 1.9], [1.9, 2.0]]])
    found = bounded_solve(gram, np.array([[4.0, -3.0]]), np.zeros(2), np.array([1.0, 5.0]))
    assert found.tolist() == [[1.0, 0.0]]


def test_of_two_equal_columns_the_prior_holds_the_known_one_at_zero():
    gram = np.full((1, 2, 2), 100.0)
    ridge = np.array([0.0, 1.0])
    found = bounded_solve(gram, np.full((1, 2), 300.0), np.full(2, -9.0), np.full(2, 9.0), ridge)
    assert found[0] == pytest.approx([3.0, 0.0], abs=1e-3)


def test_a_column_of_zeros_gets_zero():
    gram = np.array([[[4.0, 0.0], [0.0, 0.0]]])
    found = bounded_solve(gram, np.array([[8.0, 0.0]]), np.full(2, -9.0), np.full(2, 9.0))
    assert found[0].tolist() == pytest.approx([2.0, 0.0])
