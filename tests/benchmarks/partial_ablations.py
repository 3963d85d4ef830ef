"""Two other ways to match parts, beside `skfmap.PartialMatcher`, on the cuts of `partial.py`.

    python tests/benchmarks/partial_ablations.py creatures
    python tests/benchmarks/partial_ablations.py cats

Mean errors in sqrt(area), by kind of cut: of the matcher; of its answer refined by ZoomOut between
eigenfunctions of the part and of the reference restricted to the cover that the matcher estimates,
with up to so many eigenfunctions; of equation (2) with the slanted mask of Rodola et al. 2017, from
local features and from what the recogniser makes of them, by nearest neighbours in the embedding;
and of the latter refined in the same way.
``--training`` cuts three training shapes instead, by which ``--mu`` was chosen.
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from partial import Figures, collection_of, cut, fitted
from scipy.sparse.linalg import eigsh
from threadpoolctl import threadpool_limits

from skfmap.functional.neighbours import nearest
from skfmap.geometry.laplacian import cotangent_laplacian
from skfmap.partial.recognition import features_of

K_0, K_LEAST, K_STEP, K_MOST = 100, 20, 10, (50, 120)
N_CUTS = 6  # parts of each training shape that are learned from
NARROWING = 0.03  # sigma of the slanted mask, as published


class Basis:
    """Eigenfunctions of a mesh of any number of pieces, in units of the reference."""

    def __init__(self, vertices, faces, k):
        stiffness, self.mass = cotangent_laplacian(vertices, faces)
        mass = sp.diags_array(self.mass).tocsc()
        k = min(k, len(vertices) - 2)
        start = np.random.default_rng(0).normal(size=len(vertices))
        self.evals, self.evecs = eigsh(stiffness, k, mass, sigma=-0.01, v0=start)

    def coefficients(self, values):
        """Return the coefficients of functions."""
        return self.evecs.T @ (self.mass[:, None] * values)


def slanted_mask(k_i, k_0, slope):
    """Return W of Rodola et al. 2017: far from the line m = slope l, and less so farther out."""
    m, n = np.arange(1, k_i + 1)[:, None], np.arange(1, k_0 + 1)[None]
    away = np.abs(m - slope * n) / np.hypot(1, slope)
    return np.exp(-NARROWING * np.hypot(m, n)) * away


def solved_slanted(basis_i, basis_0, values_i, values_0, mu):
    """Return the point map by equation (2) with the slanted mask."""
    slope = basis_i.mass.sum() / basis_0.mass.sum()
    k_i = min(max(int(np.ceil(slope * K_0)), K_LEAST), basis_i.evecs.shape[1])
    F_i, F_0 = basis_i.coefficients(values_i)[:k_i], basis_0.coefficients(values_0)
    size = np.linalg.norm(F_0) / np.sqrt(len(F_0))
    F_i, F_0 = F_i / size, F_0 / size
    W = slanted_mask(k_i, len(F_0), slope)
    gram, right = F_0 @ F_0.T, F_i @ F_0.T
    grams = gram + np.stack([np.diag(mu * w**2 + 1e-6) for w in W])
    C = np.linalg.solve(grams, right[:, :, None])[:, :, 0]
    return nearest(basis_i.evecs[:, :k_i] @ C, basis_0.evecs)


def refined(p2p, basis_i, basis_c, rows, vertices_0, k_most):
    """Return a point map refined by ZoomOut against the rows of the reference that are covered.

    As many eigenfunctions of the cover as have the frequencies of those of the part.
    """
    p2p = nearest(vertices_0[p2p], vertices_0[rows])
    for k_i in range(K_LEAST, min(k_most, basis_i.evecs.shape[1]) + 1, K_STEP):
        k_c = max(int(np.searchsorted(basis_c.evals, basis_i.evals[k_i - 1], "right")), 4)
        C = basis_i.coefficients(basis_c.evecs[p2p, :k_c])[:k_i]
        p2p = nearest(basis_i.evecs[:, :k_i] @ C, basis_c.evecs[:, :k_c])
    return rows[p2p]


def answers(model, scan, p2p, covered, mu):
    """Return point maps from a scan to the reference, by name."""
    regions, recogniser = model.body_.regions, model.body_.recogniser
    basis_i = Basis(scan.vertices, scan.faces, max(K_MOST))
    basis_0 = Basis(regions.vertices, regions.faces, K_0)
    faces_c = regions.faces[covered[regions.faces].all(axis=1)]
    rows, faces_c = np.unique(faces_c, return_inverse=True)
    basis_c = Basis(regions.vertices[rows], faces_c.reshape(-1, 3), 2 * max(K_MOST))
    cover = basis_i, basis_c, rows, regions.vertices
    found = {f"refined, {k}": refined(p2p, *cover, k) for k in K_MOST}
    features_0 = features_of(regions.vertices, regions.faces)
    both = [(x - recogniser.centre) / recogniser.scale for x in (scan.features, features_0)]
    both = [np.clip(x, -5, 5) for x in both]
    found["slanted, features"] = solved_slanted(basis_i, basis_0, *both, mu)
    likely = np.exp(recogniser.logarithms(scan.features))
    own = np.eye(len(regions.centres))[regions.distances.argmin(axis=0)]
    slanted = solved_slanted(basis_i, basis_0, likely, own, mu)
    found |= {"slanted, regions": slanted, "and refined": refined(slanted, *cover, min(K_MOST))}
    return found


def errors_of(model, figures, part, mesh, join, mu):
    """Return the mean errors of all ways on one part, by name."""
    laid = model._laid([part], [0])
    (match,) = model._matched([part], laid).values()
    row = {"matcher": figures.of(match, part, mesh, join)["error"]}
    scan, p2p = laid[0].scan, laid[0].laid.p2p
    own = nearest(laid[0].vertices, scan.vertices)
    for name, other in answers(model, scan, p2p, match.covered, mu).items():
        told = replace(match, p2p=np.where(match.p2p < 0, -1, other[own]))
        row[name] = figures.of(told, part, mesh, join)["error"]
    return row


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=("cats", "faust", "creatures"))
    parser.add_argument("--model", type=Path, help="file that keeps the fitted model")
    parser.add_argument("--mu", type=float, default=1e-2, help="weight of the slanted mask")
    parser.add_argument("--training", action="store_true", help="cut training shapes")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    meshes, truths, train, test = collection_of(given.kind)
    with threadpool_limits(limits=1):
        model = fitted(given.model, [meshes[i] for i in train], [truths[i] for i in train], N_CUTS)
        learner = model.estimator_[-1]
        figures = Figures(learner.reference_.spectral.mesh, learner.reference_.spectral)
        found = {}
        for i in train[1:4] if given.training else test:
            join = truths[i].join(learner.reference_correspondence_)
            for number, kind in enumerate(("planes", "limbs", "views")):
                for share in (0.7, 0.5):
                    part, mesh = cut(meshes[i], kind, share, [i, number, int(100 * share)])
                    row = errors_of(model, figures, part, mesh, join, given.mu)
                    found.setdefault(f"{kind} {share}", []).append(row)
                    print(part.name, *(f"{x:.3f}" for x in row.values()), flush=True)
    print(f"{'':<12}{'scans':>6}" + "".join(f"{name:>19}" for name in row))
    for name, rows in [*found.items(), ("all", [row for one in found.values() for row in one])]:
        means = [np.mean([row[column] for row in rows]) for column in rows[0]]
        print(f"{name:<12}{len(rows):>6}" + "".join(f"{x:>19.4f}" for x in means))


if __name__ == "__main__":
    main()
