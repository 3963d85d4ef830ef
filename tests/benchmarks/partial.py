"""Parts of held-out shapes matched to the whole reference, compared with the plain match.

    python tests/benchmarks/partial.py cats
    python tests/benchmarks/partial.py faust
    python tests/benchmarks/partial.py creatures
    python tests/benchmarks/partial.py cats --cuts holes glue

Two thirds of the cats are used for training, and the others are cut. On FAUST, people 0 to 2 are
used for training in four poses each, and people 3 and 4 are cut in four other poses. Of ten
creatures, three are cut. Cuts leave about 70 and about 50 % of the area. They are made here with
separate seeds, and all parts are remeshed with fewer vertices, so that neither rims nor edges
are those of the mesh. Thirty small holes leave 90 and 80 % of the area; in glued scans, gaps
below 0.04 and 0.1 sqrt(area) are filled. Needs the data folder (``SKFMAP_DATA``, else
``../shared/data`` beside the checkout) for cats and bodies.
"""

import argparse
import contextlib
import time
import warnings
from pathlib import Path

import joblib
import numpy as np
from noise import glued, true_tears, with_holes
from paper_experiment import DATA
from sklearn.pipeline import make_pipeline
from threadpoolctl import threadpool_limits

import skfmap
from skfmap.datasets import load_collection, make_creatures
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.cutting import clip, keep_faces, smooth_mask, visible_faces, without_crumbs
from skfmap.geometry.faults import components
from skfmap.geometry.geodesics import heat_distances
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.thinning import thin
from skfmap.partial import LimbCut, PlaneCut

SEED = 7
KEPT = 0.85  # fraction of the vertices after remeshing
# Fractions of the area that are left; for glue, half the width of the gaps that are filled.
AMOUNTS = {"holes": (0.9, 0.8), "glue": (0.02, 0.05)}
NEAR = 0.1  # distance, in sqrt(area), within which reported and true tears agree


def collection_of(kind):
    """Return meshes, correspondences, and the indices for training and for cutting."""
    if kind == "creatures":
        given, train, test = make_creatures(10, 3000), list(range(7)), [7, 8, 9]
    elif kind == "cats":
        given = load_collection(DATA / "tosca_isometric", "cat*", "cat0")
        n = len(given.meshes)
        train, test = [i for i in range(n) if i % 3 != 2], [i for i in range(n) if i % 3 == 2]
    else:
        given = load_collection(DATA / "faust", "tr_reg_0[0-4]*", "tr_reg_000")
        train = [10 * person + pose for person in (0, 1, 2) for pose in (0, 3, 6, 9)]
        test = [10 * person + pose for person in (3, 4) for pose in (1, 4, 7, 8)]
    return given.meshes, given.correspondences, train, test


def seen_part(mesh, share, rng):
    """Return what is seen from a few directions, until about the given fraction of the area."""
    towards, seen, best = rng.normal(size=3), np.zeros(mesh.n_faces, dtype=bool), None
    for _ in range(6):
        seen = seen | visible_faces(mesh.vertices, mesh.faces, towards, n_pixels=300, grazing=0.1)
        part = clip(mesh.vertices, mesh.faces, smooth_mask(mesh.faces, mesh.n_vertices, seen, 1))
        off = abs(skfmap.Mesh(*part).area / mesh.area - share)
        if best is not None and off > best[0]:
            break
        best = off, part
        towards = np.cross(towards, rng.normal(size=3))  # a quarter turn
    return best[1]


