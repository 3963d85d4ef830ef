"""Pictures and pages: what they show, not how they look; looking was done by people."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_hex
from matplotlib.image import imread

import skfmap
from skfmap import Mesh
from skfmap.datasets import make_sphere
from skfmap.functional import basis_error
from skfmap.geometry.position_colours import colours_of_position
from skfmap.metrics import error_curve
from skfmap.plotting import (
    BasisErrorDisplay,
    Camera,
    ErrorCurveDisplay,
    ReliabilityDisplay,
    SingularValuesDisplay,
    WeightsDisplay,
    plot_function,
    plot_functions,
    plot_matches,
    write_functions_page,
    write_matches_page,
)
from skfmap.plotting._colours import UNKNOWN, scale_of
from skfmap.plotting._scene import scene_of_matches
from skfmap.plotting._surface import lit


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    plt.close("all")


@pytest.fixture
def matched(fitted, probed, collection):
    """Return the match of the last body, its mesh and the reference."""
    (match,) = fitted.match(probed[5:])
    return [match], collection.meshes[5:], collection.meshes[0]


# Camera and colours


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_camera_keeps_distances_and_handedness(up):
    points = np.random.default_rng(0).normal(size=(4, 3))
    seen = Camera(up, azimuth=33, elevation=-12).project(points)
    edges, seen_edges = np.diff(points, axis=0), np.diff(seen, axis=0)
    np.testing.assert_allclose(np.linalg.norm(seen_edges, axis=1), np.linalg.norm(edges, axis=1))
    assert np.linalg.det(edges) == pytest.approx(np.linalg.det(seen_edges))


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_up_axis_is_up(up):
    axis = np.eye(3)["xyz".index(up)]
    right, height, towards = Camera(up, azimuth=70, elevation=20).project(axis[None])[0]
    assert right == pytest.approx(0)
    assert (height, towards) == (
        pytest.approx(np.cos(np.radians(20))),
        pytest.approx(np.sin(np.radians(20))),
    )


@pytest.mark.parametrize(
    ("wrong", "message"), [({"up": "w"}, "up must be one of"), ({"elevation": 91}, "elevation")]
)
def test_a_camera_says_what_it_cannot_do(wrong, message):
    with pytest.raises(ValueError, match=message):
        Camera(**wrong)


def test_functions_of_both_signs_have_zero_in_the_middle():
    scale = scale_of([np.array([-1.0, 0.0, 3.0])])
    assert (scale.low, scale.high) == (-3, 3)
    assert scale_of([np.array([1.0, 3.0])]).cmap != scale.cmap


def test_values_that_are_not_known_are_grey():
    values = np.ma.array([0.0, 1.0, 0.5, np.nan], mask=[0, 0, 1, 0])
    colours = scale_of([values]).colours(values)
    np.testing.assert_array_equal(colours[2:], [UNKNOWN, UNKNOWN])
    assert not np.allclose(colours[0], UNKNOWN)


def test_colours_of_position_can_be_told_apart_by_the_colour_blind():
    """Without the red-green axis, the ends of all three axes of a body still differ."""
    box = make_sphere(n_subdivisions=4)
    mesh = Mesh(box.vertices * [1.0, 2.0, 3.0], box.faces)
    linear = colours_of_position(mesh.vertices) ** 2.2
    seen = linear @ np.array(
        [[0.152, 0.115, -0.004], [1.053, 0.786, -0.048], [-0.205, 0.099, 1.052]]
    )  # protanopia
    for axis in range(3):
        ends = mesh.vertices[:, axis].argsort()[[0, -1]]
        first, last = np.clip(seen[ends], 0, 1) ** (1 / 2.2)
        assert np.linalg.norm(first - last) > 0.12


def test_light_does_not_change_with_the_side_that_is_seen():
    normals = np.array([[0.0, 0.6, 0.8], [0.0, -0.6, -0.8]])
    colours = lit(np.full((2, 3), 0.5), normals)
    np.testing.assert_allclose(colours[0], colours[1])


def test_no_error_is_beyond_its_scale(fitted, probed, collection, matched):
    matches, meshes, reference = matched
    (errors,) = fitted.pair_errors(probed[5:], collection.truths[5:])
    far = replace(errors, direct=errors.direct + np.where(np.arange(len(errors.direct)) == 7, 1, 0))
    scene = scene_of_matches(
        matches,
        meshes,
        reference,
        show=("expected error",),
        errors=[far],
        captions=None,
        camera=None,
        align=True,
    )
    (_, panel), (expected, true) = scene.panels, scene.scales
    assert expected.high == true.high == np.nanmax(panel.values[1])
    assert true.high > matches[0].expected_error.max()
    alone = scene_of_matches(
        matches,
        meshes,
        reference,
        show=("expected error",),
        errors=None,
        captions=None,
        camera=None,
        align=True,
    )
    assert alone.scales[0].high == pytest.approx(max(0.02, matches[0].expected_error.max()))


# Pictures


def test_a_function_is_drawn_in_its_colours(tmp_path):
    sphere = make_sphere(n_subdivisions=4)
    axes = plot_function(sphere, sphere.vertices[:, 2])
    (drawn,) = axes.collections
    assert len(drawn.get_facecolor()) == sphere.n_vertices
    axes.figure.savefig(tmp_path / "function.png")
    picture = imread(tmp_path / "function.png")[..., :3]
    seen = picture[picture.min(axis=2) < 0.9]
    top, bottom = seen[: len(seen) // 4].mean(axis=0), seen[-len(seen) // 4 :].mean(axis=0)
    assert top[0] > top[2] + 0.2  # red above,
    assert bottom[2] > bottom[0] + 0.1  # blue below


def test_what_is_in_front_hides_what_is_behind(tmp_path):
    """Two walls, the red one nearer to the camera in front of -y."""
    wall = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    vertices = np.concatenate([np.add(wall, [0, -1, 0]), np.add(wall, [0, 1, 0])])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(vertices, np.concatenate([faces, faces + 4]))
    colours = np.repeat([[1.0, 0, 0], [0, 0, 1.0]], 4, axis=0)
    axes = plot_function(mesh, colours, camera=Camera(azimuth=0, elevation=0))
    axes.figure.savefig(tmp_path / "walls.png")
    red, _, blue = imread(tmp_path / "walls.png")[200, 200, :3]
    assert red > blue + 0.3


def test_panels_have_one_scale_of_size_and_of_colour(collection):
    meshes = collection.meshes[:2]
    functions = [
        np.column_stack([mesh.vertices[:, 0], factor * mesh.vertices[:, 1]])
        for mesh, factor in zip(meshes, (1, 5), strict=True)
    ]
    figure = plot_functions(
        meshes, functions, labels=["first", "second"], captions=["left", "right"]
    )
    panels, bars = figure.axes[:4], figure.axes[4:]
    assert [bar.get_ylabel() for bar in bars] == ["first", "second"]
    assert [panel.get_title() for panel in panels] == ["left", "right", "", ""]
    widths = [np.ptp(panel.get_xlim()) for panel in panels]
    np.testing.assert_allclose(widths, widths[0])
    largest = max(np.abs(function[:, 1]).max() for function in functions)
    assert bars[1].get_ylim() == (pytest.approx(-largest), pytest.approx(largest))


def test_colours_of_a_match_are_those_of_the_matched_vertices(matched, tmp_path):
    matches, meshes, reference = matched
    figure = plot_matches(
        matches,
        meshes,
        reference,
        captions=["caption"],
        show=["match", "confidence"],
        path=tmp_path / "m.png",
    )
    assert "body5\ncaption" in [axes.get_title() for axes in figure.axes]
    assert imread(tmp_path / "m.png")[..., :3].std() > 0.05


def test_true_errors_are_shown_where_they_are_known(matched, fitted, probed, collection):
    truth = collection.truths[5].restrict(np.arange(40))
    errors = fitted.pair_errors(probed[5:], [truth])
    options = {"captions": None, "camera": None, "align": True}
    scene = scene_of_matches(*matched, show=["match"], errors=errors, **options)
    assert scene.labels == ("match", "true error")
    shown = scene.panels[1].values[1]
    known = np.unique(errors[0].vertices)
    np.testing.assert_array_equal(np.flatnonzero(~np.isnan(shown)), known)
    assert shown[known[0]] == pytest.approx(errors[0].direct[errors[0].vertices == known[0]].mean())


def test_shapes_need_no_names_and_functions_no_variation(matched):
    matches, (mesh,), reference = matched
    nameless = [Mesh(one.vertices, one.faces) for one in (mesh, reference)]
    figure = plot_matches([replace(matches[0], name=None)], nameless[:1], nameless[1])
    assert [axes.get_title() for axes in figure.axes[:2]] == ["reference", ""]
    figure = plot_functions(nameless[:1], [np.full((mesh.n_vertices, 2), [0.0, np.nan])])
    figure.canvas.draw()


def test_matched_shapes_are_turned_to_face_as_the_reference_does(matched):
    matches, (mesh,), reference = matched
    options = {"show": ["match"], "errors": None, "captions": None, "camera": None}
    facing = scene_of_matches(matches, [mesh], reference, **options, align=True).panels[1].points
    angle = np.radians(130)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    turned = Mesh(mesh.vertices @ turn.T, mesh.faces, name=mesh.name)
    again = scene_of_matches(matches, [turned], reference, **options, align=True).panels[1].points
    np.testing.assert_allclose(again, facing, atol=1e-9)
    as_it_is = (
        scene_of_matches(matches, [turned], reference, **options, align=False).panels[1].points
    )
    assert np.abs(as_it_is - facing).max() > 0.1


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (
            lambda m, s, r: plot_function(s[0], np.ones(3)),
            "for each of the 380 vertices of mesh 'body5'",
        ),
        (lambda m, s, r: plot_function(s[0], ["a"] * 380), "must hold one number"),
        (lambda m, s, r: plot_functions(s, []), "1 meshes and functions for 0"),
        (
            lambda m, s, r: plot_functions(s, [np.ones(380)], captions="body"),
            "captions must be a list of",
        ),
        (
            lambda m, s, r: plot_functions([s[0], s[0]], [np.ones(380), np.ones((380, 2))]),
            "the same number of functions",
        ),
        (
            lambda m, s, r: plot_functions(s, [np.ones((380, 0))]),
            "no function to draw on mesh 'body5'",
        ),
        (lambda m, s, r: plot_functions(s, [1.0]), "for each of the 380 vertices"),
        (lambda m, s, r: plot_matches(m, [], r), "one mesh per match"),
        (lambda m, s, r: plot_matches(m, [r], r), "in the order of the matches"),
        (lambda m, s, r: plot_matches(m, s, r, show=["error"]), "show must be one of"),
        (
            lambda m, s, r: plot_matches(m, s, r, show=["true error"]),
            "To show true errors, give errors",
        ),
        (lambda m, s, r: plot_matches(m, s, r, errors=[]), "errors of 0 and 1 matches"),
    ],
)
def test_pictures_say_what_does_not_fit(matched, draw, message):
    with pytest.raises(ValueError, match=re.escape(message) if "." not in message else message):
        draw(*matched)


# Displays


@pytest.fixture
def unseen(probed, collection):
    return probed[4:], collection.truths[4:]


def test_weights_are_drawn_by_category(fitted, model):
    display = WeightsDisplay.from_estimator(fitted)
    np.testing.assert_array_equal(display.line_.get_ydata(), fitted.weights_)
    assert [label.get_text() for label in display.ax_.get_xticklabels()] == list(
        dict.fromkeys(fitted.probe_categories_)
    )
    again = WeightsDisplay.from_estimator(model, ax=display.ax_, name="pipeline")
    assert again.figure_ is display.figure_
    assert [text.get_text() for text in again.ax_.get_legend().get_texts()] == [
        "function",
        "pipeline",
    ]
    with pytest.raises(ValueError, match="each of the 3 probe functions"):
        WeightsDisplay([1.0], ["a"] * 3).plot()


def test_singular_values_are_those_of_the_difference(fitted, unseen):
    display = SingularValuesDisplay.from_estimator(fitted, *unseen, name="learned")
    difference = fitted.functional_maps(unseen[0]) - fitted.ground_truth_maps(*unseen)
    np.testing.assert_allclose((display.singular_values**2).sum(), (difference**2).sum())
    share = display.line_.get_ydata()
    assert (np.diff(share) >= 0).all()
    np.testing.assert_allclose(
        share, 100 * error_curve(display.singular_values.ravel(), display.line_.get_xdata())
    )


def test_basis_errors_are_those_of_equation_5(fitted, unseen):
    display = BasisErrorDisplay.from_estimator(fitted, *unseen)
    maps, known = fitted.functional_maps(unseen[0]), fitted.ground_truth_maps(*unseen)
    expected = [basis_error(X, C, fitted.stable_basis_) for X, C in zip(maps, known, strict=True)]
    np.testing.assert_allclose(display.errors, expected)
    np.testing.assert_allclose(display.line_.get_ydata(), np.mean(expected, axis=0))


def test_error_curves_are_of_the_matches_asked_for(fitted, unseen):
    full = ErrorCurveDisplay.from_estimator(
        fitted, *unseen, matching="cut", n_stable=1.0, name="full"
    )
    errors = fitted.pair_errors(*unseen, matching="cut", n_stable=1.0)
    np.testing.assert_allclose(full.errors, np.concatenate([one.direct for one in errors]))
    both = ErrorCurveDisplay.from_predictions(errors[0], ax=full.ax_, largest=0.1)
    assert len(both.ax_.lines) == 2
    np.testing.assert_allclose(
        both.line_.get_ydata(), 100 * error_curve(errors[0].direct, both.line_.get_xdata())
    )


def test_error_curves_that_forgive_symmetry_say_so(
    make_learner, symmetric_probed, symmetric_collection
):
    learner = make_learner().fit(symmetric_probed[:3], symmetric_collection.truths[:3])
    display = ErrorCurveDisplay.from_estimator(
        learner, symmetric_probed[3:], symmetric_collection.truths[3:], kind="per_vertex"
    )
    assert "symmetric answers correct" in display.ax_.get_xlabel()
    with pytest.raises(ValueError, match="kind must be one of"):
        ErrorCurveDisplay.from_predictions(np.ones(3), kind="best")


def test_reliability_is_the_mean_error_of_equal_bins():
    expected = np.linspace(0, 1, 100)
    display = ReliabilityDisplay.from_predictions(expected[::-1], 2 * expected[::-1], n_bins=4)
    x, y = display.line_.get_data()
    np.testing.assert_allclose(x, expected.reshape(4, 25).mean(axis=1))
    np.testing.assert_allclose(y, 2 * x)
    with pytest.raises(ValueError, match="of the same length"):
        ReliabilityDisplay.from_predictions(expected, expected[:5])


def test_reliability_of_a_model_compares_its_own_matches(fitted, unseen):
    display = ReliabilityDisplay.from_estimator(fitted, *unseen, n_bins=5)
    matches, errors = fitted.match(unseen[0]), fitted.pair_errors(*unseen)
    np.testing.assert_allclose(display.errors, np.concatenate([one.direct for one in errors]))
    first = matches[0].expected_error[errors[0].vertices]
    np.testing.assert_allclose(display.expected[: len(first)], first)


@pytest.mark.parametrize(
    "display", [SingularValuesDisplay, BasisErrorDisplay, ErrorCurveDisplay, ReliabilityDisplay]
)
def test_displays_take_pipelines_and_refuse_the_rest(model, collection, display):
    X, y = collection.meshes[5:], collection.truths[5:]
    assert display.from_estimator(model, X, y).ax_.lines
    with pytest.raises(TypeError, match="Expected a WeightedFunctionalMapLearner"):
        display.from_estimator(skfmap.SpectralBasis(), X, y)


def test_known_maps_of_training_shapes_are_those_that_were_learned_from(fitted, probed, collection):
    """The loss at the learned weights is that of the learner's own maps against the known ones."""
    maps = fitted.functional_maps(probed[1:5]) - fitted.ground_truth_maps(
        probed[1:5], collection.truths[1:5]
    )
    squared = np.linalg.svd(maps, compute_uv=False) ** 2
    assert (squared / (squared + fitted.epsilon_)).sum() == pytest.approx(fitted.loss_, rel=1e-6)


