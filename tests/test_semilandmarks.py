"""Points placed once on the reference: carried, and slid until a thin plate is bent least."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from skfmap import Landmarks, Match, Mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.closest import ClosestPoints
from skfmap.landmarks import bending_energy, carry_points, slide, stack_landmarks
from skfmap.landmarks.thin_plate import bending_matrix
from skfmap.shapes import Registered

BALL = make_sphere(n_subdivisions=3)
POINTS = np.random.default_rng(0).normal(size=(12, 3))


def _form(seed=0, strength=0.15):
    """Return the ball, stretched and bent in a way of its own."""
    random = np.random.default_rng(seed)
    v = BALL.vertices * [1.0, 1.3, 1.7] * (1 + 0.1 * random.normal(size=3))
    return Mesh(v + strength * random.normal() * np.sin(2 * v[:, [1, 2, 0]]), BALL.faces)


def _registered(vertices, fits=True, name=None):
    away = np.zeros(len(vertices))
    return Registered(
        vertices, BALL.faces, away, 0, 0.0, 0.0, 0.0, fits=fits, name=name, reference_name="ball"
    )


def _similar(points, seed=4):
    random = np.random.default_rng(seed)
    turn = Rotation.random(random_state=random).as_matrix()
    return 2.5 * points @ turn + random.normal(scale=9, size=3)


# Bending energy


def test_affine_maps_bend_nothing_and_all_others_do():
    random = np.random.default_rng(1)
    for _ in range(5):
        affine = POINTS @ random.normal(size=(3, 3)) + random.normal(size=3)
        assert bending_energy(affine, POINTS) < 1e-12
    L = bending_matrix(POINTS)
    energies = np.linalg.eigvalsh(L)
    assert_allclose(L, L.T, atol=1e-12)
    assert_allclose(energies[:4], 0, atol=1e-12)
    assert energies[4] > 0.01  # four affine functions are free, no others


def test_the_matrix_is_that_of_bookstein():
    """The upper left block of the inverse of the spline's system."""
    K = -np.linalg.norm(POINTS[:, None] - POINTS, axis=2)
    P = np.column_stack([np.ones(12), POINTS])
    system = np.block([[K, P], [P.T, np.zeros((4, 4))]])
    assert_allclose(bending_matrix(POINTS), np.linalg.inv(system)[:12, :12], atol=1e-10)


def test_the_matrix_gives_the_coefficients_of_scipys_spline():
    values = np.sin(POINTS)
    spline = RBFInterpolator(POINTS, values, kernel="linear", degree=1)
    centre = np.random.default_rng(2).normal(size=(5, 3))
    coefficients = bending_matrix(POINTS) @ values
    bent = -np.linalg.norm(centre[:, None] - POINTS, axis=2) @ coefficients
    rest = spline(centre) - bent  # must be affine, and the same function everywhere
    on_points = values + np.linalg.norm(POINTS[:, None] - POINTS, axis=2) @ coefficients
    P = np.column_stack([np.ones(12), POINTS])
    affine = np.linalg.lstsq(P, on_points)[0]
    assert_allclose(P @ affine, on_points, atol=1e-10)
    assert_allclose(np.column_stack([np.ones(5), centre]) @ affine, rest, atol=1e-9)


def test_energy_does_not_depend_on_where_both_lie_and_scales():
    bent = POINTS + 0.2 * np.sin(POINTS[:, ::-1])
    energy = bending_energy(bent, POINTS)
    assert_allclose(bending_energy(_similar(bent), POINTS), 2.5**2 * energy)
    assert_allclose(bending_energy(bent, _similar(POINTS)), energy / 2.5)


def test_flat_references_bend_by_what_leaves_the_plane_too():
    flat = POINTS * [1, 1, 0]
    assert bending_energy(flat @ np.diag([2, 3, 1]), flat) < 1e-12
    raised = flat.copy()
    raised[:, 2] = flat[:, 0] ** 2
    assert bending_energy(raised, flat) > 1e-3


