"""Damaged files: saved branches, stores of studies, study files.

    python -m tests.fuzz.files --count 5000 --seed 0 --processes 2

A damaged file gives something whole (every amplitude a finite number, jumps, figure, the same again when saved and
loaded) or is refused with one clean sentence.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import struct
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import hbgear as hb

from . import pool
from .commands import judged

Random = np.random.Generator
Arrays = dict[str, np.ndarray]

STUDY = """
model = "duffing"

[base]
zeta = 0.04

[grid]
F = [0.1, 0.2]

[compute]
what = ["peak"]
harmonics = 2
span = [0.6, 0.8]
"""

SAMPLE = """
model = "spur-pair"

[sample]
method = "latin-hypercube"
count = 2
seed = 3

[sample.parameters]
zeta = ["uniform", 0.04, 0.06]
F_m = ["truncated_normal", 0.1, 0.01, 0.05, 0.2]

[compute]
what = ["peak", "jumps"]
harmonics = 2
span = [1.5, 1.3]
measure = "rms"
element = 0
"""

MEASURED = {
    "measured.csv": b"Omega,amplitude\n0.7,0.3\n0.8,0.5\n0.9,0.9\n1.0,1.4\n",
    "speeds.csv": b"n [r/min];x\n9000;0.1\n10000;0.2\n",
    "directions.csv": b"Omega,amplitude,direction\n0.8,0.5,up\n0.9,0.9,down\n1.0,1.4,up\n",
    "broken.csv": b'Omega,amplitude\n0.7\nx,y\n"\n',
    "cell.csv": b"Omega,amplitude\n" + b"9" * 200_000 + b",1\n",
}
"""Tables of measured points, the last two of which are none."""

NASTY: list[Any] = [
    None,
    True,
    False,
    0,
    1,
    -1,
    2,
    1.5,
    -0.0,
    1e308,
    -1e308,
    float("nan"),
    float("inf"),
    10**30,
    -(10**30),
    2**63,
    10**9,
    "",
    "x",
    "Omega",
    "0.05",
    "é",
    "\u0000",
    "x" * 3000,
    "nan",
    "Branch",
    "header",
    "values",
    [],
    {},
    [[]],
    [1, 2],
    [None],
    {"a": 1},
    {"__array__": "values"},
    {"__array__": "X"},
    {"__array__": "header"},
    {"__array__": 3},
    {"__array__": None},
    {"__array__": []},
    {"__array__": "no"},
    {"__tuple__": []},
    {"__tuple__": 3},
    {"__tuple__": None},
    {"__tuple__": {"a": 1}},
    {"__class__": "Branch"},
    {"__class__": "Point"},
    {"__class__": []},
    {"__class__": "Layout", "harmonics": 3},
    {"__class__": "os"},
    {"__class__": None},
    {"__class__": "__init__"},
]


@cache
def small_files() -> dict[str, bytes]:
    """Files to damage, and for commands: saved branches of several kinds, and a study file."""
    duffing = hb.HarmonicBalance(hb.Duffing(), 3)
    spur = hb.HarmonicBalance(hb.SpurPair(), 3)
    curve = hb.trace(spur, "Omega", (1.5, 0.3))
    branches = {
        "duffing.npz": hb.trace(duffing, "Omega", (0.7, 1.4)),
        "spur.npz": curve,
        "load.npz": hb.trace(duffing, "F", (0.05, 0.3), at={"Omega": 1.1}, stability=False),
        "folds.npz": hb.trace(hb.continuation.FoldProblem(spur, "Omega"), "zeta", (0.05, 0.06), start=curve["LP1"]),
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, branch in branches.items():
            branch.save(Path(folder) / name)
        saved = {name: (Path(folder) / name).read_bytes() for name in branches}
    return {**saved, "good.toml": STUDY.encode(), "sample.toml": SAMPLE.encode(), **MEASURED}


# ---- damage to bytes, to the archive, to arrays, to the header


def _bytes(rng: Random, data: bytes) -> bytes:
    """A few bytes flipped, cut, doubled, moved, or made zero."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        if not out:
            break
        at = int(rng.integers(len(out)))
        size = int(min(rng.geometric(0.05), 4096))
        match rng.integers(6):
            case 0:
                out[at] ^= 1 << int(rng.integers(8))
            case 1:
                del out[at:]
            case 2:
                out[at : at + size] = bytes(len(out[at : at + size]))
            case 3:
                out[at:at] = rng.bytes(size)
            case 4:
                del out[at : at + size]
            case 5:
                out[at:at] = out[at : at + size]
    return bytes(out)


