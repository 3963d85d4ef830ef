"""The estimators as scikit-learn's citizens, and what they promise about matches."""

from collections import Counter
from contextlib import nullcontext
from dataclasses import replace

import joblib
import numpy as np
import pytest
import sklearn
from numpy.testing import assert_array_equal
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.utils import estimator_html_repr
from sklearn.utils.validation import check_is_fitted

import skfmap
import skfmap.basis
import skfmap.descriptors
from skfmap import DescriptorTransformer, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.descriptors import HeatKernelSignature, ProbeFamily, WaveKernelSignature
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.functional.regularization import laplacian_mask
from skfmap.metrics import geodesic_error, reference_distances

LEARNED = ("weights_", "stable_basis_", "stability_", "epsilon_", "loss_", "loss_curve_", "n_iter_")


def assert_same_learning(one, other):
    for attribute in LEARNED:
        assert_array_equal(getattr(one, attribute), getattr(other, attribute), err_msg=attribute)


@pytest.fixture
def spectral(probed):
    return [shape.spectral for shape in probed]


# Parameters


@pytest.mark.parametrize(
    "estimator", [SpectralBasis, DescriptorTransformer, WeightedFunctionalMapLearner]
)
def test_clone_and_parameters(estimator):
    first = estimator()
    assert clone(first).get_params(deep=False) == first.get_params(deep=False)
    for name, value in first.get_params(deep=False).items():
        marked = clone(first).set_params(**{name: "marked"})
        assert getattr(marked, name) == "marked"  # stored as given, checked at fit only
        assert getattr(first, name) == value
    with pytest.raises(ValueError, match="nothing"):
        first.set_params(nothing=1)


def test_repr_shows_what_was_changed():
    assert (
        repr(WeightedFunctionalMapLearner(n_functions=12))
        == "WeightedFunctionalMapLearner(n_functions=12)"
    )
    assert repr(DescriptorTransformer("paper")) == "DescriptorTransformer(families='paper')"
    assert repr(SpectralBasis(30)) == "SpectralBasis(n_components=30)"
    assert "HeatKernelSignature(n_functions=3)" in repr(
        DescriptorTransformer([("hks", HeatKernelSignature(3))])
    )


@pytest.mark.parametrize("families", [None, "paper", [("hks", HeatKernelSignature())]])
def test_html_repr_of_a_pipeline(families, make_learner, fitted):
    for learner in (make_learner(), fitted):
        html = estimator_html_repr(
            make_pipeline(SpectralBasis(), DescriptorTransformer(families), learner)
        )
        for name in ("SpectralBasis", "DescriptorTransformer", "WeightedFunctionalMapLearner"):
            assert name in html


def test_nested_parameters_of_families():
    transformer = DescriptorTransformer("paper")
    assert transformer.get_params()["hks__n_functions"] == 5
    assert "hks__n_functions" not in transformer.get_params(deep=False)
    assert transformer.set_params(hks__n_functions=3, wks_wide__sigma=0.7) is transformer
    assert transformer.get_params()["hks__n_functions"] == 3
    assert transformer.get_params()["wks_wide__sigma"] == 0.7
    assert len(transformer.get_feature_names_out()) == 48
    assert Counter(transformer.probe_categories_)["hks"] == 3


def test_expanding_a_shorthand_changes_nobody_else():
    original = DescriptorTransformer("paper")
    copy = clone(original).set_params(hks__n_functions=3)
    assert original.families == "paper"
    assert original.get_params()["hks__n_functions"] == 5
    third = clone(copy).set_params(hks__n_functions=2)
    assert copy.get_params()["hks__n_functions"] == 3
    assert len(third.get_feature_names_out()) == 47


def test_setting_a_parameter_leaves_the_users_families_alone():
    mine = [("a", HeatKernelSignature(3)), ("b", WaveKernelSignature(4))]
    transformer = DescriptorTransformer(mine)
    assert transformer.families is mine
    transformer.set_params(a__n_functions=7)
    assert mine[0][1].n_functions == 3
    assert len(transformer.get_feature_names_out()) == 11


def test_shorthand_and_nested_parameter_in_one_call():
    transformer = DescriptorTransformer().set_params(families="paper", hks__n_functions=2)
    assert len(transformer.get_feature_names_out()) == 47
    assert "oriented" not in transformer.get_params()


