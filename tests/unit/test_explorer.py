"""The explorer: computations, access control, the command, and use in a real browser."""

import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from browser import browser, check_only_own_scripts_run, check_toolbars, clicked, complaints, opened, resized
from machines import gear_pair

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import transmission_error
from hbgear.cli.commands.pages import explored
from hbgear.design.studies.study_file import read_study
from hbgear.io.machines.machine_file import Machine, read_machine, write_machine
from hbgear.web.editable_model import EditableInstance, EditableMachine
from hbgear.web.explorer import Explorer, Request, Superseded
from hbgear.web.server import Server
from hbgear.web.view import view

pytest.importorskip("flask")
pytest.importorskip("plotly")
MODEL = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25), eps=(0.1,))
SPAN = (1.5, 0.3)


def explorer(model=MODEL, span=SPAN, harmonics=8):
    return Explorer(EditableInstance(model, "spur-pair"), span, harmonics)


def machine():
    return Machine(gear_pair(), 200.0, 0.04)


@contextmanager
def served(found):
    """Run a server in a separate thread; shut it down at the end."""
    server = Server(found, "test")
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server._server.shutdown()
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture(scope="module")
def server():
    with served(explorer()) as found:
        yield found


def answer(server, path, body=None, token=None, **headers):
    """Return the status and the text of the response."""
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.port}{path}",
        None if body is None else json.dumps(body).encode(),
        {"X-Hbgear-Token": server.token if token is None else token, "Content-Type": "application/json", **headers},
    )
    try:
        with urllib.request.urlopen(request, timeout=30) as found:
            return found.status, found.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def question(**values):
    return {"session": "s", "values": values, "span": list(SPAN), "harmonics": 8}


# ---- subjects


def test_every_number_of_a_model_is_a_parameter():
    found = {p.name: p for p in EditableInstance(MODEL, "spur-pair").parameters()}
    assert {"zeta", "F_m", "b", "eps[0]", "reference[3]"} <= set(found)
    assert found["F_m"].unit == "-" and found["F_m"].label == "mean load F<sub>m</sub>"
    assert all(p.low <= p.value <= p.high for p in found.values())
    pair = {p.name: p for p in EditableInstance(hb.gears.DoubleHelicalPair(), "double-helical").parameters()}
    assert pair["I_p"].unit == "kg m^2"


def test_values_make_the_model_and_leave_the_rest():
    subject = EditableInstance(MODEL, "spur-pair")
    assert subject.model({p.name: p.value for p in subject.parameters()}) == MODEL
    assert subject.model({"eps[0]": 0.3, "zeta": 0.2}) == MODEL.replace(eps=(0.3,), zeta=0.2)
    for name in ("nope", "eps[1]", "nope[0]"):
        with pytest.raises(KeyError):
            subject.model({name: 1.0})
    with pytest.raises(ValueError, match="zeta"):
        subject.model({"zeta": -1.0})


@pytest.mark.parametrize("subject", [EditableInstance(MODEL, "spur-pair"), EditableMachine(machine())])
def test_python_and_toml_make_the_same_model(subject, tmp_path):
    values = {p.name: p.value for p in subject.parameters()}
    changed = {"zeta": 0.07} if "zeta" in values else {"torque": 250.0, "backlash": 90.0, "tip_relief": 10.0}
    expected = subject.model(values | changed)
    names = {}
    exec(f"import hbgear as hb\n{subject.python(values | changed)}", names)
    assert names["model"] == expected and expected != subject.model(values)
    path = tmp_path / "design.toml"
    path.write_text(subject.toml(values | changed, SPAN, 8), encoding="utf-8")
    if isinstance(subject, EditableMachine):
        model = read_machine(path).model()  # micrometres are written with twelve digits
        assert model.parameters == pytest.approx(expected.parameters, rel=1e-11)
    else:
        study = read_study(path)
        assert study.model.replace(**next(study.vary.rows())) == expected
        assert (study.work.span, study.work.harmonics) == (SPAN, 8)


STRUCTURE = """matrices = { M = [[1.0]], C = [[0.1]], K = [[1.0]] }
element = [{ direction = [1.0], law = "unilateral", k = 2.0, gap = 0.1 }]
load = [{ cosine = { 1 = [0.2] } }]
"""


