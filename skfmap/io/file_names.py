"""Portable file names for shapes."""

import hashlib

__all__ = ["file_stem"]

# File systems allow 255 bytes including the suffix; files beside a mesh have longer suffixes.
_LONGEST = 200
_FORBIDDEN = '/\\:*?"<>|'


def file_stem(name: str) -> str:
    """Return a file name without suffix that is valid on all systems.

    Characters that are not allowed everywhere are replaced by ``_``. A name that is too long is cut
    and ends in a hash of the whole name, so that names with the same beginning stay distinct.
    """
    stem = "".join(c if c.isprintable() and c not in _FORBIDDEN else "_" for c in name)
    content = stem.encode()
    if len(content) <= _LONGEST:
        return stem
    mark = hashlib.sha256(content).hexdigest()[:12]
    return f"{content[: _LONGEST - len(mark) - 1].decode(errors='ignore')}-{mark}"
