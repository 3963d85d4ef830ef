"""The figures of the pages on concepts and architecture, drawn when the pages are built."""

import ast
import tomllib
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import FancyBboxPatch

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import make_creatures
from skfmap.plotting import BasisErrorDisplay, ReliabilityDisplay, SingularValuesDisplay, plot_functions, plot_matches

ROOT = Path(__file__).resolve().parents[1]


@lru_cache(maxsize=1)
def trained():
    """Return a reference and seven training shapes, one that is not trained on, and maps without and with weights."""
    creatures = make_creatures(n_shapes=9, n_vertices=1200)
    shapes = DescriptorTransformer().transform(SpectralBasis().transform(creatures.meshes))
    truths = creatures.correspondences
    naive = WeightedFunctionalMapLearner(weighting=None).fit(shapes[:8], truths[:8])
    learned = WeightedFunctionalMapLearner().fit(shapes[:8], truths[:8])
    return SimpleNamespace(
        shapes=shapes,
        truths=truths,
        naive=naive,
        learned=learned,
        new=shapes[8:],
        new_truths=truths[8:],
        reference=shapes[0].spectral,
        unseen=shapes[8].spectral,
    )


def eigenfunctions():
    """Draw the same three eigenfunctions on two poses."""
    it = trained()
    shown = [1, 2, 8]
    poses = [it.reference, it.unseen]
    plot_functions(
        [pose.mesh for pose in poses],
        [pose.evecs[:, shown] for pose in poses],
        labels=[f"number {j + 1}" for j in shown],
        captions=["the reference", "another pose"],
    )


def pulled_back():
    """Draw a function on the reference, what the true points make of it, and what the functional map does."""
    it = trained()
    bump = np.exp(
        -((it.reference.vertices - it.reference.vertices[it.reference.vertices[:, 1].argmax()]) ** 2).sum(1) * 8
    )
    (C,) = it.learned.ground_truth_maps(it.new, it.new_truths)
    coefficients = it.reference.evecs[:, :50].T @ (it.reference.mass * bump)
    join = it.new_truths[0].join(it.truths[0])
    nearest = np.linalg.norm(it.unseen.vertices[:, None] - it.unseen.vertices[join.vertices_i], axis=2).argmin(axis=1)
    meshes = [it.reference.mesh, it.unseen.mesh, it.unseen.mesh]
    functions = [bump, bump[join.vertices_0[nearest]], it.unseen.evecs[:, :50] @ C @ coefficients]
    plot_functions(
        meshes,
        functions,
        captions=["a function f on the reference", "f after the points' map T", "C times 50 coefficients of f"],
        limits=(0, 1),
        cmap="viridis",
    )


def matrices():
    """Draw the known map of a shape that was not trained on, the map without weights, and the learned one."""
    it = trained()
    (known,) = it.learned.ground_truth_maps(it.new, it.new_truths)
    maps = {
        "known": known,
        "without weights": it.naive.functional_maps(it.new)[0],
        "learned": it.learned.functional_maps(it.new)[0],
    }
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained", sharey=True)
    for ax, (title, C) in zip(axes, maps.items(), strict=True):
        image = ax.imshow(C[:30, :30], cmap="coolwarm", vmin=-1, vmax=1)
        ax.set(title=title, xlabel="function on the reference")
    axes[0].set_ylabel("function on the shape")
    figure.colorbar(image, ax=axes, shrink=0.8)


def singular_values():
    """Draw how much of the function space is mapped well, and how well each stable function is."""
    it = trained()
    _, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for name, learner in (("without weights", it.naive), ("learned", it.learned)):
        SingularValuesDisplay.from_estimator(learner, it.new, it.new_truths, ax=left, name=name)
        BasisErrorDisplay.from_estimator(learner, it.new, it.new_truths, ax=right, name=name)


def stable_functions():
    """Draw three of the most stable functions on the reference and on the shape, and the least stable one."""
    it = trained()
    shown = [1, 2, 3, 49]
    Y = it.learned.stable_basis_[:, shown]
    (X,) = it.learned.functional_maps(it.new)
    functions = [(it.reference.evecs[:, :50] @ Y).T, (it.unseen.evecs[:, :50] @ X @ Y).T]
    captions = [f"number {j + 1}" for j in shown]
    for shape, columns in zip((it.reference, it.unseen), functions, strict=True):
        plot_functions(
            [shape.mesh] * 4,
            list(columns),
            captions=captions,
            limits=(-4, 4),
            labels=["reference" if shape is it.reference else "carried by X(D)"],
        )
        captions = [""] * 4


