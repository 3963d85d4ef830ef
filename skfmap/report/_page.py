"""HTML report on a fitted model."""

import datetime
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sklearn
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.types import FloatArray
from skfmap._tools.unwrap import fitted_learner, last_step
from skfmap._tools.validation import check_folder, check_number
from skfmap._version import __version__
from skfmap.functional.stable_basis import missed_by_maps
from skfmap.learner import WeightedFunctionalMapLearner
from skfmap.metrics import ERROR_KINDS, PairErrors
from skfmap.plotting import (
    Camera,
    ErrorCurveDisplay,
    ReliabilityDisplay,
    WeightsDisplay,
    plot_functions,
    plot_matches,
)
from skfmap.report._evaluation import CrossValidation, Evaluation, evaluate
from skfmap.report._html import details, findings, page, paragraph, picture, section, table
from skfmap.report._verdict import (
    expected_and_true,
    findings_of_evaluation,
    findings_of_model,
    trusted_part,
)
from skfmap.shapes import Correspondence, Match

__all__ = ["write_report"]

_KINDS = {
    "direct": "direct",
    "consistent": "better side",
    "per_vertex": "better side per point",
}
_ASSESSED = ("expected", "most trusted half")


def write_report(
    model: BaseEstimator,
    path: str | Path,
    X: Sequence[Any] | None = None,
    y: Sequence[Correspondence | ArrayLike] | None = None,
    *,
    cv: CrossValidation = 5,
    y_scored: Sequence[Correspondence | ArrayLike] | None = None,
    evaluation: Evaluation | None = None,
    n_worst: int = 3,
    camera: Camera | None = None,
    title: str = "Learned functional maps",
    verbose: int = 0,
) -> Path:
    """Write an HTML report that shows at a glance whether a trained model can be trusted.

    Given the collection that the model was fitted on, the model is cross-validated: the page shows
    the errors on shapes that were left out, how well they were expected, and pictures of the worst
    matches. Without the collection, the page shows only what the model itself contains: its
    weights, stable functions and calibration.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        Fitted model.
    path : str or Path
        The ``.html`` file to write. It is self-contained.
    X : sequence of shapes, optional
        Shapes that the model was fitted on.
    y : sequence of correspondences, optional
        Correspondences that the model was fitted on.
    cv : int, cross-validation generator or iterable, default=5
        How to split the shapes. Each fold takes two fits, with and without weights.
    y_scored : sequence of correspondences, optional
        Correspondences to score the matches with; ``y`` by default. With sparse landmarks, give
        those that were not learned from.
    evaluation : Evaluation, optional
        Result of `evaluate`, if it has been run already. Nothing is then computed from ``X`` and
        ``y``.
    n_worst : int, default=3
        Number of matches to show in pictures, the worst ones.
    camera : Camera, optional
        Direction of view of the pictures.
    title : str
        Title of the page.
    verbose : int, default=0
        If 1, report each fold.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        If ``X`` and ``y`` are not those of the model, only one of them is given, or no shape could
        be scored.
    FileNotFoundError
        If the folder of ``path`` does not exist.
    sklearn.exceptions.NotFittedError
        If the model is not fitted.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> from skfmap.datasets import make_creatures
    >>> from skfmap.report import write_report
    >>> creatures = make_creatures(n_shapes=4, n_vertices=500)
    >>> model = make_pipeline(
    ...     skfmap.SpectralBasis(n_components=30),
    ...     skfmap.DescriptorTransformer(),
    ...     skfmap.WeightedFunctionalMapLearner(n_functions=15, tol=1e-3),
    ... ).fit(creatures.meshes, creatures.correspondences)
    >>> path = Path(tempfile.mkdtemp(), "report.html")
    >>> page = write_report(model, path, creatures.meshes, creatures.correspondences, cv=2)
    >>> "Worst matches" in page.read_text()
    True
    """
    learner = fitted_learner(model)
    check_number(n_worst, "n_worst", low=0, integer=True)
    if (X is None) != (y is None):
        raise ValueError(
            "Give both X and y: the shapes that the model was fitted on, and their correspondences."
        )
    if evaluation is None and X is not None and y is not None:
        evaluation = evaluate(model, X, y, cv=cv, y_scored=y_scored, verbose=verbose)
    evaluation = None if evaluation is None else _usable(evaluation)
    bridge = getattr(last_step(model), "bridge_", None)
    news = findings_of_model(learner)
    sections = []
    if evaluation is not None:
        news = findings_of_evaluation(learner, evaluation) + news
        sections = [_errors(evaluation), _worst(learner, evaluation, n_worst, camera)]
    sections = [
        section("Can it be trusted?", findings(news), *_hint(evaluation)),
        *sections,
        _stable_functions(learner, camera),
        _weights(learner),
        _collection(learner, evaluation),
        _settings(learner, bridge),
    ]
    check_folder(path).write_text(page(title, _subtitle(learner), sections), encoding="utf-8")
    return Path(path)


