"""Compiled code is stored, verified, loaded and shared; results are the same without Numba or without a store."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.common.process.checksums import DamagedFileError, read_parts, write_parts

pytestmark = pytest.mark.slow

ROOT = Path(hb.__file__).parent

NORMAL = """
import numpy as np
from hbgear.continuation.stepping.kernels import arclength_normal, predict
out, u = np.empty(3), np.array([[1.0, 2.0, 3.0], [0.8, 1.9, 2.7]])
arclength_normal(u[0], np.array([1.0, 2.0, 0.5]), out)
print(*out)
predict(u, u - 0.5, 2, np.array([1.0, 2.0, 0.5]), 0.1, out)
print(*out)
"""
"""Calls two kernels, which call kernels of another file."""

KERNELS = {"arclength_normal", "predict"}

EQUATIONS = """
import hashlib
import numpy as np
import hbgear as hb
problem = hb.HarmonicBalance(hb.SpurPair(), 8)
found = [problem.linearise(X, "Omega", Omega=0.8) for X in np.random.default_rng(1).normal(size=(20, problem.size))]
print(len(found), hashlib.sha256(b"".join(x.tobytes() for e in found for x in (e.R, e.dR_dX, e.dR_dp))).hexdigest())
"""
"""Prints a hash of the residuals and derivatives at 20 motions with contact loss."""

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
    """Start a process that stores its compiled code in a folder."""
    others = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    kept = {} if folder is None else {"NUMBA_CACHE_DIR": str(folder)}
    return subprocess.Popen(
        [sys.executable, "-c", script],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=package,
        env={**others, **kept, "PYTHONPATH": str(package)},
    )


def output_of(process):
    """Return the standard output and the standard error of a process; its exit code must be 0."""
    out, err = process.communicate(timeout=900)
    assert process.returncode == 0, err
    return out, err


def files(folder):
    """Return the size and the modification time of every file in a folder."""
    return {
        str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a folder with the compiled code of two kernels, and their output."""
    pytest.importorskip("numba")
    folder = tmp_path_factory.mktemp("compiled")
    return folder, output_of(start(NORMAL, folder))[0]


@pytest.fixture(scope="module")
def without_numba():
    """Trace curves without Numba in a separate process while other tests run."""
    process = start(WITHOUT)
    yield process
    process.kill()


def test_processes_that_compile_at_once_and_one_that_comes_later(tmp_path):
    """Two processes write a folder at the same time with identical results; a third one loads it and writes nothing."""
    pytest.importorskip("numba")
    together = [output_of(process) for process in [start(NORMAL, tmp_path) for _ in range(2)]]
    assert together[0][0] == together[1][0] and len(together[0][0].split()) == 6
    assert any("compiles its core for this processor: once" in err for _, err in together)
    before = files(tmp_path)
    assert {Path(name).name for name in before} == {f"hbgear.continuation.stepping.kernels.{name}" for name in KERNELS}
    assert len({Path(name).parts[0] for name in before}) == 1  # one folder for one version of the sources
    out, err = output_of(start(NORMAL, tmp_path))
    assert out == together[0][0] and err == ""
    assert files(tmp_path) == before


