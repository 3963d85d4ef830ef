"""The verbs of the command line, as a person calls them."""

import contextlib
import csv
import importlib
import io
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import joblib
import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import Correspondence, Landmarks, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.commands import main
from skfmap.commands.dispatch import _format_warning
from skfmap.commands.transfer import _read_columns
from skfmap.io import read_landmarks, read_mesh, write_landmarks, write_mesh
from skfmap.partial.matcher import PartialMatcher
from skfmap.persistence import load_model

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
_SMALL = ["--functions", "10", "--jobs", "1", "--quiet"]
_QUIET = ["--jobs", "1", "--quiet"]


def run(*arguments):
    return main([str(one) for one in arguments])


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _write(folder, meshes, truths=None):
    folder.mkdir()
    for i, mesh in enumerate(meshes):
        write_mesh(mesh, folder / f"{mesh.name}.off")
        if truths is not None:
            np.savetxt(folder / f"{mesh.name}.txt", truths[i].pairs, fmt="%d")
    return folder


@pytest.fixture(scope="module")
def place(collection, tmp_path_factory):
    """A folder of four bodies, two new ones, and a model that was trained on the folder."""
    place = tmp_path_factory.mktemp("shell")
    training = _write(place / "training", collection.meshes[:4], collection.truths)
    new = _write(place / "new", collection.meshes[4:])
    model = place / "model.skops"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert run("train", training, "-o", model, *_SMALL) == 0
    assert err.getvalue() == ""  # --quiet
    return SimpleNamespace(training=training, new=new, model=model, told=out.getvalue())


@pytest.fixture(scope="module")
def registering(place):
    """A model that registers, of joblib's format."""
    model = place.model.with_name("registering.joblib")
    options = ["--refine", "register", "--no-evaluation", *_SMALL]
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert run("train", place.training, "-o", model, *options) == 0
    assert f"register {model} NEW.ply -o out" in out.getvalue()
    assert "match " not in out.getvalue()
    return model


@pytest.fixture
def broken(place, tmp_path):
    """The new shapes, and one that nothing helps."""
    folder = tmp_path / "with a broken one"
    folder.mkdir()
    for path in place.new.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "broken.off").write_text("OFF\n3 1 0\n0 0 0\n")
    return folder


# train


def test_training_writes_a_model_a_page_and_errors(place):
    rows = rows_of(place.model.with_name("model-errors.csv"))
    assert {row["shape left out"] for row in rows} == {"body1", "body2", "body3"}
    errors = [float(row["error"]) for row in rows]
    assert errors == sorted(errors, reverse=True)
    assert f"All: {np.mean(errors):.3g}." in place.told
    assert "Worst matches" in place.model.with_suffix(".html").read_text(encoding="utf-8")
    assert f"match {place.model} NEW.ply -o out" in place.told
    assert "register " not in place.told
    saved = load_model(place.model)
    assert saved[-1].reference_.name == "body0"
    assert {saved.get_params()[f"{step}__n_jobs"] for step, _ in saved.steps} == {None}


def test_a_model_is_what_python_would_have_fitted(place, collection):
    model = load_model(place.model)
    same = make_pipeline(*(skfmap.SpectralBasis(120),), *(step for _, step in model.steps[1:]))
    same.fit(collection.meshes[:4], collection.truths[:4])
    own, again = (skfmap.match(one, collection.meshes[4:5])[0] for one in (model, same))
    assert (own.p2p == again.p2p).mean() > 0.999  # files of meshes have sixteen digits


def test_training_without_evaluation_writes_the_model_alone(registering):
    assert joblib.load(registering)[-1].refine == "register"
    assert not registering.with_suffix(".html").exists()


def test_progress_is_told_on_standard_error_alone(place, tmp_path, capsys):
    options = ["--functions", "10", "--jobs", "1", "--no-evaluation"]
    assert run("train", place.training, "-o", tmp_path / "m.skops", *options) == 0
    told = capsys.readouterr()
    assert "iteration 10" in told.err
    assert "iteration" not in told.out


def test_training_leaves_out_what_cannot_be_used(collection, tmp_path, capsys):
    meshes = list(collection.meshes[:4])
    tiny = Mesh(1e-180 * meshes[2].vertices, meshes[2].faces, "tiny")
    folder = _write(tmp_path / "f", [*meshes[:2], tiny, meshes[3]], collection.truths)
    with pytest.warns(skfmap.exceptions.SkippedShapeWarning, match="tiny"):
        status = run("train", folder, "-o", tmp_path / "m.skops", "--no-evaluation", *_SMALL)
    assert status == 1
    out = capsys.readouterr().out
    assert "Left out: tiny: " in out
    assert "trained on 3 of 4 shapes" in out


