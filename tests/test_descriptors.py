"""Probe functions: counts, invariances, and what oriented ones see."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.descriptors import (
    DiffusedCurvature,
    FunctionProbes,
    HeatKernelSignature,
    MeshSaliency,
    OrientedProducts,
    WaveKernelSignature,
    default_families,
    paper_families,
)
from skfmap.exceptions import MeshError, OrientationWarning


def functions(mesh, families=None, laplacian="cotangent"):
    """Return probe functions on vertices, which do not depend on signs of eigenfunctions."""
    (shape,) = DescriptorTransformer(families).transform(
        SpectralBasis(30, laplacian=laplacian).transform([mesh])
    )
    return shape.functions()


def assert_close(after, before, tolerance=1e-6):
    np.testing.assert_allclose(after, before, atol=tolerance * np.abs(before).max(axis=0).max())


@pytest.mark.parametrize(("families", "n_probes"), [("paper", 50), ("paper-310", 310), (None, 105)])
def test_counts_are_those_of_the_paper(families, n_probes, collection):
    transformer = DescriptorTransformer(families)
    (shape,) = transformer.transform(SpectralBasis(20).transform(collection.meshes[:1]))
    assert shape.probes.shape == (20, n_probes)
    assert len(transformer.get_feature_names_out()) == len(set(shape.probe_names)) == n_probes
    assert list(shape.probe_categories) == list(transformer.probe_categories_)


def test_nine_categories_of_five_and_ten_of_saliency():
    categories = list(DescriptorTransformer("paper").probe_categories_)
    counts = {name: categories.count(name) for name in categories}
    assert len(counts) == 9
    assert counts.pop("saliency") == 10
    assert set(counts.values()) == {5}
    assert [name for name, _ in default_families()] == [
        *(name for name, _ in paper_families()),
        "oriented",
    ]


@pytest.mark.parametrize("laplacian", ["cotangent", "robust"])
def test_probes_do_not_change_under_rotation_and_scaling(laplacian, collection):
    mesh = collection.meshes[0]
    rotation = Rotation.random(random_state=np.random.default_rng(1))
    moved = Mesh(37 * rotation.apply(np.array(mesh.vertices)) - [5, 0, 3], mesh.faces)
    for name, family in default_families():
        before = functions(mesh, [(name, family)], laplacian)
        after = functions(moved, [(name, family)], laplacian)
        for j in range(before.shape[1]):
            assert_close(after[:, [j]], before[:, [j]], 1e-5)


def test_probes_follow_a_renumbering(collection):
    mesh = collection.meshes[0]
    new_number = np.random.default_rng(2).permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[new_number] = mesh.vertices
    before, after = functions(mesh), functions(Mesh(vertices, new_number[mesh.faces]))
    for j in range(before.shape[1]):
        assert_close(after[new_number][:, [j]], before[:, [j]], 1e-5)


def test_a_reflection_flips_oriented_probes_and_no_others(collection):
    mesh = collection.meshes[0]
    mirrored = Mesh(
        mesh.vertices * [1, -1, 1], mesh.faces
    )  # the faces are turned outwards again inside
    assert_close(functions(mirrored, "paper"), functions(mesh, "paper"), 1e-6)
    oriented = [("oriented", OrientedProducts(5))]
    assert_close(functions(mirrored, oriented), -functions(mesh, oriented), 1e-6)


def test_an_inside_out_mesh_has_the_probes_of_the_outward_one(collection):
    mesh = collection.meshes[0]
    assert_close(functions(Mesh(mesh.vertices, mesh.faces[:, ::-1])), functions(mesh), 1e-6)


def test_symmetric_probes_are_symmetric_and_oriented_ones_antisymmetric():
    sphere = make_sphere(3)
    body = Mesh(
        sphere.vertices
        * (1 + 0.5 * np.exp(4 * sphere.vertices @ [0.6, 0, 0.8] - 4))[:, None]
        * [2, 1, 0.7],
        sphere.faces,
    )
    partner = np.array(
        [
            np.flatnonzero(np.linalg.norm(body.vertices - v * [1, -1, 1], axis=1) < 1e-9)[0]
            for v in body.vertices
        ]
    )
    for families, sign in (("paper", 1), ([("oriented", OrientedProducts(6))], -1)):
        values = functions(body, families)
        centred = values - values.mean(axis=0)
        assert np.linalg.norm(centred[partner] - sign * centred) < 0.05 * np.linalg.norm(centred)


def test_probes_vary_little_with_the_meshing(probed):
    # The same body, meshed differently and twisted by 0.1: the largest functions keep their
    # coefficients' norms.
    norms = np.array([np.linalg.norm(shape.probes[1:12, :20], axis=0) for shape in probed[:2]])
    assert np.abs(np.log(norms[0] / norms[1])).max() < 0.5


def test_oriented_probes_need_a_winding():
    # Three sheets that meet in one edge.
    angles = np.radians([0, 120, 240])
    wing = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    vertices = np.array([[0, 0, 0], [0, 0, 1], *wing, *(wing + np.array([0, 0, 1]))])
    faces = [face for i in range(3) for face in ([0, 1, 2 + i], [1, 5 + i, 2 + i])]
    with pytest.warns(OrientationWarning, match="fins"):
        shapes = SpectralBasis(4, laplacian="robust", on_invalid="raise").transform(
            [Mesh(vertices, faces, "fins")]
        )
    with pytest.raises(MeshError, match=r"'fins' cannot be wound consistently.*'paper'"):
        DescriptorTransformer().transform(shapes)
    (shape,) = DescriptorTransformer("paper").transform(shapes)
    assert np.isfinite(shape.probes).all()


@pytest.mark.parametrize(
    ("family", "message"),
    [
        (HeatKernelSignature(0), "n_functions"),
        (HeatKernelSignature(t_min=0), "t_min"),
        (HeatKernelSignature(t_min=2, t_max=1), "t_max must be at least t_min"),
        (WaveKernelSignature(sigma=0), "sigma"),
        (WaveKernelSignature(lambda_min=-1), "lambda_min"),
        (DiffusedCurvature("principal"), "kind"),
        (DiffusedCurvature(percentile=50), "percentile"),
        (DiffusedCurvature(floor=0), "floor"),
        (MeshSaliency(sigma_max=0.001), "sigma_max must be at least"),
        (OrientedProducts(1), "n_sources"),
    ],
)
def test_bad_parameters_are_named(family, message, collection):
    shapes = SpectralBasis(5).transform(collection.meshes[:1])
    with pytest.raises(ValueError, match=message):
        DescriptorTransformer([("it", family)]).fit(shapes)


def test_a_family_works_by_itself(collection):
    shapes = SpectralBasis(10).transform(collection.meshes[:2])
    first, second = HeatKernelSignature(3).fit(shapes).transform(shapes)
    assert first.shape == second.shape == (10, 3)
    stacked = DescriptorTransformer([("hks", HeatKernelSignature(3))]).transform(shapes)[1].probes
    np.testing.assert_array_equal(stacked, second)


def test_parallel_gradients_leave_nothing_rather_than_noise(collection):
    # With one energy twice, both gradients are the same up to rounding.
    (shape,) = SpectralBasis(20).transform(collection.meshes[:1])
    family = OrientedProducts(2, lambda_min=20.0, lambda_max=20.0 * (1 + 1e-12))
    assert (family.coefficients(shape) == 0).all()
    assert (
        np.linalg.norm(OrientedProducts(2, lambda_min=20.0, lambda_max=60.0).coefficients(shape))
        > 1e-3
    )


def test_probes_that_are_no_numbers_are_named(probed):
    shape = probed[0].spectral

    def half(given):
        return np.where(given.vertices[:, 0] > 0, np.nan, 1.0)

    for function in (half, lambda given: given.vertices[:, 0] * 1j):
        with pytest.raises(
            ValueError, match=r"FunctionProbes.*body0|must hold real numbers|finite"
        ):
            DescriptorTransformer([("own", FunctionProbes(function))]).transform([shape])


def test_functions_without_a_name_are_told_apart(probed, collection, make_learner):
    """Two lambdas are two probes, though both are called <lambda>."""
    shapes = [shape.spectral for shape in probed]
    one, other = (
        DescriptorTransformer(
            [("hks", HeatKernelSignature()), ("own", FunctionProbes(function))]
        ).transform(shapes)
        for function in (lambda shape: shape.vertices[:, 0], lambda shape: shape.vertices[:, 1])
    )
    learner = make_learner(weighting=None).fit(one[:3], collection.truths[:3])
    learner.predict(one[3:])
    with pytest.raises(ValueError, match="computed with different parameters"):
        learner.predict(other[3:])