def _usable(evaluation: Evaluation) -> Evaluation:
    """Return the evaluation without skipped shapes, which have no errors."""
    kept = [i for i, errors in enumerate(evaluation.errors) if len(errors.vertices)]
    if not kept:
        raise ValueError(
            "The evaluation contains no shape that could be matched and scored. Write the report "
            "without an evaluation, or give correspondences for the shapes."
        )
    return Evaluation(
        [evaluation.meshes[i] for i in kept],
        [evaluation.matches[i] for i in kept],
        [evaluation.errors[i] for i in kept],
        [evaluation.naive_errors[i] for i in kept if evaluation.naive_errors],
    )


def _subtitle(learner: WeightedFunctionalMapLearner) -> str:
    today = datetime.datetime.now(tz=datetime.UTC).date()
    return (
        f"Reference {learner.reference_.name or 'without a name'}, {len(learner.weights_)} probe "
        f"functions, {learner.n_training_shapes_} training shapes besides the reference. skfmap "
        f"{__version__}, {today}."
    )


def _hint(evaluation: Evaluation | None) -> list[str]:
    if evaluation is not None:
        return []
    return [
        paragraph(
            "This page was written without cross-validation. Give write_report the collection, X "
            "and y, to see the errors on shapes that the model was not trained on."
        )
    ]


