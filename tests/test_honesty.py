"""Where numbers cannot be had or believed, it is said, with what to change."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import skfmap.functional.eigenbasis
from skfmap import Correspondence, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import DisagreementWarning, MeshError, SkippedShapeWarning, StabilityWarning
from skfmap.functional import RowSystems, learn_functional_maps
from skfmap.shapes import SkippedShape


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    evals = np.linspace(0, 10, 6)
    return {
        "probes_0": rng.normal(size=(6, 4)),
        "probes": rng.normal(size=(2, 6, 4)),
        "evals_0": evals,
        "evals": np.stack([evals + 0.1, evals + 0.2]),
        "maps": np.stack([np.eye(6)] * 2),
    }


def test_coefficients_that_overflow_are_named(arrays):
    arrays["probes"] = arrays["probes"] * 1e200
    arrays["probes"][0, 1, 1] = np.inf
    with (
        np.errstate(all="ignore"),
        pytest.raises((ValueError, np.linalg.LinAlgError), match=r"extreme probe coefficients|NaN or infinite|finite"),
    ):
        learn_functional_maps(**arrays)


def test_a_row_system_that_is_not_definite_says_what_to_raise():
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite; raise alpha"):
        RowSystems(np.zeros((3, 3)), np.zeros((1, 3)))


def test_an_eigen_solver_that_does_not_converge_is_an_error(monkeypatch):
    monkeypatch.setattr(skfmap.functional.eigenbasis, "_MOST", 1.05)
    monkeypatch.setattr(skfmap.functional.eigenbasis, "_FIRST_LOOK", 1.0)
    with pytest.raises(MeshError, match=r"No eigenbasis for mesh.*did not converge"):
        SpectralBasis(40).transform([make_sphere(4)])


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.OrientationWarning")
def test_correspondences_of_another_numbering_leave_nothing_stable(probed, collection, make_learner):
    rng = np.random.default_rng(0)
    shuffled = [
        Correspondence(np.column_stack([rng.permutation(truth.pairs[:, 0]), truth.pairs[:, 1]]))
        for truth in collection.truths[1:5]
    ]
    with pytest.warns(StabilityWarning, match=r"No function maps stably.*vertex numbers from 0"):
        make_learner().fit(probed[:5], [collection.truths[0], *shuffled])


def _mirrored(truth, mesh):
    mirror = cKDTree(mesh.vertices).query(mesh.vertices * [1, -1, 1])[1]
    return Correspondence(np.column_stack([mirror[truth.pairs[:, 0]], truth.pairs[:, 1]]))


def _shuffled(truth, mesh):
    rng = np.random.default_rng(0)
    return Correspondence(np.column_stack([rng.permutation(truth.pairs[:, 0]), truth.pairs[:, 1]]))


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.OrientationWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.StabilityWarning")
@pytest.mark.parametrize("wrong", [_mirrored, _shuffled])
@pytest.mark.parametrize("reference", ["body0", "body2"])
def test_a_correspondence_that_contradicts_the_others_is_named(probed, collection, make_learner, wrong, reference):
    truths = list(collection.truths[:5])
    truths[3] = wrong(truths[3], collection.meshes[3])
    with pytest.warns(
        DisagreementWarning, match=r"say, by this many sqrt\(area\): X\[3\] \('body3'\) \(0\.[234]\d\); 0\.0"
    ):
        learner = make_learner(reference=reference).fit(probed[:5], truths)
    errors = learner.training_errors_
    assert errors.shape == (5,)
    assert np.flatnonzero(np.isnan(errors)) == np.flatnonzero(np.isnan(learner.misfits_)) == learner.reference_index_
    assert np.nanargmax(errors) == 3
    truths[learner.reference_index_] = wrong(
        collection.truths[learner.reference_index_], collection.meshes[learner.reference_index_]
    )
    truths[3] = collection.truths[3]
    with pytest.warns(DisagreementWarning, match="Check the correspondence of the reference first"):
        make_learner(reference=reference).fit(probed[:5], truths)


def test_errors_of_training_shapes_are_those_of_matches_left_out(probed, collection, make_learner):
    """Two beside the reference: each is matched by what the other taught."""
    learner = make_learner(tol=1e-2).fit(probed[:3], collection.truths[:3])
    for left_out in (1, 2):
        rows = [0, 3 - left_out]
        other = make_learner(tol=1e-2).fit([probed[i] for i in rows], [collection.truths[i] for i in rows])
        (errors,) = other.pair_errors([probed[left_out]], [collection.truths[left_out]])
        # There, errors are seen at some of the landmarks and by heat distances.
        assert learner.training_errors_[left_out] == pytest.approx(errors.direct.mean(), rel=0.3)


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
def test_a_strength_that_leaves_no_room_for_probes_is_told(probed, collection, make_learner):
    with pytest.warns(StabilityWarning, match="No function maps stably"):
        make_learner(alpha=1e9).fit(probed[:5], collection.truths[:5])


def test_eigenfunctions_that_are_not_numbers_are_refused():
    """Where coordinates have lost all digits, so have angles."""
    ball = make_sphere(n_subdivisions=3)
    faces = np.delete(ball.faces, np.random.default_rng(1).integers(0, len(ball.faces), 60), axis=0)
    mesh = Mesh(ball.vertices + 1e15, faces, "far")
    with pytest.raises(MeshError, match="mesh 'far'"):
        SpectralBasis(40).transform([mesh])
    with pytest.warns(SkippedShapeWarning, match="mesh 'far'"):
        (shape,) = SpectralBasis(40, on_invalid="skip").transform([mesh])
    assert isinstance(shape, SkippedShape)
