"""Reports: one page that says everything, and is used in a real browser as a person would."""

import base64
import hashlib
import json
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from browser import browser, check_only_own_scripts_run, check_toolbars, clicked, complaints, opened, resized
from machines import single_mass

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import usual_measure
from hbgear.analysis.quantities.engineering_quantities import are_meshes, transmission_error
from hbgear.analysis.summary import summary_facts, title_of
from hbgear.cli.app import main
from hbgear.common import optional
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.design.fitting.measurement_table import measurements_of
from hbgear.design.studies.results import Results, read_results
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.plot.branch_sections import SmoothCurve
from hbgear.web import view
from hbgear.web.overlay import dots, dots_of
from hbgear.web.page import PALETTES, in_script
from hbgear.web.studies import lines_of, study_section
from hbgear.web.view import views

pytest.importorskip("plotly")


@pytest.fixture(scope="module")
def pair():
    model = hb.SpurPair(zeta=0.04, reference=(38000.0, 37.6e-6, 15000.0, 25))
    return hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.5, 0.3))


@pytest.fixture(scope="module")
def page(pair, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "pair.html"
    hb.report(pair, title="A <pair> & more", validation=hb.validate(pair, 1)).save(path)
    return path


@pytest.fixture(scope="module")
def driver():
    with browser() as found:
        yield found


@pytest.fixture
def shown(driver, page):
    """The page, opened without a network."""
    resized(driver, 1280, 1000)
    nothing = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
    driver.execute_cdp_cmd("Network.emulateNetworkConditions", nothing)
    opened(driver, page.as_uri())
    return driver


# ---- what is written


@pytest.mark.parametrize(
    ("model", "title"),
    [
        (hb.Duffing(F=0.3), "Duffing, F = 0.3"),
        (
            hb.SpurPair(zeta=0.04, e=(0.2, 0.1), reference=(38000.0, 37.6e-6, 15000.0, 25)),
            "Spur pair, zeta = 0.04, e = (0.2, 0.1)",
        ),
        (hb.gears.DoubleHelicalPair(), "Double helical pair"),
        (hb.gears.PlanetarySet(), "Planetary set 28/36/100, 4 planets, 300 N m"),
        (
            hb.System([[1.0]], None, [[1.0]], [hb.Element([1.0], hb.Cubic(1.0), name=f"s{i}") for i in range(5)]),
            "Structure of 1 coordinate with s0, s1, s2 and 2 more elements",
        ),
    ],
)
def test_titles_are_words(model, title):
    curve = hb.trace(hb.HarmonicBalance(model, 2), "Omega", (1.5, 1.49), stability=False, special=False)
    assert title_of(curve) == title


def test_drawn_values_are_those_of_the_curve(pair):
    (drawn,) = view.views([pair], ["pair"])
    assert json.loads(json.dumps(drawn, allow_nan=False)) == json.loads(json.dumps(drawn))
    np.testing.assert_allclose(drawn["amplitudes"]["pp2"][0], pair.amplitude("pp2"), rtol=1e-6)
    X = np.frombuffer(base64.b64decode(drawn["coefficients"]), "<f4").reshape(pair.X.shape)
    np.testing.assert_allclose(X, pair.X, rtol=1e-6, atol=1e-12)
    assert drawn["scales"]["rpm"] == pytest.approx(pair.problem.model.scales.pinion_speed(1.0))
    dashed = [(first, last) for _, stability, first, last in drawn["sections"][0] if stability == "unstable"]
    inside = [i for first, last in dashed for i in range(first + 1, last)]
    assert inside and not pair.stable[inside].any()
    assert [jump["x"] for jump in drawn["jumps"]] == [jump.value for jump in pair.jumps()]
    np.testing.assert_allclose(drawn["multipliers"]["largest"], np.abs(pair.multipliers).max(axis=1), rtol=1e-6)


def test_report_has_jumps_accuracy_and_validation(page, pair):
    text = page.read_text(encoding="utf-8")
    assert "<h1>A &lt;pair&gt; &amp; more</h1>" in text and len(text.encode()) < 6e6
    body = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    for word in (
        "Jumps of a slow sweep",
        "LP1",
        "Estimated relative error",
        "1 of 1 points agree",
        "mean load F_m",
        "11639"[:2],
    ):
        assert word in body
    assert "http://" not in body and "https://" not in body  # nothing to be fetched


def test_warnings_are_highlighted(pair, monkeypatch):
    texts = ("the errors are large; use more harmonics",)
    monkeypatch.setattr("hbgear.analysis.summary.branch_warnings", lambda branch: texts)
    text = hb.report(pair).html
    assert '<p class="warning">warning: the errors are large; use more harmonics</p>' in text


@pytest.mark.slow
def test_several_curves_with_measured_points_and_a_study(pair, tmp_path):
    (tmp_path / "run.csv").write_text("speed [r/min], x\n9000, 0.1\n10000; 0.2\n".replace(";", ","))
    study = hb.design.cases(
        hb.SpurPair(), hb.design.grid(zeta=[0.06]), ("curve",), harmonics=4, span=(1.5, 0.3), processes=1
    )
    made = hb.report([pair, pair], names=["a", "b"], measured=[tmp_path / "run.csv"], studies=[study])
    assert '"name":"case 0"' in made.html and '"name":"run.csv","mode":"markers"' in made.html
    assert "<h2>Study 1</h2>" in made.html
    assert "<iframe srcdoc=" in made._repr_html_() and "MB>" in repr(made)


@pytest.fixture(scope="module")
def scatter(tmp_path_factory):
    """A study, and the folder with its table."""
    folder = tmp_path_factory.mktemp("studies") / "scatter"
    folder.mkdir()
    vary = hb.design.grid(zeta=[0.04, 0.05, 0.2])
    with ThreadPoolExecutor(1) as here:
        found = hb.design.cases(
            hb.SpurPair(), vary, ("peak", "jumps", "curve"), harmonics=6, span=(1.5, 0.3), executor=here
        )
    found.export(folder / "table.npz")
    return found, folder


def test_results_of_a_study_are_those_of_its_file(scatter):
    found, folder = scatter
    read = read_results(folder)
    assert list(read.table) == list(found.table) and list(read.curves) == list(found.curves)
    for name, column in found.table.items():
        np.testing.assert_array_equal(read.table[name], column)
    np.testing.assert_array_equal(read.jumps, found.jumps)
    for case, curve in found.curves.items():
        np.testing.assert_array_equal(read.curves[case], curve)
    assert study_section(read, "a") == study_section(found, "a")


def test_a_study_has_tables(scatter):
    found, _ = scatter
    seen = study_section(found, "study 1")
    assert seen["summary"] == "3 cases; all of their curves are drawn as thin lines"
    (_, _, distribution), (_, _, jumps) = seen["tables"]
    rows = {row[0]: row[1:] for row in distribution}
    assert rows["zeta"] == ["0.040000", "0.040000", "0.050000", "0.20000", "0.20000"]
    assert rows["jumps"] == ["0", "0", "2", "2", "2"]
    rising = found.jumps[found.jumps[:, 2] > 0]
    assert jumps[0][:2] == ["up", "2 of 3"] and jumps[1][:2] == ["down", "2 of 3"]
    assert [float(jumps[0][2]), float(jumps[0][4])] == pytest.approx([rising[:, 1].min(), rising[:, 1].max()], rel=1e-4)
    assert float(jumps[0][5]) == pytest.approx(np.median(rising[:, 3]), rel=1e-3)
    title, headers, rows = seen["cases"]
    assert title == "all cases" and headers == list(found.table) and [row[1] for row in rows][2] == "0.200000"
    drawn = lines_of(found, "study 1")
    assert [line["name"] for line in drawn] == ["study 1", "case 0", "case 1", "case 2"]


@pytest.mark.parametrize(("measure", "element"), [("rms", 0), ("pp2", "gap")])
def test_lines_of_a_study_are_of_its_measure_and_element(tmp_path, measure, element):
    """The page draws them only where it shows this measure, and not among those of the transmission error."""
    with ThreadPoolExecutor(1) as here:
        found = hb.design.cases(
            hb.SpurPair(),
            hb.design.grid(zeta=[0.2]),
            ("curve",),
            harmonics=4,
            span=(1.5, 1.3),
            executor=here,
            measure=measure,
            element=element,
        )
    found.export(tmp_path / "table.npz")
    for study in (found, read_results(tmp_path)):
        for line in lines_of(study, "a"):
            assert (line["measure"], line["element"]) == (measure, element)


def test_tables_of_earlier_versions_have_the_default_measure(scatter, tmp_path):
    found, folder = scatter
    with np.load(folder / "table.npz") as table:
        np.savez(tmp_path / "table.npz", **{name: table[name] for name in table if not name.startswith("curve_m")})
    assert read_results(tmp_path).measure == "pp2" == found.work.measure


def test_many_curves_are_thinned_with_a_note(scatter):
    found, _ = scatter
    curve = next(iter(found.curves.values()))
    table = {name: np.resize(column, 600) for name, column in found.table.items()} | {"case": np.arange(600)}
    many = Results(table, np.empty((0, 5)), dict.fromkeys(range(600), curve))
    drawn = lines_of(many, "a")[1:]
    assert len(drawn) == 200 and (drawn[0]["name"], drawn[-1]["name"]) == ("case 0", "case 599")
    seen = study_section(many, "a")
    assert seen["summary"].endswith("200 of 600 of their curves are drawn as thin lines") and len(seen["tables"]) == 1
    assert seen["cases"][0] == "the first 500 of 600 cases" and len(seen["cases"][2]) == 500


def test_a_study_in_a_folder_is_shown_by_the_command(pair, scatter, tmp_path, capsys):
    pair.save(pair_file := tmp_path / "pair.npz")
    with pytest.raises(SystemExit, match="0"):
        main(["report", str(pair_file), "--study", str(scatter[1]), "-o", str(tmp_path / "a.html")])
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<h2>Study scatter</h2>" in text and "Distribution over the cases" in text and '"name":"case 2"' in text
    with pytest.raises(SystemExit, match="2"):
        main(
            [
                "report",
                str(tmp_path / "pair.npz"),
                "--study",
                str(tmp_path / "pair.npz"),
                "-o",
                str(tmp_path / "b.html"),
            ]
        )
    assert "is not a table of a study" in capsys.readouterr().err and not (tmp_path / "b.html").exists()


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"case": np.arange(2)}, "array jump_table"),
        ({"jump_table": np.zeros((1, 4)), "curve_table": np.zeros((0, 4))}, "array jump_table"),
        ({"jump_table": np.zeros((1, 5)), "curve_table": np.zeros((0, 4))}, "one of them case"),
        (
            {"jump_table": np.zeros((1, 5)), "curve_table": np.zeros((0, 4)), "case": np.arange(2), "a": np.zeros(3)},
            "columns of one length",
        ),
    ],
)
def test_files_that_are_no_table_of_a_study_are_refused(tmp_path, arrays, said):
    np.savez(tmp_path / "table.npz", **arrays)
    with pytest.raises(ValueError, match=f"{said}.*give the folder of hbgear study"):
        read_results(tmp_path)
    (tmp_path / "table.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match="cannot be read as the table of a study"):
        read_results(tmp_path / "table.npz")
    with pytest.raises(FileNotFoundError, match="there is no file"):
        read_results(tmp_path / "other.npz")


def test_invalid_reports_are_refused(pair, tmp_path):
    with pytest.raises(ValueError, match="no curve to report on"):
        hb.report([])
    with pytest.raises(ValueError, match="1 names for 2 branches"):
        hb.report([pair, pair], names=["a"])
    with pytest.raises(ValueError, match=r"must end in \.html"):
        hb.report(pair).save(tmp_path / "a.txt")
    with pytest.raises(FileNotFoundError, match="give a table of measured points"):
        hb.report(pair, measured=[tmp_path / "no.csv"])

    class Line:
        def evaluate(self, X, p):
            return X - p, np.eye(1)

    with pytest.raises(ValueError, match="not a branch of periodic motions"):
        hb.report(hb.trace(Line(), "p", (0, 1), np.array([0.0])))


def test_data_cannot_end_its_script():
    assert in_script({"a": "</script><!--"}) == '{"a":"\\u003c/script>\\u003c!--"}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no rows of numbers"),
        ("a,b\n1,2\n3,4", "column 'b' is unknown; accepted are frequency"),
        ("Omega,x\n1,2\n3,x", "line 3: 'x' in the column 'x' must be a number"),
        ("f [Hz], x\n1,2", "does not know its units"),
        ("Omega, x [um]\n1,2", "does not know its unit of length"),
        ("n, x\n1,2", "'n' has no unit"),
        ("n [Hz], x\n1,2", "may be the mesh frequency or turns per second"),
        ("Omega, x [kg]\n1,2", "has an unknown unit for the amplitude; accepted are um"),
        ("n [furlong], x\n1,2", "has an unknown unit for the frequency"),
    ],
)
def test_measured_points_that_are_none(text, message):
    with pytest.raises(ValueError, match=message):
        dots(measurements_of(text.encode(), "m.csv"), "m.csv", {}, "1")