def remeshed(vertices, faces):
    """Return a mesh with fewer vertices, thinned component by component."""
    pieces, found, n = components(faces, len(vertices))[faces[:, 0]], [], 0
    for piece in np.unique(pieces):
        own = keep_faces(vertices, faces, pieces == piece)
        with contextlib.suppress(ValueError):  # the component is too small
            own = thin(*own, max(int(KEPT * len(own[0])), 20))[:2]
        found.append((own[0], own[1] + n))
        n += len(own[0])
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def cut(mesh, kind, share, seed):
    """Return a scan of a mesh, and the mesh in the pose of the scan."""
    rng = np.random.default_rng([SEED, *seed])
    name = f"{mesh.name} {kind} {share}"
    if kind == "glue":
        part, posed = glued(mesh, share, int(KEPT * mesh.n_vertices), rng)
        return skfmap.Mesh(*part, name), posed
    if kind == "views":
        part = seen_part(mesh, share, rng)
    elif kind == "holes":
        part = with_holes(mesh, share, rng)
    else:
        one = {"planes": PlaneCut, "limbs": LimbCut}[kind](share, share)
        part = one.part(mesh.vertices, mesh.faces, share, rng)
    vertices, faces = remeshed(*without_crumbs(*part, 0.01 * mesh.area))
    return skfmap.Mesh(vertices, faces, name), mesh


def figures_of_tears(match, part, posed):
    """Return the agreement of reported tears with true ones."""
    true = np.zeros(part.n_vertices, dtype=bool)
    true[part.faces[true_tears(part.vertices, part.faces, posed)]] = True
    told = match.torn if match.torn is not None else np.zeros(part.n_vertices, dtype=bool)
    row = {"torn": float(told.any()), "tears found": np.nan, "tears right": np.nan}
    if true.any():
        row["tears found"] = 0.0
    if true.any() and told.any():
        at = part.vertices[told][:, None] - part.vertices[true][None]
        near = np.linalg.norm(at, axis=2) < NEAR * posed.area**0.5
        row["tears found"], row["tears right"] = near.any(axis=0).mean(), near.any(axis=1).mean()
    return row


class Figures:
    """Measures matches against the known pairs of a whole shape and the reference."""

    def __init__(self, reference, spectral_0):
        self.reference, self.mass = reference, spectral_0.mass
        self.known = {}

    def away(self, found, truth):
        """Return geodesic distances on the reference, in sqrt(area)."""
        sources, back = np.unique(truth, return_inverse=True)
        new = [s for s in sources if s not in self.known]
        if new:
            rows = heat_distances(self.reference.vertices, self.reference.faces, np.array(new))
            self.known.update(zip(new, rows / np.sqrt(self.reference.area), strict=True))
        return np.stack([self.known[s] for s in sources])[back, found]

    def of(self, match, part, mesh, join):
        """Return the figures of one match."""
        unit, n_0 = np.sqrt(self.reference.area), self.reference.n_vertices
        at = mesh.vertices[join.vertices_i]
        near = ClosestPoints(part.vertices, part.faces).of(at)
        normals = vertex_normals(mesh.vertices, mesh.faces)[join.vertices_i]
        shown = (near.distances < 0.01 * unit) & (np.sum(normals * near.normals, axis=1) > 0.5)
        shown &= ~near.on_rim
        rows = np.flatnonzero(shown)
        gaps = np.linalg.norm(at[rows][:, None] - part.vertices[None], axis=2)
        own = gaps.argmin(axis=1)
        answered = match.p2p[own] >= 0
        errors = self.away(match.p2p[own][answered], join.vertices_0[rows][answered])
        expected = np.nan
        if match.expected_error is not None:
            expected = np.nanmean(match.expected_error[own])
        counts = np.bincount(join.vertices_0, minlength=n_0)
        share = np.bincount(join.vertices_0, shown, minlength=n_0) / np.maximum(counts, 1)
        is_known, truth = counts > 0, share > 0.5
        covered = np.ones(n_0, dtype=bool) if match.covered is None else match.covered
        area = self.mass * is_known
        return {
            "area": part.area / mesh.area,
            "error": errors.mean() if len(errors) else 1.0,
            "median": np.median(errors) if len(errors) else 1.0,
            "expected": expected,
            "IoU": area @ (covered & truth) / (area @ (covered | truth)),
            "told wrong": area @ (~covered & truth) / (area @ truth),
            "told right": area @ (~covered & ~truth) / max(area @ ~truth, 1e-9),
            "unanswered": 1 - answered.mean(),
        }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=("cats", "faust", "creatures"))
    parser.add_argument("--n-test", type=int, help="number of shapes that are cut")
    parser.add_argument("--model", type=Path, help="file in which the fitted model is kept")
    parser.add_argument("--no-plain", action="store_true", help="skip the plain match")
    parser.add_argument("--cuts", nargs="+", default=("planes", "limbs", "views"))
    given = parser.parse_args()
    meshes, truths, train, test = collection_of(given.kind)
    test = test[: given.n_test]
    warnings.simplefilter("ignore")
    with threadpool_limits(limits=1):
        model = fitted(given.model, [meshes[i] for i in train], [truths[i] for i in train])
        rows = measured(model, meshes, truths, test, given)
    tell(rows)


