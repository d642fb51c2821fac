"""Compiled code is kept, found again and shared; without Numba, or without a place to keep it, all works the same."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hbgear as hb
from hbgear.cli import support
from hbgear.common import compiling

ROOT = Path(hb.__file__).parent

NORMAL = """
import numpy as np
from hbgear.continuation.stepping import planes_normal, predict
out, u = np.empty(3), np.array([[1.0, 2.0, 3.0], [0.8, 1.9, 2.7]])
planes_normal(u[0], np.array([1.0, 2.0, 0.5]), out)
print(*out)
predict(u, u - 0.5, 2, np.array([1.0, 2.0, 0.5]), 0.1, out)
print(*out)
"""
"""Two kernels, with those they call in another file."""

WITHOUT = """
import json, sys
sys.modules["numba"] = None
import hbgear as hb
found = []
for H in (1, 2, 3):
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), H), "Omega", (0.8, 1.6))
    found.append([[p.label, p.parameters["Omega"], *p.X] for p in curve.special])
    found.append([[j.label, j.value] for j in curve.jumps()])
print(json.dumps(found))
"""


def start(script, folder=None, package=ROOT.parent):
    """A process of its own that keeps what it compiles in a folder."""
    others = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    kept = {} if folder is None else {"NUMBA_CACHE_DIR": str(folder)}
    return subprocess.Popen([sys.executable, "-c", script], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            cwd=package, env={**others, **kept, "PYTHONPATH": str(package)})  # fmt: skip


def told(process):
    """What a process printed, and what it warned of."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out, err


def files(folder):
    """Every file below a folder with its size and the time of its last change."""
    return {str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns)
            for path in folder.rglob("*") if path.is_file()}  # fmt: skip


@pytest.fixture(scope="module")
def without_numba():
    """A package that cannot be compiled, traced while other tests run."""
    process = start(WITHOUT)
    yield process
    process.kill()


def test_processes_that_compile_at_once_and_one_that_comes_later(tmp_path):
    """Two write the same folder at the same time and agree; a third one finds everything and writes nothing."""
    pytest.importorskip("numba")
    together = [told(process) for process in [start(NORMAL, tmp_path) for _ in range(2)]]
    assert together[0][0] == together[1][0] and len(together[0][0].split()) == 6
    assert any("compiles its core for this processor: once" in err for _, err in together)
    before = files(tmp_path)
    assert {Path(name).suffix for name in before} == {".nbi", ".nbc"}
    assert {Path(name).parts[0] for name in before} == {next(tmp_path.iterdir()).name}  # one state of the sources
    out, err = told(start(NORMAL, tmp_path))
    assert out == together[0][0] and err == ""
    assert files(tmp_path) == before


def test_a_folder_that_cannot_be_written(tmp_path):
    """A file stands where it should be: compiled for this process, and it says how to keep it."""
    pytest.importorskip("numba")
    (tmp_path / "taken").touch()
    out, err = told(start(NORMAL, tmp_path / "taken"))
    expected = np.array([1.0, 0.5, 12.0]) / np.sqrt(145.25)  # u / scale^2
    np.testing.assert_allclose(np.array(out.split()[:3], dtype=float), expected, rtol=1e-15)
    assert "anew in every process" in err and "NUMBA_CACHE_DIR" in err and "Traceback" not in err
    assert files(tmp_path) == {"taken": (0, (tmp_path / "taken").stat().st_mtime_ns)}


def test_a_change_of_a_kernel_reaches_those_that_call_it(tmp_path):
    """What is kept of a kernel holds the code of those it calls: `planes_normal` follows `length` in another file."""
    pytest.importorskip("numba")
    shutil.copytree(ROOT, tmp_path / "own" / "hbgear", ignore=shutil.ignore_patterns("__pycache__"))
    first = told(start(NORMAL, tmp_path / "kept", tmp_path / "own"))[0]
    path = tmp_path / "own" / "hbgear" / "continuation" / "elimination.py"
    path.write_text(path.read_text().replace("return math.sqrt(total)", "return 2.0 * math.sqrt(total)", 1))
    second = told(start(NORMAL, tmp_path / "kept", tmp_path / "own"))[0]
    a, b = (np.array(text.split()[:3], dtype=float) for text in (first, second))
    np.testing.assert_allclose(b, a / 2, rtol=1e-15)
    assert len(list((tmp_path / "kept").iterdir())) == 2


