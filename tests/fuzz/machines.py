"""Files of machines (TOML): gear pairs, trains, planetary sets, matrices and receptances, and damaged ones of each.

    python -m tests.fuzz.machines --count 2000 --seed 0 --processes 2

A valid variant is read, and gives a model whose equations can be written down. A damaged file gives a model too, or is
refused with one sentence for each error, each with the line of the file it is about.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import hbgear as hb

from . import pool
from .commands import judged
from .files import _bytes, _clear

Random = np.random.Generator
Table = dict[str, Any]

NASTY = [
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
    "1979-05-27",
    "9" * 5000,
    "0x7f",
    '"1 parsec"',
    '"3 mm"',
    '"-80 um"',
    '"1e300 N m"',
    '"é"',
    "'''a\nb'''",
    "[" * 500,
    "{a = 1}",
    '"../x"',
    "[[1]]",
    "1e-300",
    "1e300",
    "10_000_000",
    '"200 N"',
    '"nan m"',
    "[0.1, nan]",
    '"' + "x" * 5000 + '"',
    "-0.0",
    "25.5",
    '"M.mtx"',
    '"/dev/zero"',
]
"""Values that are put in the place of others."""


def written(tree: Table) -> str:
    """A tree of tables, lists of tables and values as TOML."""
    plain = {name: value for name, value in tree.items() if not _is_table(value)}
    lines = [f"{name} = {inline(value)}" for name, value in plain.items()]
    for name, value in tree.items():
        for each in (value if isinstance(value, list) else [value]) if _is_table(value) else ():
            lines += ["", f"[[{name}]]" if isinstance(value, list) else f"[{name}]"]
            lines += [f"{key} = {inline(entry)}" for key, entry in each.items()]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def inline(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(name)} = {inline(each)}" for name, each in value.items()) + " }"
    return f"[{', '.join(map(inline, value))}]" if isinstance(value, list | tuple) else json.dumps(value)


def _some(rng: Random, table: Table, options: Table, share: float = 0.4) -> Table:
    """A table with some of its options."""
    return table | {name: value for name, value in options.items() if rng.random() < share}


def pair_file(rng: Random) -> Table:
    """A machine of one gear pair: every form, with and without supports, helix and modifications."""
    form = str(rng.choice(["torsion", "bearings", "spatial"]))
    helix = {"helix_angle": "15 deg"} if form == "spatial" else {}
    shape = {"tip_relief": "10 um", "profile_shift": 0.1, "inertia": "0.002 kg m^2", "crowning": "2 um"}
    pinion = _some(
        rng, {"teeth": int(rng.integers(20, 40)), "module": "3 mm", "face_width": "20 mm", **helix}, shape, 0.2
    )
    tree: Table = {"torque": str(rng.choice(["200 N m", "150 N m"])), "damping": float(rng.choice([0.02, 0.05]))}
    tree |= {"form": form} if form != "torsion" or rng.random() < 0.5 else {}
    tree |= {"pinion": pinion, "wheel": _some(rng, {"teeth": int(rng.integers(30, 60))}, {"mass": "2 kg"}, 0.3)}
    tree |= {"pair": _some(rng, {"backlash": "80 um"}, {"pitch_error": "5 um", "backlash_measure": "normal"}, 0.3)}
    if form == "torsion":
        return tree
    support = {"stiffness": "3e8 N/m", "damping": 0.02}
    return tree | {
        "support": {
            side: support | ({"tilt": "5e5 N m/rad"} if form == "spatial" else {}) for side in ("pinion", "wheel")
        }
    }


def train_file(rng: Random) -> Table:
    """A train of two or three wheels, by gears or by numbers, with shafts, beams, bearings and a housing."""
    gear = {"teeth": 25, "module": "3 mm", "face_width": "20 mm"}
    wheels: list[Table] = [
        {"name": "in", "torque": "100 N m", "gear": gear},
        {"name": "middle", "x": "82.5 mm", "gear": gear | {"teeth": 30}},
    ]
    mesh = {"first": "in", "second": "middle", "torque": "100 N m", "damping": 0.04, "pair": {"backlash": "80 um"}}
    tree: Table = {"balance": "middle", "wheel": wheels, "mesh": [mesh]}
    if rng.random() < 0.5:
        wheels.append(
            {"name": "out", "teeth": 40, "base_radius": "56.38155725 mm", "inertia": "0.004 kg m^2", "x": "187.5 mm"}
        )
        more = {"half_backlash": "40 um", "eps": [0.2], "damping": 0.03}
        tree["mesh"] = [mesh, _some(rng, {"first": "middle", "second": "out", "k_mean": "4e8 N/m"}, more, 0.6)]
        tree["balance"] = "out"
    if rng.random() < 0.5:
        wheels.append({"name": "flange", "inertia": "0.01 kg m^2"})
        tree["shaft"] = [{"first": "middle", "second": "flange", "torsion": "2e4 N m/rad"}]
    return tree


def ring_file(rng: Random) -> Table:
    """A planetary set as a train, its carrier at rest: sun, planets and a ring with internal teeth."""
    count = int(rng.integers(2, 4))
    gear = {"teeth": 24, "module": "3 mm", "face_width": "20 mm"}
    wheels: list[Table] = [
        {"name": "sun", "torque": "300 N m", "gear": gear},
        {
            "name": "ring",
            "gear": gear | {"teeth": 72, "internal": True, "body_diameter": "260 mm", "tip_diameter": "212.5 mm"},
        },
    ]
    meshes: list[Table] = []
    for i in range(count):
        angle, name = 2 * np.pi * i / count, f"p{i + 1}"
        place = {"x": float(0.072 * np.cos(angle)), "y": float(0.072 * np.sin(angle))}
        wheels.append({"name": name, "gear": gear, **place})
        more = {"damping": 0.04, "pair": {"backlash": "40 um"}}
        pair = {"torque": "100 N m"}
        meshes.append(_some(rng, {"first": "sun", "second": name, **pair, "pair": {}}, more, 0.7))
        meshes.append(_some(rng, {"first": name, "second": "ring", **pair, "pair": {}}, more, 0.7))
    return {"balance": "ring", "wheel": wheels, "mesh": meshes}


def planetary_file(rng: Random) -> Table:
    """A study of a planetary set, or of another model of the catalogue, with some of its fields."""
    from hbgear.harmonic.models import model_registry

    name = str(rng.choice([name for name in model_registry.MODELS if "planet" in name] or [*model_registry.MODELS]))
    name = name if rng.random() < 0.6 else str(rng.choice([*model_registry.MODELS]))
    values = model_registry.MODELS[name]().parameters
    some = [str(each) for each in rng.choice([*values], min(3, len(values)), replace=False)] if values else []
    tree: Table = {"model": name, "base": {each: values[each] for each in some[1:]}}
    return tree | {"grid": {each: [values[each]] for each in some[:1]}, "compute": {"what": ["peak"], "harmonics": 4}}


def structure_file(rng: Random) -> Table:
    """Matrices in files, one or several, or receptances in tables; laws of every kind, loads constant and periodic."""
    laws: list[Table] = [
        {"law": "unilateral", "k": 200.0, "gap": 0.1},
        {"law": "backlash", "k": 50.0, "b": 0.2},
        {"law": "piecewise", "corners": [-0.1, 0.2], "slopes": [3.0, 0.0, 5.0]},
        {"law": "cubic", "k3": 4.0, "k1": 1.0},
    ]
    elements = []
    for i in range(int(rng.integers(1, 4))):
        law = laws[int(rng.integers(len(laws)))]
        direction = {"shaft": 1.0, "case": -1.0} if rng.random() < 0.5 else {"case": 1.0}
        more = {"damping": 0.5, "error": [0.01]} | ({} if law["law"] == "cubic" else {"eps": [0.1]})
        elements.append(_some(rng, {"name": f"e{i}", "direction": direction, **law}, more))
    load = _some(rng, {"cosine": {"1": {"shaft": 4.0}}}, {"constant": {"shaft": 1.0}, "sine": {"2": {"case": 0.5}}})
    names = ["shaft", "case"]
    match rng.integers(3):
        case 0:
            part: Table = {
                "matrices": _some(rng, {"M": "M.mtx", "K": "K.npy", "names": names}, {"C": "C.mtx", "G": "G.mtx"})
            }
        case 1:
            part = {"matrices": {"file": str(rng.choice(["all.mat", "all.npz"])), "names": names, "ratio": 0.05}}
        case _:
            tables = [
                {"response": a, "force": b, "file": f"{a}{b}.csv"}
                for a, b in (("shaft", "shaft"), ("shaft", "case"), ("case", "case"))
            ]
            part = {"receptances": {"tables": tables}}
    return part | {"element": elements, "load": [load]}


FORMS = {
    "pair": pair_file,
    "train": train_file,
    "ring": ring_file,
    "planetary": planetary_file,
    "structure": structure_file,
}


def data_files() -> dict[str, bytes]:
    """Matrices and receptances that structures name."""
    M, K = np.diag([2.0, 5.0]), np.array([[200.0, -100.0], [-100.0, 400.0]])
    C, G = 5e-3 * K, np.array([[0.0, 1.0], [-1.0, 0.0]])
    found: dict[str, bytes] = {}

    def keep(name: str, write: Any) -> None:
        handle = io.BytesIO()
        write(handle)
        found[name] = handle.getvalue()

    for name, A in (("M", M), ("C", C), ("G", G)):
        keep(f"{name}.mtx", lambda handle, A=A: scipy.io.mmwrite(handle, A, symmetry="general"))
    keep("K.npy", lambda handle: np.save(handle, K))
    keep("all.mat", lambda handle: scipy.io.savemat(handle, {"M": M, "K": K, "C": C, "G": G}))
    keep("all.npz", lambda handle: np.savez(handle, M=M, K=K, C=C, G=G))
    f = np.linspace(0.0, 30.0, 301)
    H = np.array([np.linalg.inv(K - (w * 2 * np.pi) ** 2 * M + 2j * np.pi * w * C) for w in f])
    for i, a in enumerate(("shaft", "case")):
        for j, b in enumerate(("shaft", "case")):
            rows = "\n".join(f"{x:.6g},{h.real:.12g},{h.imag:.12g}" for x, h in zip(f, H[:, i, j], strict=True))
            found[f"{a}{b}.csv"] = f"f [Hz],real,imag\n{rows}\n".encode()
    return found


def damaged(rng: Random, text: str) -> bytes:
    """A file with lines changed, moved, doubled or taken out, sometimes with bytes changed."""
    lines = text.splitlines()
    keys = [line.split(" = ")[0] for line in lines if " = " in line] + ["nope", "é", '"a b"', "model", "law", "gap"]
    tables = [line for line in lines if line.startswith("[")] + [
        "[nope]",
        "[[mesh]]",
        "[matrices]",
        "[",
        "[é]",
        "[pair.x]",
    ]
    for _ in range(int(rng.geometric(0.6))):
        at = int(rng.integers(len(lines)))
        value = NASTY[int(rng.integers(len(NASTY)))]
        match rng.integers(8):
            case 0 | 1 | 2:
                if " = " in lines[at]:
                    lines[at] = f"{lines[at].split(' = ')[0]} = {value}"
            case 3:
                lines.insert(at, f"{rng.choice(keys)} = {value}")
            case 4:
                del lines[at]
            case 5:
                lines.insert(at, str(rng.choice(tables)))
            case 6:
                lines.append(lines[at])
            case 7:
                numbers = re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", lines[at])
                if numbers:
                    other = str(rng.choice(["0", "-1", "1e9", "1e-9", "7", "0.5"]))
                    lines[at] = lines[at].replace(str(rng.choice(numbers)), other, 1)
        lines = lines or [""]
    content = "\n".join(lines).encode("utf-8", "replace")
    return _bytes(rng, content) if rng.random() < 0.08 else content


def read(path: Path, study: bool) -> Any:
    """The model of a file, or of a study."""
    from hbgear.cli.support import chosen_model
    from hbgear.design.studies.study_file import read_study

    return read_study(path).model if study else chosen_model(str(path), None)


def attempt(seed: int, folder: Path, note: pool.Note) -> pool.Wrong | None:
    """A valid or damaged file, read, or traced by the command."""
    rng = np.random.default_rng([7, seed])
    _clear(folder)
    for name, content in data_files().items():
        (folder / name).write_bytes(_bytes(rng, content) if rng.random() < 0.02 else content)
    name = str(rng.choice([*FORMS]))
    text = written(FORMS[name](rng))
    valid = rng.random() < 0.25
    if valid:
        for file, content in data_files().items():
            (folder / file).write_bytes(content)
    file, study = folder / "machine.toml", name == "planetary"
    file.write_bytes(text.encode() if valid else damaged(rng, text))
    note(f"{name}, {'valid' if valid else 'damaged'}: {file.read_bytes()[:1500]!r}")
    if rng.random() < 0.06:
        return _commanded(rng, folder, study)
    try:
        model = read(file, study)
        system = model.system()
    except (ValueError, KeyError) as error:
        return _refused(error, valid)
    if not all(np.isfinite(np.asarray(getattr(system, each))).all() for each in "MCK" if valid and not study):
        return pool.Wrong("nonsense", f"{name}: a matrix that is not finite", repr(model)[:300])
    if valid and not study and not np.array_equal(read(file, study).system().K, system.K):
        return pool.Wrong("nonsense", f"{name}: read twice it is another", repr(model)[:300])
    return None


def _refused(error: Exception, valid: bool) -> pool.Wrong | None:
    if valid:
        return pool.Wrong("nonsense", f"a valid file is refused: {pool.place(error)}", str(error)[:500])
    for problem in getattr(error, "problems", (str(error),)):
        if words := pool.raw_words(problem):
            return pool.Wrong("raw", f"{pool.place(error)}: {words}", problem[:300])
        if "\n" in problem or len(problem) > 2000:
            return pool.Wrong("raw", f"{pool.place(error)}: long or of several lines", problem[:300])
        if not pool.LINE.search(problem):
            return pool.Wrong("raw", f"{pool.place(error)}: no line of the file", problem[:300])
    return None


def _commanded(rng: Random, folder: Path, study: bool) -> pool.Wrong | None:
    """One command with the file, kept short."""
    short = ["--harmonics", "2"]
    commands = [
        ["trace", "machine.toml", *short, "--max-points", "5", "--no-stability"],
        ["campbell", "machine.toml", "--points", "3"],
        ["campbell", "machine.toml", "--points", "3", "--open", "e0", "--closed", "e1"],
        ["models", "machine.toml"],
    ]
    if study:
        commands = [["study", "machine.toml", "--processes", "1"]]
    return judged(commands[int(rng.integers(len(commands)))], folder)


def make() -> pool.Attempt:
    """The attempt of this fuzzer."""
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 2), "Omega", (0.5, 0.6))  # kernels are loaded before workers are made
    return attempt


if __name__ == "__main__":
    pool.main("machines", make)