def test_a_family_can_be_replaced():
    transformer = DescriptorTransformer("paper").set_params(hks=HeatKernelSignature(2))
    assert len(transformer.get_feature_names_out()) == 47


def test_an_unknown_nested_parameter_is_refused():
    transformer = DescriptorTransformer("paper")
    for wrong in ({"hks__n_moments": 3}, {"heat__n_functions": 3}):
        with pytest.raises(ValueError, match="Invalid parameter"):
            transformer.set_params(**wrong)
    assert len(transformer.get_feature_names_out()) == 50


@pytest.mark.parametrize(("families", "n"), [(None, 105), ("paper", 50), ("paper-310", 310)])
def test_number_of_probes(families, n):
    transformer = DescriptorTransformer(families)
    names = transformer.get_feature_names_out()
    assert len(names) == len(set(names)) == len(transformer.probe_categories_) == n
    assert all(
        name.startswith(category + "[")
        for name, category in zip(names, transformer.probe_categories_, strict=True)
    )


@pytest.mark.parametrize("names", [("a", "a"), ("memory", "b"), ("a__b", "c")])
def test_unusable_names_of_families_are_refused(names, spectral):
    with pytest.raises(ValueError, match="ames"):
        DescriptorTransformer([(name, HeatKernelSignature()) for name in names]).fit(spectral)


class Coordinates(ProbeFamily):
    """A user's own family: it is not invariant, but it is one."""

    def check_parameters(self):
        pass

    def labels(self):
        return ["x", "y"]

    def coefficients(self, shape):
        return shape.evecs.T @ (shape.mass[:, None] * shape.vertices[:, :2])


def test_own_families_take_part(spectral):
    probed = DescriptorTransformer(
        [("heat", HeatKernelSignature(2)), ("place", Coordinates())]
    ).transform(spectral[:1])
    assert probed[0].probe_names[2:] == ("place[x]", "place[y]")
    assert_array_equal(
        probed[0].probes[:, 2:], Coordinates().fit(spectral).transform(spectral[:1])[0]
    )


# Interface


def test_transformers_need_no_fit_and_fit_returns_self(collection, spectral):
    basis, descriptors = SpectralBasis(15), DescriptorTransformer("paper")
    check_is_fitted(basis)
    check_is_fitted(descriptors)
    assert basis.fit(collection.meshes) is basis
    assert descriptors.fit(spectral) is descriptors
    assert len(basis.transform(collection.meshes[:2])) == 2


@pytest.mark.parametrize("method", ["predict", "functional_maps", "match", "point_maps"])
def test_an_unfitted_learner_says_so(method, make_learner, probed):
    with pytest.raises(NotFittedError, match="not fitted yet"):
        getattr(make_learner(), method)(probed)


def test_unfitted_models_say_so(make_learner, make_model, probed, collection):
    with pytest.raises(NotFittedError, match="not fitted yet"):
        make_learner().score(probed, collection.truths)
    search = GridSearchCV(make_model(), {"learner__alpha": [0.1]})
    for unfitted in (make_learner(), make_model(), search):
        for function in (skfmap.match, skfmap.functional_maps):
            with pytest.raises(NotFittedError, match="not fitted yet"):
                function(
                    unfitted,
                    probed
                    if unfitted.__class__ is WeightedFunctionalMapLearner
                    else collection.meshes,
                )


def test_fit_returns_self_and_changes_neither_parameters_nor_input(
    make_learner, probed, collection
):
    def content():
        arrays = [
            array
            for s in probed[:3]
            for array in (s.probes, s.spectral.evals, s.spectral.evecs, s.spectral.mass)
        ]
        return joblib.hash([*arrays, *(truth.pairs for truth in collection.truths[:3])])

    share = np.array([1.0, 2.0, 0.5])
    learner, X, y = make_learner(), list(probed[:3]), list(collection.truths[:3])
    parameters, before = learner.get_params(), content()
    assert learner.fit(X, y, sample_weight=share) is learner
    learner.match(probed[4:])
    assert learner.get_params() == parameters
    assert content() == before
    assert probed[:3] == X
    assert y == collection.truths[:3]
    assert share.tolist() == [1.0, 2.0, 0.5]


def test_fitting_again_gives_the_same_and_forgets(make_learner, fitted, probed, collection):
    learner = make_learner(weighting="unique").fit(probed[1:4], collection.truths[1:4])
    learner.set_params(weighting="function").fit(probed[:5], collection.truths[:5])
    assert_same_learning(learner, fitted)
    assert_array_equal(learner.predict(probed), fitted.predict(probed))


