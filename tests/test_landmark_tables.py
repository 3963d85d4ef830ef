"""Landmarks of specimens as arrays and files, and what is measured on them."""

import csv

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from skfmap import Landmarks
from skfmap.exceptions import CorrespondenceError
from skfmap.landmarks import (
    align_landmarks,
    centroid_sizes,
    distances,
    landmark_names,
    observer_error,
    shrinkage,
    stack_landmarks,
    write_table,
)

BASE = np.random.default_rng(0).normal(size=(9, 3)) * [3.0, 2.0, 1.0]
NAMES = [f"p{i}" for i in range(9)]


def _specimens(n=8, seed=1, strength=0.1):
    """Return configurations that differ in size and in form, each somewhere else in space."""
    random = np.random.default_rng(seed)
    sizes = 1 + 0.2 * random.normal(size=(n, 1, 1))
    return sizes * (BASE + strength * random.normal(size=(n, 9, 3)))


def _moved(points, seed=2):
    random = np.random.default_rng(seed)
    turns = Rotation.random(len(points), random_state=random).as_matrix()
    return points @ turns + random.normal(scale=20, size=(len(points), 1, 3))


def _marks(points, names=NAMES):
    return [Landmarks(one, names, name=f"s{i}") for i, one in enumerate(points)]


# The array


def test_landmarks_are_joined_by_name_whatever_their_order():
    points = _specimens(3)
    order = np.random.default_rng(3).permutation(9)
    shuffled = Landmarks(points[1][order], [NAMES[i] for i in order])
    stacked = stack_landmarks([Landmarks(points[0], NAMES), shuffled, Landmarks(points[2], NAMES)])
    assert_array_equal(stacked, points)  # to the last bit: nothing is moved or scaled


def test_a_landmark_that_one_specimen_lacks_is_missing_there_and_nowhere_else():
    points = _specimens(3)
    marks = [Landmarks(points[0][1:], NAMES[1:]), *_marks(points[1:])]
    assert landmark_names(marks) == (*NAMES[1:], "p0")
    stacked = stack_landmarks(marks, NAMES)
    assert np.isnan(stacked[0, 0]).all()
    assert np.isnan(stacked).sum() == 3
    assert_array_equal(stacked[1:], points[1:])


def test_names_that_no_specimen_has_are_told():
    with pytest.raises(
        CorrespondenceError, match="No specimen has a landmark 'chin'; there are p0"
    ):
        stack_landmarks(_marks(_specimens(2)), ["chin"])
    with pytest.raises(TypeError, match=r"landmarks\[0\] must be a skfmap.Landmarks; got ndarray"):
        stack_landmarks([BASE])


def test_centroid_size_is_that_of_all_distances_between_landmarks():
    """Sum of squares about the centroid = sum over pairs of squared distances / n."""
    points = _moved(_specimens())
    between = np.square(points[:, :, None] - points[:, None]).sum(axis=(1, 2, 3)) / 2 / 9
    assert_allclose(centroid_sizes(points), np.sqrt(between))
    points[2, 4] = np.nan
    assert_array_equal(np.isnan(centroid_sizes(points)), np.arange(8) == 2)


def test_half_known_landmarks_are_refused():
    points = _specimens(2)
    points[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="partly NaN"):
        centroid_sizes(points)
    with pytest.raises(ValueError, match=r"shape \(n_specimens, n_landmarks, 3\)"):
        centroid_sizes(BASE)


# Files


def test_a_wide_table_comes_back_to_the_last_bit(tmp_path):
    points = _moved(_specimens())
    points[3, 5] = np.nan
    write_table(_marks(points), tmp_path / "table.csv")
    table = pd.read_csv(tmp_path / "table.csv")
    assert list(table.columns[:5]) == ["specimen", "centroid_size", "p0_x", "p0_y", "p0_z"]
    assert list(table["specimen"]) == [f"s{i}" for i in range(8)]
    # What geomorph's arrayspecs does: three columns for each landmark, one after the other.
    # The default of older releases of pandas reads the last digits as it likes.
    assert_allclose(table.iloc[:, 2:].to_numpy().reshape(8, 9, 3), points, rtol=1e-12)
    assert_allclose(table["centroid_size"], centroid_sizes(points), rtol=1e-12)
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert_array_equal(np.array(rows[1][2:], dtype=float).reshape(9, 3), points[0])
    assert rows[4].count("NA") == 4  # three coordinates and the size


