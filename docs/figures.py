"""The figures of the pages, drawn when the pages are built."""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
from layers import read_layers
from matplotlib import pyplot as plt
from matplotlib.patches import FancyBboxPatch
from scipy.spatial.transform import Rotation
from sklearn.pipeline import make_pipeline

from skfmap import (
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
    register,
)
from skfmap.datasets import make_creatures
from skfmap.functional import farthest_points, project
from skfmap.metrics import ERROR_KINDS
from skfmap.plotting import (
    BasisErrorDisplay,
    Camera,
    ErrorCurveDisplay,
    ReliabilityDisplay,
    SingularValuesDisplay,
    WeightsDisplay,
    plot_function,
    plot_functions,
    plot_matches,
)
from skfmap.shape_space import ShapeSpace


@lru_cache(maxsize=1)
def trained():
    """Return a reference, seven training shapes, a new one, and maps without and with weights."""
    creatures = make_creatures(n_shapes=9, n_vertices=1200)
    shapes = DescriptorTransformer().transform(SpectralBasis().transform(creatures.meshes))
    truths = creatures.correspondences
    naive = WeightedFunctionalMapLearner(weighting=None, refine=None).fit(shapes[:8], truths[:8])
    learned = WeightedFunctionalMapLearner(refine=None).fit(shapes[:8], truths[:8])
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


@lru_cache(maxsize=1)
def _posed():
    """Return the new shape as a mesh turned about the vertical to face as the reference does."""
    it = trained()
    mesh, pairs = it.unseen.mesh, it.new_truths[0].join(it.truths[0])
    here = mesh.vertices[pairs.vertices_i] - mesh.vertices.mean(axis=0)
    there = it.reference.mesh.vertices[pairs.vertices_0] - it.reference.mesh.vertices.mean(axis=0)
    angle = np.angle(np.vdot(here[:, 0] + 1j * here[:, 1], there[:, 0] + 1j * there[:, 1]))
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    return Mesh(mesh.vertices @ turn, mesh.faces, name=mesh.name)


@lru_cache(maxsize=1)
def _known():
    it = trained()
    return it.learned.ground_truth_maps(it.new, it.new_truths)[0]


def _grid(rows, titles, labels):
    """Draw functions of the rows' meshes side by side, at one scale about zero in each column."""
    size = (1.75 * len(titles), 1.5 * len(rows))
    _, axes = plt.subplots(
        len(rows), len(titles), figsize=size, squeeze=False, layout="constrained"
    )
    for column, title in enumerate(titles):
        largest = max(np.quantile(np.abs(functions[:, column]), 0.99) for _, functions in rows)
        for (mesh, functions), ax in zip(rows, axes[:, column], strict=True):
            plot_function(mesh, functions[:, column], ax=ax, limits=(-largest, largest))
        axes[0, column].set_title(title, fontsize=10)
    for label, ax in zip(labels, axes[:, 0], strict=True):
        ax.text(
            -0.04,
            0.5,
            label,
            transform=ax.transAxes,
            rotation=90,
            ha="right",
            va="center",
            fontsize=10,
        )


def eigenfunctions():
    """Draw the same five eigenfunctions on two poses."""
    it, shown = trained(), [1, 2, 3, 6, 16]
    rows = [
        (it.reference.mesh, it.reference.evecs[:, shown]),
        (_posed(), it.unseen.evecs[:, shown]),
    ]
    _grid(rows, [f"number {j}" for j in shown], ["reference", "another pose"])


def pulled_back():
    """Draw a function on the reference, its image by the true points, and by the functional map."""
    it = trained()
    distances = np.linalg.norm(
        it.reference.vertices - it.reference.vertices[it.reference.vertices[:, 2].argmax()], axis=1
    )
    bump = np.exp(-((distances / 0.15) ** 2))
    coefficients = project(bump[:, None], it.reference.evecs[:, :50], it.reference.mass)[:, 0]
    pairs = it.new_truths[0].join(it.truths[0])
    nearest = np.linalg.norm(
        it.unseen.vertices[:, None] - it.unseen.vertices[pairs.vertices_i], axis=2
    ).argmin(axis=1)
    shown = {
        "a function f on the reference": (it.reference.mesh, bump),
        "f in 50 eigenfunctions": (it.reference.mesh, it.reference.evecs[:, :50] @ coefficients),
        "f after the points' map T": (_posed(), bump[pairs.vertices_0[nearest]]),
        "C times the 50 coefficients": (
            _posed(),
            it.unseen.evecs[:, :50] @ _known() @ coefficients,
        ),
    }
    _, axes = plt.subplots(1, len(shown), figsize=(9.6, 2.2), layout="constrained")
    for ax, (title, (mesh, values)) in zip(axes, shown.items(), strict=True):
        plot_function(mesh, values, ax=ax, limits=(0, 1), cmap="viridis").set_title(
            title, fontsize=10
        )


