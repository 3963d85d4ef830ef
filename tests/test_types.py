"""What the type checker tells a user of a word that no parameter takes."""

from pathlib import Path

import pytest

_HEAD = """\
import skfmap
from skfmap.datasets import Collection, load_collection

def use(collection: Collection) -> list[skfmap.Mesh]:
    return collection.meshes

def count() -> int:
    return len(use(load_collection("meshes"))) + len(skfmap.io.READ_SUFFIXES)

"""
_WRONG = {
    'skfmap.WeightedFunctionalMapLearner(weighting="bogus")': "weighting",
    'skfmap.WeightedFunctionalMapLearner(matching="hard")': "matching",
    'skfmap.WeightedFunctionalMapLearner(refine="zoom-out")': "refine",
    'skfmap.WeightedFunctionalMapLearner(known_maps="landmarks")': "known_maps",
    'skfmap.SpectralBasis(laplacian="graph")': "laplacian",
    'skfmap.DescriptorTransformer("default")': "DescriptorTransformer",
    'load_collection("meshes", on_invalid="ignore")': "on_invalid",
    "skfmap.WeightedFunctionalMapLearner().fit()": "Missing positional arguments",
    "skfmap.pictures": "no attribute",
}
_RIGHT = [
    "skfmap.WeightedFunctionalMapLearner(weighting=[0, 1], regularizer=lambda a, b: a)",
    "skfmap.WeightedFunctionalMapLearner(weighting=None, refine=None, epsilon=1.0)",
    'skfmap.SpectralBasis(laplacian="robust", on_invalid="skip", wrap="auto")',
]


def test_words_that_no_parameter_takes_are_found(tmp_path):
    """One run: each wrong line has an error that names its parameter, and no other line has one."""
    api = pytest.importorskip("mypy.api")
    script = tmp_path / "user.py"
    lines = [*_HEAD.splitlines(), *_RIGHT, *_WRONG]
    script.write_text("\n".join(lines) + "\n", encoding="utf-8")
    project = Path(__file__).resolve().parents[1]
    config = ["--config-file", str(project / "pyproject.toml")]
    cache = ["--cache-dir", str(project / ".mypy_cache")]
    told, failed, status = api.run(["--strict", *config, *cache, "--no-error-summary", str(script)])
    assert (status, failed) == (1, ""), told
    errors = [line.split(": error: ", 1) for line in told.splitlines() if ": error: " in line]
    at = {int(where.rsplit(":", 1)[1]): message for where, message in errors}
    first = len(lines) - len(_WRONG) + 1
    assert sorted(at) == list(range(first, first + len(_WRONG))), told
    for number, word in enumerate(_WRONG.values(), start=first):
        assert word in at[number]