def test_two_shapes_are_too_few_to_leave_one_out(place, tmp_path, capsys):
    options = ["-o", tmp_path / "m.skops", "--pattern", "body[01]", *_SMALL]
    assert run("train", place.training, *options) == 0
    assert "that takes three shapes, and 2 can be used" in capsys.readouterr().out
    assert (tmp_path / "m.skops").is_file()


# match


def test_matches_are_those_of_python(place, tmp_path, capsys):
    assert run("match", place.model, place.new, "-o", tmp_path / "out", *_QUIET) == 0
    files = sorted(place.new.iterdir())
    for path, match in zip(files, skfmap.match(load_model(place.model), files), strict=True):
        rows = rows_of(tmp_path / "out" / f"{path.stem}.csv")
        assert [int(row["vertex"]) for row in rows] == list(range(len(match.p2p)))
        assert [int(row["reference_vertex"]) for row in rows] == match.p2p.tolist()
        expected = np.array([float(row["expected_error"]) for row in rows])
        np.testing.assert_allclose(expected, match.expected_error, rtol=1e-6)
        confidence = np.array([float(row["confidence"]) for row in rows])
        np.testing.assert_allclose(confidence, match.confidence, rtol=1e-6)
    errors = [float(row["expected error"]) for row in rows_of(tmp_path / "out" / "summary.csv")]
    assert errors == sorted(errors, reverse=True)
    assert "body4" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", ["npz", "ply", "vtp"])
def test_matches_are_written_as_python_saves_them(place, tmp_path, suffix):
    new = place.new / "body4.off"
    out = tmp_path / "out"
    assert run("match", place.model, new, "-o", out, "--format", suffix, *_QUIET) == 0
    (match,) = skfmap.match(load_model(place.model), [new])
    (path,) = match.save(tmp_path / f"saved.{suffix}")
    assert (out / f"body4.{suffix}").read_bytes() == path.read_bytes()


def test_a_texture_must_lie_on_the_reference(place, tmp_path, capsys):
    (tmp_path / "uv.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    given = ["-o", tmp_path / "out", "--uv", tmp_path / "uv.obj", *_QUIET]
    assert run("match", place.model, place.new, *given) == 2
    assert "--texture and --uv belong together" in capsys.readouterr().err
    given += ["--texture", tmp_path / "skin.png"]
    assert run("match", place.model, place.new, *given) == 2
    assert "are for --format glb" in capsys.readouterr().err
    assert run("match", place.model, place.new, *given, "--format", "glb") == 2
    assert "has 3 vertices, and the reference" in capsys.readouterr().err


def test_a_shape_that_cannot_be_used_is_told_and_does_not_lose_the_others(
    place, broken, tmp_path, capsys
):
    assert run("match", place.model, broken, "-o", tmp_path / "out", *_QUIET) == 1
    assert "Not used: broken: " in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "body4.csv",
        "body5.csv",
        "summary.csv",
    }
    first = rows_of(tmp_path / "out" / "summary.csv")[0]
    assert first["shape"] == "broken"
    assert "broken.off cannot be read" in first["note"]


def test_unfamiliar_shapes_come_before_the_others(place, tmp_path):
    ball = skfmap.datasets.make_sphere(n_subdivisions=3)
    write_mesh(ball, tmp_path / "ball.off")
    meshes = [*sorted(place.new.iterdir()), tmp_path / "ball.off"]
    assert run("match", place.model, *meshes, "-o", tmp_path / "out", *_QUIET) == 0
    rows = rows_of(tmp_path / "out" / "summary.csv")
    assert [row["familiar"] for row in rows] == ["no", "yes", "yes"]
    assert rows[0]["shape"] == "ball"


def test_vertices_without_a_match_are_blank(place, tmp_path):
    mesh = read_mesh(place.new / "body4.off")
    loose = tmp_path / "loose.off"
    write_mesh(Mesh(np.vstack([[9.0, 9, 9], mesh.vertices]), mesh.faces + 1), loose)
    with pytest.warns(skfmap.exceptions.RepairWarning, match="'loose': removed 1 vertices"):
        assert run("match", place.model, loose, "-o", tmp_path / "out", *_QUIET) == 0
    rows = rows_of(tmp_path / "out" / "loose.csv")
    assert rows[0] == {
        "vertex": "0",
        "reference_vertex": "-1",
        "expected_error": "",
        "confidence": "",
    }
    assert rows_of(tmp_path / "out" / "summary.csv")[0]["unmatched"] == "1"