def test_points_that_are_one_are_told():
    with pytest.raises(ValueError, match="Points 3 and 7 of the reference coincide"):
        bending_matrix(np.where(np.arange(12)[:, None] == 7, POINTS[3], POINTS))
    with pytest.raises(ValueError, match=r"both have shape \(n_landmarks, 3\)"):
        bending_energy(POINTS[:5], POINTS)


# Sliding

N_FIXED, N_SURFACE = 8, 25
FIXED = [f"f{i}" for i in range(N_FIXED)]
ON_SURFACE = [f"s{i}" for i in range(N_SURFACE)]


def _on(mesh, places):
    """Return points of a form at vertices of the ball, as landmarks and semilandmarks."""
    return Landmarks(mesh.vertices[places], FIXED + ON_SURFACE, name="one")


PLACES = np.random.default_rng(5).permutation(BALL.n_vertices)[: N_FIXED + N_SURFACE]


def _disturbed(mesh, strength=0.15, seed=6):
    """Return landmarks whose semilandmarks have slipped along the surface."""
    random = np.random.default_rng(seed)
    points = mesh.vertices[PLACES].copy()
    slipped = points[N_FIXED:] + strength * random.normal(size=(N_SURFACE, 3))
    points[N_FIXED:] = ClosestPoints(mesh.vertices, mesh.faces).of(slipped).points
    return Landmarks(points, FIXED + ON_SURFACE, name="one")


def test_slid_points_bend_less_stay_on_the_surface_and_fixed_ones_stay():
    forms = [_form(seed) for seed in range(4)]
    given = [_disturbed(mesh, seed=i) for i, mesh in enumerate(forms)]
    reference = Landmarks(BALL.vertices[PLACES], FIXED + ON_SURFACE)
    slid = slide(given, forms, surfaces=ON_SURFACE, reference=reference)
    for before, after, mesh in zip(given, slid, forms, strict=True):
        assert after.names == before.names
        assert after.name == before.name
        assert_array_equal(after.points[:N_FIXED], before.points[:N_FIXED])
        away = ClosestPoints(mesh.vertices, mesh.faces).of(np.array(after.points)).distances
        assert away.max() < 1e-12
        energy, energy_before = (
            bending_energy(one.points, reference.points) for one in (after, before)
        )
        assert energy < 0.6 * energy_before


def test_more_rounds_never_bend_more():
    mesh = _form(3)
    reference = Landmarks(BALL.vertices[PLACES], FIXED + ON_SURFACE)
    energies = [bending_energy(_disturbed(mesh).points, reference.points)]
    for n_rounds in (1, 2, 4, 8):
        (slid,) = slide(
            [_disturbed(mesh)],
            [mesh],
            surfaces=ON_SURFACE,
            reference=reference,
            n_rounds=n_rounds,
        )
        energies.append(bending_energy(slid.points, reference.points))
    assert (np.diff(energies) <= 0).all()


def _plane(n=9, reach=50.0):
    """Return a square in z = 0 that all points stay on."""
    x, y = np.meshgrid(np.linspace(-reach, reach, n), np.linspace(-reach, reach, n))
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return Mesh(np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)]), faces)


def _flat_problem(seed=0):
    """Return fixed points in space and semilandmarks in a plane, and what they are bent from."""
    random = np.random.default_rng(seed)
    names = [*"abcdef", *(f"s{i}" for i in range(10))]
    points = random.normal(size=(16, 3))
    points[6:, 2] = 0
    reference = Landmarks(points + 0.3 * random.normal(size=(16, 3)), names)
    return Landmarks(points, names), reference, names[6:]


def test_on_a_plane_one_round_finds_the_least_energy():
    """No movement in the plane bends less, and every one bends more than a parabola allows."""
    given, reference, sliding = _flat_problem()
    (slid,) = slide([given], [_plane()], surfaces=sliding, reference=reference, n_rounds=1)
    least = bending_energy(slid.points, reference.points)
    assert least < bending_energy(given.points, reference.points)
    random = np.random.default_rng(1)
    for step in (1e-3, 1e-1, 1.0):
        for _ in range(10):
            moved = slid.points.copy()
            move = step * random.normal(size=(10, 2))
            moved[6:, :2] += move
            # The energy is quadratic, and its gradient is zero there.
            rise = np.zeros((16, 3))
            rise[6:, :2] = move
            assert_allclose(
                bending_energy(moved, reference.points) - least,
                np.einsum("ia,ij,ja->", rise, bending_matrix(reference.points), rise),
                rtol=1e-4 if step > 1e-2 else 1e-2,
            )