def _members(data: bytes) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(name, archive.read(name)) for name in archive.namelist()]


def _zipped(members: list[tuple[str, bytes]], method: int = zipfile.ZIP_STORED) -> bytes:
    out = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(out, "w", method) as archive:
        warnings.simplefilter("ignore")  # names that are there twice
        for name, content in members:
            archive.writestr(name, content)
    return out.getvalue()


def _archive(rng: Random, data: bytes) -> bytes:
    """Members missing, doubled, renamed, in other order, compressed; entries of the directory changed."""
    members = _members(data)
    i = int(rng.integers(len(members)))
    name, content = members[i]
    match rng.integers(9):
        case 0:
            del members[i]
        case 1:
            members.append((name, members[int(rng.integers(len(members)))][1]))
        case 2:
            members[i] = (str(rng.choice(["x.npy", "../x.npy", "values", "header", "y", "é.npy", "X.npy/"])), content)
        case 3:
            rng.shuffle(members)  # type: ignore[arg-type]
        case 4:
            members[i] = (name, members[int(rng.integers(len(members)))][1])
        case 5:
            members[i] = (name, _bytes(rng, content))
        case 6:
            return _zipped(members, int(rng.choice([zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])))
        case 7:
            return _zipped(
                [(n, c) for n, c in members if n == "header.npy"] + [(f"m{k}.npy", b"") for k in range(3000)]
            )
        case 8:
            return _directory(rng, _zipped(members))
    return _zipped(members)


def _directory(rng: Random, data: bytes) -> bytes:
    """An entry with another flag (encrypted), compression, checksum or size, here and in the central directory."""
    out = bytearray(data)
    field, size = [(6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (4, 2), (26, 2)][int(rng.integers(7))]
    value = int(rng.choice([1, 8, 9, 12, 14, 99, 0x41, 0x800, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF])) % (1 << 8 * size)
    places = [at for at in range(len(out)) if out[at : at + 4] == b"PK\x01\x02"]
    at = places[int(rng.integers(len(places)))]
    local = struct.unpack_from("<I", out, at + 42)[0]
    out[at + field + 2 : at + field + 2 + size] = value.to_bytes(size, "little")
    if rng.random() < 0.7:
        out[local + field : local + field + size] = value.to_bytes(size, "little")
    return bytes(out)


@cache
def _bomb() -> bytes:
    """An archive of 2 MB whose member holds 2 GB of zeros, truly and with the right checksum."""
    count, block = 128, bytes(1 << 24)
    head = _npy("<f8", (count * len(block) // 8,))
    squeeze = zlib.compressobj(9, zlib.DEFLATED, -15)
    parts = [squeeze.compress(head), squeeze.flush(zlib.Z_FULL_FLUSH)]
    piece = squeeze.compress(block) + squeeze.flush(zlib.Z_FULL_FLUSH)
    crc = zlib.crc32(head)
    for _ in range(count):
        parts.append(piece)
        crc = zlib.crc32(block, crc)
    packed = b"".join(parts) + squeeze.flush()
    size = len(head) + count * len(block)
    name = b"values.npy"
    sizes = struct.pack("<III", crc, len(packed), size)
    local = struct.pack("<IHHHHH", 0x04034B50, 20, 0, 8, 0, 33) + sizes + struct.pack("<HH", len(name), 0) + name
    central = (
        struct.pack("<IHHHHHH", 0x02014B50, 20, 20, 0, 8, 0, 33)
        + sizes
        + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0)
        + name
    )
    end = struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, 1, 1, len(central), len(local) + len(packed), 0)
    return local + packed + central + end


def _with_bomb(data: bytes) -> bytes:
    """The branch with the bomb in the place of its values."""
    out = io.BytesIO(_zipped([(name, content) for name, content in _members(data) if name != "values.npy"]))
    bomb = _bomb()
    with zipfile.ZipFile(out) as archive:
        rest = [(info, archive.read(info)) for info in archive.infolist()]
    whole = io.BytesIO(bomb)
    with zipfile.ZipFile(whole, "a") as archive:
        for info, content in rest:
            archive.writestr(info, content)
    return whole.getvalue()


def _npy(descr: str, shape: tuple[int, ...], text: str | None = None) -> bytes:
    head = (text or str({"descr": descr, "fortran_order": False, "shape": shape})).encode("latin1", "replace")
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head) % 65536) + head


