"""A person's own probe functions and own grouping of the weights."""

from functools import lru_cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.utils.estimator_checks import (
    check_get_params_invariance,
    check_no_attributes_set_in_init,
    check_set_params,
)

from skfmap import DescriptorTransformer
from skfmap.descriptors import FunctionProbes, HeatKernelSignature, paper_families
from skfmap.functional import project
from skfmap.model_selection import PinnedReference

computed = []


def ring(shape, power=2.0):
    computed.append(power)
    return np.linalg.norm(shape.vertices - shape.mass @ shape.vertices, axis=1) ** power


def moments(shape):
    centred = shape.vertices - shape.mass @ shape.vertices
    return np.column_stack([np.linalg.norm(centred, axis=1) ** p for p in (1, 2, 3)])


@pytest.fixture
def spectral(probed):
    return [shape.spectral for shape in probed]


def test_a_function_becomes_a_probe(spectral):
    families = [
        *paper_families(),
        ("ring", FunctionProbes(ring)),
        ("moments", FunctionProbes(moments, 3)),
    ]
    transformer = DescriptorTransformer(families)
    (shape,) = transformer.transform(spectral[:1])
    assert shape.probe_names[-4:] == (
        "ring[ring]",
        "moments[moments_0]",
        "moments[moments_1]",
        "moments[moments_2]",
    )
    expected = project(ring(spectral[0])[:, None], spectral[0].evecs, spectral[0].mass)
    assert_array_equal(shape.probes[:, 50:51], expected)
    np.testing.assert_allclose(shape.probes[:, 51 + 1], shape.probes[:, 50], atol=1e-12)


def test_own_probes_keep_scikit_learns_promises():
    for family in (FunctionProbes(ring, kw_args={"power": 3.0}), FunctionProbes(moments, 3)):
        check_get_params_invariance("FunctionProbes", family)
        check_set_params("FunctionProbes", clone(family))
        assert repr(clone(family)) == repr(family)
    check_no_attributes_set_in_init("HeatKernelSignature", HeatKernelSignature())


def test_own_probes_are_learned_searched_and_matched(make_model, collection, tmp_path):
    families = [*paper_families(2), ("ring", FunctionProbes(ring))]
    model = make_model(memory=str(tmp_path)).set_params(probes__families=families)
    grid = {
        "probes__ring__kw_args": [{"power": 1.0}, {"power": 2.0}],
        "probes__ring__function": [ring],
    }
    search = GridSearchCV(model, grid, cv=PinnedReference(2), error_score="raise")
    search.fit(collection.meshes[:4], collection.truths[:4])
    assert search.best_estimator_["learner"].probe_names_[-1] == "ring[ring]"


def test_functions_of_a_module_are_cached_and_lambdas_are_not(spectral, tmp_path):
    for power in (2.0, 3.0, 2.0, 3.0):
        families = [("ring", FunctionProbes(ring, kw_args={"power": power}))]
        computed.clear()
        (shape,) = DescriptorTransformer(families, memory=str(tmp_path)).transform(spectral[:1])
        assert_array_equal(
            shape.probes, DescriptorTransformer(families).transform(spectral[:1])[0].probes
        )
    assert computed == [3.0]  # the second time from the cache; this one is the plain transformer's
    for power in (2.0, 3.0):  # the same source, another value
        families = [("ring", FunctionProbes(lambda shape, power=power: ring(shape, power)))]
        (shape,) = DescriptorTransformer(families, memory=str(tmp_path)).transform(spectral[:1])
        assert_array_equal(
            shape.probes[:, 0],
            project(ring(spectral[0], power), spectral[0].evecs, spectral[0].mass),
        )


def test_a_wrapped_function_whose_values_its_source_does_not_tell_is_no_error(spectral, tmp_path):
    families = [("ring", FunctionProbes(lru_cache(ring)))]
    (shape,) = DescriptorTransformer(families, memory=str(tmp_path)).transform(spectral[:1])
    assert_array_equal(
        shape.probes, DescriptorTransformer(families).transform(spectral[:1])[0].probes
    )


@pytest.mark.parametrize(
    ("family", "error", "message"),
    [
        (FunctionProbes("ring"), TypeError, "function must be callable"),
        (FunctionProbes(ring, 0), ValueError, "n_functions"),
        (FunctionProbes(ring, kw_args=3), TypeError, "kw_args"),
        (
            FunctionProbes(moments),
            ValueError,
            r"moments must return finite values of shape \(\d+, 1\) on .*body0",
        ),
        (FunctionProbes(lambda shape: shape.mass * np.nan), ValueError, "NaN"),
    ],
)
def test_functions_that_do_not_fit_are_refused(family, error, message, spectral):
    with pytest.raises(error, match=message):
        DescriptorTransformer([("own", family)]).transform(spectral[:1])


def by_kind(names, categories):
    return ["oriented" if category == "oriented" else "symmetric" for category in categories]


def test_own_groupings_share_weights(make_learner, probed, collection):
    X, y = probed[:4], collection.truths[:4]
    learner = make_learner(weighting=by_kind).fit(X, y)
    labels = np.array(by_kind(learner.probe_names_, learner.probe_categories_))
    for group in ("oriented", "symmetric"):
        assert len(set(learner.weights_[labels == group])) == 1
    assert len(set(learner.weights_)) == 2
    given = make_learner(weighting=labels.tolist()).fit(X, y)
    assert_array_equal(given.weights_, learner.weights_)
    assert_array_equal(make_learner(weighting=labels).fit(X, y).weights_, learner.weights_)
    assert_array_equal(
        make_learner(weighting=lambda names, categories: categories).fit(X, y).weights_,
        make_learner(weighting="category").fit(X, y).weights_,
    )
    assert clone(learner).weighting is by_kind


def test_own_groupings_are_searched_over(make_learner, probed, collection):
    grid = {"weighting": [None, "category", by_kind]}
    search = GridSearchCV(make_learner(), grid, cv=PinnedReference(2), error_score="raise")
    assert len(search.fit(probed[:4], collection.truths[:4]).cv_results_["params"]) == 3


@pytest.mark.parametrize(
    "weighting", [["a", "b"], "families", 3, lambda names, categories: names[:4]]
)
def test_groupings_that_do_not_fit_are_refused(weighting, make_learner, probed, collection):
    with pytest.raises(ValueError, match=r"weighting must be .*(one label|a label|'category')"):
        make_learner(weighting=weighting).fit(probed[:4], collection.truths[:4])
