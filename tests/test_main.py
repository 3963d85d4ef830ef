"""The main job as a person runs it."""

import subprocess
import sys

import joblib
import numpy as np
import pytest
from matplotlib.image import imread

from skfmap import Mesh
from skfmap.__main__ import main
from skfmap.commands import demo
from skfmap.datasets import make_sphere
from skfmap.exceptions import DisagreementWarning, RepairWarning, SkippedShapeWarning
from skfmap.io import write_mesh
from skfmap.persistence import load_model


@pytest.fixture
def folder(symmetric_collection, tmp_path):
    for mesh, truth in zip(symmetric_collection.meshes, symmetric_collection.truths, strict=True):
        write_mesh(mesh, tmp_path / f"{mesh.name}.off")
        for suffix, pairs in ((".vts", truth.pairs), (".sym.vts", truth.symmetric_pairs)):
            np.savetxt(
                tmp_path / f"{mesh.name}{suffix}", pairs[np.argsort(pairs[:, 1]), 0] + 1, fmt="%d"
            )
    return tmp_path


# Of the two that are left to learn from neither bends as far as body3.
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
def test_main_job_on_a_folder(folder, capsys):
    output = folder / "out"
    status = main(
        [str(folder), "--output", str(output), "--functions", "10", "--folds", "2", "--jobs", "1"]
    )
    printed = capsys.readouterr().out
    assert status == 0
    table = printed[printed.index("weighting ") :].splitlines()
    assert [row.split()[0] for row in table[1:5]] == ["none", "unique", "category", "function"]
    assert all(
        0 < float(cell) < 100 for row in table[1:5] for cell in row.replace("|", " ").split()[-12:]
    )
    assert "Leaving out one at a time: body1, body3." in printed
    assert imread(output / "matches.png")[..., :3].std() > 0.05
    assert "body3" in (output / "report.html").read_text(encoding="utf-8")
    assert load_model(output / "model.skops")[-1].reference_.name == "body0"
    assert (output / "errors.txt").read_text(encoding="utf-8") in printed
    assert f"match {output / 'model.skops'} NEW.ply -o out" in printed