def matched():
    """Draw a match, its expected error, and its true error."""
    it = trained()
    plot_matches(
        it.learned.match(it.new),
        [it.unseen.mesh],
        it.reference.mesh,
        errors=it.learned.pair_errors(it.new, it.new_truths),
        show=["match", "expected error", "confidence"],
    )


def reliability():
    """Draw expected against true errors of the shape that was not trained on."""
    it = trained()
    ReliabilityDisplay.from_estimator(it.learned, it.new, it.new_truths, name="mean of a tenth of the points")


def layers():
    """Draw the layers that import-linter holds, read from its contract, and how data flows through them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = next(one for one in project["tool"]["importlinter"]["contracts"] if one["type"] == "layers")
    rows = [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]
    _, ax = plt.subplots(figsize=(10, 0.62 * len(rows) + 0.3), layout="constrained")
    for height, names in enumerate(reversed(rows)):
        width = 10 / len(names)
        for place, name in enumerate(names):
            colour = "#d6e6f2" if name in _FLOW else "#eef1f4"
            box = FancyBboxPatch(
                (place * width + 0.06, height + 0.08),
                width - 0.12,
                0.8,
                boxstyle="round,pad=0,rounding_size=0.08",
                facecolor=colour,
                edgecolor="#9fb3c4",
                linewidth=0.8,
            )
            ax.add_patch(box)
            text = name if len(names) > 3 else f"{name}: {_summary(name)}"
            ax.text(
                (place + 0.5) * width,
                height + 0.48,
                text,
                ha="center",
                va="center",
                fontsize=8 if len(names) > 1 else 9,
            )
    ax.set(xlim=(0, 10), ylim=(0, len(rows)))
    ax.set_axis_off()


# What data flows through, from meshes to maps.
_FLOW = ("io", "basis", "descriptors", "learner", "shapes")


def _summary(name, most=58):
    """Return the beginning of the first line of a module's docstring."""
    path = ROOT / "skfmap" / name
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    line = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))).split("\n")[0].rstrip(".")
    for stop in (":", ";", ",", " of ", " that "):
        if len(line) > most:
            line = line.split(stop)[0]
    return line[0].lower() + line[1:]


def flow():
    """Draw the paper's figure 2: learning above, a new shape below."""
    steps = ["meshes", "SpectralBasis", "DescriptorTransformer", "WeightedFunctionalMapLearner"]
    above = ["", "eigenfunctions", "probe functions G", "fit: weights D, stable basis Y"]
    below = ["", "eigenfunctions", "probe functions G", "predict, match: X(D) Y, points, errors"]
    _, ax = plt.subplots(figsize=(10, 2.6), layout="constrained")
    for row, (who, texts) in enumerate((("new shape", below), ("collection with\ncorrespondences", above))):
        for place, (step, text) in enumerate(zip(steps, texts, strict=True)):
            x, y = 2.6 * place, 1.4 * row
            ax.add_patch(
                FancyBboxPatch(
                    (x, y),
                    2.15,
                    0.9,
                    boxstyle="round,pad=0,rounding_size=0.1",
                    facecolor="#d6e6f2" if row else "#fbe6d4",
                    edgecolor="0.6",
                    linewidth=0.8,
                )
            )
            ax.text(
                x + 1.07, y + 0.45, who if place == 0 else f"{step}\n{text}", ha="center", va="center", fontsize=7.5
            )
            if place:
                ax.annotate("", (x, y + 0.45), (x - 0.45, y + 0.45), arrowprops={"arrowstyle": "->", "color": "0.4"})
    ax.annotate("", (8.9, 0.9), (8.9, 1.4), arrowprops={"arrowstyle": "->", "color": "0.4"})
    ax.text(9.0, 1.15, "D, Y", fontsize=8, va="center")
    ax.set(xlim=(-0.05, 10), ylim=(-0.05, 2.35))
    ax.set_axis_off()
