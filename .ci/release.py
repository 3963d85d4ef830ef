"""Prepare a release: what must hold before it, and what changes with it."""

import datetime
import re
import subprocess
import sys
from pathlib import Path

CHANGELOG, VERSION_FILE = Path("docs/changelog.rst"), Path("skfmap/_version.py")
CITATION, RECIPE = Path("CITATION.cff"), Path("docs/conda/recipe.yaml")
_VERSION = re.compile(r'^__version__ = "(.*)"$', re.MULTILINE)


def check(version: str, current: str, changelog: str, changed_files: str, tags: str) -> str | None:
    """Return why ``version`` cannot be released, or None."""
    if not re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?", version):
        return f"{version!r} is no version like 1.2.3 or 1.2.3rc1."
    if changed_files.strip():
        return f"The checkout has changes that are not committed:\n{changed_files}"
    if f"v{version}" in tags.split():
        return f"There is a tag v{version} already."
    heading = f"{version} (unreleased)"
    if heading not in changelog:
        return f"{CHANGELOG} has no section '{heading}' (the package says {current})."
    section = changelog.split(heading, 1)[1].split("\n", 2)[2]
    if not re.search(
        r"^- ", re.split(r"^\d+\.\d+\.\d+", section, flags=re.MULTILINE)[0], re.MULTILINE
    ):
        return f"The section '{heading}' of {CHANGELOG} says nothing."
    return None


def dated(changelog: str, version: str, today: datetime.date) -> str:
    """Return the changelog with the date of the release."""
    old, new = f"{version} (unreleased)", f"{version} ({today:%Y-%m-%d})"
    text = changelog.replace(old, new, 1)
    return text.replace(f"{new}\n{'-' * len(old)}", f"{new}\n{'-' * len(new)}", 1)


def versioned(source: str, version: str) -> str:
    """Return the source of the version file with another version."""
    text, n = _VERSION.subn(f'__version__ = "{version}"', source)
    if n != 1:
        raise ValueError(f"{VERSION_FILE} holds {n} lines with __version__; one is needed.")
    return text


def cited(citation: str, version: str, today: datetime.date) -> str:
    """Return the citation file with another version and the date of its release."""
    text, n = re.subn(
        r"^version: .*\n(date-released: .*\n)?",
        f"version: {version}\ndate-released: {today:%Y-%m-%d}\n",
        citation,
        flags=re.MULTILINE,
    )
    if n != 1:
        raise ValueError(f"{CITATION} holds {n} lines with a version; one is needed.")
    return text


def packed(recipe: str, version: str) -> str:
    """Return conda's recipe with another version."""
    text, n = re.subn(r'^  version: ".*"$', f'  version: "{version}"', recipe, flags=re.MULTILINE)
    if n != 1:
        raise ValueError(f"{RECIPE} holds {n} lines with a version; one is needed.")
    return text


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True).stdout


def main(what: str, version: str) -> int:
    """Check that a version can be released, or write it into the files; return the exit status."""
    changelog, source = (path.read_text(encoding="utf-8") for path in (CHANGELOG, VERSION_FILE))
    if what == "check":
        current = _VERSION.search(source)
        told = check(
            version,
            current[1] if current else "?",
            changelog,
            _git("status", "--porcelain"),
            _git("tag"),
        )
        if told:
            sys.stderr.write(told + "\n")
        return int(told is not None)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    CHANGELOG.write_text(dated(changelog, version, today), encoding="utf-8")
    CITATION.write_text(
        cited(CITATION.read_text(encoding="utf-8"), version, today), encoding="utf-8"
    )
    RECIPE.write_text(packed(RECIPE.read_text(encoding="utf-8"), version), encoding="utf-8")
    VERSION_FILE.write_text(versioned(source, version), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