def test_structures_of_files_and_of_their_curves_are_explored(tmp_path, monkeypatch):
    """The Python text and the study of the page give the model of its sliders."""
    monkeypatch.chdir(tmp_path)
    Path("stop.toml").write_text(STRUCTURE, encoding="utf-8")
    with pytest.raises(ValueError, match=r"--from and --to are needed.* 0.9987"):
        explored("stop.toml", None, None)
    subject, span, H, _ = explored("stop.toml", None, None, ends=("0.5", "1.5"))
    assert (span, H, {p.name: p.value for p in subject.parameters()}) == ((0.5, 1.5), 16, {"k": 2.0, "gap": 0.1})
    values = {"k": 2.0, "gap": 0.2}
    names = {}
    exec(f"import hbgear as hb\n{subject.python(values)}", names)
    assert names["model"].parameters == subject.model(values).parameters == values
    Path("study.toml").write_text(subject.toml(values, span, 8), encoding="utf-8")
    study = read_study("study.toml")
    assert study.model.replace(**next(study.vary.rows())).parameters == values
    hb.trace(hb.HarmonicBalance(hb.io.read_model("stop.toml"), 3), "Omega", (0.5, 0.6)).save("stop.npz")
    subject, span, *_ = explored("stop.npz", None, None)
    exec(f"import hbgear as hb\n{subject.python(values)}", names)
    assert names["model"].parameters == subject.model(values).parameters == values and span == (0.5, 0.6)
    with pytest.raises(ValueError, match=r"a study needs the file of the model, not its curve stop\.npz"):
        subject.toml(values, span, 8)


def test_studies_and_curves_of_files_name_their_file(tmp_path, monkeypatch):
    """The texts of the page had an empty model name, or left out the values that differ from those of the file."""
    monkeypatch.chdir(tmp_path)
    Path("stop.toml").write_text(STRUCTURE, encoding="utf-8")
    Path("study.toml").write_text(
        'model = "stop.toml"\n[base]\nk = 3.0\n[grid]\ngap = [0.3, 0.4]\n[compute]\nspan = [0.5, 1.5]', encoding="utf-8"
    )
    curve = hb.trace(hb.HarmonicBalance(hb.io.read_model("stop.toml"), 3), "Omega", (0.5, 0.6), at={"k": 2.5})
    curve.save("stop.npz")
    write_machine(machine(), "pair.toml")
    pair = hb.io.read_model("pair.toml")
    hb.trace(hb.HarmonicBalance(pair, 3), "Omega", (2.5, 2.4)).save("pair.npz")
    for source, initial in (
        ("study.toml", {"k": 3.0, "gap": 0.3}),
        ("stop.npz", {"k": 2.5, "gap": 0.1}),
        ("pair.npz", pair.parameters),
    ):
        subject, span, H, _ = explored(source, None, None, ends=("0.7", None))
        assert subject.model({}).parameters == initial == {p.name: p.value for p in subject.parameters()}
        name = next(iter(initial))
        for values in ({}, initial, {name: 2.0}):
            names = {}
            exec(f"import hbgear as hb\n{subject.python(values)}", names)
            assert names["model"].parameters == subject.model(values).parameters == {**initial, **values}
        if source == "study.toml":
            Path("again.toml").write_text(subject.toml({}, span, H), encoding="utf-8")
            study = read_study("again.toml")
            assert study.model.replace(**next(study.vary.rows())).parameters == initial
            assert (span, H) == ((0.7, 1.5), 16) == (study.work.span, study.work.harmonics)


def test_python_text_names_public_classes():
    assert (
        EditableInstance(hb.gears.DoubleHelicalPair(), "double-helical").python({}).startswith("model = hb.gears.Dou")
    )


# ---- computations


@pytest.mark.slow
def test_jump_maps_of_a_machine_are_over_its_model():
    found = Explorer(EditableMachine(machine()), SPAN, 4)
    names = [parameter["name"] for parameter in found.start()["parameters"]]
    model = machine().model()
    assert set(names) == set(model.parameters | model.entries)
    axes = {"x": ["Omega", 0.5, 1.2], "y": ["torque", 200.0, 205.0], "Omega": None}
    assert found.jump_map("s", Request({}, SPAN, 4), axes)["lines"]


def test_curve_is_the_traced_one():
    found = explorer()
    result = found.curve("s", Request.of(question(zeta=0.06)))
    curve = hb.trace(hb.HarmonicBalance(MODEL.replace(zeta=0.06), 8), "Omega", SPAN)
    np.testing.assert_allclose(result["curves"][0]["x"], curve.values, rtol=1e-9)
    assert [jump["x"] for jump in result["curves"][0]["jumps"]] == [jump.value for jump in curve.jumps()]
    details = found.details("s", Request.of(question(zeta=0.06)))
    assert details["tables"][0]["jumpTable"][1][0][0] == "LP1" and "zeta=0.06" in details["python"]


def test_python_text_prints_the_jumps_of_all_curves_of_the_page(capsys):
    """A pair whose first curve grows without bound: most jumps are on the curve of the rest of the span."""
    values = {"torque": 200.0, "damping": 0.04, "backlash": 80.0}
    found = Explorer(EditableMachine(machine()), (1.5, 0.55), 8)
    asked = Request(values, (1.5, 0.55), 8)
    found.curve("s", asked)
    details = found.details("s", asked)
    exec(details["python"], {})
    printed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert printed == [row[0] for table in details["tables"] for row in table["jumpTable"][1]] and len(printed) == 3


