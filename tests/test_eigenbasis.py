"""The first eigenfunctions: closed forms, multiplicities, and the dense route against the sparse one."""

import numpy as np
import pytest
import scipy.sparse as sp

import skfmap.functional.eigenbasis as module
from skfmap.functional import laplacian_eigenbasis


def cycle(n):
    """Return the Laplacian of a ring, whose eigenvalues 2 - 2 cos(2 pi j / n) are double but for the first."""
    ones = np.ones(n)
    ring = sp.diags_array([2 * ones, -ones[1:], -ones[1:]], offsets=[0, 1, -1]).tolil()
    ring[0, -1] = ring[-1, 0] = -1
    return sp.csc_array(ring)


def torus(n, m):
    """Return the Laplacian of a grid of n x m on a torus, and its eigenvalues."""
    A, B = cycle(n), cycle(m)
    product = sp.csc_array(sp.kron(A, sp.eye_array(m)) + sp.kron(sp.eye_array(n), B))
    sums = np.add.outer(*(2 - 2 * np.cos(2 * np.pi * np.arange(size) / size) for size in (n, m)))
    return product, np.sort(sums.ravel())


@pytest.mark.parametrize("shape", [(30, 40), (32, 32)])
def test_every_copy_of_a_multiple_eigenvalue_is_found(shape):
    stiffness, expected = torus(*shape)
    n = len(expected)
    evals, evecs = laplacian_eigenbasis(stiffness, np.full(n, 1 / n), 60)
    np.testing.assert_allclose(evals, n * expected[:60], atol=1e-8 * n * expected[60])
    np.testing.assert_allclose(evecs.T @ evecs / n, np.eye(60), atol=1e-10)


def test_residuals_are_as_small_as_stated(monkeypatch):
    rng = np.random.default_rng(0)
    stiffness, _ = torus(40, 40)
    mass = rng.random(1600) + 0.1
    mass /= mass.sum()
    evals, evecs = laplacian_eigenbasis(stiffness, mass, 50)
    left = stiffness @ evecs - mass[:, None] * evecs * evals
    sizes = np.linalg.norm(left / np.sqrt(mass)[:, None], axis=0)
    assert (sizes <= 1e-9 * np.maximum(evals, 1)).all()
    monkeypatch.setattr(module, "_SMALL", 10_000)
    dense_evals, dense = laplacian_eigenbasis(stiffness, mass, 50)
    np.testing.assert_allclose(evals, dense_evals, atol=1e-8)
    # The same space of functions, but for the last, whose cluster may be cut.
    np.testing.assert_allclose(np.linalg.svd(dense.T @ (mass[:, None] * evecs))[1][:45], 1, atol=1e-8)


def test_the_same_on_every_run_and_in_every_layout():
    stiffness, _ = torus(30, 40)
    mass = np.full(1200, 1 / 1200)
    one, other = (laplacian_eigenbasis(stiffness, mass, 20) for _ in range(2))
    np.testing.assert_array_equal(one[1], other[1])
    assert one[1][:, :7].flags.f_contiguous


def test_a_search_that_goes_on_too_long_says_so(monkeypatch):
    monkeypatch.setattr(module, "_MOST", 1.0)
    stiffness, _ = torus(40, 40)
    with pytest.raises(np.linalg.LinAlgError, match="did not converge"):
        laplacian_eigenbasis(stiffness, np.full(1600, 1 / 1600), 90)
