"""Collections in folders: every format says the same, and what does not fit is refused at once."""

import re

import numpy as np
import pytest

from skfmap import Mesh
from skfmap.datasets import load_collection, make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError, SkippedShapeWarning
from skfmap.io import write_mesh

N = 66


@pytest.fixture(scope="module")
def orders():
    """Return the vertex of each template point on three renumbered spheres."""
    rng = np.random.default_rng(0)
    return {name: rng.permutation(N) for name in ("cat0", "cat2", "cat10")}


@pytest.fixture
def folder(tmp_path, orders):
    """Write three spheres whose vertices are numbered differently, without correspondences."""
    sphere = make_sphere(2)
    for name, order in orders.items():
        write_mesh(
            Mesh(sphere.vertices[np.argsort(order)], order[sphere.faces]), tmp_path / f"{name}.off"
        )
    return tmp_path


def save(path, values):
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        np.savetxt(path, values, fmt="%d")


def write_kind(folder, kind, orders):
    """Write the correspondences of all shapes in one of the formats."""
    for name, order in orders.items():
        base, suffix = kind.rsplit(".", 1)
        values = {
            "": order + 1,
            ".vertices": np.argsort(order),
            ".template": order,
            ".pairs": np.column_stack([order, np.arange(N)]),
        }[base]
        save(folder / f"{name}{base.replace('.pairs', '')}.{suffix}", values)


@pytest.mark.parametrize(
    "kind",
    [
        ".vts",
        ".vertices.txt",
        ".vertices.npy",
        ".template.txt",
        ".template.npy",
        ".pairs.txt",
        ".pairs.npy",
    ],
)
def test_every_format_says_the_same(folder, orders, kind):
    write_kind(folder, kind, orders)
    data = load_collection(folder)
    assert data.names == ["cat0", "cat2", "cat10"]
    for mesh, truth, order in zip(data.meshes, data.correspondences, orders.values(), strict=True):
        assert {tuple(row) for row in truth.pairs.tolist()} == set(
            zip(order.tolist(), range(N), strict=True)
        )
        joined = truth.join(data.correspondences[0])
        np.testing.assert_allclose(
            mesh.vertices[joined.vertices_i], data.meshes[0].vertices[joined.vertices_0], atol=1e-6
        )
    assert not data.correspondences[0].has_symmetric
    assert "3 meshes" in data.DESCR


def test_symmetric_answers_of_vts_files_count_from_1_too(folder, orders):
    write_kind(folder, ".vts", orders)
    for name, order in orders.items():
        save(folder / f"{name}.sym.vts", order[::-1] + 1)
    truth = load_collection(str(folder)).correspondences[1]
    by_point = truth.symmetric_pairs[np.argsort(truth.symmetric_pairs[:, 1])]
    np.testing.assert_array_equal(by_point[:, 0], orders["cat2"][::-1])


def test_unknown_vertices_and_points_are_left_out(folder, orders):
    for name, order in orders.items():
        save(folder / f"{name}.template.txt", np.where(np.arange(N) < 10, -1, order))
    assert all(len(truth.pairs) == N - 10 for truth in load_collection(folder).correspondences)


def test_formats_may_differ_from_mesh_to_mesh(folder, orders):
    save(folder / "cat0.vts", orders["cat0"] + 1)
    save(folder / "cat2.vertices.npy", np.argsort(orders["cat2"]))
    save(folder / "cat10.txt", np.column_stack([orders["cat10"], np.arange(N)]))
    data = load_collection(folder)
    joined = data.correspondences[2].join(data.correspondences[1])
    assert dict(zip(joined.points.tolist(), joined.vertices_0.tolist(), strict=True)) == dict(
        enumerate(orders["cat2"])
    )


@pytest.mark.parametrize("suffix", [".off", ".obj", ".ply"])
def test_same_connectivity_needs_no_files(tmp_path, suffix):
    for name in ("b", "a"):
        write_mesh(make_sphere(1), tmp_path / f"{name}{suffix}")
    data = load_collection(tmp_path)
    assert data.names == [mesh.name for mesh in data.meshes] == ["a", "b"]
    assert data.correspondences[1].pairs.tolist() == [[v, v] for v in range(18)]
    assert "by number" in data.DESCR