def matrices():
    """Draw the known map of the new shape, the map without weights, and the learned one."""
    it = trained()
    maps = {"known": _known(), "without weights": it.naive.functional_maps(it.new)[0]}
    maps["learned"] = it.learned.functional_maps(it.new)[0]
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.3), layout="constrained", sharey=True)
    for ax, (title, C) in zip(axes, maps.items(), strict=True):
        image = ax.imshow(C[:30, :30], cmap="RdBu_r", vmin=-1, vmax=1)
        off = "" if C is _known() else f": off by {np.linalg.norm(C - _known()):.1f}"
        ax.set(title=title + off, xlabel="function on the reference")
    axes[0].set_ylabel("function on the shape")
    figure.colorbar(image, ax=axes, shrink=0.8)


def directions():
    """Draw the two maps between a shape and the reference, and which way they run."""
    it = trained()
    (match,) = it.learned.match(it.new)
    height = it.reference.vertices[:, 2]
    _, axes = plt.subplots(1, 2, figsize=(8, 3))
    plot_function(it.reference.mesh, height, ax=axes[0]).set_title("reference $S_0$, a function f")
    plot_function(_posed(), height[match.p2p], ax=axes[1]).set_title(
        r"shape $S_i$, the function $f \circ T$"
    )
    axes[0].figure.subplots_adjust(left=0.01, right=0.99, wspace=0.45, top=0.86, bottom=0.06)
    arrow = {"xycoords": "figure fraction", "arrowprops": {"arrowstyle": "-|>", "lw": 1.8}}
    axes[0].annotate("", xy=(0.6, 0.6), xytext=(0.41, 0.6), **arrow)
    axes[0].annotate("", xy=(0.41, 0.36), xytext=(0.6, 0.36), **arrow)
    axes[0].figure.text(0.505, 0.65, "functional_map C\ntakes functions", ha="center")
    axes[0].figure.text(0.505, 0.18, "p2p T\nsends points", ha="center")


INFORMATIVE, MISLEADING = "gaussian_curvature[t=0.01]", "log_gaussian_curvature[t=0.1]"


def probes():
    """Draw a probe that the known map respects, and one that it respects less."""
    it = trained()
    names = list(it.shapes[0].probe_names)
    of_reference, of_new = (shape.probes[:50].copy() for shape in (it.shapes[0], it.new[0]))
    of_reference[0] = of_new[0] = 0
    of_reference, of_new = (one / np.linalg.norm(one, axis=0) for one in (of_reference, of_new))
    expected = _known() @ of_reference
    misses = np.linalg.norm(expected - of_new, axis=0)
    figure, axes = plt.subplots(2, 3, figsize=(7.2, 4), layout="constrained")
    for name, row in zip((INFORMATIVE, MISLEADING), axes, strict=True):
        j = names.index(name)
        shown = {
            "on the reference": (it.reference, it.reference.mesh, of_reference),
            "on the new shape": (it.unseen, _posed(), of_new),
            "as the known map expects it": (it.unseen, _posed(), expected),
        }
        functions = [
            basis.evecs[:, :50] @ coefficients[:, j] for basis, _, coefficients in shown.values()
        ]
        largest = np.quantile(np.abs(np.concatenate(functions)), 0.98)
        for ax, title, (_, mesh, _), values in zip(
            row, shown, shown.values(), functions, strict=True
        ):
            plot_function(mesh, values, ax=ax, limits=(-largest, largest))
            if name == INFORMATIVE:
                ax.set_title(title, fontsize=10)
        label = f"{name.split('[')[0].replace('_', ' ')}\ndisagreement {misses[j]:.2f}"
        row[0].text(
            -0.04,
            0.5,
            label,
            transform=row[0].transAxes,
            rotation=90,
            ha="right",
            va="center",
            fontsize=8,
        )
    return figure


def weights():
    """Draw the learned weights."""
    _, ax = plt.subplots(figsize=(8, 3.4), layout="constrained")
    WeightsDisplay.from_estimator(trained().learned, ax=ax, linestyle="none")


def singular_values():
    """Draw how much of the function space is mapped well, and how well each stable function is."""
    it = trained()
    _, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for name, learner in (("without weights", it.naive), ("learned", it.learned)):
        SingularValuesDisplay.from_estimator(learner, it.new, it.new_truths, ax=left, name=name)
        BasisErrorDisplay.from_estimator(learner, it.new, it.new_truths, ax=right, name=name)


