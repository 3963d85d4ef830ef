"""Landmarks on bones: what alignment alone gives, for other answers to be compared with.

    python tests/benchmarks/landmarks.py mandibles|skulls

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). Of the first
twenty mandibles in order of name, the first ten are templates and the rest is scored. ``--final``
scores the last ten of all forty, and is for one run at the end. Skulls are left out in turn.

An answer is a function of the templates and the target that returns landmarks, shape
(n_landmarks, 3); it must not look at those of the target. See ``answers``. Errors are distances
from the landmarks by hand, in millimetres. Intervals are of the bootstrap over specimens, 95 %.
"skfmap" is `skfmap.predict_landmarks` with what `python -m skfmap train` would choose, "on surface"
the same put onto the surface, "register" the first template's landmarks on its registered mesh.
Seconds of these three are without fits, which the last lines tell; bases are computed once for all
folds.
"""

import argparse
import importlib.util
import itertools
import json
import os
import tempfile
import time
import warnings
from functools import partial
from typing import NamedTuple

import igl
import numpy as np
from joblib import Parallel, delayed, parallel_config
from paper_experiment import DATA
from scipy.sparse import csr_array
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import (
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals
from skfmap.io import as_far_as_sound, read_arrays

N_VOTERS = 10  # templates that vote where not all of them do
N_POINTS, N_QUERIES, N_COARSE = 20_000, 3_000, 300  # of a cloud; moved; for the global start
COARSE_STEPS, STEPS, PATCH_STEPS = 10, 20, 10
KEPT = 0.8  # share of the closest pairs that an alignment looks at
NORMAL_WEIGHT = 0.2  # length of a normal beside coordinates, over the size of the target
PATCH_RADIUS = 0.25  # over the size of the template
MEMORY = "SKFMAP_BENCHMARK_MEMORY"  # names the folder where bases are kept between folds
N_JOBS = "SKFMAP_BENCHMARK_JOBS"  # of a fit
MODELS = {}  # of a process, by the names of what they learned from


class Similarity(NamedTuple):
    """The map that takes x to scale * rotation @ x + shift."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def apply(self, points):
        return self.scale * points @ self.rotation.T + self.shift

    def undo(self, points):
        return (points - self.shift) @ self.rotation / self.scale


class Cloud:
    """Points with normals; well-spread ones look for the closest that face the same way."""

    def __init__(self, points, normals, n_queries):
        self.points, self.normals = points, normals
        self.queries = spread(points, n_queries)
        even = points[self.queries]
        self.centre = even.mean(axis=0)
        self.size = np.sqrt(((even - self.centre) ** 2).sum(axis=1).mean())
        self.tree = KDTree(np.hstack([points, NORMAL_WEIGHT * self.size * normals]))

    def closest(self, points, normals):
        """Return the distances and the numbers of the points that are closest to others."""
        return self.tree.query(np.hstack([points, NORMAL_WEIGHT * self.size * normals]))


class Specimen(NamedTuple):
    """A bone. Vertices are numbered as stored; the clouds are without those of no face."""

    name: str
    mesh: Mesh
    landmarks: np.ndarray
    estimates: np.ndarray | None  # MALPACA's
    cloud: Cloud
    coarse: Cloud  # for the global start


def positions(path):
    """Return the landmarks of a file of 3D Slicer, in order of label, as written."""
    if path.suffix == ".json":
        points = json.loads(path.read_text())["markups"][0]["controlPoints"]
        labelled = {int(point["label"]): point["position"] for point in points}
    else:
        rows = [line.split(",") for line in path.read_text().split("\n") if line[:1] not in "#"]
        labelled = {int(row[11]): row[1:4] for row in rows}
    return np.array([labelled[label] for label in sorted(labelled)], dtype=float)


def read(path):
    """Read a mandible or a skull with its landmarks."""
    mesh, _ = as_far_as_sound(*read_arrays(path), path.stem)
    by_hand, estimates = path.with_suffix(".mrk.json"), None
    if not by_hand.is_file():
        by_hand = path.with_name(f"{path.stem}_Landmarks.fcsv")
        estimates = positions(path.parent / "malpaca" / by_hand.name)
    points = np.ascontiguousarray(mesh.vertices[np.unique(mesh.faces)])
    normals = vertex_normals(mesh.vertices, mesh.faces)[np.unique(mesh.faces)]
    some, few = spread(points, N_POINTS), spread(points, N_COARSE)
    cloud = Cloud(points[some], normals[some], N_QUERIES)
    coarse = Cloud(points[few], normals[few], N_COARSE)
    return Specimen(path.stem, mesh, positions(by_hand), estimates, cloud, coarse)


def spread(points, n):
    """Return the numbers of about n points, one of each cell of a grid, or of all."""
    if n >= len(points):
        return np.arange(len(points))
    width = np.ptp(points, axis=0).max() / np.sqrt(n)
    for _ in range(8):
        cells = np.floor((points - points.min(axis=0)) / width).astype(int)
        chosen = np.unique(cells, axis=0, return_index=True)[1]
        width *= np.sqrt(len(chosen) / n)
    return chosen


def fit_similarity(points, onto, scaled=True):
    """Return the best similarity or rigid motion; its scale is the ratio of the two sizes."""
    centre, centre_onto = points.mean(axis=0), onto.mean(axis=0)
    a, b = points - centre, onto - centre_onto
    U, _, Vt = np.linalg.svd(b.T @ a)
    rotation = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    scale = np.linalg.norm(b) / np.linalg.norm(a) if scaled else 1.0
    return Similarity(scale, rotation, centre_onto - scale * rotation @ centre)


def closest_pairs(a, b, start):
    """Return points of a, their partners in b, and all distances: trimmed, both ways."""
    far, on_b = b.closest(start.apply(a.points[a.queries]), a.normals[a.queries] @ start.rotation.T)
    back = start.undo(b.points[b.queries])
    far_back, on_a = a.closest(back, b.normals[b.queries] @ start.rotation)
    near, near_back = far <= np.quantile(far, KEPT), far_back <= np.quantile(far_back, KEPT)
    points = np.vstack([a.points[a.queries[near]], a.points[on_a[near_back]]])
    onto = np.vstack([b.points[on_b[near]], b.points[b.queries[near_back]]])
    return points, onto, np.append(far[near], start.scale * far_back[near_back])


def align(a, b, start, steps):
    """Return the similarity after some steps of ICP, and the mean trimmed distance."""
    for _ in range(steps):
        start = fit_similarity(*closest_pairs(a, b, start)[:2])
    return start, closest_pairs(a, b, start)[2].mean()


def starts(a, b):
    """Yield the 24 similarities that take principal axes to principal axes, in any order."""
    axes, axes_b = (np.linalg.eigh(np.cov(c.points[c.queries].T))[1] for c in (a, b))
    for order, *signs in itertools.product(itertools.permutations(range(3)), *3 * [(1, -1)]):
        rotation = axes_b @ (np.eye(3)[list(order)] * signs) @ axes.T
        if np.linalg.det(rotation) > 0:
            scale = b.size / a.size
            yield Similarity(scale, rotation, b.centre - scale * rotation @ a.centre)


def similarity_icp(template, target):
    """Return the similarity from a template to a target, by ICP from a global start."""
    a, b = template.coarse, target.coarse
    tried = [align(a, b, start, COARSE_STEPS) for start in starts(a, b)]
    best, _ = min(tried, key=lambda tried: tried[1])
    return align(template.cloud, target.cloud, best, STEPS)[0]


def move_with_patch(template, target, frame, landmark):
    """Return a landmark of the template on the target, moved with the rigid patch around it."""
    cloud = template.cloud
    near = np.linalg.norm(cloud.points - landmark, axis=1) < PATCH_RADIUS * cloud.size
    points, normals = frame.apply(cloud.points[near]), cloud.normals[near] @ frame.rotation.T
    at = frame.apply(landmark)
    for _ in range(PATCH_STEPS):
        far, partner = target.cloud.closest(points, normals)
        kept = far <= np.quantile(far, KEPT)
        step = fit_similarity(points[kept], target.cloud.points[partner[kept]], scaled=False)
        points, normals, at = step.apply(points), normals @ step.rotation.T, step.apply(at)
    return at


def project(points, target):
    """Return the closest points of the target's surface."""
    return igl.point_mesh_squared_distance(points, target.mesh.vertices, target.mesh.faces)[2]


def carry(template, target):
    """Return the landmarks of a template on a target after each step, and the seconds."""
    started = time.perf_counter()
    frame = similarity_icp(template, target)
    aligned, seconds = frame.apply(template.landmarks), time.perf_counter() - started
    patches = [move_with_patch(template, target, frame, at) for at in template.landmarks]
    carried = {"frame": frame, "aligned": aligned, "projected": project(aligned, target)}
    carried["patches"] = np.array(patches)
    return carried | {"seconds": (seconds, time.perf_counter() - started)}


def first_template(carried, templates, target, step):
    """Return the landmarks of the first template after a step."""
    return carried[templates[0].name, target.name][step]


def vote(carried, templates, target, step="patches", n_voters=N_VOTERS, on_surface=False):
    """Return the median of the landmarks that the first templates give after a step."""
    voted = np.median([carried[t.name, target.name][step] for t in templates[:n_voters]], axis=0)
    return project(voted, target) if on_surface else voted


def vote_and_offset(carried, templates, target):
    """Return the vote of patches, moved by what it lacks on average at templates left out."""
    first, offsets = templates[0], []
    for left_out in templates:
        others = [t for t in templates if t is not left_out]
        off = left_out.landmarks - vote(carried, others, left_out, on_surface=True)
        if left_out is not first:
            frame = carried[first.name, left_out.name]["frame"]
            off = off @ frame.rotation / frame.scale
        offsets.append(off)
    # Means in the frame of the first template, less the share of their squares that is noise.
    mean, n = np.mean(offsets, axis=0), len(offsets)
    noise = np.var(offsets, axis=0, ddof=1).sum(axis=1) / n
    mean *= np.maximum(0, 1 - noise / (mean**2).sum(axis=1))[:, None]
    frame = carried[first.name, target.name]["frame"]
    moved = frame.scale * mean @ frame.rotation.T
    return vote(carried, templates, target, on_surface=True) + moved


def coherent_point_drift(carried, templates, target, n=1000, sigma=0.1):
    """Return the first template's landmarks after ICP and non-rigid CPD."""
    from pycpd import DeformableRegistration  # noqa: PLC0415

    frame, onto = carried[templates[0].name, target.name]["frame"], target.cloud
    source, fixed = (c.points[spread(c.points, n)] for c in (templates[0].cloud, onto))
    moved = frame.apply(source), frame.apply(templates[0].landmarks), fixed
    source, at, fixed = ((points - onto.centre) / onto.size for points in moved)
    # From a wider start, as pycpd's own, and from affine CPD, errors were larger.
    drift = DeformableRegistration(X=fixed, Y=source, sigma2=sigma**2)
    drift.register()
    # pycpd's kernel at points that are not the source's.
    at = at + np.exp(-cdist(at, source, "sqeuclidean") / (2 * drift.beta**2)) @ drift.W
    return project(onto.centre + onto.size * at, target)


def learned(templates):
    """Return a model of templates, made once in a process."""
    key = tuple(template.name for template in templates)
    if key not in MODELS:
        started, memory = time.perf_counter(), os.environ.get(MEMORY)
        model = make_pipeline(
            SpectralBasis(memory=memory),
            DescriptorTransformer(memory=memory),
            WeightedFunctionalMapLearner(memory=memory, n_jobs=int(os.environ.get(N_JOBS, "2"))),
        )
        meshes = [template.mesh for template in templates]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(meshes, [Correspondence.from_points(t.landmarks, t.mesh) for t in templates])
        MODELS[key] = model, time.perf_counter() - started
    return MODELS[key]


def places(vertices, faces, points):
    """Return the matrix whose rows interpolate at the nearest points of a surface."""
    faces = faces[sound_faces(vertices, faces)]
    used, back = np.unique(faces, return_inverse=True)
    at, corners = vertices[used], back.reshape(-1, 3)
    _, face, nearest = igl.point_mesh_squared_distance(points, at, corners)
    triangles = [np.ascontiguousarray(at[corners[face, a]]) for a in range(3)]
    weights = igl.barycentric_coordinates(nearest, *triangles)
    rows = np.repeat(np.arange(len(points)), 3), faces[face].ravel()
    return csr_array((weights.ravel(), rows), shape=(len(points), len(vertices)))


def registration(templates, target):
    """Return the landmarks of the first template on its registered mesh."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (laid,) = skfmap.register(learned(templates)[0], [target.mesh])
    first = templates[0]
    own = places(first.mesh.vertices, laid.faces, first.landmarks)
    return project(own @ laid.vertices, target)


def measured(templates, target, on_surface=False):
    """Return what the package predicts."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = learned(templates)[0]
        (marks,) = skfmap.predict_landmarks(model, [target.mesh], on_surface=on_surface)
    return marks.points


def promised(templates, target):
    """Return errors to expect, radii, and the seconds of the fit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, seconds = learned(templates)
        (marks,) = skfmap.predict_landmarks(model, [target.mesh])
    radius = np.full(len(marks.names), np.nan) if marks.radius is None else marks.radius
    return marks.expected_error, radius, seconds


def malpaca(templates, target):
    """Return MALPACA's estimates, as stored; its templates were chosen by others."""
    return target.estimates


def own_similarity(templates, target):
    """Return the first template's landmarks after the similarity that is best for them."""
    return fit_similarity(templates[0].landmarks, target.landmarks).apply(templates[0].landmarks)


def nearest_vertex(templates, target):
    """Return the vertices nearest to the landmarks: the least that vertices can be off."""
    return target.mesh.vertices[KDTree(target.mesh.vertices).query(target.landmarks)[1]]


def unlearned(carried):
    """Return the answers that are not the package's, beside ICP."""
    named = {
        "ICP unproj.": partial(first_template, carried, step="aligned"),
        "vote": partial(vote, carried, step="projected", n_voters=None, on_surface=True),
        "patch vote": partial(vote, carried, on_surface=True),
        "pv unproj.": partial(vote, carried),
        "+ offset": partial(vote_and_offset, carried),
    }
    if importlib.util.find_spec("pycpd"):
        return named | {"CPD": partial(coherent_point_drift, carried)}
    print("CPD is left out: pycpd is not installed.")
    return named


def answers(carried, with_malpaca, with_unlearned):
    """Return the answers to compare, by name; the first is what the others are compared with."""
    named = {
        "ICP": partial(first_template, carried, step="projected"),
        **(unlearned(carried) if with_unlearned else {}),
        "register": registration,
        "on surface": partial(measured, on_surface=True),
        "skfmap": measured,
    }
    named |= {"MALPACA": malpaca} if with_malpaca else {}
    return named | {"(own sim.)": own_similarity, "(vertex)": nearest_vertex}


def score(answer, templates, target):
    """Return the errors at all landmarks, and the seconds."""
    started = time.perf_counter()
    errors = np.linalg.norm(answer(templates, target) - target.landmarks, axis=1)
    return errors, time.perf_counter() - started


def score_all(named, folds):
    """Return errors, seconds and what was promised, for each fold."""
    done = []
    for fold in folds:
        errors, seconds = zip(*(score(answer, *fold) for answer in named.values()), strict=True)
        expected, radius, fitting = promised(*fold)
        told = np.array([expected, radius, np.full(len(expected), fitting)])
        done.append((np.array(errors), np.array(seconds), told))
    return done


def needed(folds, with_unlearned):
    """Return the pairs of template and target that the answers look at, each once."""
    pairs = {}
    for templates, target in folds:
        if not with_unlearned:
            pairs[templates[0].name, target.name] = templates[0], target
            continue
        # Left-out templates are voted on by the first of the others.
        voted = itertools.product(templates[: N_VOTERS + 1], templates)
        for a, b in [(t, target) for t in templates] + [p for p in voted if p[0] is not p[1]]:
            pairs[a.name, b.name] = a, b
    return pairs


def interval(values):
    """Return a mean and its bootstrap interval, in words."""
    drawn = np.random.default_rng(0).integers(len(values), size=(10_000, len(values)))
    low, high = np.quantile(values[drawn].mean(axis=1), (0.025, 0.975))
    return f"{values.mean():8.3f} [{low:6.3f}, {high:6.3f}]"


def report(named, errors, seconds):
    """Print errors of shape (n_answers, n_specimens, n_landmarks), and seconds."""
    print("landmark" + "".join(f"{name:>12}" for name in named))
    for j, row in enumerate(errors.mean(axis=1).T, start=1):
        print(f"{j:>8}" + "".join(f"{one:>12.3f}" for one in row))
    print(f"\n{'':14}{'mean, mm':^26}{'less the first':^26}  median  95 %  s per specimen")
    for name, each, taken in zip(named, errors, seconds, strict=True):
        means = each.mean(axis=1)
        print(
            f"{name:14}{interval(means)}  {interval(means - errors[0].mean(axis=1))}"
            f"{np.median(each):8.3f}{np.quantile(each, 0.95):8.3f}{taken.mean():8.2f}"
        )


def folds_of(data, n_training, final):
    """Return the templates and the target of each fold."""
    paths = sorted((DATA / data).glob("*.ply"))
    if not paths:
        raise SystemExit(f"There are no meshes in {DATA / data}; set SKFMAP_DATA.")
    if data == "skulls":
        skulls = [read(path) for path in paths]
        return [([s for s in skulls if s is not target], target) for target in skulls]
    tested = paths[-10:] if final else paths[n_training:20]
    if not tested:
        raise SystemExit("More than 10 for training leave none of twenty to score; see --final.")
    templates = [read(path) for path in paths[:n_training]]
    return [(templates, read(path)) for path in tested]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("data", choices=("mandibles", "skulls"))
    parser.add_argument("--training", type=int, choices=(10, 20, 30), default=10)
    parser.add_argument("--final", action="store_true", help="score the last ten mandibles")
    parser.add_argument("--learned", action="store_true", help="leave out other answers but ICP")
    options = parser.parse_args()
    folds = folds_of(options.data, options.training, options.final)
    pairs = needed(folds, not options.learned)
    kept = tempfile.TemporaryDirectory()
    # Mandibles have one fit, on both cores; skulls have one each, two at a time.
    n_groups = 1 if options.data == "mandibles" else 2
    os.environ |= {MEMORY: kept.name, N_JOBS: str(3 - n_groups)}
    with kept:
        with parallel_config("loky", n_jobs=2, inner_max_num_threads=1):
            carried = Parallel()(delayed(carry)(*pair) for pair in pairs.values())
        found = dict(zip(pairs, carried, strict=True))
        named = answers(found, options.data == "mandibles", not options.learned)
        if n_groups == 1:
            done = [score_all(named, folds)]
        else:
            with parallel_config("loky", n_jobs=2, inner_max_num_threads=1):
                done = Parallel()(delayed(score_all)(named, folds[f::2]) for f in range(2))
    scored = [one for pair in itertools.zip_longest(*done) for one in pair if one is not None]
    errors, seconds, told = (np.array(what) for what in zip(*scored, strict=True))
    icp, both = np.mean([one["seconds"] for one in carried], axis=0)
    print(f"Not in the seconds below: {icp:.2f} s per template for ICP, with patches {both:.2f} s")
    errors = errors.transpose(1, 0, 2)
    report(named, errors, seconds.T)
    expected, radius, fitting = told[:, 0], told[:, 1], told[:, 2, 0]
    own = errors[list(named).index("skfmap")]
    fits = np.isfinite(expected).all(axis=1)
    print(f"\nskfmap: {(~fits).sum()} of {len(fits)} specimens do not fit, and nothing is promised")
    print(f"expected {expected[fits].mean():.3f} mm on the others, true {own[fits].mean():.3f}")
    if np.isfinite(radius[fits]).all():
        held = interval((own <= radius)[fits].mean(axis=1))
        print(f"radii of 90 %: mean {radius[fits].mean():.3f} mm, share within: {held}")
    print(f"s per fit, with bases of the templates: {np.unique(fitting).mean():.0f}")


if __name__ == "__main__":
    main()
