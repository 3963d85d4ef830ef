"""scikit-learn's callback protocol (from 1.9): a fit is a task, each iteration a subtask."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self, TypeVar

from sklearn.base import BaseEstimator

if TYPE_CHECKING:
    _Method = TypeVar("_Method", bound=Callable[..., Any])

    class CallbackSupportMixin:
        """As scikit-learn's, which has no types."""

    def with_callbacks(method: _Method) -> _Method:
        """Keep the type of the method."""
        return method

else:
    try:
        from sklearn.callback import CallbackSupportMixin, with_callbacks
    except ImportError:

        class CallbackSupportMixin:
            """Nothing: the installed scikit-learn has no callbacks."""

        def with_callbacks(method):
            """Return the method itself."""
            return method


__all__ = ["CallbackSupportMixin", "FitTask", "with_callbacks"]


class FitTask:
    """What the callbacks of an estimator are told during one `fit`; nothing where there are none.

    Parameters
    ----------
    estimator : estimator
        Whose `fit` runs, decorated by ``with_callbacks``.
    X, y, sample_weight : objects
        What `fit` was given.
    max_iter : int
        Most iterations.
    """

    def __init__(
        self,
        estimator: BaseEstimator | None,
        X: object,
        y: object,
        sample_weight: object,
        max_iter: int,
    ) -> None:
        self._given = {
            "estimator": estimator,
            "X": X,
            "y": y,
            "metadata": None if sample_weight is None else {"sample_weight": sample_weight},
        }
        self._task: Any = None
        self._iteration: Any = None
        if estimator is not None and hasattr(estimator, "_init_callback_context"):
            # The last iteration is followed by the beginning of one that does not take place.
            self._task = estimator._init_callback_context(max_subtasks=max_iter + 1)
            self._task.call_on_fit_task_begin(**self._given)

    @classmethod
    def untold(cls) -> Self:
        """Return the task of a fit that no callback is told of."""
        return cls(None, None, None, None, 0)

    def begin_iteration(self) -> None:
        """Tell that an iteration begins."""
        if self._task is not None:
            self._iteration = self._task.subcontext(task_name="iteration")
            self._iteration.call_on_fit_task_begin(**self._given)

    def end_iteration(self, fitted: Callable[[], dict[str, Any]] | None = None) -> bool:
        """Tell that the iteration has ended, and return whether a callback asks to stop.

        ``fitted`` gives the attributes of an estimator as if `fit` ended here; it is called if a
        callback wants them.
        """
        iteration, self._iteration = self._iteration, None
        if iteration is None:
            return False
        return bool(iteration.call_on_fit_task_end(**self._given, reconstruction_attributes=fitted))

    def end(self, fitted: dict[str, Any]) -> None:
        """Tell that the fit has ended."""
        self.end_iteration()
        if self._task is not None:
            self._task.call_on_fit_task_end(**self._given, reconstruction_attributes=fitted)