def test_fitted_attributes(fitted, probed):
    assert fitted.weights_.shape == (105,)
    assert (fitted.weights_ > 0).all()
    np.testing.assert_allclose(
        fitted.stable_basis_.T @ fitted.stable_basis_, np.eye(12), atol=1e-10
    )
    assert (np.diff(fitted.stability_) >= 0).all()
    assert fitted.reference_ is probed[0]
    assert fitted.reference_index_ == 0
    assert fitted.n_stable_ == 6
    assert fitted.loss_ == fitted.loss_curve_[-1]
    assert fitted.loss_ < fitted.loss_curve_[0]
    assert (np.diff(fitted.loss_curve_) <= 1e-12).all()
    assert len(fitted.loss_curve_) == fitted.n_iter_ + 1
    assert tuple(fitted.probe_names_) == probed[0].probe_names
    assert tuple(fitted.probe_categories_) == probed[0].probe_categories


def test_constants_map_to_constants(fitted, probed):
    for C in fitted.functional_maps(probed):
        np.testing.assert_allclose(C[:, 0], np.eye(12)[0], atol=1e-12)


def test_predict_is_the_maps_on_the_stable_functions(fitted, probed):
    maps = fitted.functional_maps(probed)
    assert_array_equal(fitted.predict(probed), maps @ fitted.stable_basis_[:, :6])
    for match, C, reduced in zip(fitted.match(probed), maps, fitted.predict(probed), strict=True):
        assert_array_equal(match.functional_map, C)
        np.testing.assert_allclose(match.reduced_map, reduced, atol=1e-14)


def test_the_number_of_jobs_changes_no_bit(make_model, collection):
    X, y = collection.meshes[:3], collection.truths[:3]
    serial = make_model().fit(X, y)
    parallel = (
        make_model().set_params(basis__n_jobs=2, probes__n_jobs=2, learner__n_jobs=2).fit(X, y)
    )
    assert_same_learning(parallel[-1], serial[-1])
    assert_array_equal(parallel.predict(X), serial.predict(X))
    assert_array_equal(
        skfmap.match(parallel, X)[2].expected_error, skfmap.match(serial, X)[2].expected_error
    )
    with joblib.parallel_config(backend="threading", n_jobs=2):
        threaded = make_model().fit(X, y)
    assert_same_learning(threaded[-1], serial[-1])


def test_a_shape_is_transformed_and_matched_by_itself(model, collection):
    order = [4, 1, 5]
    whole, part = (
        model.predict(collection.meshes),
        model.predict([collection.meshes[i] for i in order]),
    )
    assert_array_equal(part, whole[order])
    (alone,) = skfmap.match(model, [collection.meshes[5]])
    assert_array_equal(alone.p2p, skfmap.match(model, collection.meshes)[5].p2p)


@pytest.mark.parametrize("container", [tuple, list, "array"])
def test_any_sequence_of_samples(model, collection, container):
    X = collection.meshes[:2]
    if container == "array":
        X = np.empty(2, dtype=object)
        X[:] = collection.meshes[:2]
    else:
        X = container(X)
    assert_array_equal(model.predict(X), model.predict(collection.meshes[:2]))


def test_meshes_need_no_class(model, collection):
    X = [(mesh.vertices, mesh.faces) for mesh in collection.meshes[:2]]
    assert_array_equal(model.predict(X), model.predict(collection.meshes[:2]))


def test_lists_are_left_alone_by_set_output(collection):
    with sklearn.config_context(transform_output="pandas"):
        shapes = SpectralBasis(15).transform(collection.meshes[:1])
        probed = DescriptorTransformer("paper").transform(shapes)
    assert isinstance(shapes, list)
    assert isinstance(probed, list)


def test_tags_say_that_samples_are_no_rows():
    for estimator in (
        SpectralBasis(),
        DescriptorTransformer(),
        WeightedFunctionalMapLearner(),
        HeatKernelSignature(),
    ):
        assert not estimator.__sklearn_tags__().input_tags.two_d_array
    assert WeightedFunctionalMapLearner().__sklearn_tags__().target_tags.required


# What the learner's parameters do