def _cut(content):
    return content[: len(content) // 2]


def _random(content):
    return np.random.default_rng(1).bytes(len(content))


def _flipped(content):
    at = len(content) // 2  # in the machine code
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


@pytest.mark.parametrize("damage", [_cut, _random, _flipped, lambda content: b"", lambda content: content + b"x"])
def test_damaged_code_is_compiled_again_with_one_warning(tmp_path, compiled, damage):
    """Damaged code is ignored: results are unchanged, no error is raised, and valid files are written."""
    folder, out = compiled
    shutil.copytree(folder, tmp_path / "kept")
    whole = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for path in (tmp_path / "kept").rglob("hbgear.*"):
        path.write_bytes(damage(path.read_bytes()))
    again, err = output_of(start(NORMAL, tmp_path / "kept"))
    assert again == out
    assert len(err.splitlines()) == 1 and "cannot be used" in err and "checksum" in err
    assert output_of(start(NORMAL, tmp_path / "kept")) == (out, "")
    assert {path.name for path in (tmp_path / "kept").rglob("hbgear.*")} == whole.keys()


def test_parts_of_a_file_are_those_written_or_an_error(tmp_path):
    """Reading detects a change of any single byte by the checksum."""
    parts = {"a": b"one", "b": bytes(range(40))}
    write_parts(tmp_path / "x", parts)
    assert read_parts(tmp_path / "x") == parts and read_parts(tmp_path / "none") == {}
    content = (tmp_path / "x").read_bytes()
    for at in range(len(content)):
        (tmp_path / "y").write_bytes(content[:at] + bytes([content[at] ^ 0x10]) + content[at + 1 :])
        with pytest.raises(DamagedFileError, match="checksum"):
            read_parts(tmp_path / "y")
    with pytest.raises(OSError):
        write_parts(tmp_path / "none" / "x", parts)
    assert {path.name for path in tmp_path.iterdir()} == {"x", "y"}


def test_a_folder_that_cannot_be_written(tmp_path):
    """A file has the path of the folder: code is compiled for this process, with one warning that names a remedy."""
    pytest.importorskip("numba")
    (tmp_path / "taken").touch()
    out, err = output_of(start(NORMAL, tmp_path / "taken"))
    expected = np.array([1.0, 0.5, 12.0]) / np.sqrt(145.25)  # u / scale^2
    np.testing.assert_allclose(np.array(out.split()[:3], dtype=float), expected, rtol=1e-15)
    assert len(err.splitlines()) == 1 and "in every process" in err and "NUMBA_CACHE_DIR" in err
    assert files(tmp_path) == {"taken": (0, (tmp_path / "taken").stat().st_mtime_ns)}


READ_ONLY = """
import os
from pathlib import Path
from hbgear.common.process import compiling
real = os.access
os.access = lambda path, mode: False if "kernels-" in str(path) else real(path, mode)  # root may write everywhere
"""


def test_a_complete_folder_that_cannot_be_written_is_read(tmp_path, compiled):
    """Nothing is compiled and no warning is issued; a kernel missing in the folder is compiled with one warning."""
    folder, out = compiled
    shutil.copytree(folder, tmp_path / "kept")
    before = files(tmp_path / "kept")
    assert output_of(start(READ_ONLY + NORMAL, tmp_path / "kept")) == (out, "")
    assert files(tmp_path / "kept") == before
    next((tmp_path / "kept").rglob("*.predict")).unlink()
    again, err = output_of(start(READ_ONLY + NORMAL, tmp_path / "kept"))
    assert again == out and len(err.splitlines()) == 1 and "in every process" in err


@pytest.mark.skipif(os.name == "nt", reason="limits of processes are those of POSIX")
@pytest.mark.parametrize("room", [0, 5_000])
def test_a_full_disk_does_not_stop_a_kernel(tmp_path, room):
    """A limit on the size of all files, also of temporary files of Numba, causes one warning and no error."""
    pytest.importorskip("numba")
    full = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))\n"
    out, err = output_of(start(full + NORMAL, tmp_path))
    assert len(out.split()) == 6 and "Traceback" not in err
    assert sum("in every process" in line for line in err.splitlines()) == 1
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def test_code_is_shared_between_copies_of_the_package(tmp_path, compiled):
    """The key of stored code does not contain the path of the package."""
    folder, out = compiled
    shutil.copytree(folder, tmp_path / "kept")
    shutil.copytree(ROOT, tmp_path / "elsewhere" / "hbgear", ignore=shutil.ignore_patterns("__pycache__"))
    before = files(tmp_path / "kept")
    assert output_of(start(NORMAL, tmp_path / "kept", tmp_path / "elsewhere")) == (out, "")
    assert files(tmp_path / "kept") == before


