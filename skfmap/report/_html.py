"""Elements of an HTML page; all text is escaped here, and only here."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["details", "findings", "page", "paragraph", "picture", "section", "table"]

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1c2430; }
body { margin: 0 auto; max-width: 1080px; padding: 1.5rem; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; } h2 { font-size: 1.2rem; margin: 2.2rem 0 .4rem; }
p { max-width: 75ch; } .quiet { color: #5a6675; }
ul.findings { list-style: none; padding: 0; }
ul.findings li { border-left: .4rem solid; background: #f5f7fa; }
ul.findings li { padding: .35rem .8rem; margin: .35rem 0; }
li.good { border-color: #0072b2 !important; } li.doubtful { border-color: #e69f00 !important; }
li.bad { border-color: #d55e00 !important; } li b { display: inline-block; min-width: 5.5em; }
table { border-collapse: collapse; font-size: 13.5px; }
th, td { padding: .2rem .7rem; text-align: right; }
th { border-bottom: 2px solid #c9d1da; } td { border-bottom: 1px solid #e6eaef; }
th:first-child, td:first-child { text-align: left; }
figure { margin: .8rem 0; overflow-x: auto; } figure img { max-width: 100%; }
summary { cursor: pointer; color: #0072b2; }
"""


def page(title: str, subtitle: str, sections: Iterable[str]) -> str:
    """Return a self-contained page."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        f'<h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n'
        + "\n".join(sections)
        + "\n</body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a section; ``parts`` are already HTML."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "</section>"


def paragraph(text: str) -> str:
    """Return a paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def findings(items: Iterable[tuple[str, str]]) -> str:
    """Return a list of findings, given as pairs of a level and a sentence."""
    lines = (
        f'<li class="{escape(level)}"><b>{escape(level)}</b> {escape(text)}</li>'
        for level, text in items
    )
    return '<ul class="findings">' + "".join(lines) + "</ul>"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table whose first column names the rows."""
    head = "".join(f"<th>{escape(str(cell))}</th>" for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def details(summary: str, *parts: str) -> str:
    """Return a collapsed element that opens on a click; ``parts`` are already HTML."""
    return f"<details><summary>{escape(summary)}</summary>" + "".join(parts) + "</details>"


def picture(figure: "Figure", text: str) -> str:
    """Return a matplotlib figure as an embedded image, and close the figure."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    plt.close(figure)
    content = base64.b64encode(stream.getvalue()).decode("ascii")
    return f'<figure><img alt="{escape(text)}" src="data:image/png;base64,{content}"></figure>'
