"""Packages and platforms: extras are complete, nothing depends on one operating system."""

import ast
import errno
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from hbgear.common import atomic_write as writing
from hbgear.common.atomic_write import CannotWrite, atomic_write

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOR_DEVELOPMENT = {"all", "docs", "test", "lint", "mutation"}

POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty", "posix"}
POSIX_NAMES = {
    "fork",
    "getuid",
    "geteuid",
    "getgid",
    "killpg",
    "getpgid",
    "setsid",
    "sysconf",
    "getloadavg",
    "uname",
    "mkfifo",
    "statvfs",
    "nice",
    "sched_getaffinity",
    "O_DIRECTORY",
    "O_NOFOLLOW",
    "O_CLOEXEC",
    "SIGKILL",
    "SIGALRM",
    "SIGHUP",
    "SIGUSR1",
    "SIGUSR2",
    "SIGPIPE",
    "SIGCHLD",
    "alarm",
    "setitimer",
    "pthread_sigmask",
    "pthread_kill",
}
GUARDED = {"pthread_sigmask": "design/studies/processes.py"}
"""Names whose presence is checked in a module before they are used."""


def test_all_is_every_extra_of_users():
    extras = PROJECT["optional-dependencies"]
    (entry,) = extras["all"]
    named = set(entry.partition("[")[2].rstrip("]").split(","))
    implied = {"report"}  # of explore
    assert named | implied == extras.keys() - FOR_DEVELOPMENT
    assert any(requirement.startswith("hbgear[report]") for requirement in extras["explore"])


def test_readme_names_the_extras_and_python():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in PROJECT["optional-dependencies"].keys() - FOR_DEVELOPMENT)
    assert f"Python {PROJECT['requires-python'].removeprefix('>=')} or newer" in text


def unportable(path, text):
    """Return the lines of a module that use names of one operating system, or the default encoding of the system."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            wrong = ({alias.name for alias in node.names} | {getattr(node, "module", "")}) & POSIX_MODULES
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("os", "signal"):
            wrong = node.attr in POSIX_NAMES and not path.endswith(GUARDED.get(node.attr, "?"))
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("read_text", "write_text"):
            wrong = "encoding" not in {keyword.arg for keyword in node.keywords}
        else:
            continue
        found += [f"{path}, line {node.lineno}"] if wrong else []
    return found


@pytest.mark.slow
def test_no_names_of_one_system_and_every_text_has_an_encoding():
    sources = {path.as_posix(): path.read_text(encoding="utf-8") for path in (ROOT / "hbgear").rglob("*.py")}
    assert [line for path, text in sources.items() for line in unportable(path, text)] == []


@pytest.mark.parametrize("text", ["import fcntl", "os.getuid()", "signal.SIGALRM", "path.read_text()"])
def test_names_of_one_system_are_found(text):
    assert unportable("a.py", text) == ["a.py, line 1"]


MISSING_ON_WINDOWS = """
import os, signal
for module, names in ((os, {os_names}), (signal, {signal_names})):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
import hbgear as hb
from hbgear.design.studies.processes import _delayed_ctrl_c
curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.0))
curve.save("curve.npz")
with _delayed_ctrl_c():
    print(hb.load("curve.npz").message)
"""


@pytest.mark.slow
def test_a_curve_is_traced_and_saved_without_posix_functions(tmp_path):
    program = MISSING_ON_WINDOWS.format(
        os_names=("sched_getaffinity", "getuid", "getloadavg", "sysconf"),
        signal_names=("pthread_sigmask", "SIGALRM", "SIGHUP", "SIGPIPE", "SIGUSR1", "setitimer"),
    )
    where = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=where, capture_output=True, text=True, timeout=300
    )
    assert (done.stdout, done.returncode) == ("Omega = 1 reached\n", 0), done.stderr


def test_a_rename_is_repeated_while_another_program_reads_the_file(tmp_path, monkeypatch):
    replace, refused = os.replace, iter([True, True, False])

    def replaced(source, target):
        if next(refused):
            raise PermissionError(errno.EACCES, "used by another process")
        replace(source, target)

    monkeypatch.setattr(writing, "_SHARING_VIOLATIONS", True)
    monkeypatch.setattr(writing, "_REPLACE_DELAYS", (0.0, 0.0, 0.0))
    monkeypatch.setattr(os, "replace", replaced)
    (tmp_path / "a.txt").write_text("old")
    with atomic_write(tmp_path / "a.txt", "x", encoding="utf-8") as file:
        file.write("new")
    assert (tmp_path / "a.txt").read_text() == "new" and next(refused, None) is None


def test_a_rename_that_stays_refused_keeps_the_old_file(tmp_path, monkeypatch):
    def refuse(source, target):
        raise PermissionError(errno.EACCES, "Used by another process")

    monkeypatch.setattr(writing, "_SHARING_VIOLATIONS", True)
    monkeypatch.setattr(writing, "_REPLACE_DELAYS", (0.0,))
    monkeypatch.setattr(os, "replace", refuse)
    (tmp_path / "a.txt").write_text("old")
    with (
        pytest.raises(CannotWrite, match="used by another process; the file that was there is unchanged"),
        atomic_write(tmp_path / "a.txt", "x", encoding="utf-8") as file,
    ):
        file.write("new")
    assert (tmp_path / "a.txt").read_text() == "old" and list(tmp_path.iterdir()) == [tmp_path / "a.txt"]


@pytest.mark.parametrize(("number", "written"), [(errno.EINVAL, True), (errno.ENOTSUP, True), (errno.ENOSPC, False)])
def test_file_systems_that_cannot_synchronise_are_written_and_full_ones_are_reported(
    tmp_path, monkeypatch, number, written
):
    def fsync(descriptor):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", fsync)
    try:
        with atomic_write(tmp_path / "a.txt", "x", encoding="utf-8") as file:
            file.write("new")
    except CannotWrite:
        assert not written
    assert (tmp_path / "a.txt").exists() is written


def test_ci_installs_the_packages():
    assert "stage .ci/package" in (ROOT / ".ci/full").read_text(encoding="utf-8")
    assert os.access(ROOT / ".ci/package", os.X_OK)
