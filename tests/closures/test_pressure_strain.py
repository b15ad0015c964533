# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reynolds-stress laws, wall functions and heat fluxes: closed numbers and what must not happen."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import ufl

from fem_tfm.closures import make, names
from fem_tfm.closures.turbulence.reynolds_stress import Wall, production
from fem_tfm.errors import InputError

LAWS = [name for name in names("reynolds-stress") if name != "k-epsilon"]
SHEAR = np.array([[0.0, 3.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
RNG = np.random.default_rng(4)


def realisable() -> np.ndarray:
    """A symmetric positive tensor."""
    root = RNG.normal(size=(3, 3))
    return root @ root.T


def walls(law: Any) -> list[Wall]:
    return [Wall(np.array([0.0, 1.0, 0.0]), 2.0), Wall(np.array([1.0, 0.0, 0.0]), 0.5)]


def lrr_log_layer(c_1: float, c_2: float, c_z1: float, c_z2: float, f: float) -> dict[str, float]:
    """Stresses over k of the log layer in closed form: P = eps and no transport."""
    alpha, beta, gamma = (c_2 + 8) / 11, (30 * c_2 - 2) / 55, (8 * c_2 - 2) / 11
    rapid = (2 * alpha - 4 * gamma) / 3
    off = (2 / 3 * (c_1 - 1) + rapid * (1 - 2 * c_z2 * f)) / (c_1 + 2 * c_z1 * f)
    across = 2 / 3 * (c_1 - 1) + 2 / 3 * (alpha + gamma) + c_z2 * f * rapid + c_z1 * f * off
    across /= c_1
    along = 2 - off - across
    taken = (alpha * off - beta + gamma * along) * (1 - 1.5 * c_z2 * f)
    shear = math.sqrt((off - taken) / (c_1 + 1.5 * c_z1 * f))
    return {"off": off, "across": across, "along": along, "shear": shear}


def test_log_layer_of_lrr_in_closed_form() -> None:
    """Ratios 2.82/1.04/4.07 of the stresses to the shear stress, k = 3.96 u_tau^2."""
    layer = make("reynolds-stress", "lrr").log_layer()
    expected = lrr_log_layer(1.5, 0.4, 0.5, 0.06, 1.0)
    assert layer.stress[1, 1] == pytest.approx(expected["off"], rel=1e-10)
    assert layer.stress[2, 2] == pytest.approx(expected["across"], rel=1e-10)
    assert layer.stress[0, 0] == pytest.approx(expected["along"], rel=1e-10)
    assert -layer.stress[0, 1] == pytest.approx(expected["shear"], rel=1e-10)
    ratios = [layer.stress[i, i] / expected["shear"] for i in (2, 1, 0)]
    assert ratios == pytest.approx([2.82, 1.04, 4.07], abs=0.005)
    assert layer.C_mu == pytest.approx(0.0637, abs=5e-5)
    assert layer.kappa == pytest.approx(0.434, abs=5e-4)
    assert layer.reflection == pytest.approx(1.0, rel=1e-10)


def test_printed_constant_of_the_reflection_is_not_that_of_the_log_layer() -> None:
    """With C_mu = 0.09 the fixed point is f_z = 1.66, k = 4.67 u_tau^2 and C_mu = 0.0458."""
    layer = make("reynolds-stress", {"model": "lrr", "C_mu": 0.09}).log_layer()
    assert layer.reflection == pytest.approx(1.66, abs=0.005)
    assert 1 / math.sqrt(layer.C_mu) == pytest.approx(4.67, abs=0.005)
    assert layer.C_mu == pytest.approx(0.0458, abs=5e-5)
    expected = lrr_log_layer(1.5, 0.4, 0.5, 0.06, layer.reflection)
    assert -layer.stress[0, 1] == pytest.approx(expected["shear"], rel=1e-9)


def test_log_layer_of_ssg() -> None:
    """No reflection; the slope is von Karman's with the constants of the paper."""
    layer = make("reynolds-stress", "ssg").log_layer()
    assert layer.reflection == 0.0
    assert layer.kappa == pytest.approx(0.41, abs=0.005)
    assert layer.stress[0, 0] > layer.stress[2, 2] > layer.stress[1, 1]


def test_resolved_fills_in_the_constant_once() -> None:
    law = make("reynolds-stress", "lrr")
    assert law.C_mu == 0.0
    assert law.resolved().C_mu == pytest.approx(law.log_layer().C_mu)
    given = dataclasses.replace(law, C_mu=0.09)
    assert given.resolved() == given


@pytest.mark.parametrize("name", LAWS)
def test_redistribution_moves_energy_and_makes_none(name: str) -> None:
    """Phi_kk = 0 and Phi is symmetric, walls or none."""
    law = make("reynolds-stress", name).resolved()
    gradient = RNG.normal(size=(3, 3))
    gradient -= np.trace(gradient) / 3 * np.eye(3)
    stress = realisable()
    for near in ([], walls(law)):
        phi = law.redistribution(stress, gradient, np.trace(stress) / 2, 0.7, near)
        assert np.trace(phi) == pytest.approx(0.0, abs=1e-12 * abs(phi).max())
        assert phi == pytest.approx(phi.T)
        assert abs(phi).max() > 1e-3


@pytest.mark.parametrize("name", LAWS)
def test_redistribution_turns_with_the_axes(name: str) -> None:
    law = make("reynolds-stress", name).resolved()
    turn, _ = np.linalg.qr(RNG.normal(size=(3, 3)))
    stress, gradient = realisable(), RNG.normal(size=(3, 3))
    wall = walls(law)[0]
    turned = Wall(turn @ wall.normal, wall.nearness)
    k = np.trace(stress) / 2
    here = law.redistribution(stress, gradient, k, 0.7, [wall])
    there = law.redistribution(turn @ stress @ turn.T, turn @ gradient @ turn.T, k, 0.7, [turned])
    assert there == pytest.approx(turn @ here @ turn.T, rel=1e-10)


def test_return_to_isotropy() -> None:
    """Without shear and walls LRR takes anisotropy away at the rate (C_1 - 1) eps/k."""
    law = make("reynolds-stress", "lrr").resolved()
    stress = realisable()
    k = np.trace(stress) / 2
    phi = law.redistribution(stress, np.zeros((3, 3)), k, 0.7, [])
    assert phi == pytest.approx(-1.5 * 0.7 / k * (stress - 2 / 3 * k * np.eye(3)))


def test_production_of_simple_shear() -> None:
    """P_11 = -2 R_12 S, P_12 = -R_22 S, nothing else."""
    stress = realisable()
    found = production(stress, SHEAR)
    expected = np.zeros((3, 3))
    expected[0, 0] = -6 * stress[0, 1]
    expected[0, 1] = expected[1, 0] = -3 * stress[1, 1]
    expected[0, 2] = expected[2, 0] = -3 * stress[1, 2]
    assert found == pytest.approx(expected)


def test_k_epsilon_in_simple_shear() -> None:
    law = make("reynolds-stress", "k-epsilon")
    stress = law.stress(SHEAR, 2.0, 5.0)
    assert np.diag(stress) == pytest.approx([4 / 3] * 3)
    assert stress[0, 1] == pytest.approx(-0.09 * 4 / 5 * 3)


@pytest.mark.parametrize("name", LAWS)
def test_forms_and_numbers_are_the_same_law(name: str) -> None:
    """A constant UFL tensor gives what the array gives."""
    law = make("reynolds-stress", name).resolved()
    stress, gradient = realisable(), RNG.normal(size=(3, 3))
    k = np.trace(stress) / 2
    numbers = law.redistribution(stress, gradient, k, 0.7, walls(law))
    symbols = law.redistribution(
        ufl.as_matrix(stress.tolist()),
        ufl.as_matrix(gradient.tolist()),
        k,
        0.7,
        [Wall(ufl.as_vector(w.normal.tolist()), w.nearness) for w in walls(law)],
    )
    found = [[float(symbols[i, j](())) for j in range(3)] for i in range(3)]
    assert np.array(found) == pytest.approx(numbers)


# -- walls and heat ----------------------------------------------------------------------------


def test_wall_function_gives_the_log_law_back() -> None:
    """In equilibrium, k = u_tau^2/sqrt(C_mu), the traction of u+ u_tau is u_tau^2."""
    function = make("wall-function", {"model": "equilibrium", "C_mu": 0.0637})
    u_tau, nu, y = 0.9, 1.5e-5, 8e-4
    k = u_tau**2 / math.sqrt(0.0637)
    u = u_tau / 0.41 * math.log(9.0 * u_tau * y / nu)
    assert function.friction(k, y, nu) * u == pytest.approx(u_tau**2)
    assert function.dissipation(k, y) == pytest.approx(u_tau**3 / (0.41 * y))


def test_strip_carries_the_mean_of_its_log_law() -> None:
    function = make("wall-function", {"model": "equilibrium", "C_mu": 0.09})
    nu, y, k = 1.5e-5, 1e-3, 4.0
    u_k = 0.09**0.25 * 2.0
    at = np.linspace(0, y, 400001)[1:]
    log = np.log(9.0 * u_k * at / nu) / 0.41
    assert function.strip(k, y, nu) == pytest.approx(log.mean() * y / log[-1], rel=1e-4)
    wall = make("thermal-wall", "jayatilleke")
    heat = log * (log + wall.resistance(0.71))
    found = wall.strip(function, k, y, nu, 0.71)
    assert found == pytest.approx(heat.mean() * y / heat[-1], rel=1e-3)


def test_jayatilleke_numbers() -> None:
    """P vanishes at Pr = Pr_t; conductance is u_k/(Pr_t (u+ + P))."""
    wall = make("thermal-wall", "jayatilleke")
    assert wall.resistance(0.9) == 0.0
    assert wall.resistance(0.71) == pytest.approx(-1.92468, abs=1e-5)
    assert wall.resistance(7.0) > 30
    function = make("wall-function", {"model": "equilibrium", "C_mu": 0.09})
    k, y, nu = 4.0, 1e-3, 1.5e-5
    u_plus = function.velocity(k, y, nu)
    expected = 0.09**0.25 * 2.0 / (0.9 * (u_plus + wall.resistance(0.71)))
    assert wall.conductance(function, k, y, nu, 0.71) == pytest.approx(expected)


def test_log_layer_turbulent_prandtl_number() -> None:
    """Launder's fluxes with the stresses of LRR give Pr_t = 0.79."""
    layer, law = make("reynolds-stress", "lrr").log_layer(), make("heat-flux", "launder")
    shear = -layer.stress[0, 1]
    gradient = np.array([0.0, 1.0, 0.0])
    velocity = np.outer([1.0, 0.0, 0.0], gradient) / shear
    wall = Wall(gradient, 1.0)

    def balance(flux: np.ndarray) -> np.ndarray:
        made = law.production(flux, layer.stress, velocity, gradient)
        return made + law.redistribution(flux, velocity, 1.0, 1.0, [(wall, layer.reflection)])

    zero = balance(np.zeros(3))
    matrix = np.column_stack([balance(unit) - zero for unit in np.eye(3)])
    flux = np.linalg.solve(matrix, -zero)
    assert shear**2 / -flux[1] == pytest.approx(0.793, abs=0.002)


@pytest.mark.parametrize(
    ("family", "spec"),
    [
        ("reynolds-stress", {"model": "lrr", "C_1": 0.0}),
        ("reynolds-stress", {"model": "lrr", "C_mu": -0.1}),
        ("wall-function", {"model": "equilibrium", "E": 0.5}),
        ("heat-flux", {"model": "launder", "C_T1": -1.0}),
        ("reynolds-stress", "rsm"),
    ],
)
def test_bad_parameters_are_refused(family: str, spec: Any) -> None:
    with pytest.raises(InputError):
        make(family, spec)