def test_measured_points_in_every_unit():
    scales = {MESH: 100.0, PINION: 600.0}
    for text in ("Omega x\n0.5 1\n1 2", "f [Hz];x\n50;1\n100;2", "n [rpm]\tx\n300\t1\n600\t2", "0.5,1\n# no\n1,2"):
        (found,) = dots(measurements_of(text.encode(), "m"), "m", scales, "1")
        assert found["x"] == [0.5, 1.0] and found["y"] == [1.0, 2.0] and found["name"] == "m"


def test_measured_sweeps_in_units_of_length_and_both_directions(tmp_path):
    """One half backlash is 37.6 um, and Omega = 1 a speed of 14515 r/min: what is read are 0.5 and 2 of them."""
    model = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (1.2, 0.8), stability=False)
    n = float(model.scales.pinion_speed(1.0))
    rows = [f"{0.9 * n!r};{0.5 * 37.6!r};up", f"{1.1 * n!r};{2 * 37.6!r};down", f"{0.95 * n!r};;down"]
    text = "n [r/min];dte [µm];direction\n" + "\n".join(rows)
    (tmp_path / "run.csv").write_text(text.replace(".", ","), encoding="latin-1")
    up, down = dots_of(tmp_path / "run.csv", [curve])
    assert (up["name"], down["name"]) == ("run.csv, rising", "run.csv, falling") and up["symbol"] != down["symbol"]
    np.testing.assert_allclose([*up["x"], *up["y"], *down["x"], *down["y"]], [0.9, 0.5, 1.1, 2.0], rtol=1e-6)
    np.testing.assert_allclose(down["jumps"], [0.95], rtol=1e-6)
    data = hb.design.read_measurements(tmp_path / "run.csv")
    axes = hb.plot.measured(data, model, hb.plot.response(curve))
    drawn = {line.get_label(): line.get_xydata() for line in axes.lines if str(line.get_label()).startswith("measured")}
    np.testing.assert_allclose(drawn["measured, rising"], [[0.9 * n, 0.5 * 37.6]], rtol=1e-9)  # [r/min], [um]
    np.testing.assert_allclose(drawn["measured, falling"], [[1.1 * n, 2 * 37.6]], rtol=1e-9)


