"""Damaged or forged branch files are either read or refused with a one-line error."""

import copy
import dataclasses
import io
import json
import os
import random
import struct
import subprocess
import sys
import tracemalloc
import zipfile

import numpy as np
import pytest

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.io.branches.forms import _FORMS

MB = 2**20
JUNK = [
    None,
    True,
    False,
    0,
    1,
    -1,
    7,
    2**40,
    10**400,
    0.5,
    float("nan"),
    float("inf"),
    -1e308,
    "",
    "x",
    "\ud800",
    "Omega",
    "a" * 300,
    [],
    [[]],
    [1, "x"],
    {},
    {"a": 1},
    {"__tuple__": []},
    {"__tuple__": 3},
    {"__tuple__": [1, [2]]},
    {"__array__": "X"},
    {"__array__": "none"},
    {"__array__": ["X"]},
    {"__array__": "header"},
    {"__class__": "Branch"},
    {"__class__": "Point"},
    {"__class__": ["Jump"]},
    {"__class__": "os"},
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the bytes of a file with special points, jumps and landings."""
    path = tmp_path_factory.mktemp("whole") / "b.npz"
    hb.trace(hb.HarmonicBalance(hb.SpurPair(), 4), "Omega", (0.9, 0.5)).save(path)
    return path.read_bytes()


def parts(whole):
    """Return the header and the bytes of every array file."""
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(str(np.load(io.BytesIO(members.pop("header.npy")))))
    return header, members


def packed(array):
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def zipped(members, compression=zipfile.ZIP_STORED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


def with_header(whole, header):
    return zipped({"header.npy": packed(np.array(json.dumps(header))), **parts(whole)[1]})


def declaring(whole, name, text):
    """Return the file with another header text in one array file, its data unchanged."""
    header, members = parts(whole)
    length = struct.unpack("<H", members[name][8:10])[0]
    members[name] = (
        members[name][:8] + struct.pack("<H", len(text)) + text.encode("latin1") + members[name][10 + length :]
    )
    return zipped({"header.npy": packed(np.array(json.dumps(header))), **members})


def places(tree, at=()):
    """Yield the paths to all values of a JSON tree."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in pairs:
        yield (*at, key)
        yield from places(value, (*at, key))


def edited_header(rng, whole):
    header, _ = parts(whole)
    for _ in range(rng.choice([1, 1, 3])):
        place = rng.choice(list(places(header)))
        holder = header
        for key in place[:-1]:
            holder = holder[key]
        if rng.random() < 0.2:
            del holder[place[-1]]
        elif rng.random() < 0.1 and isinstance(holder, dict):
            holder["more"] = copy.deepcopy(rng.choice(JUNK))
        else:
            holder[place[-1]] = copy.deepcopy(rng.choice(JUNK))
    return with_header(whole, header)


def edited_bytes(rng, whole):
    data = bytearray(whole)
    for _ in range(rng.choice([1, 2, 20])):
        at = rng.randrange(len(data))
        how = rng.randrange(4)
        if how == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            data[at : at + 4] = rng.randbytes(4)
        elif how == 2:
            del data[at : at + rng.choice([1, 100])]
        else:
            data[at:at] = rng.randbytes(rng.choice([1, 50]))
    return bytes(data[: rng.randrange(len(data))] if rng.random() < 0.1 else data)


def edited_directory(rng, whole):
    """Change bytes of the central directory, which declares the sizes and kinds of members."""
    start = whole.index(b"PK\x01\x02")
    data = bytearray(whole)
    for _ in range(rng.choice([1, 3])):
        data[rng.randrange(start, len(data))] = rng.randrange(256)
    return bytes(data)


def edited_array(rng, whole):
    """Replace one array by another one, or change its header."""
    header, members = parts(whole)
    name = rng.choice(list(members))
    was = np.load(io.BytesIO(members[name]))
    if rng.random() < 0.5:
        others = [
            was[:-1],
            was[None],
            was.astype(complex),
            was.astype("S8"),
            was.astype("U9"),
            was.real.astype(np.float16),
            np.zeros(0),
            np.full_like(was, -1),
            np.array(3),
            was.T.copy(),
            np.zeros((3, 10**4), bool),
            np.zeros(3, dtype=[("a", float)]),
            np.array(["a", None], dtype=object),
        ]
        members[name] = packed(rng.choice(others))
        return zipped({"header.npy": packed(np.array(json.dumps(header))), **members})
    shapes = ["(10**12,)", "(1000000000000,)", f"({2**60},)", "(-8,)", f"({10**30},)", "(1L,)", "(True,)", "7"]
    texts = [f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}" for shape in shapes]
    kinds = ["'<U0'", "'|O'", "[('a', '<f8')]", "3", "'<f99'"]
    texts += [f"{{'descr': {kind}, 'fortran_order': False, 'shape': (1000000000,), }}" for kind in kinds]
    texts += ["(" * 200, "{'descr'", "'''", "{1: 2}", "[]", "\0" * 30]
    return declaring(whole, name, rng.choice(texts))


EDITS = (edited_header, edited_bytes, edited_directory, edited_array)


def look(path):
    """Return whether the file is read; if not, check the one-line error. The peak memory must stay below 40 MB."""
    tracemalloc.start()
    try:
        hb.load(path)
        return True
    except ValueError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return False
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 40 * MB


@pytest.mark.slow
@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.filterwarnings("ignore:Reading `.npy`")
def test_edited_files_are_read_or_refused(whole, edit, tmp_path, capsys):
    rng = random.Random(edit.__name__)
    path, read = tmp_path / "b.npz", 0
    for _ in range(60):
        path.write_bytes(edit(rng, whole))
        if look(path):
            read += 1
            if read <= 5:
                for command in ("info", "jumps"):
                    with pytest.raises(SystemExit) as end:
                        cli.main([command, str(path)])
                    assert end.value.code in (0, 2)
    assert read < 55  # most edits are detected


def test_files_and_compressed_copies_are_read(whole, tmp_path):
    path = tmp_path / "b.npz"
    path.write_bytes(whole)
    assert look(path)
    header, members = parts(whole)
    assert len(header["branch"]["special"]["__tuple__"]) and len(header["branch"]["jump_records"]["__tuple__"])
    members = {"header.npy": packed(np.array(json.dumps(header))), **members}
    path.write_bytes(zipped(members, zipfile.ZIP_DEFLATED))
    assert look(path)
    path.write_bytes(zipped(members, zipfile.ZIP_BZIP2))
    with pytest.raises(ValueError, match="a compression that NumPy does not write"):
        hb.load(path)


def refused(path, match):
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=match):
            hb.load(path)
        assert tracemalloc.get_traced_memory()[1] < 40 * MB
    finally:
        tracemalloc.stop()


