"""The mean of registered shapes and its modes."""

import joblib
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skfmap import Mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError, OrientationWarning
from skfmap.io import read_mesh, write_mesh
from skfmap.persistence import load_model, save_model
from skfmap.shape_space import ShapeSpace, stack
from skfmap.shapes import Registered

BALL = make_sphere(n_subdivisions=4)
# Differs along all axes and from its mirror image, so that a rotation is told and so is a side.
FORM = (
    BALL.vertices * [1.0, 1.5, 2.2] + 0.3 * np.maximum(BALL.vertices, 0) ** 2 @ np.eye(3)[[1, 2, 0]]
)


def _area_weights(points, faces):
    a, b, c = (points[faces[:, j]] for j in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    weights = np.zeros(len(points))
    for j in range(3):
        np.add.at(weights, faces[:, j], areas)
    return weights / weights.sum()


def _no_rotation(field, points, weights):
    """Return a displacement without what turns and shifts points, to first order."""
    centred = points - weights @ points
    moves = np.concatenate(
        [np.cross(np.eye(3)[:, None], centred[None]), np.tile(np.eye(3)[:, None], (len(points), 1))]
    )
    root = np.sqrt(weights)[:, None]
    A = (moves * root).reshape(6, -1).T
    return field - np.tensordot(np.linalg.lstsq(A, (field * root).ravel())[0], moves, 1)


def _family(n_shapes=7, strength=1e-3):
    """Return shapes that move along one displacement, forth and back, their mean and parameters."""
    weights = _area_weights(FORM, BALL.faces)
    mean = FORM - weights @ FORM
    field = _no_rotation(np.sin(3 * FORM[:, [2, 0, 1]]), mean, weights)
    field /= np.sqrt(weights @ np.square(field).sum(axis=1))
    t = np.linspace(-1, 1, n_shapes) * strength
    return mean + t[:, None, None] * field, mean, field, t


def _wild(n_shapes=6, seed=0, strength=0.05):
    """Return shapes that differ in several smooth ways, each more than the next."""
    random = np.random.default_rng(seed)
    fields = [np.sin(k * FORM[:, np.roll([0, 1, 2], k)] + k) / k for k in range(1, 5)]
    amounts = strength * random.normal(size=(n_shapes, 4))
    return FORM + np.tensordot(amounts, np.array(fields), 1)


def _moved(points, seed=1):
    """Return each shape turned and shifted in its own way."""
    random = np.random.default_rng(seed)
    turns = Rotation.random(len(points), random_state=random).as_matrix()
    return points @ turns + random.normal(scale=5, size=(len(points), 1, 3))


def _meshes(points):
    return [Mesh(one, BALL.faces, f"body{i}") for i, one in enumerate(points)]


def _registered(points, **changes):
    return [
        Registered(
            **{
                **{"vertices": one, "faces": BALL.faces, "distance": np.zeros(len(one))},
                **{"n_flipped": 0, "off": 0.0, "uncovered": 0.0, "stretched": 0.0, "fits": True},
                **{"name": f"body{i}", "reference_name": "body0"},
                **changes,
            }
        )
        for i, one in enumerate(points)
    ]


# Mathematics


def test_a_family_of_one_parameter_has_one_mode_which_is_its_derivative():
    points, mean, field, t = _family()
    space = ShapeSpace(faces=BALL.faces).fit(points)
    assert space.explained_variance_ratio_[0] > 1 - 1e-5  # but for second order
    turn = np.sign((space.modes_[0] * field).sum())
    # The first shape says how the mean is turned: nearly as it is here.
    assert_allclose(turn * space.modes_[0], field, atol=2e-3 * np.abs(field).max())
    assert_allclose(turn * space.transform(points)[:, 0], t, atol=1e-5 * 1e-3 + 1e-7)
    assert_allclose(space.mean_, mean, atol=1e-3 * 1e-2)
    assert_allclose(space.standard_deviations_[0], t.std(ddof=1), rtol=1e-4)


def test_growth_is_a_mode_if_size_is_kept_and_nothing_if_it_is_not():
    sizes = np.array([0.8, 1.0, 1.1, 1.4])
    points = _moved(sizes[:, None, None] * FORM)
    space = ShapeSpace(faces=BALL.faces).fit(points)
    assert_allclose(space.explained_variance_ratio_, [1.0])
    assert_allclose(space.centroid_sizes_ / space.centroid_sizes_[1], sizes)
    # Along growth the score is the size, as root mean square distance from the centroid.
    scores = space.transform(points)[:, 0]
    assert_allclose(scores, space.centroid_sizes_ - space.centroid_sizes_.mean(), atol=1e-9)
    with pytest.raises(ValueError, match="without variation"):
        ShapeSpace(scale=True, faces=BALL.faces).fit(points)


def test_with_scale_scores_do_not_depend_on_sizes():
    points = _wild()
    sizes = np.array([1.0, 2.0, 0.5, 3.0, 1.2, 0.9])[:, None, None]
    space = ShapeSpace(scale=True, faces=BALL.faces).fit(points)
    other = ShapeSpace(scale=True, faces=BALL.faces).fit(sizes * points)
    assert_allclose(other.transform(points), space.transform(sizes * points), atol=1e-9)
    assert_allclose(other.centroid_sizes_, sizes.ravel() * space.centroid_sizes_)


def test_modes_do_not_depend_on_where_shapes_stand():
    points = _wild()
    space, moved = (ShapeSpace(faces=BALL.faces).fit(one) for one in (points, _moved(points)))
    assert_allclose(moved.standard_deviations_, space.standard_deviations_, rtol=1e-6)
    assert_allclose(moved.transform(_moved(points, 2)), space.transform(points), atol=1e-8)
    turn = Rotation.align_vectors(space.mean_, moved.mean_)[0].as_matrix().T
    assert_allclose(moved.mean_ @ turn, space.mean_, atol=1e-8)
    assert_allclose(moved.modes_ @ turn, space.modes_, atol=1e-5)


def test_the_order_of_shapes_does_not_matter():
    points, order = _wild(), [3, 1, 5, 0, 4, 2]
    space, other = (ShapeSpace(faces=BALL.faces).fit(one) for one in (points, points[order]))
    assert_allclose(other.transform(points), space.transform(points), atol=1e-7)


def test_modes_are_orthonormal_over_the_surface_and_scores_uncorrelated():
    points = _moved(_wild())
    space = ShapeSpace(faces=BALL.faces).fit(points)
    assert_allclose(space.weights_, _area_weights(space.mean_, BALL.faces), atol=1e-9)
    products = np.einsum("v,mvd,nvd->mn", space.weights_, space.modes_, space.modes_)
    assert_allclose(products, np.eye(len(space.modes_)), atol=1e-6)
    scores = space.transform(points)
    assert_allclose(np.cov(scores.T), np.diag(space.standard_deviations_**2), atol=1e-9)
    assert_allclose(scores.mean(axis=0), 0, atol=1e-8)
    assert_allclose(space.explained_variance_ratio_.sum(), 1)
    assert (np.diff(space.standard_deviations_) <= 0).all()


def test_a_finer_mesh_of_one_half_changes_nothing_much():
    """Areas count and vertices do not: splitting the faces of one half leaves the deviations."""
    points = _wild()
    coarse = ShapeSpace(faces=BALL.faces).fit(points)
    split = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] > 0
    centres = points[:, BALL.faces[split]].mean(axis=2)
    new = np.arange(split.sum())[:, None] + len(BALL.vertices)
    a, b, c = (BALL.faces[split][:, [j]] for j in range(3))
    finer = [np.hstack(three) for three in ((a, b, new), (b, c, new), (c, a, new))]
    faces = np.vstack([BALL.faces[~split], *finer])
    fine = ShapeSpace(faces=faces).fit(np.concatenate([points, centres], axis=1))
    uneven = ShapeSpace().fit(np.concatenate([points, centres], axis=1))
    off, off_if_alike = (
        np.abs(one.standard_deviations_[:3] / coarse.standard_deviations_[:3] - 1).max()
        for one in (fine, uneven)
    )
    assert off < 0.01 < 3 * 0.01 < off_if_alike


