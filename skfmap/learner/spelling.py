"""Detection of landmark names that seem to be two spellings of one name."""

from collections.abc import Sequence

from skfmap.shapes import Correspondence

__all__ = ["spelling_message"]


def spelling_message(truths: Sequence[Correspondence], called: Sequence[str]) -> str:
    """Return a message about names that may be spelt differently on some shapes.

    These are names that differ only in case, spaces and punctuation and never occur on the same
    shape. If there are at least three shapes, they are also names of one shape only, if this shape
    lacks names that all others have.

    Parameters
    ----------
    truths : sequence of Correspondence
        Where shapes lie on the template.
    called : sequence of str
        Names of the shapes in messages.

    Returns
    -------
    str
        The message; empty if there are no such names.

    Examples
    --------
    >>> from skfmap import Correspondence
    >>> from skfmap.learner.spelling import spelling_message
    >>> one, other = (
    ...     Correspondence([[0, 0], [1, 1]], names=names)
    ...     for names in (["nose", "ear"], ["Nose", "ear"])
    ... )
    >>> spelling_message([one, other], ["X[0]", "X[1]"])[:62]
    "These names may be two spellings of one: 'nose' and 'Nose' of "
    """
    has = [truth.known_names for truth in truths]
    told = _alike(has, called) or _alone(has, called)
    return (
        f"These names may be two spellings of one: {', '.join(told)}. Landmarks are joined by "
        "name, letter for letter; rename them in the files if they are the same."
        if told
        else ""
    )


def _alike(has: Sequence[Sequence[str]], called: Sequence[str]) -> list[str]:
    first: dict[str, str] = {}
    told: dict[str, str] = {}
    together = [set(names) for names in has]
    for names, who in zip(has, called, strict=True):
        for name in names:
            other = first.setdefault(_folded(name), name)
            if other != name and not any({name, other} <= both for both in together):
                told.setdefault(name, f"{other!r} and {name!r} of {who}")
    return list(told.values())


def _folded(name: str) -> str:
    """Return the letters and digits of a name, or the name itself if it has none."""
    return "".join(c for c in name.casefold() if c.isalnum()) or name


def _alone(has: Sequence[Sequence[str]], called: Sequence[str]) -> list[str]:
    if len(has) < 3:
        return []
    told = []
    for i, (names, who) in enumerate(zip(has, called, strict=True)):
        others = [set(one) for j, one in enumerate(has) if j != i]
        alone = set(names) - set().union(*others)
        lacks = set.intersection(*others) - set(names)
        if alone and lacks:
            told.append(f"{_listed(alone)} of {who} and {_listed(lacks)} of all others")
    return told


def _listed(names: set[str]) -> str:
    return ", ".join(repr(name) for name in sorted(names))