def _headers_of_arrays(rng: Random, data: bytes) -> bytes:
    """The text before an array changed: its type, its shape, its form."""
    members = _members(data)
    i = int(rng.integers(len(members)))
    name, content = members[i]
    start = 10 + struct.unpack_from("<H", content, 8)[0]
    text, body = content[10:start].decode("latin1"), content[start:]
    descr = [
        "<f8",
        "|O",
        "<f4",
        ">f8",
        "<i8",
        "<c16",
        "|S8",
        "<U2",
        "|V8",
        "<M8[s]",
        "|b1",
        "<f16",
        "x",
        "<U999999999",
        "|S0",
        [("a", "<f8")],
    ][int(rng.integers(16))]
    shape: Any = [
        (),
        (3,),
        (-1,),
        (0,),
        (10**12,),
        (2**62, 2),
        (4, 10**9),
        (1, 1),
        (0, 10**18),
        (2**70,),
        "x",
        (1.5,),
        (None,),
        (10**8,),
        tuple([1] * 40),
    ][int(rng.integers(15))]
    kept = str(shape) if rng.random() < 0.6 else text[text.index("'shape': ") + 9 : text.index(")") + 1]
    what = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {kept}, }}"
    match rng.integers(6):
        case 0:
            what = text.replace("<f8", "|O")
        case 1:
            what = str(rng.choice(["", "{", "None", "[]", "{'descr': 1}", "(" * 3000, "__import__('os')", "9" * 5000]))
        case 2:
            what = text.replace("'shape'", "'shap'")
    members[i] = (name, _npy("", (), what) + (_bytes(rng, body) if rng.random() < 0.3 else body))
    return _zipped(members)


