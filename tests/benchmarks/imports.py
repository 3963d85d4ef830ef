"""How long ``import skfmap`` takes beside its own heaviest dependency.

python tests/benchmarks/imports.py
"""

import statistics
import subprocess
import sys

MODULES = (
    "skfmap",
    "sklearn.base",
    "sklearn.linear_model",
    "scipy.sparse.linalg",
    "igl",
    "potpourri3d",
)
REPEATS = 7
CODE = "import time; t = time.perf_counter(); import {0}; print(time.perf_counter() - t)"


def main():
    seconds = {module: [] for module in MODULES}
    for _ in range(REPEATS):
        for module, own in seconds.items():
            done = subprocess.run(
                [sys.executable, "-c", CODE.format(module)],
                capture_output=True,
                text=True,
                check=True,
            )
            own.append(float(done.stdout))
    medians = {module: statistics.median(own) for module, own in seconds.items()}
    for module, median in medians.items():
        print(
            f"{module:<24}{median:>7.2f} s   skfmap takes {medians['skfmap'] / median:.2f} times "
            "that"
        )
    code = (
        "import skfmap, sys; heavy = ('trimesh', 'matplotlib', 'pyvista'); "
        "print([m for m in heavy if m in sys.modules] or 'none')"
    )
    subprocess.run(
        [
            sys.executable,
            "-c",
            f"print('of trimesh, matplotlib, pyvista imported:', end=' '); {code}",
        ],
        check=True,
    )


if __name__ == "__main__":
    main()
