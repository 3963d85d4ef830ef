"""Cross-validation that keeps its reference."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GroupKFold, KFold, LeaveOneOut, ShuffleSplit, cross_val_score

from skfmap.model_selection import PinnedReference

X = list("rabcdef")


@pytest.mark.parametrize(
    ("cv", "n_splits"),
    [(2, 2), (3, 3), (LeaveOneOut(), 6), (KFold(3, shuffle=True, random_state=0), 3)],
)
def test_the_reference_opens_every_training_fold_and_is_never_tested(cv, n_splits):
    pinned = PinnedReference(cv)
    splits = list(pinned.split(X, X))
    assert len(splits) == n_splits == pinned.get_n_splits(X, X)
    for train, test in splits:
        assert train[0] == 0
        assert sorted([*train, *test]) == list(range(7))
    assert sorted(np.concatenate([test for _, test in splits])) == [1, 2, 3, 4, 5, 6]


def test_the_number_of_folds_is_known_without_data():
    assert PinnedReference(4).get_n_splits() == 4
    assert PinnedReference().get_n_splits() == 5


def test_folds_are_those_of_the_inner_splitter():
    inner = ShuffleSplit(3, test_size=2, random_state=0)
    for (train, test), (train_0, test_0) in zip(
        PinnedReference(inner).split(X), inner.split(X[1:]), strict=True
    ):
        assert train.tolist() == [0, *(train_0 + 1)]
        assert test.tolist() == (test_0 + 1).tolist()


def test_groups_stay_together():
    groups = ["ref", "a", "b", "a", "b", "c", "c"]
    pinned = PinnedReference(GroupKFold(3))
    assert pinned.get_n_splits(X, X, groups) == 3
    for train, test in pinned.split(X, X, groups):
        assert train[0] == 0
        assert len(test) == 2
        assert groups[test[0]] == groups[test[1]]


def test_splits_given_as_a_list_count_from_the_second_sample():
    splits = [([0, 1, 2, 3], [4, 5]), ([2, 3, 4, 5], [0, 1])]
    (train, test), _ = PinnedReference(splits).split(X)
    assert train.tolist() == [0, 1, 2, 3, 4]
    assert test.tolist() == [5, 6]


def test_a_generator_of_splits_is_not_used_up_by_counting():
    pinned = PinnedReference(KFold(3).split(X[1:]))
    assert pinned.get_n_splits(X) == 3
    assert len(list(pinned.split(X))) == 3


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_samples_are_refused(n):
    with pytest.raises(ValueError, match="at least two more"):
        list(PinnedReference(LeaveOneOut()).split(X[:n]))


def test_samples_may_be_in_an_array():
    shapes = np.array(X, dtype=object)
    assert len(list(PinnedReference(3).split(shapes, shapes))) == 3


def test_repr_and_clone():
    pinned = PinnedReference(LeaveOneOut())
    assert repr(pinned) == "PinnedReference(cv=LeaveOneOut())"
    assert isinstance(clone(pinned, safe=False).cv, LeaveOneOut)


def test_scores_are_those_of_the_folds_by_hand(make_learner, probed, collection):
    cv, learner = PinnedReference(2), make_learner(weighting=None)
    scores = cross_val_score(learner, probed, collection.truths, cv=cv)
    for score, (train, test) in zip(scores, cv.split(probed), strict=True):
        part = clone(learner).fit([probed[i] for i in train], [collection.truths[i] for i in train])
        assert part.reference_.name == "body0"
        assert part.score([probed[i] for i in test], [collection.truths[i] for i in test]) == score


def test_groups_reach_the_inner_splitter_through_scikit_learn(make_learner, probed, collection):
    groups, cv = [9, 0, 0, 1, 1, 1], PinnedReference(GroupKFold(2))
    scores = cross_val_score(
        make_learner(weighting=None), probed, collection.truths, cv=cv, groups=groups
    )
    assert scores.shape == (2,)
    assert (scores < 0).all()
