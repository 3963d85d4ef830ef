"""The demonstration: learn on a collection, leave shapes out, and show the gain from learning."""

import argparse
import shlex
import tempfile
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.pipeline import make_pipeline
from sklearn.utils import Bunch

from skfmap._tools.types import WeightingWord
from skfmap._tools.validation import check_number
from skfmap.basis import SpectralBasis
from skfmap.commands.inputs import add_by_number, write_model
from skfmap.datasets import load_collection, make_creatures
from skfmap.descriptors import DescriptorTransformer
from skfmap.exceptions import (
    CorrespondenceError,
    CoverageWarning,
    DisagreementWarning,
    MeshError,
    OrientationWarning,
)
from skfmap.functional.weighting import WEIGHTINGS
from skfmap.learner import WeightedFunctionalMapLearner
from skfmap.learner.given_answers import drawn_on_working_meshes, errors_on_working_mesh
from skfmap.metrics import ERROR_KINDS, PairErrors, reference_distances
from skfmap.plotting import Camera, plot_matches
from skfmap.report import Evaluation, thin_out, write_report
from skfmap.shapes import Correspondence, Match, Mesh, ProbedShape, SkippedShape

# Ways of matching points: in all functions alike, in the p most stable ones, in all weighted by
# stability, and with refinement of the latter.
_MATCHINGS: dict[str, dict[str, Any]] = {
    "full": {"matching": "cut", "n_stable": 1.0, "refine": None},
    "reduced": {"matching": "cut", "n_stable": "fitted", "refine": None},
    "soft": {"matching": "soft", "refine": None},
    "refined": {},
}


# The weighting that the report and the pictures show.
_SHOWN: WeightingWord = "function"

_GO_ON = " (--on-invalid skip goes on without what cannot be used, but for the reference.)"

_KINDS_EXPLAINED = (
    "full: all functions alike; reduced: the more stable half; soft: all, weighted by stability;\n"
    "refined: from soft on, in all functions that there are\n"
    "direct: nothing forgiven; consistent: the better side, once for the map; per vertex: the "
    "better side at each\n"
)


@dataclass(frozen=True)
class _Result:
    """Errors of each shape left out, by matching; seconds of training per fold; matches to show."""

    errors: dict[str, list[PairErrors]]
    seconds: list[float]
    matches: list[Match]