def test_weight_0_leaves_a_shape_out(make_learner, probed, collection):
    share = [1, 1, 0, 1, 1]
    weighted = make_learner().fit(probed[:5], collection.truths[:5], sample_weight=share)
    kept = [0, 1, 3, 4]
    without = make_learner().fit([probed[i] for i in kept], [collection.truths[i] for i in kept])
    np.testing.assert_allclose(weighted.weights_, without.weights_, rtol=1e-6)
    np.testing.assert_allclose(weighted.stability_, without.stability_, rtol=1e-6, atol=1e-12)
    assert weighted.epsilon_ == pytest.approx(without.epsilon_)
    one, other = (learner.match(probed[5:])[0] for learner in (weighted, without))
    assert (one.p2p == other.p2p).mean() > 0.99
    np.testing.assert_allclose(one.functional_map, other.functional_map, atol=1e-6)


def test_weight_0_leaves_a_shape_out_of_the_expected_errors(make_learner, probed, collection):
    weighted = make_learner(weighting=None).fit(
        probed[:5], collection.truths[:5], sample_weight=[1, 1, 0, 1, 1]
    )
    kept = [0, 1, 3, 4]
    without = make_learner(weighting=None).fit(
        [probed[i] for i in kept], [collection.truths[i] for i in kept]
    )
    one, other = (learner.match(probed[5:])[0] for learner in (weighted, without))
    np.testing.assert_allclose(one.expected_error, other.expected_error, rtol=1e-6)


def test_weights_count_relatively_and_the_references_does_not(
    make_learner, fitted, probed, collection
):
    share = [123.0, 2, 2, 2, 2]
    learner = make_learner().fit(probed[:5], collection.truths[:5], sample_weight=share)
    np.testing.assert_allclose(learner.weights_, fitted.weights_, rtol=1e-6)
    np.testing.assert_allclose(
        learner.functional_maps(probed), fitted.functional_maps(probed), atol=1e-6
    )


def test_weights_change_what_is_learned(make_learner, fitted, probed, collection):
    learner = make_learner().fit(probed[:5], collection.truths[:5], sample_weight=[1, 1, 1, 1, 50])
    assert np.abs(np.log(learner.weights_ / fitted.weights_)).max() > 0.01


def test_score_is_minus_the_mean_direct_error(fitted, probed, collection):
    distances = reference_distances(collection.meshes[0])
    errors = [
        geodesic_error(match.p2p, truth, collection.truths[0], distances)
        for match, truth in zip(fitted.match(probed), collection.truths, strict=True)
    ]
    assert fitted.score(probed, collection.truths) == pytest.approx(-np.mean(errors), rel=1e-12)
    weights = [0, 1, 2, 3, 4, 5]
    weighted = fitted.score(probed, collection.truths, sample_weight=weights)
    assert weighted == pytest.approx(-np.average(errors, weights=weights), rel=1e-12)
    assert errors[0] == 0
    assert max(errors) < 0.05


def test_reference_by_name(make_learner, probed, collection):
    named = make_learner(reference="body2").fit(probed[:5], collection.truths[:5])
    assert named.reference_ is probed[2]
    assert named.reference_index_ == 2
    order = [2, 0, 1, 3, 4]
    first = make_learner().fit([probed[i] for i in order], [collection.truths[i] for i in order])
    assert_same_learning(named, first)


def test_a_reference_that_is_not_there_or_there_twice_is_refused(make_learner, probed, collection):
    with pytest.raises(ValueError, match=r"'body5'.*PinnedReference"):
        make_learner(reference="body5").fit(probed[:5], collection.truths[:5])
    with pytest.raises(ValueError, match="exactly one"):
        make_learner(reference="body1").fit(
            [*probed[:2], probed[1]], [*collection.truths[:2], collection.truths[1]]
        )


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 0, 2]])
def test_the_medoid_is_the_shape_in_the_middle(make_learner, probe, collection, order):
    mesh = collection.meshes[0]
    stretched = [Mesh(mesh.vertices * [s, 1, 1], mesh.faces, name=f"{s}") for s in (0.7, 1.0, 1.3)]
    shapes = probe([stretched[i] for i in order])
    learner = make_learner(reference="medoid", weighting=None).fit(
        shapes, [collection.truths[0]] * 3
    )
    assert learner.reference_.name == "1.0"
    assert learner.reference_index_ == order.index(1)