def test_reference_comes_first_and_the_rest_in_natural_order(folder, orders):
    write_kind(folder, ".vts", orders)
    data = load_collection(folder, reference="cat10")
    assert data.names == [mesh.name for mesh in data.meshes] == ["cat10", "cat0", "cat2"]
    first = data.correspondences[0].pairs
    np.testing.assert_array_equal(first[np.argsort(first[:, 1]), 0], orders["cat10"])
    with pytest.raises(ValueError, match=r"'dog'.*cat2"):
        load_collection(folder, reference="dog")


def test_pattern_chooses_by_name(folder, orders):
    write_kind(folder, ".vts", orders)
    write_mesh(make_sphere(1), folder / "dog0.off")
    assert load_collection(folder, "cat*").names == ["cat0", "cat2", "cat10"]
    assert load_collection(folder, "cat?").names == ["cat0", "cat2"]


def test_other_files_are_no_meshes(folder, orders):
    write_kind(folder, ".vts", orders)
    (folder / "notes.txt").write_text("Three cats.")
    (folder / "cat0.png").write_bytes(b"")
    assert len(load_collection(folder).meshes) == 3


def test_missing_or_empty_folders(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load_collection(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="no mesh"):
        load_collection(tmp_path)
    write_mesh(make_sphere(1), tmp_path / "a.off")
    with pytest.raises(FileNotFoundError, match=r"cat\*"):
        load_collection(tmp_path, "cat*")


def replaced(values, index, value):
    values = np.array(values)
    values[index] = value
    return values


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("cat2.vts", 0, "counted from 1"),
        ("cat2.vts", N + 1, f"up to {N}"),
        ("cat2.vts", -1, "counted from 1"),
        ("cat2.sym.vts", 0, "counted from 1"),
        ("cat2.template.txt", N, "cat2"),
        ("cat2.template.npy", -2, "-2"),
        ("cat2.vertices.txt", -2, "-2"),
    ],
)
def test_indices_out_of_range_are_refused_when_loaded(folder, orders, name, value, message):
    kind = ".vts" if "vts" in name else name.removeprefix("cat2")
    write_kind(folder, kind, orders)
    save(folder / name, replaced(orders["cat2"], 7, value))
    with pytest.raises(CorrespondenceError, match=message):
        load_collection(folder)


@pytest.mark.parametrize("value", [[N, 0], [-1, 0], [0, -1]])
def test_pairs_out_of_range_are_refused_when_loaded(folder, orders, value):
    write_kind(folder, ".pairs.txt", orders)
    save(folder / "cat2.txt", [[0, 1], value])
    with pytest.raises(CorrespondenceError, match=r"cat2|negative"):
        load_collection(folder)


def test_a_file_that_is_not_there_is_named(folder, orders):
    write_kind(folder, ".vts", orders)
    (folder / "cat10.vts").unlink()
    with pytest.raises(CorrespondenceError, match="cat10") as error:
        load_collection(folder)
    assert "cat2" not in str(error.value)


def test_one_column_in_a_file_of_pairs_is_refused_with_both_readings(folder, orders):
    write_kind(folder, ".template.txt", orders)
    for name in orders:
        (folder / f"{name}.template.txt").rename(folder / f"{name}.txt")
    with pytest.raises(CorrespondenceError, match=r"cat0\.vertices\.txt") as error:
        load_collection(folder)
    assert "cat0.template.txt" in str(error.value)


def test_a_file_of_vertices_needs_one_line_for_each(folder, orders):
    write_kind(folder, ".vertices.txt", orders)
    save(folder / "cat2.vertices.txt", np.arange(N - 1))
    with pytest.raises(CorrespondenceError, match=f"cat2.*{N} vertices"):
        load_collection(folder)


def test_unequal_connectivity_without_files_is_refused(folder):
    with pytest.raises(CorrespondenceError, match="'cat2' has other faces than 'cat0'"):
        load_collection(folder)


def test_what_to_do_about_missing_files_is_said_once(folder):
    with pytest.warns(SkippedShapeWarning) as told:
        load_collection(folder, on_invalid="skip")
    (said,) = [str(one.message) for one in told]
    assert said.count("Add a file for each mesh") == said.count("--by-number") == 1
    assert all(f"{name!r} has other faces than 'cat0'" in said for name in ("cat2", "cat10"))


def test_one_name_in_two_formats_is_refused(folder):
    write_mesh(make_sphere(2), folder / "cat2.obj")
    with pytest.raises(ValueError, match=r"\['cat2'\] in more than one format"):
        load_collection(folder)