def test_where_a_specimen_lies_and_how_large_it_is_does_not_matter():
    mesh = _form(2)
    given = _disturbed(mesh)
    reference = Landmarks(BALL.vertices[PLACES], FIXED + ON_SURFACE)
    (slid,) = slide([given], [mesh], surfaces=ON_SURFACE, reference=reference, n_rounds=2)
    moved = Mesh(_similar(mesh.vertices), mesh.faces)
    (other,) = slide(
        [Landmarks(_similar(given.points), given.names)],
        [moved],
        surfaces=ON_SURFACE,
        reference=Landmarks(_similar(reference.points, seed=8), reference.names),
        n_rounds=2,
    )
    assert_allclose(other.points, _similar(slid.points), atol=1e-6)


def test_specimens_that_differ_by_affine_maps_have_nothing_to_slide():
    base = _form(1)
    given, meshes = [], []
    for seed in range(4):
        A = np.eye(3) + 0.2 * np.random.default_rng(seed).normal(size=(3, 3))
        meshes.append(Mesh(base.vertices @ A, base.faces))
        given.append(_on(meshes[-1], PLACES))
    reference = _on(base, PLACES)
    for before, after in zip(
        given, slide(given, meshes, surfaces=ON_SURFACE, reference=reference), strict=True
    ):
        assert_allclose(after.points, before.points, atol=1e-6)


def test_without_a_reference_specimens_agree_on_their_mean():
    """Semilandmarks that slipped on copies of one form come nearer to each other."""
    mesh = _form(5)
    given = [_disturbed(mesh, seed=i) for i in range(6)]
    before, after = (
        stack_landmarks(one).std(axis=0).mean()
        for one in (given, slide(given, [mesh] * 6, surfaces=ON_SURFACE))
    )
    assert after < 0.7 * before


def test_a_specimen_counts_as_much_in_the_mean_whatever_its_size():
    mesh = _form(5)
    given = [_disturbed(mesh, seed=i) for i in range(3)]
    large = Mesh(100 * mesh.vertices, mesh.faces)
    scaled = [Landmarks(100 * given[0].points, given[0].names), *given[1:]]
    slid = slide(given, [mesh] * 3, surfaces=ON_SURFACE)
    other = slide(scaled, [large, mesh, mesh], surfaces=ON_SURFACE)
    assert_allclose(other[0].points, 100 * slid[0].points, atol=1e-5)
    for a, b in zip(slid[1:], other[1:], strict=True):
        assert_allclose(b.points, a.points, atol=1e-7)


def _helix(t):
    return np.column_stack([np.cos(t), np.sin(t), 0.5 * t])


def test_points_of_a_curve_slide_along_it():
    """A helix whose points were spaced unevenly: they end on its line, nearer to even spacing."""
    even = np.linspace(0, 4, 15)
    uneven = 4 * (even / 4) ** 1.4
    names = [*"abcde", *(f"c{i}" for i in range(15))]
    around = np.array([[2.0, 0, 0], [-2, 0, 1], [0, 2, 0], [0, -2, 2], [1, 1, 3]])
    reference = Landmarks(np.concatenate([around, _helix(even)]), names)
    given = Landmarks(np.concatenate([around, _helix(uneven)]), names)
    (slid,) = slide([given], curves=[names[5:]], reference=reference, n_rounds=30)
    assert_array_equal(slid.points[[*range(6), 19]], given.points[[*range(6), 19]])
    line, at = given.points[5:], slid.points[5:]
    starts, along = line[:-1], np.diff(line, axis=0)
    share = np.clip(
        np.einsum("psa,sa->ps", at[:, None] - starts, along) / np.square(along).sum(axis=1), 0, 1
    )
    away = np.linalg.norm(starts + share[:, :, None] * along - at[:, None], axis=2).min(axis=1)
    assert away.max() < 1e-12
    angle = at[:, 2] / 0.5
    assert np.abs(angle - even).max() < 0.3 * np.abs(uneven - even).max()


