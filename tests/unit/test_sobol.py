"""Sobol indices of studies, against closed forms. SALib itself is at work: extra hbgear[sobol], which is in [test]."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb

pytest.importorskip("SALib", reason="SALib is not installed: pip install 'hbgear[sobol]'")

SCATTER = {"zeta": ("uniform", 0.04, 0.08), "F": ("normal", 0.2, 0.02)}


def computed(drawn, compute=("peak",), **more):
    linear = hb.Duffing(k3=0.0)
    with ThreadPoolExecutor(1) as here:
        return hb.design.cases(linear, drawn, compute, harmonics=1, span=(0.8, 1.2), executor=here, **more)


@pytest.fixture(scope="module")
def found():
    return computed(hb.design.saltelli(16, 3, **SCATTER))


def closed_forms():
    """Of Y = F g(zeta), the peak of a linear oscillator F / (2 zeta sqrt(1 - zeta^2)), from the moments of both."""
    zeta = np.linspace(0.04, 0.08, 20_001)
    g = 1 / (2 * zeta * np.sqrt(1 - zeta**2))
    g1, g2, f1, f2 = np.mean(g), np.mean(g**2), 0.2, 0.2**2 + 0.02**2
    variance = f2 * g2 - (f1 * g1) ** 2
    alone = {"zeta": f1**2 * (g2 - g1**2) / variance, "F": g1**2 * (f2 - f1**2) / variance}
    return alone, {"zeta": 1 - alone["F"], "F": 1 - alone["zeta"]}


def test_peaks_of_a_linear_oscillator(found):
    """The peaks are those of the closed form; as many of them as are needed give its indices."""
    zeta, F = found.table["zeta"], found.table["F"]
    np.testing.assert_allclose(found.table["peak"], F / (2 * zeta * np.sqrt(1 - zeta**2)), rtol=1e-6)
    rows = list(hb.design.saltelli(2048, 3, **SCATTER).rows())
    many = {name: np.array([row[name] for row in rows]) for name in SCATTER}
    peak = many["F"] / (2 * many["zeta"] * np.sqrt(1 - many["zeta"] ** 2))
    table = {"case": np.arange(len(rows)), **many, "peak": peak}
    indices = hb.design.sobol_indices(replace(found, table=table, total=len(rows)), "peak")
    assert (indices.blocks, indices.lost) == (2048, 0)
    for mine, expected in zip((indices.first, indices.total), closed_forms(), strict=True):
        for name, (value, error) in mine.items():
            assert value == pytest.approx(expected[name], abs=4 * error) and error < 0.03
            assert abs(value - 1.3 * expected[name]) > 2 * error


def test_few_cases_have_large_errors(found):
    indices = hb.design.sobol_indices(found)
    for mine, expected in zip((indices.first, indices.total), closed_forms(), strict=True):
        for name, (value, error) in mine.items():
            assert value == pytest.approx(expected[name], abs=5 * error) and error > 0.02


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_errors(found, seed):
    assert hb.design.sobol_indices(found, seed=seed) == hb.design.sobol_indices(found, seed=seed)
    assert hb.design.sobol_indices(found, seed=seed) != hb.design.sobol_indices(found, seed=seed + 1)


def test_blocks_with_a_case_that_failed_are_left_out(found):
    peak = found.table["peak"].copy()
    peak[5] = np.nan
    indices = hb.design.sobol_indices(replace(found, table={**found.table, "peak": peak}))
    assert (indices.blocks, indices.lost) == (16, 1)
    peak[::4] = np.nan
    with pytest.raises(ValueError, match="peak is known in 0 of 16 blocks"):
        hb.design.sobol_indices(replace(found, table={**found.table, "peak": peak}))


def test_quantities_without_indices(found):
    with pytest.raises(KeyError, match="there is no column 'peek'; did you mean 'peak'"):
        hb.design.sobol_indices(found, "peek")
    with pytest.raises(ValueError, match="compute them with vary=saltelli"):
        hb.design.sobol_indices(computed(hb.design.monte_carlo(8, 1, **SCATTER)))
    flat = {**found.table, "peak": np.ones(len(found))}
    with pytest.raises(ValueError, match="peak does not vary"):
        hb.design.sobol_indices(replace(found, table=flat))
    with pytest.raises(ValueError, match="blocks = 12 must be a power of 2, such as 16"):
        hb.design.saltelli(12, **SCATTER)


@pytest.mark.slow
def test_study_file(tmp_path, run):
    text = (
        'model = "duffing"\n[base]\nk3 = 0.0\n[sample]\nmethod = "saltelli"\ncount = {count}\n[sample.parameters]\n'
        'zeta = ["uniform", 0.04, 0.08]\nF = ["normal", 0.2, 0.02]\n[compute]\nwhat = ["peak"]\nharmonics = 1\n'
        "span = [0.9, 1.1]\n"
    )
    for count, code in ((32, 0), (30, 2)):
        (tmp_path / "study.toml").write_text(text.format(count=count))
        end, _, err = run("study study.toml --processes 1")
        assert end == code, err
    assert "30 cases cannot be divided into blocks of 4 (for 2 parameters)" in err


def test_without_salib(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "SALib.sample.sobol", None)
    with pytest.raises(ValueError, match=r"a sample by Saltelli needs SALib.*pip install 'hbgear\[sobol\]'"):
        list(hb.design.saltelli(4, **SCATTER).rows())