def test_functions_of_a_user_are_cached_elsewhere(tmp_path):
    """Numba caches a function of a user in its default folder while kernels are compiled in another thread."""
    pytest.importorskip("numba")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "own.py").write_text("import numba\n@numba.njit(cache=True)\ndef f(x):\n    return x + 1\n")
    script = f"""
import sys, threading, importlib, numba
sys.path.insert(0, {str(tmp_path / "mine")!r})
before, places, done = numba.config.CACHE_DIR, set(), threading.Event()
def watch():
    while not done.is_set():
        places.add(numba.config.CACHE_DIR)
        import own
        places.add(importlib.reload(own).f.stats.cache_path)
thread = threading.Thread(target=watch)
thread.start()
{NORMAL}
done.set()
thread.join()
print(*sorted(places))
"""
    others = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "user"), "PYTHONPATH": str(ROOT.parent)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=others | home, check=True, capture_output=True, text=True, timeout=900
    )
    assert done.stdout.splitlines()[-1].split() == [str(tmp_path / "mine" / "__pycache__")]
    assert {path.name for path in (tmp_path / "user").rglob("*") if path.is_file()} == {
        f"hbgear.continuation.stepping.kernels.{name}" for name in KERNELS
    }


def test_results_do_not_depend_on_whether_code_was_compiled_in_this_process(tmp_path):
    """Results are identical with code compiled here, by a concurrent process, after other kernels, and loaded."""
    pytest.importorskip("numba")
    first = "import numpy, hbgear as hb; hb.HarmonicBalance(hb.SpurPair(), 8).observe(numpy.ones(17), Omega=0.8)\n"
    together = [output_of(process)[0] for process in [start(EQUATIONS, tmp_path), start(first + EQUATIONS, tmp_path)]]
    loaded = output_of(start(EQUATIONS, tmp_path))[0]
    assert together == [loaded, loaded] and len(loaded.split()) == 2


PARALLEL = """
import time
import numpy as np
import hbgear as hb
from hbgear.cli import first, startup
from hbgear.common.process import compiling
startup.IS_COMMAND, first.processors = {command}, lambda: 2
problem = hb.HarmonicBalance(hb.SpurPair({stiffness}), 8)
with first.compile_in_parallel(problem):
    end = time.monotonic() + {seconds}
    last = compiling._store() / "hbgear.harmonic.equations.diagnostic_kernels.driven_response"
    while not last.exists() and time.monotonic() < end:
        time.sleep(0.05)
from hbgear.harmonic.multipliers.monodromy_kernels import monodromies
from hbgear.harmonic.equations.diagnostic_kernels import driven_response, extrema, truncated_force_harmonics
if {command}:
    problem.observe_many(np.ones((1, problem.size)), "Omega", np.array([0.8]))
    problem.multipliers(np.ones(problem.size), Omega=0.8)
    stats = [kernel._call.stats for kernel in (monodromies, extrema, truncated_force_harmonics, driven_response)]
    print(*(sum(one.cache_hits.values()) for one in stats), *(sum(one.cache_misses.values()) for one in stats))
print(compiling.is_missing(monodromies))
"""
"""Compiles in parallel as the first command does, without tracing; ``command=False`` stands for another program."""


@pytest.mark.parametrize("stiffness", ["", "stiffness=hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3)"])
def test_the_first_command_loads_code_of_another_process(tmp_path, stiffness):
    """The kernels of multipliers and observables are loaded, not compiled, with and without breakpoints."""
    pytest.importorskip("numba")
    out, err = output_of(start(PARALLEL.format(command=True, seconds=250, stiffness=stiffness), tmp_path))
    assert out == "1 1 1 1 0 0 0 0\nFalse\n" and err == ""


def test_a_program_that_is_not_the_command_starts_no_process(tmp_path):
    pytest.importorskip("numba")
    assert output_of(start(PARALLEL.format(command=False, seconds=0, stiffness=""), tmp_path))[0] == "True\n"
    assert files(tmp_path) == {}


@pytest.mark.parametrize(
    "model, sizes",
    [
        (hb.SpurPair(), None),
        (hb.SpurPair(stiffness=hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3)), (2, 0, 0)),
        (single_mass(hb.mechanics.Jenkins(k=1.0, limit=0.5), F=0.3), (0, 0, 1)),
    ],
)
def test_kernels_know_two_types_of_models(model, sizes):
    """A model without breakpoints, compiled laws and friction has no tables of them; any other model has all tables."""
    packed = hb.HarmonicBalance(model, 8).compiled({}).packed
    if sizes is None:
        assert packed[3:] == (None, None, None)
    else:
        assert (len(packed.piecewise.phases), len(packed.user_laws.element), len(packed.sliders.element)) == sizes


