"""The command ``hbgear study``: many cases from a file."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbgear.cli.options import AllowCode
from hbgear.cli.output import BAD_INPUT, STOPPED_EARLY, bar, print_message, print_table
from hbgear.cli.output_files import report_written
from hbgear.common.optional import needed

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from hbgear.design.studies.case_results import Cases


SCHEDULER_TIMEOUT = 5
"""Time [s] within which a Dask scheduler must answer, and between two checks of its workers."""


Folder = Annotated[
    Path | None, typer.Option("-o", "--output", help="Folder for cases, table and figures.", show_default="FILE")
]

Processes = Annotated[int | None, typer.Option(min=1, help="Number of processes.", show_default="one for each core")]

Dask = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Compute on a Dask scheduler, such as tcp://127.0.0.1:8786.")
]

Authority = Annotated[
    Path | None, typer.Option(help="With --dask tls://...: certificates of the authority of the scheduler.")
]

Key = Annotated[Path | None, typer.Option(help="With --dask tls://...: its key.", show_default="in the certificate")]


def study(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="What to vary and what to compute.")],
    output: Folder = None,
    processes: Processes = None,
    dask: Dask = None,
    tls_ca_file: Authority = None,
    tls_cert: Annotated[Path | None, typer.Option(help="With --dask tls://...: certificate of this study.")] = None,
    tls_key: Key = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed cases again.")] = False,
    allow_code: AllowCode = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation of many cases.")] = False,
) -> None:
    """Compute many cases: a grid or a random sample of parameters.

    Every finished case is stored at once in the folder. Ctrl-C ends after the running cases (a second Ctrl-C: at once)
    and keeps all cases; the same command continues. The folder gets table.csv, table.npz and figures (.png): envelope
    of the curves, distribution of the jumps, peaks and jumps against each parameter. A case that fails is a row with
    its reason. A model of your own in the file, FILE.py:NAME, needs --allow-code.
    Exit codes: 0 every case is done, 2 bad input, 3 stopped early.
    """
    from hbgear.design.studies.case_results import Outcome
    from hbgear.design.studies.study import MANY, cases
    from hbgear.design.studies.study_file import read_study
    from hbgear.io.machines.toml_file import TomlFileError

    try:
        parsed = read_study(file, allow_code)
    except TomlFileError as error:
        for problem in error.problems:
            print_message("error", problem)
        raise typer.Exit(BAD_INPUT) from None
    count, work = parsed.vary.size, parsed.work
    if count > MANY and not yes:
        if not sys.stdin.isatty():
            raise ValueError(f"{file} has {count:,} cases; confirm them with --yes")
        typer.confirm(f"{file} has {count:,} cases. Continue?", abort=True)
    folder = output or file.with_suffix("")
    with dask_executor(dask, tls_ca_file, tls_cert, tls_key) as executor, bar("designs") as progress:
        results = cases(
            parsed.model,
            parsed.vary,
            work.compute,
            critical=work.critical,
            harmonics=work.harmonics,
            span=work.span,
            measure=work.measure,
            element=work.element,
            store=folder,
            executor=executor,
            processes=processes,
            retry=retry,
            most=max(count, MANY),
            progress=progress,
        )
    print(f"{len(results)} of {results.total} cases, {len(results.failed)} of them failed; {results.message}")
    if getattr(parsed.vary, "method", "") == "saltelli":
        _print_indices(results)
    for case, reason in list(results.failed.items())[:5]:
        print(f"case {case} failed: {reason}")
    if results.outcome != Outcome.CANNOT_STORE:
        _write(results, folder)
    raise typer.Exit(0 if results.outcome == Outcome.FINISHED else STOPPED_EARLY)


def _write(results: Cases, folder: Path) -> None:
    """Write the tables and figures of a study; end the command if they cannot be written."""
    try:
        tables = [folder / "table.csv", folder / "table.npz"]
        for path in tables:
            results.export(path)
        report_written(*tables, *draw_figures(results, folder))
    except OSError as error:
        print_message(
            "error", f"tables and figures could not be written ({error}); the cases are kept: run the command again"
        )
        raise typer.Exit(STOPPED_EARLY) from None


def _print_indices(results: Cases) -> None:
    """Print Sobol indices of each number of the table."""
    from hbgear.design.uncertainty.sobol import sobol_indices

    skipped = {*results.names, "case", "reason", "seconds"}
    columns = zip(results.table, results.physical_table, strict=True)
    for quantity in [shown_name for name, shown_name in columns if name not in skipped]:
        try:
            indices = sobol_indices(results, quantity)
        except ValueError as error:
            print(f"{quantity}: {error}")
            continue
        rows = [
            [name, *(f"{value:.3f} +- {error:.3f}" for value, error in (indices.first[name], indices.total[name]))]
            for name in results.names
        ]
        print_table(["", "first order", "total"], rows, f"Sobol indices of {quantity}")


def draw_figures(results: Cases, folder: Path) -> list[Path]:
    """Write each figure of the study as .png; return the written files."""
    from hbgear import plot
    from hbgear.plot.style import without_windows

    paths = []
    with without_windows():
        for name, drawing in plot.figures(results).items():
            paths.append(folder / f"{name}.png")
            plot.save(drawing, paths[-1])
    return paths


@contextmanager
def dask_executor(
    address: str | None, ca_file: Path | None = None, cert: Path | None = None, key: Path | None = None
) -> Iterator[Executor | None]:
    """Yield the executor of a running scheduler at an address such as tcp://127.0.0.1:8786; None without an address.

    The certificate files (.pem) of an address tls://... are by default those of the Dask configuration. ValueError is
    raised if Dask is not installed, no scheduler answers within a few seconds, or the certificates do not fit.
    """
    if address is None:
        if ca_file or cert or key:
            raise ValueError("certificates are for a Dask scheduler; give its address with --dask tls://HOST:PORT")
        yield None
        return
    distributed = needed("distributed", "dask", "--dask")
    security = _security(address, ca_file, cert, key)
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # one line of hbgear reports a lost scheduler instead
    try:
        client: Any = distributed.Client(address, timeout=SCHEDULER_TIMEOUT, security=security)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"no Dask scheduler answers at {address} ({error}); start one with 'dask scheduler' and give its address"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ValueError(f"the scheduler at {address} has no workers; start some with 'dask worker {address}'")
        ended = threading.Event()
        threading.Thread(target=_watch, args=(client, ended), daemon=True).start()
        try:
            yield client.get_executor(pure=False)
        finally:
            ended.set()


def _security(address: str, ca_file: Path | None, cert: Path | None, key: Path | None) -> Any:
    """Return the security settings of Dask with the given certificates, by default those of its configuration.

    ValueError is raised if the address and the certificates do not go together, or one cannot be read.
    """
    from distributed.security import Security

    certificates = {"tls_ca_file": ca_file, "tls_client_cert": cert, "tls_client_key": key}
    files = {name: str(path) for name, path in certificates.items() if path}
    if files and not (ca_file and cert and address.startswith("tls://")):
        raise ValueError("certificates need --tls-ca-file and --tls-cert, and an address --dask tls://HOST:PORT")
    try:
        security = Security(**files, **({"require_encryption": True} if files else {}))
        context = security.get_connection_args("client").get("ssl_context")
    except OSError as error:
        raise ValueError(f"the certificates cannot be used ({error}); need .pem files that fit each other") from None
    if address.startswith("tls://") and context is None:
        raise ValueError(f"{address} needs certificates: give --tls-ca-file, --tls-cert and --tls-key")
    return security


def _watch(client: Any, ended: threading.Event) -> None:
    """Warn once when no worker is left; Dask itself waits for new workers without a message."""
    while not ended.wait(SCHEDULER_TIMEOUT):
        try:
            workers = client.scheduler_info()["workers"]
        except OSError:  # the study itself reports a lost scheduler
            return
        if not workers:
            print_message(
                "warning", "no worker is left; the study waits for new workers, Ctrl-C ends it and keeps its results"
            )
            return
