"""The rules that contributions are held to, and the steps of a release."""

import datetime
import importlib.util
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

import skfmap

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(not (ROOT / ".ci").is_dir(), reason="not in a checkout")


def _script(path):
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("changed", "message", "refused"),
    [
        (["skfmap/learner.py"], "Faster", True),
        (["skfmap/learner.py", "docs/changelog.rst"], "Faster", False),
        (["tests/test_io.py", "docs/index.rst"], "More tests", False),
        (["skfmap/learner.py"], "Rename\n\nNo-changelog: a private name", False),
        (["skfmap/learner.py"], "Rename\n\nNo-changelog:", True),
    ],
)
def test_a_change_of_the_package_needs_a_changelog_entry(changed, message, refused):
    told = _script(".ci/changelog_entry.py").complaint(changed, message)
    assert (told is not None) == refused
    assert not refused or changed[0] in told


def test_the_hook_reads_what_is_staged_and_lets_merges_pass(tmp_path, monkeypatch, capsys):
    def git(*arguments):
        subprocess.run(["git", *arguments], check=True, capture_output=True)

    monkeypatch.chdir(tmp_path)
    for variable in (
        "GIT_DIR",
        "GIT_INDEX_FILE",
        "GIT_WORK_TREE",
    ):  # set where a hook runs the tests
        monkeypatch.delenv(variable, raising=False)
    main = _script(".ci/changelog_entry.py").main
    git("init")
    for name in ("skfmap/io.py", "docs/changelog.rst", "message"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("text\n")
    git("add", "skfmap/io.py")
    assert main("message") == 1
    assert "No-changelog: why" in capsys.readouterr().err
    (tmp_path / ".git" / "MERGE_HEAD").touch()
    assert main("message") == 0
    (tmp_path / ".git" / "MERGE_HEAD").unlink()
    git("add", "docs/changelog.rst")
    assert main("message") == 0


def _advisories():
    return tomllib.loads((ROOT / ".ci/advisories.toml").read_text(encoding="utf-8"))["advisory"]


def test_no_version_that_is_allowed_has_a_known_vulnerability(project):
    audit = _script(".ci/audit.py")
    oldest = audit.floors(project["project"])
    assert {item["package"] for item in _advisories()} <= set(oldest)
    assert audit.affected(oldest, _advisories()) == []
    assert audit.affected(audit.installed(), _advisories()) == []


def test_an_audit_finds_what_is_affected():
    audit = _script(".ci/audit.py")
    told = audit.affected({"FileLock": "3.12.0", "skops": "0.13.0"}, _advisories())
    assert [line.split(",")[0] for line in told] == [
        "filelock 3.12.0: CVE-2025-68146",
        "filelock 3.12.0: CVE-2026-22701",
    ]
    answer = {
        "dependencies": [
            {"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]},
            {"name": "b", "version": "1", "vulns": []},
            {"name": "c", "skip_reason": "not found"},
        ]
    }
    assert audit.told_by_database(answer) == (["a 1: CVE-1; fixed in 2."], 2)


@pytest.mark.parametrize(
    ("answer", "options", "status"),
    [
        (([], 0), [], 1),
        (([], 0), ["--without-database"], 0),
        (([], 3), [], 0),
        ((["a 1: CVE-1"], 3), ["--without-database"], 1),
    ],
)
def test_an_audit_without_a_database_is_none(monkeypatch, capsys, answer, options, status):
    audit = _script(".ci/audit.py")
    monkeypatch.setattr(audit, "_ask_database", lambda versions: answer)
    assert audit.main(options) == status
    assert ("COULD NOT BE ASKED" in capsys.readouterr().out) == (answer[1] == 0)


_CHANGELOG = (
    "Changelog\n=========\n\n1.2.0 (unreleased)\n------------------\n\nAdded\n\n- Something.\n\n"
    "1.1.0 (2025-01-01)\n"
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, None),
        ({"version": "1.2"}, "not a version like"),
        ({"changed_files": " M skfmap/io.py"}, "not committed"),
        ({"tags": "v1.1.0 v1.2.0"}, "tag v1.2.0 already"),
        ({"version": "1.3.0"}, "has no section '1.3.0 (unreleased)'"),
        ({"changelog": _CHANGELOG.replace("- Something.\n", "")}, "says nothing"),
    ],
)
def test_what_must_hold_before_a_release(change, message):
    given = {
        "version": "1.2.0",
        "current": "1.1.0",
        "changelog": _CHANGELOG,
        "changed_files": "",
        "tags": "v1.1.0",
    }
    told = _script(".ci/release.py").check(**given | change)
    assert told is None if message is None else message in told