def test_measured_transmission_errors_are_drawn_among_transmission_errors(tmp_path):
    (tmp_path / "run.csv").write_text("Omega,dte\n1,2")
    for reference, e, measure in (
        ((38000.0, 37.6e-6, 15000.0, 25), (0.05,), "dte"),
        ((), (), "pp2"),
        ((), (0.05,), None),
    ):
        model = hb.SpurPair(e=e, eps=(0.1,), reference=reference or hb.SpurPair().reference)
        curve = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (1.2, 1.1), stability=False)
        if measure is None:
            with pytest.raises(ValueError, match="the data are transmission errors"):
                dots_of(tmp_path / "run.csv", [curve])
        else:
            assert [group["measure"] for group in dots_of(tmp_path / "run.csv", [curve])] == [measure]


def test_matrices_have_no_unit_that_is_not_stated():
    """The page called the displacement of any element of matrices "gap [-]"; figures state "model units"."""
    system = single_mass(hb.Unilateral(k=1.0, gap=1.0), F=0.2, name="stop")
    curve = hb.trace(hb.HarmonicBalance(system, 4), "Omega", (1.9, 2.0), stability=False)
    (drawn,) = views([curve], ["stop"])
    assert (drawn["motion"], drawn["unit"], drawn["label"]) == ("d (model units)", "", "Ω")


