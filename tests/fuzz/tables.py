"""Fuzzing of tables (receptances, mesh cycles, measurements) and matrices in formats of other programs.

    python -m tests.fuzz.tables --count 3000 --seed 0 --processes 2

Every number of a valid file must be read with its generated value, in SI. An invalid cell, name or unit must be refused
with a one-line message; a file with damaged bytes may be read or be refused in the same way.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import hbgear as hb

from . import pool
from .commands import judged
from .files import _bytes, _clean

Random = np.random.Generator

FREQUENCIES = {
    "Hz": 1.0,
    "kHz": 1e3,
    "KHZ": 1e3,
    "r/min": 1 / 60,
    "rpm": 1 / 60,
    "U/min": 1 / 60,
    "min^-1": 1 / 60,
    "rad/s": 0.15915494309189535,
}
COMPLIANCES = {"m/N": 1.0, "mm/N": 1e-3, "um/N": 1e-6, "µm/N": 1e-6, "mm/kN": 1e-6, "m/MN": 1e-6}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
STIFFNESSES = {"N/m": 1.0, "N/um": 1e6, "N/µm": 1e6, "kN/mm": 1e6, "N/mm": 1e3, "MN/m": 1e6}
ANGLES = {"deg": 1.0, "°": 1.0, "Deg": 1.0, "rad": 57.29577951308232, "mrad": 0.05729577951308232}
CYCLES = {"cycle": 1.0, "-": 1.0, "deg": 1 / 360, "°": 1 / 360, "rad": 0.15915494309189535}
BAD_UNITS = ("furlong^7", "K", "é", "V", "?", "Hz^2", "N/", "[", "1e999 m", "m" * 200)
BAD_NAMES = ("qqq", "Temperatur", "時間", "column 1", "re2", "=A1+1", "None", "a" * 500)
BAD_CELLS = (
    "x",
    "1e",
    "nan",
    "inf",
    "-inf",
    "1_0",
    "1.2.3",
    "--1",
    "\u0663",
    "0x10",
    "1" * 300,
    "1e400",
    "#N/A",
    "True",
    "1.234.567",
    "=1+1",
    "1 000",
    "\u00bd",
)
MARKS = (",", ";", "\t", " ", "   ", ", ", "; ", " ; ", "\t\t"[:1])
ENCODINGS = ("utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252")
REMARKS = ("# made in May", "% T = 20, p = 1", "// rig 2", "! 3 runs; 2 sweeps", "#", "   # a, b, c")


@dataclass
class Made:
    """A generated table: names and units of its columns, rows of cells, and the values of each column in SI."""

    names: list[str]
    units: list[str]
    cells: list[list[str]]
    numbers: list[Any]


def pick(rng: Random, options: Any) -> Any:
    return list(options)[int(rng.integers(len(options)))]


def column(rng: Random, values: Sequence[float], factor: float) -> tuple[list[str], np.ndarray]:
    """Return values formatted in a unit, and the values in SI."""
    style = pick(rng, ("{!r}", "{:.12e}", "{:.9E}", "{:+.8e}"))
    texts = [style.format(float(x) / factor) for x in values]
    return texts, np.array([float(text) * factor for text in texts])


def response(rng: Random) -> Made:
    """A frequency response of one mass in random units: real and imaginary part, or magnitude and phase."""
    count = int(rng.integers(4, 40))
    f = np.sort(rng.uniform(0.5, 90.0, count) + np.arange(count) * 0.1)
    H = 1 / (1e4 * (1 - (f / 30.0) ** 2) + 800j * f)
    unit = pick(rng, FREQUENCIES)
    name = pick(
        rng, ("n", "speed", "rpm") if unit in ("r/min", "rpm", "U/min") else ("frequency", "f", "Freq", "OMEGA")
    )
    parts = [(name, unit, *column(rng, f, FREQUENCIES[unit]))]
    if rng.random() < 0.5:
        for part, names in (
            (H.real, ("real", "Re", "Re(H)", "Real_Part")),
            (H.imag, ("imag", "Im(H)", "imaginary part")),
        ):
            unit = pick(rng, COMPLIANCES)
            parts.append((pick(rng, names), unit, *column(rng, part, COMPLIANCES[unit])))
    else:
        name, unit = pick(rng, ("magnitude", "|H|", "mag", "modulus", "Amplitude")), pick(rng, COMPLIANCES)
        if rng.random() < 0.4:
            texts, levels = column(rng, 20 * np.log10(np.abs(H) / COMPLIANCES[unit]), 1.0)
            parts.append((name, f"dB re 1 {unit}", texts, COMPLIANCES[unit] * 10 ** (levels / 20)))
        else:
            parts.append((name, unit, *column(rng, np.abs(H), COMPLIANCES[unit])))
        unit = pick(rng, ANGLES)
        parts.append(
            (pick(rng, ("phase", "angle", "arg", "Phase")), unit, *column(rng, np.degrees(np.angle(H)), ANGLES[unit]))
        )
    if rng.random() < 0.2:
        parts.append(("coherence", "-", *column(rng, rng.uniform(0, 1, count), 1.0)))
    order = rng.permutation(len(parts))
    return _made([parts[i] for i in order], H)


def cycle(rng: Random) -> Made:
    """Mesh stiffness over one cycle, in random units."""
    count = int(rng.integers(4, 60))
    unit, own = pick(rng, CYCLES), pick(rng, STIFFNESSES)
    phase = np.arange(count) / count
    k = 3e8 * (1 + 0.2 * np.cos(2 * np.pi * phase + rng.uniform(0, 6)))
    name = pick(rng, ("stiffness", "k", "c_gamma", "K mesh"))
    parts = [("phase", unit, *column(rng, phase, CYCLES[unit])), (name, own, *column(rng, k, STIFFNESSES[own]))]
    return _made(parts, None)


def sweeps(rng: Random) -> Made:
    """Measured amplitudes, some with sweep directions and deviations."""
    count = int(rng.integers(2, 30))
    unit, length = pick(rng, ("r/min", "Hz", "kHz", "rpm", "-")), pick(rng, LENGTHS)
    names = {"r/min": ("n", "speed", "Pinion_Speed"), "rpm": ("n", "RPM"), "-": ("Omega",)}.get(
        unit, ("frequency", "f")
    )
    factor = {"kHz": 1e3}.get(unit, 1.0)
    amplitude = column(rng, rng.uniform(1e-6, 9e-5, count), LENGTHS[length])
    parts = [
        (pick(rng, names), unit, *column(rng, rng.uniform(0.1, 2.0, count) * (1 if unit == "-" else 1e3), factor)),
        (pick(rng, ("dte", "x", "amplitude", "Displacement")), length, *amplitude),
    ]
    if rng.random() < 0.6:
        words = [
            pick(rng, (("up", 1), ("down", -1), ("Rising", 1), ("FALLING", -1), ("+1", 1), ("-1", -1)))
            for _ in range(count)
        ]
        parts.append(
            (pick(rng, ("direction", "sweep")), "", [word for word, _ in words], np.array([d for _, d in words]))
        )
    if rng.random() < 0.4:
        own = pick(rng, LENGTHS)
        parts.append((pick(rng, ("deviation", "std")), own, *column(rng, rng.uniform(1e-8, 1e-7, count), LENGTHS[own])))
    order = rng.permutation(len(parts))
    return _made([parts[i] for i in order], {i: parts[j][0].lower() for i, j in enumerate(order)})


def _made(parts: list[tuple[Any, ...]], more: Any) -> Made:
    names, units, cells, numbers = (list(each) for each in zip(*parts, strict=True))
    made = Made(names, units, [list(row) for row in zip(*cells, strict=True)], numbers)
    made.more = more  # type: ignore[attr-defined]
    return made


def written(rng: Random, made: Made) -> bytes:
    """Return the bytes of a table in a random dialect that keeps its values."""
    mark = pick(rng, MARKS)
    decimal = pick(rng, (".", ".", ","))
    quote = (decimal == "," and mark.strip() == ",") or (rng.random() < 0.1 and mark.strip() != "")
    mark = mark.strip() or mark if quote else mark
    style = pick(rng, ("{} [{}]", "{} ({})", "{} [ {} ]", "{} / {}", "{}[{}]"))
    heads = [style.format(name, unit) if unit else name for name, unit in zip(made.names, made.units, strict=True)]
    if not mark.strip() and mark != "\t":
        heads = [head.replace("] ", "]") for head in heads]
        mark = "   "  # names may have single spaces
    change = lambda cell: cell.replace(".", decimal)  # noqa: E731
    rows = [[change(cell) for cell in row] for row in made.cells]
    if quote:
        heads, rows = [f'"{head}"' for head in heads], [[f'"{cell}"' for cell in row] for row in rows]
    lines = [mark.join(heads), *(mark.join(row) for row in rows)]
    if rng.random() < 0.1 and style == "{} [{}]":  # units in a separate line
        units = [f"[{unit}]" if unit else "-" for unit in made.units]
        if mark.strip() or mark == "\t":
            lines[:1] = [mark.join(made.names), mark.join(units)]
    lines[0] = ("# " if style == "{} [{}]" and rng.random() < 0.1 and len(lines) == len(rows) + 1 else "") + lines[0]
    if rng.random() < 0.4:
        lines.insert(0, pick(rng, REMARKS))
    if rng.random() < 0.2:
        lines.insert(len(lines) - 1, pick(rng, ("", "   ", *REMARKS)))
    text = pick(rng, ("\n", "\r\n", "\r", "\n")).join(lines) + pick(rng, ("", "\n", "\n\n"))
    encoding = pick(rng, ENCODINGS)
    return text.encode(encoding if encoding.startswith("utf") else "cp1252")


def spoilt(rng: Random, made: Made) -> str:
    """Put an invalid unit, name or cell into a table; return its description."""
    which = int(rng.integers(3))
    at = int(rng.integers(len(made.names)))
    if which == 0:
        made.units[at] = pick(rng, BAD_UNITS)
        return f"unit {made.units[at]!r}"
    if which == 1:
        made.names[at] = pick(rng, BAD_NAMES)
        return f"name {made.names[at]!r} [{made.units[at]}]"
    made.cells[int(rng.integers(len(made.cells)))][at] = cell = pick(rng, BAD_CELLS)
    return f"cell {cell!r} in {made.names[at]}"


def read_response(path: Path, made: Made) -> list[tuple[Any, Any]]:
    found = hb.io.from_receptances({("a", "a"): path}, static=[[1e-4]])
    values = np.asarray(found.values)[:, 0, 0][-len(made.cells) :]
    return [(values, made.more)]  # type: ignore[attr-defined]


def read_cycle(path: Path, made: Made) -> list[tuple[Any, Any]]:
    found = hb.io.read_mesh_table(path)
    return [(found.phase[:-1], made.numbers[0]), (found.value[:-1], made.numbers[1])]


def read_sweeps(path: Path, made: Made) -> list[tuple[Any, Any]]:
    data = hb.design.read_measurements(path)
    roles = {
        "n": "frequency",
        "speed": "frequency",
        "pinion_speed": "frequency",
        "rpm": "frequency",
        "f": "frequency",
        "omega": "frequency",
        "dte": "amplitude",
        "x": "amplitude",
        "displacement": "amplitude",
        "sweep": "directions",
        "direction": "directions",
        "std": "deviation",
    }
    fields = [roles.get(name.lower(), name.lower()) for name in made.names]
    return [(getattr(data, name), values) for name, values in zip(fields, made.numbers, strict=True)]


KINDS: tuple[tuple[Callable[[Random], Made], Callable[[Path, Made], list[tuple[Any, Any]]]], ...] = (
    (response, read_response),
    (cycle, read_cycle),
    (sweeps, read_sweeps),
)


def attempt_table(rng: Random, folder: Path, note: pool.Note) -> pool.Wrong | None:
    make_, read = KINDS[int(rng.integers(3))]
    made = make_(rng)
    what = pick(rng, ("valid", "valid", "spoilt", "damaged"))
    fault = spoilt(rng, made) if what == "spoilt" else ""
    try:
        content = written(rng, made)
    except UnicodeEncodeError:
        return None
    if what == "damaged":
        content = _bytes(rng, content)
    path = folder / "table.csv"
    path.write_bytes(content)
    note(f"{read.__name__}, {what} {fault}: {content[:300]!r}")
    if what == "damaged" and rng.random() < 0.02:
        return judged(["fit", "table.csv", "spur-pair", "--free", "zeta", "--harmonics", "2", "--starts", "1"], folder)
    try:
        pairs = read(path, made)
    except (ValueError, KeyError) as error:
        if what == "valid":
            return pool.Wrong("refused", f"{read.__name__}: a valid table", str(error)[:300])
        return _clean(error)
    if what == "spoilt":
        return pool.Wrong("nonsense", f"{read.__name__} accepts an invalid {fault.split()[0]}", fault)
    for found, right in pairs if what == "valid" else ():
        if np.shape(found) != np.shape(right) or not np.allclose(found, right, rtol=1e-6, atol=0):
            return pool.Wrong("misread", read.__name__, f"{np.ravel(found)[:3]} and not {np.ravel(right)[:3]}")
    return None


def matrices(rng: Random) -> dict[str, np.ndarray]:
    n = int(rng.integers(1, 7))
    A, J = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    return {"M": np.diag(rng.uniform(1, 2, n)), "K": A @ A.T + np.eye(n), "C": 0.1 * np.eye(n), "G": J - J.T}


def saved(rng: Random, suffix: str, found: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of a file with all matrices."""
    given = {name: scipy.sparse.csc_array(A) if rng.random() < 0.3 else A for name, A in found.items()}
    buffer = io.BytesIO()
    if suffix == ".npz":
        np.savez(buffer, **found)
    elif suffix == ".mat":
        scipy.io.savemat(buffer, given, do_compression=bool(rng.random() < 0.5))
    else:
        _save_hdf5(buffer, given)
    return buffer.getvalue()


