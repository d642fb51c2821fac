"""Studies of many cases: samples, stored results, resuming after a kill, full disks, invalid stores."""

import csv
import dataclasses
import errno
import json
import os
import signal
import struct
import subprocess
import sys
import time
import warnings
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from machines import gear_pair
from scipy import stats

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.design.studies import case_work
from hbgear.design.studies.samples import distribution, grid, latin_hypercube, monte_carlo
from hbgear.design.studies.store import Result, Store
from hbgear.design.studies.study import cases
from hbgear.design.studies.study_file import read_study

DUFFING = hb.Duffing(zeta=0.05, k3=1.0, F=0.15)
SPAN = (0.5, 2.0)

STUDY = """model = "duffing"
[base]
k3 = 1.0
[sample]
count = {count}
[sample.parameters]
zeta = ["uniform", 0.03, 0.06]
F = ["uniform", 0.1, 0.2]
[compute]
what = ["peak"]
harmonics = 3
span = [0.5, 2.0]
"""


@pytest.fixture
def run(tmp_path):
    """Return `cases` with one thread and the folder ``s`` as the store."""
    with ThreadPoolExecutor(1) as pool:
        yield lambda vary, **options: cases(
            DUFFING, vary, **{"harmonics": 3, "span": SPAN, "store": tmp_path / "s", "executor": pool} | options
        )


def test_results_are_shown_in_a_line(run):
    assert repr(run(grid(zeta=[0.05, 0.06, 0.07]))) == "<Cases of Duffing in zeta: 3 of 3 done>"


def test_a_latin_hypercube_has_one_case_in_each_layer():
    sample = latin_hypercube(20, 3, zeta=("uniform", 0.0, 1.0), F=("normal", 2.0, 0.5))
    rows = list(sample.rows())
    assert sorted(int(20 * row["zeta"]) for row in rows) == list(range(20))
    layers = [int(20 * stats.norm(2.0, 0.5).cdf(row["F"])) for row in rows]
    assert sorted(layers) == list(range(20))


def test_a_longer_monte_carlo_sample_starts_with_the_shorter():
    short, long = (list(monte_carlo(n, 1, zeta=("triangular", 0.0, 0.1, 1.0)).rows()) for n in (5, 9))
    assert long[:5] == short


@pytest.mark.parametrize(
    ("given", "mean"),
    [
        (("uniform", 1, 3), 2.0),
        (("normal", 2, 0.1), 2.0),
        (("truncated_normal", 2, 1, 1, 3), 2.0),
        (("lognormal", 2, 0.5), 2 * np.exp(0.125)),
        (("triangular", 0, 1, 5), 2.0),
    ],
)
def test_means_of_distributions(given, mean):
    assert distribution(given).mean() == pytest.approx(mean, rel=1e-12)


@pytest.mark.parametrize(
    "given", [("uniform", 2, 1), ("normal", 1), ("normal", 1, 0), ("uniform", 1, np.inf), ("normal", 10**400, 1)]
)
def test_numbers_that_do_not_fit(given):
    with pytest.raises(ValueError, match="need"):
        distribution(given)


@pytest.mark.parametrize("given", [("lognormal", 0.1, 1e9), ("normal", 1e308, 1e308), ("uniform", -1e308, 1e308)])
def test_distributions_that_reach_beyond_all_numbers_are_refused(given):
    """Samples of these distributions can contain infinite parameters."""
    with np.errstate(all="raise"), pytest.raises(ValueError, match="its values overflow; need"):
        monte_carlo(3, 0, zeta=given)


def test_numbers_of_a_case_are_those_of_its_curve(run):
    found = run(grid(zeta=[0.05, 0.5]), compute=("peak", "jumps", "curve"))
    curve = hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", SPAN)
    assert found.table["peak"][0] == pytest.approx(
        max(p.amplitude("pp2") for p in hb.analysis.peaks(curve, "pp2")), rel=1e-9
    )
    rising, falling = (next(j.value for j in curve.jumps() if j.direction == way) for way in (1, -1))
    assert found.table["jump_rising"][0] == pytest.approx(rising, rel=1e-9)
    assert found.table["jump_falling"][0] == pytest.approx(falling, rel=1e-9)
    assert found.table["jumps"].tolist() == [2, 0] and np.isnan(found.table["jump_rising"][1])
    assert found.curves[0].shape == (3, len(curve))


