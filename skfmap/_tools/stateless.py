"""Transformers that learn nothing and take shapes rather than tables."""

from sklearn.base import TransformerMixin
from sklearn.utils import Tags

from skfmap._tools.documented import Documented

__all__ = ["StatelessShapeTransformer"]


class StatelessShapeTransformer(Documented, TransformerMixin):
    """Mixin of transformers whose `transform` works without `fit`, on lists that stay lists."""

    def __init_subclass__(cls, **options: object) -> None:
        """Keep `set_output` from wrapping lists of shapes in frames."""
        super().__init_subclass__(**{**options, "auto_wrap_output_keys": None})

    def __sklearn_is_fitted__(self) -> bool:
        """Return True: there is no state."""
        return True

    def __sklearn_tags__(self) -> Tags:
        """Return tags that say that samples are no rows of a table."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.requires_fit = False
        return tags
