"""Landmarks of 3D Slicer beside the meshes of a folder."""

import json

import numpy as np
import pytest

from skfmap import Mesh
from skfmap.datasets import load_collection, make_sphere
from skfmap.datasets._landmark_files import nearest_vertices
from skfmap.exceptions import CorrespondenceError, RepairWarning
from skfmap.io import write_mesh


def _write(path, points, **changes):
    points = [
        {"id": str(i), "label": label, "position": list(map(float, at)), "positionStatus": status}
        for i, (label, at, status) in enumerate(points)
    ]
    markup = {"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points, **changes}
    path.write_text(json.dumps({"markups": [markup]}))


@pytest.fixture
def folder(tmp_path, collection):
    """Three bodies with landmarks at the same template points, in orders of their own."""
    for i, mesh in enumerate(collection.meshes[:3]):
        write_mesh(mesh, tmp_path / f"body{i}.off")
        vertices = collection.truths[i].pairs[:40, 0]
        points = [(f"L{j}", mesh.vertices[v], "defined") for j, v in enumerate(vertices)]
        _write(tmp_path / f"body{i}.mrk.json", points[i:] + points[:i])
    return tmp_path


def test_points_of_the_same_label_correspond(folder, collection):
    data = load_collection(folder)
    for i in (1, 2):
        joined = data.correspondences[i].join(data.correspondences[0])
        expected = collection.truths[i].pairs[:40, 0], collection.truths[0].pairs[:40, 0]
        assert set(zip(joined.vertices_i.tolist(), joined.vertices_0.tolist(), strict=True)) == set(
            zip(*(one.tolist() for one in expected), strict=True)
        )
    assert data.paths == [str(folder / f"body{i}.off") for i in range(3)]


def test_a_point_that_was_not_placed_is_missing_and_no_other_moves(folder, collection):
    mesh = collection.meshes[1]
    vertices = collection.truths[1].pairs[:40, 0]
    points = [(f"L{j}", mesh.vertices[v], "defined") for j, v in enumerate(vertices)]
    points[5] = ("L5", [0, 0, 0], "undefined")
    points[6] = ("L6", [np.nan, 0, 0], "defined")
    _write(folder / "body1.mrk.json", points)
    data = load_collection(folder)
    joined = data.correspondences[1].join(data.correspondences[0])
    assert joined.vertices_i.tolist() == np.delete(vertices, [5, 6]).tolist()


def test_the_other_system_of_coordinates_is_recognised_and_told(folder, collection):
    mesh = collection.meshes[1]
    vertices = collection.truths[1].pairs[:40, 0]
    points = [(f"L{j}", mesh.vertices[v] * [-1, -1, 1], "defined") for j, v in enumerate(vertices)]
    _write(folder / "body1.mrk.json", points)
    with pytest.warns(RepairWarning, match="body1.*x and y negated"):
        data = load_collection(folder)
    assert data.correspondences[1].pairs[:, 0].tolist() == vertices.tolist()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "cannot be read as one list of points of 3D Slicer: JSONDecodeError"),
        ('{"markups": []}', "cannot be read as one list of points"),
        ('{"markups": [{"controlPoints": [{"label": "a"}]}]}', "KeyError: 'position'"),
        ('{"markups": [{"controlPoints": []}]}', "holds no landmark that was placed"),
    ],
)
def test_a_file_that_holds_no_points_is_named(folder, content, message):
    (folder / "body1.mrk.json").write_text(content)
    with pytest.raises(CorrespondenceError, match=message) as error:
        load_collection(folder)
    assert "body1.mrk.json" in str(error.value)


def test_points_of_one_name_and_points_beside_the_mesh_are_refused(folder, collection):
    at = collection.meshes[1].vertices
    _write(folder / "body1.mrk.json", [("a", at[0], "defined"), ("a", at[1], "defined")])
    with pytest.raises(CorrespondenceError, match="several points of one name: a"):
        load_collection(folder)
    metres = [(f"L{j}", at[j] / 1000 + 50, "defined") for j in range(9)]
    _write(folder / "body1.mrk.json", metres)
    with pytest.raises(CorrespondenceError, match=r"do not lie on 'body1'.*Another unit"):
        load_collection(folder)


def test_landmarks_that_lie_on_the_mesh_as_they_are_are_not_turned(tmp_path):
    """An egg is nearly its own image when it is turned by half."""
    ball = make_sphere(n_subdivisions=3)
    egg = Mesh(ball.vertices * [1, 1.3, 1.7], ball.faces, "egg")
    at = np.random.default_rng(0).choice(egg.n_vertices, 20, replace=False)
    vertices, turned = nearest_vertices(egg.vertices[at] + 0.005, egg, tmp_path / "egg.mrk.json")
    assert turned == ""
    np.testing.assert_array_equal(vertices, at)
