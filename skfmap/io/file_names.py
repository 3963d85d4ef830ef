"""Names of files for shapes, whatever these are called."""

import hashlib

__all__ = ["file_stem"]

# Systems take 255 bytes, suffix included; what lies beside a mesh has longer suffixes.
_LONGEST = 200
_FORBIDDEN = '/\\:*?"<>|'


def file_stem(name: str) -> str:
    """Return the name of a file, without suffix, that all systems take.

    Characters that some have not are replaced by ``_``. A name that is too long is cut, and ends in
    a hash of all of it, so that two that begin alike stay apart.
    """
    stem = "".join(c if c.isprintable() and c not in _FORBIDDEN else "_" for c in name)
    content = stem.encode()
    if len(content) <= _LONGEST:
        return stem
    mark = hashlib.sha256(content).hexdigest()[:12]
    return f"{content[: _LONGEST - len(mark) - 1].decode(errors='ignore')}-{mark}"