HELP = "show the gain from learning on generated creatures or a folder (also without a verb)"
DESCRIPTION = (
    "Learn functional maps on a collection of meshes, match shapes that were left out, and show "
    "the gain from learning: a table, a report, a picture of the matches, and a model trained on "
    "all shapes."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the demonstration."""
    parser.add_argument(
        "folder", nargs="?", help="meshes and correspondences (default: generated creatures)"
    )
    parser.add_argument(
        "--pattern", default="*", help="pattern of names of meshes in the folder (default: all)"
    )
    parser.add_argument(
        "--reference", help="name of the reference (default: the first in natural order)"
    )
    add_by_number(parser)
    parser.add_argument(
        "--folds",
        type=int,
        default=3,
        help="number of shapes to leave out, one at a time (default: 3)",
    )
    parser.add_argument(
        "--functions", type=int, default=50, help="number of eigenfunctions to match (default: 50)"
    )
    parser.add_argument(
        "--families",
        choices=["default", "paper", "paper-310"],
        default="default",
        help="probe functions: the paper's 50 or 310, or 50 and 55 that distinguish left from "
        "right (default)",
    )
    parser.add_argument(
        "--vertices", type=int, default=1500, help="vertices of a creature (default: 1500)"
    )
    parser.add_argument(
        "--up",
        choices=["x", "y", "z"],
        default="z",
        help="axis that points up in the picture (default: z)",
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("skfmap-output"),
        help="folder for the report, the picture and the model (default: skfmap-output)",
    )
    parser.add_argument(
        "--on-invalid",
        choices=["mend", "raise", "skip"],
        default="mend",
        help="what to do with broken meshes: mend them, and stop if one cannot be mended (mend, "
        "the default); stop (raise); or mend them, and leave out the others (skip)",
    )
    parser.add_argument(
        "--max-vertices",
        type=int,
        default=SpectralBasis().max_vertices,
        help="thin larger meshes to this many vertices for the computation; results are on the "
        "given meshes (default: %(default)s)",
    )
    parser.add_argument(
        "--cache", type=Path, help="folder that keeps bases and probes between runs"
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=-1,
        help="number of shapes to process in parallel (default: one per core)",
    )


def run(options: argparse.Namespace) -> int:
    """Run the demonstration; return the exit status."""
    try:
        _run(options)
    except (MeshError, CorrespondenceError) as error:
        if options.on_invalid == "skip":
            raise
        raise ValueError(f"{error}{_GO_ON}") from error
    return 0


def _run(options: argparse.Namespace) -> None:
    check_number(options.functions, "--functions", low=2, integer=True)
    check_number(options.folds, "--folds", low=1, integer=True)
    _make_output(options.output)
    collection = _collection(options)
    collection, shapes = _usable(collection, _probed(collection, options))
    left_out = _choose_folds(len(shapes), options.folds)
    scored = thin_out(collection.correspondences)
    _measure(shapes[0], scored[0], options)
    names = ", ".join(collection.names[i] for i in left_out)
    print(f"Leaving out one at a time: {names}. Reference: {collection.names[0]}.", flush=True)
    results: dict[WeightingWord | None, _Result] = {}
    with tempfile.TemporaryDirectory() as scratch:
        # Fits share known maps and distances.
        memory = options.cache or Path(scratch)
        for weighting in WEIGHTINGS:
            results[weighting] = _cross_validate(
                shapes, collection.correspondences, scored, left_out, weighting, options, memory
            )
            print(
                f"  weighting={weighting!r}: {np.mean(results[weighting].seconds):.1f} s of "
                "training per fold",
                flush=True,
            )
        text = f"{_table(results)}\n{_summary(results)}"
        (options.output / "errors.txt").write_text(f"{text}\n", encoding="utf-8")
        print(f"\n{text}")
        _save(collection, shapes, left_out, results, options, memory)


def _collection(options: argparse.Namespace) -> Bunch:
    started = time.perf_counter()
    if options.folder is None:
        print("Making 11 creatures, each posed and meshed on its own ...", flush=True)
        collection = make_creatures(n_shapes=11, n_vertices=options.vertices)
    else:
        print(f"Reading {options.folder} ...", flush=True)
        collection = load_collection(
            options.folder,
            options.pattern,
            options.reference,
            on_invalid=options.on_invalid,
            by_number=options.by_number,
        )
    counts = [mesh.n_vertices for mesh in collection.meshes if isinstance(mesh, Mesh)]
    print(
        f"  {len(counts)} meshes of {min(counts)} to {max(counts)} vertices, {_since(started)}",
        flush=True,
    )
    if options.folder is not None:
        print(f"  {collection.DESCR}", flush=True)
    if len(counts) < 3:
        raise ValueError(
            f"the main job needs a reference and at least two more shapes; got {len(counts)} "
            "meshes."
        )
    return collection


def _probed(collection: Bunch, options: argparse.Namespace) -> list[ProbedShape]:
    started = time.perf_counter()
    print("Eigenfunctions and probe functions ...", flush=True)
    basis, probes = _transformers(options)
    smallest = min(mesh.n_vertices for mesh in collection.meshes if isinstance(mesh, Mesh))
    smallest = min(smallest, options.max_vertices)
    basis.set_params(n_components=min(basis.n_components, max(options.functions, smallest - 1)))
    shapes = probes.fit_transform(basis.fit_transform(collection.meshes))
    if isinstance(shapes[0], SkippedShape):
        raise MeshError(f"The reference, {collection.names[0]}, cannot be used: {shapes[0].reason}")
    print(f"  {shapes[0].probes.shape[1]} probe functions per shape, {_since(started)}", flush=True)
    return list(shapes)


def _usable(
    collection: Bunch, shapes: Sequence[ProbedShape | SkippedShape]
) -> tuple[Bunch, list[ProbedShape]]:
    """Return the collection and the shapes without skipped ones."""
    kept = {i: shape for i, shape in enumerate(shapes) if not isinstance(shape, SkippedShape)}
    if len(kept) < len(shapes):
        names = [name for i, name in enumerate(collection.names) if i not in kept]
        print(f"  left out: {', '.join(names)}", flush=True)
    if len(kept) < 3:
        raise ValueError(
            f"the main job needs a reference and at least two more shapes; {len(kept)} can be used."
        )
    parts = {key: [collection[key][i] for i in kept] for key in ("correspondences", "names")}
    return Bunch(**parts), list(kept.values())


def _make_output(folder: Path) -> None:
    """Create the folder for the results before anything is computed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"--output {folder} cannot hold the results: {error.strerror}.") from error