# landmarks


@pytest.fixture(scope="module")
def marked(collection, tmp_path_factory):
    """A folder of bodies with landmarks, one of them missing once, and a model of it."""
    place = tmp_path_factory.mktemp("landmarks")
    folder, marks = _write(place / "training", collection.meshes[:4]), {}
    for i, (mesh, truth) in enumerate(zip(collection.meshes, collection.truths, strict=True)):
        chosen = truth.pairs[truth.pairs[:, 1] % 12 == 0]
        points = mesh.vertices[chosen[:, 0]]
        points[3] = np.nan if i == 1 else points[3]
        names = [f"point {t}" for t in chosen[:, 1]]
        marks[mesh.name] = Landmarks(points, names, name=mesh.name)
        if i < 4:
            write_landmarks(marks[mesh.name], folder / f"{mesh.name}_Landmarks.csv")
    new = _write(place / "new", collection.meshes[4:])
    return SimpleNamespace(training=folder, new=new, marks=marks, model=place / "model.skops")


@pytest.fixture(scope="module")
def told_of_marked(marked):
    """What training says of the folder of landmarks."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert run("train", marked.training, "-o", marked.model, *_SMALL) == 0
    return out.getvalue()


def test_training_on_landmarks_ends_with_an_error_for_each(marked, told_of_marked):
    model = load_model(marked.model)
    assert model[-1].refine == "register"
    rows = rows_of(marked.model.with_name("model-errors.csv"))
    assert {row["specimen"] for row in rows} == {"body1", "body2", "body3"}
    blank = [(row["specimen"], row["landmark"]) for row in rows if not row["error"]]
    assert blank == [("body1", "point 36")]
    errors = np.array([float(row["error"]) for row in rows if row["error"]])
    assert f"All: {errors.mean():.3g}." in told_of_marked
    # Bodies are some 4 long, and edges 0.2.
    assert errors.mean() < 0.5
    assert re.search(r"^point 36 +2 ", told_of_marked, re.MULTILINE)
    assert f"landmarks {marked.model} NEW.ply -o out" in told_of_marked
    page = marked.model.with_suffix(".html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3


@pytest.mark.usefixtures("told_of_marked")
@pytest.mark.parametrize("suffix", ["fcsv", "mrk.json", "pp", "tps", "pts", "csv"])
def test_landmarks_are_written_as_python_predicts_them(marked, tmp_path, suffix):
    options = ["-o", tmp_path, "--format", suffix, *_QUIET]
    assert run("landmarks", marked.model, marked.new / "body4.off", *options) == 0
    (found,) = skfmap.predict_landmarks(load_model(marked.model), [marked.new / "body4.off"])
    read = read_landmarks(tmp_path / f"body4.{suffix}")
    np.testing.assert_allclose(read.points, found.points, rtol=1e-12)
    if suffix != "tps":  # has no names
        assert read.names == found.names
    off = np.linalg.norm(found.points - marked.marks["body4"].points, axis=1)
    assert off.mean() < 0.5


@pytest.mark.usefixtures("told_of_marked")
def test_landmarks_are_put_onto_the_surface_if_asked(marked, tmp_path):
    mesh = marked.new / "body4.off"
    options = ["--on-surface", "-o", tmp_path, *_QUIET]
    assert run("landmarks", marked.model, mesh, *options) == 0
    (found,) = skfmap.predict_landmarks(load_model(marked.model), [mesh], on_surface=True)
    read = read_landmarks(tmp_path / "body4.fcsv")
    np.testing.assert_allclose(read.points, found.points, rtol=1e-12)
    put = Correspondence.from_points(read, read_mesh(mesh))
    assert put.distance.max() < 1e-12


@pytest.mark.usefixtures("told_of_marked")
def test_a_model_without_landmarks_says_so(place, tmp_path, capsys):
    assert run("landmarks", place.model, place.new, "-o", tmp_path / "out", *_QUIET) == 2
    assert "was trained without landmarks" in capsys.readouterr().err


@pytest.mark.usefixtures("told_of_marked")
def test_landmarks_of_what_is_unlike_are_told_as_doubtful(marked, tmp_path, capsys):
    write_mesh(skfmap.datasets.make_sphere(n_subdivisions=3), tmp_path / "ball.off")
    options = ("-o", tmp_path / "out", *_QUIET)
    assert run("landmarks", marked.model, tmp_path / "ball.off", *options) == 0
    assert "Doubtful: ball: unlike the training specimens" in capsys.readouterr().out
    (row,) = rows_of(tmp_path / "out" / "summary.csv")
    assert row["expected error"] == ""
    assert row["note"].startswith("unlike the training specimens")


@pytest.mark.usefixtures("told_of_marked")
def test_one_table_has_the_landmarks_of_all_specimens(marked, broken, tmp_path):
    assert run("landmarks", marked.model, broken, "-o", tmp_path / "out", *_QUIET) == 1
    table = rows_of(tmp_path / "out" / "landmarks.csv")
    assert {row["specimen"] for row in table} == {"body4", "body5"}
    single = read_landmarks(tmp_path / "out" / "body5.fcsv")
    (row,) = (row for row in table if row["specimen"] == "body5")
    at = [float(row[f"point 24_{axis}"]) for axis in "xyz"]
    np.testing.assert_allclose(at, single.point("point 24"), rtol=1e-12)
    summary = rows_of(tmp_path / "out" / "summary.csv")
    assert summary[0]["shape"] == "broken"
    expected = [float(row["expected error"]) for row in summary[1:]]
    assert expected == sorted(expected, reverse=True)


# numbers


def test_vertices_correspond_by_number_where_that_is_said(collection, tmp_path, capsys):
    """Other faces, and a file beside them that would say something else."""
    body = collection.meshes[0]
    bent = [Mesh(body.vertices * [1, 1, 1 + i / 20], body.faces, f"bent{i}") for i in range(2)]
    other = Mesh(body.vertices, body.faces[:-1], "bent2")
    folder = _write(tmp_path / "bent", [*bent, other])
    (folder / "bent0.txt").write_text("0 0\n")
    assert run("check", folder) == 1
    assert "by number" not in capsys.readouterr().out
    assert run("check", folder, "--by-number") == 0
    assert "vertices correspond by number" in capsys.readouterr().out
    model = tmp_path / "model.skops"
    assert run("train", folder, "-o", model, "--by-number", "--no-evaluation", *_SMALL) == 0
    assert len(load_model(model)[-1].reference_correspondence_.pairs) == body.n_vertices


# convert


def test_meshes_and_landmarks_are_converted(place, tmp_path, capsys):
    mesh = read_mesh(place.new / "body4.off")
    assert run("convert", place.new / "body4.off", tmp_path / "body.vtp") == 0
    assert f"{mesh.n_vertices} vertices" in capsys.readouterr().out
    again = read_mesh(tmp_path / "body.vtp")
    assert again.content_hash == mesh.content_hash
    write_landmarks(Landmarks([[1.0, 2, 3]], ["nose"]), tmp_path / "marks.fcsv")
    to_ras = ["--system", "RAS"]
    assert run("convert", tmp_path / "marks.fcsv", tmp_path / "marks.csv", *to_ras) == 0
    assert read_landmarks(tmp_path / "marks.csv").point("nose").tolist() == [-1, -2, 3]
    assert run("convert", place.new / "body4.off", tmp_path / "body.vtp") == 2
    told = capsys.readouterr().err
    assert "--force to overwrite, or write elsewhere" in told
    assert run("convert", place.new, tmp_path / "body.off") == 2
    assert "is a folder" in capsys.readouterr().err
    assert run("convert", place.new / "body4.off", tmp_path / "body.stl") == 0
    assert "numbered anew" in capsys.readouterr().out
    assert run("convert", place.new / "body4.off", tmp_path / "body.step") == 2
    assert "skfmap writes .off" in capsys.readouterr().err
    assert run("convert", place.new / "body4.off", tmp_path / "body.ply", *to_ras) == 2
    assert "--system is for landmarks" in capsys.readouterr().err


# register


def test_registered_meshes_have_the_faces_of_the_reference(
    place, registering, broken, tmp_path, capsys
):
    assert run("register", registering, broken, "-o", tmp_path / "out", *_QUIET) == 1
    reference = read_mesh(place.training / "body0.off")
    (laid,) = skfmap.register(joblib.load(registering), [place.new / "body4.off"])
    written = read_mesh(tmp_path / "out" / "body4.ply")
    assert (written.faces == reference.faces).all()
    np.testing.assert_allclose(written.vertices, laid.vertices, atol=1e-6)  # PLY: single precision
    row = rows_of(tmp_path / "out" / "summary.csv")[-1]
    assert row["fits"] == "yes"
    assert float(row["off"]) <= 1


def test_registration_asks_for_a_model_that_registers(place, tmp_path, capsys):
    assert run("register", place.model, place.new, "-o", tmp_path / "out", *_QUIET) == 2
    assert "train it again with --refine register" in capsys.readouterr().err


# transfer


@pytest.fixture
def heights(place, tmp_path):
    """The third coordinate of the reference's vertices, and which of them are above."""
    values = read_mesh(place.training / "body0.off").vertices[:, 2]
    path = tmp_path / "values.csv"
    lines = [f"{z!r},{'above' if z > 0 else 'below'}" for z in values.tolist()]
    path.write_text("\n".join(["height,side", *lines]) + "\n", encoding="utf-8")
    return SimpleNamespace(path=path, values=values)


