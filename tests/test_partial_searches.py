"""A matcher of parts as an estimator: scores, searches, cross-validation."""

import numpy as np
import pytest
import sklearn
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import Correspondence, PartialMatcher
from skfmap.datasets import make_creatures
from skfmap.metrics import GeodesicDistances, multi_scorer
from skfmap.model_selection import PinnedReference
from skfmap.partial import PlaneCut
from skfmap.partial.scoring import PartScorer, parts_to_score
from skfmap.persistence import load_model, save_model


@pytest.fixture(scope="module")
def creatures():
    return make_creatures(n_shapes=5, n_vertices=500, n_points=300)


@pytest.fixture(scope="module")
def unfitted():
    pipeline = make_pipeline(
        skfmap.SpectralBasis(30),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(n_functions=15, confidence=None, tol=1e-2),
    )
    return PartialMatcher(pipeline, cuts=["planes", "limbs"], n_cuts=2, n_calibrated=1)


@pytest.fixture(scope="module")
def model(unfitted, creatures):
    """Return a fitted matcher; do not fit it again or change it."""
    return clone(unfitted).fit(creatures.meshes[:4], creatures.correspondences[:4])


@pytest.fixture(scope="module")
def held_out(creatures):
    return creatures.meshes[4:], creatures.correspondences[4:]


def test_a_score_counts_a_whole_shape_as_much_as_its_parts(model, held_out):
    """By hand: the pipeline's score of the whole, and the errors of one part by each cut."""
    (mesh,), (truth,) = held_out
    parts = parts_to_score(mesh.vertices, mesh.faces, truth, [*_CUTS], 0)
    of_parts = [model.pair_errors([part], [known])[0].mean() for part, known in parts]
    whole = model.estimator_.score([mesh], [truth])
    score = model.score([mesh], [truth])
    assert score == pytest.approx((whole - np.mean(of_parts)) / 2)
    assert -1 < score < 0
    several = multi_scorer("neg_geodesic_error", "neg_consistent_geodesic_error")
    assert several(model, [mesh], [truth])["neg_geodesic_error"] == score


_CUTS = (PlaneCut(), skfmap.partial.LimbCut())


def test_parts_of_a_shape_are_the_same_wherever_it_stands_and_their_truth_lies_on_it(held_out):
    (mesh,), (truth,) = held_out
    parts = parts_to_score(mesh.vertices, mesh.faces, truth, _CUTS, 0)
    again = parts_to_score(mesh.vertices, mesh.faces, truth, _CUTS, 0)
    other = parts_to_score(mesh.vertices, mesh.faces, truth, _CUTS, 1)
    hashes = [[part.content_hash for part, _ in made] for made in (parts, again, other)]
    assert hashes[0] == hashes[1]
    assert not set(hashes[0]) & set(hashes[2])
    at = dict(zip(truth.pairs[:, 1], mesh.vertices[truth.pairs[:, 0]], strict=True))
    for part, known in parts:
        assert 0.2 < len(known.pairs) / len(truth.pairs) < 1
        corners = part.vertices[known.places.corners]
        points = np.einsum("nc,ncd->nd", known.places.weights, corners)
        assert np.allclose(points, [at[t] for t in known.pairs[:, 1]], atol=1e-6)


def test_shapes_have_weights_and_parts_as_given_count_as_they_are(model, creatures):
    meshes, truths = creatures.meshes[3:], creatures.correspondences[3:]
    one, other = (-errors.mean() for errors in model.errors_to_score(meshes, truths))
    weighted = model.score(meshes, truths, sample_weight=[1, 3])
    assert weighted == pytest.approx((one + 3 * other) / 4)
    ((part, known),) = parts_to_score(
        meshes[0].vertices, meshes[0].faces, truths[0], [PlaneCut(0.6, 0.6)], 5
    )
    (errors,) = model.pair_errors([part], [known])
    assert model.score([part], [known]) == -errors.mean()
    with pytest.raises(ValueError, match="X has 2 shapes, but y has 1"):
        model.score(meshes, truths[:1])


