"""
Which parameters? A grid search
===============================

Does it pay to learn weights? How many eigenfunctions are enough, and how many training shapes?
Answers by cross-validation, with the same reference in every fold.
"""

# %%
# Nine creatures, each meshed on its own. The first is the reference, to which all are matched.
import tempfile

import numpy as np
from matplotlib import pyplot as plt
from sklearn.model_selection import GridSearchCV, learning_curve
from sklearn.pipeline import Pipeline

import skfmap
from skfmap.datasets import make_creatures
from skfmap.metrics import get_scorer
from skfmap.model_selection import PinnedReference

creatures = make_creatures(n_shapes=9, n_vertices=600)
X, y = creatures.meshes, creatures.correspondences

# %%
# A search compares scores only, so expected errors need not be calibrated (``confidence=None``),
# and matches need not be refined. With ``memory``, each basis, each set of probes and all distances
# are computed once for the whole search.
memory = tempfile.mkdtemp()
model = Pipeline(
    [
        ("basis", skfmap.SpectralBasis(n_components=60, memory=memory)),
        ("probes", skfmap.DescriptorTransformer(memory=memory)),
        (
            "learner",
            skfmap.WeightedFunctionalMapLearner(
                refine=None, confidence=None, tol=1e-3, memory=memory
            ),
        ),
    ]
)

# %%
# `PinnedReference` wraps any splitter and puts the reference into every training fold, so that all
# scores are distances on the same surface.
cv, scorer = PinnedReference(4), get_scorer("neg_geodesic_error")
weightings, sizes = ["function", "category", None], [10, 20, 35, 50]
search = GridSearchCV(
    model,
    {"learner__weighting": weightings, "learner__n_functions": sizes},
    cv=cv,
    scoring=scorer,
)
search.fit(X, y)
print("best:", search.best_params_, f"error {-search.best_score_:.4f}")

# %%
# Errors in percent of sqrt(area), with the standard error over the folds. Where the bars overlap,
# the search does not tell: take the simpler model.
results = search.cv_results_
figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
for weighting in weightings:
    rows = [i for i, p in enumerate(results["params"]) if p["learner__weighting"] == weighting]
    at = [results["params"][i]["learner__n_functions"] for i in rows]
    error = -100 * results["mean_test_score"][rows]
    spread = 100 * results["std_test_score"][rows] / np.sqrt(cv.get_n_splits(X, y))
    ax.errorbar(at, error, spread, capsize=3, marker="o", label=f"weighting={weighting!r}")
ax.set(xlabel="n_functions", ylabel="geodesic error, % of sqrt(area)", ylim=(0, None))
ax.legend()
plt.show()

# %%
# How many training shapes are enough? Without shuffling, the reference stays in front.
counts, _, scores = learning_curve(
    search.best_estimator_,
    X,
    y,
    train_sizes=[2, 3, 4, 6],
    cv=cv,
    scoring=scorer,
    shuffle=False,
)
for count, score in zip(counts, scores, strict=True):
    print(f"{count} shapes, the reference among them: error {-score.mean():.4f}")
