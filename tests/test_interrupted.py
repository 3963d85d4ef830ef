"""Work that is killed goes on from what was finished, and never reads half an entry."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from skfmap import SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import CacheWarning

# Bases of bodies of which no two are alike; each that is computed is told.
_WORK = """
import sys
import numpy as np
import skfmap.basis
from skfmap import Mesh, SpectralBasis
from skfmap.datasets import make_sphere

computed, original = [], skfmap.basis.laplacian_eigenbasis
skfmap.basis.laplacian_eigenbasis = lambda *a: computed.append(1) or original(*a)
ball = make_sphere(n_subdivisions=4)
stretched = [Mesh(ball.vertices * [1, 1, 1 + 0.1 * i], ball.faces) for i in range(12)]
print("ready", flush=True)
for mesh in stretched:
    (shape,) = SpectralBasis(20, memory=sys.argv[1]).transform([mesh])
    print(f"{shape.evecs.tobytes().hex()[:4000]} {len(computed)}", flush=True)
"""


def _start(folder, **options):
    return subprocess.Popen(
        [sys.executable, "-c", _WORK, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def _finish(process):
    """Return the shapes that a process printed, and how many it computed itself."""
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    lines = [line.split() for line in out.splitlines()[1:]]
    return [shape for shape, _ in lines], int(lines[-1][1])


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    shapes, computed = _finish(_start(tmp_path_factory.mktemp("undisturbed")))
    assert computed == 12
    return shapes


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("seed", range(3))
def test_killed_at_any_moment_the_next_run_goes_on(tmp_path, undisturbed, seed):
    rng = random.Random(seed)
    finished = 0
    for _ in range(4):
        process = _start(tmp_path)
        assert process.stdout.readline() == "ready\n"
        time.sleep(rng.uniform(0, 0.25))
        process.send_signal(signal.SIGKILL)
        process.wait()
        done = len(process.stdout.read().splitlines())
        process.stdout.close()
        process.stderr.close()
        finished = max(finished, done)
    shapes, computed = _finish(_start(tmp_path))
    assert shapes == undisturbed
    assert computed <= 12 - finished  # what any run had told of is kept
    assert _finish(_start(tmp_path)) == (undisturbed, 0)


def test_two_processes_on_one_cache_share_the_work(tmp_path, undisturbed):
    both = [_start(tmp_path), _start(tmp_path)]
    results = [_finish(process) for process in both]
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


def test_on_a_full_disk_the_answer_comes_all_the_same(tmp_path):
    resource = pytest.importorskip("resource")
    code = _WORK.replace("range(12)", "range(2)")

    def no_room():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))

    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True, preexec_fn=no_room
    )
    full = [line.split()[0] for line in done.stdout.splitlines()[1:]]
    assert "Unable to cache to disk" in done.stderr
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()[1:]
    assert [line.split()[0] for line in lines] == full
    assert lines[-1].split()[1] == "2"  # nothing of the failed writing was read


def test_a_cache_that_cannot_be_written_to_is_read(tmp_path, monkeypatch):
    known, other = make_sphere(3), make_sphere(2)
    (first,) = SpectralBasis(20, memory=str(tmp_path)).transform([known])

    def read_only(path, *how, **options):
        raise PermissionError(30, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "mkdir", read_only)
    (again,) = SpectralBasis(20, memory=str(tmp_path)).transform([known])
    np.testing.assert_array_equal(again.evecs, first.evecs)
    with pytest.warns(CacheWarning, match="cannot be written to .*Read-only.*computed and not kept"):
        (shape,) = SpectralBasis(20, memory=str(tmp_path)).transform([other])
    np.testing.assert_array_equal(shape.evecs, SpectralBasis(20).transform([other])[0].evecs)
    assert len(list(tmp_path.rglob("output.pkl"))) == 1


def test_a_cache_that_cannot_be_is_said_to_be_none(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(ValueError, match="cannot hold a cache"):
        SpectralBasis(20, memory=str(tmp_path / "file")).transform([make_sphere(3)])