def test_a_failing_case_is_a_line_and_is_retried_on_request_only(run, monkeypatch):
    reports = []
    found = run(grid(zeta=[0.05, -0.05]), progress=lambda now: reports.append(tuple(now.numbers.values())))
    assert reports[0] == (0, 2, 0) and reports[-1] == (2, 2, 1)
    assert list(found.failed) == [1] and "must not be negative" in found.failed[1]
    calls = []
    monkeypatch.setattr(
        "hbgear.design.studies.case_work.run_case", lambda cls, fields, work: calls.append(fields) or found_result()
    )
    run(grid(zeta=[0.05, -0.05]))
    assert calls == []
    again = run(grid(zeta=[0.05, -0.05]), retry=True)
    assert [fields["zeta"] for fields in calls] == [-0.05] and not again.failed


def found_result():
    return Result({"peak": 1.0})


def test_quick_cases_are_handed_over_in_groups(monkeypatch):
    """Groups are formed once the time per case is known; every case is reported and has its own row, failed or not."""

    class Counting(ThreadPoolExecutor):
        handed = 0

        def submit(self, *args):
            self.handed += 1
            return super().submit(*args)

    def quick(cls, fields, work):
        return Result({"peak": fields["zeta"]}, seconds=0.01, reason="odd" if fields["zeta"] == 899 else "")

    monkeypatch.setattr("hbgear.design.studies.case_work.run_case", quick)
    reports = []
    with Counting(1) as here:
        found = cases(
            DUFFING,
            grid(zeta=range(900)),
            ("peak",),
            executor=here,
            progress=lambda now: reports.append(now.numbers["finished"]),
        )
    assert reports == list(range(901)) and 256 < here.handed < 300
    assert found.table["peak"].tolist() == list(range(900)) and found.failed == {899: "odd"}


def test_a_full_disk_stops_and_keeps_the_results(run, monkeypatch):
    write, written = Store.write, []

    def full(self, key, inputs, result):
        if len(written) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(key)
        write(self, key, inputs, result)

    monkeypatch.setattr(Store, "write", full)
    vary = grid(zeta=[0.05, 0.06, 0.07, 0.08])
    found = run(vary)
    assert found.outcome == "cannot_store" and "free space on the disk" in found.message and len(found) == 3
    monkeypatch.setattr(Store, "write", write)
    assert len(run(vary)) == 4 and run(vary).outcome == "finished"


@pytest.mark.slow
def test_full_disk_when_the_tables_are_written(tmp_path, monkeypatch, capsys):
    (tmp_path / "a.toml").write_text(STUDY.format(count=1))

    def full(self, path):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(hb.design.Cases, "export", full)
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", str(tmp_path / "a.toml")])
    assert stop.value.code == 3 and len(stored(tmp_path)) == 1
    assert "could not be written" in capsys.readouterr().err


class Losing(Executor):
    """An executor whose third task ends with an error; an OSError is also raised when a fifth one is submitted."""

    def __init__(self, error):
        self.error, self.count = error, 0

    def submit(self, function, *args):
        self.count += 1
        future = Future()
        if self.count == 3:
            future.set_exception(self.error)
        elif self.count == 5 and isinstance(self.error, OSError):
            raise self.error
        else:
            future.set_result(function(*args))
        return future


class KilledWorker(Exception):
    """Has the name of the exception of Dask."""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (BrokenExecutor("abrupt"), "a process died, killed or out of memory (abrupt)"),
        (CancelledError(), "its scheduler may have ended"),
        (KilledWorker("after 4 workers"), "(KilledWorker: after 4 workers)"),
        (OSError("closed"), "(OSError: closed)"),
    ],
)
def test_finished_cases_are_kept_when_the_executor_fails(run, error, words):
    vary = grid(zeta=[0.05, 0.06, 0.07, 0.08])
    found = run(vary, executor=Losing(error))
    assert found.outcome == "workers_lost" and words in found.message
    assert "the finished cases are stored" in found.message
    assert found.table["case"].tolist() == [0, 1, 3] and not found.failed
    assert run(vary).outcome == "finished" and len(run(vary)) == 4