def test_curves_lie_on_meshes_where_these_are_given():
    mesh = _form(4)
    ring = np.flatnonzero(np.abs(BALL.vertices[:, 2]) < 1e-9)
    ring = ring[np.argsort(np.arctan2(*BALL.vertices[ring, :2].T))]
    names = [f"c{i}" for i in range(len(ring))]
    poles = (BALL.vertices @ np.array([[0, 0, 1.0], [0, 0, -1], [0, 0.5, 0.8]]).T).argmax(axis=0)
    every = [*names, *"xyz"]
    places = np.concatenate([ring, poles])
    given = Landmarks(mesh.vertices[places], every)
    reference = Landmarks(BALL.vertices[places] + 0.01, every)
    closed = [*names, names[0]]
    (slid,) = slide([given], [mesh], curves=[closed], reference=reference)
    assert ClosestPoints(mesh.vertices, mesh.faces).of(slid.points[: len(ring)]).distances.max() < (
        1e-12
    )
    assert_array_equal(slid.points[0], given.points[0])
    assert np.abs(slid.points[1 : len(ring)] - given.points[1 : len(ring)]).max() > 1e-3


def test_a_missing_fixed_landmark_costs_that_landmark_alone():
    mesh = _form(2)
    reference = Landmarks(BALL.vertices[PLACES], FIXED + ON_SURFACE)
    full = _disturbed(mesh)
    gap = full.points.copy()
    gap[2] = np.nan
    keep = np.arange(len(PLACES)) != 2
    names = [name for name in full.names if name != "f2"]
    with_gap, without = (
        slide([one], [mesh], surfaces=ON_SURFACE, reference=reference)[0].points
        for one in (Landmarks(gap, full.names), Landmarks(full.points[keep], names))
    )
    assert np.isnan(with_gap[2]).all()
    assert_allclose(with_gap[keep], without, atol=1e-12)


def test_so_few_points_that_nothing_bends_stay():
    names = ["a", "between", "b", "c"]
    one = Landmarks([[0, 0, 0], [1, 0, 0], [3, 0, 0], [0, 1, 0]], names)
    for reference in (None, Landmarks(POINTS[:4], names)):
        (slid,) = slide([one], curves=[names[:3]], reference=reference)
        assert_allclose(slid.points, one.points, atol=1e-12)


def test_what_cannot_slide_is_told():
    mesh = _form(2)
    one = _disturbed(mesh)
    with pytest.raises(CorrespondenceError, match="There is no landmark tail"):
        slide([one], [mesh], surfaces=["tail"])
    with pytest.raises(CorrespondenceError, match="s1 slides on two curves, or on a curve and"):
        slide([one], [mesh], surfaces=["s1"], curves=[["f0", "s1", "f1"]])
    with pytest.raises(CorrespondenceError, match="The curve f0, f1 has no point between"):
        slide([one], [mesh], curves=[["f0", "f1"]])
    with pytest.raises(ValueError, match="Nothing slides"):
        slide([one], [mesh])
    with pytest.raises(ValueError, match="give one mesh per specimen"):
        slide([one], surfaces=["s1"])
    with pytest.raises(ValueError, match="1 specimens but 2 meshes"):
        slide([one], [mesh, mesh], surfaces=["s1"])
    with pytest.raises(TypeError, match="surfaces must be a list of names"):
        slide([one], [mesh], surfaces="s1")
    with pytest.raises(CorrespondenceError, match="belongs to this specimen"):
        slide([one], [Mesh(mesh.vertices[:, ::-1] * 2 + 3, mesh.faces)], surfaces=["s1"])
    gap = one.points.copy()
    gap[N_FIXED + 1] = np.nan
    with pytest.raises(CorrespondenceError, match="one lacks 's1', which slides"):
        slide([Landmarks(gap, one.names, name="one")], [mesh], surfaces=["s1"])