def fitted(path, meshes, truths, n_cuts=12):
    """Return the fitted model, loaded from a file if it exists."""
    if path is not None and path.exists():
        return joblib.load(path)
    started = time.perf_counter()
    pipeline = make_pipeline(
        skfmap.SpectralBasis(),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(confidence=None),
    )
    model = skfmap.PartialMatcher(pipeline, n_cuts=n_cuts).fit(meshes, truths)
    print(f"fitted in {time.perf_counter() - started:.0f} s", flush=True)
    if path is not None:
        joblib.dump(model, path)
    return model


def measured(model, meshes, truths, test, given):
    """Return a row of figures for each part."""
    reference = model.estimator_[-1].reference_.spectral.mesh
    figures = Figures(reference, model.estimator_[-1].reference_.spectral)
    truth_0 = model.estimator_[-1].reference_correspondence_
    rows, n_parts, n_differ, n_torn = [], 0, 0, 0
    for i in test:
        join = truths[i].join(truth_0)
        whole, plain = (skfmap.match(one, [meshes[i]])[0] for one in (model, model.estimator_))
        n_parts += not whole.covered.all()
        n_differ += not np.array_equal(whole.p2p, plain.p2p)
        n_torn += whole.torn.any()
        for number, kind in enumerate(given.cuts):
            for share in AMOUNTS.get(kind, (0.7, 0.5)):
                part, posed = cut(meshes[i], kind, share, [i, number, int(100 * share)])
                started = time.perf_counter()
                (match,) = skfmap.match(model, [part])
                row = {"name": part.name, "kind": kind, "share": share}
                row["seconds"] = time.perf_counter() - started
                row["unfamiliar"] = float(match.familiar is False)
                row |= figures.of(match, part, posed, join)
                if kind in AMOUNTS:
                    row |= figures_of_tears(match, part, posed)
                row["plain"] = np.nan
                if not given.no_plain:
                    (match,) = skfmap.match(model.estimator_, [part])
                    row["plain"] = figures.of(match, part, posed, join)["error"]
                rows.append(row)
                told = ("error", "plain", "IoU", "torn", "tears found", "tears right", "expected")
                values = " ".join(f"{row[name]:.3f}" for name in told if name in row)
                print(f"{row['name']:<28} {values}", flush=True)
    print(f"whole shapes taken for parts: {n_parts} of {len(test)}; matched otherwise: {n_differ}")
    print(f"whole shapes reported to tear: {n_torn}")
    return rows


def tell(rows):
    """Print means by kind of cut and fraction of the area, with errors in sqrt(area)."""
    columns = [name for name in rows[-1] if name not in ("name", "kind", "share")]
    print(f"{'':<12}{'scans':>6}" + "".join(f"{name:>12}" for name in [*columns, "> 0.10"]))
    for kind, share in dict.fromkeys((row["kind"], row["share"]) for row in rows):
        own = [row for row in rows if (row["kind"], row["share"]) == (kind, share)]
        means = [np.nanmean([row.get(name, np.nan) for row in own]) for name in columns]
        bad = np.mean([row["error"] > 0.1 for row in own])
        print(
            f"{kind:<7}{share:>5}{len(own):>6}"
            + "".join(f"{value:>12.3f}" for value in [*means, bad])
        )
    ratio = np.nanmean([row["expected"] for row in rows]) / np.mean([row["error"] for row in rows])
    print(f"expected over true error: {ratio:.2f}")


if __name__ == "__main__":
    main()