# Pages

_FLAGS = [
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *(
        "--disable-background-networking",
        "--disable-component-update",
        "--host-resolver-rules=MAP * ~NOTFOUND",
    ),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1200,520"),
    "--virtual-time-budget=20000",
]


@pytest.fixture
def browse(tmp_path):
    """Return a function that opens a page in a browser and returns a screenshot or the title."""
    browser = (
        os.environ.get("SKFMAP_BROWSER")
        or shutil.which("chromium")
        or shutil.which("google-chrome")
    )
    if not browser:
        pytest.skip("no browser found: install chromium, or name one in SKFMAP_BROWSER")

    def open_page(page, script=None):
        if script is not None:
            page.write_text(
                page.read_text(encoding="utf-8").replace(
                    "</body>", f"<script>{script}</script></body>"
                )
            )
        picture = tmp_path / "screenshot.png"
        what = ["--dump-dom"] if script is not None else [f"--screenshot={picture}"]
        command = [
            browser,
            *_FLAGS,
            f"--user-data-dir={tmp_path / 'profile'}",
            *what,
            page.as_uri(),
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
        return (
            re.search("<title>(.*?)</title>", done.stdout)[1]
            if script is not None
            else imread(picture)[..., :3]
        )

    return open_page


def _is_coloured(picture):
    return (np.ptp(picture, axis=2) > 0.15).mean(axis=0)


@pytest.mark.browser
def test_a_page_of_matches_shows_shapes_without_a_network(matched, tmp_path, browse):
    page = write_matches_page(tmp_path / "matches.html", *matched)
    share = _is_coloured(browse(page))
    assert share[40:320].max() > 0.05  # the reference
    assert share[360:640].max() > 0.05  # the shape


@pytest.mark.browser
def test_buttons_change_the_colours_and_one_camera_turns_all(matched, tmp_path, browse):
    script = """
setTimeout(() => {
  const page = document.querySelector('.plotly-graph-div');
  const first = page.data[1].vertexcolor[0];
  const button = document.querySelectorAll('.updatemenu-button')[1];
  button.dispatchEvent(new MouseEvent('click', {bubbles: true}));
  const camera = {eye: {x: -1.5, y: 1, z: 1}, up: {x: 0, y: 0, z: 1}};
  Plotly.relayout(page, {'scene2.camera': camera}).then(() => setTimeout(() => {
    document.title = JSON.stringify({
      eyes: ['scene', 'scene2'].map(name => page.layout[name].camera.eye.x),
      first: first, then: page.data[1].vertexcolor[0], shown: page.data.map(one => one.visible),
    });
  }, 500));
}, 1500);"""
    matches, meshes, reference = matched
    page = write_matches_page(tmp_path / "matches.html", matches, meshes, reference)
    seen = json.loads(browse(page, script).replace("&quot;", '"'))
    assert seen["eyes"] == [-1.5, -1.5]
    assert seen["first"] == to_hex(colours_of_position(reference.vertices)[matches[0].p2p[0]])
    assert seen["then"] != seen["first"]
    assert seen["shown"] == [
        True,
        True,
        False,
        True,
        False,
    ]  # two shapes, then the scales of three rows


def test_pages_need_no_other_file_and_no_host(matched, tmp_path):
    page = write_matches_page(str(tmp_path / "matches.html"), *matched).read_text(encoding="utf-8")
    tags = re.findall(r"<(?:script|link|img)[^>]*>", page)
    assert not any(re.search(r"(src|href)\s*=", tag) for tag in tags)


def test_pages_escape_names(tmp_path):
    sphere = make_sphere(n_subdivisions=2)
    mesh = Mesh(sphere.vertices, sphere.faces, name="<script>alert(1)</script>")
    path = write_functions_page(tmp_path / "f.html", [mesh], [mesh.vertices[:, 0]], labels=["<b>"])
    page = path.read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "alert(1)" in page


@pytest.mark.parametrize(
    ("path", "n_shapes", "message"),
    [("page.png", 1, "must end in .html"), ("page.html", 13, "at most 12 shapes")],
)
def test_pages_say_what_they_cannot_do(tmp_path, path, n_shapes, message):
    sphere = make_sphere(n_subdivisions=1)
    with pytest.raises(ValueError, match=message):
        write_functions_page(
            tmp_path / path, [sphere] * n_shapes, [sphere.vertices[:, 0]] * n_shapes
        )


def test_without_plotly_the_remedy_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    sphere = make_sphere(n_subdivisions=1)
    with pytest.raises(ImportError, match=r"pip install 'skfmap\[pages\]'"):
        write_functions_page(tmp_path / "page.html", [sphere], [sphere.vertices[:, 0]])


def test_matches_without_expected_errors_are_drawn_as_far_as_they_go(matched):
    matches, meshes, reference = matched
    bare = [replace(match, expected_error=None, confidence=None) for match in matches]
    assert plot_matches(bare, meshes, reference) is not None
    with pytest.raises(ValueError, match="has no expected error: the learner was fitted with"):
        plot_matches(bare, meshes, reference, show=["expected error"])
    plt.close("all")