def test_a_long_table_has_errors_of_predictions(tmp_path):
    points = _specimens(2)
    marks = [
        Landmarks(points[0], NAMES, name="one", expected_error=np.arange(9), radius=np.ones(9)),
        Landmarks(points[1], NAMES),
    ]
    write_table(marks, tmp_path / "long.csv", layout="long")
    table = pd.read_csv(tmp_path / "long.csv", dtype={"specimen": str})
    assert table.shape == (18, 7)
    assert_array_equal(table["expected_error"][:9], np.arange(9))
    assert table[["expected_error", "radius"]][9:].isna().all().all()
    assert list(table["specimen"].unique()) == ["one", "2"]
    assert_allclose(table[["x", "y", "z"]].to_numpy().reshape(2, 9, 3), points, rtol=1e-12)


def test_arrays_come_back_without_pickle(tmp_path):
    points = _specimens()
    write_table(_marks(points), tmp_path / "table.npz")
    with np.load(tmp_path / "table.npz", allow_pickle=False) as file:
        assert_array_equal(file["points"], points)
        assert_array_equal(file["centroid_size"], centroid_sizes(points))
        assert file["specimens"].tolist() == [f"s{i}" for i in range(8)]
        assert file["landmarks"].tolist() == NAMES


def test_a_file_that_exists_is_kept_unless_it_is_to_be_replaced(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="set overwrite=True to replace it"):
        write_table(_marks(_specimens()), path)
    assert path.read_text() == "mine"
    write_table(_marks(_specimens()), path, overwrite=True)
    assert path.read_text().startswith("specimen,")
    with pytest.raises(ValueError, match=r"must end in .csv or .npz; got '.xlsx'"):
        write_table(_marks(_specimens()), tmp_path / "table.xlsx")


# Alignment


def test_aligned_specimens_do_not_depend_on_where_they_lay_and_keep_all_distances():
    points = _specimens()
    aligned = align_landmarks(_moved(points))
    assert_allclose(centroid_sizes(aligned), centroid_sizes(points))
    again = align_landmarks(_moved(aligned, seed=5))
    turn, _ = Rotation.align_vectors(aligned.reshape(-1, 3), again.reshape(-1, 3))
    assert_allclose(turn.apply(again.reshape(-1, 3)).reshape(aligned.shape), aligned, atol=1e-7)


def test_no_turn_or_shift_of_one_specimen_brings_it_nearer_to_the_mean():
    """To first order: its products with the mean are symmetric, and positive but for one."""
    aligned = align_landmarks(_moved(_specimens(strength=0.6)))
    mean = aligned.mean(axis=0)
    assert_allclose(aligned.mean(axis=1), 0, atol=1e-12)
    for one in aligned:
        products = one.T @ mean
        assert_allclose(products, products.T, atol=1e-7)
        a, b, _ = np.linalg.eigvalsh(products)
        assert a + b > 0


def test_missing_landmarks_change_nothing_where_specimens_are_alike():
    points = _moved(np.tile(BASE, (5, 1, 1)))
    points[1, 3] = points[4, 0] = np.nan
    aligned = align_landmarks(points)
    full = aligned[0]  # of which nothing is missing
    assert_allclose(np.where(np.isnan(aligned), full, aligned), np.tile(full, (5, 1, 1)), atol=1e-9)
    assert_array_equal(np.isnan(aligned), np.isnan(points))


def test_specimens_that_cannot_be_turned_are_told():
    points = _specimens(3)
    points[1, 2:] = np.nan
    with pytest.raises(
        ValueError, match="Specimen 1 has 2 landmarks, but alignment takes at least 3"
    ):
        align_landmarks(points)


# Shrinkage


def _shrunk(points, share):
    """Return aligned configurations, brought nearer to their mean."""
    aligned = align_landmarks(points)
    mean = aligned.mean(axis=0)
    return aligned, mean + share * (aligned - mean)


def test_predictions_nearer_to_the_mean_keep_the_square_of_the_share():
    true, predicted = _shrunk(_specimens(12, strength=0.02), 0.7)
    found = shrinkage(_marks(_moved(predicted)), _marks(_moved(true, seed=7)))
    assert_allclose(found.variance_ratio, 0.49, atol=1e-3)
    assert_allclose(found.per_landmark, 0.49, atol=0.02)
    assert_allclose(found.size_slope, 0.7, atol=1e-3)


def test_true_landmarks_do_not_shrink_and_places_do_not_matter():
    points = _specimens()
    found = shrinkage(_marks(_moved(points)), _marks(_moved(points, seed=9)))
    assert_allclose([found.variance_ratio, found.size_slope], 1)
    assert_allclose(found.per_landmark, 1)


def test_noise_raises_the_variance_but_not_the_slope_on_size():
    random = np.random.default_rng(0)
    sizes = np.linspace(0.7, 1.3, 200)[:, None, None]
    true, half = sizes * BASE, (1 + (sizes - 1) / 2) * BASE
    noisy = half + 0.3 * random.normal(size=half.shape)
    found = shrinkage(_marks(noisy), _marks(true))
    assert found.variance_ratio > 0.35  # a quarter, and the noise
    assert_allclose(found.size_slope, 0.5, atol=0.05)


