"""Files appear whole or not at all, and a result is not lost because its place fails."""

import os
import pickle
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.common.atomic_write import CannotWrite, atomic_write, check_writable

posix = pytest.mark.skipif(os.name != "posix", reason="needs the devices and limits of POSIX")
LIMIT = 70_000  # bytes a file may have: more than is written to see whether one can be, less than a curve takes
CURVE = ["trace", "duffing", "--harmonics", "40"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return tmp_path


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.Duffing(), 40), "Omega", (0.5, 1.6))


def limited(code, size=LIMIT):
    """Python code run where no file can grow beyond a size, after a short trace that loads the compiled code."""
    first = "import resource, hbgear as hb; hb.trace(hb.HarmonicBalance(hb.Duffing(), 40), 'Omega', (0.8, 0.81))\n"
    first += f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, resource.RLIM_INFINITY))\n"
    env = {**os.environ, "PYTHONPATH": str(Path(hb.__file__).parents[1])}
    return subprocess.run([sys.executable, "-c", first + code], capture_output=True, text=True, timeout=600, env=env)


def command(args):
    return f"from hbgear.cli.app import main; main({args!r})"


# ---- the library


@pytest.mark.slow
@posix
def test_save_that_fails_leaves_the_old_file_whole(folder, curve):
    curve.save("a.npz")
    before = Path("a.npz").read_bytes()
    assert len(before) > LIMIT
    for name in ("a.npz", "new.npz"):
        out = limited(f"import hbgear as hb; hb.load('a.npz').save('{name}')")
        assert f"CannotWrite: cannot write '{name}': file too large" in out.stderr
    assert Path("a.npz").read_bytes() == before and os.listdir() == ["a.npz"]


def test_longest_names_are_saved(folder, curve):
    name = "x" * 251 + ".npz"
    curve.save(name)
    assert len(hb.load(name)) == len(curve) and os.listdir() == [name]


def test_stored_files_are_synchronised_first(folder, monkeypatch):
    did = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda number: (did.append(os.fstat(number).st_ino), fsync(number)))
    monkeypatch.setattr(os, "replace", lambda a, b: (did.append("renamed"), replace(a, b)))
    with atomic_write("a.txt", "x") as handle:
        handle.write("text")
    file, place = os.stat("a.txt").st_ino, os.stat(".").st_ino
    assert did == ([file, "renamed", place] if os.name == "posix" else [file, "renamed"])


@posix
def test_a_link_is_followed_and_a_device_never_replaced(folder):
    Path("target.txt").write_text("before")
    os.symlink("target.txt", "link.txt")
    with atomic_write("link.txt", "x") as handle:
        handle.write("text")
    assert os.path.islink("link.txt") and Path("target.txt").read_text() == "text"
    os.symlink("/dev/full", "full.txt")
    with pytest.raises(CannotWrite, match=r"'full.txt': it is a device"), atomic_write("full.txt"):
        pass


def test_a_failure_of_the_disk_is_reported_as_such(folder):
    with pytest.raises(CannotWrite, match="no space") as error, atomic_write("a") as handle:
        try:
            handle.write(b"half")
            raise OSError(28, "No space left on device")
        finally:
            raise ValueError("cannot close the archive")
    assert error.value.errno == 28 and not os.listdir()
    again = pickle.loads(pickle.dumps(error.value))
    assert (str(again), again.errno) == (str(error.value), 28)
    with pytest.raises(ValueError, match="a bug"), atomic_write("a"):
        raise ValueError("a bug")


# ---- commands: before the work


@posix
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("file/a", "not a directory"),
        ("/proc/a", "no file can be made in '/proc'"),
        ("full", "it is a device or pipe"),
        ("x" * 260, "file name too long"),
    ],
)
def test_unwritable_places_are_refused_before_the_work(folder, run, monkeypatch, curve, place, words):
    Path("file").write_text("")
    for suffix in (".npz", ".png", ".csv"):
        os.symlink("/dev/full", f"full{suffix}")
    monkeypatch.setattr(hb, "trace", lambda *_, **__: pytest.fail("traced"))
    before = sorted(os.listdir())
    for args in (
        [*CURVE, "-o", f"{place}.npz"],
        [*CURVE, "--plot", f"{place}.png"],
        ["map", "spur-pair", "--in", "zeta=0.1:0.2", "-o", f"{place}.csv"],
        ["sweep", "duffing", "-o", f"{place}.csv"],
    ):
        code, out, err = run(*args)
        assert (code, out) == (2, "") and err.count("\n") == 1 and words in err
    assert sorted(os.listdir()) == before