def test_superseded_computations_are_cancelled():
    found, ended = explorer(harmonics=32), []

    def slow():
        try:
            found.curve("s", Request({}, (1.5, 0.001), 64))
        except Superseded:
            ended.append("overtaken")

    thread = threading.Thread(target=slow)
    thread.start()
    while not found.progress("s", "curve")["busy"] and thread.is_alive():
        time.sleep(0.001)
    assert found.curve("other", Request.of(question()))["curves"]  # another session does not cancel it
    assert found.curve("s", Request.of(question()))["curves"]
    thread.join(60)
    assert ended == ["overtaken"] and found.progress("s", "curve") == {"busy": False}


@pytest.mark.slow
def test_jump_map_is_that_of_the_library():
    axes = {"x": ["Omega", 0.3, 1.5], "y": ["zeta", 0.05, 0.12], "Omega": None}
    result = explorer().jump_map("s", Request({}, SPAN, 4), axes)
    jumps = hb.jump_map(MODEL, "zeta", (0.05, 0.12), frequencies=(0.3, 1.5), harmonics=4)
    assert len(result["lines"]) == len(jumps.arms) and result["message"] == ""
    for line, arm in zip(result["lines"], jumps.arms, strict=True):
        np.testing.assert_allclose(line["x"], arm.Omega, rtol=1e-8)
        np.testing.assert_allclose(line["y"], arm.values, rtol=1e-8)


@pytest.mark.slow
def test_jump_map_of_two_parameters_holds_omega():
    axes = {"x": ["F_m", 0.05, 0.3], "y": ["zeta", 0.045, 0.055], "Omega": 0.75}
    result = explorer().jump_map("s", Request({}, SPAN, 4), axes)
    assert result["lines"]
    line = result["lines"][0]
    F_m, zeta = next((x, y) for x, y in zip(line["x"][3:], line["y"][3:], strict=True) if x is not None)
    problem = hb.HarmonicBalance(MODEL.replace(zeta=zeta), 4)
    curve = hb.trace(problem, "F_m", (0.05, 0.3), at={"Omega": 0.75})
    folds = [p.parameters["F_m"] for p in curve.special if p.kind == "LP"]
    assert min(abs(fold - F_m) for fold in folds) < 1e-4 * F_m


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": [1]}, "numbers by name"),
        ({"values": {"zeta": "x"}}, "zeta must be a finite number"),
        ({"values": {"zeta": True}}, "zeta must be"),
        ({"span": [1]}, "two numbers"),
        ({"span": [1.2, 1.2]}, "from and to, must be positive and different"),
        ({"span": [1.2, -0.1]}, "from and to, must be positive and different"),
        ({"harmonics": 0}, "from 1 to"),
        ({"harmonics": 10**6}, "from 1 to"),
    ],
)
def test_questions_that_are_none_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Request.of(question() | change)


# ---- access control


def test_answers_its_own_page_only(server):
    assert answer(server, "/curve", question())[0] == 200
    assert answer(server, "/curve", question(), token="")[0] == 403
    assert (
        answer(
            server,
            "/curve",
            question(),
            token=server.token[:-1] + "\N{LATIN SMALL LETTER E WITH ACUTE}".encode().decode("latin-1"),
        )[0]
        == 403
    )
    assert answer(server, "/", token="x")[0] == 403
    own = f"http://127.0.0.1:{server.port}"
    assert answer(server, "/curve", question(), Origin=own)[0] == 200
    for origin in ("http://example.com", "null", f"https://127.0.0.1:{server.port}", "http://127.0.0.1:1"):
        assert answer(server, "/curve", question(), Origin=origin)[0] == 403
    assert answer(server, "/curve", question(), Host="example.com")[0] == 403
    assert answer(server, "/curve", question(), **{"Sec-Fetch-Site": "cross-site"})[0] == 403
    assert answer(server, f"/?token={server.token}", token="")[0] == 200


def test_measured_points_of_any_encoding_are_drawn_in_the_units_of_the_figure(server):
    n, length = (float(x) for x in (MODEL.scales.pinion_speed(0.5), 1e6 * MODEL.scales.length))
    text = f"n [r/min];dte [µm];direction\n{n!r};{0.25 * length!r};up\n{2 * n!r};{3 * length!r};down"
    for encoding in ("utf-8", "utf-16", "latin-1"):
        sent = {"content": base64.b64encode(text.encode(encoding)).decode(), "name": "run.csv"}
        status, answered = answer(server, "/measured", {**question(), **sent})
        up, down = json.loads(answered)["groups"]
        assert status == 200 and [up["name"], down["name"]] == ["run.csv, rising", "run.csv, falling"]
        np.testing.assert_allclose([*up["x"], *up["y"], *down["x"], *down["y"]], [0.5, 0.25, 1.0, 3.0], rtol=1e-6)
    for content, said in (
        ("n [r/min],q\n1,2", "'q' is unknown"),
        ("n,x\n1," + "1" * 10**6, "a cell has 1000000"),
        ("n [r/min],x\n1,1e400", "finite"),
    ):
        sent = {"content": base64.b64encode(content.encode()).decode()}
        status, answered = answer(server, "/measured", {**question(), **sent})
        assert status == 200 and said in json.loads(answered)["error"]
    for content in ("?", 3, None, ["a"]):
        status, answered = answer(server, "/measured", {**question(), "content": content})
        assert status == 200 and json.loads(answered)["error"] == "the content of a file must be base64"


