"""scikit-learn's own checks; each that cannot hold for shapes is named, with its twin here.

The truthful tag says that samples are no rows of a table, which switches nearly all of
scikit-learn's checks off. A subclass flips it, so that they run.
"""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from sklearn.utils.estimator_checks import parametrize_with_checks

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner

if "xfail_strict" not in inspect.signature(parametrize_with_checks).parameters:
    pytest.skip("strict checks came with scikit-learn 1.8", allow_module_level=True)

# Twins are tests of tests/test_estimators.py and tests/test_bad_input.py unless another file is
# named.
_ALONE = "twin: test_a_shape_is_transformed_and_matched_by_itself"
_REFUSED = "numeric tables are refused whatever they hold: test_tables_are_refused"
_STATELESS = "twin: test_transformers_need_no_fit_and_fit_returns_self"
_UNCHANGED = "twin: test_fit_returns_self_and_changes_neither_parameters_nor_input"
_TABLES = {
    "check_complex_data": _REFUSED,
    "check_dict_unchanged": _UNCHANGED,
    "check_dont_overwrite_parameters": _UNCHANGED,
    "check_dtype_object": "twin: test_steps_in_the_wrong_order_are_told_apart",
    "check_estimators_dtypes": "meshes have one dtype: tests/test_shapes.py",
    "check_estimators_empty_data_messages": "twin: test_empty_input_is_refused_everywhere",
    "check_estimators_fit_returns_self": _STATELESS,
    "check_estimators_nan_inf": "twin: the checks of Mesh in tests/test_shapes.py",
    "check_estimators_overwrite_params": _UNCHANGED,
    "check_estimators_pickle": "twin: test_a_saved_model_predicts_bit_by_bit_the_same",
    "check_f_contiguous_array_estimator": "meshes have one memory layout: tests/test_shapes.py",
    "check_fit1d": "twin: test_tables_are_refused",
    "check_fit2d_1feature": "shapes have no features",
    "check_fit2d_1sample": "twin: test_one_shape_alone_teaches_nothing",
    "check_fit2d_predict1d": "twin: test_tables_are_refused",
    "check_fit_check_is_fitted": "twin: test_unfitted_models_say_so",
    "check_fit_idempotent": "twin: test_fitting_again_gives_the_same_and_forgets",
    "check_fit_score_takes_y": "twin: test_score_is_minus_the_mean_direct_error",
    "check_methods_sample_order_invariance": _ALONE,
    "check_methods_subset_invariance": _ALONE,
    "check_n_features_in": "shapes have no features; n_features_in_ is not set",
    "check_n_features_in_after_fitting": "shapes have no features; n_features_in_ is not set",
    "check_pipeline_consistency": "twin: test_the_pipeline_says_the_same_as_its_steps",
    "check_positive_only_tag_during_fit": _REFUSED,
    "check_readonly_memmap_input": "meshes are read-only: tests/test_shapes.py",
}
_TRANSFORMER = {
    "check_transformer_data_not_an_array": "twin: test_tables_are_refused",
    "check_transformer_general": _ALONE,
    "check_transformer_preserve_dtypes": "meshes have one dtype: tests/test_shapes.py",
    "check_transformers_unfitted_stateless": _STATELESS,
}
_LEARNER = {
    "check_all_zero_sample_weights_error": "twin: test_bad_sample_weights_are_refused",
    "check_requires_y_none": "twin: test_messages_about_y_say_y",
    "check_sample_weight_equivalence_on_dense_data": "twin: test_weight_0_leaves_a_shape_out",
    "check_sample_weights_list": "twin: test_weight_0_leaves_a_shape_out",
    "check_sample_weights_not_an_array": "twin: test_weight_0_leaves_a_shape_out",
    "check_sample_weights_not_overwritten": _UNCHANGED,
    "check_sample_weights_pandas_series": "twin: test_weight_0_leaves_a_shape_out",
    "check_sample_weights_shape": "twin: test_bad_sample_weights_are_refused",
}


def _expected_failures(estimator):
    """Return the checks that this estimator cannot pass, with reasons."""
    if isinstance(estimator, WeightedFunctionalMapLearner):
        return _TABLES | _LEARNER
    failures = _TABLES | _TRANSFORMER
    if isinstance(estimator, SpectralBasis):
        del failures["check_fit1d"]  # passes: a column of numbers is refused before it is read
    return failures


def _tabular(kind, *arguments):
    """Return an estimator whose tags claim that it takes tables."""

    def sklearn_tags(self):
        tags = super(flipped, self).__sklearn_tags__()
        tags.input_tags.two_d_array = True
        return tags

    flipped = type(
        kind.__name__, (kind,), {"__sklearn_tags__": sklearn_tags, "__module__": __name__}
    )
    return flipped(*arguments)


_ESTIMATORS = [
    _tabular(SpectralBasis),
    _tabular(DescriptorTransformer),
    _tabular(WeightedFunctionalMapLearner),
]


@pytest.mark.filterwarnings("default")
@parametrize_with_checks(_ESTIMATORS, expected_failed_checks=_expected_failures, xfail_strict=True)
def test_scikit_learns_checks(estimator, check):
    check(estimator)


def test_every_twin_exists():
    here = Path(__file__).parent
    written = "".join(
        path.read_text() for path in here.glob("test_*.py") if path.name != Path(__file__).name
    )
    written += inspect.getsource(test_tables_are_refused)
    for reason in {**_TABLES, **_TRANSFORMER, **_LEARNER}.values():
        for name in re.findall(r"\btest_\w+(?!\.py)\b", reason):
            assert f"def {name}(" in written or (here / f"{name}.py").is_file(), name


@pytest.mark.parametrize(
    "table",
    [
        np.zeros((4, 3)),
        np.zeros(4),
        np.full((2, 2), np.nan),
        np.eye(3) * 1j,
        sp.csr_array(np.eye(4)),
    ],
)
def test_tables_are_refused(table, fitted):
    for step in (SpectralBasis(), DescriptorTransformer(), fitted):
        with pytest.raises(TypeError, match="X must be a sequence of"):
            step.predict(table) if step is fitted else step.fit(table)
