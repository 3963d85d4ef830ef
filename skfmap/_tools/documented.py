"""Estimators whose diagrams in notebooks link to these docs."""

import sys

__all__ = ["DOCS", "Documented"]

DOCS = "https://skfmap.readthedocs.io/en/stable"  # tests compare it with pyproject.toml


class Documented:
    """Mixin of estimators that tells scikit-learn's diagrams where their page is."""

    _doc_link_module = "skfmap"
    _doc_link_template = f"{DOCS}/generated/api/{{public_name}}.html"

    def _doc_link_url_param_generator(self) -> dict[str, str]:
        """Return the name that the page has: that of the package, or of its public module."""
        cls = type(self)
        package, module = cls.__module__.split(".")[:2]
        at_top = getattr(sys.modules[package], cls.__name__, None) is cls
        return {"public_name": ".".join([package, *([] if at_top else [module]), cls.__name__])}
