"""Formulas as MathML, which browsers draw by themselves: pages need no network to be read."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging


def _to_mathml(node, display):
    made = convert(node.astext().replace(r"\arg\min", r"\mathrm{arg}\,\min"), display=display)
    for command in re.findall(r"\\\w+", made):
        logging.getLogger(__name__).warning("%s is not known in formulas", command, location=node)
    return made


def _inline(translator, node):
    translator.body.append(_to_mathml(node, "inline"))
    raise nodes.SkipNode


def _block(translator, node):
    translator.body.append(f'<div class="math">{_to_mathml(node, "block")}</div>')
    raise nodes.SkipNode


def setup(app):
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