def test_branches_are_kept_whole(run, tmp_path):
    curve = hb.trace(hb.HarmonicBalance(DUFFING.replace(zeta=0.06), 3), "Omega", SPAN)
    options = {"compute": ("peak", "branch")}
    vary = grid(zeta=[-0.05, 0.06])
    for found in (run(vary, **options), run(vary, **options), run(vary, store=None, **options)):  # new, read, no store
        branch = found.branch(1)
        assert np.array_equal(branch.X, curve.X) and np.array_equal(branch.multipliers, curve.multipliers)
        assert [p.label for p in branch.special] == [p.label for p in curve.special]
        assert branch.amplitude("rms", dof="x") == pytest.approx(curve.amplitude("rms", dof="x"))
        assert found.model_of(1) == DUFFING.replace(zeta=0.06)
        with pytest.raises(KeyError, match=r"case 0 failed: .* must not be negative"):
            found.branch(0)
        with pytest.raises(KeyError, match="case 2 was not computed"):
            found.branch(2)
    with pytest.raises(KeyError, match="no branches were stored"):
        run(grid(zeta=[0.07]), store=None).branch(0)


def test_an_error_that_is_not_of_the_store_is_not_called_one(run):
    def broken(now):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    with pytest.raises(BrokenPipeError):
        run(grid(zeta=[0.5]), progress=broken)


def test_stores_of_others_are_refused(run, tmp_path):
    run(grid(zeta=[0.5]))
    with pytest.raises(ValueError, match=r"another study \(harmonics = 3 in the folder, 5 now\)"):
        run(grid(zeta=[0.5]), harmonics=5)
    file = tmp_path / "s" / "study.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"schema": 99}))
    with pytest.raises(ValueError, match="schema 99"):
        run(grid(zeta=[0.5]))
    for folder, words in (
        (tmp_path, "contains no study"),
        (file, "is a file; give a folder"),
        (tmp_path / "none" / "s", "there is no folder"),
    ):
        with pytest.raises(ValueError, match=words):
            run(grid(zeta=[0.5]), store=folder)
    with pytest.raises(OSError, match=r"cannot make 'o+' \(.*too long\); give another folder"):
        run(grid(zeta=[0.5]), store="o" * 300)


def test_bad_plans(run):
    with pytest.raises(KeyError, match="did you mean 'zeta'"):
        run(grid(zetta=[0.5]))
    with pytest.raises(ValueError, match="2,000,000 cases"):
        run(grid(zeta=range(2_000_000)))
    with pytest.raises(ValueError, match="at least one value"):
        grid(zeta=[])


def started(command, folder):
    """Start a process as from a terminal: it receives SIGINT even if the tests run in the background and ignore it."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    hear = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    return subprocess.Popen(command, cwd=folder, start_new_session=True, preexec_fn=hear, **pipes)


def stopped(folder, signal_to_send):
    """Signal a study of 10 cases once three are stored; return its exit code, output and stored files."""
    (folder / "a.toml").write_text(STUDY.format(count=10))
    (folder / "study.py").write_text(STOPPED.format(signal_to_send))
    study = started([sys.executable, "study.py"], folder)
    out, _ = study.communicate(timeout=120)
    return study.returncode, out, stored(folder)


STOPPED = """
import os, signal
from contextlib import contextmanager
from hbgear.cli import app
from hbgear.cli.commands import study

@contextmanager
def stopping(what):
    yield lambda now: {} if now.numbers["finished"] == 3 else None

if __name__ == "__main__":
    study.bar = stopping
    app.main(["study", "a.toml", "--processes", "1"])
