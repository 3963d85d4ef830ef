"""All default probe functions of meshes of growing size: time and peak memory.

    python tests/benchmarks/probes.py

Meshes of 5,000 vertices (a creature), and spheres of 4,098, 16,386 and 65,538; a TOSCA cat of
27,894 if the data folder is there. One thread; basis computed before. Memory is what numpy
allocated at most, over what was there.
"""

import tracemalloc

from problems import DATA
from timing import median_seconds, one_thread

from skfmap import DescriptorTransformer, SpectralBasis
from skfmap.datasets import make_creatures, make_sphere
from skfmap.io import as_meshes


def meshes():
    yield make_creatures(1, 5000).meshes[0]
    yield from as_meshes(sorted((DATA / "tosca_full").glob("cat0*"))[:1]) if DATA.is_dir() else ()
    for n_subdivisions in (5, 6, 7):
        yield make_sphere(n_subdivisions)


def main():
    transformer = DescriptorTransformer()
    for mesh in meshes():
        shapes = SpectralBasis(n_jobs=1).transform([mesh])
        with one_thread():
            seconds = median_seconds(
                {"probes": lambda shapes=shapes: transformer.transform(shapes)}, 3
            )["probes"]
        tracemalloc.start()
        transformer.transform(shapes)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        n = mesh.n_vertices
        print(
            f"{n:>8} vertices{seconds:>8.2f} s{1e6 * seconds / n:>8.1f} us a "
            f"vertex{peak / n / 1024:>8.1f} KiB a vertex"
        )


if __name__ == "__main__":
    main()