def stable_functions():
    """Draw the three most and the two least stable functions, and their images on the new shape."""
    it, shown = trained(), [1, 2, 3, 48, 49]
    Y = it.learned.stable_basis_[:, shown]
    (X,) = it.learned.functional_maps(it.new)
    rows = [
        (it.reference.mesh, it.reference.evecs[:, :50] @ Y),
        (_posed(), it.unseen.evecs[:, :50] @ X @ Y),
        (_posed(), it.unseen.evecs[:, :50] @ _known() @ Y),
    ]
    _grid(rows, [f"$y_{{{j}}}$" for j in shown], ["reference", "learned map", "known map"])


def matched():
    """Draw a match: the colours of the reference, carried to the shape that was not trained on."""
    it = trained()
    plot_matches(it.learned.match(it.new), [it.unseen.mesh], it.reference.mesh, show=["match"])


def trusted():
    """Draw expected and true errors of the new shape; grey where no truth is known."""
    it = trained()
    (match,), (errors,) = it.learned.match(it.new), it.learned.pair_errors(it.new, it.new_truths)
    true = np.full(len(match.p2p), np.nan)
    true[errors.vertices] = errors.direct
    plot_functions(
        [_posed(), _posed()],
        [match.expected_error, true],
        captions=["expected error", "true error"],
        labels=["error / sqrt(area)"],
        limits=(0, 0.08),
        cmap="magma_r",
    )


def sides():
    """Draw which side of the reference points are matched to, without and with oriented probes."""
    it = trained()
    paper = DescriptorTransformer("paper").transform([shape.spectral for shape in it.shapes])
    symmetric = WeightedFunctionalMapLearner(refine=None).fit(paper[:8], it.truths[:8])
    side = np.tanh(it.reference.vertices[:, 0] / 0.05)
    meshes, functions, captions = [it.reference.mesh], [side], ["reference"]
    for learner, new, name in (
        (symmetric, paper[8:], "the paper's probes"),
        (it.learned, it.new, "with oriented probes"),
    ):
        (errors,) = learner.pair_errors(new, it.new_truths)
        meshes.append(_posed())
        functions.append(side[learner.point_maps(new)[0]])
        captions.append(f"{name}\n" + ", ".join(f"{errors.mean(kind):.3f}" for kind in ERROR_KINDS))
    plot_functions(meshes, functions, captions=captions, labels=["side"])


def reliability():
    """Draw expected against true errors of the shape that was not trained on."""
    it = trained()
    ReliabilityDisplay.from_estimator(
        it.learned, it.new, it.new_truths, name="mean of a tenth of the points"
    )


@lru_cache(maxsize=1)
def _registering():
    """Return the first of a few creatures, and its mesh laid onto all."""
    creatures = make_creatures(n_shapes=6, n_vertices=1000, pose_strength=0.3, variation=0.2)
    model = make_pipeline(
        SpectralBasis(),
        DescriptorTransformer(),
        WeightedFunctionalMapLearner(n_functions=30, refine="register", confidence=None),
    )
    model.fit(creatures.meshes[:4], creatures.correspondences[:4])
    return creatures.meshes[0], register(model, creatures.meshes)


def _card(shown, **limits):
    """Draw meshes with their values in a row, as a picture for a card of the first page."""
    _, axes = plt.subplots(1, len(shown), figsize=(4.6, 2.1), layout="constrained")
    for ax, (mesh, values) in zip(axes, shown, strict=True):
        plot_function(mesh, values, ax=ax, **limits)
    return axes


@lru_cache(maxsize=1)
def _card_match():
    """Return what is trained, and the refined match of the new shape."""
    it = trained()
    refined = WeightedFunctionalMapLearner().fit(it.shapes[:8], it.truths[:8])
    return it, refined.match(it.new)[0]


def card_match():
    """Draw the reference, and a new shape in the colours of the vertices that it is matched to."""
    it, match = _card_match()
    spread = it.reference.mesh.vertices
    low, high = spread.min(axis=0), spread.max(axis=0)
    colours = 0.15 + 0.8 * (spread - low) / (high - low)
    _card([(it.reference.mesh, colours), (_posed(), colours[match.p2p])])


def card_transfer():
    """Draw labels of the reference, carried to a new shape."""
    it, match = _card_match()
    vertices = it.reference.mesh.vertices
    centres = vertices[farthest_points(vertices, 9)]
    labels = np.linalg.norm(vertices[:, None] - centres, axis=2).argmin(axis=1)
    colours = plt.get_cmap("Set3")(labels)[:, :3]
    _card([(it.reference.mesh, colours), (_posed(), match.transfer(colours))])


