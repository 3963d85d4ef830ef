"""The architecture page: layers from pyproject.toml, descriptions from docstrings."""

import ast
import tomllib
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "skfmap"


def read_layers():
    """Return the layers of the import-linter contract, the top first: lists of names of modules."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (contract,) = (
        one for one in contracts if one["type"] == "layers" and one["containers"] == ["skfmap"]
    )
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def describe(path):
    """Return the first line of a module's docstring."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))).splitlines()[0]


def modules_of(name):
    """Return (dotted name, description) of a module, and of what it holds if it is a package."""
    folder = PACKAGE / name
    if not folder.is_dir():
        return [(name, describe(PACKAGE / f"{name}.py"))]
    inside = sorted(path for path in folder.glob("*.py") if path.stem != "__init__")
    return [
        (name, describe(folder / "__init__.py")),
        *((f"{name}.{path.stem}", describe(path)) for path in inside),
    ]


class Modules(SphinxDirective):
    """Write a table of all modules, layer by layer."""

    def run(self):
        lines = [".. list-table::", "   :widths: 30 70", ""]
        for layer in read_layers():
            for name, description in (module for top in layer for module in modules_of(top)):
                lines += [f"   * - ``{name}``", f"     - {description}"]
        holder = nodes.container()
        self.state.nested_parse(StringList(lines, source="layers.py"), self.content_offset, holder)
        return holder.children


def setup(app):
    """Register the directive ``modules``."""
    app.add_directive("modules", Modules)
    return {"parallel_read_safe": True}
