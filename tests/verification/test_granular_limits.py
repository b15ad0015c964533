# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed forms of kinetic theory, found by the forms: shear, cooling, agitation by the gas."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import problems
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType
from scipy.optimize import brentq

from fem_tfm.closures import make
from fem_tfm.fenics import compile_form
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.axis import DevelopedAxis
from fem_tfm.models.two_fluid.forms import State, TwoFluidForms
from fem_tfm.scenes.dense import setup_of
from fem_tfm.solvers.newton import Block, BorderedNewton
from fem_tfm.solvers.pseudo_time import PseudoTime, PseudoTimeControl

DIAMETER, SHEAR = 1e-3, 40.0
# e, alpha_s: Theta/(d rate)^2, p/(rho_s d^2 rate^2), tau/(rho_s d^2 rate^2) of Lun's energy balance
# mu rate^2 = gamma with Gidaspow's viscosity and the radial distribution of Carnahan and Starling
TABLE = {
    (0.80, 0.1): (3.829, 0.5625, 0.2380),
    (0.80, 0.3): (0.6598, 0.7277, 0.2913),
    (0.80, 0.5): (0.4657, 2.748, 1.162),
    (0.90, 0.1): (7.052, 1.054, 0.3139),
    (0.90, 0.3): (1.287, 1.477, 0.4188),
    (0.90, 0.5): (0.9261, 5.742, 1.720),
    (0.95, 0.1): (13.56, 2.046, 0.4297),
    (0.95, 0.3): (2.544, 2.976, 0.5973),
    (0.95, 0.5): (1.848, 11.73, 2.487),
}


class Cell:
    """The granular energy alone, in a shear u_z = rate y between frictionless walls, no gas.

    Parameters
    ----------
    theta : "transport" or "algebraic"
    others : laws beside those
    """

    def __init__(self, theta: str, **others: Any) -> None:
        mesh, domain = problems.square(2, 5, CellType.triangle)
        laws = replace(
            setup_of(problems.demo().scene).model,
            radial=make("radial", "carnahan-starling"),
            friction=make("friction", "none"),
            solids_wall=make("solids-wall", "free-slip"),
            theta=theta,
            **others,
        )
        self.numerics = problems.plain_numerics(
            alpha_diffusion=0.0,
            theta_floor=0.0,
            void_fraction=0.0,
            residual_fraction=0.0,
            theta_free=1e15,
        )
        # gas so thin that it neither heats nor cools: 3 beta/gamma is below 1e-12
        model = TwoFluidForms(
            problems.constants(mesh, Gas(1e-12, 1e-20)),
            problems.constants(mesh, Solids(2500.0, DIAMETER)),
            problems.constants(mesh, laws),
            fem.Constant(mesh, np.zeros(3)),
            problems.constants(mesh, self.numerics),
            DevelopedAxis(),
            domain,
        )
        self.solids = model.solids
        constants = [fem.Constant(mesh, 0.0) for _ in range(6)]
        self.rate, self.q, self.idt, self.slip, self.dilation, rest = constants
        space = fem.functionspace(mesh, ("Lagrange", 2))
        self.c, self.old = fem.Function(space), fem.Function(space)
        y = ufl.SpatialCoordinate(mesh)[1]
        velocity = ufl.as_vector((rest, self.dilation * y, self.rate * y))
        gas = velocity + ufl.as_vector((rest, rest, self.slip))
        now, old = (State(gas, rest, velocity, self.q, t) for t in (self.c, self.old))
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        form = model.granular_energy(now, old, test, self.idt)
        self.newton = BorderedNewton(
            compile_form(form),
            compile_form(ufl.derivative(form, self.c, trial)),
            self.c,
            [],
            [],
            [Block("c", np.arange(self.c.x.array.size), 1e-2)],
        )
        solid = model.solid(now)
        self.stress = compile_form(solid.stress()[1, 2] * domain.dx)
        self.pressure = compile_form(solid.pressure * domain.dx)
        sink = solid.kinetic.dissipation / ufl.sqrt(solid.theta)
        self.sink = compile_form(sink * test * domain.dx)

    def prescribe(self, e: float, alpha: float, rate: float) -> None:
        """Material and shear of a run."""
        self.solids.restitution.value, self.rate.value = e, rate
        self.q.value = math.log(alpha / (float(self.solids.packing_limit) - alpha))

    def scaled_residual(self) -> float:
        """Largest residual over the largest dissipation."""
        sink = fem.assemble_vector(self.sink).array
        return float(np.abs(self.newton.assemble_residual()).max() / np.abs(sink).max())


@cache
def cell(theta: str = "transport") -> Cell:
    """One set of forms for all runs."""
    return Cell(theta)


def radial(alpha: float) -> float:
    """Carnahan and Starling's g0."""
    return (1 - alpha / 2) / (1 - alpha) ** 3


