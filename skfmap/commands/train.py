"""``train``: train a model on a folder of meshes, and measure its errors on shapes left out."""

import argparse
import copy
import shlex
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.utils import Bunch

from skfmap._tools.parallel import tell
from skfmap._tools.types import RaiseOrSkip
from skfmap._tools.validation import check_number
from skfmap.basis import ON_INVALID, SpectralBasis
from skfmap.commands.inputs import (
    add_by_number,
    check_model_path,
    check_two_usable,
    write_model,
)
from skfmap.commands.match import mean_error
from skfmap.commands.outputs import add_output, add_quiet, check_free, show_table, write_table
from skfmap.datasets import Collection, load_collection
from skfmap.descriptors import DescriptorTransformer
from skfmap.exceptions import (
    CoverageWarning,
    DisagreementWarning,
    MeshError,
    OrientationWarning,
    SkippedShapeWarning,
)
from skfmap.learner import WeightedFunctionalMapLearner
from skfmap.shapes import Mesh, SkippedShape

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "train a model on a folder of meshes"
DESCRIPTION = (
    "Train a model on a folder of meshes with landmarks or other correspondences beside them, "
    "write it, and report its errors on shapes left out: of landmarks in the units of the meshes, "
    "of other matches in percent. A page beside the model shows the worst shapes."
)
# Number of folds for shapes without landmarks.
_FOLDS = 10
_REFINEMENTS = ("auto", "register", "bijective-zoomout", "zoomout", "icp", "none")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    learner = WeightedFunctionalMapLearner()
    parser.add_argument("folder", type=Path, help="meshes and the files that belong to them")
    add_output(parser, "model.skops", "the model; .joblib for joblib's format")
    parser.add_argument(
        "--pattern", default="*", help="pattern of names of meshes in the folder (default: all)"
    )
    parser.add_argument(
        "--reference", help="name of the reference (default: the first in natural order)"
    )
    add_by_number(parser)
    parser.add_argument(
        "--functions",
        type=int,
        help=f"number of eigenfunctions to match (default: {learner.n_functions}, fewer for small "
        "meshes)",
    )
    parser.add_argument(
        "--refine",
        choices=_REFINEMENTS,
        default="auto",
        help="refinement of matches; auto is register if there are landmarks, otherwise "
        "bijective-zoomout (default: auto)",
    )
    parser.add_argument(
        "--laplacian",
        choices=["cotangent", "robust"],
        default="cotangent",
        help="use robust for meshes with bad triangles (default: cotangent)",
    )
    parser.add_argument(
        "--mirrored",
        choices=["warn", "reflect"],
        default="warn",
        help="what to do with mirrored specimens, such as right bones among left ones: warn "
        "(default), or reflect them",
    )
    parser.add_argument(
        "--on-invalid",
        choices=ON_INVALID,
        default="skip",
        help="what to do with broken meshes: mend them, and leave out those that cannot be mended "
        "(skip, the default); mend them, and stop if one cannot be mended (mend); or stop (raise)",
    )
    parser.add_argument(
        "--max-vertices",
        type=int,
        default=SpectralBasis().max_vertices,
        help="thin larger meshes to this many vertices for the computation (default: %(default)s)",
    )
    parser.add_argument(
        "--folds",
        type=int,
        help="number of folds of the evaluation, each of which is trained again (default: for "
        "landmarks, reuse predictions made in training; otherwise 10, or one per shape if there "
        "are fewer)",
    )
    parser.add_argument(
        "--no-evaluation", action="store_true", help="train only, without an evaluation"
    )
    parser.add_argument("--memory", type=Path, help="folder that keeps results between runs")
    parser.add_argument(
        "--jobs",
        type=int,
        default=-1,
        help="number of shapes to process in parallel (default: one per core)",
    )
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    """Train and evaluate a model; return the exit status."""
    if options.folds is not None:
        check_number(options.folds, "--folds", low=2, integer=True)
    page, errors = options.output.with_suffix(".html"), _errors_path(options.output)
    check_model_path(options.output)
    evaluated = () if options.no_evaluation else (page, errors)
    check_free([options.output, *evaluated], force=options.force)
    _tell(options, f"reading {options.folder}")
    collection = _collection(options)
    _tell(options, collection.DESCR)
    steps = _steps(collection, options)
    shapes = _probed(steps, collection)
    learner = steps[-1].fit(shapes, collection.correspondences)
    write_model(_to_save(steps), options.output)
    lines = []
    if not options.no_evaluation:
        lines = _evaluated(learner, shapes, collection, options)
    left_out = [one for one in shapes if isinstance(one, SkippedShape)]
    for line in lines:
        print(line)
    for one in left_out:
        print(f"Left out: {one.name}: {one.reason}")
    n_used = len(shapes) - len(left_out)
    print(f"Model trained on {n_used} of {len(shapes)} shapes: {options.output}. To use it:")
    for verb in _next_verbs(collection, options):
        print(f"    {options.program} {verb} {shlex.quote(str(options.output))} NEW.ply -o out")
    return 1 if left_out else 0