# Carrying


def _middles(n=7):
    """Return points inside faces of the ball: which face, and their weights."""
    random = np.random.default_rng(3)
    face = random.choice(BALL.n_faces, n, replace=False)
    return face, random.dirichlet(np.ones(3), n)


def test_points_go_where_their_triangles_go():
    face, weights = _middles()
    points = Landmarks(np.einsum("nc,nca->na", weights, BALL.vertices[BALL.faces[face]]))
    form = _form(1)
    onto = [_registered(form.vertices, name="form"), _registered(BALL.vertices * 3)]
    first, second = carry_points(onto, points, BALL)
    there = np.einsum("nc,nca->na", weights, form.vertices[BALL.faces[face]])
    assert_allclose(first.points, there, atol=1e-12)
    assert_allclose(second.points, 3 * points.points, atol=1e-12)
    assert (first.name, first.names) == ("form", points.names)


def test_points_are_put_onto_the_specimens_own_surface():
    face, weights = _middles()
    points = Landmarks(np.einsum("nc,nca->na", weights, BALL.vertices[BALL.faces[face]]))
    fine = make_sphere(n_subdivisions=4)
    (there,) = carry_points([_registered(BALL.vertices * 1.01)], points, BALL, [fine])
    nearest = ClosestPoints(fine.vertices, fine.faces).of(1.01 * points.points)
    assert_allclose(there.points, nearest.points, atol=1e-12)


def test_matches_carry_points_by_the_vertices_that_match():
    face, weights = _middles()
    points = Landmarks(np.einsum("nc,nca->na", weights, BALL.vertices[BALL.faces[face]]))
    n = BALL.n_vertices
    order = np.random.default_rng(0).permutation(n)  # vertex of the ball for each of the other's
    form = _form(1)
    new = np.argsort(order)
    other = Mesh(form.vertices[order], new[BALL.faces], name="other")
    matrix = sp.csr_array((np.ones(n), (np.arange(n), order)))
    match = Match(order, None, None, np.eye(1), np.eye(1), "other", matrix=matrix, inverse=new)
    (there,) = carry_points([match], points, BALL, [other])
    expected = np.einsum("nc,nca->na", weights, form.vertices[BALL.faces[face]])
    assert_allclose(there.points, expected, atol=1e-12)
    with pytest.raises(ValueError, match="'other': a match needs the shape's own mesh"):
        carry_points([match], points, BALL)


def test_missing_points_stay_missing_and_so_do_shapes_that_were_left_out():
    at = BALL.vertices[:4].copy()
    at[1] = np.nan
    left_out = _registered(np.full_like(BALL.vertices, np.nan), fits=False)
    laid = [_registered(BALL.vertices), left_out]
    good, none = carry_points(laid, Landmarks(at), BALL, [BALL, BALL])
    assert_allclose(good.points, at, atol=1e-12)
    assert not none.placed.any()


def test_another_reference_and_shapes_that_do_not_fit_are_refused():
    points = Landmarks(BALL.vertices[:4])
    with pytest.raises(MeshError, match="'bad': the reference does not fit"):
        carry_points([_registered(BALL.vertices, fits=False, name="bad")], points, BALL)
    other = make_sphere(n_subdivisions=1)
    with pytest.raises(MeshError, match="has 258 vertices and is not the given mesh"):
        carry_points([_registered(BALL.vertices)], Landmarks(other.vertices[:2]), other)
    with pytest.raises(CorrespondenceError, match="divided by 1000"):
        carry_points([_registered(BALL.vertices)], Landmarks(1000 * points.points), BALL)
    elsewhere = Mesh(BALL.vertices + 5, BALL.faces)
    with pytest.raises(CorrespondenceError, match="belongs to this specimen"):
        carry_points([_registered(BALL.vertices)], points, BALL, [elsewhere])
    with pytest.raises(TypeError, match="must come from skfmap"):
        carry_points([BALL], points, BALL)
    with pytest.raises(ValueError, match="1 shapes but 2 meshes"):
        carry_points([_registered(BALL.vertices)], points, BALL, [BALL, BALL])
