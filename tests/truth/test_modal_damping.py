"""Damping ratios of the modes of fine meshes, against the closed-form frequencies of a uniform beam."""

import numpy as np
import pytest

import hbgear as hb

CLAMPED, FREE = 1.875104068711961**2, 4.730040744862704**2
"""Lowest natural frequencies of bending."""


def beam(count, clamped):
    """Return M and K of Euler-Bernoulli elements, with unit length, stiffness and mass."""
    h, n = 1.0 / count, 2 * (count + 1)
    k = (
        np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h * h, -6 * h, 4 * h * h],
            ]
        )
        / h**3
    )
    m = (
        np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
            ]
        )
        * h
        / 420
    )
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for first in range(0, n - 2, 2):
        part = slice(first, first + 4)
        M[part, part] += m
        K[part, part] += k
    held = slice(2 if clamped else 0, None)
    return M[held, held], K[held, held]


@pytest.mark.parametrize("count", [20, 150])
def test_modes_of_a_clamped_beam_have_the_damping_ratio(count):
    """The squares of the frequencies of 150 elements span twelve decades."""
    M, K = beam(count, clamped=True)
    C = hb.mechanics.modal_damping(M, K, [0.02, 0.05])
    powers = np.linalg.matrix_power(np.linalg.solve(K, M), 8)  # the lowest mode remains
    mode = powers @ np.ones(len(M))
    mode /= np.sqrt(mode @ M @ mode)
    assert mode @ C @ mode == pytest.approx(2 * 0.02 * CLAMPED, rel=1e-4)


def test_rigid_motions_of_a_free_beam_are_not_damped():
    M, K = beam(150, clamped=False)
    C = hb.mechanics.modal_damping(M, K, 0.02)
    x = np.linspace(0.0, 1.0, 151)
    rigid = np.array([np.column_stack([x**0, 0 * x]).ravel(), np.column_stack([x, x**0]).ravel()])
    assert np.abs(rigid @ C @ rigid.T).max() < 1e-9
    bent = np.column_stack([np.cosh(x) - x, np.sinh(x) - 1]).ravel()
    bent -= rigid.T @ np.linalg.solve(rigid @ M @ rigid.T, rigid @ M @ bent)
    assert bent @ C @ bent >= 2 * 0.02 * FREE * (bent @ M @ bent)  # the damping of the lowest bending mode


@pytest.mark.slow
def test_the_backbone_of_a_fine_mesh_begins_at_the_lowest_mode():
    """Its frequency and damping ratio at a small amplitude are those of the linear beam."""
    M, K = beam(100, clamped=True)
    tip = np.eye(1, len(M), len(M) - 2)[0]
    load = hb.Load(cosine={1: 0.02 * tip})
    system = hb.System(M, hb.mechanics.modal_damping(M, K, 0.02), K, [hb.Element(tip, hb.Cubic(k3=1.0))], load)
    curve = hb.analysis.backbone(system, span=(1e-3, 2e-3))
    assert curve.tracked["Omega"][0] == pytest.approx(CLAMPED, rel=1e-5)
    assert curve.tracked["modal_damping"][0] == pytest.approx(0.02, rel=1e-4)