@pytest.mark.parametrize("content", ["1 2\n3\n", "one\n", "1.5\n" * N, "nan\n" * N, ""])
def test_what_are_no_whole_numbers_is_refused_and_warns_of_nothing(folder, orders, content):
    write_kind(folder, ".vts", orders)
    (folder / "cat2.vts").write_text(content)
    with pytest.raises(CorrespondenceError, match="cat2"):
        load_collection(folder)


def test_broken_npy_files_are_refused(folder, orders):
    write_kind(folder, ".template.npy", orders)
    for content in (b"", b"no array", (folder / "cat0.template.npy").read_bytes()[:-20]):
        (folder / "cat2.template.npy").write_bytes(content)
        with pytest.raises(CorrespondenceError, match="cat2"):
            load_collection(folder)


def test_broken_meshes_are_refused(folder, orders):
    write_kind(folder, ".vts", orders)
    (folder / "cat2.off").write_text("OFF\n")
    with pytest.raises(MeshError, match="cat2"):
        load_collection(folder)


def test_stl_meshes_take_no_correspondences(tmp_path):
    for name in ("a", "b"):
        write_mesh(make_sphere(1), tmp_path / f"{name}.stl")
        np.savetxt(tmp_path / f"{name}.vts", np.arange(1, 19), fmt="%d")
    with pytest.raises(CorrespondenceError, match="an STL file have no fixed order"):
        load_collection(tmp_path)


def test_vts_files_have_one_length(tmp_path):
    for name, n_lines in (("a", 18), ("b", 18), ("c", 12)):
        write_mesh(make_sphere(1), tmp_path / f"{name}.off")
        np.savetxt(tmp_path / f"{name}.vts", np.arange(1, n_lines + 1), fmt="%d")
    with pytest.raises(CorrespondenceError, match=r"18 here; these differ: \{'c.vts': 12\}"):
        load_collection(tmp_path)


def test_a_file_is_no_folder_and_patterns_may_have_a_suffix(tmp_path):
    for name in ("a", "b"):
        write_mesh(make_sphere(1), tmp_path / f"{name}.off")
    with pytest.raises(NotADirectoryError, match=r"a\.off is a file"):
        load_collection(tmp_path / "a.off")
    assert load_collection(tmp_path, "*.off").names == ["a", "b"]


def test_one_mesh_without_correspondences_does_not_lose_the_folder(tmp_path, collection):
    for i in range(3):
        write_mesh(collection.meshes[i], tmp_path / f"body{i}.off")
    for i in range(2):
        np.savetxt(tmp_path / f"body{i}.txt", collection.truths[i].pairs, fmt="%d")
    (tmp_path / "._body0.off").write_bytes(b"what another system leaves")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(CorrespondenceError, match=r"none for \['body2'\]"):
        load_collection(tmp_path)
    with pytest.warns(SkippedShapeWarning, match=r"1 of 3 shapes are left out. X\[2\]"):
        assert load_collection(tmp_path, on_invalid="skip").names == ["body0", "body1", "body2"]
    for i in range(3):
        np.savetxt(tmp_path / f"body{i}.vts", 1 + np.arange(9 + (i == 1)), fmt="%d")
    with pytest.warns(SkippedShapeWarning, match=r"X\[1\].*'body1.vts': 10"):
        load_collection(tmp_path, on_invalid="skip")
    for path in [*tmp_path.glob("*.vts"), *tmp_path.glob("*.txt")]:
        path.unlink()
    with pytest.warns(SkippedShapeWarning, match=r"2 of 3 shapes are left out.*other faces"):
        load_collection(tmp_path, on_invalid="skip")
    (tmp_path / "body0.sym.vts").write_text("1\n")
    with pytest.raises(CorrespondenceError, match=r"body0.sym.vts has no body0.vts beside it"):
        load_collection(tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("f.template.txt", "-5\n"),
        ("f.vertices.txt", "3\n"),
        ("f.txt", "1 -2\n"),
        ("f.vertices.txt", "1e30\n"),
    ],
)
def test_faults_in_correspondence_files_name_the_file(tmp_path, name, content):
    write_mesh(make_sphere(2), tmp_path / "f.off")
    (tmp_path / name).write_text(content)
    with pytest.raises(CorrespondenceError, match=re.escape(name)):
        load_collection(tmp_path)


def test_names_with_odd_digits_are_sorted(tmp_path):
    write_mesh(make_sphere(2), tmp_path / "1²2.off")
    assert load_collection(tmp_path).names == ["1²2"]