def test_declared_sizes_are_checked_before_anything_is_unpacked(whole, tmp_path):
    path = tmp_path / "b.npz"
    path.write_bytes(declaring(whole, "X.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (125000000000,), }"))
    refused(path, r"declares the shape \(125000000000,\)")
    header, members = parts(whole)
    members["X.npy"] = packed(np.zeros((1, 2**23)))  # 64 MB of zeros, 64 kB in the file
    bomb = zipped({"header.npy": packed(np.array(json.dumps(header))), **members}, zipfile.ZIP_DEFLATED)
    path.write_bytes(bomb)
    refused(path, "it declares 67,")
    at = bomb.index(b"X.npy", bomb.index(b"PK\x01\x02")) - 46  # the directory declares a small size
    assert bomb[at : at + 4] == b"PK\x01\x02"
    path.write_bytes(bomb[: at + 24] + struct.pack("<I", 1000) + bomb[at + 28 :])
    refused(path, "cannot be read as a branch")
    path.write_bytes(zipped({"header.npy": packed(np.array("[" * 200_000)), **members}, zipfile.ZIP_DEFLATED))
    refused(path, "cannot be read as a branch")


@pytest.mark.parametrize("flag, value", [(8, 1), (10, 93)])
def test_encrypted_and_unknown_members(whole, tmp_path, flag, value):
    data, at = bytearray(whole), whole.index(b"PK\x01\x02")
    while data[at : at + 4] == b"PK\x01\x02":
        data[at + flag] |= value
        at += 46 + sum(struct.unpack("<3H", data[at + 28 : at + 34]))
    (tmp_path / "b.npz").write_bytes(data)
    with pytest.raises(ValueError, match="cannot be read as a branch"):
        hb.load(tmp_path / "b.npz")


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are not available")
def test_pipes_and_devices_are_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    for path in (tmp_path / "pipe.npz", "/dev/zero"):
        command = [sys.executable, "-m", "hbgear", "info", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2 and "it is not a regular file" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "place, value, words",
    [
        (("values",), {"__array__": "X"}, r"values is an array .* need 1 dimension"),
        (("multipliers",), {"__array__": "X"}, "need 2 dimensions of complex numbers"),
        (("special", "__tuple__", 0, "index"), 10**6, "at point 1000000 of"),
        (("special", "__tuple__", 0, "label"), 3, "label is 3; need a text"),
        (("status",), "done", "'done' is not a valid Status"),
        (("layout", "nu"), 2, "its header states nu = 1, its points have 2"),
        (("layout", "harmonics"), 5, "do not fit"),
        (("fixed", "zeta"), float("nan"), "zeta is nan; need a finite number"),
        pytest.param(("meta", "trace", "accuracy"), 10**400, "is 1000.*; need a finite number", id="huge"),
        pytest.param(("message",), "\ud800", "message is '.ud800'; need a text", id="surrogate"),
        (("jump_records", "__tuple__", 0, "direction"), 0, "no direction"),
        (("jump_records", "__tuple__", 0, "before"), None, "before is None; need a Point or SpecialPoint"),
    ],
)
def test_errors_are_named(whole, tmp_path, place, value, words):
    header, _ = parts(whole)
    holder = header["branch"]
    for key in place[:-1]:
        holder = holder[key]
    assert place[-1] in holder or isinstance(holder, list)
    holder[place[-1]] = value
    (tmp_path / "b.npz").write_bytes(with_header(whole, header))
    with pytest.raises(ValueError, match=words):
        hb.load(tmp_path / "b.npz")