def test_weightings(make_learner, probed, collection):
    X, y = probed[:3], collection.truths[:3]
    categories = np.array(probed[0].probe_categories)
    weights = {
        w: make_learner(weighting=w).fit(X, y).weights_
        for w in (None, "unique", "category", "function")
    }
    assert (weights[None] == 1).all()
    assert len(np.unique(weights["unique"])) == 1
    assert weights["unique"][0] != 1
    for category in set(categories):
        assert len(np.unique(weights["category"][categories == category])) == 1
    assert len(np.unique(weights["category"])) == len(set(categories)) == 10
    assert len(np.unique(weights["function"])) > 50


def test_freer_weights_reach_a_smaller_loss(make_learner, probed, collection):
    learners = [
        make_learner(weighting=weighting, epsilon=0.01).fit(probed[:5], collection.truths[:5])
        for weighting in (None, "unique", "category", "function")
    ]
    losses = [learner.loss_ for learner in learners]
    assert losses == sorted(losses, reverse=True)
    assert losses[3] < 0.9 * losses[0]


def test_a_callable_regularizer(make_learner, fitted, probed, collection):
    same = make_learner(regularizer=laplacian_mask).fit(probed[:5], collection.truths[:5])
    assert_same_learning(same, fitted)
    other = make_learner(regularizer=lambda a, b: np.abs(a[:, None] - b) ** 0.5).fit(
        probed[:5], collection.truths[:5]
    )
    assert not np.array_equal(other.functional_maps(probed), fitted.functional_maps(probed))


def test_epsilon_as_a_number_is_used(make_learner, probed, collection):
    learner = make_learner(epsilon=0.25, weighting="category").fit(
        probed[:3], collection.truths[:3]
    )
    assert learner.epsilon_ == 0.25


@pytest.mark.parametrize(
    ("n_stable", "p"), [(None, 6), (1, 1), (12, 12), (0.5, 6), (1.0, 12), (0.01, 1)]
)
def test_number_of_stable_functions(make_learner, probed, collection, n_stable, p):
    learner = make_learner(n_stable=n_stable, weighting=None).fit(probed[:3], collection.truths[:3])
    assert learner.n_stable_ == p
    assert learner.predict(probed[:2]).shape == (2, 12, p)


@pytest.mark.parametrize("n_stable", [4, 0.5, 1.0])
def test_point_maps_in_other_functions_than_fitted(
    make_learner, fitted, probed, collection, n_stable
):
    cut = make_learner(matching="cut", n_stable=n_stable).fit(probed[:5], collection.truths[:5])
    asked = fitted.point_maps(probed[5:], matching="cut", n_stable=n_stable)[0]
    assert_array_equal(cut.match(probed[5:])[0].p2p, asked)
    assert_array_equal(
        cut.point_maps(probed[5:], matching="soft")[0], fitted.point_maps(probed[5:])[0]
    )
    assert_array_equal(fitted.point_maps(probed[5:])[0], fitted.match(probed[5:])[0].p2p)


@pytest.mark.parametrize(("matching", "n_stable"), [("soft", None), ("cut", 5), ("cut", 1.0)])
def test_points_are_neighbours_in_the_trusted_functions(fitted, probed, matching, n_stable):
    functions = fitted.stable_basis_[:, : 5 if n_stable == 5 else 12]
    if matching == "soft":
        covariance = fitted.residual_covariance_
        functions = np.linalg.inv(covariance + 0.2 * np.trace(covariance) / 12 * np.eye(12))
    (C,) = fitted.functional_maps(probed[5:])
    points_i, points_0 = (
        probed[5].spectral.evecs[:, :12] @ C @ functions,
        probed[0].spectral.evecs[:, :12] @ functions,
    )
    expected = cdist(points_i, points_0).argmin(axis=1)
    assert (
        fitted.point_maps(probed[5:], matching=matching, n_stable=n_stable)[0] == expected
    ).mean() > 0.99


@pytest.mark.parametrize(("normalize", "invariant"), [("shape", True), ("reference", False)])
def test_only_shapes_own_norms_take_out_the_amplitude(
    make_learner, probed, collection, normalize, invariant
):
    learner = make_learner(normalize=normalize, weighting=None).fit(
        probed[:3], collection.truths[:3]
    )
    loud = replace(probed[5], probes=2 * probed[5].probes)
    with nullcontext() if invariant else pytest.warns(UnfamiliarShapeWarning, match="body5"):
        changed = learner.predict([loud])
    assert (np.abs(changed - learner.predict(probed[5:])).max() < 1e-9) == invariant