def test_scores_and_shapes_go_round():
    points = _moved(_wild())
    space = ShapeSpace(faces=BALL.faces).fit(points)
    scores = space.transform(points)
    shapes = space.inverse_transform(scores)
    assert_allclose(space.transform(shapes), scores, atol=1e-8)
    for shape, given in zip(shapes, points, strict=True):  # all modes: the shapes themselves
        sides = [np.linalg.norm(one[:50, None] - one[None, :50], axis=2) for one in (shape, given)]
        assert_allclose(*sides, atol=1e-7)
    assert_allclose(space.inverse_transform(np.zeros((1, len(space.modes_))))[0], space.mean_)


def test_fewer_modes_are_the_first_of_all():
    points = _wild()
    space = ShapeSpace(faces=BALL.faces).fit(points)
    two = ShapeSpace(2, faces=BALL.faces).fit(points)
    assert_allclose(two.modes_, space.modes_[:2])
    assert_allclose(two.explained_variance_ratio_, space.explained_variance_ratio_[:2])
    shares = np.cumsum(space.explained_variance_ratio_)
    enough = ShapeSpace(float(shares[1] - 1e-6), faces=BALL.faces).fit(points)
    assert len(enough.modes_) == 2


def test_meshes_of_the_mean_and_the_modes(tmp_path):
    meshes = _meshes(_wild())
    space = ShapeSpace().fit(meshes)
    assert_array_equal(space.mean_mesh_.vertices, space.mean_)
    assert_array_equal(space.mean_mesh_.faces, BALL.faces)
    there, back = (space.mode_mesh(1, t).vertices for t in (2.0, -2.0))
    assert_allclose((there + back) / 2, space.mean_)
    assert_allclose(
        space.transform([space.mode_mesh(1, 2.0)])[0],
        2 * space.standard_deviations_ * (np.arange(len(space.modes_)) == 1),
        atol=0.05 * space.standard_deviations_[1],  # turned onto the mean anew
    )
    write_mesh(space.mode_mesh(0, -1.5), tmp_path / "mode.off")
    assert_allclose(read_mesh(tmp_path / "mode.off").vertices, space.mode_mesh(0, -1.5).vertices)


