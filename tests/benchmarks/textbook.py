"""Loss and gradient of equation (3) as a textbook would write them, for ``objective.py``.

A loop over shapes and over rows, a LAPACK solve for the map and another for the adjoint, and the
norm (4) by singular values and their derivatives.
"""

import numpy as np
import scipy.linalg


def loss_gradient(problem, weights, epsilon, solve=scipy.linalg.solve):
    """Return E(D) and its gradient in the squared weights, like `LearningProblem.loss_gradient`."""
    g_0 = problem.probes_0[1:]
    gram = (g_0 * weights**2) @ g_0.T
    loss, gradient = 0.0, np.zeros(len(weights))
    for g, penalty, C, share in zip(
        problem.probes, problem.penalties, problem.maps, problem.sample_weight, strict=True
    ):
        rhs = (g[1:] * weights**2) @ g_0.T
        X = np.stack(
            [solve(gram + np.diag(p), b) for p, b in zip(penalty[1:, 1:], rhs, strict=True)]
        )
        difference = -C[:, 1:]
        difference[1:] += X
        norm, R = norm_by_singular_values(difference, epsilon)
        adjoint = np.stack(
            [solve(gram + np.diag(p), r) for p, r in zip(penalty[1:, 1:], R[1:], strict=True)]
        )
        loss += share * norm
        gradient += share * ((adjoint @ g_0) * (g[1:] - X @ g_0)).sum(axis=0)
    return loss, gradient


def norm_by_singular_values(A, epsilon):
    """Return the norm (4) and its gradient; the derivative of a singular value is u v^T."""
    U, sigma, Vt = np.linalg.svd(A, full_matrices=False)
    derivative = 2 * sigma * epsilon / (sigma**2 + epsilon) ** 2
    return float((sigma**2 / (sigma**2 + epsilon)).sum()), (U * derivative) @ Vt
