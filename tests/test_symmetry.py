"""What is symmetric in a specimen, and what is not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from skfmap.exceptions import CorrespondenceError
from skfmap.landmarks import Pairing, asymmetric_component, propose_pairing, symmetric_component

NAMES = ["nose", "eye_L", "eye_R", "ear_L", "ear_R", "chin", "jaw_L", "jaw_R"]
PAIRS = [("eye_L", "eye_R"), ("ear_L", "ear_R"), ("jaw_L", "jaw_R")]
PAIRING = Pairing(NAMES, PAIRS, ["nose", "chin"])
MIRROR = np.array([-1.0, 1.0, 1.0])


def _symmetric(seed=0):
    """Return a configuration that is symmetric in x = 0."""
    points = np.random.default_rng(seed).normal(size=(8, 3))
    points[[0, 5], 0] = 0
    points[[2, 4, 7]] = points[[1, 3, 6]] * MIRROR
    return points


def _specimens(n=5, strength=0.1, seed=3):
    random = np.random.default_rng(seed)
    return _symmetric() + strength * random.normal(size=(n, 8, 3))


def _move(seed=4):
    random = np.random.default_rng(seed)
    return 2.5, Rotation.random(random_state=random).as_matrix(), random.normal(scale=9, size=3)


def test_a_symmetric_specimen_has_no_asymmetry_wherever_it_lies():
    scale, turn, shift = _move()
    specimen = (scale * _symmetric() @ turn + shift)[None]
    assert_allclose(asymmetric_component(specimen, PAIRING), 0, atol=1e-12)
    assert_allclose(symmetric_component(specimen, PAIRING), specimen, atol=1e-12)


def test_the_components_add_up_and_the_first_is_symmetric():
    points = _specimens()
    symmetric = symmetric_component(points, PAIRING)
    assert_allclose(symmetric + asymmetric_component(points, PAIRING), points, atol=1e-12)
    assert_allclose(symmetric_component(symmetric, PAIRING), symmetric, atol=1e-12)
    for one in symmetric:  # pairs have one middle plane, on which the midline lies
        across = np.array([one[j] - one[i] for i, j in ((1, 2), (3, 4), (6, 7))])
        normal = across[0] / np.linalg.norm(across[0])
        assert_allclose(across, np.outer(across @ normal, normal), atol=1e-12)
        middles = [(one[1] + one[2]) / 2, (one[3] + one[4]) / 2, one[0], one[5]]
        assert_allclose(np.ptp(np.array(middles) @ normal), 0, atol=1e-12)


def test_the_asymmetric_component_of_a_pair_is_opposite():
    points = _specimens()
    symmetric, rest = (f(points, PAIRING) for f in (symmetric_component, asymmetric_component))
    for whole, left in zip(symmetric, rest, strict=True):
        normal = (whole[2] - whole[1]) / np.linalg.norm(whole[2] - whole[1])
        image = left - 2 * np.outer(left @ normal, normal)
        assert_allclose(image[PAIRING.partner], -left, atol=1e-12)


def test_of_all_planes_the_image_is_nearest_in_the_one_that_is_used():
    """Another route: the plane, by its normal and its distance, found by minimisation."""

    def asymmetry(plane, points):
        normal = plane[:3] / np.linalg.norm(plane[:3])
        image = points - 2 * np.outer(points @ normal - plane[3], normal)
        return np.square(points - image[PAIRING.partner]).sum() / 4

    for points in _specimens(strength=0.3):
        found = min(
            minimize(asymmetry, start, args=(points,), tol=1e-14).fun
            for start in np.random.default_rng(0).normal(size=(8, 4))
        )
        rest = asymmetric_component(points[None], PAIRING)
        assert_allclose(np.square(rest).sum(), found, rtol=1e-7)


def test_components_move_with_the_specimen():
    points = _specimens()
    scale, turn, shift = _move()
    assert_allclose(
        symmetric_component(scale * points @ turn + shift, PAIRING),
        scale * symmetric_component(points, PAIRING) @ turn + shift,
        atol=1e-12,
    )
    assert_allclose(
        asymmetric_component(points * MIRROR, PAIRING),
        asymmetric_component(points, PAIRING) * MIRROR,
        atol=1e-12,
    )


def test_known_asymmetry_comes_out():
    """Of a displacement of one side of a pair, half is antisymmetric."""
    symmetric = _symmetric()
    moved = symmetric.copy()
    moved[1] += 1e-6 * np.array([0.0, 0, 1])
    moved[2] -= 1e-6 * np.array([0.0, 0, 1])
    rest = asymmetric_component(moved[None], PAIRING)[0]
    # All but what turns the plane, which is to first order the best fit of a rotation.
    field = moved - symmetric
    turns = np.cross(np.eye(3)[:, None], symmetric - symmetric.mean(axis=0))
    A = np.concatenate([turns, np.tile(np.eye(3)[:, None], (8, 1))]).reshape(6, -1).T
    image = (A @ np.linalg.lstsq(A, field.ravel())[0]).reshape(8, 3)
    assert_allclose(rest, field - image, atol=1e-11)


def test_a_landmark_without_its_partner_has_no_components():
    points = _specimens()
    points[2, 3] = np.nan
    rest = asymmetric_component(points, PAIRING)
    expected = np.zeros((5, 8), dtype=bool)
    expected[2, [3, 4]] = True
    assert_array_equal(np.isnan(rest[:, :, 0]), expected)
    alone = points.copy()
    alone[:, 1:] = np.nan
    alone[0, 0] = np.nan
    assert_array_equal(np.isnan(symmetric_component(alone, PAIRING)[0]), True)


# Who mirrors whom


def test_pairings_must_name_each_landmark_once():
    with pytest.raises(CorrespondenceError, match="chin is neither in a pair nor on the midline"):
        Pairing(NAMES, PAIRS, ["nose"])
    with pytest.raises(CorrespondenceError, match="eye_L is in two pairs"):
        Pairing(NAMES, [*PAIRS, ("eye_L", "chin")], ["nose"])
    with pytest.raises(CorrespondenceError, match="There is no landmark tail; there are nose"):
        Pairing(NAMES, PAIRS, ["nose", "chin", "tail"])
    with pytest.raises(ValueError, match="array has 7 landmarks, but the pairing has 8"):
        symmetric_component(_specimens()[:, :7], PAIRING)
    with pytest.raises(TypeError, match="pairing must be a Pairing; got list"):
        symmetric_component(_specimens(), PAIRS)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("L1", "R1"),
        ("eye_l", "eye_r"),
        ("orbitL", "orbitR"),
        ("left eye", "right eye"),
        ("LeftEye", "RightEye"),
        ("zygoma-LEFT", "zygoma-RIGHT"),
    ],
)
def test_pairs_are_proposed_by_their_names(left, right):
    proposed = propose_pairing(["nose", right, left])
    assert proposed.pairs == ((left, right),)
    assert proposed.midline == ("nose",)
    assert proposed.partner.tolist() == [0, 2, 1]
    assert repr(proposed) == f"Pairing({left} - {right}; midline: nose)"


def test_names_without_a_partner_are_on_the_midline_unless_they_say_a_side():
    pair, middle = ("eye_L", "eye_R"), ("lambda", "rostrum", "nasal")
    assert propose_pairing([*middle, *pair]).midline == middle
    for alone in ("ear_R", "right eye", "L3"):
        with pytest.raises(CorrespondenceError, match=f"{alone}: the name contains a side"):
            propose_pairing([*pair, alone])
    with pytest.raises(
        CorrespondenceError, match="more than one landmark could be the mirror image"
    ):
        propose_pairing(["L_L", "R_L", "L_R"])
    with pytest.raises(CorrespondenceError, match="No two names differ only by their side: L1, L2"):
        propose_pairing(["L1", "L2"])