def test_vertices_without_a_face_move_with_the_others():
    points = _wild()
    more = np.concatenate([points, points[:, :1]], axis=1)
    space = ShapeSpace(faces=BALL.faces).fit(more)
    assert space.weights_[-1] == 0
    assert_allclose(space.modes_[:, -1], space.modes_[:, 0], atol=1e-9)


def test_landmarks_need_no_faces():
    points = _moved(_wild()[:, ::15])
    space = ShapeSpace().fit(points)
    assert_allclose(space.weights_, 1 / points.shape[1])
    assert_allclose(space.transform(points).std(axis=0, ddof=1), space.standard_deviations_)
    with pytest.raises(AttributeError, match="without faces"):
        space.mode_mesh(0, 1.0)


# Mirror images


def test_mirror_images_are_told_or_reflected():
    points = _wild(strength=0.01)
    mirrored = points.copy()
    mirrored[[1, 4]] = mirrored[[1, 4]] * [1, 1, -1]
    right = ShapeSpace(faces=BALL.faces).fit(points)
    assert not right.mirrored_.any()
    space = ShapeSpace(on_mirrored="reflect").fit(_meshes(_moved(mirrored)))
    assert_array_equal(np.flatnonzero(space.mirrored_), [1, 4])
    assert_allclose(space.transform(mirrored), right.transform(points), atol=1e-7)
    with pytest.warns(OrientationWarning, match="'body1', 'body4'"):
        wrong = ShapeSpace().fit(_meshes(mirrored))
    assert wrong.standard_deviations_[0] > 5 * right.standard_deviations_[0]
    with pytest.warns(OrientationWarning, match="shape 0"):
        right.transform(mirrored[1:2])


