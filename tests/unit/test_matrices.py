"""Matrices from files, and machines of other programs; stand-ins where those are not installed."""

import io
import os
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import hbgear as hb

M = np.diag([1.0, 2.0, 3.0])
K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
C = 0.05 * K
G = np.array([[0.0, 0.4, 0.0], [-0.4, 0.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.fixture
def folder(tmp_path):
    for name, A in (("mass", M), ("stiff", K), ("damp", C), ("gyro", G)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", scipy.sparse.coo_array(A))
    np.save(tmp_path / "mass.npy", M)
    scipy.io.savemat(tmp_path / "model.mat", {"M": M, "K": scipy.sparse.csc_matrix(K), "C": C, "G": G})
    scipy.io.savemat(tmp_path / "other.mat", {"mass": M, "stiffness": K, "x": np.zeros(3)})
    np.savez(tmp_path / "model.npz", M=M, K=K)
    return tmp_path


def plain(A):
    return None if A is None else A.toarray() if scipy.sparse.issparse(A) else A


def test_files_have_the_matrices(folder):
    by_file = hb.io.from_matrices(
        {"M": folder / "mass.mtx", "K": str(folder / "stiff.mtx"), "C": folder / "damp.mtx", "G": folder / "gyro.mtx"}
    )
    from_matlab = hb.io.from_matrices(folder / "model.mat")
    for found in (by_file, from_matlab):
        for name, A in (("M", M), ("K", K), ("C", C), ("G", G)):
            np.testing.assert_array_equal(plain(getattr(found, name)), A)
    named = hb.io.from_matrices(folder / "other.mat", names={"M": "mass", "K": "stiffness"})
    mixed = hb.io.from_matrices({"M": folder / "mass.npy", "K": K})
    packed = hb.io.from_matrices(folder / "model.npz")
    for found in (named, mixed, packed):
        np.testing.assert_array_equal(plain(found.K), K)
        assert found.C is None and found.G is None and found.n == 3


def test_text_files_have_the_matrix_with_each_separator(folder):
    """As spreadsheets of two languages, ``writematrix`` and ``numpy.savetxt`` write it."""
    texts = {"a.csv": ("%.17g", ","), "b.txt": ("%.18e", " "), "c.dat": ("%.17g", "\t"), "d.csv": ("%.17g", ";")}
    for name, (form, separator) in texts.items():
        np.savetxt(folder / name, K / 3, form, separator)
        if separator == ";":
            (folder / name).write_text((folder / name).read_text().replace(".", ","))
        np.testing.assert_array_equal(hb.io.from_matrices({"M": M, "K": folder / name}).K, K / 3)
    (folder / "e.csv").write_text("1,2,3\n4,x,6\n7,8,9\n")
    with pytest.raises(ValueError, match=r"e\.csv', line 2: 'x' in column 2 must be a number"):
        hb.io.from_matrices({"M": M, "K": folder / "e.csv"})
    (folder / "f.csv").write_text("1,2,3\n4,5\n7,8,9\n")
    with pytest.raises(ValueError, match=r"f\.csv', line 2 has 2 cells"):
        hb.io.from_matrices({"M": M, "K": folder / "f.csv"})
    with pytest.raises(ValueError, match=r"there is no file '.*none\.csv'"):
        hb.io.from_matrices({"M": M, "K": folder / "none.csv"})


def test_a_curve_of_matrices_is_that_of_the_system(folder):
    found = hb.io.from_matrices(folder / "model.mat", dof_names=["a", "b", "c"])
    stop = hb.Element(found.along({"a": 1.0, "c": -1.0}), hb.Unilateral(k=3.0, gap=0.05))
    load = hb.Load(cosine={1: found.along({1: 0.1})})
    system = found.system([stop], load, ratio=0.5)
    by_hand = hb.System(
        M,
        C,
        K,
        [hb.Element([1, 0, -1], stop.law)],
        hb.Load(cosine={1: [0, 0.1, 0]}),
        speed=hb.mechanics.SpeedTerms(G, 0.5),
    )
    X = [hb.HarmonicBalance(model, 6).start(Omega=0.8) for model in (system, by_hand)]
    np.testing.assert_allclose(*X, atol=1e-12)
    assert system.dof_names == ("a", "b", "c")


class Shaft:
    """What from_ross reads of a rotor, with bearings that stiffen with speed."""

    number_dof = 4

    def __init__(self, frequency=(0.0, 10.0), stiffen=0.1, **others):
        self.frequency, self.stiffen = np.array(frequency), stiffen
        self.bearing_elements = [SimpleNamespace(frequency=self.frequency), SimpleNamespace(frequency=None)]
        self.__dict__.update(others)

    def M(self):
        return np.eye(8)

    def C(self, frequency):
        return 0.1 * np.eye(8)

    def K(self, frequency):
        return (1.0 + self.stiffen * frequency) * np.eye(8)

    def G(self):
        J = np.zeros((8, 8))
        J[2, 3], J[3, 2] = 0.5, -0.5
        return J


def test_a_rotor_with_bearings_over_speed():
    found = hb.io.from_ross(Shaft())
    assert found.dof_names[:5] == ("x_0", "y_0", "alpha_0", "beta_0", "x_1")
    assert found.damping is None and found.stiffness is not None
    np.testing.assert_allclose(found.K + found.stiffness(4.0), Shaft().K(4.0))
    stop = hb.Element(found.along({"x_1": 1.0}), hb.Unilateral(k=1.0, gap=0.1))
    system = found.system([stop], hb.Load(cosine={1: found.along({"x_1": 0.1})}), ratio=2.0)
    np.testing.assert_allclose(system.at_speed(1.5).K, Shaft().K(3.0))
    with pytest.raises(ValueError, match="12 rad/s is outside of the bearings of the rotor, which have 0 to 10"):
        system.at_speed(6.0)
    assert hb.io.from_ross(Shaft(stiffen=0.0)).stiffness is None


def test_the_spring_of_gears_is_taken_out():
    gears = [SimpleNamespace(dof_global_index={"a": i, "b": i + 1}) for i in (0, 4)]
    w = np.array([0.5, 1.0, -0.5, -1.0])
    mesh = SimpleNamespace(driving_gear=gears[0], driven_gear=gears[1], stiffness=7.0, gear_ratio=1.0)

    class Coupled(Shaft):
        def K(self, frequency):
            out = super().K(frequency)
            out[np.ix_([0, 1, 4, 5], [0, 1, 4, 5])] += 7.0 * np.outer(w, w)
            return out

    one = SimpleNamespace(K=lambda speed: (1.0 + 0.1 * speed) * np.eye(4))
    pair = {"mesh": mesh, "rotors": {"driving": one, "driven": one}}
    found = hb.io.from_ross(Coupled(**pair))
    direction, k = found.meshes["gears"]
    np.testing.assert_allclose(
        k * np.outer(direction, direction)[np.ix_([0, 1, 4, 5], [0, 1, 4, 5])], 7 * np.outer(w, w)
    )
    np.testing.assert_allclose(found.K, Shaft().K(0.0), atol=1e-12)
    with pytest.raises(ValueError, match="along one line of action"):
        hb.io.from_ross(Shaft(**pair, coupling_matrix=lambda: np.eye(4)))
    for name in ("coupling_matrix", "compute_coupling_matrix"):  # the force of the backlash is computed by ROSS
        open_ = hb.io.from_ross(Shaft(**pair, **{name: lambda: np.outer(w, w)}))
        np.testing.assert_allclose(open_.meshes["gears"][0], direction, atol=1e-12)
        np.testing.assert_array_equal(open_.K, Shaft().K(0.0))
    np.testing.assert_allclose(hb.io.from_ross(Shaft(**pair, K_coupling=np.outer(w, w))).meshes["gears"][0], direction)
    with pytest.raises(ValueError, match="no spring couples the gears of the rotor, and it has no coupling matrix"):
        hb.io.from_ross(Shaft(**pair))
    with pytest.raises(ValueError, match="the gears of the rotor cannot be found"):
        hb.io.from_ross(Coupled(mesh=mesh))


def test_a_drive_train_with_an_elastic_gear():
    w = np.array([0.2, 0.3])
    gear = SimpleNamespace(parent=SimpleNamespace(node=0), node=2, k=1e3, K=lambda: 1e3 * np.outer(w, w))
    coupled = K.copy()
    coupled[np.ix_([0, 2], [0, 2])] += 1e3 * np.outer(w, w)
    train = SimpleNamespace(M=M, K=coupled, C=C, shaft_elements=[], gear_elements=None, elastic_gear_elements=[gear])
    found = hb.io.from_opentorsion(train)
    np.testing.assert_allclose(found.K, K, atol=1e-10)
    assert found.dof_names == ("theta_0", "theta_1", "theta_2") and list(found.meshes) == ["0-2"]
    rigid = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 1.0]])  # node 2 turns with node 1
    train.gear_elements, train.E, train.T = [gear], lambda: None, lambda E: rigid
    named = hb.io.from_opentorsion(train)
    assert named.dof_names == ("theta_0", "theta_1", "theta_3")
    along = rigid.T @ [0.2, 0.0, 0.3, 0.0]
    np.testing.assert_allclose(named.K + 1e3 * np.outer(along, along), coupled, atol=1e-10)
    train.T = lambda E: rigid[:, :2]
    with pytest.raises(ValueError, match=r"leave \(2,\) coordinates, and the matrices of the assembly have 3"):
        hb.io.from_opentorsion(train)


def test_bearings_of_the_newer_ross_have_speeds():
    rotor = Shaft()
    rotor.bearing_elements = [SimpleNamespace(speed=rotor.frequency)]
    np.testing.assert_allclose(hb.io.from_ross(rotor).stiffness(4.0), 0.4 * np.eye(8))


def test_matlab_files_of_version_73(tmp_path):
    """As MATLAB writes them: dense matrices transposed, sparse ones by columns, after 512 bytes of its own."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, A in (("M", M), ("C", C), ("G", G)):
            file[name] = A.T
            file[name].attrs["MATLAB_class"] = np.bytes_(b"double")
        group, columns = file.create_group("K"), scipy.sparse.csc_array(K)
        group.attrs.update({"MATLAB_class": np.bytes_(b"double"), "MATLAB_sparse": np.uint64(3)})
        for name, part in (("data", columns.data), ("ir", columns.indices), ("jc", columns.indptr)):
            group[name] = part
        file["note"] = np.frombuffer("text".encode("utf-16-le"), dtype=np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_(b"char")
    found = hb.io.from_matrices(path)
    for name, A in (("M", M), ("K", K), ("C", C), ("G", G)):
        np.testing.assert_array_equal(plain(getattr(found, name)), A)
    with pytest.raises(ValueError, match="no matrix 'mass', but C, G, K, M: give the names"):
        hb.io.from_matrices(path, names={"M": "mass"})
    damaged = path.read_bytes()
    path.write_bytes(damaged[: len(damaged) // 2])
    with pytest.raises(ValueError, match="cannot be read as matrices"):
        hb.io.from_matrices(path)
    with h5py.File(path, "w") as file:  # half a terabyte that takes no room
        huge = file.create_dataset("M", (1 << 18, 1 << 18), dtype=float, chunks=(1024, 1024))
        huge.attrs["MATLAB_class"] = np.bytes_(b"double")
    with pytest.raises(ValueError, match=r"'M' has 512.0 GiB; need at most 1"):
        hb.io.from_matrices(path)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda f: hb.io.from_matrices(f / "none.mat"), "there is no file '.*none.mat'"),
        (lambda f: hb.io.from_matrices(f / "mass.mtx"), "must be a .mat or .npz file; files of single matrices"),
        (lambda f: hb.io.from_matrices(f / "other.mat"), "no matrix 'M', but mass, stiffness, x: give the names"),
        (lambda f: hb.io.from_matrices({"M": M}), "K is missing"),
        (lambda f: hb.io.from_matrices({"M": M, "K": K, "D": C}), "no matrix 'D'"),
        (lambda f: hb.io.from_matrices({"M": M, "K": K}, names={"D": "x"}), "names has 'D'"),
        (lambda f: hb.io.from_matrices({"M": M, "K": np.eye(2)}), r"K has shape \(2, 2\); need \(3, 3\)"),
        (lambda f: hb.io.from_matrices({"M": M, "K": np.full((3, 3), np.nan)}), "finite"),
        (lambda f: hb.io.from_matrices({"M": M, "K": K, "G": np.eye(3)}), "skew-symmetric"),
        (lambda f: hb.io.from_matrices({"M": M, "K": K}, dof_names=["a"]), "1 dof_names for 3"),
        (lambda f: hb.io.from_matrices({"M": M, "K": K}, dof_names=["a", "b", "a"]), "two coordinates are called 'a'"),
        (lambda f: hb.io.from_matrices({"M": M, "K": f / "other.mat"}), "no matrix 'K', but"),
        (lambda f: hb.io.from_matrices(3.0), "from_matrices"),
        (lambda f: hb.io.Matrices(M, K).along({"q9": 1.0}), "no coordinate 'q9'; it has: q1, q2, q3"),
        (lambda f: hb.io.Matrices(M, K).along({3: 1.0}), "numbers 0 to 2"),
        (lambda f: hb.io.Matrices(M, K).along({"q1": np.inf}), "q1"),
        (lambda f: hb.io.Matrices(M, K).along({}), "values by coordinate"),
        (lambda f: hb.io.from_ross(hb.Duffing()), "needs a ross.Rotor or ross.MultiRotor; got a Duffing"),
        (lambda f: hb.io.from_opentorsion(3), "needs an opentorsion.Assembly; got 3"),
    ],
)
def test_bad_input(folder, make, said):
    with pytest.raises((ValueError, TypeError, KeyError, IndexError), match=said):
        make(folder)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("array real symmetric\n2 2\n1\n0\n1\n5\n5\n5\n5\n5\n", "it has 8 numbers, and its size needs 3"),
        ("array real general\n2 2\n1\n0\n0\n1\0\n", "it has characters that are not part of a number"),
        ("coordinate real general\n2 2 3\n1 1 1.0\n2 2 1.0\n", "it has 6 numbers, and its size needs 9"),
        ("coordinate real general\n2 2 2\n1 1 1.0\n3 2 1.0\n", "it is damaged, or not a .mtx file"),
        ("array real general\n2 2\n1\n0\n0\n1.2.3\n", "it is damaged, or not a .mtx file"),
    ],
)
def test_matrix_market_files_with_other_numbers_than_their_size_needs(tmp_path, text, said):
    """SciPy writes beyond the matrix where a symmetric array has too many, and may end the process."""
    path = tmp_path / "a.mtx"
    path.write_bytes(b"%%MatrixMarket matrix " + text.encode())
    with pytest.raises(ValueError, match=said):
        hb.io.from_matrices({"M": np.eye(2), "K": path})


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_files_with_types_that_there_are_not(tmp_path, compressed):
    """SciPy looks such a type up beyond its table, and may end the process."""
    path = tmp_path / "a.mat"
    values = {"M": M, "K": scipy.sparse.csc_matrix(K), "text": "a", "cell": np.array([M, "b"], dtype=object)}
    scipy.io.savemat(path, values, do_compression=compressed)
    np.testing.assert_array_equal(hb.io.from_matrices(path).M, M)
    good, start = path.read_bytes(), 128
    if compressed:
        import struct
        import zlib

        size = struct.unpack("<I", good[132:136])[0]
        inner = bytearray(zlib.decompress(good[136 : 136 + size]))
    else:
        inner = bytearray(good[start:])
    at = inner.index(M.tobytes()) - 8  # the tag of the numbers of M
    for tag in (b"\x00\x00\x00\x01", b"\xff\xff\xff\x7f", b"\x14\x00\x00\x00"):
        wrong = bytes(inner[:at]) + tag + bytes(inner[at + 4 :])
        if compressed:
            packed = zlib.compress(wrong)
            path.write_bytes(good[:128] + struct.pack("<II", 15, len(packed)) + packed + good[136 + size :])
        else:
            path.write_bytes(good[:128] + wrong)
        with pytest.raises(ValueError, match="cannot be read as matrices: it is damaged"):
            hb.io.from_matrices(path)


@pytest.mark.parametrize("form", ["coo", "dense"])
def test_matrix_market_files_of_every_symmetry(tmp_path, form):
    for A in (K, G, np.arange(9.0).reshape(3, 3)):
        scipy.io.mmwrite(tmp_path / "a.mtx", scipy.sparse.coo_array(A) if form == "coo" else A, comment="of\ntwo lines")
        np.testing.assert_array_equal(plain(hb.io.from_matrices({"M": M, "K": tmp_path / "a.mtx"}).K), A)


def test_a_damaged_file(folder):
    path = folder / "model.mat"
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ValueError, match="cannot be read as matrices"):
        hb.io.from_matrices(path)


def bomb_npz(path, size):
    """A small .npz whose matrix unpacks to zeros of that many bytes; written piece by piece."""
    n = int((size / 8) ** 0.5)
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (n, n)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "MK":
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                member.write(head.getvalue())
                for _ in range(n):
                    member.write(bytes(8 * n))


def bomb_mat(path, size):
    """A small .mat whose matrix unpacks to zeros of that many bytes."""
    n = int((size / 8) ** 0.5)
    name = struct.pack("<II", 1, 1) + b"M" + bytes(7)
    head = struct.pack("<IIIIIIii", 6, 8, 6, 0, 5, 8, n, n) + name + struct.pack("<II", 9, 8 * n * n)
    packing = zlib.compressobj()
    parts = [packing.compress(struct.pack("<II", 14, len(head) + 8 * n * n) + head)]
    parts += [packing.compress(bytes(8 * n)) for _ in range(n)] + [packing.flush()]
    data = b"".join(parts)
    text = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(text + struct.pack("<II", 15, len(data)) + data)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
@pytest.mark.parametrize("make", [bomb_npz, bomb_mat], ids=["npz", "mat"])
def test_an_archive_that_unpacks_to_far_more_is_refused_before_it_is_read(tmp_path, make):
    path = tmp_path / f"big.{make.__name__.removeprefix('bomb_')}"
    make(path, 5e8)
    assert path.stat().st_size < 2e6
    code = (
        "import sys, hbgear as hb\n"
        "def peak(): return int(next(l for l in open('/proc/self/status') if l.startswith('VmHWM')).split()[1]) / 1e3\n"
        "hb.io.Matrices; import scipy.io; before = peak()\n"
        "try: hb.io.from_matrices(sys.argv[1])\n"
        "except ValueError as error: print(error)\n"
        "print(peak() - before)"
    )
    root = str(Path(hb.__file__).parents[1])
    ended = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        env={**os.environ, "PYTHONPATH": root},
        text=True,
        stdout=subprocess.PIPE,
        check=True,
    )
    said, grown = ended.stdout.splitlines()
    assert "cannot be read as matrices: it " in said and " bytes in a file of " in said
    assert float(grown) < 100  # MB


@pytest.mark.parametrize("suffix", ["mat", "npz", "npy"])
def test_a_declared_size_of_four_gigabytes_is_refused_before_memory_is_taken(tmp_path, suffix):
    """Only the headers declare it: the size is compared with a limit before anything is unpacked."""
    path, n = tmp_path / f"big.{suffix}", 23_170  # 8 n^2 = 4.29e9 bytes
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (n, n)})
    if suffix == "mat":
        bomb_mat(path, 8e4)
        good = path.read_bytes()
        inner = zlib.decompress(good[136:])
        packed = zlib.compress(inner[:4] + struct.pack("<I", 8 * n * n) + inner[8:])
        path.write_bytes(good[:128] + struct.pack("<II", 15, len(packed)) + packed)
    elif suffix == "npz":
        np.savez_compressed(path, M=np.zeros((100, 100)), K=np.zeros((100, 100)))
        content = path.read_bytes()
        at = content.index(b"PK\x01\x02")  # the directory, with the sizes of the members
        path.write_bytes(content[: at + 24] + struct.pack("<I", 8 * n * n) + content[at + 28 :])
    else:
        path.write_bytes(head.getvalue() + bytes(8000))
    source = {"M": np.eye(2), "K": path} if suffix == "npy" else path
    tracemalloc.start()
    with pytest.raises(ValueError, match="cannot be read as matrices: it "):
        hb.io.from_matrices(source)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e7


def test_compressed_variables_are_unpacked_once(tmp_path, monkeypatch):
    scipy.io.savemat(tmp_path / "a.mat", {"M": M, "K": scipy.sparse.csc_array(K), "note": "x"}, do_compression=True)
    made, new = [], zlib.decompressobj
    monkeypatch.setattr(zlib, "decompressobj", lambda *more: made.append(1) or new(*more))
    found = hb.io.from_matrices(tmp_path / "a.mat")
    np.testing.assert_array_equal(found.M, M)
    np.testing.assert_array_equal(plain(found.K), K)
    assert len(made) == 3


def test_a_large_matrix_of_zeros_is_read(tmp_path):
    """As compressed files of structures are: their matrices are zero but for a band."""
    A = scipy.sparse.diags_array([1.0, 2.0, 1.0], offsets=[-1, 0, 1], shape=(1500, 1500)).toarray()
    np.savez_compressed(tmp_path / "a.npz", M=A, K=A)
    scipy.io.savemat(tmp_path / "a.mat", {"M": A, "K": A}, do_compression=True)
    for name in ("a.npz", "a.mat"):
        assert hb.io.from_matrices(tmp_path / name).n == 1500


@pytest.mark.parametrize(
    "head",
    [
        "coordinate real general\n3 3 900000000",
        "array real general\n30000 30000",
        "coordinate real general\n2000000 2000000 1",
        "array real symmetric\n30000 30000",
    ],
)
def test_a_table_that_declares_more_than_it_has_is_refused(tmp_path, head):
    (tmp_path / "a.mtx").write_text(f"%%MatrixMarket matrix {head}\n1 1 1.0\n")
    with pytest.raises(ValueError, match="cannot be read as matrices: it declares"):
        hb.io.from_matrices({"M": tmp_path / "a.mtx", "K": np.eye(3)})