# Two shapes are few to learn from.
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.StabilityWarning")
def test_without_skops_the_model_is_of_joblib(folder, monkeypatch, capsys):
    monkeypatch.setattr(demo, "find_spec", lambda _: None)
    output = folder / "out"
    short = ["--functions", "10", "--folds", "1", "--jobs", "1", "--pattern", "body[012]"]
    assert main([str(folder), "--output", str(output), *short]) == 0
    assert joblib.load(output / "model.joblib")[-1].reference_.name == "body0"
    assert "model.joblib NEW.ply" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no folder nowhere"),
        (["{}", "--pattern", "dog*"], "no mesh 'dog*'"),
        (["{}", "--reference", "body9"], "reference='body9' is not one of"),
        (["{}", "--folds", "0"], "--folds must be an integer at least 1"),
        (["{}", "--pattern", "body[01]"], "needs a reference and at least two more"),
    ],
)
def test_main_job_says_what_is_wrong_in_one_line(folder, capsys, arguments, message):
    arguments = [text.format(folder) for text in arguments]
    assert main([*arguments, "--output", str(folder / "out"), "--jobs", "1"]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1


def test_a_wrong_correspondence_is_told_once(collection, tmp_path):
    rng = np.random.default_rng(0)
    for i in range(5):
        pairs = collection.truths[i].pairs.copy()
        if i == 3:
            pairs[:, 0] = rng.permutation(pairs[:, 0])
        write_mesh(collection.meshes[i], tmp_path / f"body{i}.off")
        np.savetxt(tmp_path / f"body{i}.txt", pairs, fmt="%d")
    options = [
        str(tmp_path),
        "--output",
        str(tmp_path / "out"),
        "--functions",
        "10",
        "--folds",
        "1",
        "--jobs",
        "1",
    ]
    with pytest.warns(DisagreementWarning, match="'body3'") as told:
        assert main(options) == 0
    assert [one.category for one in told] == [DisagreementWarning]


def test_warnings_are_printed_without_lines_of_code(folder):
    (folder / "body1.off").write_text("OFF\n3 1 0\n0 0 0\n")
    code = [
        sys.executable,
        "-m",
        "skfmap",
        str(folder),
        "--output",
        str(folder / "out"),
        "--on-invalid",
        "skip",
    ]
    code += ["--functions", "10", "--folds", "1", "--jobs", "1"]
    done = subprocess.run(code, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[0].startswith(
        "SkippedShapeWarning: 1 of 4 shapes are left out. X[1], shape 'body1'"
    )
    assert "left out: body1\n" in done.stdout
    assert ".py" not in done.stderr


@pytest.fixture
def folder_with(tmp_path, collection):
    """Return a function that writes bodies with their pairs, the second of them broken."""

    def write(breaks):
        folder = tmp_path / "meshes"
        folder.mkdir()
        for i, (mesh, truth) in enumerate(
            zip(collection.meshes[:4], collection.truths, strict=False)
        ):
            vertices, faces, pairs = mesh.vertices, mesh.faces, truth.pairs
            if i == 1:
                vertices, faces, pairs = breaks(vertices, faces, pairs)
            write_mesh(Mesh(vertices, faces), folder / f"body{i}.off")
            np.savetxt(folder / f"body{i}.txt", pairs, fmt="%d")
        options = [str(folder), "--output", str(tmp_path / "out")]
        return [*options, "--functions", "10", "--folds", "1", "--jobs", "1"]

    return write


def _loose(vertices, faces, pairs):
    """Put a vertex in front of all others that no face uses."""
    return np.vstack([[9.0, 9, 9], vertices]), faces + 1, np.add(pairs, [1, 0])


def _of_no_size(vertices, faces, pairs):
    """Scale to where areas are no numbers: nothing helps."""
    return 1e-180 * vertices, faces, pairs


@pytest.mark.parametrize("option", [[], ["--on-invalid", "skip"]])
def test_the_command_line_mends_a_broken_mesh(folder_with, capsys, option):
    options = folder_with(_loose)
    assert main([*options, "--on-invalid", "raise"]) == 2
    assert "body1" in capsys.readouterr().err
    with pytest.warns(RepairWarning, match="'body1': removed 1 vertices that no face used"):
        assert main([*options, *option]) == 0
    assert "left out: " not in capsys.readouterr().out


def test_the_command_line_goes_on_without_a_mesh_that_cannot_be_mended(
    folder_with, tmp_path, capsys
):
    options = folder_with(_of_no_size)
    assert main(options) == 2
    assert "body1" in (told := capsys.readouterr().err)
    assert "--on-invalid skip goes on" in told
    with pytest.warns(SkippedShapeWarning, match="body1"):
        assert main([*options, "--on-invalid", "skip"]) == 0
    assert "left out: body1\n" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.html").exists()


def test_the_command_line_says_what_is_wrong_before_it_computes(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["--output", str(tmp_path / "file")]) == 2
    assert "--output" in capsys.readouterr().err
    assert main([str(tmp_path), "--pattern", "/x", "--output", str(tmp_path / "out")]) == 2
    assert "pattern must match names of meshes" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.StabilityWarning")
def test_the_command_line_takes_small_meshes(tmp_path, capsys):
    folder = tmp_path / "balls"
    folder.mkdir()
    for i in range(4):
        ball = make_sphere(n_subdivisions=2)
        write_mesh(Mesh(ball.vertices * [1, 1 + 0.2 * i, 1.5], ball.faces), folder / f"ball{i}.off")
    options = [str(folder), "--output", str(tmp_path / "out")]
    assert main([*options, "--functions", "8", "--folds", "1", "--jobs", "1"]) == 0
