"""Tables of receptances, mesh cycles and measurements: every column is read by its name and unit, or refused."""

import os

import numpy as np
import pytest

import hbgear as hb
from hbgear.io.tables.table_text import number_of_cell, table_text

f = np.linspace(0.0, 50.0, 101)
H = 1 / (1e4 - (2 * np.pi * f) ** 2 + 20j * 2 * np.pi * f)
SIZE, ANGLE = np.abs(H), np.degrees(np.angle(H))
POLAR = (f, SIZE, ANGLE)


def written(path, header, columns, mark=",", decimal=".", encoding="utf-8", remark=""):
    lines = [mark.join(repr(float(x)).replace(".", decimal) for x in row) for row in zip(*columns, strict=True)]
    path.write_bytes("\n".join([remark] * bool(remark) + [header] * bool(header) + lines).encode(encoding))
    return path


def receptance(path, **more):
    return np.asarray(hb.io.from_receptances({("a", "a"): path}, **more).values)[:, 0, 0]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("frequency [Hz],mag,phase [deg]", POLAR),
        ("Frequency (Hz),|H| (m/N),Phase (deg)", POLAR),
        ("Frequency (Hz),|H| (m/N),Phase (°)", POLAR),
        ("f,modulus,angle", POLAR),
        ("f [Hz],phase [deg],magnitude", (f, ANGLE, SIZE)),
        ("f [Hz],abs(H),phase [rad]", (f, SIZE, np.radians(ANGLE))),
        ("f [Hz],abs,arg [mrad]", (f, SIZE, 1e3 * np.radians(ANGLE))),
        ("frequency [Hz],magnitude [dB],phase [deg]", (f, 20 * np.log10(SIZE), ANGLE)),
        ("frequency [Hz],magnitude [dB re 1 mm/N],phase [deg]", (f, 20 * np.log10(1e3 * SIZE), ANGLE)),
        ("frequency [kHz],real,imag", (f / 1e3, H.real, H.imag)),
        ("n [r/min],real,imag", (60 * f, H.real, H.imag)),
        ("omega,real,imag", (2 * np.pi * f, H.real, H.imag)),
        ("f / (rad/s),Re(H),Im(H)", (2 * np.pi * f, H.real, H.imag)),
        ("frequency [Hz],real [mm/N],imag [µm/N]", (f, 1e3 * H.real, 1e6 * H.imag)),
        ("frequency [Hz],imag,real,coherence", (f, H.imag, H.real, np.ones_like(f))),
        ("", (f, H.real, H.imag)),
    ],
)
def test_receptances_in_every_unit(tmp_path, header, columns):
    read = receptance(written(tmp_path / "t.csv", header, columns))
    np.testing.assert_allclose(read, H, rtol=1e-9)


def test_the_unit_defines_the_measured_quantity(tmp_path):
    w = 2j * np.pi * f[1:]
    v, a = H[1:] * w, H[1:] * w**2
    for name, unit, values, scale in (("v", "mm/s/N", v, 1e3), ("a", "(m/s²)/N", a, 1.0), ("b", "1/kg", a, 1.0)):
        table = written(
            tmp_path / f"{name}.csv",
            f"f [Hz],real [{unit}],imag [{unit}]",
            (f[1:], scale * values.real, scale * values.imag),
        )
        np.testing.assert_allclose(receptance(table, static=[[1e-4]])[-100:], H[1:], rtol=1e-9)
        with pytest.raises(ValueError, match=r"is that of \w+, not receptance; give quantity="):
            receptance(table, quantity="receptance")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("frequency [Hz],real,phase [deg]", "need a frequency with real and imaginary part"),
        ("frequency [Hz],real,quadrature", "column 'quadrature' is unknown; accepted are frequency .frequency, freq"),
        ("frequency [furlong],real,imag", "an unknown unit for the frequency; accepted are Hz, mHz, kHz"),
        ("frequency [Hz],real [kg],imag [kg]", "an unknown unit for the real part; accepted are m/N"),
        ("frequency [Hz],magnitude,phase [V]", "an unknown unit for the phase; accepted are deg, rad"),
        ("frequency [Hz],real,real", "'real' and 'real' are both the real part"),
        ("n,real,imag", "'n' has no unit; write it as in 'n .Hz.'"),
        ("frequency [Hz],magnitude,phase", "may be degrees or radians"),
        ("x,real,imag", "column 'x' is unknown"),
    ],
)
def test_names_and_units_that_are_not_known(tmp_path, header, message):
    with pytest.raises(ValueError, match=message):
        receptance(written(tmp_path / "t.csv", header, (f, SIZE, np.radians(ANGLE))))


