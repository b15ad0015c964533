# SPDX-License-Identifier: LGPL-3.0-or-later
"""Transported turbulence and dispersion in the unsteady flow, against closed forms and bounds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import box, flow
from mpi4py import MPI
from sections import prandtl_karman
from test_unsteady_limits import UPRIGHT, G, drag_of, line, owned
from test_unsteady_robustness import AXIS, CONVEYING, FEED, conveying, run

from fem_tfm import Case
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, TurbulenceCoefficients
from fem_tfm.models.finite_volume.time_levels import TimeLevels, implicit_euler

FOUR = {"closures.turbulence": "realizable-4eq", "closures.dispersion": "burns"}
SIMONIN = {
    "closures.turbulence": "k-epsilon",
    "closures.dispersed": "simonin",
    "closures.dispersion": "simonin",
    "walls.gas": "log-law-k",
}
DRIFT = {**FOUR, "closures.dispersion": "drift", "walls.grain_gap": 1.0}
NORMAL = {
    **FOUR,
    "closures.turbulence": "realizable",
    "closures.dispersed": {"model": "k-epsilon", "normal_stress": 1.0},
}
CONVEYING_FOUR = {**CONVEYING, **FOUR}
# along the pipe
AXIAL_CELLS = 50
LAWS = {"four": FOUR, "simonin": SIMONIN, "drift": DRIFT, "normal-stress": NORMAL}


@pytest.fixture(params=[0, 1], ids=["order0", "order1"])
def order(request: pytest.FixtureRequest) -> int:
    return request.param


# -- gas alone ---------------------------------------------------------------------------------


def decayed(dt: float, steps: int, order: int) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """k and eps after steps of `dt` k_0/eps_0, and k_0 A^(-1/(C_2 - 1)), eps_0 A^(-C_2/(C_2 - 1))
    with A = 1 + (C_2 - 1) t eps_0/k_0."""
    laws = {"closures.turbulence": "k-epsilon"}
    found = flow(box((10.0, 10.0, 10.0), (2, 2, 2), "ssssss"), laws, True, order=order)
    k, eps = 1.0, 10.0
    scales = {"k": np.full(found.cells.count, k), "eps": np.full(found.cells.count, eps)}
    found.now = replace(found.now, scales=scales)
    for _ in range(steps):
        found.advance(dt * k / eps, Inflow(0.0))
    age = 1 + 0.92 * steps * dt
    exact = {"k": k * age ** (-1 / 0.92), "eps": eps * age ** (-1.92 / 0.92)}
    return dict(found.now.scales), exact


def test_turbulence_decays_as_its_power_law(order: int) -> None:
    found, exact = decayed(0.005, 400, order)
    for name, wanted in exact.items():
        assert found[name] == pytest.approx(wanted, rel=1e-4 if order else 0.01)


def test_turbulence_stays_positive_in_steps_of_ten_times_its_own(order: int) -> None:
    found, _ = decayed(10.0, 400, order)
    for values in found.values():
        assert values.min() > 0


def test_decay_is_of_second_order_in_time() -> None:
    errors = []
    for steps in (40, 80):
        found, exact = decayed(2.0 / steps, steps, 1)
        errors.append([abs(found[name][0] / wanted - 1) for name, wanted in exact.items()])
    assert np.log2(np.divide(*errors)).min() > 1.8


def decaying_along(cells: int, order: int) -> float:
    """Mean error of k behind a grid in a stream, over k of the grid."""
    length, speed = 1.0, 10.0
    mesh = box((0.1, 0.1, length), (1, 1, cells), "ssssio")
    laws = {"closures.turbulence": "k-epsilon", "walls.gas": "free-slip"}
    inlet = {"inlet.gas_intensity": 1e-3, "inlet.length_scale": 1e-3}
    rest = {"operation.gas_superficial_velocity": speed, "gas.viscosity": 1e-9}
    found = flow(mesh, {**laws, **inlet, **rest}, True, order=order)
    found.set_velocities(np.zeros(3), np.array([0.0, 0.0, speed]))
    k, eps = (float(found.now.scales[name][0]) for name in ("k", "eps"))
    for _ in range(3 * cells):
        found.advance(length / speed / cells, Inflow(speed))
    z, now = line(found, found.now.scales["k"])
    exact = k * (1 + 0.92 * z / speed * eps / k) ** (-1 / 0.92)
    assert exact.min() < k / 2
    return float(np.abs(now - exact).mean()) / k


def test_slopes_carry_turbulence_to_second_order() -> None:
    """k = k_0 [1 + (C_2 - 1) (z/u) eps_0/k_0]^(-1/(C_2 - 1)), with next to no diffusion."""
    coarse, fine = (decaying_along(cells, 1) for cells in (20, 40))
    assert np.log2(coarse / fine) > 1.8
    assert fine < 0.1 * decaying_along(40, 0)


def test_shear_makes_what_the_laws_say() -> None:
    """Rates of k and eps in u = S y: (C_mu S^2 k/eps - eps/k) and (1.44 ... - 1.92 ...)."""
    found = flow(
        box((10.0, 10.0, 10.0), (3, 3, 3), "sswwss"), {"closures.turbulence": "k-epsilon"}, True
    )
    k, eps, shear, many = 1.0, 10.0, 20.0, found.cells.count
    u_g = np.zeros((many, 3))
    u_g[:, 2] = shear * found.cells.centre[:, 1]
    scales = {"k": np.full(many, k), "eps": np.full(many, eps)}
    now = replace(found.now, u_g=u_g, scales=scales)
    rate = found.turbulence.coefficients(implicit_euler(found.line, now, 1.0)).rate
    made = 0.09 * shear**2 * k / eps
    assert rate["k"] == pytest.approx(made - eps / k, rel=1e-3)
    assert rate["eps"] == pytest.approx(1.44 * made - 1.92 * eps / k, rel=1e-3)


def pipe(law: str, wall: str, reynolds: float, order: int, symmetry: str = "half") -> UnsteadyFlow:
    """A pipe of 25 diameters filled with moving gas."""
    size, speed, density = 0.01, 6.0, 1.2
    case = Case.from_dict(
        {
            "solution": "unsteady",
            "geometry": {"diameter": size, "length": 0.25, "symmetry": symmetry},
            "gas": {"density": density, "viscosity": density * speed * size / reynolds},
            "operation": {"gas_superficial_velocity": speed},
            "closures": {"turbulence": law},
            "walls": {"gas": wall},
            "numerics": {"axial_cells": AXIAL_CELLS, "level": 1, "order": order, "end_time": 1.0},
        }
    )
    found = UnsteadyFlow(case.scene.problem(), case.scene.mesh())
    found.set_velocities(np.zeros(3), speed * AXIS)
    return found


def steady(found: UnsteadyFlow, steps: int = 75) -> UnsteadyFlow:
    """The same gas after three times its way through the pipe."""
    speed = found.problem.gas_velocity
    dt = 2 * found.mesh.length / AXIAL_CELLS / speed
    for _ in range(steps):
        found.advance(dt, Inflow(speed))
    return found


def friction_of(found: UnsteadyFlow) -> float:
    """Darcy's factor of the last third but the outlet."""
    z, p = owned(found, found.cells.centre)[:, 2], owned(found, found.now.p)
    volume = owned(found, found.cells.volume)
    places = np.unique(np.round(z, 9))
    means = []
    for place in places:
        layer = np.isclose(z, place, rtol=0, atol=1e-6)
        means.append(np.average(p[layer], weights=volume[layer]))
    last = slice(2 * len(places) // 3, -3)
    gradient = -np.polyfit(places[last], means[last], 1)[0]
    size, speed = found.problem.diameter, found.problem.gas_velocity
    return 2 * size * gradient / (found.gas.density * speed**2)


@pytest.mark.parametrize(
    ("law", "wall"),
    [("k-epsilon", "log-law"), ("k-epsilon", "log-law-k"), ("realizable", "log-law")],
)
def test_a_smooth_pipe_has_the_friction_of_prandtl_and_the_log_law(
    law: str, wall: str, order: int
) -> None:
    reynolds = 1e5
    found = steady(pipe(law, wall, reynolds, order))
    f = friction_of(found)
    assert f == pytest.approx(prandtl_karman(reynolds), rel=0.03)
    speed, size = found.problem.gas_velocity, found.problem.diameter
    u_tau, z = speed * math.sqrt(f / 8), owned(found, found.cells.centre)[:, 2]
    y_plus = owned(found, found.line.wall_distance) * u_tau * reynolds / (speed * size)
    layer = (z > 0.22) & (z < 0.24) & (y_plus > 30) & (y_plus < 0.1 * u_tau / speed * reynolds / 2)
    assert layer.sum() > 5
    u_plus = owned(found, found.now.u_g)[layer, 2] / u_tau
    assert u_plus == pytest.approx(np.log(9.8 * y_plus[layer]) / 0.41, rel=0.06)
    # k of the layer is that of the traction
    k_plus = owned(found, found.now.scales["k"])[layer] / u_tau**2
    assert k_plus == pytest.approx(1 / math.sqrt(0.09), rel=0.1)


def test_half_a_pipe_has_the_turbulence_of_the_whole() -> None:
    """The plane of symmetry lets neither k nor eps pass."""
    means = []
    for symmetry in ("half", "none"):
        found = steady(pipe("k-epsilon", "log-law-k", 1e5, 0, symmetry), 40)
        volume, scales = owned(found, found.cells.volume), found.now.scales
        k, eps = (np.average(owned(found, scales[n]), weights=volume) for n in ("k", "eps"))
        means.append([k, eps, friction_of(found)])
    assert means[0] == pytest.approx(means[1], rel=0.01)


@pytest.mark.parametrize("reynolds", [2e4, 1e5])
def test_a_resolved_wall_needs_no_function(reynolds: float) -> None:
    """u+ = ln(9.8 y+)/0.41 beyond the buffer layer and y+ within the sublayer."""
    found = steady(pipe("k-epsilon", "low-reynolds", reynolds, 0))
    f, z = friction_of(found), owned(found, found.cells.centre)[:, 2]
    assert f == pytest.approx(prandtl_karman(reynolds), rel=0.1)
    speed, size = found.problem.gas_velocity, found.problem.diameter
    u_tau = speed * math.sqrt(f / 8)
    y_plus = owned(found, found.line.gas_profile[0]) * u_tau * reynolds / (speed * size)
    u_plus = owned(found, found.now.u_g)[:, 2] / u_tau
    far = (z > 0.2) & (z < 0.24)
    low, high = far & (y_plus < 3), far & (y_plus > 30) & (y_plus < 0.2 * reynolds / 50)
    assert low.any() and high.any()
    assert u_plus[low] == pytest.approx(y_plus[low], rel=0.1)
    assert u_plus[high] == pytest.approx(np.log(9.8 * y_plus[high]) / 0.41, rel=0.1)


# -- what eddies do to the solids --------------------------------------------------------------


def spread(found: UnsteadyFlow, diffusivity: float, normal: dict[str, Any] | None = None) -> None:
    """Give a flow's turbulence a given diffusivity of the solids and nothing else."""
    cells = found.cells

    def coefficients(levels: TimeLevels, relative: Any = None) -> TurbulenceCoefficients:
        now = levels.now
        gradient = cells.ghosted(cells.gradient(now.u_g))
        drag = found.drag(now)[0]
        alpha = np.maximum(now.alpha, SMALLEST_FRACTION)
        force = drag * diffusivity / (alpha * (1 - alpha))
        return TurbulenceCoefficients(gradient, 0.0, 0.0, force, drag, normal, {}, {}, {})

    found.turbulence.coefficients = coefficients


# grains so fine that they follow the force at once
BURNS = {
    "closures.turbulence": "mixing-length",
    "closures.dispersion": "burns",
    "closures.drag": "wen-yu",
    "solids.diameter": 3e-5,
}


@pytest.mark.parametrize("fraction", [1e-6, 1e-3])
def test_a_thin_cloud_spreads_as_diffusion_says(fraction: float, order: int) -> None:
    """alpha = a (1 + cos(pi z/L) exp(-D pi^2 t/L^2)), in gas that stays at rest."""
    length, diffusivity = 0.1, 1e-3
    found = flow(box((0.01, 0.01, length), (1, 1, 40), "ssssss"), BURNS, order=order)
    spread(found, diffusivity)
    z = found.cells.centre[:, 2]
    wave = np.cos(math.pi * z / length)
    found.initialise(fraction * (1 + wave))
    rate = diffusivity * (math.pi / length) ** 2
    steps = 100
    for _ in range(steps):
        found.advance(1.0 / rate / steps, Inflow(0.0))
        assert found.now.alpha.min() >= 0
        assert found.balances()["solids_mass"] < 1e-12
    assert found.now.alpha == pytest.approx(
        fraction * (1 + wave * math.exp(-1)), abs=0.01 * fraction
    )


def test_a_cloud_that_settles_is_held_up_by_dispersion(order: int) -> None:
    """alpha ~ exp(-w z/D), where beta D grad(alpha)/(alpha alpha_g) is the weight of the grains."""
    changes = {**UPRIGHT, **BURNS}
    length, alpha = 0.1, 1e-4
    found = flow(box((0.01, 0.01, length), (1, 1, 50), "ssssss"), changes, order=order)
    weight = alpha * (found.solids.density - found.gas.density) * G
    settling = weight / drag_of(found, alpha, 1e-2)
    diffusivity = settling * length / 2
    spread(found, diffusivity)
    found.initialise(alpha)
    for _ in range(300):
        found.advance(0.02 * length**2 / diffusivity, Inflow(0.0))
        assert found.balances()["solids_mass"] < 1e-12
    z, profile = line(found, found.now.alpha)
    slip = np.linalg.norm(line(found, found.now.u_g - found.now.u_s)[1], axis=1)
    settling = (
        weight
        / alpha
        * profile
        / np.array([drag_of(found, a, s) for a, s in zip(profile, slip, strict=True)])
    )
    slope = np.gradient(np.log(profile), z)[10:40]
    assert slope == pytest.approx(-settling[10:40] / diffusivity, rel=0.03)
    assert profile[10] > 3 * profile[40]


def test_normal_stress_of_the_eddies_is_borne_by_the_pressure() -> None:
    """p + 2/3 rho k is uniform in a gas at rest."""
    mesh = box((0.01, 0.01, 0.1), (1, 1, 20), "ssssso")
    found = flow(mesh, {**NORMAL, "closures.turbulence": "realizable"})
    found.initialise(1e-9)
    k = 10.0 * found.cells.centre[:, 2]
    spread(found, 0.0, {"k": k, "k_s": 0 * k})
    found.turbulence.solve = lambda step: (step.state.scales, 0)
    for _ in range(10):
        found.advance(1e-4, Inflow(0.0))
    found_p = line(found, found.now.p + found.gas.density * k)[1][:-2]
    assert np.ptp(found_p) < 0.01 * np.ptp(found.gas.density * k)


def test_the_drag_fades_within_the_grain_gap() -> None:
    mesh = box((0.01, 0.01, 0.01), (4, 4, 2), "wwwwss")
    far, near = (flow(mesh, {"walls.grain_gap": gap}) for gap in (0.0, 2.0))
    y, gap = near.line.wall_distance, 2 * near.solids.diameter
    ratio = near.drag(near.now)[0] / far.drag(far.now)[0]
    assert ratio == pytest.approx(y**2 / (y**2 + gap**2))


# -- hard cases --------------------------------------------------------------------------------


@pytest.mark.parametrize("laws", LAWS)
@pytest.mark.parametrize("dt", [1e-4, 4e-3])
def test_bounds_hold_with_every_turbulence(laws: str, dt: float, order: int) -> None:
    """A front enters a duct: alpha, Theta, mass, and k, eps of both phases."""
    found = conveying(order, LAWS[laws])
    for _ in range(4):
        run(found, dt, 10, FEED)
        assert {"k", "eps"} <= set(found.now.scales)
        assert len(found.now.scales) == (2 if laws == "simonin" else 4)
        for values in found.now.scales.values():
            assert values.min() > 0
    assert found.now.alpha.max() > 0.2


@pytest.mark.parametrize("laws", LAWS)
def test_a_bed_under_gas_with_every_turbulence(laws: str, order: int) -> None:
    found = conveying(order, LAWS[laws])
    found.initialise(np.where(found.cells.centre[:, 1] < -0.0025, 0.6, 1e-8))
    run(found, 5e-4, 20, Inflow(6.43))


@pytest.mark.parametrize("laws", LAWS)
def test_turbulence_goes_on_bit_for_bit(laws: str, order: int) -> None:
    found, other = (conveying(order, LAWS[laws]) for _ in range(2))
    run(found, 1e-4, 5, FEED)
    other.restore(found.state())
    for one in (found, other):
        run(one, 1e-4, 5, FEED)
    expected = found.state()
    assert {"k", "eps"} <= set(expected)
    for name, values in other.state().items():
        assert np.array_equal(values, expected[name]), name


@pytest.mark.mpi
def test_ranks_agree_with_four_equations() -> None:
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        one = flow(box((0.01, 0.01, 0.1), (4, 4, 20), "wwwwio", comm=comm), CONVEYING_FOUR)
        one.initialise(1e-8)
        one.set_velocities(6.09 * AXIS, 6.43 * AXIS)
        for _ in range(20):
            one.advance(2e-4, FEED)
        scales = {n: one.cells.largest(v[: one.cells.owned]) for n, v in one.now.scales.items()}
        found.append(one.quantities() | scales)
    assert found[0] == pytest.approx(found[1], rel=1e-3)
