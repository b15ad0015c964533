# SPDX-License-Identifier: LGPL-3.0-or-later
"""The physics at a point: the same code in UFL, compiled by FFCx, and on arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_interval
from mpi4py import MPI

import fem_tfm as ft
from fem_tfm.closures.base import make, names
from fem_tfm.fenics import compile_expression
from fem_tfm.models.pointwise import SLIP_STEP, Invariants, Pointwise, Regularisation

COUNT = 200
GAS = ft.Gas(density=33.5, viscosity=1.8e-5)
COAL = ft.Solids(density=1700.0, diameter=1.6e-4, restitution=0.7)
FAMILIES = (
    "drag",
    "radial",
    "granular",
    "friction",
    "solids-wall",
    "slip-production",
    "free-path",
)
# tables of laws whose defaults leave a term out
FULL: dict[str, Any] = {"k-epsilon": {"model": "k-epsilon", "normal_stress": 1.0}}


def law_sets() -> dict[str, dict[str, Any]]:
    """As many sets of laws as the largest family has, so that each law stands in one or more.

    The gas's turbulence is transported in every second set, as some laws ask for.
    """
    walls = {law: make("gas-wall", law) for law in names("gas-wall")}
    # with transported turbulence and without
    fit = {
        True: [name for name, law in walls.items() if not law.strong],
        False: [name for name, law in walls.items() if not law.needs_k],
    }
    found: dict[str, dict[str, Any]] = {}
    for i in range(max(len(names(family)) for family in FAMILIES)):
        laws: dict[str, Any] = {
            family.replace("-", "_"): names(family)[i % len(names(family))] for family in FAMILIES
        }
        transported, step = i % 2 == 1, i // 2
        eddies = ("k-epsilon", "realizable") if transported else ("laminar", "mixing-length")
        laws["turbulence"] = eddies[step % 2]
        laws["gas_wall"] = fit[transported][step % len(fit[transported])]
        if transported:
            dispersed = names("dispersed")[step % len(names("dispersed"))]
            laws["dispersed"] = FULL.get(dispersed, dispersed)
            laws["dispersion"] = names("dispersion")[step % len(names("dispersion"))]
        laws["friction_feeds_theta"] = step % 2 == 1
        found[f"{i}: {laws['drag']}, {laws['turbulence']}"] = laws
    return found


SETS = law_sets()
SHAPES: dict[str, tuple[int, ...]] = {
    "L": (3, 3),
    "L_s": (3, 3),
    "slip": (3,),
    **dict.fromkeys(("alpha", "theta", "height", "slope", "drift"), ()),
    **dict.fromkeys(("k", "eps", "k_s", "eps_s"), ()),
}


def random_states() -> dict[str, np.ndarray]:
    """States of sheared, dilute and dense flows over many decades."""
    random = np.random.default_rng(11)

    def decades(low: float, high: float) -> np.ndarray:
        return 10 ** random.uniform(low, high, COUNT)

    dilute, medium, packed = decades(-9, -1), random.uniform(0, 0.6, COUNT), 0.63 - decades(-3, -1)
    alpha = np.choose(random.integers(3, size=COUNT), [dilute, medium, packed])
    return {
        "L": decades(0, 4)[:, None, None] * random.standard_normal((COUNT, 3, 3)),
        "L_s": decades(0, 3)[:, None, None] * random.standard_normal((COUNT, 3, 3)),
        "slip": decades(-3, 1)[:, None] * random.standard_normal((COUNT, 3)),
        "alpha": alpha,
        "theta": decades(-8, 0),
        "height": decades(-5, -2.3),
        "slope": random.uniform(0.5, 2, COUNT),
        "drift": decades(0, 3) * random.standard_normal(COUNT),
        "k": decades(-4, 0),
        "eps": decades(-2, 3),
        "k_s": decades(-4, 0),
        "eps_s": decades(-2, 3),
    }


def pointwise(changes: dict[str, Any]) -> Pointwise:
    model = ft.TwoFluid(GAS, COAL, **changes)
    floors = Regularisation.scaled(6.43, 0.01, COAL, 1e-8, 2e-5, void_fraction=1e-4)
    return Pointwise(GAS, COAL, model, floors, 0.01)


def quantities(point: Pointwise, at: dict[str, Any]) -> dict[str, Any]:
    """All that the closures say at a state, one scalar for each name."""
    gas, solids = Invariants(at["L"]), Invariants(at["L_s"])
    dilation = at["dilation"]
    alpha, theta, height = at["alpha"], at["theta"], at["height"]
    speed = point.speed(at["slip"])
    beta, growth = point.drag_and_growth(alpha, speed, height)
    coefficients = point.coefficients(alpha, theta, solids.square, dilation, beta)
    energy = point.granular_energy(
        coefficients, alpha, theta, solids.square, dilation, beta, at["slip"]
    )
    wall = point.wall_state(alpha, theta, coefficients, at["slip"])
    found = {
        "S:S": gas.square,
        "cubic": gas.cubic,
        "W:W": gas.spin,
        "g0": coefficients.g0,
        "p_f": coefficients.p_f,
        "mu_f": coefficients.mu_f,
        "p_s": point.solids_pressure(alpha, theta, solids.square, dilation),
        "beta": beta,
        "growth": growth,
        "p/theta": point.pressure_per_theta(alpha, theta),
        "theta": point.algebraic_theta(alpha, coefficients.g0, solids.square, beta),
        "wall friction": point.solids_wall_friction(wall),
        "wall heat": point.solids_wall_heat(wall),
        **coefficients.kinetic._asdict(),
        **energy._asdict(),
    }
    transported = bool(point.closures.turbulence.transported)
    scales = (at["k"], at["eps"]) if transported else ()
    eddies = point.eddies(gas, height, at["slope"], *scales)
    found["mu_t"] = point.gas_viscosity(eddies, at["slope"])
    found["gas wall"] = point.gas_wall_friction(speed, height, at["k"] if transported else None)
    if not transported:
        return found
    at_gas = point.gas_eddies(eddies)
    own = point.eddies(solids, height, 1.0, at["k_s"], at["eps_s"])
    viscosity = coefficients.kinetic.shear_viscosity
    grains = point.grains(alpha, theta, coefficients.g0, viscosity, speed, height, at["drift"], own)
    balances = point.gas_balances(eddies, at_gas, grains)
    balances |= point.closures.dispersed.balances(at_gas, grains)
    for name, balance in balances.items():
        found[f"rate of {name}"] = balance.rate
        found[f"diffusivity of {name}"] = balance.diffusivity
    nu_s = viscosity / (alpha * COAL.density)
    found["dispersion"] = point.dispersion(at_gas, grains, nu_s)
    found["eddy pressure"] = point.eddy_pressure(at["k_s"])
    return found


def in_ufl(point: Pointwise, states: dict[str, np.ndarray]) -> tuple[list[str], np.ndarray]:
    """The quantities by the code that FFCx makes, a state in each cell of a mesh."""
    mesh = create_interval(MPI.COMM_SELF, COUNT, (0.0, 1.0))
    at: dict[str, Any] = {}
    for name, shape in SHAPES.items():
        at[name] = fem.Function(fem.functionspace(mesh, ("DG", 0, shape)))
        at[name].x.array[:] = states[name].ravel()
    at["dilation"] = ufl.tr(at["L_s"])
    found = quantities(point, at)
    middle = np.array([[0.5]])
    expression = compile_expression(ufl.as_vector(list(found.values())), middle)
    return list(found), expression.eval(mesh, np.arange(COUNT)).reshape(COUNT, -1)


@pytest.mark.parametrize("name", SETS)
def test_ufl_and_arrays_agree_at_random_states(name: str) -> None:
    """Every quantity within 1e-12 of itself, or of what it is the difference of."""
    point, states = pointwise(SETS[name]), random_states()
    arrays = quantities(point, states | {"dilation": np.trace(states["L_s"], axis1=1, axis2=2)})
    told, found = in_ufl(point, states)
    assert told == list(arrays) and len(told) > 20
    scales = {"cubic": np.abs(arrays["S:S"]) ** 1.5, "growth": arrays["beta"] / SLIP_STEP}
    for i, quantity in enumerate(told):
        wanted = np.broadcast_to(np.asarray(arrays[quantity], dtype=float), COUNT)
        assert np.isfinite(wanted).all(), quantity
        scale = scales.get(quantity, np.abs(wanted))
        wrong = np.abs(found[:, i] - wanted) / np.maximum(scale, 1e-300)
        assert wrong.max() < 1e-12, (quantity, wrong.max(), states["alpha"][wrong.argmax()])


def test_every_law_stands_in_a_set() -> None:
    """Nothing that a point needs is left out of the comparison."""
    chosen = [pointwise(laws).closures for laws in SETS.values()]
    for family in (*FAMILIES, "turbulence", "dispersed", "dispersion", "gas-wall"):
        found = {getattr(laws, family.replace("-", "_")).name for laws in chosen}
        assert found == set(names(family)), family


def test_options_that_are_off_leave_every_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without them no law is asked, and the coefficients are those of the kinetic theory."""
    point, at = pointwise({}), random_states()

    def asked(*args: Any) -> None:
        raise AssertionError("a law that is off is asked")

    monkeypatch.setattr(type(point.closures.slip_production), "production", asked)
    alpha, theta, square = at["alpha"], at["theta"], at["k"]
    beta = point.drag(alpha, point.speed(at["slip"]), at["height"])
    found = point.coefficients(alpha, theta, square, 0 * theta, beta)
    still = point.coefficients(alpha, theta, square, 0 * theta, None)
    for name, value in found.kinetic._asdict().items():
        assert np.array_equal(value, getattr(still.kinetic, name)), name
    energy = point.granular_energy(found, alpha, theta, square, 0 * theta, beta, at["slip"])
    k = found.kinetic
    assert np.array_equal(energy.production, 2 * k.shear_viscosity * square)
    assert np.array_equal(energy.decay, k.dissipation / theta + 3 * beta)
    assert point.feels_theta