def sheared(e: float, alpha: float) -> tuple[float, float, float]:
    """Theta, p and tau of simple shear over (d rate)^2 and rho_s (d rate)^2, from mu rate^2 = J."""
    g0 = radial(alpha)
    mu = 0.8 * alpha**2 * g0 * (1 + e) / math.sqrt(math.pi)
    mu += 10 * math.sqrt(math.pi) / (96 * (1 + e) * g0) * (1 + 0.8 * g0 * alpha * (1 + e)) ** 2
    loss = 12 * (1 - e**2) * g0 * alpha**2 / math.sqrt(math.pi)
    theta = mu / loss
    return theta, alpha * theta * (1 + 2 * (1 + e) * alpha * g0), mu * math.sqrt(theta)


@pytest.mark.parametrize(("e", "alpha"), TABLE)
def test_simple_shear_has_no_residual(e: float, alpha: float) -> None:
    """At the closed form the granular energy balances, and 1 % off it does not."""
    found, wanted = cell(), sheared(e, alpha)
    assert wanted == pytest.approx(TABLE[e, alpha], rel=5e-4)
    found.prescribe(e, alpha, SHEAR)
    found.idt.value = 0.0
    found.c.x.array[:] = math.sqrt(wanted[0]) * DIAMETER * SHEAR
    assert found.scaled_residual() < 1e-10
    found.c.x.array[:] *= 1.005
    # production/c ~ 1, dissipation/c ~ Theta: the balance is off by as much as Theta
    assert found.scaled_residual() == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize("theta", ["transport", "algebraic"])
@pytest.mark.parametrize(("e", "alpha"), TABLE)
def test_simple_shear_is_found(e: float, alpha: float, theta: str) -> None:
    """From a cold and uneven start the granular energy finds Theta, p and tau of the table."""
    found, wanted = cell(theta), sheared(e, alpha)
    found.prescribe(e, alpha, SHEAR)
    found.c.interpolate(lambda x: 3e-3 * np.exp(x[0] - 0.5 * x[1]))
    # below a third of the answer Newton alone runs away, as production grows faster than loss
    control = PseudoTimeControl(first=1 / SHEAR, smallest=1e-6, largest=1e8)
    PseudoTime(found.newton, found.old, found.idt, control).run()
    theta = found.c.x.array**2
    scale = (DIAMETER * SHEAR) ** 2
    assert theta / scale == pytest.approx(wanted[0], rel=1e-9)
    pressure, stress = (fem.assemble_scalar(f) for f in (found.pressure, found.stress))
    scale *= float(found.solids.density)
    assert (pressure / scale, stress / scale) == pytest.approx(wanted[1:], rel=1e-9)


@pytest.mark.parametrize("dilation", [-20.0, 20.0])
def test_a_negative_fluctuation_speed_returns(dilation: float) -> None:
    """Neither expansion nor compression drives a negative c away from zero."""
    found = cell()
    found.prescribe(1.0, 0.3, 0.0)
    found.dilation.value, found.idt.value = dilation, 1e4
    # so hot that the pressure does more work than the viscous stress
    hot = 100 * DIAMETER * abs(dilation)
    found.c.x.array[:] = found.old.x.array[:] = -hot
    found.newton.step()
    found.idt.value = found.dilation.value = 0.0
    assert -hot < found.c.x.array.min() and found.c.x.array.max() < 0


THETA_0 = 0.01


def haff_constant(e: float, alpha: float) -> float:
    """C of dTheta/dt = -C Theta^1.5 [1/m]."""
    return 8 * (1 - e**2) * radial(alpha) * alpha / (DIAMETER * math.sqrt(math.pi))


def cooled(time: float, steps: int) -> float:
    """Theta after implicit Euler steps of the form at rest."""
    found = cell()
    found.idt.value = steps / time
    found.c.x.array[:] = math.sqrt(THETA_0)
    for _ in range(steps):
        found.old.x.array[:] = found.c.x.array
        problems.newton(found.newton)
    c = found.c.x.array
    assert np.ptp(c) < 1e-9
    return float(c[0] ** 2)


@pytest.mark.parametrize(("e", "alpha", "tabled"), [(0.9, 0.1, 111.8), (0.8, 0.3, 1208.0)])
def test_homogeneous_cooling(e: float, alpha: float, tabled: float) -> None:
    """Haff's law: Theta_0/(1 + t/tau)^2 at first order in dt, and within 0.1 % in its limit."""
    constant = haff_constant(e, alpha)
    assert constant == pytest.approx(tabled, rel=1e-3)
    cell().prescribe(e, alpha, 0.0)
    time = 2 * 2 / (constant * math.sqrt(THETA_0))
    wanted = THETA_0 / (1 + 2) ** 2
    found = np.array([cooled(time, steps) for steps in (40, 80, 160)])
    errors = found / wanted - 1
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders == pytest.approx(1.0, abs=0.05)
    assert 2 * found[2] - found[1] == pytest.approx(wanted, rel=1e-3)


def test_elastic_grains_do_not_cool() -> None:
    """e = 1 keeps Theta."""
    cell().prescribe(1.0, 0.3, 0.0)
    assert cooled(1.0, 3) == pytest.approx(THETA_0, rel=1e-12)