def test_a_bearing_has_no_transmission_error(tmp_path):
    """Tables, figures and pages show half of the peak-to-peak displacement of a bearing under this name."""
    model = hb.gears.GearRotorBearing(reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (1.5, 1.4), stability=False, special=False)
    assert [usual_measure(curve, element=name) for name in ("gap", "bearing 1", 2)] == ["dte", "pp2", "pp2"]
    assert [name.partition(" [")[0] for name, _ in summary_facts(curve) if "bearing" in name] == ["pp2", "pp2"]
    assert (
        hb.plot.response(curve, element="bearing 1").get_ylabel()
        == "half peak-to-peak of $d$, bearing 1 [\N{MICRO SIGN}m]"
    )
    (shown,) = views([curve], ["a"], with_tables=False)
    assert shown["meshes"] == [True, False, False]
    planets = hb.gears.PlanetarySet()
    assert all(are_meshes(planets, hb.HarmonicBalance(planets, 1).layout))


def test_measured_points_need_curves_in_omega(tmp_path):
    (tmp_path / "run.csv").write_text("Omega,x\n1,2")
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "zeta", (0.05, 0.2), at={"Omega": 0.5}, stability=False)
    with pytest.raises(ValueError, match="a branch is in zeta; measured points need branches in Omega"):
        dots_of(tmp_path / "run.csv", [curve])