def _read_columns_of(path, n_vertices):
    columns = _read_columns(path, n_vertices)
    return [one.name for one in columns], [one.values for one in columns]


def test_numbers_are_interpolated_and_words_voted_on(place, heights, tmp_path):
    options = ["--values", heights.path, "-o", tmp_path / "out", *_QUIET]
    assert run("transfer", place.model, place.new / "body4.off", *options) == 0
    rows = rows_of(tmp_path / "out" / "body4.csv")
    learner = load_model(place.model)
    (match,) = skfmap.match(learner, [place.new / "body4.off"], interpolate="barycentric")
    carried = [float(row["height"]) for row in rows]
    np.testing.assert_allclose(carried, match.matrix @ heights.values, rtol=1e-6, atol=1e-9)
    words = match.transfer(np.where(heights.values > 0, "above", "below"))
    assert [row["side"] for row in rows] == words.tolist()


@pytest.mark.parametrize("suffix", [".npy", ".txt"])
def test_what_is_not_trusted_is_blank(place, heights, tmp_path, suffix):
    path = tmp_path / f"heights{suffix}"
    np.save(path, heights.values) if suffix == ".npy" else np.savetxt(path, heights.values)
    (match,) = skfmap.match(load_model(place.model), [place.new / "body4.off"])
    limit = float(np.median(match.expected_error))
    options = ["--values", path, "--max-error", limit, "--format", "npy", "-o", tmp_path / "out"]
    assert run("transfer", place.model, place.new / "body4.off", *options, *_QUIET) == 0
    carried = np.load(tmp_path / "out" / "body4.npy")
    assert (np.isnan(carried) == (match.expected_error > limit)).all()
    assert 0.4 < np.isnan(carried).mean() < 0.6


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("between", [";", "\t", None])
def test_values_may_have_decimal_commas(place, heights, tmp_path, encoding, between):
    sides = np.where(heights.values > 0, "höher", "1,5 tiefer").tolist()
    numbers = [repr(z).replace(".", ",") for z in heights.values.tolist()]
    columns = zip(["Höhe", *numbers], ["Seite", *sides], strict=True)
    lines = [one if between is None else f"{one}{between}{side}" for one, side in columns]
    path = tmp_path / "werte.csv"
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode(encoding))
    names, read = _read_columns_of(path, len(numbers))
    assert names == ["Höhe", "Seite"][: 1 if between is None else 2]
    np.testing.assert_array_equal(read[0], heights.values)
    if between is not None:
        assert read[1].tolist() == sides