def _arrays(rng: Random, data: bytes) -> bytes:
    """Other numbers, types or shapes in an array, all of the archive in order."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = str(rng.choice(list(arrays)))
    x = arrays[name]
    choices: list[Callable[[], Any]] = [
        lambda: np.full(x.shape, np.nan),
        lambda: np.full(x.shape, np.inf),
        lambda: np.full(x.shape, 1e308),
        lambda: x[:-1] if x.ndim else x,
        lambda: x.reshape(-1),
        lambda: x[None],
        lambda: np.zeros(0),
        lambda: x[:0] if x.ndim else x,
        lambda: np.array("text"),
        lambda: np.array([b"x"] * max(x.size, 1)),
        lambda: np.zeros(x.shape, dtype=complex),
        lambda: np.full(x.shape, 5 + 3j),
        lambda: np.full(x.shape, "1.5"),
        lambda: np.zeros(x.shape, dtype="M8[s]"),
        lambda: np.full(x.shape, -7),
        lambda: np.full(x.shape, 2**40),
        lambda: np.zeros((1, 1, 1)),
        lambda: np.zeros(x.shape, dtype=bool),
        lambda: np.concatenate([x, x]) if x.ndim else x,
        lambda: x[..., :-1] if x.ndim > 1 else x,
        lambda: np.zeros(x.shape, dtype=[("a", float)]),
        lambda: np.array({}),
        lambda: np.zeros((0, 0)),
        lambda: np.where(np.arange(x.size).reshape(x.shape) == 1, np.nan, x) if x.dtype.kind in "fc" else x,
    ]
    arrays[name] = choices[int(rng.integers(len(choices)))]()
    return _saved(arrays)


def _saved(arrays: Arrays) -> bytes:
    out = io.BytesIO()
    np.savez(out, allow_pickle=True, **arrays)
    return out.getvalue()


def _edited_tree(rng: Random, tree: Any) -> Any:
    """One value of a tree of JSON replaced, removed, added, exchanged, or put one level deeper."""
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], dict | list):
                walk(node[key])

    tree = json.loads(json.dumps(tree))
    walk(tree)
    if rng.random() < 0.5:  # near the root as often as in the many leaves of the points
        places = places[: max(1, min(len(places), 60))]
    node, key = places[int(rng.integers(len(places)))]
    value = NASTY[int(rng.integers(len(NASTY)))]
    match rng.integers(8):
        case 0 | 1 | 2:
            node[key] = value
        case 3:
            del node[key]
        case 4:
            if isinstance(node, dict):
                node[str(rng.choice(["x", "__class__", "__array__", "__tuple__", "problem", "", "self"]))] = value
            else:
                node.append(value)
        case 5:
            other, at = places[int(rng.integers(len(places)))]
            node[key], other[at] = json.loads(json.dumps(other[at])), json.loads(json.dumps(node[key]))
        case 6:
            node[key] = [node[key]] if rng.random() < 0.5 else {"x": node[key]}
        case 7:
            for _ in range(int(rng.choice([3, 900, 20000]))):
                value = [value] if rng.random() < 0.7 else {"a": value}
            node[key] = "DEEP"
            return tree, value
    return tree


def _deep(value: Any) -> str:
    """The JSON of a tree too deep for `json`."""
    opened, closed = [], []
    while isinstance(value, list | dict) and len(value) == 1:
        inner = value[0] if isinstance(value, list) else next(iter(value.values()))
        opened.append("[" if isinstance(value, list) else '{"a":')
        closed.append("]" if isinstance(value, list) else "}")
        value = inner
    return "".join(opened) + json.dumps(value) + "".join(reversed(closed))


def _text_of(edited: Any) -> str:
    if isinstance(edited, tuple):
        tree, value = edited
        return json.dumps(tree).replace('"DEEP"', _deep(value))
    return json.dumps(edited)


def _header(rng: Random, data: bytes) -> bytes:
    """The header edited as a tree, as a text, or no text at all."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    text = str(arrays["header"])
    if rng.random() < 0.85:
        edited = json.loads(text)
        for _ in range(int(rng.geometric(0.7))):
            edited = _edited_tree(rng, edited)
            if isinstance(edited, tuple):
                break
        new = _text_of(edited)
    else:
        texts = [
            "",
            "null",
            "[]",
            "{}",
            "3",
            '"x"',
            "NaN",
            "[" * 100000,
            text[: len(text) // 2],
            text + text,
            text.replace(":", "="),
            text.replace('"schema": 1', '"schema": 1, "schema": 99'),
            text.replace('"schema": 1', '"schema": 99'),
            text.replace('"schema": 1', '"schema": "1"'),
            text.replace("0.0", "9" * 5000),
            text.replace("0.0", "1e999"),
            "\ufeff" + text,
        ]
        new = texts[int(rng.integers(len(texts)))]
    whole = [lambda: np.array(new), lambda: np.array([new, new]), lambda: np.array(new.encode()), lambda: np.array(3.0)]
    arrays["header"] = whole[0 if rng.random() < 0.93 else int(rng.integers(4))]()
    return _saved(arrays)


# ---- what a file must be


def attempt_branch(rng: Random, folder: Path, note: pool.Note) -> pool.Wrong | None:
    """A damaged branch, in Python or on the command line."""
    kinds = {
        "bytes": _bytes,
        "archive": _archive,
        "array headers": _headers_of_arrays,
        "arrays": _arrays,
        "header": _header,
    }
    kind = str(rng.choice(list(kinds), p=[0.15, 0.15, 0.15, 0.15, 0.4]))
    saved = {name: content for name, content in small_files().items() if name.endswith(".npz")}
    base = str(rng.choice(list(saved)))
    file = folder / "case.npz"
    _clear(folder)
    what = f"{kind} of {base}"
    if rng.random() < 0.02:
        what = _odd_place(rng, file)
    else:
        file.write_bytes(kinds[kind](rng, saved[base]))
    if rng.random() < 0.65:
        note(f"hb.load: {what}")
        return loaded(file, rng)
    args = _command(rng, file.name)
    note(f"hbgear {' '.join(args)}: {what}")
    return judged(args, folder)


def _command(rng: Random, file: str) -> list[str]:
    commands = [
        ["info"],
        ["jumps"],
        ["plot", "-o", "out.svg"],
        ["plot", "--point", "LP1", "-o", "out.svg"],
        ["switch", "LP1"],
        ["switch", "PD1"],
        ["validate", "--points", "1"],
        ["sweep", "duffing", "--curve"],
    ]
    shares = [0.34, 0.2, 0.08, 0.03, 0.05, 0.1, 0.1, 0.1]
    name, *rest = commands[int(rng.choice(len(commands), p=shares))]
    if name == "sweep":
        return [name, *rest, file, "--count", "2", "--max-periods", "20", "--tolerance", "1e-2"]
    return [name, file, *rest]


def _odd_place(rng: Random, file: Path) -> str:
    match rng.integers(8):
        case 0:
            os.mkfifo(file)
            return "a FIFO"
        case 1:
            file.symlink_to("/dev/zero")
            return "a link to /dev/zero"
        case 2:
            file.mkdir()
            return "a folder"
        case 3:
            file.symlink_to(file)
            return "a link to itself"
        case 4:
            file.write_bytes(b"")
            return "an empty file"
        case 5:
            file.write_bytes(_with_bomb(small_files()["duffing.npz"]))
            return "2 MB that unpack to 2 GB"
        case 6:
            file.symlink_to("/dev/urandom")
            return "a link to /dev/urandom"
    return "no file"


def loaded(file: Path, rng: Random) -> pool.Wrong | None:
    """Load a branch; it is whole, or refused with one clean sentence."""
    try:
        branch = hb.load(file)
    except ValueError as error:
        return _clean(error)
    except FileNotFoundError:
        return pool.Wrong("traceback", "FileNotFoundError", "") if file.exists() else None
    except OSError as error:
        return _clean(error) or (
            pool.Wrong("raw", f"load: {type(error).__name__}", str(error)) if error.errno else None
        )
    return whole(branch, rng)


def _clean(error: Exception) -> pool.Wrong | None:
    text = str(error)
    if words := pool.raw_words(text):
        return pool.Wrong("raw", f"{pool.place(error)}: {words}", text[:400])
    if "\n" in text or not 10 < len(text) < 1500:
        return pool.Wrong("raw", f"{pool.place(error)}: {len(text)} characters, lines", text[:400])
    return None


def whole(branch: hb.Branch, rng: Random) -> pool.Wrong | None:
    """What is wrong with a branch that was loaded; anything raised here is wrong."""
    assert isinstance(branch, hb.Branch)
    repr(branch), branch.regimes, branch.status.advice, [repr(p) for p in branch.special]
    if not (np.isfinite(branch.values).all() and np.isfinite(branch.X).all()):
        return pool.Wrong("nonsense", "load: values or X not finite", repr(branch)[:300])
    if len(branch) == 0:
        return pool.Wrong("nonsense", "load: no rows", repr(branch))
    for point in (
        branch[0],
        branch[-1],
        *branch.special,
        *(end for j in branch.jumps() for end in (j.before, j.after) if end),
    ):
        _ = repr(point), point.stable, point.regime_name
        if not all(isinstance(x, int | float) and abs(x) < np.inf for x in point.parameters.values()):
            return pool.Wrong("nonsense", "load: parameters of a point", f"{point.parameters}"[:300])
    for element in range(len(branch.layout.elements)) if branch.layout else ():
        for measure in ("rms", "pp2", "max", "H1"):
            if not all(x >= 0 and np.isfinite(x) for x in branch.amplitude(measure, element)):
                return pool.Wrong(
                    "nonsense", f"load: {measure} is not a size", f"{branch.amplitude(measure, element)}"[:200]
                )
            for point in branch.special:
                if not 0 <= point.amplitude(measure, element) < np.inf:
                    return pool.Wrong("nonsense", f"load: {measure} of {point.kind} is not a size", repr(point)[:200])
    for jump in branch.jumps():
        if not (np.isfinite(jump.value) and jump.direction in (1, -1)):
            return pool.Wrong("nonsense", "load: a jump without value or direction", repr(jump)[:300])
    with tempfile.TemporaryDirectory() as folder:
        branch.save(Path(folder) / "again.npz")
        again = hb.load(Path(folder) / "again.npz")
        branch.export(Path(folder) / "again.csv")
        branch.export(Path(folder) / "again.mat")
        if rng.random() < 0.1:
            _drawn(branch, Path(folder))
    if not (np.array_equal(again.X, branch.X) and repr(again) == repr(branch)):
        return pool.Wrong("nonsense", "load: another branch when saved and loaded", f"{branch!r} and {again!r}")
    return None


def _drawn(branch: hb.Branch, folder: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from hbgear import plot

    if branch.layout:
        plot.save(plot.response(branch, "rms"), folder / "again.svg")
        matplotlib.pyplot.close("all")


# ---- studies


class _Here(Executor):
    """Runs each case in this process when it is submitted."""

    def submit(self, task: Any, /, *args: Any, **more: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(task(*args, **more))
        return future


def _cases(store: Path) -> hb.design.Cases:
    vary = hb.design.grid(F=[0.1, 0.12])
    return hb.design.cases(
        hb.Duffing(), vary, ("peak", "jumps", "curve"), harmonics=2, span=(0.6, 0.7), store=store, executor=_Here()
    )


@cache
def _store() -> tuple[dict[str, bytes], dict[str, np.ndarray]]:
    """The files of a finished study by path, and its table."""
    with tempfile.TemporaryDirectory() as folder:
        found = _cases(Path(folder) / "store")
        root = Path(folder) / "store"
        return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}, found.table


def attempt_store(rng: Random, folder: Path, note: pool.Note) -> pool.Wrong | None:
    """A study goes on from a folder in which one file is damaged."""
    files, table = _store()
    _clear(folder)
    root = folder / "store"
    for name, content in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(content)
    name = str(rng.choice([n for n in files if n.endswith(".npz") or rng.random() < 0.5]))
    file = root / name
    if name.endswith(".npz"):
        kinds = [_bytes, _archive, _headers_of_arrays, _arrays, _header]
        damage = kinds[int(rng.integers(len(kinds)))]
        content = damage(rng, files[name])
        what = f"{damage.__name__} of a case"
    else:
        edited = rng.random() < 0.8
        content = _text_of(_edited_tree(rng, json.loads(files[name]))).encode() if edited else _bytes(rng, files[name])
        what = "study.json"
    file.write_bytes(content)
    if rng.random() < 0.03:
        file.unlink()
        what = _odd_place(rng, file)
    note(
        f"hb.design.cases with a damaged store: {what}: {content[:200]!r}"
        if what == "study.json"
        else f"hb.design.cases, damaged: {what}"
    )
    try:
        found = _cases(root)
    except (ValueError, OSError) as error:
        if name.endswith(".npz"):
            return pool.Wrong(
                "nonsense", f"store: a damaged case ends the study: {pool.place(error)}", str(error)[:300]
            )
        return _clean(error)
    for column, values in table.items():
        mine = found.table.get(column)
        if mine is None or mine.dtype.kind != values.dtype.kind or mine.shape != values.shape:
            return pool.Wrong("nonsense", f"store: column {column} is another", f"{mine!r}"[:300])
    if not all(np.isfinite(found.table[c]).all() for c in ("peak", "peak_Omega", "seconds", "jumps")):
        return pool.Wrong("nonsense", "store: text instead of a number", f"{found.table}"[:300])
    found.export(folder / "t.csv")
    found.export(folder / "t.npz")
    return None


VALUES = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e400",
    "true",
    '"x"',
    '""',
    "[]",
    "{}",
    "[1,2,3]",
    '["uniform", 0.1]',
    "1979-05-27",
    "9" * 5000,
    "0x7f",
    '"\\u00e9"',
    "[[1]]",
    "[nan, 1]",
    '["uniform", "a", 1]',
    '["normal", 0.1, inf]',
    "1_000",
    "é",
    "[0.1, 0.1]",
    '["uniform", 0.2, 0.1]',
    "{a = 1}",
    "12:30:00",
    "99999999999",
    '"latin-hypercube"',
    "[true]",
    '["peak", 3]',
    "-0.0",
    '"' + "x" * 5000 + '"',
    "[" * 500,
    "'''a\nb'''",
    "10_000_000",
    '"H1"',
    '"H999"',
    '[["uniform"]]',
    "[0.6, 0.6]",
]


def attempt_study(rng: Random, folder: Path, note: pool.Note) -> pool.Wrong | None:
    """A study file with lines changed; read in Python, or computed by the command."""
    from hbgear.design.studies.study_file import read_study

    _clear(folder)
    lines = str(rng.choice([STUDY, SAMPLE])).splitlines()
    keys = [line.split(" = ")[0] for line in lines if " = " in line] + [
        "nope",
        "é",
        '"a b"',
        "model.x",
        "k3",
        "b",
        "eps",
        "critical",
    ]
    tables = [line for line in lines if line.startswith("[")] + ["[nope]", "[[grid]]", "[compute.what]", "[", "[é]"]
    for _ in range(int(rng.geometric(0.6))):
        at = int(rng.integers(len(lines)))
        pair = f"{rng.choice(keys)} = {VALUES[int(rng.integers(len(VALUES)))]}"
        match rng.integers(8):
            case 0 | 1 | 2:
                if " = " in lines[at]:
                    lines[at] = f"{lines[at].split(' = ')[0]} = {VALUES[int(rng.integers(len(VALUES)))]}"
            case 3:
                lines.insert(at, pair)
            case 4:
                del lines[at]
            case 5:
                lines.insert(at, str(rng.choice(tables)))
            case 6:
                lines[at] = lines[at] * 2
            case 7:
                many = [f"wrong{i} = {VALUES[int(rng.integers(len(VALUES)))]}" for i in range(300)]
                numbers = ", ".join(f"'{i}'" for i in range(300))
                grid = [f"{name} = {[i / 1000 for i in range(1, 200)]}" for name in ("zeta", "k3")]
                lines[at:at] = [many, [f"F = [{numbers}]"], grid][int(rng.integers(3))]
        if not lines:
            lines = [""]
    content = "\n".join(lines).encode("utf-8", "replace")
    if rng.random() < 0.1:
        content = _bytes(rng, content)
    if rng.random() < 0.02:
        content = rng.bytes(50) if rng.random() < 0.5 else b"\xef\xbb\xbf" + content
    file = folder / "study.toml"
    file.write_bytes(content)
    text = content.decode("utf-8", "replace")
    if rng.random() < 0.02:
        note(f"hbgear study study.toml --processes 1: {text[:1500]!r}")
        return judged(["study", "study.toml", "--processes", "1"], folder)
    note(f"read_study: {text[:1500]!r}")
    try:
        asked = read_study(file)
    except ValueError as error:
        for problem in getattr(error, "problems", (str(error),)):
            if words := pool.raw_words(problem):
                return pool.Wrong("raw", f"{pool.place(error)}: {words}", problem[:300])
            if "\n" in problem or len(problem) > 2000:
                return pool.Wrong("raw", f"{pool.place(error)}: long or of several lines", problem[:300])
            if not pool.LINE.search(problem):
                return pool.Wrong("raw", f"{pool.place(error)}: no line of the file", problem[:300])
        return None
    if not np.isfinite(asked.work.span).all() or asked.work.span[0] == asked.work.span[1]:
        return pool.Wrong("nonsense", "study: span", f"{asked.work.span}")
    for i, row in zip(range(3), asked.vary.rows() if asked.vary.size < 10**6 else (), strict=False):
        if not all(np.isfinite(x) for x in row.values() if isinstance(x, float)):
            return pool.Wrong("nonsense", "study: a case is not finite", f"case {i}: {row}"[:300])
    return None


def _clear(folder: Path) -> None:
    for path in folder.iterdir():
        if path.name == "stuck.txt":
            continue
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def make() -> pool.Attempt:
    """The attempt of this fuzzer."""
    small_files(), _store()  # once, before workers are made of this process
    attempts = [attempt_branch, attempt_study, attempt_store]

    def attempt(seed: int, folder: Path, note: pool.Note) -> pool.Wrong | None:
        rng = np.random.default_rng([1, seed])
        return attempts[int(rng.choice(3, p=[0.7, 0.2, 0.1]))](rng, folder, note)

    return attempt


if __name__ == "__main__":
    pool.main("files", make)