# As scikit-learn's transformers


def test_registered_meshes_and_arrays_are_the_same_to_it():
    points = _wild()
    of_array = ShapeSpace(faces=BALL.faces).fit(points)
    for X in (_meshes(points), _registered(points)):
        space = ShapeSpace().fit(X)
        assert_array_equal(space.modes_, of_array.modes_)
        assert_array_equal(space.transform(X), of_array.transform(points))
    assert_array_equal(stack(_registered(points)), points)


def test_parameters_are_stored_and_checked_in_fit():
    points = _wild()
    space = ShapeSpace(n_components=0, scale="yes", max_iter=-1, tol="small")
    assert clone(space).get_params() == space.get_params()
    for change, error, message in [
        ({"n_components": 0}, ValueError, "n_components must be an integer at least 1"),
        ({"n_components": 6}, ValueError, "less than the number of shapes: 6"),
        ({"n_components": 1.5}, ValueError, "fraction of variance between 0 and 1"),
        ({"n_components": "mle"}, TypeError, "n_components must be an integer"),
        ({"scale": "yes"}, ValueError, "scale must be one of"),
        ({"on_mirrored": "keep"}, ValueError, "on_mirrored must be one of"),
        ({"max_iter": 0}, ValueError, "max_iter"),
        ({"tol": "small"}, TypeError, "tol must be a number"),
        ({"faces": [[0, 1, 9999]]}, MeshError, "vertex 9999"),
    ]:
        with pytest.raises(error, match=message):
            ShapeSpace(**change).fit(points)


def test_fit_changes_nothing_and_fitting_again_is_the_same():
    points = _wild()
    before, space = points.copy(), ShapeSpace(faces=BALL.faces)
    given = space.get_params()
    assert space.fit(points) is space
    modes = space.modes_.copy()
    assert_array_equal(points, before)
    assert space.get_params() == given
    space.fit(_wild(seed=5)).fit(points)
    assert_array_equal(space.modes_, modes)
    assert_array_equal(ShapeSpace(faces=BALL.faces).fit_transform(points), space.transform(points))


def test_each_shape_is_transformed_by_itself():
    points = _wild()
    space = ShapeSpace(faces=BALL.faces).fit(points)
    alone = np.concatenate([space.transform(points[[i]]) for i in (4, 2)])
    assert_allclose(alone, space.transform(points)[[4, 2]], atol=1e-12)


def test_it_stands_in_a_pipeline_and_names_its_scores():
    points = _wild()
    pipeline = make_pipeline(ShapeSpace(2, faces=BALL.faces), StandardScaler()).fit(points)
    assert pipeline.get_feature_names_out().tolist() == ["mode0", "mode1"]
    assert_allclose(pipeline.transform(points).std(axis=0), 1)
    frame = ShapeSpace(2).set_output(transform="pandas").fit_transform(_meshes(points))
    assert list(frame.columns) == ["mode0", "mode1"]


def test_unfitted_spaces_say_so():
    space = ShapeSpace()
    for call in (
        lambda: space.transform(_wild()),
        lambda: space.inverse_transform([[0.0]]),
        lambda: space.mode_mesh(0, 1.0),
        lambda: space.mean_mesh_,
        space.get_feature_names_out,
    ):
        with pytest.raises(NotFittedError):
            call()


def test_saved_spaces_give_the_same_scores(tmp_path):
    points = _wild()
    space = ShapeSpace(2, faces=BALL.faces).fit(points)
    joblib.dump(space, tmp_path / "space.joblib")
    save_model(space, tmp_path / "space.skops")
    for saved in (joblib.load(tmp_path / "space.joblib"), load_model(tmp_path / "space.skops")):
        assert_allclose(saved.transform(points), space.transform(points), atol=1e-12)