"""


def stored(folder):
    return {path: path.stat().st_mtime_ns for path in folder.glob("a/cases/*/*.npz")}


def goes_on(folder, before):
    """Resume a study to its end and return the results; stored files must not change."""
    asked = read_study(folder / "a.toml")
    with ThreadPoolExecutor(1) as pool:
        found = cases(asked.model, asked.vary, ("peak",), harmonics=3, span=SPAN, store=folder / "a", executor=pool)
    after = stored(folder)
    assert found.outcome == "finished" and len(found) == len(after) == 10 and not found.failed
    assert all(after[path] == time for path, time in before.items())
    return found


@pytest.mark.slow
def test_a_killed_study_goes_on_where_it_stopped(tmp_path):
    code, _, files = stopped(tmp_path, "os.kill(os.getpid(), signal.SIGKILL)")
    assert code == -signal.SIGKILL and len(files) == 3
    goes_on(tmp_path, files)


@pytest.mark.slow
def test_a_study_stopped_by_ctrl_c_goes_on(tmp_path):
    """All processes receive SIGINT, as from a terminal."""
    code, out, files = stopped(tmp_path, "os.killpg(0, signal.SIGINT)")
    assert code == 3 and 3 <= len(files) < 10
    assert f"{len(files)} of 10 cases, 0 of them failed; interrupted; the finished cases are stored" in out
    rows = list(csv.DictReader((tmp_path / "a" / "table.csv").open()))
    whole = goes_on(tmp_path, files)
    assert [float(row["peak"]) for row in rows] == [whole.table["peak"][int(row["case"])] for row in rows]
    assert len(rows) == len(files)


def test_a_group_of_cases_that_take_long_is_handed_back(monkeypatch):
    """A group whose first case is slow is divided again: Ctrl-C waits for one case, and every case runs once."""
    calls, groups, clock = [], [], iter(range(0, 10_000, 2))
    monkeypatch.setattr(case_work, "run_case", lambda cls, fields, work: calls.append(fields["zeta"]) or found_result())
    monkeypatch.setattr(case_work, "time", SimpleNamespace(perf_counter=lambda: float(next(clock))))

    class Counting(ThreadPoolExecutor):
        def submit(self, function, cls, group, work):
            groups.append(len(group))
            return super().submit(function, cls, group, work)

    with Counting(1) as here:
        found = hb.design.cases(hb.Duffing(), hb.design.grid(zeta=np.linspace(0.05, 0.1, 300).tolist()), executor=here)
    assert found.outcome == "finished" and len(found) == len(set(calls)) == len(calls) == 300
    assert len(groups) == 300 and max(groups) > 1


@pytest.mark.slow
def test_ctrl_c_waits_for_running_cases_only(tmp_path):
    """One process, cases of 1 s: the one that runs is finished, those that the pool has already passed on are not."""
    (tmp_path / "study.py").write_text(SLOW)
    out, err = started([sys.executable, "study.py"], tmp_path).communicate(timeout=120)
    outcome, count = out.split()
    assert outcome == "interrupted" and count == "2" and "Traceback" not in err


SLOW = """
import os, signal, time
import hbgear as hb
from hbgear.design.studies import case_work
from hbgear.design.studies.store import Result

def slow(cls, fields, work):
    time.sleep(1.0)
    return Result({"peak": 1.0, "peak_Omega": 1.0}, seconds=1.0)

stops = [signal.SIGINT]

def stop(now):
    if now.numbers["finished"] == 1 and stops:
        time.sleep(0.15)  # the pool passes on the next cases
        os.kill(os.getpid(), stops.pop())

case_work.run_case = slow  # in the worker process, too
if __name__ == "__main__":
    zeta = hb.design.grid(zeta=[0.05 + 0.01 * i for i in range(8)])
    found = hb.design.cases(hb.Duffing(), zeta, ("peak",), processes=1, progress=stop)
    print(found.outcome, len(found))
"""


@pytest.mark.slow
def test_ctrl_c_twice_waits_for_nothing(tmp_path):
    """The running cases take 600 s; the second signal ends the study without waiting for them."""
    (tmp_path / "study.py").write_text(ENDLESS)
    out, err = started([sys.executable, "study.py"], tmp_path).communicate(timeout=120)
    assert out.split() == ["interrupted", "0"] and "Traceback" not in err


ENDLESS = """
import os, signal, threading, time
import hbgear as hb
from hbgear.design.studies import study

def endless(cls, group, work):
    time.sleep(600)

def interrupt():
    for _ in range(2):
        time.sleep(2.0)
        os.kill(os.getpid(), signal.SIGINT)

if __name__ == "__main__":
    study.run_cases = endless
    threading.Thread(target=interrupt, daemon=True).start()
    found = hb.design.cases(hb.Duffing(), hb.design.grid(zeta=[0.1, 0.2]), processes=2)
    print(found.outcome, len(found))
