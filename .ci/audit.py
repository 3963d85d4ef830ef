"""Look for known vulnerabilities in the dependencies, as installed and in their oldest versions.

Two sources: ``advisories.toml`` beside this file, which needs no network, and the database that
pip-audit asks. Without a network the second is no audit: that is an error, unless
``--without-database`` says that it may be missing.
"""

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from packaging.version import Version

_TOP = Path(__file__).resolve().parent.parent


def floors(project: Mapping[str, Any]) -> dict[str, str]:
    """Return the oldest version of each dependency and extra that a project table allows."""
    extras = project.get("optional-dependencies", {}).values()
    every = [*project["dependencies"], *(line for extra in extras for line in extra)]
    return dict(re.split(r"\s*>=\s*", line, maxsplit=1) for line in every)


def installed() -> dict[str, str]:
    """Return the version of each distribution in this environment."""
    return {
        _plain(item.metadata["Name"]): item.version
        for item in distributions()
        if item.metadata["Name"]
    }


def affected(versions: Mapping[str, str], advisories: Iterable[Mapping[str, str]]) -> list[str]:
    """Return a line for each version that an advisory is about.

    Parameters
    ----------
    versions : mapping of str to str
        Version of each package.
    advisories : iterable of mapping
        With ``package``, ``id``, ``fixed`` and ``what``.

    Returns
    -------
    list of str
        What is affected, and what to do.
    """
    have = {_plain(name): version for name, version in versions.items()}
    return [
        f"{item['package']} {have[item['package']]}: {item['id']}, {item['what']}; fixed in "
        f"{item['fixed']}."
        for item in advisories
        if item["package"] in have and Version(have[item["package"]]) < Version(item["fixed"])
    ]


def told_by_database(report: Mapping[str, Any]) -> tuple[list[str], int]:
    """Return what pip-audit found, and how many packages it could look up."""
    looked_up = [item for item in report["dependencies"] if "vulns" in item]
    found = [
        f"{item['name']} {item['version']}: {vuln['id']}; fixed in "
        f"{', '.join(vuln['fix_versions']) or 'no version'}."
        for item in looked_up
        for vuln in item["vulns"]
    ]
    return found, len(looked_up)


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _ask_database(versions: Mapping[str, str]) -> tuple[list[str], int]:
    pins = "".join(
        f"{name}=={version}\n"
        for name, version in sorted(versions.items())
        if _plain(name) != "skfmap"
    )
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write(pins)
        file.flush()
        command = [
            "-r",
            file.name,
            "--no-deps",
            "--disable-pip",
            "-f",
            "json",
            "--progress-spinner",
            "off",
        ]
        done = subprocess.run(
            [sys.executable, "-m", "pip_audit", *command, "--timeout", "10"],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
    try:
        return told_by_database(json.loads(done.stdout))
    except ValueError:
        return [], 0


def main(arguments: Sequence[str]) -> int:
    """Audit; return the exit status."""
    known = tomllib.loads((_TOP / ".ci/advisories.toml").read_text(encoding="utf-8"))["advisory"]
    project = tomllib.loads((_TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    status = 0
    for what, versions in (
        ("oldest versions allowed", floors(project)),
        ("versions installed", installed()),
    ):
        found = affected(versions, known)
        told, n_looked_up = _ask_database(versions)
        sys.stdout.write(
            f"{what}: {len(versions)} packages, {len(known)} advisories in .ci/advisories.toml; "
        )
        sys.stdout.write(f"{n_looked_up} looked up in the database\n")
        for line in (*found, *told):
            sys.stdout.write(f"  {line}\n")
        if not n_looked_up:
            sys.stdout.write(
                "  THE DATABASE COULD NOT BE ASKED: advisories that .ci/advisories.toml lacks go "
                "unseen\n"
            )
        may_lack = "--without-database" in arguments
        status |= bool(found or told or not (n_looked_up or may_lack))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