@pytest.mark.parametrize("site", ["cross-site", "same-site", "", "Same-Origin "])
def test_requests_of_other_sites_are_refused(server, site):
    assert answer(server, "/curve", question(), **{"Sec-Fetch-Site": site})[0] == 403


@pytest.mark.parametrize("site", ["same-origin", "none"])
def test_requests_of_its_own_site_are_answered(server, site):
    assert answer(server, "/curve", question(), **{"Sec-Fetch-Site": site})[0] == 200


@pytest.mark.parametrize(
    "host", ["localhost", "127.0.0.1", "localhost:1", "example.com", "127.0.0.1.example.com", "::1"]
)
def test_other_hosts_are_refused(server, host):
    assert answer(server, "/curve", question(), Host=host)[0] == 403
    assert answer(server, "/curve", question(), Host=f"localhost:{server.port}")[0] == 200


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Referrer-Policy", "no-referrer"),
        ("X-Content-Type-Options", "nosniff"),
        ("Cache-Control", "no-store"),
        ("Content-Security-Policy", "default-src 'none'"),
        ("Content-Security-Policy", "connect-src 'self'"),
        ("Content-Security-Policy", "base-uri 'none'"),
        ("Content-Security-Policy", "form-action 'none'"),
        ("Content-Security-Policy", "frame-ancestors 'none'"),
    ],
)
@pytest.mark.parametrize("path", ["/?token={}", "/progress?token={}", "/nothing?token={}", "/"])
def test_every_answer_has_the_headers(server, path, name, value):
    """Responses of the page, of data, of an unknown address (404) and of a request without the token (403)."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path.format(server.token)}") as found:
            headers = found.headers
    except urllib.error.HTTPError as error:
        headers = error.headers
    assert value in [part.strip() for part in headers[name].split(";")]
    assert "Access-Control-Allow-Origin" not in headers


def test_the_page_runs_only_its_own_scripts(server):
    policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', answer(server, "/")[1])[1]
    assert "script-src 'sha256-" in policy and "connect-src 'self'" in policy
    assert "unsafe" not in policy.split("script-src")[1].split(";")[0]


@pytest.mark.parametrize("path", ["/curve", "/map", "/measured", "/save/npz", "/cancel"])
@pytest.mark.parametrize("depth", [1000, 100_000])
def test_deeply_nested_requests_are_refused(server, path, depth, capfd):
    text = f'{{"values": {{}}, "x": {"[" * depth}{"]" * depth}}}'
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.port}{path}",
        text.encode(),
        {"X-Hbgear-Token": server.token, "Content-Type": "application/json"},
    )
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=30)
    assert refused.value.code == 400 and "nested too deeply" in refused.value.read().decode()
    assert capfd.readouterr().err == ""


def test_a_measured_cell_without_end_is_refused(server, capfd):
    for text in ("1,2\n" + "9" * 500_000 + ",1", '1,"' + "9" * 500_000):
        status, said = answer(server, "/measured", question() | {"text": text, "name": "a.csv"})
        assert status == 200 and len(json.loads(said)["error"]) < 500
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("begun", [b"", b"POST /curve HTTP/1.1\r\nHost: ", None])
def test_connections_that_say_nothing_are_closed(begun):
    """A client sends nothing, part of the header or part of the body: the connection and its thread end."""
    quiet = Server(explorer(), "quiet", patience=0.5)
    thread = threading.Thread(target=quiet.run, daemon=True)
    thread.start()
    before = threading.active_count()
    if begun is None:
        head = f"POST /curve HTTP/1.1\r\nHost: 127.0.0.1:{quiet.port}\r\nX-Hbgear-Token: {quiet.token}\r\n"
        begun = f"{head}Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{".encode()
    with socket.create_connection(("127.0.0.1", quiet.port), timeout=20) as open_one:
        open_one.sendall(begun)
        while open_one.recv(4096):
            pass  # read the response until the server closes the connection
        end = time.monotonic() + 10
        while threading.active_count() > before:
            assert time.monotonic() < end
            time.sleep(0.02)
    quiet._server.shutdown()
    thread.join(10)


def test_listens_on_this_machine_only(server):
    assert server._server.socket.getsockname() == ("127.0.0.1", server.port)


def test_bad_values_give_one_sentence(server):
    status, text = answer(server, "/curve", question(zeta=-1))
    assert status == 200 and json.loads(text)["error"].startswith("SpurPair: zeta = -1")
    for path, body in (("/curve", question(nope=1)), ("/curve", [1]), ("/save/exe", question())):
        assert json.loads(answer(server, path, body)[1])["error"]
    assert answer(server, "/nothing")[0] == 404
    for axes in (None, [], {"x": 1}, {"x": ["zeta", 1, 2], "y": ["zeta", 1, 2]}, {"x": ["zeta", "a", 2], "y": []}):
        status, text = answer(server, "/map", question() | {"axes": axes})
        assert status == 200 and json.loads(text)["error"]
    assert (
        "choose"
        in json.loads(
            answer(
                server, "/map", question() | {"axes": {"x": ["zeta", 0.1, 0.2], "y": ["F_m", 0.1, 0.11], "Omega": 3.0}}
            )[1]
        )["message"]
    )


def test_files_are_those_of_the_curve(server, tmp_path):
    answer(server, "/curve", question(zeta=0.06))
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.port}/save/npz", json.dumps(question()).encode(), {"X-Hbgear-Token": server.token}
    )
    request.add_header("Content-Type", "application/json")
    with urllib.request.urlopen(request) as found:
        (tmp_path / "c.npz").write_bytes(found.read())
    assert hb.load(tmp_path / "c.npz").meta["model"]["fields"]["zeta"] == 0.06
    assert answer(server, "/save/html", question())[1].startswith("<!DOCTYPE html>")


def test_a_port_in_use_is_reported_and_two_explorers_run_together(server):
    with pytest.raises(ValueError, match=f"port {server.port} is taken by another program; give another by --port"):
        Server(explorer(), "second", server.port)
    with served(explorer()) as second:
        assert second.port != server.port and second.token != server.token
        assert answer(second, "/curve", question(), token=server.token)[0] == 403


# ---- the command


def test_command_refuses_invalid_subjects(tmp_path, run):
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "F", (0.1, 0.12), at={"Omega": 0.9})
    curve.save(tmp_path / "F.npz")
    for words, said in (
        ("nope", "there is no model 'nope'"),
        ("F.npz", "a curve in F"),
        ("no.npz", "there is no file"),
        ("no.toml", "cannot be read as a machine"),
    ):
        code, _, err = run("explore", words, "--no-browser")
        assert code == 2 and said in err and err.count("\n") == 1
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        code, _, err = run("explore", "duffing", "--no-browser", "--port", other.getsockname()[1])
    assert code == 2 and "is taken by another program" in err


def test_own_models_are_explored(tmp_path, capsys, modules_are_forgotten):
    (tmp_path / "mine.py").write_text(
        "import hbgear as hb\n\n@hb.mechanics.model(default_span=(0.5, 1.5))\n"
        "def stop(zeta: float = 0.05, gap: float = 1.0) -> hb.System:\n"
        "    law = hb.Unilateral(k=5.0, gap=gap)\n"
        "    return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [hb.Element([1.0], law)], hb.Load(cosine={1: [0.2]}))\n"
    )
    subject, span, _, saved = explored(f"{tmp_path / 'mine.py'}:stop", ["gap=0.5"], None)
    assert span == (0.5, 1.5) and saved is None
    result = Explorer(subject, span, 4).curve("s", Request({"zeta": 0.1}, span, 4))
    assert result["curves"][0]["x"][0] == 0.5
    assert subject.python({"zeta": 0.1}) == "from mine import stop\nmodel = stop(zeta=0.1, gap=0.5)"
    curve = hb.trace(hb.HarmonicBalance(subject.model({}), 4), "Omega", span)
    curve.save(tmp_path / "mine.npz")
    again, *_, saved = explored(str(tmp_path / "mine.npz"), None, f"{tmp_path / 'mine.py'}:stop")
    assert again.model({}) == subject.model({}) and len(saved) == len(curve)
    assert again.toml({}, span, 4).splitlines()[1] == f'model = "{tmp_path / "mine.py"}:stop"'


def test_a_saved_curve_is_drawn_in_every_measure_and_element():
    """The page shows the transmission error of machines, which is not the half peak-to-peak of the displacement."""
    model = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25), e=(0.2,))
    curve = hb.trace(hb.HarmonicBalance(model, 4), "Omega", (1.5, 1.2))
    (line,) = Explorer(EditableInstance(model, "spur-pair"), SPAN, 4, curve).start()["behind"]
    np.testing.assert_allclose(line["sizes"]["dte"][0], transmission_error(curve), rtol=1e-6)
    np.testing.assert_allclose(line["sizes"]["rms"][0], curve.amplitude("rms"), rtol=1e-6)
    difference = np.array(line["sizes"]["dte"][0]) - 37.6 * np.array(line["sizes"]["pp2"][0])
    assert np.abs(difference).min() > 1.0  # um


def test_a_saved_curve_that_goes_to_infinity_does_not_set_the_axes():
    """Its line ends at the limit of the axes of its own page, so that a change with small amplitudes is visible."""
    model = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.5, 0.3), stability=False)
    tops = [one["top"]["pp2"][0] for one in (view(each, "") for each in curve.curves) if one["top"]]
    lines = Explorer(EditableInstance(model, "spur-pair"), SPAN, 4, curve).start()["behind"]
    largest = max(y for line in lines for y in line["sizes"]["pp2"][0] if y is not None)
    assert 0.5 * max(tops) < largest <= max(tops) < 0.1 * curve.amplitude("pp2").max()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals are sent otherwise")
@pytest.mark.parametrize("what", ["machine.toml", "curve.npz"])
def test_ctrl_c_ends_it_and_leaves_nothing(tmp_path, what):
    write_machine(machine(), tmp_path / "machine.toml")
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 1.6)).save(tmp_path / "curve.npz")
    before = sorted(tmp_path.iterdir())
    root = str(Path(hb.__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-m", "hbgear", "explore", what, "--no-browser"],
        cwd=tmp_path,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": root},
    )
    try:
        assert process.stdout
        address = re.match(r"open (http://127\.0\.0\.1:(\d+)/\?token=\S+)\n", process.stdout.readline())
        assert address
        with urllib.request.urlopen(address[1], timeout=30) as page:
            assert b"explorer.begin" in page.read()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 0 and out.endswith("ended\n") and not err
    assert sorted(tmp_path.iterdir()) == before
    with socket.socket() as again:
        assert again.connect_ex(("127.0.0.1", int(address[2]))) != 0


# ---- in a browser


@pytest.fixture(scope="module")
def driver():
    with browser(1400, 1100) as found:
        yield found


@pytest.fixture
def shown(driver, server):
    resized(driver, 1400, 1100)
    opened(driver, server.address)
    settled(driver)
    return driver


def settled(driver):
    """Wait until the status line describes the displayed curve."""
    waited_for(driver, "document.getElementById('status').textContent.includes(' points in ')")


def waited_for(driver, condition, seconds=30):
    end = time.monotonic() + seconds
    while not driver.execute_script(f"return Boolean({condition})"):
        assert time.monotonic() < end, (
            f"waited for {condition}: {driver.execute_script('return document.getElementById(`status`).textContent')}"
        )
        time.sleep(0.02)


def jumps_shown(driver):
    return driver.execute_script("return hbgear.state.curves[0].jumps.map(jump => jump.x)")


def slide(driver, name, keys):
    """Move a slider with the keyboard and wait for the curve."""
    before = driver.execute_script("return explorer.timings.length")
    driver.find_element("css selector", f"[aria-label='{name} as a slider']").send_keys(keys)
    waited_for(driver, f"explorer.timings.length > {before}")


def value_of(driver, name):
    return driver.execute_script(f"return explorer.now.values[{name!r}]")


@pytest.mark.slow
def test_a_slider_draws_another_curve(shown):
    from selenium.webdriver.common.keys import Keys

    before = jumps_shown(shown)
    slide(shown, "zeta", Keys.ARROW_RIGHT * 20)
    waited_for(shown, "document.getElementById('python').textContent.includes('zeta=')")
    zeta = value_of(shown, "zeta")
    assert zeta > 0.05
    problem = hb.HarmonicBalance(MODEL.replace(zeta=zeta), 8)
    jumps = [jump.value for jump in hb.trace(problem, "Omega", SPAN).jumps()]
    expected = [float(n) for n in MODEL.scales.pinion_speed(np.array(jumps))]  # r/min, the unit of the figure
    waited_for(shown, f"Math.abs(hbgear.state.curves[0].jumps[0].x / {expected[0]} - 1) < 1e-9")
    assert jumps_shown(shown) == pytest.approx(expected, rel=1e-9) and before != expected
    assert complaints(shown) == []


@pytest.mark.slow
def test_a_slider_has_a_sensible_range_after_typed_values(shown):
    """A value outside the range sets its ends to 0.2 and 2.5 times the value; a value inside restores the range."""
    from selenium.webdriver.common.keys import Keys

    def typed(text):
        before = shown.execute_script("return explorer.timings.length")
        shown.find_element("id", "p-zeta").send_keys(Keys.CONTROL, "a")
        shown.find_element("id", "p-zeta").send_keys(text, Keys.ENTER)
        waited_for(shown, f"explorer.timings.length > {before}")
        ends = "[Number(s.min), Number(s.max), Number(s.value)]"
        return shown.execute_script(
            f"const s = document.querySelector(\"[aria-label='zeta as a slider']\"); return {ends}"
        )

    assert typed("0.4") == pytest.approx([0.08, 1.0, 0.4], rel=1e-2)
    assert typed("0.06") == pytest.approx([0.2 * MODEL.zeta, 2.5 * MODEL.zeta, 0.06], rel=1e-2)
    assert typed("0.001") == pytest.approx([0.0002, 0.0025, 0.001], rel=1e-2)
    assert complaints(shown) == []


@pytest.fixture
def slow(monkeypatch):
    """Return a list of values of zeta whose curves are computed until they are cancelled."""
    values = []

    def traced(self, asked, job):
        if asked.values["zeta"] in values:
            while True:
                job(job.last_progress)
                time.sleep(0.01)
        return usual(self, asked, job)

    usual = Explorer._traced
    monkeypatch.setattr(Explorer, "_traced", traced)
    return values


@pytest.mark.slow
def test_an_overtaken_or_cancelled_curve_is_no_error(shown, slow):
    from selenium.webdriver.common.keys import Keys

    handle = shown.find_element("css selector", "[aria-label='zeta as a slider']")
    sent = "performance.getEntriesByType('resource').filter(entry => entry.name.endsWith('/curve'))"
    before = value_of(shown, "zeta")
    slide(shown, "zeta", Keys.ARROW_RIGHT)
    step = value_of(shown, "zeta")
    slide(shown, "zeta", Keys.ARROW_LEFT)
    slow.append(step)
    handle.send_keys(Keys.ARROW_RIGHT)
    waited_for(shown, "!document.getElementById('work').hidden")
    ended = shown.execute_script(f"return {sent}.length")
    handle.send_keys(Keys.ARROW_RIGHT)
    waited_for(shown, f"{sent}.length === {ended} + 2")
    settled(shown)
    assert value_of(shown, "zeta") > step > before
    handle.send_keys(Keys.ARROW_LEFT)
    waited_for(shown, "!document.getElementById('work').hidden")
    shown.find_element("id", "cancel").click()
    waited_for(shown, "document.getElementById('work').hidden")
    assert shown.find_element("id", "status").text.startswith("cancelled; the previous curve is shown")
    assert complaints(shown) == []


@pytest.mark.slow
def test_undo_link_and_reset(shown):
    from selenium.webdriver.common.keys import Keys

    start = jumps_shown(shown)
    slide(shown, "F_m", Keys.ARROW_RIGHT * 5)
    moved = value_of(shown, "F_m")
    link = shown.current_url
    assert f"F_m={moved}" in link
    shown.find_element("id", "undo").click()
    waited_for(shown, f"Math.abs(hbgear.state.curves[0].jumps[0].x - {start[0]}) < 1e-9")
    assert value_of(shown, "F_m") == 0.1 and not shown.find_element("id", "redo").get_property("disabled")
    shown.get("about:blank")
    opened(shown, link)
    assert value_of(shown, "F_m") == moved and jumps_shown(shown) != start
    shown.find_element("id", "reset").click()
    waited_for(shown, f"Math.abs(hbgear.state.curves[0].jumps[0].x - {start[0]}) < 1e-9")


def test_a_refused_value_is_reported_and_the_curve_stays(shown):
    from selenium.webdriver.common.keys import Keys

    before = jumps_shown(shown)
    field = shown.find_element("id", "p-zeta")
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys("-1", Keys.ENTER)
    waited_for(shown, "document.getElementById('status').textContent.includes('zeta = -1')")
    assert "the previous curve" in shown.find_element("id", "status").text and jumps_shown(shown) == before
    assert complaints(shown) == []


@pytest.mark.slow
def test_the_heading_states_the_model_in_words(shown):
    from selenium.webdriver.common.keys import Keys

    waited_for(shown, "document.getElementById('title').textContent === 'Spur pair, eps = 0.1'")
    slide(shown, "zeta", Keys.ARROW_RIGHT)
    settled(shown)
    zeta = value_of(shown, "zeta")
    waited_for(shown, f"document.getElementById('title').textContent === 'Spur pair, zeta = {zeta:g}, eps = 0.1'")


@pytest.mark.slow
def test_the_vertical_axis_fits_each_curve_after_an_unbounded_one(driver):
    """The axis ends at a multiple of the bounded part of an unbounded curve, and at the top of the next curve."""
    from selenium.webdriver.common.keys import Keys

    def top_and_largest():
        return driver.execute_script(
            "const d = document.getElementById('response');"
            "const all = hbgear.state.curves[0].amplitudes[hbgear.state.measure][0];"
            "return [d._fullLayout.yaxis.range[1], Math.max(...all), hbgear.state.curves[0].asymptotes.length]"
        )

    def legend():
        names = "document.getElementById('response').data.filter((t) => t.showlegend !== false).map((t) => t.name)"
        return driver.execute_script(f"return {names}")

    resized(driver, 1400, 1100)
    with served(explorer(hb.SpurPair(zeta=0.02, eps=(0.1, 0.15), e=(0.03, 0.01), F_m=0.2), harmonics=16)) as server:
        opened(driver, server.address)
        settled(driver)
        top, largest, asymptotes = top_and_largest()
        assert asymptotes == 1 and 0 < top < 0.3 * largest
        assert legend().count("asymptote") == 1
        field = driver.find_element("id", "p-zeta")
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys("0.2", Keys.ENTER)
        waited_for(driver, "hbgear.state.curves[0].asymptotes.length === 0")
        top, largest, _ = top_and_largest()
        assert largest < top < 1.2 * largest
        assert "asymptote" not in legend()
        assert complaints(driver) == []
        driver.get("about:blank")  # close the page, which requests details after the curve


@pytest.mark.slow
def test_a_click_shows_the_motion(shown):
    curve = hb.trace(hb.HarmonicBalance(MODEL, 8), "Omega", SPAN)
    i = int(np.argmin(abs(curve.values - 1.2)))
    n, dte = MODEL.scales.pinion_speed(curve.values[i]), transmission_error(curve)[i]
    clicked(shown, n, dte)
    text = shown.find_element("id", "chosen").text
    assert f"n = {n:.6g} r/min; " in text and f"; dte = {dte:.5g} \N{MICRO SIGN}m; " in text


@pytest.mark.slow
def test_jump_map_is_drawn_and_taken(shown):
    button = shown.find_element("id", "makemap")
    shown.execute_script("arguments[0].scrollIntoView()", button)
    for name, value in (("mapy0", "0.05"), ("mapy1", "0.12")):
        field = shown.find_element("id", name)
        field.clear()
        field.send_keys(value)
    button.click()
    waited_for(shown, "!document.getElementById('map').hidden && document.getElementById('map').data")
    kinds = shown.execute_script("return document.getElementById('map').data.map(trace => trace.name)")
    assert {"jump, sweep up", "jump, sweep down", "now"} == set(kinds)
    title, x = shown.execute_script(
        "const d = document.getElementById('map'); return [d.layout.xaxis.title.text, d.data[0].x]"
    )
    assert title == "speed of the pinion [r/min]"
    assert MODEL.scales.pinion_speed(0.3) < min(y for y in x if y) < MODEL.scales.pinion_speed(1.5)


@pytest.mark.slow
def test_fields_of_the_range_are_speeds(shown):
    from selenium.webdriver.common.keys import Keys

    first, last = (shown.find_element("id", name) for name in ("from", "to"))
    waited_for(shown, "document.querySelector('.frequency-unit').textContent === 'r/min'")
    for field, Omega in ((first, SPAN[0]), (last, SPAN[1])):
        assert float(field.get_attribute("value")) == pytest.approx(MODEL.scales.pinion_speed(Omega), rel=1e-6)
    before = shown.execute_script("return explorer.timings.length")
    first.send_keys(Keys.CONTROL, "a")
    first.send_keys("20000", Keys.ENTER)
    waited_for(shown, f"explorer.timings.length > {before}")
    Omega = shown.execute_script("return explorer.now.from")
    assert MODEL.scales.pinion_speed(Omega) == pytest.approx(20000.0, rel=1e-6)
    assert first.get_attribute("value") == "20000"
    assert max(shown.execute_script("return hbgear.state.curves[0].x")) == pytest.approx(20000.0, rel=1e-6)
    assert shown.execute_script("return document.getElementById('mapx').selectedOptions[0].text") == "speed [r/min]"
    assert complaints(shown) == []


@pytest.mark.slow
def test_measured_points_lie_over_the_curve(shown, tmp_path):
    (tmp_path / "run.csv").write_text("speed [r/min], x\n14515, 0.1\n")
    shown.find_element("id", "measured").send_keys(str(tmp_path / "run.csv"))
    waited_for(shown, "hbgear.state.behind.length === 1")
    x = shown.execute_script("return hbgear.state.behind[0].x[0]")
    assert x == pytest.approx(MODEL.scales.from_pinion_speed(14515.0), rel=1e-6)


@pytest.mark.slow
def test_toolbars_keep_the_data_here(shown):
    check_toolbars(shown)


@pytest.mark.slow
def test_only_own_scripts_run(driver, server):
    opened(driver, server.address)
    settled(driver)
    check_only_own_scripts_run(driver)
    complaints(driver)  # clear the messages about blocked scripts


class Slow(Explorer):
    """Explorer whose curves take at least 30 s, except with the initial damping."""

    def _traced(self, asked, job):
        for i in range(600 if asked.values["zeta"] != 0.05 else 0):
            job(hb.continuation.Progress(i / 600, f"step {i}"))
            time.sleep(0.05)
        return super()._traced(asked, job)


@pytest.mark.slow
def test_a_long_computation_shows_progress_and_can_be_cancelled(driver):
    resized(driver, 1400, 1100)
    with served(Slow(EditableInstance(MODEL, "spur-pair"), SPAN, 4)) as server:
        opened(driver, server.address)
        settled(driver)
        before = jumps_shown(driver)
        field = driver.find_element("id", "p-zeta")
        field.send_keys("1\n")  # 0.051
        waited_for(driver, "document.getElementById('doing').textContent.startsWith('step ')")
        assert 0 < float(driver.find_element("id", "done").get_attribute("value")) < 1
        driver.find_element("id", "cancel").click()
        waited_for(driver, "document.getElementById('work').hidden")
        assert driver.find_element("id", "status").text.startswith("cancelled") and jumps_shown(driver) == before
        driver.get("about:blank")


@pytest.mark.slow
def test_fits_a_phone_with_the_curve_above_the_sliders(driver, server):
    resized(driver, 390, 844)
    opened(driver, server.address)
    settled(driver)
    assert driver.execute_script("return document.documentElement.scrollWidth") <= 390
    driver.execute_script("document.getElementById('p-b').scrollIntoView({block: 'center'})")
    top = driver.execute_script("return document.getElementById('response').getBoundingClientRect().top")
    assert abs(top) < 2  # the figure stays at the top while the page is scrolled
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert driver.execute_script("return document.getElementById('response').offsetHeight") >= 440
    finally:
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