def test_products_and_sums_are_not_fused(tmp_path):
    """A fused a b + c rounds only once, and whether the compiler fuses it would depend on the surrounding code."""
    pytest.importorskip("numba")
    (tmp_path / "fused.py").write_text(
        "from hbgear.common.process.compiling import kernel\n@kernel\ndef f(a, b, c):\n    return a * b + c\n"
    )
    a = 1.0 + 2.0**-30
    script = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import fused\n"
    script += f"print(fused.f({a!r}, {a!r}, -1.0 - 2.0**-29))"
    assert output_of(start(script, tmp_path / "kept"))[0] == "0.0\n"  # 2^-60 with one rounding


def test_a_change_of_a_kernel_reaches_those_that_call_it(tmp_path):
    """A stored kernel contains the code of the kernels that it calls, here `scaled_norm` of another file."""
    pytest.importorskip("numba")
    shutil.copytree(ROOT, tmp_path / "own" / "hbgear", ignore=shutil.ignore_patterns("__pycache__"))
    first = output_of(start(NORMAL, tmp_path / "kept", tmp_path / "own"))[0]
    path = tmp_path / "own" / "hbgear" / "continuation" / "numerics" / "gauss_kernels.py"
    path.write_text(path.read_text().replace("return math.sqrt(total)", "return 2.0 * math.sqrt(total)", 1))
    second = output_of(start(NORMAL, tmp_path / "kept", tmp_path / "own"))[0]
    a, b = (np.array(text.split()[:3], dtype=float) for text in (first, second))
    np.testing.assert_allclose(b, a / 2, rtol=1e-15)
    assert len(list((tmp_path / "kept").iterdir())) == 2


def test_a_kernel_is_part_of_another_and_called_by_itself(tmp_path):
    """A kernel called by another one has no signature; compiling it later issues no message, because code is stored."""
    pytest.importorskip("numba")
    assert "compiles its core" in output_of(start(NORMAL, tmp_path))[1]
    by_itself = (
        "from hbgear.continuation.numerics.gauss_kernels import scaled_norm\nfound = [len(scaled_norm.signatures)]\n"
    )
    by_itself += "print(*found, scaled_norm(np.array([3.0, 4.0])), len(scaled_norm.signatures))\n"
    out, err = output_of(start(NORMAL + by_itself, tmp_path))
    assert out.splitlines()[-1] == "0 5.0 1" and err == ""


def test_arguments_of_another_type_are_compiled_for_and_stored(tmp_path):
    """The code for both types is stored in one file; a later process loads either one."""
    pytest.importorskip("numba")
    (tmp_path / "two.py").write_text(
        "from hbgear.common.process.compiling import kernel\n@kernel\ndef f(a):\n    return a + a\n"
    )
    begin = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import two\n"
    said = "\nprint(sum(two.f._call.stats.cache_hits.values()), sum(two.f._call.stats.cache_misses.values()))"
    both = begin + "print(two.f(1), two.f(2.5), len(two.f.signatures))" + said
    assert output_of(start(both, tmp_path / "kept"))[0] == "2 5.0 2\n0 2\n"
    assert output_of(start(both, tmp_path / "kept"))[0] == "2 5.0 2\n2 0\n"
    assert output_of(start(begin + "print(two.f(2.5))" + said, tmp_path / "kept"))[0] == "5.0\n1 0\n"


