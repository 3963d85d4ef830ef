"""What the pages say can be run, and every public name has its place in them."""

import importlib
import pkgutil
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import skfmap
from skfmap.commands.dispatch import parser_of, split_verb

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="not in a checkout")


def _pages():
    if not (ROOT / "docs").is_dir():
        return []
    pages = [
        path
        for path in (ROOT / "docs").rglob("*.rst")
        if not {"_build", "generated"} & set(path.parts)
    ]
    return [ROOT / "README.md", *sorted(pages)]


def _blocks(language):
    """Return the lines of all code blocks of a language."""
    for path in _pages():
        text = path.read_text(encoding="utf-8")
        pattern = (
            rf"```{language}\n(.*?)```"
            if path.suffix == ".md"
            else rf"\.\. code-block:: {language}\n\n((?:   .*\n|\n)+)"
        )
        for block in re.findall(pattern, text, re.DOTALL if path.suffix == ".md" else 0):
            yield path.name, [line.strip() for line in block.splitlines() if line.strip()]


def test_python_stands_in_examples_that_are_run():
    """Doctests are collected from every page; a block without a prompt would not be run."""
    for name, lines in _blocks("python"):
        assert all(
            line.startswith((">>>", "...")) or lines[i - 1].startswith((">>>", "..."))
            for i, line in enumerate(lines)
        ), name


def _installs(command):
    """Whether extras, addresses and files of a command that installs something are ours."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    if command.startswith("git clone"):
        return command.split()[2] == project["urls"]["Source"]
    if command.startswith("rattler-build"):
        return (ROOT / command.split("--recipe ")[1].split()[0]).is_file()
    extras = re.findall(r"\[([\w,-]+)\]", command)
    return {one for group in extras for one in group.split(",")} <= set(
        project["optional-dependencies"]
    )


def _commands():
    return [
        (name, line)
        for name, lines in _blocks("console")
        for line in lines
        if not line.startswith("#")
    ]


@pytest.mark.parametrize(("page", "command"), _commands())
def test_commands_are_those_that_the_gate_runs_or_parse(page, command):
    if command.startswith("python3 -m venv"):
        assert f"```console\n{command}\n```" in (ROOT / "README.md").read_text(
            encoding="utf-8"
        )  # the gate runs these
    elif "pip install" in command or command.startswith(("git clone", "rattler-build")):
        assert _installs(command)
    elif command.startswith(".ci/run"):
        step = command.split()[1]
        assert f"\n{step}() {{\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    elif "-m skfmap" in command:
        arguments = command.split("-m skfmap", 1)[1].replace("'", "").replace('"', "").split()
        verb, rest = split_verb(arguments)
        assert parser_of(verb).parse_args(rest)
    else:
        script = re.search(r"tests/benchmarks/\w+\.py", command)
        assert script, f"{page}: nothing runs {command!r}"
        assert (ROOT / script[0]).is_file()


def test_benchmarks_that_pages_name_are_there():
    for path in _pages():
        for script in re.findall(r"tests/benchmarks/\w+\.py", path.read_text(encoding="utf-8")):
            assert (ROOT / script).is_file(), f"{path.name}: {script}"


def _public():
    """Return the names that users import: those of the package, and those of its public modules."""
    names = {f"{name}" for name in skfmap.__all__ if not name.startswith("_")}
    for module in pkgutil.iter_modules(skfmap.__path__):
        if not module.name.startswith("_") and module.name not in (
            "basis",
            "learner",
            "shapes",
            "geometry",
            "exceptions",
        ):
            public = importlib.import_module(f"skfmap.{module.name}")
            names |= {f"{module.name}.{name}" for name in public.__all__}
    return names


# Public elsewhere, or of use inside the package only.
_ELSEWHERE = {
    *(
        "descriptors.DescriptorTransformer",
        "functional.basis_error",
        "metrics.ERROR_KINDS",
        "io.MESH_SUFFIXES",
    ),
    *(
        "report.thin_out",
        "report.landmark_table",
        "persistence.TRUSTED_TYPES",
        "io.as_mesh",
        "io.as_meshes",
    ),
    *("ground_truth.KnownMap", "ground_truth.join_with_reference", "ground_truth.known_maps"),
    *("ground_truth.areas_of_pairs", "ground_truth.distinct_landmarks"),
    *("known_maps.KNOWN_MAPS", "known_maps.kind_of", "known_maps.record_of", "known_maps.told_of"),
    *(
        "ground_truth.check_landmarks",
        "ground_truth.coverage_messages",
        "ground_truth.warn_of_coverage",
        "health.check_mesh",
        "refinement.REFINEMENTS",
        "health.WOUND",
        "health.repair_arrays",
        "health.repair_mesh",
    ),
    *("io.as_arrays", "io.as_far_as_sound", "io.check_meshes", "io.n_vertices_of", "io.named"),
    *("io.open_given", "io.read_arrays", "io.READ_SUFFIXES", "io.unread_formats"),
    *("io.WRITTEN_SUFFIXES", "io.LANDMARK_SUFFIXES", "io.WRITTEN_LANDMARK_SUFFIXES"),
}


def _listed():
    text = (ROOT / "docs" / "api.rst").read_text(encoding="utf-8")
    return re.findall(r"^   ([A-Za-z_.]+)$", text, re.MULTILINE)


def test_every_public_name_is_in_the_api():
    missing = _public() - set(_listed()) - _ELSEWHERE
    assert not missing, sorted(missing)


def test_modules_are_there_when_the_package_is_and_wait_until_they_are_asked_for():
    code = (
        "import sys, skfmap; assert not {'matplotlib', 'trimesh', 'skfmap.report'} & "
        "set(sys.modules); modules = {name for name in dir(skfmap) if name not in "
        "skfmap.__all__}; print(*sorted(name for name in modules if getattr(skfmap, "
        "name).__name__ == f'skfmap.{name}'))"
    )
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    public = {
        module.name
        for module in pkgutil.iter_modules(skfmap.__path__)
        if not module.name.startswith("_")
    }
    assert set(told) == public
    with pytest.raises(AttributeError, match="module 'skfmap' has no attribute 'pictures'"):
        _ = skfmap.pictures


@pytest.mark.parametrize("name", _listed() if (ROOT / "docs").is_dir() else [])
def test_every_name_in_the_api_is_public(name):
    holder, _, attribute = f"skfmap.{name}".rpartition(".")
    assert attribute in importlib.import_module(holder).__all__
    assert _listed().count(name) == 1


def test_files_that_the_architecture_page_names_are_there():
    page = (ROOT / "docs" / "architecture.rst").read_text(encoding="utf-8")
    named = re.findall(r"``([\w/]+\.py)``", page)
    assert len(named) > 5
    for name in named:
        assert (ROOT / "skfmap" / name).is_file(), name


def test_every_module_has_its_line_on_the_architecture_page(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    layers = importlib.import_module("layers")
    described = {
        name
        for layer in layers.read_layers()
        for top in layer
        for name, _ in layers.modules_of(top)
    }
    files = (
        path.relative_to(ROOT / "skfmap").with_suffix("")
        for path in (ROOT / "skfmap").rglob("*.py")
    )
    modules = {".".join(part for part in path.parts if part != "__init__") for path in files} - {""}
    assert described == modules


def test_files_that_the_readme_names_are_there():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    named = re.findall(r"\]\(([^)#]+)\)", text) + re.findall(
        r"`((?:docs|examples|tests)/[\w./]*)`", text
    )
    for path in named:
        assert path.startswith("http") or (ROOT / path).exists(), path
