"""Diagrams of estimators link to pages that are there."""

import inspect
import re
import tomllib
from pathlib import Path

import pytest
from sklearn.base import BaseEstimator

import skfmap
from skfmap import descriptors, known_maps, learner, refinement, registration, shape_space
from skfmap._tools.documented import DOCS

ROOT = Path(__file__).resolve().parents[1]
in_checkout = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="not in a checkout")

ESTIMATORS = {
    value
    for module in (skfmap, descriptors, known_maps, learner, refinement, registration, shape_space)
    for value in (getattr(module, name) for name in module.__all__)
    if isinstance(value, type)
    and issubclass(value, BaseEstimator)
    and not inspect.isabstract(value)
}


@in_checkout
@pytest.mark.parametrize("cls", sorted(ESTIMATORS, key=lambda cls: cls.__name__))
def test_every_estimator_links_to_its_page_of_the_api(cls):
    link = cls._get_doc_link(cls.__new__(cls))
    name = link.removeprefix(f"{DOCS}/generated/api/skfmap.").removesuffix(".html")
    listed = (ROOT / "docs" / "api.rst").read_text(encoding="utf-8")
    assert re.search(rf"^   {re.escape(name)}$", listed, re.MULTILINE), link


@in_checkout
def test_links_lead_to_the_docs_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert DOCS.startswith(f"{project['urls']['Documentation']}/")


def test_links_show_in_the_diagram():
    shown = skfmap.SpectralBasis()._repr_html_()
    assert f"{DOCS}/generated/api/skfmap.SpectralBasis.html" in shown


def test_estimators_of_others_do_not_link_to_ours():
    class Finer(skfmap.SpectralBasis):
        pass

    assert Finer()._get_doc_link() == ""
