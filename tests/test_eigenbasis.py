"""The first eigenfunctions: closed forms, multiplicities, dense against sparse, failures."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull

import skfmap.functional.eigenbasis as module
from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError, SkippedShapeWarning
from skfmap.functional import laplacian_eigenbasis
from skfmap.shapes import SkippedShape


def cycle(n):
    """Return the Laplacian of a ring: eigenvalues 2 - 2 cos(2 pi j / n), all but one double."""
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


def test_errors_are_as_small_as_stated(monkeypatch):
    rng = np.random.default_rng(0)
    stiffness, _ = torus(40, 40)
    mass = rng.random(1600) + 0.1
    mass /= mass.sum()
    evals, evecs = laplacian_eigenbasis(stiffness, mass, 50)
    left = stiffness @ evecs - mass[:, None] * evecs * evals
    for j in range(1, 50):
        error = spsolve(sp.csc_array(stiffness + evals[j] * sp.diags_array(mass)), left[:, j])
        assert np.sqrt(mass @ error**2) <= 1e-8
    monkeypatch.setattr(module, "_SMALL", 10_000)
    dense_evals, dense = laplacian_eigenbasis(stiffness, mass, 50)
    np.testing.assert_allclose(evals, dense_evals, atol=1e-8)
    # The same space of functions, but for the last, whose cluster may be cut.
    np.testing.assert_allclose(
        np.linalg.svd(dense.T @ (mass[:, None] * evecs))[1][:45], 1, atol=1e-8
    )


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


def test_far_from_weyls_law():
    """A path has one eigenvalue where Weyl's law expects hundreds: the shift follows the count."""
    n, k = 3000, 40
    ones = np.ones(n)
    ones[[0, -1]] = 0.5
    path = sp.diags_array([2 * ones, -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    shift, _ = module._factorise(sp.csc_array(n * path), k)
    expected = n * (2 - 2 * np.cos(np.pi * np.arange(n) / n))
    assert k / 4 < np.count_nonzero(expected < shift) <= 0.75 * k
    evals, _ = laplacian_eigenbasis(sp.csc_array(path), np.full(n, 1 / n), k)
    np.testing.assert_allclose(evals, expected[:k], atol=1e-8 * expected[k])


def test_a_shift_that_costs_digits_is_moved():
    usual, _ = module._factorise(sp.csc_array(sp.diags_array([0.0, 1e4, 1e5, 1e6])), 3)
    near = usual * (1 + 1e-9)
    moved, solver = module._factorise(sp.csc_array(sp.diags_array([0.0, near, 1e5, 1e6])), 3)
    assert abs(moved - near) > 0.01 * near
    np.testing.assert_allclose(
        solver.solve(np.ones(4)), 1 / (np.array([0, near, 1e5, 1e6]) - moved)
    )


def star(n):
    """Return the Laplacian of a star, whose eigenvalues are 0, n - 2 times 1, and n."""
    ones = np.ones(n - 1)
    spokes = [[[[n - 1.0]], -ones[None]], [-ones[:, None], sp.eye_array(n - 1)]]
    return sp.csc_array(sp.block_array(spokes))


def test_a_search_that_runs_out_of_dimensions_says_so(monkeypatch):
    """Powers of the inverse reach three functions only: the rest of the space is rounding.

    With so many vertices and functions the last block falls between two looks.
    """
    monkeypatch.setattr(module, "_FIRST_LOOK", 8.0)  # earlier looks take time and change nothing
    with pytest.raises(np.linalg.LinAlgError, match=r"did not converge.*after 869"):
        laplacian_eigenbasis(star(873), np.full(873, 1 / 873), 108)


@pytest.mark.parametrize("k", [20, 90])
@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_laplacian_that_is_not_finite_is_a_failure_of_the_solver(value, k):
    stiffness = cycle(500).tolil()
    stiffness[5, 5] = value
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        laplacian_eigenbasis(sp.csc_array(stiffness), np.full(500, 1 / 500), k)


def test_a_mesh_whose_basis_does_not_converge_is_left_out(monkeypatch):
    """128 functions: the search ends at 193 dimensions, before the first look."""
    monkeypatch.setattr(module, "_MOST", 0.75)
    points = np.random.default_rng(0).standard_normal((1034, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    ball = Mesh(points, ConvexHull(points).simplices.astype(np.int64), name="ball")
    with pytest.warns(SkippedShapeWarning, match="ball"):
        (skipped,) = SpectralBasis(120, on_invalid="skip").transform([ball])
    assert "The eigenbasis of mesh 'ball' cannot be computed" in skipped.reason
    assert "did not converge" in skipped.reason


def test_eigenfunctions_that_are_not_numbers_are_refused():
    """Where coordinates have lost all digits, so have angles."""
    ball = make_sphere(n_subdivisions=3)
    faces = np.delete(ball.faces, np.random.default_rng(1).integers(0, len(ball.faces), 60), axis=0)
    mesh = Mesh(ball.vertices + 1e15, faces, "far")
    with pytest.raises(MeshError, match="mesh 'far'"):
        SpectralBasis(40).transform([mesh])
    with pytest.warns(SkippedShapeWarning, match="mesh 'far'"):
        (shape,) = SpectralBasis(40, on_invalid="skip").transform([mesh])
    assert isinstance(shape, SkippedShape)


def test_repeated_eigenvalues_give_one_space_whatever_the_mesh():
    """On a sphere whole spaces belong to one eigenvalue; rotations turn functions within."""
    sphere = make_sphere(n_subdivisions=4)
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    one, two = SpectralBasis(16).transform([sphere, Mesh(sphere.vertices @ turn.T, sphere.faces)])
    for first, last in ((1, 4), (4, 9), (9, 16)):
        overlap = one.evecs[:, first:last].T @ (one.mass[:, None] * two.evecs[:, first:last])
        np.testing.assert_allclose(overlap @ overlap.T, np.eye(last - first), atol=1e-8)


@pytest.mark.parametrize("n_components", [20, 64, 65])
def test_nearly_as_many_functions_as_vertices(n_components):
    sphere = make_sphere(n_subdivisions=2)  # 66 vertices
    (shape,) = SpectralBasis(n_components).transform([sphere])
    gram = shape.evecs.T @ (shape.mass[:, None] * shape.evecs)
    np.testing.assert_allclose(gram, np.eye(n_components), atol=1e-8)
    (probed,) = DescriptorTransformer().transform([shape])
    assert np.isfinite(probed.probes).all()
    with pytest.raises(MeshError, match="too few for n_components=66"):
        SpectralBasis(66).transform([sphere])


def test_an_eigen_solver_that_does_not_converge_is_an_error(monkeypatch):
    monkeypatch.setattr(module, "_MOST", 1.05)
    monkeypatch.setattr(module, "_FIRST_LOOK", 1.0)
    with pytest.raises(MeshError, match=r"The eigenbasis of mesh .*did not converge"):
        SpectralBasis(40).transform([make_sphere(4)])