def _errors(evaluation: Evaluation) -> str:
    """Return a section on errors of shapes left out, worst first, and on expected errors."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    kinds = (
        ERROR_KINDS
        if all(one.symmetric is not None for one in evaluation.errors)
        else ERROR_KINDS[:1]
    )
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    ErrorCurveDisplay.from_predictions(evaluation.errors, ax=left, name="learned weights")
    if evaluation.naive_errors:
        ErrorCurveDisplay.from_predictions(
            evaluation.naive_errors, ax=left, name="no weights (D = I)", linestyle="--"
        )
    expected, true = expected_and_true(evaluation)
    if len(expected):
        name = "mean of each tenth of the points"
        ReliabilityDisplay.from_predictions(
            expected, true, ax=right, n_bins=min(10, len(true)), name=name
        )
    else:
        right.set_axis_off()
    assessed = all(match.expected_error is not None for match in evaluation.matches)
    header = ["shape left out", *(_KINDS[kind] for kind in kinds), *(_ASSESSED if assessed else [])]
    rows = [
        [
            match.name or "",
            *(_percent(errors.mean(kind)) for kind in kinds),
            *_expected_cells(match, errors),
        ]
        for match, errors in zip(evaluation.matches, evaluation.errors, strict=True)
    ]
    worst_first = np.argsort([-errors.mean() for errors in evaluation.errors], kind="stable")
    return section(
        "Errors on shapes left out",
        paragraph(
            "Mean geodesic errors, in percent of sqrt(area) of the reference. Expected errors were "
            "predicted by the model without the true correspondences. The last column is the true "
            "error of the half of the points with the lowest expected errors."
        ),
        table(header, [rows[i] for i in worst_first]),
        picture(
            figure,
            "Left: percentage of points below an error. Right: true against expected errors.",
        ),
    )


def _expected_cells(match: Match, errors: PairErrors) -> list[str]:
    if match.expected_error is None:
        return []
    expected = match.expected_error[errors.vertices]
    return [_percent(float(expected.mean())), _percent(_trusted_half(expected, errors))]


def _trusted_half(expected: FloatArray, errors: PairErrors) -> float:
    trusted = trusted_part(expected)
    if not errors.weights[trusted].any():
        return float("nan")
    return float(np.average(errors.direct[trusted], weights=errors.weights[trusted]))


def _worst(
    learner: WeightedFunctionalMapLearner,
    evaluation: Evaluation,
    n_worst: int,
    camera: Camera | None,
) -> str:
    order = np.argsort([-errors.mean() for errors in evaluation.errors], kind="stable")[:n_worst]
    if not len(order):
        return ""
    assessed = all(evaluation.matches[i].expected_error is not None for i in order)
    figure = plot_matches(
        [evaluation.matches[i] for i in order],
        [evaluation.meshes[i] for i in order],
        learner.reference_.spectral.mesh,
        errors=[evaluation.errors[i] for i in order],
        show=("match", *(["expected error"] if assessed else []), "true error"),
        captions=[f"error {_percent(evaluation.errors[i].mean())} %" for i in order],
        camera=camera,
    )
    return section(
        "Worst matches",
        paragraph(
            "Each point has the colour of its matched point on the reference. The rows below show "
            "the expected error and the true error, in grey where no correspondence is known."
        ),
        picture(
            figure,
            "The worst matches: colours of the reference, expected errors, true errors.",
        ),
    )


def _stable_functions(
    learner: WeightedFunctionalMapLearner, camera: Camera | None, n_shown: int = 4
) -> str:
    """Return pictures of the most and least stable functions, and of where maps are inaccurate."""
    reference, k = learner.reference_.spectral, len(learner.stable_basis_)
    shown = [*range(1, min(1 + n_shown, k)), k - 1]
    functions = (reference.evecs[:, :k] @ learner.stable_basis_[:, shown]).T
    captions = [f"number {j + 1}: {learner.stability_[j]:.2f}" for j in shown]
    # Functions with root mean square 1 on a shape of unit area rarely exceed these limits.
    limits = (-4.0, 4.0)
    meshes, rows = [reference.mesh] * len(shown), list(functions)
    first = plot_functions(meshes, rows, captions=captions, limits=limits, camera=camera)
    missed = missed_by_maps(
        reference.evecs[:, :k],
        learner.stable_basis_,
        learner.stability_,
        learner.record_.total_share,
    )
    where = plot_functions(
        [reference.mesh], [missed], labels=["error of the maps"], cmap="magma_r", camera=camera
    )
    return section(
        "Stable functions",
        paragraph(
            "Functions on the reference, the most stable first, and the least stable last. The "
            "constant function, number 1, is always the most stable and is not shown. The number "
            "beside each function is its singular value over the training shapes; a function with "
            "value 0 is mapped perfectly."
        ),
        picture(first, "Stable functions on the reference."),
        picture(where, "Error of the learned maps on each part of the reference."),
    )


def _weights(learner: WeightedFunctionalMapLearner, n_shown: int = 10) -> str:
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure = plt.figure(figsize=(10, 3.6), layout="constrained")
    WeightsDisplay.from_estimator(learner, ax=figure.add_subplot())
    order = np.argsort(-learner.weights_, kind="stable")
    rows = [
        [learner.probe_names_[j], learner.probe_categories_[j], f"{learner.weights_[j]:.3g}"]
        for j in order
    ]
    return section(
        "Weights of the probe functions",
        picture(figure, "Weights by category."),
        paragraph(
            "The probe functions determine the map together: a small weight does not mean that a "
            "probe carries no information."
        ),
        table(["probe", "category", "weight"], rows[:n_shown]),
        details("All weights", table(["probe", "category", "weight"], rows))
        if len(rows) > n_shown
        else "",
    )


def _collection(learner: WeightedFunctionalMapLearner, evaluation: Evaluation | None) -> str:
    """Return a table of the reference and the evaluated shapes."""
    reference = learner.reference_.spectral.mesh
    rows = [
        [
            f"{reference.name or ''} (reference)",
            reference.n_vertices,
            reference.n_faces,
            f"{reference.area:.4g}",
            len(np.unique(learner.reference_correspondence_.pairs[:, 1])),
        ]
    ]
    if evaluation is not None:
        rows += [
            [
                mesh.name or "",
                mesh.n_vertices,
                mesh.n_faces,
                f"{mesh.area:.4g}",
                len(errors.vertices),
            ]
            for mesh, errors in zip(evaluation.meshes, evaluation.errors, strict=True)
        ]
    return section(
        "Collection", table(["shape", "vertices", "faces", "area", "known points"], rows)
    )


def _settings(
    learner: WeightedFunctionalMapLearner, bridge: WeightedFunctionalMapLearner | None
) -> str:
    parameters = [
        [name, repr(value)] for name, value in sorted(learner.get_params(deep=False).items())
    ]
    found: list[list[object]] = [
        ["epsilon", f"{learner.epsilon_:.4g}"],
        ["initial loss, final loss", f"{learner.loss_curve_[0]:.4g}, {learner.loss_:.4g}"],
        ["iterations", learner.n_iter_],
        ["bridge", "none" if bridge is None else bridge.reference_.name],
        [
            "scikit-learn, numpy, Python",
            f"{sklearn.__version__}, {np.__version__}, {platform.python_version()}",
        ],
    ]
    return section(
        "How the model was fitted",
        table(["result", "value"], found),
        details("Parameters of the learner", table(["parameter", "value"], parameters)),
    )


def _percent(error: float) -> str:
    return f"{100 * error:.1f}" if np.isfinite(error) else "unknown"