def test_decimal_commas_without_a_head_are_not_taken_for_columns(place, heights, tmp_path, capsys):
    path = tmp_path / "values.csv"
    numbers = [f"{abs(z):.3f}".replace(".", ",") for z in heights.values.tolist()]
    path.write_text("\n".join(numbers) + "\n")
    options = ["--values", path, "-o", tmp_path / "out", *_QUIET]
    assert run("transfer", place.model, place.new / "body4.off", *options) == 2
    assert "Write decimal points, or semicolons between columns" in capsys.readouterr().err


def test_unknown_values_stay_unknown(place, heights, tmp_path):
    values = heights.values.tolist()
    lines = ["" if z > 0 else repr(z) for z in values]
    path = tmp_path / "half.csv"
    path.write_text("\n".join(["height", *(line or '""' for line in lines)]), encoding="utf-8")
    options = ["--values", path, "-o", tmp_path / "out", *_QUIET]
    assert run("transfer", place.model, place.new / "body4.off", *options) == 0
    carried = [row["height"] for row in rows_of(tmp_path / "out" / "body4.csv")]
    known = [float(value) for value in carried if value]
    assert 0.2 < len(known) / len(carried) < 0.8
    assert max(known) <= 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1\n2\n3\n", "holds values for 3 vertices, but the reference has 500"),
        ("1,2\n3\n", "must have a line for each of the 500 vertices"),
        ("", "values.csv is empty"),
    ],
)
def test_values_must_fit_the_reference(place, tmp_path, capsys, content, message):
    path = tmp_path / "values.csv"
    path.write_text(content)
    options = ["--values", path, "-o", tmp_path / "out", *_QUIET]
    assert run("transfer", place.model, place.new, *options) == 2
    assert message in capsys.readouterr().err


