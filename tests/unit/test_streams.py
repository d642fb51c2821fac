"""Commands whose terminal, streams, current folder or files are not as usual: one sentence, no traceback."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hbgear as hb
from hbgear.cli.output import listed

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="needs the devices and shell of Linux"),
]
ROOT = str(Path(hb.__file__).parents[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("streams")
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.3)).save(found / "F.npz")
    os.symlink("/dev/zero", found / "zero.toml")
    os.mkfifo(found / "fifo.toml")
    return found


def shell(folder, line, limit=60):
    """Exit code, and what is written to standard error, of a line of the shell; hbgear is the command."""
    file = folder / "err.txt"
    line = line.replace("hbgear", f"{sys.executable} -m hbgear")
    script = f"exec 3>'{file}'\n{line}"
    env = {**os.environ, "PYTHONPATH": ROOT, "COLUMNS": "120"}
    ended = subprocess.run(["bash", "-c", script], cwd=folder, env=env, timeout=limit, capture_output=True, text=True)
    return ended.returncode, file.read_text(), ended.stdout


PRINTED = "hbgear: error: the result could not be printed ({}); the output files are written\n"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("hbgear info F.npz >&- 2>&3", PRINTED.format("standard output is closed")),
        ("hbgear --version >&- 2>&3", PRINTED.format("standard output is closed")),
        ("hbgear info F.npz >/dev/full 2>&3", PRINTED.format("No space left on device")),
        ("hbgear models >/dev/full 2>&3", PRINTED.format("No space left on device")),
        ("hbgear --help >/dev/full 2>&3", PRINTED.format("No space left on device")),
        ("hbgear follow F.npz LP1 --in zeta=0.05:0.051 >&- 2>&3", PRINTED.format("standard output is closed")),
        (
            "hbgear backbone duffing --harmonics 3 --amplitudes 0.01:0.02 >/dev/full 2>&3",
            PRINTED.format("No space left on device"),
        ),
        ("hbgear info no.npz 2>/dev/full", ""),
        ("hbgear info no.npz 2>&-", ""),
        ("hbgear info no.npz <&- >&- 2>&-", ""),
    ],
)
def test_characters_that_cannot_be_printed(folder, line, said):
    assert shell(folder, line)[:2] == (2, said)


def test_a_file_is_written_though_nothing_can_be_printed(folder):
    code, said, _ = shell(folder, "hbgear trace duffing --harmonics 3 --to 0.6 --no-stability -o G.npz >&- 2>&3")
    assert (code, said) == (2, PRINTED.format("standard output is closed"))
    whole = (folder / "G.npz").read_bytes()
    assert len(hb.load(folder / "G.npz")) > 2
    for closed in ("<&-", "<&- >&-", "<&- >&- 2>&-"):
        (folder / "G.npz").unlink()
        code, _, _ = shell(folder, f"hbgear trace duffing --harmonics 3 --to 0.6 --no-stability -o G.npz {closed}")
        assert code == (0 if closed == "<&-" else 2) and len((folder / "G.npz").read_bytes()) == len(whole)


@pytest.mark.parametrize("command", ["trace", "study", "speed", "campbell", "explore --no-browser", "backbone"])
@pytest.mark.parametrize("file", ["zero.toml", "fifo.toml"])
def test_a_device_or_pipe_is_no_file(folder, command, file):
    code, said, _ = shell(folder, f"ulimit -v 8000000; hbgear {command} {file} 2>&3", limit=30)
    assert code == 2 and said.count("\n") == 1 and "it is a pipe, a device or a socket; need a regular file" in said


def test_a_file_without_end_is_refused(folder):
    with (folder / "long.toml").open("wb") as handle:
        handle.truncate(10**10)
    code, said, _ = shell(folder, "hbgear trace long.toml 2>&3", limit=30)
    assert code == 2 and "it has more than 32 MiB; need a smaller file" in said


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("info F.npz", "there is no file 'F.npz'"),
        ("trace duffing -o x.npz", "the current folder does not exist any more"),
        ("trace x.py:y", "the current folder does not exist any more"),
        ("backbone duffing", "the current folder does not exist any more"),  # Numba imports a library that reads it
        ("certify F.npz", "there is no file 'F.npz'"),
        ("study a.toml", "No such file or directory"),
        ("trace a.toml", "No such file or directory"),
        ("report F.npz", "the current folder does not exist any more"),
    ],
)
def test_a_current_folder_that_was_removed(folder, command, said):
    code, err, _ = shell(folder, f"mkdir gone; cd gone; rmdir ../gone; hbgear {command} 2>&3")
    assert code == 2 and err.count("\n") == 1 and said in err and "Errno" not in err


@pytest.mark.parametrize("trace", [1, [], "x", {"span": 3}, {"span": [1]}, {"span": ["a", "b"]}, {"accuracy": "x"}])
def test_a_curve_with_an_invalid_trace_in_its_header(folder, trace):
    with np.load(folder / "F.npz") as file:
        arrays = dict(file)
    header = json.loads(str(arrays["header"]))
    header["branch"]["meta"]["trace"] = trace
    arrays["header"] = np.array(json.dumps(header))
    np.savez(folder / "bad.npz", **arrays)
    for command in ("info", "report", "extend"):
        code, said, _ = shell(folder, f"hbgear {command} bad.npz 2>&3")
        assert code == 2 and said.count("\n") == 1 and "trace" in said and "of its header is" in said
        if trace != 1:
            break


# ---- a narrow terminal


def on_terminal(folder, columns, *args):
    """What is printed on a terminal of that width."""
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    env = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    env |= {"PYTHONPATH": ROOT, "TERM": "xterm", "NO_COLOR": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", "hbgear", *args], cwd=folder, env=env, stdin=theirs, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    parts = []
    while True:
        try:
            data = os.read(ours, 65536)
        except OSError:
            break
        if not data:
            break
        parts.append(data)
    os.close(ours)
    process.wait(60)
    return re.sub(r"\x1b\[[0-9;]*m", "", b"".join(parts).decode()).replace("\r", "")


@pytest.mark.parametrize("args", [("info", "F.npz"), ("models",), ("info", "--help"), ("study", "--help")])
def test_a_narrow_terminal_cuts_no_words(folder, args):
    """Every word of the wide output is one of the narrow one too."""
    narrow, wide = (on_terminal(folder, columns, *args) for columns in (40, 400))
    words = {word for word in re.findall(r"[A-Za-z][A-Za-z_.]{5,}", wide)}
    assert len(words) > 5 and "\u2026" not in narrow
    shown = set(re.findall(r"[A-Za-z][A-Za-z_.]{5,}", narrow))
    assert words - shown <= {"Arguments", "Options"}
    assert [line for line in narrow.splitlines() if len(line) > 40 and " " in line.strip()] == []


def test_cells_of_a_table_in_lines():
    found = listed(["", "meaning"], [["LP1", "the curve turns back\nhere"], ["BP1", "-"]], "points", 20)
    first = ["points", "", "LP1", "meaning: the curve", "  turns back", "  here"]
    assert found.splitlines() == [*first, "", "BP1", "meaning: -"]
