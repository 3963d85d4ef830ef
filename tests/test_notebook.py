"""What a notebook shows."""

import base64
import builtins
import copy
import io
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.image import imread

from skfmap import Landmarks, Mesh, Registered
from skfmap.datasets import Collection, make_creatures
from skfmap.plotting import Page, functions_page, matches_page
from skfmap.shapes import SkippedShape


@pytest.fixture
def match(fitted, probed):
    (found,) = fitted.match(probed[5:])
    return found


def _picture(text):
    """Return the pixels of the picture in a piece of HTML."""
    (content,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    return imread(io.BytesIO(base64.b64decode(content)))


def _laid(mesh):
    shares = dict.fromkeys(("uncovered", "stretched", "energy"), 0.0)
    named = {"name": "<a>", "reference_name": "b"}
    distance = np.zeros(mesh.n_vertices)
    return Registered(
        mesh.vertices, mesh.faces, distance, 0, off=0.25, **shares, fits=True, **named
    )


def test_a_match_shows_both_shapes_and_its_numbers(match):
    before = plt.get_fignums()
    shown = match._repr_html_()
    assert _picture(shown).shape[1] > 1.5 * _picture(match.mesh._repr_html_()).shape[1]
    assert "body5 → body0" in shown
    assert f"mean {match.expected_error.mean():.3f}, 90th percentile" in shown
    assert plt.get_fignums() == before  # a notebook would show pyplot's a second time


def test_shapes_show_their_numbers(collection):
    mesh = collection.meshes[1]
    assert f'<td style="text-align:left">{mesh.n_vertices}</td>' in mesh._repr_html_()
    laid = _laid(mesh)._repr_html_()
    assert "25.0%" in laid
    assert "&lt;a&gt;" in laid  # names are no HTML
    assert _picture(laid).std() > 0
    marks = Landmarks(np.arange(24.0).reshape(8, 3), name="skull", expected_error=np.full(8, 0.5))
    shown = marks._repr_html_()
    assert "8, of which 8 are placed" in shown
    assert "and 2 more" in shown


def test_a_collection_shows_its_shapes():
    creatures = make_creatures(2, 500, n_points=100)
    shown = creatures._repr_html_()
    assert _picture(shown).std() > 0
    assert "cat0, cat1" in shown
    left_out = Collection(
        meshes=[creatures.meshes[0], SkippedShape("gone", "it is broken.")],
        correspondences=creatures.correspondences,
        names=["cat0", "gone"],
    )
    assert "skipped" in left_out._repr_html_()


def test_where_there_is_no_picture_the_numbers_are_shown(match, collection, monkeypatch):
    unknown = replace(match, given=None)._repr_html_()
    assert "does not know the mesh" in unknown
    assert "expected error" in unknown
    flat = Mesh(np.zeros((3, 3)), [[0, 1, 2]])._repr_html_()
    assert "no area" in flat
    lost = replace(_laid(collection.meshes[0]), vertices=np.full((500, 3), np.nan))
    assert "was skipped" in lost._repr_html_()
    usual = builtins.__import__

    def without(name, *rest):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return usual(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    shown = collection.meshes[0]._repr_html_()
    assert "needs matplotlib" in shown
    assert "img" not in shown


def test_a_match_draws_itself(match, tmp_path):
    figure = match.plot(show=["match"], path=tmp_path / "match.png")
    assert len(figure.axes) == 2
    assert imread(tmp_path / "match.png").std() > 0
    plt.close("all")


def test_pages_are_shown_in_a_frame_and_saved(match, tmp_path):
    pytest.importorskip("plotly")
    page = match.plot(interactive=True)
    assert isinstance(page, Page)
    shown = page._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    assert shown.count('"') == 8  # four attributes: the page within is escaped
    assert f'width="{page.width}"' in shown
    assert page.save(tmp_path / "match.html").read_text(encoding="utf-8") == page.html
    with pytest.raises(ValueError, match=r"must end in \.html"):
        page.save(tmp_path / "match.png")
    assert "expected error" in matches_page([match]).html
    mesh = match.mesh
    page = functions_page([mesh], [mesh.vertices[:, 2]], labels=["along z"])
    assert "along z" in page.html


def test_a_collection_survives_a_pickle_and_a_copy():
    creatures = make_creatures(2, 500, n_points=100)
    for again in (pickle.loads(pickle.dumps(creatures)), copy.copy(creatures)):
        assert isinstance(again, Collection)
        assert list(again) == list(creatures)
        assert again.meshes[1].content_hash == creatures.meshes[1].content_hash


def test_a_collection_is_a_bunch_with_its_parts_as_attributes():
    creatures = make_creatures(2, 500, n_points=100)
    assert creatures["meshes"] is creatures.meshes
    assert list(creatures) == [
        "meshes", "correspondences", "names", "template_points", "up", "DESCR",
    ]  # fmt: skip
    assert repr(creatures).startswith("Collection(2 meshes")