@pytest.mark.slow
def test_command(pair, tmp_path, run, monkeypatch):
    pair.save("pair.npz")
    code, out, _ = run("report pair.npz -o a.html --validate 1 --title Pair")
    assert code == 0 and "wrote a.html" in out and "Validation" in (tmp_path / "a.html").read_text("utf-8")
    assert run("report pair.npz -o a.png")[0] == 2
    monkeypatch.setattr(optional.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    code, _, err = run("report pair.npz")
    assert code == 2 and "pip install 'hbgear[report]'" in err


def contrast(one: str, other: str) -> float:
    """Ratio of luminances by WCAG 2.1."""

    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    a, b = sorted((luminance(one), luminance(other)))
    return (b + 0.05) / (a + 0.05)


@pytest.mark.parametrize("theme", PALETTES)
def test_colours_stand_out_from_the_paper(theme):
    ink = PALETTES[theme]
    assert contrast(ink["text"], ink["paper"]) >= 7
    assert all(contrast(colour, ink["paper"]) >= 3 for colour in ink["regimes"].values())
    assert all(contrast(colour, ink["paper"]) >= 2.2 for colour in ink["branches"])


def test_policy_of_the_page(page):
    text = page.read_text(encoding="utf-8")
    (policy,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="(.*?)">', text)
    assert policy.startswith("default-src 'none'; ") and "connect-src 'none'" in policy
    allowed = {each.split()[0]: each.split()[1:] for each in policy.split("; ")}
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.S)
    hashes = {f"'sha256-{base64.b64encode(hashlib.sha256(one.encode()).digest()).decode()}'" for one in scripts}
    assert len(scripts) == 2 and set(allowed["script-src"]) == hashes
    assert not re.search(r"<[a-z]+[^>]* on[a-z]+=", re.sub(r"<script>.*?</script>", "", text, flags=re.S))


# ---- in a browser


@pytest.mark.slow
def test_page_needs_no_network_and_has_no_errors(shown):
    assert shown.execute_script("return performance.getEntriesByType('resource').length") == 0
    assert complaints(shown) == []


def test_toolbars_keep_the_data_here(shown):
    check_toolbars(shown)


def test_figure_is_saved_from_the_toolbar(shown):
    """The policy of the page lets Plotly make an image of the figure."""
    found = shown.execute_async_script(
        "Plotly.toImage(document.getElementById('response'), {format: 'svg'}).then(arguments[0], arguments[0])"
    )
    assert str(found).startswith("data:image/svg+xml") and complaints(shown) == []


@pytest.mark.slow
def test_page_in_a_frame_of_a_published_notebook(driver, pair, tmp_path):
    """Sphinx strips lines, expands tabs and splits at other ends of lines; the scripts of the page stay as they are."""
    frame = hb.report(pair, title="pair")._repr_html_()
    published = "\n".join(line.expandtabs(8).rstrip() for line in f"<html><body>\n{frame}\n</body></html>".splitlines())
    (tmp_path / "notebook.html").write_text(published, encoding="utf-8")
    driver.get((tmp_path / "notebook.html").as_uri())
    driver.switch_to.frame(0)
    try:
        driver.execute_async_script("hbgear.ready.then(() => requestAnimationFrame(arguments[0]))")
        assert driver.execute_script("return document.getElementById('response').data.length") > 2
        assert complaints(driver) == []
    finally:
        driver.switch_to.default_content()


def test_only_own_scripts_run(page, driver):
    opened(driver, page.as_uri())
    check_only_own_scripts_run(driver)
    complaints(driver)  # of what was refused


def test_report_is_printed(shown):
    from selenium.webdriver.common.by import By

    shown.execute_script("window.print = () => { window.printed = true; }")
    shown.find_element(By.ID, "print").click()
    assert shown.execute_script("return window.printed") is True


def drawing(shown):
    """Titles and ranges of the horizontal axes of the response, its dashes and its jump arrows."""
    return shown.execute_script(
        "const d = document.getElementById('response');"
        "const axes = Object.keys(d.layout).filter(name => name.startsWith('xaxis')).sort();"
        "return {dashes: d.data.map(t => t.line && t.line.dash), titles: axes.map(a => d.layout[a].title.text),"
        "ranges: axes.map(a => d.layout[a].range), height: d.layout.yaxis.title.text,"
        "arrows: d.layout.annotations.map(a => [a.x, a.ay, a.y])}"
    )


def test_curve_is_drawn_as_engineers_draw(shown, pair):
    drawn = drawing(shown)
    assert {"solid", "dash"} <= set(drawn["dashes"])
    assert drawn["titles"] == ["speed of the pinion [r/min]", "mesh frequency [Hz]"]
    assert drawn["height"] == "dynamic transmission error, half peak-to-peak [\N{MICRO SIGN}m]"
    scales = pair.problem.model.scales
    n, f = np.array(drawn["ranges"])
    Omega = scales.from_pinion_speed(n)
    np.testing.assert_allclose(f, scales.mesh_frequency(Omega))
    assert Omega[0] < 0.3 < 1.5 < Omega[1]
    arrows = [
        [scales.pinion_speed(jump.value), *transmission_error(jump.before), *transmission_error(jump.after)]
        for jump in pair.jumps()
    ]
    assert len(arrows) == 2
    np.testing.assert_allclose(drawn["arrows"], arrows, rtol=1e-5)


def test_lines_are_those_of_the_figures(shown, pair):
    """Vertices are the same on the page and in figures, at the sharp fold of a hard stop and in the drawn traces."""
    model = single_mass(hb.Unilateral(k=1e4, gap=0.5), F=0.3)
    stop = hb.trace(hb.ContactInstants(model, 8), "Omega", (1.9, 1.2))
    amplitude = stop.amplitude("max")
    assert len(stop) > 40 and np.diff(stop.values).min() < 0 < np.diff(stop.values).max()
    for x, y in [
        (stop.values, amplitude),
        (stop.values[:4], amplitude[:4]),
        (np.repeat(stop.values, 2), np.repeat(amplitude, 2)),
    ]:
        for first, last in [(0, len(x) - 1), (len(x) // 3, len(x) - 2)]:
            drawn = shown.execute_script(
                "return hbgearLines.smooth(arguments[0], arguments[1])(arguments[2], arguments[3])",
                x.tolist(),
                y.tolist(),
                first,
                last,
            )
            expected = SmoothCurve(x, y).between(first, last)
            np.testing.assert_allclose([drawn["x"], drawn["y"]], expected, rtol=0, atol=1e-9)
            np.testing.assert_array_equal(sorted(set(drawn["point"])), range(first, last + 1))
    traces = shown.execute_script(
        "return document.getElementById('response').data.filter(t => t.mode === 'lines' && t.x.length > 1)"
        ".map(t => [t.x, t.y])"
    )
    vertices = np.array([xy for x, y in traces for xy in zip(x, y, strict=True) if None not in xy])
    line = SmoothCurve(pair.problem.model.scales.pinion_speed(pair.values), transmission_error(pair))
    whole = np.array(line.between(0, len(pair) - 1)).T
    assert np.abs(vertices[:, None] - whole).max(axis=2).min(axis=1).max() < 1e-5 * whole.max()
    assert len({tuple(x) for x in vertices}) == pytest.approx(len(whole), abs=2)


def test_gaps_in_lines_of_other_motions_stay(shown):
    x, y = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.0, 1.0, None, 0.0, 1.0, 4.0, 9.0]
    drawn = shown.execute_script("return hbgearLines.smoothParts(arguments[0], arguments[1])", x, y)
    assert drawn["x"][:3] == [0.0, 1.0, None] and drawn["y"][2:4] == [None, 0.0] and drawn["y"][-1] == 9.0


@pytest.mark.slow
def test_curves_of_different_lengths_are_drawn_without_units(driver, tmp_path):
    """The half backlash differs and the frequencies do not: Omega below, frequency and speed above."""
    curves = [
        hb.trace(hb.HarmonicBalance(hb.SpurPair(reference=(38000.0, b, 15000.0, 25)), 3), "Omega", (1.5, 0.3))
        for b in (37.6e-6, 50e-6)
    ]
    hb.report(curves, names=["a", "b"]).save(tmp_path / "two.html")
    resized(driver, 1280, 1000)
    opened(driver, (tmp_path / "two.html").as_uri())
    drawn, scales = drawing(driver), curves[0].problem.model.scales
    assert drawn["titles"][1:] == ["mesh frequency [Hz]", "speed of the pinion [r/min]"] and "Ω" in drawn["titles"][0]
    Omega, f, n = np.array(drawn["ranges"])
    np.testing.assert_allclose(f, scales.mesh_frequency(Omega))
    np.testing.assert_allclose(n, scales.pinion_speed(Omega))
    jumps = [jump for curve in curves for jump in curve.jumps()]
    arrows = [[jump.value, jump.before.amplitude("pp2"), jump.after.amplitude("pp2")] for jump in jumps]
    np.testing.assert_allclose(drawn["arrows"], arrows, rtol=1e-5)


@pytest.mark.slow
def test_first_motion_of_a_curve_to_infinity_is_on_the_axis(driver, tmp_path):
    """It was the last point if the stability is unknown, or the end stable: an amplitude of 34 in place of 1.5."""
    pair = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))
    curve = hb.trace(hb.HarmonicBalance(pair, 8), "Omega", pair.default_span, stability=False)
    hb.report(curve).save(tmp_path / "far.html")
    opened(driver, (tmp_path / "far.html").as_uri())
    n, i = driver.execute_script("return hbgear.state.at")
    sizes = curve.amplitude("pp2")
    top = driver.execute_script("return hbgear.state.curves[0].top.pp2[0]")
    assert curve.asymptotes and sizes[-1] > 10 * top
    assert (n, sizes[i]) == (0, sizes[sizes <= top].max())