def test_an_infinite_residual_is_named(whole, tmp_path):
    """Such a file was read in the past, and its largest residual was printed as inf."""
    path = tmp_path / "b.npz"
    path.write_bytes(whole)
    branch = hb.load(path)
    dataclasses.replace(branch, residual=np.full(len(branch), np.inf)).save(path)
    with pytest.raises(ValueError, match="residual has entries that are infinite"):
        hb.load(path)


def test_every_field_that_is_written_is_read():
    # not stored as fields: rebuilt from the model, determined by the kind, or stored next to the branch
    stored = {Branch: {"problem", "full_motion"}, Point: {"problem"}, SpecialPoint: {"problem", "event"}}
    for kind, forms in _FORMS.items():
        assert set(forms) == {field.name for field in dataclasses.fields(kind)} - stored.get(kind, set())


@pytest.mark.parametrize(
    "key, value",
    [
        ("model", 3),
        ("model", {"class": "SpurPair", "fields": {"zeta": "x"}}),
        ("model", {"class": [], "fields": {}}),
        ("model", {"class": "SpurPair", "fields": {"e": [[1]]}}),
        ("balance", []),
        ("balance", {"harmonics": 4, "more": 1}),
        ("balance", {"harmonics": 4, "nu": 1, "sampled": False, "auto": None, "samples": 10**12}),
    ],
)
def test_commands_refuse_a_model_that_is_none(whole, tmp_path, capsys, key, value):
    header, _ = parts(whole)
    header["branch"]["meta"][key] = value
    path = tmp_path / "b.npz"
    path.write_bytes(with_header(whole, header))
    for command, code in (("info", 0), ("jumps", 0), ("validate", 2), ("switch", 2)):
        with pytest.raises(SystemExit) as end:
            cli.main([command, str(path), *(["PD1"] if command == "switch" else [])])
        assert end.value.code == code, command
    assert capsys.readouterr().err.count("hbgear: error:") == 2
