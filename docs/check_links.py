"""Check that every link inside the built pages leads somewhere: files, and anchors in them.

python docs/check_links.py docs/_build/html
"""

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """Collects what a page links to, and what can be linked to in it."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):  # noqa: ARG002
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name in ("id", "name") and value:
                self.anchors.add(value)


@cache
def _page(path):
    return _Page(path.read_text(encoding="utf-8"))


def broken_links(root):
    """Return (page, link) for every local link that leads nowhere."""
    broken = []
    for path in sorted(root.rglob("*.html")):
        if "_static" in path.parts:  # a template of the theme
            continue
        for link in _page(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            lost = not target.exists() or (
                target.suffix == ".html"
                and parts.fragment
                and unquote(parts.fragment) not in _page(target).anchors
            )
            if lost:
                broken.append((path.relative_to(root), link))
    return broken


if __name__ == "__main__":
    lost = broken_links(Path(sys.argv[1]).resolve())
    for page, link in lost:
        sys.stderr.write(f"{page}: {link} leads nowhere\n")
    sys.exit(bool(lost))