# Errors


def test_shapes_that_were_left_out_or_do_not_fit_are_named():
    points = _wild()
    registered = _registered(points)
    registered[1] = _registered(points * np.nan, fits=False)[1]
    registered[3] = _registered(points, fits=False)[3]
    for call in (stack, ShapeSpace().fit):
        with pytest.raises(MeshError, match=r"'body1': left out.* 'body3': the reference does not"):
            call(registered)
    kept = [one for one in registered if one.fits]
    assert stack(kept).shape == (4, *points.shape[1:])


def test_other_faces_are_refused_by_name():
    points = _wild()
    other = Mesh(points[0], BALL.faces[:, [1, 2, 0]], "turned")
    told = "'turned' has as many vertices and faces as 'body0', but the faces themselves differ"
    with pytest.raises(MeshError, match=told):
        ShapeSpace().fit([*_meshes(points), other])
    fewer = Mesh(points[0], BALL.faces[:-1], "open")
    told = r"'open' has 1026 vertices and 2047 faces, unlike 'body0' \(1026 and 2048\)"
    with pytest.raises(MeshError, match=told):
        ShapeSpace().fit([*_meshes(points), fewer])
    space = ShapeSpace().fit(_meshes(points))
    with pytest.raises(MeshError, match="in other faces"):
        space.transform([other])
    with pytest.raises(MeshError, match="got 9 vertices"):
        space.transform(points[:, :9])
    with pytest.raises(ValueError, match=r"scores of 5 modes, shape \(n_shapes, 5\)"):
        space.inverse_transform(np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("X", "error", "message"),
    [
        (FORM, ValueError, r"shape \(n_shapes, n_vertices, 3\); got \(\d+, 3\)"),
        (FORM[None], ValueError, "only one shape"),
        (np.stack([FORM, FORM * np.nan]), MeshError, "NaN or too large coordinates in shape 1"),
        (np.stack([FORM, FORM]), ValueError, "without variation"),
        (Mesh(FORM, BALL.faces), TypeError, "got one Mesh"),
        ([], ValueError, "X is empty"),
        ([Mesh(FORM, BALL.faces), FORM], TypeError, r"ndarray at X\[1\]\. .*np\.stack\(X\)"),
        ([Mesh(FORM, BALL.faces), (FORM, BALL.faces)], TypeError, r"tuple at X\[1\]\.$"),
        (["a.off", "b.off"], TypeError, r"str at X\[0\]\. .*io\.read_mesh"),
        ([Mesh(FORM, BALL.faces), *_registered([FORM])], TypeError, r"at X\[1\]\. .*\.mesh"),
    ],
)
def test_what_is_no_collection_is_refused(X, error, message):
    with pytest.raises(error, match=message):
        ShapeSpace().fit(X)


def test_faces_are_refused_for_shapes_that_have_their_own():
    for given in (_meshes(_wild()), _registered(_wild())):
        with pytest.raises(ValueError, match=r"ShapeSpace\(faces=\.\.\.\) is for .* array"):
            ShapeSpace(faces=BALL.faces).fit(given)


def test_shapes_without_size_are_refused():
    with pytest.raises(MeshError, match=r"The first shape, .*, has no area"):
        ShapeSpace(faces=BALL.faces).fit(np.stack([0 * FORM, FORM]))
    with pytest.raises(MeshError, match="it has no size"):
        ShapeSpace(scale=True).fit(np.stack([FORM, 0 * FORM]))


def test_stack_takes_registered_shapes_only():
    with pytest.raises(TypeError, match=r"registered\[0\] must be what skfmap.register returns"):
        stack(_meshes(_wild()))


def test_an_alignment_that_does_not_converge_says_so():
    with pytest.warns(ConvergenceWarning, match="did not converge in 1 iterations"):
        ShapeSpace(faces=BALL.faces, max_iter=1).fit(_wild())