# check and report


def test_check_tells_what_is_wrong_with_each_mesh(place, broken, capsys):
    assert run("check", place.training) == 0
    out = capsys.readouterr().out
    assert out.count("sound\n") == 4
    assert "4 meshes of" in out
    assert run("check", broken / "broken.off", place.new / "body4.off") == 1
    out = capsys.readouterr().out
    assert "broken.off cannot be read" in out
    assert "mesh 'body4': 620 vertices" in out


def test_check_tells_which_meshes_training_would_leave_out(place, tmp_path, collection, capsys):
    folder = _write(tmp_path / "f", collection.meshes[:3], collection.truths)
    (folder / "body2.txt").unlink()
    assert run("check", folder) == 1
    assert "body2 would be left out: " in capsys.readouterr().out
    (folder / "body0.txt").unlink()
    assert run("check", folder) == 1
    assert "cannot be trained on: " in capsys.readouterr().out


def test_report_leaves_shapes_out(place, tmp_path):
    page = tmp_path / "page.html"
    options = ["-o", page, "--folds", "3", "--quiet"]
    assert run("report", place.model, place.training, *options) == 0
    text = page.read_text(encoding="utf-8")
    assert "Errors on shapes left out" in text
    assert "body3" in text


# What all verbs share


def test_nothing_is_written_over_without_force(place, tmp_path, capsys):
    taken = tmp_path / "out" / "body5.csv"
    taken.parent.mkdir()
    taken.write_text("mine")
    arguments = ["match", place.model, place.new, "-o", taken.parent, *_QUIET]
    assert run(*arguments) == 2
    told = capsys.readouterr().err
    assert "body5.csv is there already" in told
    assert "--force" in told
    assert [path.name for path in taken.parent.iterdir()] == ["body5.csv"]
    assert taken.read_text() == "mine"
    assert run(*arguments, "--force") == 0
    assert taken.read_text().startswith("vertex,")


def test_the_summary_of_an_earlier_run_is_replaced(place, tmp_path, capsys):
    out, new = tmp_path / "out", [place.new / "body4.off", place.new / "body5.off"]
    assert run("match", place.model, new[0], "-o", out, *_QUIET) == 0
    assert run("match", place.model, new[1], "-o", out, "--format", "ply", *_QUIET) == 0
    assert [row["shape"] for row in rows_of(out / "summary.csv")] == ["body5"]
    assert {path.name for path in out.iterdir()} == {"body4.csv", "body5.ply", "summary.csv"}
    mine = "shape,length\nbody4,12\n"
    (out / "summary.csv").write_text(mine)
    assert run("match", place.model, new[0], "-o", out, "--format", "npz", *_QUIET) == 2
    assert "summary.csv is there already; give --force" in capsys.readouterr().err
    assert (out / "summary.csv").read_text() == mine


def test_names_that_are_too_long_are_told_before_any_work(place, tmp_path, capsys):
    mesh = tmp_path / f"{'x' * 250}.off"
    mesh.write_bytes((place.new / "body4.off").read_bytes())
    out = tmp_path / "out"
    assert run("landmarks", place.model, mesh, "-o", out, "--format", "mrk.json", *_QUIET) == 2
    assert "A name of 259 letters" in capsys.readouterr().err
    assert not out.exists()


def test_force_does_not_write_over_the_mesh_itself(place, registering, tmp_path, capsys):
    mesh = tmp_path / "body4.ply"
    write_mesh(read_mesh(place.new / "body4.off"), mesh)
    before = mesh.read_bytes()
    assert run("register", registering, mesh, "-o", tmp_path, "--force", *_QUIET) == 2
    assert "body4.ply would be overwritten by its result" in capsys.readouterr().err
    assert mesh.read_bytes() == before