def test_a_kernel_is_part_of_another_and_called_by_itself(tmp_path):
    """As a part it gets no code of its own, whether the other is compiled or what it is made of found again."""
    pytest.importorskip("numba")
    by_itself = "from hbgear.continuation.elimination import length\nfound = [len(length.signatures)]\n"
    by_itself += "print(*found, length(np.array([3.0, 4.0])), len(length.signatures))\n"
    first, _, last = told(start(NORMAL + by_itself, tmp_path))[0].splitlines()
    assert last == "0 5.0 1"
    for kept in tmp_path.glob("kernels-*/*/stepping.planes_normal*"):
        kept.unlink()
    assert told(start(NORMAL + by_itself, tmp_path))[0].splitlines()[::2] == [first, last]


def test_whether_anything_is_compiled(tmp_path):
    """Until the folder is made, which is told, if it can be."""
    pytest.importorskip("numba")
    asked = "from hbgear.common.compiling import nothing_compiled as asked; print(asked(), asked())"
    out, err = told(start(asked, tmp_path / "new"))
    assert out == "True False\n" and err.count("compiles its core for this processor: once") == 1
    assert told(start(asked, tmp_path / "new")) == ("False False\n", "")
    (tmp_path / "taken").touch()
    assert told(start(asked, tmp_path / "taken"))[0] == "False False\n"


def test_another_numba_compiles_as_it_does_by_itself(tmp_path):
    """Of versions whose inside is not known nothing but their own ways is asked, for a kernel that calls others."""
    pytest.importorskip("numba")
    asked = """
import sys
import numpy as np
from hbgear.common import compiling
if OTHER:
    compiling._LAST = (0, 1)
from hbgear.continuation.algebra import solve_signed
x, _ = solve_signed(np.array([[0.0, 2.0], [4.0, 0.0]]), np.ones((2, 1)))
print(*x.ravel(), "hbgear.common.linking" in sys.modules)
"""
    for other, linked in ((False, "True"), (True, "False")):
        for _ in range(2):  # compiled, and found again
            out, err = told(start(asked.replace("OTHER", str(other)), tmp_path / str(other)))
            assert out.split() == ["0.25", "0.5", linked] and "Traceback" not in err


def test_what_two_processes_compile_is_what_a_curve_needs():
    """One what leads from point to point, the other what is asked of points and where special ones are."""
    pytest.importorskip("numba")
    asked = """
import hbgear as hb
from hbgear.cli.support import _followed, _observed
from hbgear.harmonic import assembly, carrying, locating, observing, pursuit
first = assembly.linear_part, pursuit.pursue, assembly.assembled
last = carrying.monodromies, observing.reach, observing.neglected, observing.driven, locating.located
def known():
    print(*(len(kernel.signatures) for kernel in (*first, *last)))
_followed() if ONE else _observed()
known()
hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6))
known()
"""
    for one, expected in ((True, "1 1 1 0"), (False, "0 0 0 1 1 1 1 1")):
        out = told(start(asked.replace("ONE", str(one))))[0].splitlines()
        assert out[0].startswith(expected)
        assert out[1] in ("1 1 0 1 1 1 1 1", "1 1 1 1 1 1 1 1")  # not every curve asks for the equations of one motion


def test_ctrl_c_while_a_curve_is_followed_to_compile_is_for_the_command(monkeypatch):
    """A trace ends with what it has, which nobody would see."""

    def pressed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(hb.HarmonicBalance, "pursuit", pressed)
    with pytest.raises(KeyboardInterrupt):
        support._followed()


