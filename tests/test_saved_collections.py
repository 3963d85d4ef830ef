"""A collection that was written to a folder is read again as it was."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from skfmap import Correspondence, Mesh
from skfmap.commands import main
from skfmap.datasets import load_collection, make_creatures, make_sphere, save_collection
from skfmap.exceptions import CorrespondenceError


def _alike(one, other):
    rows = [
        {tuple(row) for row in ([] if each is None else each.tolist())}
        for truth in (one, other)
        for each in (truth.pairs, truth.symmetric_pairs)
    ]
    return rows[:2] == rows[2:]


@pytest.fixture(scope="module")
def balls():
    ball = make_sphere(2)
    return [Mesh(ball.vertices * [1, 1, s], ball.faces, name=f"ball{s}") for s in (1, 2, 10)]


@pytest.mark.parametrize("suffix", [".off", ".obj", ".vtk", ".vtp"])
def test_meshes_and_pairs_come_back(tmp_path, suffix):
    made = make_creatures(n_shapes=3, n_vertices=500)
    folder = tmp_path / "cats"
    written = save_collection(folder, made.meshes, made.correspondences, suffix=suffix)
    again = load_collection(folder)
    assert again.paths == [str(path) for path in written]
    assert again.names == made.names
    for mesh, other in zip(made.meshes, again.meshes, strict=True):
        digits = 1e-15 * np.abs(mesh.vertices).max()
        np.testing.assert_allclose(other.vertices, mesh.vertices, rtol=0, atol=digits)
        np.testing.assert_array_equal(other.faces, mesh.faces)
    truths = zip(made.correspondences, again.correspondences, strict=True)
    assert all(_alike(*pair) for pair in truths)


def test_points_of_many_vertices_and_symmetric_answers_come_back(balls, tmp_path):
    rng = np.random.default_rng(0)
    truths = [
        Correspondence(rng.integers(0, 66, (n, 2)), rng.integers(0, 66, (5, 2)))
        for n in (1, 40, 200)
    ]
    save_collection(tmp_path, balls, truths)
    again = load_collection(tmp_path).correspondences
    assert all(_alike(*pair) for pair in zip(truths, again, strict=True))


def test_landmarks_keep_names_coordinates_and_gaps(balls, tmp_path):
    names = ["nose, left", "tail", "7"]
    points = [[[0.1, 0.2, 1.0], [1.05, 0, 0], [0, -1, 0]]] * 3
    points[1] = [[0.1, 0.2, 2.0], [np.nan] * 3, [0, -1.01, 0]]
    truths = [
        Correspondence.from_points(at, ball, names=names, max_distance=2)
        for at, ball in zip(points, balls, strict=True)
    ]
    save_collection(tmp_path, balls, truths)
    again = load_collection(tmp_path)
    for truth, other in zip(truths, again.correspondences, strict=True):
        assert other.known_names == truth.known_names
        rows = [other.landmarks.names.index(name) for name in truth.landmarks.names]
        np.testing.assert_array_equal(other.landmarks.points[rows], truth.landmarks.points)


def test_places_without_coordinates_come_back_as_points(balls, tmp_path):
    corners, weights = balls[0].faces[:2], np.array([[0.5, 0.25, 0.25], [0.4, 0.3, 0.3]])
    at = Correspondence(np.column_stack([corners[:, 0], [4, 2]]), places=(corners, weights))
    save_collection(tmp_path, balls[:2], [at, at])
    again = load_collection(tmp_path).correspondences[1]
    wanted = np.einsum("nc,ncd->nd", weights, balls[1].vertices[corners])
    found = dict(zip(again.landmarks.names, again.landmarks.points, strict=True))
    np.testing.assert_allclose([found["5"], found["3"]], wanted, atol=1e-15)


def test_the_shell_reads_what_was_written(balls, tmp_path, capsys):
    same = Correspondence(np.column_stack([np.arange(66)] * 2))
    save_collection(tmp_path / "f", balls, [same] * 3, suffix=".ply")
    assert main(["check", str(tmp_path / "f")]) == 0
    assert "66 pairs per mesh read beside them (NAME.txt for 3)" in capsys.readouterr().out


def test_what_no_folder_holds_is_told_and_nothing_is_written(balls, tmp_path):
    pairs = Correspondence([[0, 0], [1, 1]])
    named = replace(pairs, names=("a", "b"))
    soft = Correspondence.from_matrix(sp.eye_array(66).tocsr() * 0.5)
    faults = {
        "soft pairs": [soft] * 3,
        "no pairs": [Correspondence(np.empty((0, 2), dtype=int))] * 3,
        "there are 66 vertices": [Correspondence([[66, 0]])] * 3,
        "symmetric answers": [replace(named, symmetric_pairs=pairs.pairs)] * 3,
        "of the same kind": [named, named, pairs],
    }
    for said, truths in faults.items():
        with pytest.raises(CorrespondenceError, match=said):
            save_collection(tmp_path / "f", balls, truths)
    names = {"a/b": "name of a file", None: "name of a file", "BALL2": "Two meshes are called"}
    for name, said in names.items():
        with pytest.raises(ValueError, match=said):
            save_collection(tmp_path / "f", [replace(balls[0], name=name), *balls[1:]], [pairs] * 3)
    with pytest.raises(ValueError, match="3 meshes and 1 corr"):
        save_collection(tmp_path / "f", balls, [pairs])
    with pytest.raises(ValueError, match=r"suffix must be one of .off"):
        save_collection(tmp_path / "f", balls, [pairs] * 3, suffix=".stl")
    with pytest.raises(TypeError, match=r"meshes\[0\] must be a skfmap.Mesh; got str"):
        save_collection(tmp_path / "f", ["a.off"], [pairs])
    with pytest.raises(FileNotFoundError, match="no folder"):
        save_collection(tmp_path / "no" / "f", balls, [pairs] * 3)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "ball1.vts").write_text("1\n")
    with pytest.raises(FileExistsError, match="is not empty"):
        save_collection(tmp_path, balls, [pairs] * 3)