def _collection(options: argparse.Namespace) -> Collection:
    """Read the folder; raise a one-line error if there is nothing to learn from."""
    with warnings.catch_warnings(record=True) as told:
        collection = load_collection(
            options.folder,
            options.pattern,
            options.reference,
            on_invalid=options.on_invalid,
            by_number=options.by_number,
        )
    try:
        check_two_usable(collection.meshes)
    except ValueError as error:
        raise ValueError(f"{options.folder} cannot be trained on: {error}") from None
    for one in told:
        warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return collection


def _next_verbs(collection: Bunch, options: argparse.Namespace) -> list[str]:
    """Return the verbs to suggest for the model: what it was trained for, or matching."""
    for_landmarks = ["landmarks"] if _has_landmarks(collection) else []
    to_register = ["register"] if options.refine == "register" else []
    return [*for_landmarks, *to_register] or ["match"]


def _has_landmarks(collection: Bunch) -> bool:
    return any(marks is not None for marks in collection.landmarks)


def _steps(collection: Bunch, options: argparse.Namespace) -> tuple[Any, Any, Any]:
    """Return the unfitted basis, probes and learner."""
    n_functions, n_components = _sizes(collection, options)
    shared = {"memory": options.memory, "n_jobs": options.jobs}
    skips: RaiseOrSkip = "skip" if options.on_invalid == "skip" else "raise"
    basis = SpectralBasis(
        n_components,
        laplacian=options.laplacian,
        max_vertices=options.max_vertices,
        on_invalid=options.on_invalid,
        **shared,
    )
    probes = DescriptorTransformer(on_invalid=skips, **shared)
    learner = WeightedFunctionalMapLearner(
        n_functions=n_functions,
        on_invalid=skips,
        on_mirrored=options.mirrored,
        verbose=_verbosity(options),
        **shared,
    )
    return basis, probes, learner.set_params(**_refinement(collection, options))


def _sizes(collection: Bunch, options: argparse.Namespace) -> tuple[int, int]:
    """Return the numbers of functions to match and to compute; fewer for small meshes."""
    sizes = [mesh.n_vertices for mesh in collection.meshes if isinstance(mesh, Mesh)]
    most = min(sizes[0], options.max_vertices) - 1
    if options.functions is not None:
        check_number(options.functions, "--functions", low=2, high=most, integer=True)
    wanted = options.functions or WeightedFunctionalMapLearner().n_functions
    n_functions = min(wanted, most)
    usual = max(SpectralBasis().n_components, n_functions)
    # A mesh that is too small for n_functions is left out, and must not limit the others.
    return n_functions, max(n_functions, min(usual, min(sizes) - 1, most))


def _refinement(collection: Bunch, options: argparse.Namespace) -> dict[str, str | None]:
    if options.refine == "auto":
        return {"refine": "register"} if _has_landmarks(collection) else {}
    return {"refine": None if options.refine == "none" else options.refine}