def _save_hdf5(buffer: io.BytesIO, given: dict[str, Any]) -> None:
    """Write matrices in the layout of MATLAB version 7.3."""
    import h5py

    with h5py.File(buffer, "w", userblock_size=512) as file:
        for name, A in given.items():
            if scipy.sparse.issparse(A):
                node = file.create_group(name)
                node["data"], node["ir"], node["jc"] = A.data, A.indices, A.indptr
                node.attrs["MATLAB_sparse"] = np.uint64(A.shape[0])
            else:
                node = file.create_dataset(name, data=A.T)
            node.attrs["MATLAB_class"] = np.bytes_(b"double")


def attempt_matrices(rng: Random, folder: Path, note: pool.Note) -> pool.Wrong | None:
    try:
        import h5py  # noqa: F401

        forms = (".npz", ".mat", ".h5")
    except ImportError:
        forms = (".npz", ".mat")
    form = pick(rng, (*forms, ".mtx", ".npy"))
    found, damaged = matrices(rng), rng.random() < 0.6
    source: Any = folder / f"all{'.mat' if form == '.h5' else form}"
    if form in forms:
        content = saved(rng, form, found)
        source.write_bytes(_bytes(rng, content) if damaged else content)
    else:
        source = {name: folder / f"{name}{form}" for name in found}
        for name, path in source.items():
            buffer = io.BytesIO()
            np.save(buffer, found[name]) if form == ".npy" else scipy.io.mmwrite(buffer, found[name], precision=17)
            path.write_bytes(_bytes(rng, buffer.getvalue()) if damaged and rng.random() < 0.4 else buffer.getvalue())
    note(f"from_matrices, {form}, {'damaged' if damaged else 'valid'}, n = {len(found['M'])}")
    try:
        read = hb.io.from_matrices(source)
    except (ValueError, KeyError) as error:
        return _clean(error) if damaged else pool.Wrong("refused", f"{form}: valid matrices", str(error)[:300])
    for name, right in found.items() if not damaged else ():
        A = getattr(read, name)
        A = A.toarray() if scipy.sparse.issparse(A) else A
        if np.shape(A) != right.shape or not np.allclose(A, right, rtol=1e-12, atol=1e-15):
            return pool.Wrong("misread", f"{form}: {name}", f"{np.ravel(A)[:3]} and not {np.ravel(right)[:3]}")
    return None


def make() -> pool.Attempt:
    """Return the function that runs one attempt of this fuzzer."""

    def attempt(seed: int, folder: Path, note: pool.Note) -> pool.Wrong | None:
        rng = np.random.default_rng([4, seed])
        for path in folder.iterdir():
            if path.suffix in (".csv", ".mat", ".npz", ".mtx", ".npy"):
                path.unlink()
        return (attempt_matrices if rng.random() < 0.2 else attempt_table)(rng, folder, note)

    return attempt


if __name__ == "__main__":
    pool.main("tables", make)