def test_what_is_missing_in_one_counts_in_neither():
    true, predicted = _shrunk(_specimens(10), 0.5)
    without = true.copy()
    without[2, 3] = np.nan
    both = predicted.copy()
    both[2, 3] = np.nan
    a = shrinkage(_marks(predicted), _marks(without))
    b = shrinkage(_marks(both), _marks(without))
    assert_allclose(a.per_landmark, b.per_landmark)
    assert a.size_slope == b.size_slope


def test_other_specimens_and_other_landmarks_are_refused():
    marks = _marks(_specimens())
    with pytest.raises(CorrespondenceError, match=r"predicted\[0\] is 's1' but true\[0\] is 's0'"):
        shrinkage(marks[::-1][6:], marks[:2])
    with pytest.raises(CorrespondenceError, match="8 predicted specimens but 7 true"):
        shrinkage(marks, marks[:7])
    with pytest.raises(CorrespondenceError, match="no name in common"):
        shrinkage(_marks(_specimens(), [f"q{i}" for i in range(9)]), marks)
    with pytest.raises(ValueError, match="takes at least 3 specimens to estimate variances; got 2"):
        shrinkage(marks[:2], marks[:2])


def test_shrinkage_is_told_in_a_line():
    true, predicted = _shrunk(_specimens(6), 0.5)
    assert repr(shrinkage(_marks(predicted), _marks(true))).startswith(
        "Shrinkage(variance_ratio=0.25, least 0."
    )
    one_size = true / centroid_sizes(true)[:, None, None]
    assert "n_specimens=6" in repr(shrinkage(_marks(one_size), _marks(one_size)))


# The observer's error


def test_the_observers_error_is_that_of_what_was_placed_twice():
    points = _specimens(4)
    offsets = np.zeros_like(points)
    offsets[:, 0, 0] = [0.1, -0.2, 0.3, 0.4]
    first, second = _marks(points), _marks(points + offsets)[1:][::-1]
    found = observer_error(first, second)
    assert found.n_specimens == 3
    assert_allclose(found.per_landmark, [0.3, *[0] * 8], atol=1e-12)
    assert_allclose(found.mean, 0.3 / 9)
    assert_allclose(found.of_one_placing[0], np.sqrt((0.04 + 0.09 + 0.16) / 3 / 2))


def test_one_placing_is_as_far_from_the_middle_as_it_was_scattered():
    random = np.random.default_rng(0)
    base = np.tile(BASE, (4000, 1, 1))
    first, second = (base + 0.1 * random.normal(size=base.shape) for _ in range(2))
    found = observer_error(_marks(first), _marks(second))
    assert_allclose(found.of_one_placing, 0.1 * np.sqrt(3), rtol=0.03)


def test_where_nothing_was_digitised_twice_the_error_is_unknown():
    marks = _marks(_specimens(4))
    for unknown in (observer_error(marks), observer_error(marks[:2], marks[2:])):
        assert unknown.per_landmark is None
        assert unknown.mean is None
        assert repr(unknown) == "ObserverError(unknown: no specimen was digitised twice)"
    missing = [Landmarks(np.full((9, 3), np.nan), NAMES, name="s0")]
    assert observer_error(missing, marks).per_landmark is None


def test_a_landmark_that_was_placed_once_has_no_error_of_its_own():
    points = _specimens(2)
    again = points + 0.1
    again[:, 4] = np.nan
    found = observer_error(_marks(points), _marks(again))
    assert_array_equal(np.isnan(found.per_landmark), np.arange(9) == 4)
    assert_allclose(found.mean, 0.1 * np.sqrt(3))


def test_specimens_are_joined_by_their_names():
    marks = _marks(_specimens(2))
    with pytest.raises(CorrespondenceError, match=r"first\[0\] has no name"):
        observer_error([Landmarks(BASE)], marks)
    with pytest.raises(
        CorrespondenceError, match="Several specimens of second have the same name: s0"
    ):
        observer_error(marks, [marks[0], marks[0]])


# Distances


def test_distances_do_not_depend_on_where_a_specimen_lies():
    points = _specimens()
    pairs = [("p0", "p1"), ("p8", "p3")]
    found = distances(_marks(_moved(points)), pairs)
    assert_allclose(found[:, 1], np.linalg.norm(points[:, 8] - points[:, 3], axis=1))
    points[0, 1] = np.nan
    assert_array_equal(np.isnan(distances(_marks(points), pairs))[:2], [[True, False], [False] * 2])
    with pytest.raises(CorrespondenceError, match="'chin'"):
        distances(_marks(points), [("p0", "chin")])
