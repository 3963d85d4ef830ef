"""Refuse a commit that changes the package and says nothing about it in the changelog."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

CHANGELOG = "docs/changelog.rst"
_EXCUSE = re.compile(r"^No-changelog: \S", re.MULTILINE)


def complaint(changed: Sequence[str], message: str) -> str | None:
    """Return what is wrong with a commit, or None.

    Parameters
    ----------
    changed : sequence of str
        Files that the commit changes, relative to the top of the checkout.
    message : str
        Its message.

    Returns
    -------
    str or None
        What to do about it.
    """
    package = [name for name in changed if name.startswith("skfmap/")]
    if not package or CHANGELOG in changed or _EXCUSE.search(message):
        return None
    return (
        f"{package[0]} is changed, but {CHANGELOG} is not. Add a line for those who use the "
        "package; if nobody can notice the change, add a line 'No-changelog: why' to the message."
    )


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=True).stdout


def main(message_file: str) -> int:
    """Check the commit that is being made; return the exit status."""
    if Path(_git("rev-parse", "--git-path", "MERGE_HEAD").strip()).exists():
        return 0  # each commit that is merged has been looked at
    staged = _git("diff", "--cached", "--name-only").splitlines()
    told = complaint(staged, Path(message_file).read_text(encoding="utf-8"))
    if told:
        sys.stderr.write(told + "\n")
    return int(told is not None)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