def test_what_changes_with_a_release():
    release = _script(".ci/release.py")
    text = release.dated(_CHANGELOG, "1.2.0", datetime.date(2026, 3, 4))
    assert "1.2.0 (2026-03-04)\n------------------\n" in text
    source = (ROOT / "skfmap" / "_version.py").read_text(encoding="utf-8")
    assert '__version__ = "9.8.7"' in release.versioned(source, "9.8.7")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    dated = release.cited(citation, "9.8.7", datetime.date(2026, 3, 4))
    assert "\nversion: 9.8.7\ndate-released: 2026-03-04\n" in dated
    again = release.cited(dated, "9.8.8", datetime.date(2026, 3, 5))
    assert again.count("date-released") == 1
    recipe = (ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert '\n  version: "9.8.7"\n' in release.packed(recipe, "9.8.7")
    for write in (release.versioned, release.packed):
        with pytest.raises(ValueError, match="0 lines"):
            write("", "9.8.7")
    with pytest.raises(ValueError, match="0 lines"):
        release.cited("", "9.8.7", datetime.date(2026, 3, 4))


def test_one_address_and_one_version_everywhere(project):
    urls = project["project"]["urls"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    recipe = (ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert f"\nversion: {skfmap.__version__}\n" in citation
    assert f'\n  version: "{skfmap.__version__}"\n' in recipe
    assert f"repository-code: {urls['Source']}\nurl: {urls['Homepage']}\n" in citation
    assert f"homepage: {urls['Homepage']}\n  repository: {urls['Source']}\n" in recipe


def test_the_picture_of_the_readme_also_shows_on_a_package_index(project):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text)
    assert pictures
    raw = project["project"]["urls"]["Source"].replace("github.com", "raw.githubusercontent.com")
    for address in pictures:
        assert address.startswith(f"{raw}/main/")
        assert (ROOT / address.removeprefix(f"{raw}/main/")).is_file()


def test_the_recipe_of_conda_has_the_floors(project):
    recipe = (ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    conda_name = {"libigl": "igl", "matplotlib": "matplotlib-base"}
    for line in [
        *project["project"]["dependencies"],
        f"python{project['project']['requires-python']}",
    ]:
        name, floor = line.split(">=")
        assert f"    - {conda_name.get(name, name)} >={floor}" in recipe.split("run:")[1]


# Extras of some hundred MB, which the gate does not install; their tests run where they are.
NOT_IN_THE_GATE = {"pyvista"}


def test_the_oldest_dependencies_are_the_floors(project):
    extras = project["project"]["optional-dependencies"].items()
    lines = [line for name, extra in extras for line in extra if name not in NOT_IN_THE_GATE]
    floors = [*project["project"]["dependencies"], *lines]
    pinned = dict(line.split("==") for line in project["dependency-groups"]["oldest"])
    for line in floors:
        name, floor = line.split(">=")
        padded = ".".join([*floor.split("."), "0", "0"][:3])
        assert pinned.pop(name) == padded
    assert set(pinned) == {"pyparsing"}  # of matplotlib


def test_each_step_of_the_gate_that_is_written_down_is_there():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    steps = set(re.findall(r"^#   \.ci/run (\w+)", script, re.MULTILINE))
    functions = set(re.findall(r"^(\w+)\(\) \{", script, re.MULTILINE))
    assert steps <= functions
    page = (ROOT / "docs" / "contributing.rst").read_text(encoding="utf-8")
    assert set(re.findall(r"\.ci/run ([a-z]+)", page)) >= steps


def test_links_inside_pages_are_followed(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top">A</h1><a href="b.html#there">b</a><a href="https://x.org/y">x</a>'
    )
    (tmp_path / "b.html").write_text(
        '<p id="there"></p><a href="a.html#top">a</a><img src="lost.png"><a href="#no">n</a>'
    )
    broken = _script("docs/check_links.py").broken_links(tmp_path)
    assert sorted(link for _, link in broken) == ["#no", "lost.png"]
