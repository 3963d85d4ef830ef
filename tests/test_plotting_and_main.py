"""Pictures that can be told from blank ones, and the main job as a person runs it."""

import joblib
import numpy as np
import pytest
from matplotlib.image import imread

from skfmap.__main__ import main
from skfmap.io import write_mesh
from skfmap.plotting import plot_function, plot_matches, plot_reliability


def test_a_function_is_drawn_in_its_colours(collection, tmp_path):
    mesh = collection.meshes[0]
    axes = plot_function(mesh, mesh.vertices[:, 0], up="z")
    (drawn,) = axes.collections
    assert len(drawn.get_paths()) == mesh.n_faces
    axes.figure.savefig(tmp_path / "function.png")
    assert imread(tmp_path / "function.png")[..., :3].std() > 0.05


def test_colours_of_a_match_are_those_of_the_matched_vertices(collection, fitted, probed):
    mesh, (match,) = collection.meshes[5], fitted.match(probed[5:])
    figure = plot_matches([match], [mesh], collection.meshes[0], captions=["caption"])
    assert "body5\ncaption" in [axes.get_title() for axes in figure.axes]
    with pytest.raises(ValueError, match="one mesh per match"):
        plot_matches([match], [], collection.meshes[0])


def test_reliability_is_the_mean_error_of_equal_bins():
    expected = np.linspace(0, 1, 100)
    axes = plot_reliability(expected[::-1], 2 * expected[::-1], n_bins=4)
    x, y = axes.lines[0].get_data()
    np.testing.assert_allclose(x, expected.reshape(4, 25).mean(axis=1))
    np.testing.assert_allclose(y, 2 * x)
    with pytest.raises(ValueError, match="equally long"):
        plot_reliability(expected, expected[:5])


def test_the_least_stable_part_of_the_reference_can_be_looked_at(fitted, probed):
    where = fitted.stability_function()
    spread = np.sqrt(fitted.reference_.spectral.mass @ where**2)
    np.testing.assert_allclose(spread, np.linalg.norm(fitted.stability_) / 2, rtol=1e-9)  # of four training shapes


@pytest.fixture
def folder(symmetric_collection, tmp_path):
    for mesh, truth in zip(symmetric_collection.meshes, symmetric_collection.truths, strict=True):
        write_mesh(mesh, tmp_path / f"{mesh.name}.off")
        for suffix, pairs in ((".vts", truth.pairs), (".sym.vts", truth.symmetric_pairs)):
            np.savetxt(tmp_path / f"{mesh.name}{suffix}", pairs[np.argsort(pairs[:, 1]), 0] + 1, fmt="%d")
    return tmp_path


def test_main_job_on_a_folder(folder, capsys):
    output = folder / "out"
    status = main([str(folder), "--output", str(output), "--functions", "15", "--folds", "2", "--jobs", "1"])
    printed = capsys.readouterr().out
    assert status == 0
    table = printed[printed.index("weighting ") :].splitlines()
    assert [row.split()[0] for row in table[1:5]] == ["none", "unique", "category", "function"]
    assert all(0 < float(cell) < 100 for row in table[1:5] for cell in row.replace("|", " ").split()[-9:])
    assert "Leaving out one at a time: body1, body3." in printed
    assert imread(output / "matches.png")[..., :3].std() > 0.05
    assert joblib.load(output / "model.joblib")[-1].reference_.name == "body0"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no folder nowhere"),
        (["{}", "--pattern", "dog*"], "no mesh 'dog*'"),
        (["{}", "--reference", "body9"], "reference='body9' is not among"),
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