def test_settings_are_described_in_words(pair, tmp_path):
    text = dict(summary_facts(pair))["settings"]
    problem = pair.problem
    assert text == f"harmonics = {problem.H}, samples per period = {problem.N}"
    sampled = hb.HarmonicBalance(hb.SpurPair(), 4, samples=64, nu=2, sampled=True)
    curve = hb.trace(sampled, "Omega", (1.2, 1.19), stability=False)
    words = "harmonics = 4, samples per period = 64, excitation periods in a period = 2, contact forces sampled (AFT)"
    assert dict(summary_facts(curve))["settings"] == words


@pytest.mark.slow
def test_a_click_shows_the_motion(shown, pair):
    from selenium.webdriver.common.by import By

    place, scales = crossings_at(pair, 1.2)[0].nearest, pair.problem.model.scales
    n, um = scales.pinion_speed(pair.values[place]), 1e6 * scales.length
    clicked(shown, n, transmission_error(pair)[place])
    assert f"n = {n:.6g} r/min; " in shown.find_element(By.ID, "chosen").text
    d, t = shown.execute_script("const d = document.getElementById('time'); return [d.data[0].y, d.data[0].x]")
    theta, expected = pair[place].samples(0, len(d) - 1)
    np.testing.assert_allclose(d[:-1], um * expected, rtol=0, atol=1e-5 * um)
    np.testing.assert_allclose(t[:-1], theta / (2 * np.pi), rtol=0, atol=1e-12)
    v = shown.execute_script("return document.getElementById('phase').data[0].y")
    speed = pair.values[place] * pair[place].samples(0, len(d) - 1, order=1)[1]
    mm_per_s = 1e3 * scales.length * scales.frequency
    np.testing.assert_allclose(v[:-1], mm_per_s * speed, rtol=0, atol=1e-5 * mm_per_s)
    mu = shown.execute_script("return document.getElementById('multipliers').data[1].x")
    np.testing.assert_allclose(sorted(mu), sorted(pair.multipliers[place].real), atol=1e-6)


