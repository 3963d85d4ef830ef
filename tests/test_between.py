"""Maps from one new shape to another, in what both have in common with the reference."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV

import skfmap
from skfmap import BridgedLearner, DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import RepairWarning, UnfamiliarShapeWarning
from skfmap.geometry.geodesics import edge_path_distances
from skfmap.model_selection import PinnedReference
from skfmap.refinement import ZoomOut
from skfmap.shapes import SkippedShape


@pytest.fixture(scope="module")
def learners(make_learner, probed, collection):
    """Return learners fitted on the first four bodies, by their refinement."""
    return {
        refine: make_learner(refine=refine).fit(probed[:4], collection.truths[:4])
        for refine in (None, "bijective-zoomout", "register")
    }


REFINED = pytest.mark.parametrize("refine", [None, "bijective-zoomout", "register"])


def error(collection, i, j, p2p):
    """Return the mean distance along edges, in sqrt(area), of a map from its known pairs."""
    mesh, joined = collection.meshes[j], collection.truths[i].join(collection.truths[j])
    vertices = mesh.vertices / np.sqrt(mesh.area)
    distances = edge_path_distances(vertices, mesh.faces, joined.vertices_0)
    return distances[np.arange(len(joined.points)), p2p[joined.vertices_i]].mean()


@REFINED
def test_a_shape_goes_to_itself_vertex_by_vertex(learners, probed, refine):
    (match,) = learners[refine].match_between(probed[4:], [(1, 1)])
    np.testing.assert_array_equal(match.p2p, np.arange(probed[5].spectral.n_given))
    np.testing.assert_array_equal(match.inverse, match.p2p)
    np.testing.assert_array_equal(match.matrix.argmax(axis=1), match.p2p)
    np.testing.assert_allclose(match.functional_map, np.eye(12), atol=1e-8)
    assert not match.expected_error.any()
    assert (match.confidence == 1).all()


@REFINED
def test_the_reference_is_one_shape_among_the_others(learners, probed, collection, refine):
    learner = learners[refine]
    there, back = learner.match_between([probed[0], probed[5]], [(1, 0), (0, 1)])
    (match,) = learner.match([probed[5]])
    truth = collection.truths[5].join(collection.truths[0])
    vertices_0 = probed[0].spectral.vertices
    apart = np.linalg.norm(vertices_0[there.p2p] - vertices_0[match.p2p], axis=1)
    off = np.linalg.norm(
        vertices_0[match.p2p[truth.vertices_i]] - vertices_0[truth.vertices_0], axis=1
    )
    assert apart.mean() < off.mean()
    assert there.reference_hash == match.reference_hash
    assert there.reference_name == match.reference_name == "body0"
    np.testing.assert_array_equal(back.p2p, there.inverse)


@REFINED
def test_errors_are_lower_than_through_the_vertices_of_the_reference(
    learners, probed, collection, refine
):
    learner, shapes = learners[refine], [1, 3, 4, 5]
    pairs = list(permutations(range(4), 2))
    direct = learner.match_between([probed[s] for s in shapes])
    single = learner.match([probed[s] for s in shapes])
    errors = [
        (
            error(collection, shapes[i], shapes[j], match.p2p),
            error(collection, shapes[i], shapes[j], single[i].to(single[j])[0]),
        )
        for (i, j), match in zip(pairs, direct, strict=True)
    ]
    between, chained = np.mean(errors, axis=0)
    assert between < 0.97 * chained
    for (i, j), match in zip(pairs, direct, strict=True):
        assert (match.name, match.reference_name) == (f"body{shapes[i]}", f"body{shapes[j]}")
        assert match.reference_hash == probed[shapes[j]].spectral.given_hash


@REFINED
def test_the_functional_map_pulls_functions_back(learners, probed, collection, refine):
    (match,) = learners[refine].match_between(probed[4:], [(0, 1)])
    one, other = (shape.spectral for shape in probed[4:])
    f = other.evecs[:, :12] @ np.random.default_rng(0).standard_normal((12, 4))
    pulled = (
        one.evecs[:, :12]
        @ match.functional_map
        @ (other.evecs[:, :12].T @ (other.mass[:, None] * f))
    )
    wanted = f[match.p2p]
    np.testing.assert_allclose(match.transfer(f), wanted)
    relative = np.linalg.norm(pulled - wanted) / np.linalg.norm(wanted)
    backwards = (
        one.evecs[:, :12]
        @ match.functional_map.T
        @ (other.evecs[:, :12].T @ (other.mass[:, None] * f))
    )
    assert relative < 0.2
    assert np.linalg.norm(backwards - wanted) / np.linalg.norm(wanted) > 1.3 * relative
    # The stable functions of the reference, as they are on the other and on the one.
    (first, second) = learners[refine].match(probed[4:])
    np.testing.assert_allclose(match.reduced_map, match.functional_map @ second.reduced_map)
    assert np.linalg.norm(match.reduced_map - first.reduced_map) < 0.2 * np.linalg.norm(
        first.reduced_map
    )


@REFINED
def test_errors_to_expect_combine_those_of_both_ends(learners, probed, refine):
    learner = learners[refine]
    (match,) = learner.match_between(probed[4:], [(0, 1)])
    first, second = learner.match(probed[4:])
    share = learner.confidence_.share_between_
    both = np.hypot(first.expected_error, second.expected_error[match.p2p])
    np.testing.assert_allclose(match.expected_error, share * both)
    assert 0 < share < np.sqrt(2)
    assert (match.confidence <= np.minimum(first.confidence, 1.0)).all()
    assert match.misfit == max(first.misfit, second.misfit)


def test_the_share_of_errors_between_is_known_in_closed_form(make_learner, probed, collection):
    """Where all shapes err alike none is left between them; a single one has nobody beside it."""
    alone = make_learner().fit(probed[:2], collection.truths[:2])
    assert alone.confidence_.share_between() == 1.0
    twice = [probed[0], *[probed[1]] * 3]
    alike = make_learner(confidence=skfmap.learner.CrossFitConfidence(cv=2)).fit(
        twice, [collection.truths[0], *[collection.truths[1]] * 3]
    )
    assert alike.confidence_.share_between() == pytest.approx(0.0, abs=1e-12)


def test_nothing_is_expected_without_confidence(make_learner, probed, collection):
    learner = make_learner(confidence=None).fit(probed[:3], collection.truths[:3])
    (match,) = learner.match_between(probed[4:], [(0, 1)])
    assert match.expected_error is match.confidence is match.familiar is None


@REFINED
def test_order_copies_and_numbers_of_jobs_change_nothing(learners, probed, make_learner, refine):
    learner = learners[refine]
    shapes = [probed[1], probed[4], probed[5]]
    matches = dict(zip(permutations(range(3), 2), learner.match_between(shapes), strict=True))
    order = [2, 0, 1]
    turned = learner.match_between([shapes[s] for s in order])
    for (i, j), match in zip(permutations(range(3), 2), turned, strict=True):
        before = matches[order[i], order[j]]
        np.testing.assert_array_equal(match.p2p, before.p2p)
        np.testing.assert_allclose(match.expected_error, before.expected_error)
    several = clone(learner)
    vars(several).update(vars(learner))
    several.n_jobs = 2
    for one, other in zip(several.match_between(shapes), matches.values(), strict=True):
        np.testing.assert_array_equal(one.p2p, other.p2p)
        np.testing.assert_array_equal(one.expected_error, other.expected_error)
    asked = learner.match_between(shapes, iter([(2, 0), (2, 0), (0, 2)]))
    assert asked[0] is asked[1]
    np.testing.assert_array_equal(asked[0].p2p, matches[2, 0].p2p)
    np.testing.assert_array_equal(asked[2].p2p, asked[0].inverse)


@REFINED
def test_names_may_be_repeated(learners, probed, refine):
    alike = [replace(shape, spectral=_named(shape.spectral, "scan")) for shape in probed[4:]]
    named = learners[refine].match_between(alike)
    plain = learners[refine].match_between(probed[4:])
    for one, other in zip(named, plain, strict=True):
        np.testing.assert_array_equal(one.p2p, other.p2p)
        assert one.name == one.reference_name == "scan"


def _named(spectral, name):
    return replace(spectral, mesh=Mesh(spectral.mesh.vertices, spectral.mesh.faces, name))


@REFINED
def test_renumbering_and_rotation_change_nothing(learners, probed, probe, collection, refine):
    rng = np.random.default_rng(7)
    moved, numbers = [], []
    for mesh in collection.meshes[4:]:
        number = rng.permutation(mesh.n_vertices)
        vertices = np.empty_like(mesh.vertices)
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        vertices[number] = 7 * np.array(mesh.vertices) @ (turn * np.linalg.det(turn)) + 3
        moved.append(Mesh(vertices, number[mesh.faces], mesh.name))
        numbers.append(number)
    (before,) = learners[refine].match_between(probed[4:], [(0, 1)])
    (after,) = learners[refine].match_between(probe(moved), [(0, 1)])
    vertices = probed[5].spectral.vertices
    back = np.argsort(numbers[1])[after.p2p[numbers[0]]]
    apart = np.linalg.norm(vertices[back] - vertices[before.p2p], axis=1)
    assert np.mean(back == before.p2p) > 0.9
    assert apart.mean() < 0.003


@pytest.mark.parametrize(
    ("pairs", "error", "message"),
    [
        ([(0, 2)], ValueError, r"index of pairs\[0\].*at most 1; got 2"),
        ([(0, 1), (-1, 0)], ValueError, r"index of pairs\[1\].*at least 0.*got -1"),
        ([(0, 1.0)], TypeError, r"index of pairs\[0\] must be an integer"),
        ([(0, True)], TypeError, r"index of pairs\[0\] must be an integer"),
        ([0, 1], TypeError, r"pairs must hold pairs \(i, j\).*pairs\[0\] is 0"),
        ([(0, 1, 0)], TypeError, r"pairs must hold pairs"),
        (3, TypeError, r"pairs must hold pairs"),
    ],
)
def test_pairs_that_are_no_pairs_of_indices_are_told(fitted, probed, pairs, error, message):
    with pytest.raises(error, match=message):
        fitted.match_between(probed[4:], pairs)


def test_no_pair_has_no_match(fitted, probed):
    assert fitted.match_between(probed[4:], []) == []
    assert fitted.match_between(probed[4:5]) == []
    (match,) = fitted.match_between(probed[4:], np.array([[0, 1]]))
    assert match.name == "body4"


def test_a_pipeline_a_search_and_a_bridge_answer_alike(make_model, collection):
    model = make_model(refine="bijective-zoomout").fit(collection.meshes[:4], collection.truths[:4])
    new = collection.meshes[4:]
    matches = skfmap.match_between(model, new)
    search = GridSearchCV(
        make_model(refine="bijective-zoomout"),
        {"learner__n_functions": [12]},
        cv=PinnedReference(2),
        error_score="raise",
    ).fit(collection.meshes[:4], collection.truths[:4])
    bridged = make_model(refine="bijective-zoomout")
    bridged.steps[-1] = ("learner", BridgedLearner(bridged[-1], through="body2"))
    bridged.fit(collection.meshes[:4], collection.truths[:4])
    for one, other in zip(skfmap.match_between(search, new), matches, strict=True):
        np.testing.assert_array_equal(one.p2p, other.p2p)
    found = skfmap.match_between(bridged, new, [(0, 1)])
    assert error(collection, 4, 5, found[0].p2p) < 2 * error(collection, 4, 5, matches[0].p2p)
    inner = bridged[-1].bridge_.match_between(bridged[:-1].transform(new), [(0, 1)])
    np.testing.assert_array_equal(found[0].p2p, inner[0].p2p)
    with pytest.raises(TypeError, match="Expected a WeightedFunctionalMapLearner"):
        skfmap.match_between(SpectralBasis(), new)


def test_shapes_of_unequal_bases_go_over_places_on_the_reference(make_learner, probed, collection):
    """ZoomOut then ends in another embedding for each."""
    zoomed = make_learner(refine=ZoomOut(), confidence=None).fit(probed[:4], collection.truths[:4])
    shapes = [replace(probed[4], spectral=probed[4].spectral.truncate(25)), probed[5]]
    (match,) = zoomed.match_between(shapes, [(0, 1)])
    first, second = zoomed.match(shapes)
    assert match.p2p.shape == first.p2p.shape
    chained = error(collection, 4, 5, first.to(second)[0])
    assert error(collection, 4, 5, match.p2p) < chained


@pytest.mark.parametrize("refine", ["bijective-zoomout", "register"])
def test_answers_are_on_given_meshes(make_learner, collection, refine):
    """Bodies of 2,400 vertices are thinned to 400."""
    fine = _fine(collection, [0, 1, 2, 4, 5])
    basis, probes = SpectralBasis(30, max_vertices=400), DescriptorTransformer()
    shapes = probes.transform(basis.transform([mesh for mesh, _ in fine]))
    truths = [collection.truths[i] for i in (0, 1, 2)]
    learner = make_learner(refine=refine).fit(shapes[:3], truths)
    fine, shapes = fine[3:], shapes[3:]
    there, back = learner.match_between(shapes)
    (one, at), (other, at_other) = fine
    assert there.p2p.shape == (one.n_vertices,)
    assert there.inverse.shape == there.matrix.shape[1:] == (other.n_vertices,)
    assert there.expected_error.shape == there.confidence.shape == there.p2p.shape
    assert there.reference_hash == other.content_hash
    np.testing.assert_array_equal(there.matrix.argmax(axis=1), there.p2p)
    for match, mesh, truth, answer in (
        (there, other, at, at_other),
        (back, one, at_other, at),
    ):
        landed = mesh.vertices[match.p2p[truth]] - mesh.vertices[answer]
        assert np.linalg.norm(landed, axis=1).mean() / np.sqrt(mesh.area) < 0.08
        assert len(np.unique(match.p2p)) > 1000, "between the vertices of the working mesh"


def _fine(collection, which):
    """Return bodies with each face cut into four, and their vertices at the template points."""
    out = []
    for i in which:
        mesh = collection.meshes[i]
        edges = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, 1)], 2).reshape(-1, 2), 1)
        ends, back = np.unique(edges, axis=0, return_inverse=True)
        middle = mesh.n_vertices + back.reshape(-1, 3)
        a, b, c = mesh.faces.T
        ab, bc, ca = middle.T
        faces = np.stack([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
        vertices = np.concatenate([mesh.vertices, mesh.vertices[ends].mean(axis=1)])
        mesh = Mesh(vertices, faces.transpose(0, 2, 1).reshape(-1, 3), mesh.name)
        out.append((mesh, collection.truths[i].pairs[:, 0]))
    return out


@pytest.mark.parametrize("confidence", ["cross-fit", None])
def test_a_shape_that_was_left_out_goes_nowhere(make_learner, probed, collection, confidence):
    learner = make_learner(confidence=confidence).fit(probed[:4], collection.truths[:4])
    shapes = [probed[4], SkippedShape("torn", "no face is left", 7), probed[5]]
    matches = learner.match_between(shapes)
    pairs = dict(zip(permutations(range(3), 2), matches, strict=True))
    (plain,) = learner.match_between(probed[4:], [(0, 1)])
    np.testing.assert_array_equal(pairs[0, 2].p2p, plain.p2p)
    n_i, k = probed[4].spectral.n_given, 12
    for match, shape in ((pairs[0, 1], (n_i, 7)), (pairs[1, 0], (7, n_i))):
        assert match.matrix.shape == shape
        assert match.functional_map.shape == (k, k)
        assert (match.p2p == -1).all()
        assert (match.inverse == -1).all()
        assert np.isnan(match.functional_map).all()
        assert (match.expected_error is None) == (confidence is None)
        if confidence is not None:
            assert np.isnan(match.expected_error).all()
            assert np.isnan(match.confidence).all()
        assert match.transfer(np.zeros(shape[1])).mask.all()
    assert pairs[1, 0].reference_hash == probed[4].spectral.given_hash


def test_vertices_that_were_removed_have_no_partner(make_learner, probed, collection):
    mesh = collection.meshes[5]
    loose = Mesh(np.vstack([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1, "loose")
    with pytest.warns(RepairWarning, match="loose"):
        spectral = SpectralBasis(30, on_invalid="mend").transform([collection.meshes[4], loose])
    shapes = DescriptorTransformer().transform(spectral)
    learner = make_learner().fit(probed[:4], collection.truths[:4])
    there, back = learner.match_between(shapes)
    plain = learner.match_between(probed[4:])
    assert back.p2p[0] == there.inverse[0] == -1
    assert np.isnan(back.expected_error[0])
    np.testing.assert_array_equal(there.p2p, plain[0].p2p + 1)
    np.testing.assert_array_equal(back.p2p[1:], plain[1].p2p)


def test_an_unfamiliar_shape_is_named_once(fitted, probed, probe):
    ball = probe([make_sphere(n_subdivisions=3)])[0]
    with pytest.warns(UnfamiliarShapeWarning, match=r"X\[2\]") as told:
        matches = fitted.match_between([*probed[4:], ball])
    assert sum(one.category is UnfamiliarShapeWarning for one in told) == 1
    familiar = dict(zip(permutations(range(3), 2), [one.familiar for one in matches], strict=True))
    assert {pair for pair, known in familiar.items() if known} == {(0, 1), (1, 0)}
    # Shapes that stand in no pair are not looked at.
    assert fitted.match_between([*probed[4:], ball], [(0, 1)])[0].familiar