CYCLE = np.array([0.0, 90.0, 180.0, 270.0]), np.array([360.5, 300.25, 240.5, 300.25])


REMARKS = ("", "# measured in May, 20 °C; rig 2", "% x\n! y\n// z")
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-16-le", "utf-32", "latin-1")


@pytest.mark.parametrize("mark", [",", ";", "\t", " ", "   ", ", ", " ; "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_mesh_cycle_with_each_separator_decimal_mark_and_encoding(tmp_path, mark, decimal):
    for i, encoding in enumerate(ENCODINGS):
        _check_cycle(tmp_path, mark, encoding, decimal, REMARKS[i % 3])


def _check_cycle(tmp_path, mark, encoding, decimal, remark):
    header = mark.join(("phase [°]", "stiffness [N/µm]"))
    path = written(tmp_path / "k.csv", header, CYCLE, mark, decimal, encoding, remark)
    if mark.strip() == "," == decimal:
        with pytest.raises(ValueError, match=r"separate columns by semicolons or tabs|another decimal mark"):
            hb.io.read_mesh_table(path)
        return
    np.testing.assert_allclose(hb.io.read_mesh_table(path).value, 1e6 * np.append(CYCLE[1], CYCLE[1][0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("header", "unit", "message"),
    [
        ("phase [cycle],damping [N/m]", "N/m", "column 'damping' is unknown; accepted are stiffness, mesh stiffness,"),
        ("phase [cycle],error [N/m]", "N/m", "column 'error' is unknown"),
        ("phase [cycle],stiffness [um]", "m", "column 'stiffness' is unknown; accepted are error, transmission error"),
    ],
)
def test_a_column_of_another_name_is_no_mesh_cycle_unless_it_is_named(tmp_path, header, unit, message):
    path = written(tmp_path / "k.csv", header, (CYCLE[0] / 360, CYCLE[1]), ",")
    with pytest.raises(ValueError, match=message):
        hb.io.read_mesh_table(path, unit=unit)
    name = header.partition(",")[2].partition(" [")[0]
    factor = 1e-6 if unit == "m" else 1.0
    np.testing.assert_allclose(hb.io.read_mesh_table(path, name, unit).value[:-1], factor * CYCLE[1], rtol=1e-12)
    with pytest.raises(ValueError, match="no column 'phase'; it has 'phase', "):
        hb.io.read_mesh_table(path, "phase", unit)


def test_names_and_units_in_two_lines_in_quotes_and_in_a_remark(tmp_path):
    path = tmp_path / "k.csv"
    rows = "\n".join(f"{x};{k}" for x, k in zip(*CYCLE, strict=True))
    texts = (
        f"phase;k(t)\n[deg];[kN/mm]\n{rows}",
        f"phase;k\n°;kN/mm\n{rows}",
        f"phase;k\r[deg];[kN/mm]\r{rows}".replace("\n", "\r"),
        f"# phase [deg];k [kN/mm]\n{rows}",
        f'"phase [deg]";"k [kN/mm]"\n{rows}',
        "phase [deg],k [kN/mm]\n" + '"' + rows.replace(".", ",").replace(";", '","').replace("\n", '"\n"') + '"',
        f"phase [deg];k [kN/mm];\n{rows.replace(chr(10), ';' + chr(10))};",
    )
    for text in texts:
        path.write_text(text, encoding="utf-8", newline="")
        np.testing.assert_allclose(hb.io.read_mesh_table(path).value[:4], 1e6 * CYCLE[1], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase [deg];k [N/m]\n0;1.234,5\n9;1\n18;1\n", "thousands separators"),
        ("phase [deg];k [N/m]\n0;1,5\n90;1.5\n", "line 3: '1.5' has another decimal mark"),
        ("phase [deg];k [N/m]\n0;1_000\n90;1\n180;1\n", "line 2: '1_000' in the column 'k .N/m.' must be a number"),
        ("phase [deg];k [N/m]\n0;1\n90\n180;1\n", "line 3 has 1 cells, and the table has 2 columns"),
        ("phase [deg];k [N/m]\n0;1\n90;1e999\n180;1\n", "line 3: '1e999' .* finite"),
        ("phase [deg];k [N/m]\n0;" + "1" * 300 + "\n", "line 2: a cell has 300 characters"),
        ('phase [deg];k [N/m]\n0;"1\n', "line 2: quotation marks are not closed"),
        ("rig two\nphase [deg];k [N/m]\n0;1\n", "line 1: 'rig two' is not a row of numbers; mark comments with #"),
        ("phase [deg];k [N/m];e [m]\n0;1\n", "line 3|2 cells"),
        ("roll angle [deg];k [N/m]\n0;1\n90;1\n270;1\n", "the first column is 'roll angle'; need the phase"),
        ("\0\1\2\3\0\0\1", "it is not text"),
        ("phase [deg];k [N/m]\n0;1\n#N/A;1\n180;1\n", "line 3: '#N/A' in the column 'phase .deg.' must be a number"),
        ("0;1\n90;1\n180;1\n", "line of column names"),
    ],
)
def test_cells_that_are_refused(tmp_path, text, message):
    (tmp_path / "k.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=message):
        hb.io.read_mesh_table(tmp_path / "k.csv")


@pytest.mark.parametrize("read", [hb.io.read_mesh_table, hb.design.read_measurements, lambda path: receptance(path)])
def test_pipes_devices_folders_and_large_files_are_refused_at_once(tmp_path, read):
    os.mkfifo(tmp_path / "pipe.csv")
    for path in (tmp_path / "pipe.csv", "/dev/zero", "/dev/null"):
        with pytest.raises(ValueError, match="it is a pipe, a device or a socket; need a regular file"):
            read(path)
    with pytest.raises(ValueError, match="Is a directory"):
        read(tmp_path)
    with open(tmp_path / "large.csv", "wb") as handle:
        handle.truncate(1 << 40)  # a file with a hole, which takes no room
    with pytest.raises(ValueError, match="it has more than 32 MiB"):
        read(tmp_path / "large.csv")


def test_requested_units_are_known(tmp_path):
    path = written(tmp_path / "k.csv", "phase [deg];k [N/m]", CYCLE, ";")
    for unit in ("é", "furlongs/", "N/m**2", "x" * 100):
        with pytest.raises(ValueError, match=r"read_table: unit = .* is not known; need one such as 'N/m'"):
            hb.io.read_mesh_table(path, unit=unit)
    assert hb.io.read_mesh_table(path, unit="N/um").mean == pytest.approx(1e-6 * CYCLE[1].mean())


def test_measurements_in_every_unit(tmp_path):
    path = tmp_path / "m.csv"
    for header, rows, unit, values in (
        ("n [r/min],dte [um],direction,deviation [nm]", "600,1.5,up,20\n1200,2,down,30", "pinion r/min", [600, 1200]),
        ("n [rad/s],dte [mm],sweep,std [%]", "62.8318530718,.0015,+1,1\n1,.002,-1,1", "pinion r/min", [600, 9.549297]),
        ("f [kHz],d [µm],direction,sigma [um]", ".6,1.5,Rising,.02\n1.2,2,Falling,.03", "mesh Hz", [600, 1200]),
        ("omega [rad/s],d [um],direction,sigma", "628.318530718,1.5,up,.02\n1,2,down,.03", "mesh Hz", [100, 0.1591549]),
    ):
        path.write_text(f"{header}\n{rows}", encoding="utf-8")
        data = hb.design.read_measurements(path)
        assert data.unit == unit and data.directions.tolist() == [1, -1]
        np.testing.assert_allclose(data.frequency, values, rtol=1e-6)
        np.testing.assert_allclose(data.amplitude, [1.5e-6, 2e-6], rtol=1e-9)
        expected = [1.5e-8, 2e-8] if "%" in header else [2e-8, 3e-8]
        np.testing.assert_allclose(data.deviation, expected, rtol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("first", ["", "sep=;\r\n", '"sep=;"\r\n'])
@pytest.mark.parametrize("end", ["", ";;", "; ;"])
def test_tables_of_a_german_spreadsheet(tmp_path, encoding, first, end):
    """Units after "in" as in DIN 461, a line with the separator, and empty columns at the end."""
    rows = ["Drehzahl in 1/min;Weg in µm;Richtung", "600;0,5;up", "1200,5;1,5;down"]
    path = tmp_path / "Messung Prüfstand 1.csv"
    path.write_bytes((first + "".join(f"{row}{end}\r\n" for row in rows)).encode(encoding))
    columns = {"frequency": "Drehzahl", "amplitude": "Weg in µm", "direction": "Richtung"}
    data = hb.design.read_measurements(path, columns)
    assert (data.unit, data.frequency.tolist(), data.directions.tolist()) == ("pinion r/min", [600.0, 1200.5], [1, -1])
    np.testing.assert_allclose(data.amplitude, [0.5e-6, 1.5e-6], rtol=1e-15)


def test_empty_columns_are_kept_if_they_are_named_or_have_a_number(tmp_path):
    for text in ("n [r/min];x [um];deviation\n600;1;\n700;2;\n", "n [r/min];x [um];\n600;1;2\n700;2;\n"):
        table = table_text(text, "a.csv")
        assert [len(row.cells) for row in table.rows] == [3, 3] and len(table.headings) == 3


def test_the_columns_of_a_saved_curve_are_selected_as_the_error_says(tmp_path):
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 0.7))
    curve.export(tmp_path / "curve.csv")
    with pytest.raises(ValueError, match=r"'special' is unknown; .* --column amplitude=HEADER$"):
        hb.design.read_measurements(tmp_path / "curve.csv")
    data = hb.design.read_measurements(tmp_path / "curve.csv", {"amplitude": f"pp2_{curve.layout.elements[0]}"})
    assert data.frequency.tolist() == curve.values.tolist()


def test_headings_and_arguments_that_contradict(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("n [r/min],rms [um]\n600,1\n")
    assert hb.design.read_measurements(path).measure == "rms"
    with pytest.raises(ValueError, match="is pinion r/min, and unit = 'mesh Hz' was given"):
        hb.design.read_measurements(path, unit="mesh Hz")
    with pytest.raises(ValueError, match="is rms, and measure = 'max' was given"):
        hb.design.read_measurements(path, measure="max")
    path.write_text("f [Hz],x,coolant\n600,1,20\n")
    with pytest.raises(ValueError, match="'coolant' is unknown"):
        hb.design.read_measurements(path)
    path.write_text("n,x,coolant\n600,1,20\n")
    with pytest.raises(ValueError, match="'n' has no unit"):
        hb.design.read_measurements(path)
    data = hb.design.read_measurements(path, {"frequency": "n", "amplitude": "x"}, unit="pinion r/min", length="um")
    assert data.unit == "pinion r/min" and data.amplitude[0] == pytest.approx(1e-6)


def test_a_remark_with_units_that_names_no_columns_is_not_passed_over(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("# speed [r/min] and dte [um]\n600,1\n")
    with pytest.raises(ValueError, match=r"last remark 'speed .* has the unit 'r/min'; name every column in a line"):
        hb.design.read_measurements(path)
    path.write_text("# of May (rig 2)\n0.6,1\n")
    assert hb.design.read_measurements(path).unit == "Omega"
    path.write_text("# n [r/min], dte [um]\n600,1\n")
    assert hb.design.read_measurements(path).unit == "pinion r/min"


def test_cells_of_numbers():
    good = {"1": 1.0, "-1.5e-3": -0.0015, "1,5": 1.5, "2.5D+2": 250.0, "\u22121": -1.0, ".5": 0.5, "5.": 5.0}
    assert {text: number_of_cell(text) for text in good} == good
    for text in ("", "x", "1_0", "\u0663", "0x1", "1e", "1.2.3", "1,234,567", "1.234,5", "+-1", "1 2", "True"):
        assert number_of_cell(text) is None


def test_words_may_begin_a_line():
    found = table_text("sweep;x\nup;1,5\ndown;2\n", "a.csv")
    assert found.headings == ("sweep", "x") and found.rows[1].cells == ("down", "2")
