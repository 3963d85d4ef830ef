"""Processing of new shapes, shared by match, landmarks, register and transfer."""

import argparse
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from joblib import effective_n_jobs

from skfmap._tools.parallel import tell
from skfmap._tools.unwrap import last_step, learner_and_shapes
from skfmap.commands.inputs import add_new_shapes, mesh_files, read_model
from skfmap.commands.outputs import (
    SUMMARY_ENDS,
    add_output,
    add_quiet,
    check_free,
    is_summary,
    show_table,
    targets_of,
    write_table,
)
from skfmap.exceptions import SkippedShapeWarning, UnfamiliarShapeWarning
from skfmap.shapes import SkippedShape

__all__ = ["Result", "Work", "add_common", "run_on_new_shapes"]

_SUMMARY = "summary.csv"


class Result(NamedTuple):
    """Row of a shape in the summary: its cells, and the doubt by which rows are sorted.

    ``told`` is a message printed below the table.
    """

    cells: tuple[object, ...]
    doubt: tuple[float, ...]
    told: str = ""


class Work(NamedTuple):
    """The work of a verb.

    ``suffix`` is the suffix of the files; ``columns`` are the columns of the summary between name
    and note; ``answer(learner, shapes)`` applies the model; ``write(answer, path)`` writes the file
    of one shape; ``units`` is a sentence that explains the numbers in the summary; ``finish()``
    writes files about all shapes.
    """

    suffix: str
    columns: tuple[str, ...]
    answer: Callable[[Any, Sequence[Any]], Sequence[Any]]
    write: Callable[[Any, Path], Result]
    units: str
    finish: Callable[[], None] | None = None


class _Row(NamedTuple):
    name: str
    cells: tuple[object, ...]
    doubt: tuple[float, ...]
    told: str = ""
    note: str = ""  # reason if there is no answer


def add_common(parser: argparse.ArgumentParser, default: str, what: str) -> None:
    """Add the arguments for a model, new meshes, and results."""
    add_new_shapes(parser)
    add_output(parser, default, what)
    parser.add_argument(
        "--jobs",
        type=int,
        default=-1,
        help="number of shapes to process in parallel (default: one per core)",
    )
    add_quiet(parser)


def run_on_new_shapes(
    options: argparse.Namespace,
    work: Callable[[Any], Work],
    suffix: str,
    also: Sequence[Path] = (),
) -> int:
    """Do the work on each shape, print the summary, and return the exit status.

    ``work(learner)`` checks the remaining options against the model; ``also`` are additional files
    that will be written.
    """
    paths = mesh_files(options.meshes)
    targets = targets_of(paths, options.output, suffix)
    summary = options.output / _SUMMARY
    # The summary of an earlier run, for instance in another format, may be replaced.
    kept = [] if is_summary(summary) else [summary]
    check_free([*targets.values(), *also, *kept], force=options.force)
    model = read_model(options.model)
    doing = work(last_step(model))
    rows = [
        _written(answer, path, targets[path], doing)
        for path, answer in _answers(model, paths, doing, options)
    ]
    if doing.finish is not None and not all(row.note for row in rows):
        doing.finish()
    rows.sort(key=lambda row: (not row.note, *(-doubt for doubt in row.doubt)))
    header = (SUMMARY_ENDS[0], *doing.columns)
    write_table(
        summary,
        (*header, SUMMARY_ENDS[1]),
        [(row.name, *row.cells, row.note or row.told) for row in rows],
    )
    failed = [row for row in rows if row.note]
    print(show_table(header, [(row.name, *row.cells) for row in rows]))
    print(f"{doing.units} The most doubtful come first.")
    for row in rows:
        if row.told:
            print(f"Doubtful: {row.name}: {row.told}")
    for row in failed:
        print(f"Not used: {row.name}: {row.note}")
    print(f"Written to {options.output}: {len(rows) - len(failed)} of {len(rows)}, and {summary}.")
    return 1 if failed else 0


def _answers(
    model: Any, paths: Sequence[Path], work: Work, options: argparse.Namespace
) -> Iterator[tuple[Path, Any]]:
    """Yield each file with the answer of the model, or with a skipped shape."""
    _set(model, "n_jobs", options.jobs)
    _set(model, "on_invalid", "skip")
    n_paths, n_jobs = len(paths), effective_n_jobs(options.jobs)
    for first in range(0, n_paths, n_jobs):
        batch = paths[first : first + n_jobs]
        with warnings.catch_warnings():
            for told in (SkippedShapeWarning, UnfamiliarShapeWarning):  # reported by the summary
                warnings.simplefilter("ignore", told)
            learner, shapes = learner_and_shapes(model, [str(path) for path in batch])
            usable = [shape for shape in shapes if not isinstance(shape, SkippedShape)]
            answers = iter(_asked(work, learner, usable) if usable else ())
        for i, (path, shape) in enumerate(zip(batch, shapes, strict=True), start=first + 1):
            if not options.quiet:
                tell(f"[{i} of {n_paths}] {path.name}")
            yield path, shape if isinstance(shape, SkippedShape) else next(answers)


def _asked(work: Work, learner: Any, shapes: Sequence[Any]) -> list[Any]:
    """Return the answers, with a skipped shape for each shape without one."""
    try:
        return list(work.answer(learner, shapes))
    except (ValueError, RuntimeError) as error:
        if len(shapes) == 1:
            return [SkippedShape(shapes[0].name, str(error))]
        return [answer for shape in shapes for answer in _asked(work, learner, [shape])]


def _written(answer: Any, path: Path, target: Path, work: Work) -> _Row:
    """Write the answer for a shape, and return its row of the summary."""
    note = answer.reason if isinstance(answer, SkippedShape) else ""
    if not note:
        try:
            return _Row(path.stem, *work.write(answer, target))
        except ValueError as error:
            note = str(error)
    blank = (None,) * len(work.columns)
    return _Row(path.stem, blank, (), note=" ".join(note.split()))


def _set(model: Any, parameter: str, value: object) -> None:
    """Set a parameter of every step that has it."""
    names = [name for name in model.get_params() if name.split("__")[-1] == parameter]
    model.set_params(**dict.fromkeys(names, value))