def test_a_shape_that_the_model_refuses_does_not_lose_the_others(
    place, tmp_path, capsys, monkeypatch
):
    match = WeightedFunctionalMapLearner.match

    def refuse(self, shapes, **how):
        if any(shape.name == "body5" for shape in shapes):
            raise ValueError("'body5' cannot be matched.")
        return match(self, shapes, **how)

    monkeypatch.setattr(WeightedFunctionalMapLearner, "match", refuse)
    options = ["-o", tmp_path / "out", "--jobs", "2", "--quiet"]
    assert run("match", place.model, place.new, *options) == 1
    assert "Not used: body5: 'body5' cannot be matched." in capsys.readouterr().out
    assert (tmp_path / "out" / "body4.csv").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["match", "nowhere.skops", "{new}", "-o", "{out}"], "no model file nowhere.skops"),
        (["match", "{model}", "nowhere.off", "-o", "{out}"], "no mesh nowhere.off"),
        (["match", "{model}", "{out}.txt", "-o", "{out}"], "not a mesh that can be read"),
        (["match", "{model}", "{empty}", "-o", "{out}"], "holds no mesh with suffix"),
        (["match", "{new}/body4.off", "{new}", "-o", "{out}"], "is a mesh, and the model comes"),
        (["match", "{new}/body4.off", "{model}", "-o", "{out}"], "model.skops is a model, not a"),
        (["check", "{model}"], "is a model, not a mesh. Use it as match"),
        (["check", "{learner}"], "is a model, not a mesh. Use it as match"),
        (["match", "{out}.txt", "{new}", "-o", "{out}"], "not a valid file of save_model"),
        (["match", "{model}", "{new}", "-o", "{out}.txt"], "out.txt cannot hold the results"),
        (["match", "{model}", "{new}", "{new}/body4.off", "-o", "{out}"], "would both be written"),
        (["match", "{model}", "{new}", "-o", "{out}", "--jobs", "0"], "n_jobs"),
        (["match", "{learner}", "{new}", "-o", "{out}"], "without the steps that read meshes"),
        (["match", "{parts}", "{new}", "-o", "{out}"], "holds a PartialMatcher, which"),
        (["match", "{array}", "{new}", "-o", "{out}"], "holds no model of skfmap, but a ndarray"),
        (["match", "{cut}", "{new}", "-o", "{out}"], "cut.joblib cannot be read as a model"),
        (["transfer", "{model}", "{new}", "--values", "no.csv", "-o", "{out}"], "values no.csv"),
        (["landmarks", "{model}", "{new}", "-o", "{out}", "--coverage", "1"], "--coverage must be"),
        (["train", "nowhere", "-o", "{out}.skops"], "no folder nowhere"),
        (["train", "{training}", "-o", "{out}.skops", "--functions", "900"], "--functions"),
        (["train", "{training}", "-o", "{out}.skops", "--folds", "1"], "--folds"),
        (["train", "{training}", "-o", "{training}"], "is a folder"),
        (["train", "{training}", "-o", "{out}.html"], "Two results would be written to"),
        (
            ["report", "{model}", "{training}", "--pattern", "body[123]", "-o", "{out}.html"],
            "does not contain the model's reference",
        ),
    ],
)
def test_what_is_wrong_is_told_in_one_line(place, tmp_path, capsys, arguments, message):
    (tmp_path / "out.txt").write_text("no mesh")
    (tmp_path / "empty").mkdir()
    joblib.dump(load_model(place.model)[-1], tmp_path / "learner.joblib")
    joblib.dump(PartialMatcher(load_model(place.model)), tmp_path / "parts.joblib")
    joblib.dump(np.ones(3), tmp_path / "array.joblib")
    (tmp_path / "cut.joblib").write_bytes((tmp_path / "array.joblib").read_bytes()[:20])
    names = {
        **vars(place),
        "out": tmp_path / "out",
        "empty": tmp_path / "empty",
        **{name: tmp_path / f"{name}.joblib" for name in ("learner", "parts", "array", "cut")},
    }
    assert run(*(one.format(**names) for one in arguments), "--quiet") == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize(
    ("verb", "nearest"), [("matches", "match"), ("Landmark", "landmarks"), ("checks", "check")]
)
def test_a_verb_that_is_none_names_the_nearest_and_all(capsys, verb, nearest):
    assert run(verb, "model.skops", "scan.ply") == 2
    told = capsys.readouterr().err
    assert f"no verb of that name. Did you mean {nearest}? Verbs: train, match, " in told
    assert told.count("\n") == 1


