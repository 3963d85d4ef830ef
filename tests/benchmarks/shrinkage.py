"""What a mean error hides: how much of the variation of bones estimated landmarks keep.

    python tests/benchmarks/shrinkage.py

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). MALPACA's
estimates on the first twenty mandibles in order of name, in millimetres.
"""

import numpy as np
from landmarks import positions
from paper_experiment import DATA

from skfmap import Landmarks
from skfmap.landmarks import observer_error, shrinkage, stack_landmarks


def main():
    paths = [path.with_suffix("") for path in sorted((DATA / "mandibles").glob("*.ply"))[:20]]
    if not paths:
        raise SystemExit(f"There are no meshes in {DATA / 'mandibles'}; set SKFMAP_DATA.")
    files = [path.with_name(f"{path.name}_Landmarks.fcsv") for path in paths]
    by_hand = [Landmarks(positions(file), name=file.stem) for file in files]
    malpaca = [
        Landmarks(positions(file.parent / "malpaca" / file.name), name=file.stem) for file in files
    ]
    away = np.linalg.norm(stack_landmarks(malpaca) - stack_landmarks(by_hand), axis=2)
    found = shrinkage(malpaca, by_hand)
    print(f"mean error {away.mean():.3f} mm; {observer_error(by_hand)}")
    print(found)
    for name, error, ratio in zip(found.names, away.mean(axis=0), found.per_landmark, strict=True):
        print(f"landmark {name:>2}  error {error:.3f} mm  ratio of variances {ratio:.2f}")


if __name__ == "__main__":
    main()
