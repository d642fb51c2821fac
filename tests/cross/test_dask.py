"""Studies on a Dask scheduler with two workers: a worker or the scheduler is killed; connections with TLS."""

import csv
import json
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from distributed import Client
from distributed.security import Security

pytestmark = pytest.mark.slow

# with 60 harmonics some cases are still to be computed when three are stored
STUDY = """model = "duffing"
[base]
k3 = 1.0
[sample]
count = 12
[sample.parameters]
zeta = ["uniform", 0.03, 0.06]
[compute]
what = ["peak"]
harmonics = 60
span = [0.5, 2.0]
"""

KILLING = """
import os, signal, sys
from contextlib import contextmanager
from hbgear.cli import app
from hbgear.cli.commands import study

@contextmanager
def killing(what):
    yield lambda at: [os.kill(int(pid), signal.SIGKILL) for pid in sys.argv[2:] if at.numbers["finished"] == 3]

study.bar = killing
app.main(["study", "a.toml", "--dask", sys.argv[1]])
"""
"""The command; it kills the given processes when three cases are finished."""

DASK = [sys.executable, "-m", "dask"]
LOCAL = ["--host", "127.0.0.1", "--no-dashboard"]
WORKER = [*DASK, "worker", *LOCAL, "--nthreads", "1", "--no-nanny"]


@contextmanager
def cluster(folder: Path, *tls: str, security=None):
    """Yield the address of a scheduler, its process and the processes of its two workers."""
    scheduler = [*DASK, "scheduler", *LOCAL, "--port", "0", "--scheduler-file", "s.json", *tls]
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [subprocess.Popen(scheduler, **quiet)]
    try:
        address = address_of(folder / "s.json")
        processes += [subprocess.Popen([*WORKER, address, *tls], **quiet) for _ in range(2)]
        with Client(address, security=security) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, *processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def address_of(file: Path) -> str:
    end = time.time() + 60
    while not (file.exists() and file.stat().st_size):
        assert time.time() < end, "the scheduler wrote no address within 60 s"
        time.sleep(0.05)
    address = json.loads(file.read_text())["address"]
    assert address.partition("://")[2].startswith("127.0.0.1:")
    return address


@pytest.fixture
def study(tmp_path):
    """Return a function that starts the study, which kills the given processes."""
    (tmp_path / "a.toml").write_text(STUDY)
    (tmp_path / "study.py").write_text(KILLING)
    pipes = {"cwd": tmp_path, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}

    def start(address, *victims):
        return subprocess.Popen([sys.executable, "study.py", address, *(str(v.pid) for v in victims)], **pipes)

    return start


def stored(folder):
    return len(list(folder.glob("a/cases/*/*.npz")))


def test_a_killed_worker_loses_nothing(study, tmp_path):
    with cluster(tmp_path) as (address, _, worker, _other):
        running = study(address, worker)
        out, _ = running.communicate(timeout=120)
        assert worker.wait(timeout=10) == -9
    assert running.returncode == 0 and "12 of 12 cases, 0 of them failed" in out and stored(tmp_path) == 12
    rows = list(csv.DictReader((tmp_path / "a" / "table.csv").open()))
    assert [int(row["case"]) for row in rows] == list(range(12))
    assert len({row["zeta"] for row in rows}) == 12 and all(row["peak"] and not row["reason"] for row in rows)


def test_a_killed_scheduler_is_reported_and_the_study_continues(study, tmp_path):
    with cluster(tmp_path) as (address, scheduler, *_):
        running = study(address, scheduler)
        out, err = running.communicate(timeout=120)
    kept = stored(tmp_path)
    assert running.returncode == 3 and 3 <= kept < 12 and "Traceback" not in err
    assert f"{kept} of 12 cases, 0 of them failed" in out and "its scheduler may have ended" in out
    again = [sys.executable, "-m", "hbgear", "study", "a.toml"]
    out = subprocess.run(again, cwd=tmp_path, capture_output=True, text=True, timeout=120).stdout
    assert "12 of 12 cases" in out and stored(tmp_path) == 12


def test_a_study_without_workers_reports_it_and_waits_for_new_ones(study, tmp_path):
    with cluster(tmp_path) as (address, _, *workers):
        running = study(address, *workers)
        assert "no worker is left" in running.stderr.readline()
        new = subprocess.Popen([*WORKER, address], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        out, _ = running.communicate(timeout=120)
        new.kill()
        new.wait()
    assert running.returncode == 0 and "12 of 12 cases, 0 of them failed" in out and stored(tmp_path) == 12


# ---- certificates


def certificate(folder: Path, name: str) -> tuple[str, str]:
    """Create a self-signed certificate and its key; return their paths."""
    cert, key = str(folder / f"{name}.pem"), str(folder / f"{name}.key")
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    made = subprocess.run([*command, "-out", cert, "-keyout", key], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return cert, key


@pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates for this test are made by openssl")
def test_a_study_on_a_scheduler_with_certificates(tmp_path):
    (cert, key), (other, other_key) = certificate(tmp_path, "own"), certificate(tmp_path, "other")
    (tmp_path / "a.toml").write_text(STUDY)
    options = ["--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key]
    security = Security(tls_ca_file=cert, tls_client_cert=cert, tls_client_key=key, require_encryption=True)

    def study(address, *options):
        command = [sys.executable, "-m", "hbgear", "study", "a.toml", "--dask", address, *options]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)

    with cluster(tmp_path, "--protocol", "tls", *options, security=security) as (address, *_):
        assert address.startswith("tls://")
        stranger = study(address, "--tls-ca-file", other, "--tls-cert", other, "--tls-key", other_key)
        assert stranger.returncode == 2 and "no Dask scheduler answers" in stranger.stderr
        plain = study(address.replace("tls", "tcp"))
        assert plain.returncode == 2 and "no Dask scheduler answers" in plain.stderr
        done = study(address, *options)
        assert done.returncode == 0 and "12 of 12 cases, 0 of them failed" in done.stdout, done.stderr
    assert stored(tmp_path) == 12 and all("Traceback" not in each.stderr for each in (stranger, plain, done))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tls-cert", "a.pem"], "certificates are for a Dask scheduler; give its address"),
        (["--dask", "tcp://127.0.0.1:1", "--tls-ca-file", "a.pem", "--tls-cert", "a.pem"], "an address --dask tls://"),
        (["--dask", "tls://127.0.0.1:1", "--tls-cert", "a.pem"], "need --tls-ca-file and --tls-cert"),
        (["--dask", "tls://127.0.0.1:1"], "tls://127.0.0.1:1 needs certificates"),
        (["--dask", "tls://127.0.0.1:1", "--tls-ca-file", "a.toml", "--tls-cert", "a.toml"], "cannot be used"),
        (["--dask", "tls://127.0.0.1:1", "--tls-ca-file", "none", "--tls-cert", "none"], "cannot be used"),
    ],
)
def test_certificates_that_do_not_fit(tmp_path, run, options, words):
    (tmp_path / "a.toml").write_text(STUDY)
    code, _, error = run("study", "a.toml", *options)
    assert code == 2 and words in error and error.count("\n") == 1