# beta/alpha_s [kg/m3/s] and slip [m/s] of grains at rest in a gas
SPECIFIC, SLIP = 5e4, 3.0


def agitated(e: float, alpha: float) -> float:
    """Theta where Koch's production equals the dissipation by collisions and drag [m2/s2]."""
    density, beta = 2500.0, alpha * SPECIFIC
    collisions = (
        12 * (1 - e**2) * radial(alpha) * density * alpha**2 / (DIAMETER * math.sqrt(math.pi))
    )

    def surplus(log: float) -> float:
        theta = math.exp(log)
        made = 0.25 * beta**2 * DIAMETER * SLIP**2 / (alpha * density * math.sqrt(math.pi * theta))
        return made - collisions * theta**1.5 - 3 * beta * theta

    return math.exp(brentq(surplus, -20.0, 5.0))


@cache
def suspended() -> Cell:
    """Grains that only the slip agitates."""
    drag, law = make("drag", {"model": "constant", "value": SPECIFIC}), "koch"
    return Cell("transport", drag=drag, slip_production=make("slip-production", law))


@pytest.mark.parametrize("start", [1e-9, 1e-3, 1.0])
@pytest.mark.parametrize(("e", "alpha"), [(1.0, 0.01), (0.9, 0.01), (0.8, 0.3)])
def test_slip_agitates_a_suspension_at_rest(e: float, alpha: float, start: float) -> None:
    """Production = dissipation, from next to no fluctuation and from a strong one.

    Elastic grains have Theta^1.5 = v u^2/3, v = d/(4 sqrt(pi) tau); the regularisation v^2 takes
    v^2/(3 Theta) of it.
    """
    found = suspended()
    found.prescribe(e, alpha, 0.0)
    found.slip.value, found.c.x.array[:] = SLIP, math.sqrt(start)
    control = PseudoTimeControl(first=1e-2, smallest=1e-8, largest=1e8)
    PseudoTime(found.newton, found.old, found.idt, control).run()
    theta, speed = found.c.x.array**2, DIAMETER * SPECIFIC / 2500.0 / (4 * math.sqrt(math.pi))
    wanted = agitated(e, alpha)
    if e == 1:
        assert wanted == pytest.approx((speed * SLIP**2 / 3) ** (2 / 3), rel=1e-9)
    assert np.ptp(theta) < 1e-9 * wanted
    assert theta[0] == pytest.approx(wanted, rel=0.5 * speed**2 / wanted)
    assert theta[0] < wanted


@pytest.mark.parametrize("force", ["full", "alpha"])
def test_the_force_of_the_solids_pressure(force: str) -> None:
    """-grad(p_s), or -(dp/dalpha) grad(alpha): none in a uniform fraction with a hot side."""
    mesh, domain = problems.square(3, 5, CellType.triangle)
    laws = replace(
        setup_of(problems.demo().scene).model,
        friction=make("friction", "none"),
        solids_wall=make("solids-wall", "free-slip"),
        pressure_force=force,
    )
    material = Solids(2500.0, DIAMETER)
    model = TwoFluidForms(
        problems.constants(mesh, Gas(1.2, 1.8e-5)),
        problems.constants(mesh, material),
        problems.constants(mesh, laws),
        fem.Constant(mesh, np.zeros(3)),
        problems.constants(mesh, problems.plain_numerics(alpha_diffusion=0.0, theta_floor=0.0)),
        DevelopedAxis(),
        domain,
    )
    rest, crowd = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
    x, still = ufl.SpatialCoordinate(mesh), ufl.as_vector((rest, rest, rest))
    now = State(still, rest, still, crowd * x[0] - 1, 0.1 + 0.2 * x[0])
    space = fem.functionspace(mesh, ("Lagrange", 2, (3,)))
    v = ufl.TestFunction(space)
    momentum = compile_form(model.solids_momentum(now, now, v, rest, rest))
    solid = model.solid(now)
    per_theta = 1 + 2 * (1 + material.restitution) * solid.alpha * solid.g0
    per_theta = solid.alpha * material.density * per_theta
    slopes = [solid.theta * per_theta.dx(0), per_theta * solid.theta.dx(0)]
    by_alpha, by_theta = (compile_form(slope * v[0] * domain.dx) for slope in slopes)
    # the left side is no wall
    open_sides = fem.locate_dofs_geometrical(space, lambda x: np.isclose(x[0], 0.0))
    inside = np.ones((space.dofmap.index_map.size_local, 3), dtype=bool)
    inside[open_sides] = False
    for value in (0.0, 0.3):
        crowd.value = value
        found, share, rest_of_it = (
            fem.assemble_vector(form).array[inside.ravel()]
            for form in (momentum, by_alpha, by_theta)
        )
        wanted = share + rest_of_it if force == "full" else share
        assert np.abs(share).max() >= 0.1 * value * np.abs(rest_of_it).max()
        assert found == pytest.approx(wanted, abs=1e-3 * np.abs(rest_of_it).max())