def _measure(reference: ProbedShape, truth: Correspondence, options: argparse.Namespace) -> None:
    """Compute the geodesic distances on the reference that all scores need."""
    started, spectral = time.perf_counter(), reference.spectral
    both = [truth.pairs] if truth.symmetric_pairs is None else [truth.pairs, truth.symmetric_pairs]
    sources = np.unique(spectral.places_of(np.unique(np.concatenate(both)[:, 0]))[0])
    print(f"Geodesic distances from {len(sources)} vertices of {reference.name} ...", flush=True)
    reference_distances(spectral.mesh, memory=options.cache, n_jobs=options.jobs).rows(sources)
    print(f"  {_since(started)}", flush=True)


def _transformers(options: argparse.Namespace) -> tuple[SpectralBasis, DescriptorTransformer]:
    families = None if options.families == "default" else options.families
    return (
        SpectralBasis(
            max(120, options.functions),
            max_vertices=options.max_vertices,
            on_invalid=options.on_invalid,
            memory=options.cache,
            n_jobs=options.jobs,
        ),
        DescriptorTransformer(
            families,
            on_invalid="skip" if options.on_invalid == "skip" else "raise",
            memory=options.cache,
            n_jobs=options.jobs,
        ),
    )


def _choose_folds(n_shapes: int, n_folds: int) -> list[int]:
    """Return indices of shapes to leave out, spread over the collection, without the reference."""
    return [
        int(i) for i in np.unique(np.linspace(n_shapes - 1, 1, min(n_folds, n_shapes - 1)).round())
    ]


def _cross_validate(
    shapes: list[ProbedShape],
    truths: list[Correspondence],
    scored: list[Correspondence],
    left_out: list[int],
    weighting: WeightingWord | None,
    options: argparse.Namespace,
    memory: Path,
) -> _Result:
    result = _Result({name: [] for name in _MATCHINGS}, [], [])
    for i in left_out:
        rest = [j for j in range(len(shapes)) if j != i]
        training = [shapes[j] for j in rest], [truths[j] for j in rest]
        learner = WeightedFunctionalMapLearner(
            n_functions=options.functions,
            weighting=weighting,
            confidence=None,  # not needed for scores
            memory=memory,
            n_jobs=options.jobs,
        )
        with warnings.catch_warnings():
            for what in (CoverageWarning, DisagreementWarning, OrientationWarning):
                warnings.simplefilter("ignore", what)  # given once, by the fit on all shapes
            started = time.perf_counter()
            learner.fit(*training)
            result.seconds.append(time.perf_counter() - started)
            for name, how in _MATCHINGS.items():
                (errors,) = learner.pair_errors(
                    [shapes[i]], [scored[i]], reference_y=scored[0], **how
                )
                result.errors[name].append(errors_on_working_mesh(errors, shapes[i].spectral))
            if weighting == _SHOWN:
                learner.set_params(confidence="cross-fit").fit(*training)
                (match,) = learner.match([shapes[i]])
                result.matches.append(
                    drawn_on_working_meshes(match, shapes[i].spectral, shapes[0].spectral)
                )
    return result


