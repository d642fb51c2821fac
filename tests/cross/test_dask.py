"""A study on a real Dask scheduler with two worker processes, one of which is killed."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

STUDY = """model = "duffing"
[base]
k3 = 1.0
[sample]
count = 16
[sample.parameters]
zeta = ["uniform", 0.03, 0.06]
[compute]
what = ["peak"]
harmonics = 3
span = [0.5, 2.0]
"""


def test_a_killed_worker_loses_nothing(tmp_path):
    (tmp_path / "a.toml").write_text(STUDY)
    dask = [sys.executable, "-m", "dask"]
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    processes = [
        subprocess.Popen([*dask, "scheduler", *local, "--port", "0", "--scheduler-file", "s.json"], cwd=tmp_path)
    ]
    try:
        wait_for(lambda: (tmp_path / "s.json").exists() and (tmp_path / "s.json").stat().st_size)
        address = json.loads((tmp_path / "s.json").read_text())["address"]
        assert address.startswith("tcp://127.0.0.1:")
        worker = [*dask, "worker", address, *local, "--nthreads", "1", "--no-nanny"]
        processes += [subprocess.Popen(worker, cwd=tmp_path) for _ in range(2)]
        time.sleep(5)
        command = [sys.executable, "-m", "hbgear", "study", "a.toml", "--dask", address]
        study = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        processes.append(study)
        wait_for(lambda: len(list(tmp_path.glob("a/cases/*/*.npz"))) >= 3)
        os.kill(processes[1].pid, signal.SIGKILL)
        out, _ = study.communicate(timeout=120)
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert study.returncode == 0 and "16 of 16 cases, 0 of them failed" in out
    assert len(list(tmp_path.glob("a/cases/*/*.npz"))) == 16
    rows = list(csv.DictReader((tmp_path / "a" / "table.csv").open()))
    assert [int(row["case"]) for row in rows] == list(range(16))
    assert len({row["zeta"] for row in rows}) == 16 and all(row["peak"] and not row["reason"] for row in rows)


def wait_for(condition, seconds=60.0):
    end = time.time() + seconds
    while not condition():
        assert time.time() < end, "waited in vain"
        time.sleep(0.05)
