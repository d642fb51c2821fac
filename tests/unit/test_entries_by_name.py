"""Tuple entries as parameters: e[0] names the first entry in every interface that takes a parameter name."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.design.studies.study_file import read_study
from hbgear.io.machines.toml_file import TomlFileError
from hbgear.web.editable_model import EditableInstance
from hbgear.web.explorer import Explorer, Request

PAIR = hb.SpurPair(e=(0.1, 0.02))


@pytest.mark.slow
def test_set_changes_one_entry(run):
    code, _, err = run(
        "trace",
        "spur-pair",
        "--set",
        "e=(0.1, 0.02)",
        "--set",
        "e[1]=0.03",
        "--set",
        "zeta=0.06",
        "--harmonics",
        "2",
        "-o",
        "a.npz",
    )
    assert code == 0, err
    assert hb.load("a.npz").meta["model"]["fields"]["e"] == [0.1, 0.03]
    wrong = {
        "e[2]=1": "no parameter 'e[2]'; did you mean 'e[",
        "zeta[0]=1": "has no parameter 'zeta[0]'",
        "e[0]=x": "--set e[0]=x: need a finite number",
        "e[-1]=1": "no parameter 'e[-1]'",
    }
    for word, said in wrong.items():
        code, _, err = run("trace", "spur-pair", "--set", "e=(0.1, 0.02)", "--set", word, "--harmonics", "2")
        assert code == 2 and said in err and len(err.splitlines()) == 1


@pytest.mark.slow
def test_critical_value_of_an_entry_is_where_a_jump_vanishes(run):
    """The curve has no jump 3 % below the critical amplitude and two jumps 3 % above it."""
    found = hb.analysis.critical_parameter(PAIR, "e[0]", harmonics=3)
    for factor, jumps in ((0.97, 0), (1.03, 2)):
        problem = hb.HarmonicBalance(PAIR.replace(**{"e[0]": factor * found.value}), 3)
        near = (found.Omega + 0.1, found.Omega - 0.1)
        assert len(hb.trace(problem, "Omega", near, cover=False).jumps()) == jumps
    code, out, _ = run("critical", "spur-pair", "e[0]", "--set", "e=(0.1, 0.02)", "--harmonics", "3")
    assert code == 0 and f"e[0] = {found.value:.5f}"[:11] in out and "the model has e[0] = 0.1, " in out
    code, _, err = run("critical", "spur-pair", "e[7]", "--harmonics", "3")
    assert code == 2 and "SpurPair has no parameter 'e[7]'; did you mean 'e[0]'?" in err


@pytest.mark.slow
def test_maps_curves_and_fits_take_entries(run):
    for line in (
        "map spur-pair --in e[0]=0.1:0.12 --harmonics 2 --seeds 2",
        "trace spur-pair --in e[0]=0.1:0.12 --at Omega=0.9 --harmonics 2",
        "redesign spur-pair --free e[0] --harmonics 2 --from 1.4 --to 0.8",
    ):
        code, _, err = run(*line.split())
        assert code == 0, err


@pytest.mark.slow
def test_studies_vary_entries(tmp_path):
    path = tmp_path / "a.toml"
    head = 'model = "spur-pair"\n[base]\ne = [0.1, 0.02]\n"e[1]" = 0.03\n'
    tail = '[compute]\nwhat = ["peak"]\nharmonics = 2\n'
    path.write_text(f'{head}[grid]\n"e[0]" = [0.1, 0.2]\n{tail}')
    study = read_study(path)
    assert study.model.e == (0.1, 0.03) and study.vary.names == ("e[0]",)
    found = hb.design.cases(study.model, study.vary, ("peak",), harmonics=2, processes=1)
    by_hand = [
        hb.design.cases(
            study.model.replace(e=(x, 0.03)), hb.design.grid(zeta=[0.05]), ("peak",), harmonics=2, processes=1
        )
        for x in (0.1, 0.2)
    ]
    peaks = [name for name in found.table if name.startswith("peak") and found.table[name].dtype.kind == "f"]
    assert peaks
    for name in peaks:
        np.testing.assert_allclose(found.table[name], [one.table[name][0] for one in by_hand], rtol=1e-6)
    path.write_text(f'{head}[sample]\ncount = 2\n[sample.parameters]\n"e[1]" = ["uniform", 0.01, 0.02]\n{tail}')
    assert read_study(path).vary.names == ("e[1]",)
    path.write_text(f'{head}[grid]\n"e[2]" = [0.1]\n{tail}')
    with pytest.raises(TomlFileError, match=r"line 6: unknown key 'grid.e\[2\]'; did you mean 'e\[[01]\]'"):
        read_study(path)


@pytest.mark.slow
def test_the_explorer_counts_from_zero_as_the_library_does():
    subject = EditableInstance(PAIR, "spur-pair")
    shown = {parameter.name: parameter for parameter in subject.parameters()}
    assert {name: shown[name].value for name in shown if name.startswith("e[")} == {"e[0]": 0.1, "e[1]": 0.02}
    assert shown["e[0]"].label.startswith("entry 0 of")
    assert subject.model({"e[0]": 0.2}) == PAIR.replace(**{"e[0]": 0.2})
    with pytest.raises(KeyError, match=r"e\[2\]"):
        subject.model({"e[2]": 0.2})
    explorer = Explorer(subject, (0.8, 0.4), 2)
    asked = Request({}, (0.8, 0.4), 2)
    found = explorer.jump_map("s", asked, {"x": ["e[0]", 0.1, 0.12], "y": ["Omega", 0.4, 0.9]})
    assert len(found["labels"]) == 2 and found["lines"]


def test_sweeps_go_along_an_entry():
    run = hb.time.sweep(PAIR, [0.1, 0.11], parameter="e[0]", at={"Omega": 1.3})
    assert run.parameter == "e[0]"
