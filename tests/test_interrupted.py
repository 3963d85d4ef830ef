"""Work that is killed goes on from what was finished, and never reads half an entry."""

import multiprocessing
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from skfmap import Mesh, SpectralBasis, _working_mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import CacheWarning, MeshError

# Bases of bodies of which no two are alike; each that is computed is told.
_WORK = """
import hashlib
import skfmap.basis
from skfmap import Mesh, SpectralBasis
from skfmap.datasets import make_sphere

computed, original = [], skfmap.basis.laplacian_eigenbasis
skfmap.basis.laplacian_eigenbasis = lambda *a: computed.append(1) or original(*a)
ball = make_sphere(n_subdivisions=3)
stretched = [Mesh(ball.vertices * [1, 1, 1 + 0.1 * i], ball.faces) for i in range(12)]
tell("ready")
for mesh in stretched:
    (shape,) = SpectralBasis(20, memory=folder).transform([mesh])
    tell((hashlib.sha256(shape.evecs.tobytes()).hexdigest(), len(computed)))
"""


@pytest.fixture(scope="module")
def start():
    """Return a function that starts to work in a process: that, and where it tells of its work.

    Where it can be, it is forked from one that has imported the package, which takes longer than
    the work.
    """
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    context.set_forkserver_preload(["skfmap.basis", "skfmap.datasets"])

    def start_work(folder, code=_WORK):
        told, tell = context.Pipe(duplex=False)
        process = context.Process(
            target=exec, args=(code, {"folder": str(folder), "tell": tell.send})
        )
        process.start()
        tell.close()
        return process, told

    return start_work


def _rest(told):
    """Return what a process tells from now on."""
    with told:
        rest = []
        try:
            while told.poll(120):
                rest.append(told.recv())
        except (EOFError, OSError):  # it has ended, or was killed in the middle of a message
            return rest
    raise TimeoutError("Nothing was told for two minutes.")


def _finish(process, told):
    """Return the shapes that a process told of, and how many it computed itself."""
    _, *lines = _rest(told)
    process.join()
    assert process.exitcode == 0
    return [shape for shape, _ in lines], lines[-1][1]


@pytest.fixture(scope="module")
def undisturbed(start, tmp_path_factory):
    shapes, computed = _finish(*start(tmp_path_factory.mktemp("undisturbed")))
    assert len(set(shapes)) == computed == 12
    return shapes


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("seed", range(3))
def test_killed_at_any_moment_the_next_run_goes_on(start, tmp_path, undisturbed, seed):
    rng = random.Random(seed)
    finished = 0
    for _ in range(4):
        process, told = start(tmp_path)
        assert told.recv() == "ready"
        time.sleep(rng.uniform(0, 0.15))
        process.kill()
        process.join()
        finished = max(finished, len(_rest(told)))
    shapes, computed = _finish(*start(tmp_path))
    assert shapes == undisturbed
    assert computed <= 12 - finished  # what any run had told of is kept
    assert _finish(*start(tmp_path)) == (undisturbed, 0)


def test_two_processes_on_one_cache_share_the_work(start, tmp_path, undisturbed):
    both = [start(tmp_path), start(tmp_path)]
    results = [_finish(*one) for one in both]
    assert [shapes for shapes, _ in results] == [undisturbed, undisturbed]
    assert sum(computed for _, computed in results) == 12


def test_half_an_entry_is_computed_again(tmp_path):
    (whole,) = SpectralBasis(20, memory=str(tmp_path)).transform([make_sphere(3)])
    (entry,) = tmp_path.rglob("output.pkl")
    entry.write_bytes(entry.read_bytes()[:1000])
    (again,) = SpectralBasis(20, memory=str(tmp_path)).transform([make_sphere(3)])
    np.testing.assert_array_equal(again.evecs, whole.evecs)
    (third,) = SpectralBasis(20, memory=str(tmp_path)).transform([make_sphere(3)])  # whole again
    np.testing.assert_array_equal(third.evecs, whole.evecs)


_NO_ROOM = """
import resource, signal, warnings

warnings.showwarning = lambda message, *_: tell(str(message))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
"""


def test_on_a_full_disk_the_answer_comes_all_the_same(start, tmp_path):
    pytest.importorskip("resource")
    work = _WORK.replace("range(12)", "range(2)")
    process, told = start(tmp_path, _NO_ROOM + work)
    lines = _rest(told)
    process.join()
    assert process.exitcode == 0
    assert any("Unable to cache to disk" in line for line in lines if isinstance(line, str))
    full = [line[0] for line in lines if isinstance(line, tuple)]
    assert _finish(*start(tmp_path, work)) == (full, 2)  # nothing of the failed writing was read


def test_a_cache_that_cannot_be_written_to_is_read(tmp_path, monkeypatch):
    known, other = make_sphere(3), make_sphere(2)
    (first,) = SpectralBasis(20, memory=str(tmp_path)).transform([known])

    def read_only(path, *how, **options):
        raise PermissionError(30, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "mkdir", read_only)
    (again,) = SpectralBasis(20, memory=str(tmp_path)).transform([known])
    np.testing.assert_array_equal(again.evecs, first.evecs)
    with pytest.warns(
        CacheWarning, match="cannot be written to .*Read-only.*computed and not kept"
    ):
        (shape,) = SpectralBasis(20, memory=str(tmp_path)).transform([other])
    np.testing.assert_array_equal(shape.evecs, SpectralBasis(20).transform([other])[0].evecs)
    assert len(list(tmp_path.rglob("output.pkl"))) == 1


def test_a_cache_that_cannot_be_is_said_to_be_none(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(ValueError, match="cannot hold a cache"):
        SpectralBasis(20, memory=str(tmp_path / "file")).transform([make_sphere(3)])


def test_meshes_that_were_thinned_are_not_thinned_again(tmp_path, monkeypatch):
    """A run over large meshes that ends midway goes on from the ones that it had finished."""
    ball = make_sphere(n_subdivisions=4)
    meshes = [Mesh(ball.vertices * [1, 1, 1 + 0.1 * i], ball.faces, f"ball{i}") for i in range(3)]
    thinned, original = [], _working_mesh._thinned

    def counted(mesh, *key):
        thinned.append(mesh.name)
        return original(mesh, *key)

    monkeypatch.setattr(_working_mesh, "_thinned", counted)
    basis = SpectralBasis(20, max_vertices=500, memory=str(tmp_path), on_invalid="raise")
    flat = Mesh(np.zeros_like(ball.vertices), ball.faces, "flat")
    with pytest.raises(MeshError, match="flat"):
        basis.transform([*meshes[:2], flat, meshes[2]])
    assert thinned == ["ball0", "ball1"]
    shapes = basis.transform(meshes)
    assert thinned == ["ball0", "ball1", "ball2"]
    fresh = SpectralBasis(20, max_vertices=500).transform(meshes)
    for one, other in zip(shapes, fresh, strict=True):
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
