"""What a mean error hides: how much of the variation of bones estimated landmarks keep.

    python tests/benchmarks/shrinkage.py

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). Of the first
twenty mandibles in order of name, skfmap learns from the first ten and is scored on the others;
MALPACA's estimates, which learn from nobody, on these and on all twenty. In millimetres.
"""

import numpy as np
from landmarks import folds_of, measured, positions
from paper_experiment import DATA

from skfmap import Landmarks
from skfmap.landmarks import observer_error, shrinkage, stack_landmarks


def read(folder):
    """Return the landmarks of the first twenty mandibles, as a folder has them."""
    names = [path.stem for path in sorted((DATA / "mandibles").glob("*.ply"))[:20]]
    if not names:
        raise SystemExit(f"There are no meshes in {DATA / 'mandibles'}; set SKFMAP_DATA.")
    return [Landmarks(positions(folder / f"{name}_Landmarks.fcsv"), name=name) for name in names]


def report(title, predicted, true):
    """Print errors and shrinkage, of all landmarks and of each."""
    away = np.linalg.norm(stack_landmarks(predicted) - stack_landmarks(true), axis=2)
    found = shrinkage(predicted, true)
    print(f"{title}: mean error {away.mean():.3f} mm, {found}")
    for what, row in (("error", away.mean(axis=0)), ("ratio", found.per_landmark)):
        print(f"  {what}", *(f"{value:6.3f}" for value in row))


def main():
    by_hand = read(DATA / "mandibles")
    malpaca = read(DATA / "mandibles" / "malpaca")
    print(observer_error(by_hand))
    report("MALPACA, all twenty", malpaca, by_hand)
    report("MALPACA, the last ten", malpaca[10:], by_hand[10:])
    folds = folds_of("mandibles", 10, final=False)
    predicted = [Landmarks(measured(*fold), name=fold[1].name) for fold in folds]
    report("skfmap, the last ten", predicted, by_hand[10:])


if __name__ == "__main__":
    main()