def _probed(steps: tuple[Any, Any, Any], collection: Bunch) -> list[Any]:
    """Return the probed shapes."""
    basis, probes, _ = steps
    shapes = list(probes.transform(basis.transform(collection.meshes)))
    if isinstance(shapes[0], SkippedShape):
        raise MeshError(
            f"The reference, {collection.names[0]}, cannot be used: {shapes[0].reason} Choose "
            "another by --reference."
        )
    return shapes


def _to_save(steps: tuple[Any, Any, Any]) -> Pipeline:
    """Return the fitted model without settings of this machine."""
    learner = copy.copy(steps[-1])
    return make_pipeline(
        *(
            step.set_params(memory=None, n_jobs=None, verbose=0)
            for step in (clone(steps[0]), clone(steps[1]), learner)
        )
    )


def _evaluated(
    learner: Any, shapes: list[Any], collection: Bunch, options: argparse.Namespace
) -> list[str]:
    """Evaluate the model, write a page and a table beside it, and return lines to print."""
    n_used = sum(not isinstance(shape, SkippedShape) for shape in shapes)
    if n_used < 3:
        return [f"Nothing was left out: that takes three shapes, and {n_used} can be used."]
    with warnings.catch_warnings():
        for told in (CoverageWarning, DisagreementWarning, OrientationWarning, SkippedShapeWarning):
            warnings.simplefilter("ignore", told)  # given once, by the fit on all shapes
        of = _landmarks if _has_landmarks(collection) else _matches
        return of(learner, shapes, collection, options)


def _matches(
    learner: Any, shapes: list[Any], collection: Bunch, options: argparse.Namespace
) -> list[str]:
    from skfmap.report import evaluate, write_report  # noqa: PLC0415

    found = evaluate(
        learner,
        shapes,
        collection.correspondences,
        cv=options.folds or _FOLDS,
        naive=False,
        verbose=_verbosity(options),
    )
    page = write_report(learner, options.output.with_suffix(".html"), evaluation=found)
    rows = [
        (match.name, 100 * errors.mean(), 100 * (mean_error(match) or np.nan))
        for match, errors in zip(found.matches, found.errors, strict=True)
    ]
    rows.sort(key=lambda row: -row[1])
    header = ("shape left out", "error", "expected")
    write_table(_errors_path(options.output), header, rows)
    mean = float(np.mean([row[1] for row in rows]))
    return [
        "Mean geodesic errors in percent of sqrt(area) of the reference, the worst first:",
        show_table(header, rows),
        f"All: {mean:.3g}. Page, to open in a browser: {page}",
    ]


def _landmarks(
    learner: Any, shapes: list[Any], collection: Bunch, options: argparse.Namespace
) -> list[str]:
    from skfmap.report import evaluate_landmarks, landmark_table, write_landmarks_page  # noqa: PLC0415

    found = evaluate_landmarks(
        learner,
        shapes,
        collection.correspondences,
        collection.landmarks,
        cv=options.folds,
        verbose=_verbosity(options),
    )
    page = write_landmarks_page(found, options.output.with_suffix(".html"))
    rows = [
        (marks.name, name, *values)
        for marks, *columns in zip(
            found.true, found.errors, found.expected, found.radius, strict=True
        )
        for name, *values in zip(found.names, *columns, strict=True)
    ]
    header = ("specimen", "landmark", "error", "expected_error", "radius")
    write_table(_errors_path(options.output), header, rows)
    return [
        "Landmarks of specimens left out: distances from those placed by hand, in the units of the "
        "meshes:",
        show_table(*landmark_table(found)),
        f"All: {np.nanmean(found.errors):.3g}. Page, to open in a browser: {page}",
    ]


def _errors_path(model: Path) -> Path:
    """Return the path of the table of errors, beside the model."""
    return model.with_name(f"{model.stem}-errors.csv")


def _verbosity(options: argparse.Namespace) -> int:
    return 0 if options.quiet else 1


def _tell(options: argparse.Namespace, message: str) -> None:
    if not options.quiet:
        tell(message)