def test_arguments_of_the_same_classes_and_of_another_type_are_stored(tmp_path):
    """Tuples with arrays of different dimensions: a later process loads the code of both types and compiles nothing."""
    pytest.importorskip("numba")
    (tmp_path / "two.py").write_text(
        "from hbgear.common.process.compiling import kernel\n@kernel\ndef f(a):\n    return a[0].sum()\n"
    )
    script = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import two, numpy as np\n"
    script += "print(two.f((np.ones(2),)), two.f((np.ones((2, 2)),)), two.f((np.ones(3),)), len(two.f.signatures))"
    script += "\nprint(sum(two.f._call.stats.cache_hits.values()), sum(two.f._call.stats.cache_misses.values()))"
    assert output_of(start(script, tmp_path / "kept"))[0] == "2.0 4.0 3.0 2\n0 2\n"
    assert output_of(start(script, tmp_path / "kept"))[0] == "2.0 4.0 3.0 2\n2 0\n"
    wrong = script.partition("print")[0] + "two.f(('a',))"
    assert "TypingError" in start(wrong, tmp_path / "kept").communicate(timeout=600)[1]


def test_without_numba_the_same_curves_are_found(without_numba):
    """Special points and jumps agree with the compiled code; one warning reports the missing Numba."""
    out, err = output_of(without_numba)
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


@pytest.mark.skipif(os.name == "nt", reason="signals between processes are those of POSIX")
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_while_a_kernel_is_compiled(tmp_path, stop):
    """The command ends with one message and exit code 3 once the kernel is compiled; stored files are complete."""
    pytest.importorskip("numba")
    others = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = subprocess.Popen(
        [sys.executable, "-m", "hbgear", "trace", "spur-pair"],
        cwd=ROOT.parent,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**others, "NUMBA_CACHE_DIR": str(tmp_path)},
    )
    assert "compiles its core" in command.stderr.readline()
    time.sleep(1.0)  # the first kernel takes longer
    command.send_signal(stop)
    _, err = command.communicate(timeout=600)
    assert command.returncode == 3 and "Traceback" not in err, err
    assert err.splitlines()[-1].startswith("hbgear: ") and len(err.splitlines()) <= 2
    kept = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(kept) <= 2 and all(read_parts(path) for path in kept)


@pytest.mark.skipif(os.name == "nt", reason="signals between processes are those of POSIX")
def test_ctrl_c_while_numba_is_imported_is_not_taken_for_a_missing_numba(tmp_path):
    """Some extension modules of Numba raise ImportError when a KeyboardInterrupt occurs during their import."""
    (tmp_path / "numba.py").write_text(
        "import os, signal, time\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\n    time.sleep(0.1)\n"
        "except KeyboardInterrupt:\n    raise ImportError('_devicearray failed to import')\n"
    )
    for module in ("hbgear.common.process.compiling", "hbgear.mechanics.laws.c_callback"):
        program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import {module} as m; m.kernel(lambda: 1)()"
        ended = subprocess.run(
            [sys.executable, "-c", program], cwd=ROOT.parent, capture_output=True, text=True, timeout=60
        )
        assert ended.stderr.endswith("KeyboardInterrupt\n") and "times slower" not in ended.stderr


def test_whole_numbers_and_arrays_that_cannot_be_written_need_no_kernels_of_their_own():
    """Integers and read-only arrays are converted first: their types would require compiling all kernels again."""
    from hbgear.harmonic.equations.assembly_kernels import assemble_allocating
    from hbgear.harmonic.multipliers.monodromy_kernels import monodromies

    def curve(one, corner):
        law = hb.mechanics.PiecewiseLinear((-corner, corner), (one, 0 * one, one))
        load = hb.Load(constant=np.array([one]), cosine={1: np.array([one])})
        return hb.HarmonicBalance(hb.System([[one]], [[one / 5]], [[one]], [hb.Element([one], law)], load), 4)

    def evaluate_all(problem, X):
        problem.linearise(X, "Omega", Omega=1.0)
        problem.curvature(X, X, "Omega", Omega=1.0)
        problem.observe(X, Omega=1.0)
        problem.clearance(X, Omega=1.0)

    X = np.linspace(1.0, 2.0, 9)
    evaluate_all(curve(1.0, 0.5), X)
    known = [len(kernel.signatures) for kernel in (assemble_allocating, monodromies)]
    X.setflags(write=False)
    evaluate_all(curve(1, 1), X)
    assert [len(kernel.signatures) for kernel in (assemble_allocating, monodromies)] == known
