# SPDX-License-Identifier: LGPL-3.0-or-later
"""Manufactured solutions: the forms are the stated equations, and they are solved at full order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import problems
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType
from strong import Exact, Strong, divergence

from fem_tfm.fenics import compile_form
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.axis import DevelopedAxis
from fem_tfm.models.two_fluid.forms import Stabilisation, State, TwoFluidForms
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section
from fem_tfm.scenes.dense import setup_of

SPEED, DRIVE, SOURCE = 5.0, 5e4, 3.0
# numbers for which every term counts and none has a layer thinner than the coarsest cells; blends
# and the onset of friction are wide for the same reason. Names of laws are the demo's.
SCENE = {
    "geometry.inclination_deg": 30.0,
    "gas.density": 30.0,
    "gas.viscosity": 2e-3,
    "solids.density": 500.0,
    "solids.diameter": 1e-3,
    "operation.gravity": 100.0,
    "operation.gas_superficial_velocity": SPEED,
    "closures.drag.width": 0.2,
    "closures.friction.width": 0.05,
    "closures.friction.coefficient": 5e-4,
    "walls.distance": 1e-3,
}
DUCT = {"shape": "duct", "diameter": None, "width": 0.01, "height": 0.012}
CELLS = (1 / 8, 1 / 16, 1 / 32)
# in corners the errors of coarse cells cancel by chance
FINER = (1 / 16, 1 / 32, 1 / 64)
# q: the load keeps div(alpha_s u_s) off zero, and with it a diffusion that vanishes with h^2 only
EXPECTED = {"u_g": 2.7, "p": 1.9, "u_s": 2.7, "q": 2.0, "c": 2.7}


def exact(found: Section) -> State:
    """Even in x but for u_x, which is odd; nothing goes through the wall."""
    x, geometry = ufl.SpatialCoordinate(found.mesh.mesh), found.mesh.section
    if hasattr(geometry, "diameter"):
        a, b = (2 * x[i] / geometry.diameter for i in range(2))
        bubble = across = along = 1 - a * a - b * b
    else:
        a, b = 2 * x[0] / geometry.width, 2 * x[1] / geometry.height
        across, along = 1 - a * a, 1 - b * b
        bubble = across * along
    small = 0.02 * SPEED
    return State(
        u_g=ufl.as_vector(
            (
                small * across * a * (1 + b),
                small * along * ufl.cos(a) * (1 - b * b),
                SPEED * (0.8 + 0.8 * bubble + 0.2 * b),
            )
        ),
        p=150.0 * (ufl.cos(a) * ufl.sin(b) + 0.3 * a * a),
        u_s=ufl.as_vector(
            (
                -small * across * a * ufl.cos(2 * b),
                small * along * (0.5 * a * a - b),
                SPEED * (0.5 + 0.3 * bubble + 0.3 * ufl.sin(b)),
            )
        ),
        q=0.1 - 1.3 * b + 0.2 * a * a,
        c=0.5 + 0.1 * ufl.cos(2 * a) - 0.12 * b,
    )


def errors(found: Section, wanted: State) -> dict[str, float]:
    """Relative L2 errors of the fields, and those of both multipliers."""
    state, sizes = found.state(found.now), {}
    dx = ufl.Measure("dx", found.mesh.mesh, metadata={"quadrature_degree": 8})

    def norm(value: Any) -> float:
        return float(np.sqrt(fem.assemble_scalar(compile_form(ufl.inner(value, value) * dx))))

    for name in found.names:
        value = getattr(wanted, name)
        sizes[name] = norm(getattr(state, name) - value) / norm(value)
    sizes["drive"] = abs(float(found.drive.value) / DRIVE - 1)
    sizes["source"] = abs(float(found.source.value) / SOURCE - 1)
    return sizes


def solve(found: Section) -> dict[str, float]:
    """Find the exact state again from one that is off by 3 %, both multipliers unknown."""
    wanted = exact(found)
    found.drive.value, found.source.value = DRIVE, SOURCE
    test = State(**dict(zip(found.names, ufl.TestFunctions(found.space), strict=True)))
    load = found.model.residual(wanted, wanted, test, found.idt, found.drive, found.source)
    system = problems.LoadedNewton(found, load)
    alpha = found.model.alpha(wanted)
    gas, held = found.newton.borders
    gas.target.value = found.integral("wanted gas", (1 - alpha) * wanted.u_g[2])
    held.target.value = found.integral("wanted solids", alpha)
    problems.put(found, wanted)
    found.now.x.array[:] *= 1.03
    found.drive.value = found.source.value = 0.0
    assert problems.newton(system) <= 6
    return errors(found, wanted)


def friction_share(found: Section) -> tuple[float, float]:
    """Smallest and largest share of friction in the pressure of the solids at the exact state."""
    solid = found.model.solid(exact(found))
    share, space = solid.p_f / solid.pressure, fem.functionspace(found.mesh.mesh, ("DG", 1))
    value = fem.Function(space)
    value.interpolate(fem.Expression(share, space.element.interpolation_points))
    return value.x.array.min(), value.x.array.max()


def sequence(
    changes: dict[str, Any], cells: Sequence[float] = CELLS
) -> tuple[list[dict[str, float]], Section]:
    """Errors on meshes of halved cells, and the last section."""
    case, found = problems.demo(SCENE | changes), []
    for cell in cells:
        section = problems.section_of(case, cell)
        found.append(solve(section))
    return found, section


@pytest.mark.parametrize(
    ("changes", "cells"),
    [
        pytest.param({}, CELLS, id="pipe"),
        pytest.param(
            {f"geometry.{key}": value for key, value in DUCT.items()},
            FINER,
            id="duct",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"numerics.cells": "quadrilateral"}, CELLS, id="quads", marks=pytest.mark.slow
        ),
    ],
)
def test_order(changes: dict[str, Any], cells: Sequence[float]) -> None:
    """All terms on, inclined, curved walls: third order for P2 and second for p."""
    found, section = sequence(changes, cells)
    low, high = friction_share(section)
    assert low < 0.05 and high > 0.2
    coarse, middle, fine = found
    for name, order in EXPECTED.items():
        assert np.log2(middle[name] / fine[name]) > order, (name, found)
        assert np.log2(coarse[name] / fine[name]) / 2 > 1.9, (name, found)
    assert np.log2(middle["drive"] / fine["drive"]) > 2
    # the test function 1 makes the source exact on any mesh
    assert max(f["source"] for f in found) < 1e-10


def test_order_with_diffusion() -> None:
    """Where logit(alpha_s) diffuses enough for the cells, the orders show on every mesh."""
    found, _ = sequence({"numerics.alpha_diffusion": 7.5e-5})
    for coarse, fine in pairwise(found):
        for name, order in EXPECTED.items():
            assert np.log2(coarse[name] / fine[name]) > order, (name, found)
    assert max(found[-1][name] for name in ("u_g", "u_s", "q", "c")) < 1e-4


# -- weak against strong ---------------------------------------------------------------------------


def state_of(m: Any, x: Any, shift: float, vector: Any) -> State:
    """A smooth state of the unit square for UFL (m = ufl) or numpy, with flow through walls."""
    a, b = x[0] + shift, x[1]
    return State(
        u_g=vector((0.4 * m.sin(a + b), 0.3 * m.cos(2 * a) - 0.2 * b, 1.5 + m.sin(a * b) - a * b)),
        p=m.sin(2 * a) * m.cos(b) + 0.5 * b,
        u_s=vector((0.3 * m.cos(a - b), 0.5 * m.sin(a * b + 0.3), 0.6 + 0.4 * a - m.sin(b) ** 2)),
        q=0.8 - 1.5 * b + 0.4 * m.cos(2 * a),
        c=0.7 + 0.2 * m.sin(a + 2 * b),
    )


COMPONENTS = [("u_g", 0), ("u_g", 1), ("u_g", 2), ("p", None)]
COMPONENTS += [("u_s", 0), ("u_s", 1), ("u_s", 2), ("q", None), ("c", None)]


def weight(x: Any) -> Any:
    """The test function: it vanishes on no wall."""
    return 1 + 0.5 * x[0] - 0.3 * x[1] + x[0] * x[1] ** 2


class Weak:
    """All weak forms at the smooth state, tested with `weight` in one component at a time."""

    def __init__(self, closures: TwoFluid, numerics: Stabilisation) -> None:
        mesh, domain = problems.square(8, 9, CellType.quadrilateral)
        self.switches = [fem.Constant(mesh, 0.0) for _ in COMPONENTS]
        model = TwoFluidForms(
            problems.constants(mesh, GAS),
            problems.constants(mesh, SOLIDS),
            problems.constants(mesh, closures),
            fem.Constant(mesh, GRAVITY),
            problems.constants(mesh, numerics),
            DevelopedAxis(),
            domain,
        )
        x = ufl.SpatialCoordinate(mesh)
        w = [c * weight(x) for c in self.switches]
        test = State(ufl.as_vector(w[:3]), w[3], ufl.as_vector(w[4:7]), w[7], w[8])
        now, old = (state_of(ufl, x, shift, ufl.as_vector) for shift in (0.0, 0.1))
        numbers = (fem.Constant(mesh, v) for v in (IDT, FORCE, SUPPLY))
        self.form = compile_form(model.residual(now, old, test, *numbers))

    def value(self, i: int) -> float:
        """Residual with the weight in component i."""
        for j, switch in enumerate(self.switches):
            switch.value = float(i == j)
        return float(fem.assemble_scalar(self.form))


GAS, SOLIDS = (
    Gas(1.5, 0.05),
    Solids(4.0, 0.1, friction_limit=0.3, friction_angle_deg=28.648),
)
SMOOTH = {
    "closures.drag.width": 0.2,
    "closures.friction.width": 0.1,
    "closures.friction.stiffness": 1e6,
}
GRAVITY, IDT, FORCE, SUPPLY = np.array([0.4, -2.0, -1.0]), 0.8, 1.7, 0.6


def expected(strong: Strong) -> list[float]:
    """The same numbers from the strong form: weight times balance, and what is left at walls."""

    def exact(shift: float) -> Exact:
        def field(name: str) -> Any:
            return lambda x: getattr(state_of(np, x, shift, lambda v: np.stack(v)), name)

        return Exact(*map(field, ("u_g", "p", "u_s", "q", "c")))

    now, old, fluxes = exact(0.0), exact(0.1), strong.fluxes(exact(0.0))
    nodes, weights = np.polynomial.legendre.leggauss(24)
    nodes, weights = (nodes + 1) / 2, weights / 2
    inside = np.stack([g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij")])
    rest, area = strong.rest(now, old, inside), np.outer(weights, weights).ravel()
    total = {
        name: (rest[name] + divergence(fluxes[name], inside)) @ (area * weight(inside))
        for name in fluxes
    }
    sides = {(1, 0): True, (0, 1): True, (0, -1): True, (-1, 0): False}
    for (n_x, n_y), is_wall in sides.items():
        x = np.stack([nodes, nodes])
        x[0 if n_x else 1] = max(n_x + n_y, 0)
        n = np.array([n_x, n_y, 0.0])
        ties = strong.wall(now, x, n) if is_wall else {}
        for name, flux in fluxes.items():
            leaving = np.einsum("...jn,j->...n", flux(x), n)
            edge = ties.get(name, 0.0) - leaving
            total[name] = total[name] + edge @ (weights * weight(x))
    return [total[n] if i is None else total[n][i] for n, i in COMPONENTS]


@pytest.mark.parametrize("feeds", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_weak_forms_are_the_stated_equations(feeds: bool) -> None:
    """Weak forms equal the strong balances, written in numpy, integrated by parts with the walls.

    Flow goes through the walls and nothing is steady, so every term is there, at order one.
    """
    laws = setup_of(problems.demo(SMOOTH).scene).model
    laws = replace(laws, friction_feeds_theta=feeds)
    numerics = problems.plain_numerics()
    weak = Weak(laws, numerics)
    strong = Strong(
        GAS, SOLIDS, laws, numerics, GRAVITY, problems.distance, problems.OFFSET, problems.RADIUS,
        problems.WALL_CELL, problems.WALL_CELL**2, FORCE, SUPPLY, IDT,
    )  # fmt: skip
    found = [weak.value(i) for i in range(len(COMPONENTS))]
    assert found == pytest.approx(expected(strong), rel=1e-6, abs=1e-6)
