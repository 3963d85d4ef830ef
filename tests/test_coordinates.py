"""Positions and normals as probe functions of aligned shapes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.descriptors import Coordinates, default_families
from skfmap.exceptions import MeshError, OrientationWarning
from skfmap.learner.diagnostics import is_mirrored
from skfmap.learner.mirrored import mirror_image, odd_probes

FAMILIES = [*default_families(), ("coordinates", Coordinates())]


def _spectral(mesh, n_components=16):
    return SpectralBasis(n_components).transform([mesh])[0]


def test_on_the_sphere_of_unit_area_in_closed_form():
    # x, y and z are eigenfunctions of 8 pi, of mean square r^2 / 3 = 1 / (12 pi); so are the
    # normals, which are the positions over r.
    shape = _spectral(make_sphere(4))
    probes = Coordinates().coefficients(shape)
    np.testing.assert_allclose((probes**2).sum(axis=0)[:3], 1 / (12 * np.pi), rtol=1e-2)
    np.testing.assert_allclose(probes[:, 3:], probes[:, :3] * np.sqrt(4 * np.pi), atol=1e-3)
    outside = np.delete(probes, [1, 2, 3], axis=0)
    assert np.abs(outside).max() < 5e-3 * np.abs(probes).max()
    time = 0.02
    smoothed = Coordinates(time=time).coefficients(shape)
    np.testing.assert_allclose(
        smoothed[1:4], np.exp(-8 * np.pi * time) * probes[1:4], rtol=5e-3, atol=1e-6
    )


def test_positions_are_those_of_the_shape_but_for_place_and_size(collection):
    mesh = collection.meshes[0]
    moved = Mesh(37 * mesh.vertices + [5, -3, 100], mesh.faces)
    before, after = (
        shape.evecs @ Coordinates().coefficients(shape) for shape in map(_spectral, (mesh, moved))
    )
    np.testing.assert_allclose(after, before, atol=1e-8)


def test_turned_shapes_have_turned_coordinates(collection):
    mesh, rotation = collection.meshes[0], Rotation.random(random_state=3)
    turned = Mesh(rotation.apply(np.array(mesh.vertices)), mesh.faces)
    before, after = (
        shape.evecs @ Coordinates().coefficients(shape) for shape in map(_spectral, (mesh, turned))
    )
    for columns in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(after[:, columns], rotation.apply(before[:, columns]), atol=1e-6)


def test_normals_point_outwards_and_can_be_left_out(collection):
    # By the divergence theorem the flux of x outwards is three times the volume: positive.
    shape = _spectral(collection.meshes[0], 30)
    probes = Coordinates().coefficients(shape)
    assert (probes[:, :3] * probes[:, 3:]).sum() > 0
    alone = Coordinates(normals=False)
    assert alone.labels() == ["x", "y", "z"]
    unsided = replace(shape, oriented=False)
    for one in (shape, unsided):
        np.testing.assert_allclose(alone.coefficients(one), probes[:, :3], atol=1e-14)
    with pytest.raises(MeshError, match=r"'body0'.*Coordinates\(normals=False\)"):
        Coordinates().coefficients(unsided)


def test_they_are_never_in_the_default():
    assert not any(isinstance(family, Coordinates) for _, family in default_families())


@pytest.mark.parametrize(
    ("given", "error"), [({"normals": "yes"}, TypeError), ({"time": -1.0}, ValueError)]
)
def test_parameters_that_cannot_be_used(given, error):
    with pytest.raises(error, match=next(iter(given))):
        Coordinates(**given).check_parameters()


def test_the_mirror_image_has_the_coordinates_of_its_mesh(collection, probe):
    (shape,) = probe(collection.meshes[:1], FAMILIES)
    image = mirror_image(shape)
    (again,) = DescriptorTransformer(FAMILIES).transform([image.spectral])
    scale = np.abs(again.probes).max(axis=0)
    np.testing.assert_allclose(image.probes / scale, again.probes / scale, atol=1e-7)
    changed = np.array(shape.probe_names)[(image.probes != shape.probes).any(axis=0)]
    assert {name for name in changed if not name.startswith("oriented")} == {
        "coordinates[x]",
        "coordinates[normal_x]",
    }
    assert not odd_probes(shape)[-6:].any()


def test_mirrored_shapes_are_found_beside_coordinates(collection, probe, make_learner):
    mesh = collection.meshes[5]
    mirrored = Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], name="mirrored")
    shapes = probe([*collection.meshes, mirrored], FAMILIES)
    learner = make_learner(on_mirrored="reflect").fit(shapes[:4], collection.truths[:4])
    (expected,) = learner.match([shapes[5]])
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[0\] \('mirrored'\)"):
        (match,) = learner.match([shapes[6]])
    np.testing.assert_array_equal(match.p2p, expected.p2p)


def test_that_a_shape_is_mirrored_is_told_by_its_surface_however_it_stands(
    collection, probe, make_learner
):
    rotation = Rotation.random(random_state=5)
    mesh = collection.meshes[5]
    images = [
        Mesh(turn(mesh.vertices * [-1, 1, 1]), mesh.faces[:, ::-1])
        for turn in (np.array, rotation.apply)
    ]
    shapes = probe([*collection.meshes[:4], mesh, *images], FAMILIES)
    matcher = make_learner(confidence=None).fit(shapes[:4], collection.truths[:4]).matcher_
    upright, *turned = (matcher.solve(shape, mirrored=True) for shape in shapes[4:])
    assert not is_mirrored(upright)
    assert all(map(is_mirrored, turned))
    for solution in turned:
        np.testing.assert_allclose(solution.mirrored_residual, upright.upright_residual, rtol=1e-3)
        np.testing.assert_allclose(solution.upright_residual, upright.mirrored_residual, rtol=1e-3)
    assert turned[1].residual > 1.5 * upright.residual, "coordinates see how it stands"


def test_coordinates_tell_apart_what_the_surface_cannot(make_learner):
    # An ellipsoid is its own image under rotations by half a turn; in space its ends are two.
    sphere = make_sphere(3)
    meshes = [
        Mesh(sphere.vertices * np.array(axes), sphere.faces, name=f"ellipsoid{i}")
        for i, axes in enumerate([(2, 1.4, 1), (2.1, 1.4, 1), (2, 1.5, 1), (2, 1.4, 1.05)])
    ]
    truths = [np.stack([np.arange(sphere.n_vertices)] * 2, axis=1)] * 4
    spectral = SpectralBasis(20).transform(meshes)
    families = [("coordinates", Coordinates())]
    shapes = DescriptorTransformer(families).transform(spectral)
    learner = make_learner(confidence=None, memory=None).fit(shapes[:3], truths[:3])
    assert -learner.score(shapes[3:], truths[3:]) < 0.02