"""


@pytest.mark.slow
def test_ctrl_c_while_the_processes_start(tmp_path):
    """The command and its processes print no traceback, and the exit code is 3."""
    (tmp_path / "a.toml").write_text(STUDY.format(count=300))
    command = [sys.executable, "-m", "hbgear", "study", "a.toml", "--processes", "2"]
    study = started(command, tmp_path)
    end = time.time() + 60
    while not (tmp_path / "a" / "study.json").exists():
        assert time.time() < end, "the study did not start within 60 s"
        time.sleep(0.01)
    time.sleep(0.1)
    os.killpg(study.pid, signal.SIGINT)
    _, err = study.communicate(timeout=60)
    assert study.returncode == 3 and "Traceback" not in err
    assert len(stored(tmp_path)) < 300


@pytest.fixture
def million(tmp_path, monkeypatch):
    """Return a function that calls the command for 1,000,001 cases and returns exit code, questions and limits."""
    asked, computed = [], []
    file = tmp_path / "a.toml"
    file.write_text(STUDY.format(count=1_000_001))

    def refuse(text, abort):
        asked.append(text)
        raise typer.Abort

    def nothing(*args, most, **options):
        computed.append(most)
        raise ValueError("enough")

    monkeypatch.setattr("typer.confirm", refuse)
    monkeypatch.setattr("hbgear.design.studies.study.cases", nothing)

    def call(*options, terminal):
        monkeypatch.setattr(sys.stdin, "isatty", lambda: terminal)
        with pytest.raises(SystemExit) as stop:
            cli.main(["study", str(file), *options])
        return stop.value.code, asked, computed

    return call


def test_a_million_cases_need_a_confirmation(million, capsys):
    code, asked, computed = million(terminal=True)
    assert code == 3 and computed == [] and "1,000,001 cases. Continue?" in asked[0]


def test_a_million_cases_without_a_terminal(million, capsys):
    assert million(terminal=False) == (2, [], []) and "confirm them with --yes" in capsys.readouterr().err
    assert million("--yes", terminal=False) == (2, [], [1_000_001])


def test_no_scheduler(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(STUDY.format(count=2))
    monkeypatch.setattr("hbgear.cli.commands.study.SCHEDULER_TIMEOUT", 0.5)
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", "a.toml", "--dask", "tcp://127.0.0.1:9"])
    assert stop.value.code == 2 and "no Dask scheduler answers" in capsys.readouterr().err


def test_no_dask(tmp_path, monkeypatch, capsys):
    (tmp_path / "a.toml").write_text(STUDY.format(count=2))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as stop:
        cli.main(["study", str(tmp_path / "a.toml"), "--dask", "tcp://127.0.0.1:9"])
    assert (
        stop.value.code == 2
        and "--dask needs distributed" in (err := capsys.readouterr().err)
        and "hbgear[dask]" in err
    )


# ---- stores that were damaged


def edit_case(path, change):
    """Change the header of a stored case."""
    with np.load(path) as archive:
        members = dict(archive)
    header = change(json.loads(str(members["header"])))
    np.savez(path, **members | {"header": np.array(json.dumps(header))})


def flag_members(path, at, value):
    """Set bits in the directory entries of a zip file."""
    data = bytearray(path.read_bytes())
    entry = data.index(b"PK\x01\x02")
    while data[entry : entry + 4] == b"PK\x01\x02":
        data[entry + at] |= value
        entry += 46 + sum(struct.unpack("<3H", data[entry + 28 : entry + 34]))
    path.write_bytes(data)


DAMAGE = {
    "encrypted": lambda path: flag_members(path, 8, 1),
    "unknown compression": lambda path: flag_members(path, 10, 93),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "empty": lambda path: path.write_bytes(b""),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
    "a list": lambda path: edit_case(path, lambda head: [head]),
    "numbers a text": lambda path: edit_case(path, lambda head: head | {"numbers": "peak"}),
    "a number a text": lambda path: edit_case(path, lambda head: head | {"numbers": head["numbers"] | {"peak": "1"}}),
    "no number": lambda path: edit_case(path, lambda head: head | {"numbers": {}}),
    "no arrays": lambda path: edit_case(path, lambda head: head | {"arrays": []}),
    "arrays a number": lambda path: edit_case(path, lambda head: head | {"arrays": 3}),
    "a time that is null": lambda path: edit_case(path, lambda head: head | {"seconds": None}),
    "a time that is nan": lambda path: edit_case(path, lambda head: head | {"seconds": float("nan")}),
    "a time before it began": lambda path: edit_case(path, lambda head: head | {"seconds": -1.0}),
    "a reason that is a number": lambda path: edit_case(path, lambda head: head | {"reason": 1}),
    "another case": lambda path: edit_case(path, lambda head: head | {"inputs": {**head["inputs"], "fields": {}}}),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=list(DAMAGE))
def test_a_damaged_case_is_computed_again_with_a_message(run, tmp_path, damage):
    vary, compute = grid(zeta=[0.5, 0.6]), ("peak", "jumps", "branch")
    before = run(vary, compute=compute)
    path = sorted((tmp_path / "s").glob("cases/*/*.npz"))[0]
    damage(path)
    with pytest.warns(UserWarning, match=f"1 stored case cannot be read and will be computed again.*{path.name}"):
        again = run(vary, compute=compute)
    if path.is_dir():  # a file cannot replace a folder
        assert again.outcome == "cannot_store"
        return
    assert again.outcome == "finished" and not again.failed
    for name in before.table.keys() - {"seconds"}:
        np.testing.assert_array_equal(before.table[name], again.table[name])
    with warnings.catch_warnings(action="error"):
        run(vary, compute=compute)
        assert np.array_equal(before.branch(0).X, again.branch(0).X)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"schema": 1, "hbgear": "1", "study": []}', '{"schema": []}', "[" * 10**5]
)
def test_a_damaged_study_file_is_written_again_with_a_message(run, tmp_path, text):
    before = run(grid(zeta=[0.5, 0.6]))
    file = tmp_path / "s" / "study.json"
    whole = file.read_text()
    edit_case(sorted((tmp_path / "s").glob("cases/*/*.npz"))[0], lambda head: head | {"hbgear": "0.0"})
    file.write_text(text)
    with pytest.warns(UserWarning) as caught:
        again = run(grid(zeta=[0.5, 0.6]))
    assert [str(each.message).split(" ")[1:3] for each in caught] == [["could", "not"], ["stored", "case"]]
    assert file.read_text() == whole and len(again) == 2
    assert np.array_equal(again.table["peak"], before.table["peak"])
    assert (again.table["seconds"] == before.table["seconds"]).sum() == 1  # the other case was loaded
    (tmp_path / "t").mkdir()
    (tmp_path / "t" / "study.json").write_text(text)
    with pytest.raises(ValueError, match="cannot be read as a study; give another folder"):
        run(grid(zeta=[0.5]), store=tmp_path / "t")


def test_a_study_killed_before_its_first_file_was_there_goes_on(run, tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / ".study.json.0123").write_text("{")
    assert len(run(grid(zeta=[0.5]))) == 1


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(run, tmp_path, monkeypatch):
    found = run(grid(zeta=[0.5]))

    def full(path):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("hbgear.design.studies.store.check_writable", full)
    monkeypatch.setattr("hbgear.design.studies.case_work.run_case", None)
    assert np.array_equal(run(grid(zeta=[0.5])).table["peak"], found.table["peak"])  # nothing to write
    with pytest.raises(OSError, match="Read-only"):
        run(grid(zeta=[0.5, 0.6]))


def test_a_branch_that_was_damaged_after_it_was_looked_at(run, tmp_path):
    found = run(grid(zeta=[0.5]), compute=("branch",))
    (path,) = (tmp_path / "s").glob("cases/*/*.npz")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"the branch of case 0 cannot be read .*run the study again"):
        found.branch(0)


# ---- scripts without the __main__ guard that processes need

GRID = "hb.design.grid(zeta=[0.5])"
CALL = f"found = hb.design.cases(hb.Duffing(), {GRID}, ('peak',), harmonics=3, span=(0.5, 2.0), processes=1)"
SCRIPT = f"import hbgear as hb\ndef work():\n    {CALL}\n    print(len(found), found.outcome)\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "line"), [("print(1)\nfor _ in range(1):\n    work()", 6), ("if __name__ == '__main__':\n    work()", 0)]
)
def test_a_script_without_guard_gets_the_missing_line(tmp_path, end, line):
    (tmp_path / "study.py").write_text(SCRIPT + end + "\n")
    done = subprocess.run([sys.executable, "study.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    if not line:
        assert done.returncode == 0 and done.stdout == "1 finished\n"
        return
    assert done.returncode == 1 and done.stderr.count("Traceback") == 1
    last = done.stderr.splitlines()[-1]
    assert f'write the line if __name__ == "__main__": before line {line}, and indent' in last and "study.py" in last


@pytest.mark.slow
def test_interactive_code_needs_no_guard(tmp_path):
    code = SCRIPT + "work()"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.stdout == "1 finished\n"


def test_cases_of_a_pair_from_its_drawing_keep_its_teeth():
    """Tooth contacts are rebuilt in every case: the peak agrees to 1e-3 with a trace of the model with this damping."""
    model = gear_pair().model("200 N m", 0.08)
    with ThreadPoolExecutor(1) as executor:
        found = hb.design.cases(
            model, hb.design.grid(zeta=[0.1]), ("peak",), harmonics=4, span=(0.9, 0.8), executor=executor
        )
    assert found.failed == {}
    curve = hb.trace(hb.HarmonicBalance(model.replace(zeta=0.1), 4), "Omega", (0.9, 0.8), accuracy=None)
    (name,) = [name for name in found.table if name.startswith("peak") and "Omega" not in name]
    assert found.table[name][0] == pytest.approx(curve.amplitude("pp2").max(), rel=1e-3)


def test_all_curves_of_the_span_are_results_of_a_case(tmp_path):
    """The curve from 1.5 is unbounded, a second one covers the rest: jumps and stable motions of both are included."""
    model, span = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,)), (1.5, 0.3)
    with ThreadPoolExecutor(1) as executor:
        what = ("peak", "jumps", "curve")
        found = cases(model, grid(zeta=[0.01, 0.2]), what, harmonics=8, span=span, executor=executor)
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", span, accuracy=None)
    curves = curve.curves
    assert found.failed == {} and len(curves) == 2
    jumps = sorted(jump.value for one in curves for jump in one.jumps())
    np.testing.assert_allclose(sorted(found.jumps[found.jumps[:, 0] == 0, 1]), jumps, rtol=1e-6)
    assert found.table["jumps"].tolist() == [len(jumps), 0] and len(jumps) == 2
    stable = [one.amplitude("pp2")[one.stable].max() for one in curves]  # the curve is unstable where it is unbounded
    assert found.table["peak"][0] == pytest.approx(max(stable), rel=1e-4)
    assert max(stable) < 1.001 * curve["LP1"].amplitude("pp2") < 0.5 * curve.amplitude("pp2").max()
    with ThreadPoolExecutor(1) as executor:
        alone = cases(model, grid(zeta=[0.01]), ("peak",), harmonics=8, span=span, executor=executor)
    assert alone.table["peak"][0] == found.table["peak"][0]
    numbers = {}
    case_work._peak([dataclasses.replace(curve, multipliers=0 * curve.multipliers)], found.work, numbers, {})
    assert numbers == {"peak": np.inf, "peak_Omega": curve.asymptotes["last"]}
    columns = np.isnan(found.curves[0][0])
    assert columns.sum() == 1 and not np.isnan(found.curves[1]).any()
    np.testing.assert_allclose(found.curves[0][0, ~columns], np.concatenate([one.values for one in curves]))
    at = [0.42, 0.6]
    stable = [sum(count_stable(one, Omega) for one in curves) for Omega in at]
    assert stable[0] == 2
    known = hb.design.sweep_statistics(found, at)
    assert known.coexisting.tolist() == [0.5 * (count > 1) for count in stable]
    path = tmp_path / "table.npz"
    found.export(path)
    assert np.isnan(np.load(path)["curve_table"][:, 1]).sum() == 1
    unbounded = dataclasses.replace(found, table={**found.table, "peak": np.array([np.inf, found.table["peak"][1]])})
    assert hb.plot.envelope(unbounded).get_ylim()[1] < 5 * max(stable)


def count_stable(branch, Omega):
    """Return the number of stable motions of a branch at a value of Omega."""
    return sum(bool(branch.stable[one.index]) for one in crossings_at(branch, Omega))


@pytest.mark.slow
def test_a_full_disk_ends_a_study_before_the_first_case(tmp_path):
    """Files of more than 2 KB cannot be written: processes would compile kernels that cannot be stored, for minutes."""
    resource = pytest.importorskip("resource")  # POSIX
    script = tmp_path / "study.py"
    script.write_text(
        "import resource\nimport hbgear as hb\nif __name__ == '__main__':\n"
        f"    resource.setrlimit(resource.RLIMIT_FSIZE, (2048, {resource.RLIM_INFINITY}))\n"
        "    two = hb.design.grid(zeta=[0.05, 0.06])\n"
        "    hb.design.cases(hb.Duffing(), two, harmonics=1, span=(0.9, 1.4), store='cases')\n"
    )
    run = subprocess.run(
        [sys.executable, "-B", script], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert run.returncode == 1 and "file too large; give another place" in run.stderr