def test_saying_nothing_costs_as_much_as_answering_at_random(model, held_out):
    """The mean distance of all pairs of places of the reference, by their areas."""
    (mesh,), (truth,) = held_out
    ((part, known),) = parts_to_score(mesh.vertices, mesh.faces, truth, [PlaneCut(0.6, 0.6)], 5)
    (match,) = model.match([part])
    silent = match.p2p.copy()
    silent[len(silent) // 2 :] = -1
    scorer = PartScorer(model.estimator_[-1], "heat", None)
    errors = scorer.errors(skfmap.Match(silent, *[None] * 2, np.eye(1), np.eye(1)), known)
    reference = model.estimator_[-1].reference_.spectral
    targets = np.unique(model.estimator_[-1].reference_correspondence_.pairs[:, 0])
    rows = GeodesicDistances(reference.mesh).rows(targets)
    at_random = (rows.mean(axis=0) @ reference.mass) / reference.mass.sum()
    said_nothing = errors.vertices >= len(silent) // 2
    assert 0 < said_nothing.mean() < 1
    assert errors.direct[said_nothing] == pytest.approx(at_random, rel=1e-4)
    assert errors.direct[~said_nothing].mean() < 0.5 * at_random
    silent = np.full(len(silent), -1)  # of a scan that lies off the reference everywhere
    errors = scorer.errors(skfmap.Match(silent, *[None] * 2, np.eye(1), np.eye(1)), known)
    assert len(errors.direct)
    assert errors.mean() == pytest.approx(at_random, rel=1e-4)


@pytest.mark.filterwarnings("ignore:PartialMatcher learned from 2 shapes")
def test_a_search_pins_the_reference_and_reaches_into_the_pipeline(unfitted, creatures):
    grid = {
        "estimator__weightedfunctionalmaplearner__epsilon": ["auto"],
        "cuts": ["planes"],
    }
    search = GridSearchCV(unfitted, grid, cv=PinnedReference(2), error_score="raise")
    search.fit(creatures.meshes, creatures.correspondences)
    scores = [search.cv_results_[f"split{k}_test_score"][0] for k in range(2)]
    assert all(-0.6 < score < 0 for score in scores)
    scan = PlaneCut(0.6, 0.6).cut(creatures.meshes[4], np.random.default_rng(2))
    (match,) = skfmap.match(search, [scan])
    assert match.reference_name == creatures.meshes[0].name
    assert 0 < match.covered.mean() < 1


@pytest.mark.filterwarnings("ignore:PartialMatcher learned from 2 shapes")
def test_weights_are_routed_and_scores_are_the_same_for_any_number_of_jobs(unfitted, creatures):
    meshes, truths = creatures.meshes[:4], creatures.correspondences[:4]
    weight = np.array([1.0, 1, 2, 5])
    with sklearn.config_context(enable_metadata_routing=True):
        routed = (
            clone(unfitted)
            .set_fit_request(sample_weight=True)
            .set_score_request(sample_weight=True)
        )
        cv = [([0, 1, 2], [3, 2])]
        (score,) = cross_val_score(
            routed, meshes, truths, cv=cv, params={"sample_weight": weight}, error_score="raise"
        )
    by_hand = clone(unfitted).set_params(n_jobs=2)
    by_hand.fit(meshes[:3], truths[:3], sample_weight=weight[:3])
    assert by_hand.score([meshes[3], meshes[2]], [truths[3], truths[2]], [5, 2]) == score


def test_clones_and_files_score_alike(model, held_out, tmp_path):
    mesh, truth = held_out
    save_model(model, tmp_path / "model.skops")
    assert load_model(tmp_path / "model.skops").score(mesh, truth) == model.score(mesh, truth)
    again = clone(model)
    assert again.get_params().keys() == model.get_params().keys()
    assert repr(again) == repr(model)
    assert not hasattr(again, "body_")


def test_points_between_vertices_and_pairs_of_arrays_are_scored(model, held_out):
    (mesh,), (truth,) = held_out
    rows = np.argsort(truth.pairs[:, 1])[:40]
    points = Correspondence.from_points(mesh.vertices[truth.pairs[rows, 0]], mesh)
    numbered = model.score([(mesh.vertices, mesh.faces)], [truth.pairs[rows]])
    assert model.score([mesh], [points]) == pytest.approx(numbered, abs=0.01)