def test_point_maps_refuse_what_is_unknown(fitted, probed):
    for wrong in ({"matching": "hard"}, {"n_stable": 13}, {"n_stable": 0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            fitted.point_maps(probed, **wrong)


def test_normalizing_by_the_reference_is_another_choice(make_learner, fitted, probed, collection):
    learner = make_learner(normalize="reference").fit(probed[:5], collection.truths[:5])
    assert learner.score(probed[5:], collection.truths[5:]) > -0.1
    assert not np.array_equal(learner.weights_, fitted.weights_)


def test_too_few_iterations_warn(make_learner, probed, collection):
    with pytest.warns(ConvergenceWarning, match="did not converge in 2 iterations"):
        learner = make_learner(max_iter=2, tol=1e-9).fit(probed[:3], collection.truths[:3])
    assert learner.n_iter_ == 2


def test_verbose_tells_stages_on_standard_error_only(make_learner, probed, collection, capsys):
    make_learner(verbose=1).fit(probed[:3], collection.truths[:3])
    told = capsys.readouterr()
    assert not told.out
    assert "iteration 10: loss" in told.err
    make_learner().fit(probed[:3], collection.truths[:3])
    assert not capsys.readouterr().err


# Matches


def test_the_reference_matches_itself(fitted, probed):
    (match,) = fitted.match(probed[:1])
    assert (match.p2p == np.arange(500)).mean() > 0.99
    np.testing.assert_allclose(match.functional_map, np.eye(12), atol=0.02)


def test_unseen_bodies_are_matched(fitted, probed, collection):
    assert fitted.score(probed[5:], collection.truths[5:]) > -0.04


def test_moving_scaling_and_renumbering_change_no_match(model, collection):
    mesh, rng = collection.meshes[5], np.random.default_rng(0)
    order = rng.permutation(mesh.n_vertices)
    moved = 37.0 * mesh.vertices @ Rotation.random(random_state=1).as_matrix().T + [5, -7, 100]
    faces = rng.permutation(np.argsort(order)[mesh.faces])
    faces = np.stack(
        [
            np.roll(row, shift)
            for row, shift in zip(faces, rng.integers(0, 3, len(faces)), strict=True)
        ]
    )
    one, other = skfmap.match(model, [mesh, Mesh(moved[order], faces)])
    assert (other.p2p == one.p2p[order]).mean() >= 0.99
    np.testing.assert_allclose(other.functional_map, one.functional_map, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-7, 1e7])
def test_units_change_no_match(model, collection, scale):
    mesh = collection.meshes[5]
    one, other = skfmap.match(model, [mesh, Mesh(scale * mesh.vertices, mesh.faces)])
    assert (other.p2p == one.p2p).mean() >= 0.99


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.OrientationWarning")
def test_a_mirrored_copy_is_another_shape(model, collection):
    """Faces of a mirrored copy are wound outwards again, so that oriented probes differ."""
    mesh = collection.meshes[5]
    one, other = skfmap.match(model, [mesh, Mesh(mesh.vertices * [1, -1, 1], mesh.faces)])
    assert (one.p2p == other.p2p).mean() < 0.9


def test_without_oriented_probes_a_mirrored_copy_is_the_same_shape(make_learner, probe, collection):
    mesh = collection.meshes[5]
    learner = make_learner().fit(probe(collection.meshes[:5], "paper"), collection.truths[:5])
    one, other = learner.match(probe([mesh, Mesh(mesh.vertices * [1, -1, 1], mesh.faces)], "paper"))
    assert (one.p2p == other.p2p).mean() > 0.99


def test_expected_errors_and_confidence_are_in_range_and_ordered(fitted, probed):
    for match in fitted.match(probed):
        assert match.p2p.dtype == np.int64
        assert match.p2p.min() >= 0
        assert match.p2p.max() < 500
        assert (match.expected_error >= 0).all()
        assert ((match.confidence >= 0) & (match.confidence <= 1)).all()
        safer = match.expected_error[:, None] < match.expected_error - 1e-12
        surer = match.confidence[:, None] < match.confidence - 1e-12
        assert not (
            safer & surer
        ).any()  # the smaller expected error never has the smaller confidence


def test_expected_errors_are_near_what_happens(fitted, probed, collection):
    expected = np.mean([match.expected_error.mean() for match in fitted.match(probed[5:])])
    assert 0.3 < expected / -fitted.score(probed[5:], collection.truths[5:]) < 3