@pytest.mark.slow
def test_keys_go_along_the_curve(shown):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    before = shown.execute_script("return hbgear.state.at")
    response = shown.find_element(By.ID, "response")
    shown.execute_script("arguments[0].focus()", response)
    shown.switch_to.active_element.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
    assert shown.execute_script("return hbgear.state.at") == [before[0], before[1] + 1]


@pytest.mark.slow
def test_measure_and_theme_can_be_chosen(shown, pair):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

    Select(shown.find_element(By.ID, "measure")).select_by_value("H2")
    axis, y = shown.execute_script(
        "const d = document.getElementById('response'); return [d.layout.yaxis.title.text, d.data[0].y]"
    )
    assert "harmonic 2" in axis
    rows = [i for i, point in enumerate(y) if point is not None]
    assert y[0] == pytest.approx(pair.amplitude("H2")[0], rel=1e-5) and rows
    papers = [shown.execute_script("return document.getElementById('response').layout.paper_bgcolor")]
    shown.find_element(By.ID, "theme").click()
    papers.append(shown.execute_script("return document.getElementById('response').layout.paper_bgcolor"))
    assert set(papers) == {theme["paper"] for theme in PALETTES.values()}


@pytest.mark.slow
def test_paper_is_white_and_takes_the_whole_figure(shown):
    shown.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    )
    shown.refresh()
    shown.execute_async_script("hbgear.ready.then(() => requestAnimationFrame(arguments[0]))")
    look = "const d = document.getElementById('response'); return [d.layout.paper_bgcolor, d.layout.width || null]"
    assert shown.execute_script(look)[0] == PALETTES["dark"]["paper"]
    shown.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert shown.execute_script(look) == ["#ffffff", 700]
    shown.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert shown.execute_script(look)[0] == PALETTES["dark"]["paper"]
    shown.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_page_is_redrawn_when_a_phone_is_rotated(shown):
    from selenium.webdriver.support.ui import WebDriverWait

    legend = "return document.getElementById('response')._fullLayout.legend.orientation"
    for width, orientation in ((1280, "v"), (390, "h"), (1280, "v")):
        resized(shown, width, 844)
        WebDriverWait(shown, 20).until(lambda driver, want=orientation: driver.execute_script(legend) == want)


def test_page_fits_a_phone(shown):
    resized(shown, 390, 844)
    shown.refresh()
    shown.execute_async_script("hbgear.ready.then(() => requestAnimationFrame(arguments[0]))")
    assert shown.execute_script("return document.documentElement.scrollWidth") <= 390


def test_jumps_of_a_saved_machine_have_arrows_in_its_units(tmp_path):
    """The points of a file do not know their problem: jumps had no transmission error, and no arrow in the report."""
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    curve = hb.trace(hb.HarmonicBalance(pair, 5), "Omega", (0.9, 0.6))
    curve.save(tmp_path / "pair.npz")
    (fresh,), (loaded,) = (views([one], ["pair"]) for one in (curve, hb.load(tmp_path / "pair.npz")))
    assert len(loaded["jumps"]) == 2
    for one, other in zip(loaded["jumps"], fresh["jumps"], strict=True):
        for end in ("before", "after"):
            assert one[end]["dte"][0] > 0 and one[end]["dte"] == pytest.approx(other[end]["dte"], rel=1e-9)