def card_landmarks():
    """Draw a few points of the reference, and where they lie on another shape."""
    reference, registered = _registering()
    points, camera = farthest_points(reference.vertices, 14), Camera()
    first, other = (one - one.mean(axis=0) for one in (reference.vertices, registered[5].vertices))
    turn, _ = Rotation.align_vectors(first, other)
    shown = [Mesh(first, reference.faces), Mesh(turn.apply(other), reference.faces)]
    axes = _card([(mesh, np.full((mesh.n_vertices, 3), 0.8)) for mesh in shown])
    for mesh, ax in zip(shown, axes, strict=True):
        x, y, depth = camera.project(mesh.vertices).T
        size = np.ptp(x) / 20
        near = [np.hypot(x - x[i], y - y[i]) < size for i in points]
        seen = [i for i, at in zip(points, near, strict=True) if depth[i] > depth[at].max() - size]
        colours = plt.get_cmap("tab20")([list(points).index(i) for i in seen])
        ax.scatter(x[seen], y[seen], c=colours, s=30, edgecolor="black", zorder=3)


def card_register():
    """Draw the mean of a collection between two of its variations."""
    _, registered = _registering()
    space = ShapeSpace().fit(registered)
    step = space.standard_deviations_[0] * np.linalg.norm(space.modes_[0], axis=1)
    _card([(space.mode_mesh(0, t), abs(t) * step) for t in (-2, 0, 2)], limits=(0, 2 * step.max()))


def card_trust():
    """Draw how far off each vertex may be, and how far it is."""
    it, (match,) = trained(), trained().learned.match(trained().new)
    (errors,) = it.learned.pair_errors(it.new, it.new_truths)
    true = np.full(len(match.p2p), np.nan)
    true[errors.vertices] = errors.direct
    _card([(_posed(), match.expected_error), (_posed(), true)], limits=(0, 0.08), cmap="magma_r")


def card_search():
    """Draw the share of points that land near where they belong, without and with learning."""
    it = trained()
    _, ax = plt.subplots(figsize=(4.6, 2.1), layout="constrained")
    for name, learner in (("without learning", it.naive), ("learned", it.learned)):
        ErrorCurveDisplay.from_estimator(learner, it.new, it.new_truths, ax=ax, name=name)


def quickstart():
    """Draw a new shape in the reference's colours, and below the error to expect."""
    it, match = _card_match()
    plot_matches([match], [_posed()], it.reference.mesh)


def layers():
    """Draw the layers of the import-linter contract, and how data flows through them."""
    rows = read_layers()
    _, ax = plt.subplots(figsize=(8, 0.46 * len(rows) + 0.3), layout="constrained")
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
            ax.text(
                (place + 0.5) * width,
                height + 0.48,
                name,
                ha="center",
                va="center",
                fontsize=9 if len(names) == 1 else 8 if len(names) < 6 else 7,
            )
    ax.set(xlim=(0, 10), ylim=(0, len(rows)))
    ax.set_axis_off()


# What data flows through, from meshes to maps.
_FLOW = ("io", "basis", "descriptors", "learner", "shapes")


def flow():
    """Draw the paper's figure 2: learning above, a new shape below."""
    steps = ["meshes", "SpectralBasis", "DescriptorTransformer", "WeightedFunctionalMapLearner"]
    above = ["", "eigenfunctions", "probe functions G", "fit: weights D, stable basis Y"]
    below = [
        "",
        "eigenfunctions",
        "probe functions G",
        "predict, match: X(D) Y,\npoints and errors",
    ]
    _, ax = plt.subplots(figsize=(8.5, 2.4), layout="constrained")
    for row, (who, texts) in enumerate(
        (("new shape", below), ("collection with\ncorrespondences", above))
    ):
        for place, (step, text) in enumerate(zip(steps, texts, strict=True)):
            x, y = 2.55 * place, 1.4 * row
            ax.add_patch(
                FancyBboxPatch(
                    (x, y),
                    2.3,
                    0.9,
                    boxstyle="round,pad=0,rounding_size=0.1",
                    facecolor="#d6e6f2" if row else "#fbe6d4",
                    edgecolor="0.6",
                    linewidth=0.8,
                )
            )
            ax.text(
                x + 1.15,
                y + 0.45,
                who if place == 0 else f"{step}\n{text}",
                ha="center",
                va="center",
                fontsize=7,
            )
            if place:
                ax.annotate(
                    "",
                    (x, y + 0.45),
                    (x - 0.25, y + 0.45),
                    arrowprops={"arrowstyle": "->", "color": "0.4"},
                )
    ax.annotate("", (8.9, 0.9), (8.9, 1.4), arrowprops={"arrowstyle": "->", "color": "0.4"})
    ax.text(9.0, 1.15, "D, Y", fontsize=8, va="center")
    ax.set(xlim=(-0.05, 10), ylim=(-0.05, 2.35))
    ax.set_axis_off()