@pytest.mark.filterwarnings("default::skfmap.exceptions.SkippedShapeWarning")
@pytest.mark.parametrize("verb", ["train", "check"])
def test_bare_meshes_are_nothing_to_learn_from_and_that_is_said_once(
    collection, tmp_path, capsys, verb
):
    folder = _write(tmp_path / "bare", collection.meshes[:3])
    output = ["-o", tmp_path / "m.skops"] if verb == "train" else []
    assert run(verb, folder, *output, "-q") == (2 if verb == "train" else 1)
    captured = capsys.readouterr()
    told = captured.err if verb == "train" else captured.out
    assert (captured.err + captured.out).count("\n") == 1
    assert "cannot be trained on: only the reference, body0, can be used." in told
    assert "Add a file for each mesh" in told
    assert "New meshes, to which a trained model is applied, need no such files." in told


def test_quiet_verbs_tell_what_is_wrong_alone(place, broken, tmp_path, capsys):
    assert run("convert", place.new / "body4.off", tmp_path / "body4.ply", "-q") == 0
    assert run("check", place.training, "-q") == 0
    assert capsys.readouterr().out == ""
    assert run("check", broken / "broken.off", broken / "body4.off", "-q") == 1
    out = capsys.readouterr().out
    assert "broken.off" in out
    assert "body4" not in out


def test_a_model_of_skops_asks_for_skops(place, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "skops.io", None)
    assert run("train", place.training, "-o", tmp_path / "m.skops", *_SMALL) == 2
    told = capsys.readouterr().err
    assert "pip install 'skfmap[skops]', or write" in told
    assert "m.joblib" in told


def test_wrong_options_and_help_return_their_status(capsys):
    assert run("match", "--nonsense") == 2
    assert run("--nonsense") == 2
    assert "usage: " in capsys.readouterr().err
    for verb in ("train", "match", "landmarks", "register", "transfer", "check", "report", "demo"):
        assert run(verb, "--help") == 0
    assert run("--help") == 0
    assert "predict landmarks on new specimens" in capsys.readouterr().out
    assert run("--version") == 0
    assert capsys.readouterr().out == f"skfmap {skfmap.__version__}\n"


def test_the_demonstration_has_a_name_too(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    told = []
    for arguments in (["demo"], []):
        assert run(*arguments, "--output", tmp_path / "file") == 2
        told.append(capsys.readouterr().err)
    assert told[0] == told[1]
    assert "--output" in told[0]


@pytest.mark.parametrize("name", ["мышь", "骨", "Zoë's 1"])
def test_what_a_terminal_lacks_is_escaped(place, tmp_path, name):
    mesh = tmp_path / f"{name}.off"
    mesh.write_bytes((place.new / "body4.off").read_bytes())
    (tmp_path / f"{name} 2.off").write_text("OFF\n3 1 0\n0 0 0\n", encoding="utf-8")
    command = [sys.executable, "-m", "skfmap", "match", place.model, tmp_path, "-o", tmp_path / "o"]
    done = subprocess.run(
        [*map(str, command), "--jobs", "1"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0"},
        check=False,
    )
    assert done.returncode == 1
    assert b"Traceback" not in done.stderr
    escaped = name.encode("cp1252", "backslashreplace")
    assert escaped in done.stdout
    assert b"[1 of 2] " + escaped in done.stderr
    assert (tmp_path / "o" / f"{name}.csv").is_file()
    shapes = [row["shape"] for row in rows_of(tmp_path / "o" / "summary.csv")]
    assert shapes == [f"{name} 2", name]


def test_streams_are_as_before_when_a_verb_has_ended(capfd):
    before = sys.stdout.errors
    assert run("--version") == 0
    assert sys.stdout.errors == before


def test_warnings_call_shapes_by_name_alone():
    told = _format_warning("X[0] ('left') fits as a mirror image", UserWarning, "file.py", 1)
    assert told == "UserWarning: 'left' fits as a mirror image\n"


def test_interruption_has_a_status_of_its_own(place, tmp_path, capsys, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(SpectralBasis, "transform", interrupt)
    assert run("match", place.model, place.new, "-o", tmp_path / "out", *_QUIET) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.skipif(not PROJECT.is_file(), reason="not in a checkout")
def test_the_installed_script_is_the_same():
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["skfmap"].partition(":")
    assert getattr(importlib.import_module(module), name) is main