@pytest.mark.slow
@posix
def test_a_full_disk_is_seen_before_the_work(folder):
    out = limited(f"import hbgear as hb; hb.trace = None; {command([*CURVE, '-o', 'a.npz'])}", 4096)
    assert out.returncode == 2 and "cannot write 'a.npz': file too large" in out.stderr and not os.listdir()


# ---- commands: after it


def test_a_place_that_goes_away_during_the_work(folder, run, monkeypatch):
    trace = hb.trace

    def slow(*args, **options):
        shutil.rmtree("place")
        return trace(*args, **options)

    monkeypatch.setattr(hb, "trace", slow)
    os.mkdir("place")
    Path("a.npz").write_text("mine")
    code, out, err = run(*CURVE, "-o", "place/a.npz", "--plot", "place/a.png")
    assert code == 2 and "jumps of a slow sweep" in out and "wrote" in out
    assert "cannot write 'place/a.npz': there is no folder 'place'" in err and "'place/a.png'" in err
    assert f"kept as '{folder / 'a-2.npz'}' instead" in err and Path("a.npz").read_text() == "mine"
    assert hb.load("a-2.npz").status.complete and Path("a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@posix
def test_a_result_that_cannot_be_kept_anywhere_is_printed(folder):
    out = limited(command([*CURVE, "-o", "a.npz"]))
    assert out.returncode == 2 and "jumps of a slow sweep" in out.stdout and "wrote" not in out.stdout
    assert "cannot write 'a.npz': file too large" in out.stderr and "could not be kept" in out.stderr
    assert not os.listdir()


@contextmanager
def small_disk(path, size):
    path.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", path], capture_output=True)
    if done.returncode:
        pytest.skip("needs the right to mount")
    try:
        yield path
    finally:
        subprocess.run(["umount", path], check=True)


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="needs the right to mount")
def test_a_full_disk(folder, run, curve):
    with small_disk(folder / "disk", LIMIT) as disk:
        code, out, err = run(*CURVE, "-o", disk / "a.npz")
        assert code == 2 and "jumps of a slow sweep" in out and "no space left on device" in err
        assert np.array_equal(hb.load("a.npz").values, curve.values) and not os.listdir(disk)
        (disk / "rest").write_bytes(bytes(os.statvfs(disk).f_bavail * os.statvfs(disk).f_frsize))
        code, out, err = run(*CURVE, "-o", disk / "a.npz")
        assert (code, out) == (2, "") and "no space left on device; give another place" in err


def test_a_figure_that_fails_costs_nothing_else(folder, capsys, monkeypatch):
    monkeypatch.setattr(hb.plot, "response", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cli.main([*CURVE, "-o", "a.npz", "--plot", "a.png"])
    assert "wrote a.npz" in (out := capsys.readouterr().out) and "jumps of a slow sweep" in out
    assert os.listdir() == ["a.npz"] and len(hb.load("a.npz"))


@pytest.mark.slow
@posix
def test_output_that_cannot_be_printed(folder):
    with open("/dev/full", "w") as full:
        out = subprocess.run(
            [sys.executable, "-c", command([*CURVE, "-o", "a.npz"])],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(hb.__file__).parents[1])},
            timeout=600,
        )
    assert out.returncode == 2 and "No space left on device" in out.stderr and "Exception" not in out.stderr
    assert len(hb.load("a.npz"))


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o666])
def test_a_file_written_again_keeps_its_permissions(tmp_path, mode):
    path, seen = tmp_path / "a.txt", []
    path.write_text("before")
    path.chmod(mode)
    with atomic_write(path, "x") as handle:
        seen += [each.stat().st_mode & 0o777 for each in tmp_path.iterdir() if each != path]
        handle.write("after")
    assert path.read_text() == "after" and path.stat().st_mode & 0o777 == mode
    assert seen == [mode]  # no moment at which others may read what they may not


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_a_new_file_has_the_permissions_of_the_user(tmp_path):
    (tmp_path / "usual").touch()
    with atomic_write(tmp_path / "a.txt", "x") as handle:
        handle.write("new")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "usual").stat().st_mode


@pytest.mark.parametrize("write", [check_writable, lambda path: atomic_write(path, "x").__enter__()])
def test_a_link_that_leads_nowhere_is_refused(tmp_path, write):
    (tmp_path / "link.npz").symlink_to(tmp_path / "elsewhere.npz")
    with pytest.raises(CannotWrite, match=r"is a link to '.*elsewhere.npz', which does not exist; remove the link"):
        write(tmp_path / "link.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["link.npz"]
    (tmp_path / "elsewhere.npz").touch()
    check_writable(tmp_path / "link.npz")