def _table(results: dict[WeightingWord | None, _Result]) -> str:
    """Return a table of errors by weighting (rows) and way of matching (columns)."""
    symmetric = all(
        e.symmetric is not None for result in results.values() for e in result.errors["full"]
    )
    kinds = ERROR_KINDS if symmetric else ERROR_KINDS[:1]
    groups = "".join(f" |{name:^{11 * len(kinds)}}" for name in _MATCHINGS)
    columns = "".join(
        " |" + "".join(f"{kind.replace('_', ' '):>11}" for kind in kinds) for _ in _MATCHINGS
    )
    lines = [
        "Mean geodesic error over the shapes left out, x 100 / sqrt(area of the reference)",
        *([_KINDS_EXPLAINED] if symmetric else []),
        f"{'':<13}{'training':>9}{groups}",
        f"{'weighting':<13}{'seconds':>9}{columns}",
    ]
    for weighting, result in results.items():
        cells = "".join(
            " |"
            + "".join(f"{100 * np.mean([e.mean(kind) for e in errors]):>11.2f}" for kind in kinds)
            for errors in result.errors.values()
        )
        lines.append(f"{weighting or 'none (D = I)':<13}{np.mean(result.seconds):>9.1f}{cells}")
    return "\n".join(lines)


def _summary(results: dict[WeightingWord | None, _Result]) -> str:
    """Return one line on the change of the errors by learning."""
    changes = []
    for name in _MATCHINGS:
        naive, learned = (
            np.mean([e.mean() for e in results[w].errors[name]]) for w in (None, "function")
        )
        changes.append(f"{name} {100 * naive:.1f} -> {100 * learned:.1f}")
    return (
        "Learning one weight per function changes the direct error from naive to learned: "
        + ", ".join(changes)
    )


def _save(
    collection: Bunch,
    shapes: list[ProbedShape],
    left_out: list[int],
    results: dict[WeightingWord | None, _Result],
    options: argparse.Namespace,
    memory: Path,
) -> None:
    picture, report = (options.output / name for name in ("matches.png", "report.html"))
    model = options.output / f"model{'.skops' if find_spec('skops') else '.joblib'}"
    result, camera = results[_SHOWN], Camera(options.up)
    captions = [
        f"error {100 * errors.mean('direct'):.1f} % of sqrt(area)"
        for errors in result.errors["refined"]
    ]
    meshes = [shapes[i].spectral.mesh for i in left_out]
    plot_matches(
        result.matches,
        meshes,
        shapes[0].spectral.mesh,
        path=picture,
        camera=camera,
        captions=captions,
    )
    learner = WeightedFunctionalMapLearner(
        n_functions=options.functions, memory=memory, n_jobs=options.jobs
    ).fit(shapes, collection.correspondences)
    evaluation = Evaluation(
        meshes, result.matches, result.errors["refined"], results[None].errors["refined"]
    )
    write_report(learner, report, evaluation=evaluation, camera=camera)
    basis, probes, learner = (
        step.set_params(memory=None, n_jobs=None) for step in (*_transformers(options), learner)
    )
    basis.set_params(n_components=shapes[0].spectral.n_components)
    write_model(make_pipeline(basis, probes, learner), model)
    print(f"\nReport, to open in a browser: {report}")
    print(f"Picture of the matches (weighting {_SHOWN!r}, refined): {picture}")
    print(f"Model trained on all {len(shapes)} shapes: {model}. To match a new shape with it:")
    print(f"    {options.program} match {shlex.quote(str(model))} NEW.ply -o out")


def _since(started: float) -> str:
    return f"{time.perf_counter() - started:.1f} s"