def test_without_numba_the_same_curves_are_found(without_numba):
    """Some hundred times slower, which is said once."""
    out, err = told(without_numba)
    assert err.count("Numba cannot be imported") == 1 and "works without it" in err
    found = json.loads(out)
    for H in (1, 2, 3):
        curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), H), "Omega", (0.8, 1.6))
        special, jumps = found[2 * H - 2 : 2 * H]
        assert [label for label, *_ in special] == [p.label for p in curve.special] == ["LP1", "LP2"]
        for (_, Omega, *X), point in zip(special, curve.special, strict=True):
            assert Omega == pytest.approx(point.parameters["Omega"], rel=0, abs=1e-9)
            np.testing.assert_allclose(X, point.X, rtol=0, atol=1e-6)
        assert [label for label, _ in jumps] == [jump.label for jump in curve.jumps()]
        np.testing.assert_allclose([x for _, x in jumps], [jump.value for jump in curve.jumps()], rtol=0, atol=1e-8)


def test_ctrl_c_waits_until_a_kernel_is_compiled():
    event = pytest.importorskip("numba.core.event")
    assert compiling._numba() is not None
    reached = False
    with pytest.raises(KeyboardInterrupt):
        event.start_event("numba:compiler_lock")
        try:
            event.start_event("numba:compiler_lock")  # a kernel that this one calls
            signal.raise_signal(signal.SIGINT)
            event.end_event("numba:compiler_lock")
            reached = True
        finally:
            event.end_event("numba:compiler_lock")
    assert reached


@pytest.mark.skipif(os.name == "nt", reason="signals between processes are those of POSIX")
def test_ctrl_c_while_numba_is_imported_is_not_taken_for_a_missing_numba(tmp_path):
    """Some of its extension modules say ImportError when a KeyboardInterrupt comes up in them."""
    (tmp_path / "numba.py").write_text(
        "import os, signal, time\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\n    time.sleep(0.1)\n"
        "except KeyboardInterrupt:\n    raise ImportError('_devicearray failed to import')\n"
    )
    for module in ("hbgear.common.compiling", "hbgear.mechanics.calling"):
        program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import {module} as m; m.kernel(lambda: 1)"
        ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT.parent, capture_output=True, text=True,
                               timeout=60)  # fmt: skip
        assert ended.stderr.endswith("KeyboardInterrupt\n") and "times slower" not in ended.stderr


def test_whole_numbers_and_arrays_that_cannot_be_written_need_no_kernels_of_their_own():
    """Each would be of another type, for which everything is compiled again."""
    from hbgear.harmonic.assembly import assembled
    from hbgear.harmonic.carrying import monodromies

    def curve(one, corner):
        law = hb.PiecewiseLinear((-corner, corner), (one, 0 * one, one))
        load = hb.Load(constant=np.array([one]), cosine={1: np.array([one])})
        return hb.HarmonicBalance(hb.System([[one]], [[one / 5]], [[one]], [hb.Element([one], law)], load), 4)

    def looked_at(problem, X):
        problem.linearise(X, "Omega", Omega=1.0)
        problem.curvature(X, X, "Omega", Omega=1.0)
        problem.observe(X, Omega=1.0)
        problem.clearance(X, Omega=1.0)

    X = np.linspace(1.0, 2.0, 9)
    looked_at(curve(1.0, 0.5), X)
    known = [len(kernel.signatures) for kernel in (assembled, monodromies)]
    X.setflags(write=False)
    looked_at(curve(1, 1), X)
    assert [len(kernel.signatures) for kernel in (assembled, monodromies)] == known


LEFT = """
from numba.core.runtime import _nrt_python, rtsys
import hbgear as hb
_nrt_python.memsys_enable_stats()
problem = hb.HarmonicBalance(hb.SpurPair(), 5)
hb.trace(problem, "Omega", (0.6, 1.2))
before = rtsys.get_allocation_stats()
for _ in range(3):
    hb.trace(problem, "Omega", (0.6, 1.2))
after = rtsys.get_allocation_stats()
print(after.alloc > before.alloc, after.alloc - after.free - before.alloc + before.free)
"""


def test_kernels_throw_away_what_they_make():
    """Arrays that another kernel returned to one that does not count references would be left for ever."""
    out = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["True", "0"]
