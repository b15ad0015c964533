# SPDX-License-Identifier: LGPL-3.0-or-later
"""The section of a duct's gas on one mesh: spaces, forms, constraint and solver.

Unknowns on quadrilaterals (triangles likewise): velocity, stresses, projected shear rates and
ln eps biquadratic, pressure bilinear. Stresses of a lower degree than the velocity converge to a
wrong answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import compute_midpoints

from fem_tfm.closures.turbulence.reynolds_stress import StressLaw, Wall
from fem_tfm.closures.walls.functions import WallFunction
from fem_tfm.fenics import compile_expression, compile_form
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.section import RectangularSection
from fem_tfm.models import section
from fem_tfm.models.reynolds_stress.exchange import Exchange
from fem_tfm.models.reynolds_stress.forms import (
    GasDomain,
    GasNumbers,
    GasState,
    ReynoldsStressForms,
)
from fem_tfm.models.section import structure
from fem_tfm.solvers.newton import Block, Border

# sizes of the unknowns over U, U^2 and U/D, for relative updates
SPEED, STRESS, SHEAR = 0.1, 3e-3, 20.0
# a normal to a round wall is undefined on the axis; over this share of the radius it fades
AXIS_ROUNDING = 0.05
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Setup:
    """Numbers of one problem (SI), free of meshes and forms; the laws are resolved.

    gas_velocity : bulk velocity U [m/s]
    """

    law: StressLaw
    function: WallFunction
    numbers: GasNumbers
    gas_velocity: float
    quadrature_degree: int = 5

    @property
    def structure(self) -> tuple[Any, ...]:
        """What the forms depend on; setups that agree in it differ in numbers alone."""
        return self.quadrature_degree, *(structure(law) for law in (self.law, self.function))

    def bound(self, wrap: Callable[[Any], Any]) -> tuple[StressLaw, WallFunction, GasNumbers]:
        """Laws and numbers with every number wrapped, in a fixed order."""
        return self.law.bound(wrap), self.function.bound(wrap), self.numbers.bound(wrap)


def _names(transported: bool) -> tuple[str, ...]:
    return ("u", "p", "e", "m", "r", "d") if transported else ("u", "p", "e", "m", "q")


def _element(mesh: Any, transported: bool) -> Any:
    cell = mesh.basix_cell()
    p1, p2 = (basix.ufl.element("Lagrange", cell, degree) for degree in (1, 2))
    vector = basix.ufl.blocked_element(p2, shape=(3,))
    more = [basix.ufl.blocked_element(p2, shape=(n,)) for n in (6, 4)] if transported else [p2]
    return basix.ufl.mixed_element([vector, p1, p2, p1, *more])


class ReynoldsStressSection(section.Section):
    """A turbulent gas on one mesh, ready for Newton.

    Parameters
    ----------
    mesh : the section; it begins `numbers.wall_offset` off the wall
    setup : numbers of the problem
    progress : called with a word before each form is compiled
    develops : whether it is a station of a march
    exchange : what particles give to the gas, None without particles
    """

    setup: Setup

    def __init__(
        self,
        mesh: Mesh,
        setup: Setup,
        progress: Callable[[str], None] = lambda text: None,
        develops: bool = False,
        exchange: Exchange | None = None,
    ) -> None:
        transported = setup.law.transported
        element = _element(mesh.mesh, transported)
        super().__init__(mesh, setup, _names(transported), element, develops)
        self.domain = self._domain()
        numbers = setup.bound(self._number)
        self.exchange = exchange
        self.model = ReynoldsStressForms(*numbers, self._axis(), self.domain, exchange)
        if exchange is not None:
            exchange.force.bind(self.state(self.now).u, self.dx)
        self._flux_form: fem.Form | None = None
        self.build(progress)

    def residual(self, test: GasState) -> ufl.Form:
        """Sum of all balances."""
        now, old = self.state(self.now), self.state(self.old)
        return self.model.residual(now, old, test, self.idt, self.drive)

    # -- geometry ------------------------------------------------------------------------------

    def _domain(self) -> GasDomain:
        mesh = self.mesh.mesh
        x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
        across = ufl.dot(ufl.JacobianInverse(mesh), n)
        return GasDomain(
            dx=self.dx,
            ds_wall=self.ds(self.mesh.tags["wall"]),
            walls=self._walls(x),
            wall_cell=1 / ufl.sqrt(ufl.inner(across, across)),
        )

    def _walls(self, x: Any) -> list[Wall]:
        """The nearest wall of each direction: sides of a duct, or the wall of a pipe."""
        geometry = self.mesh.section
        if isinstance(geometry, RectangularSection):
            half = self._constant(geometry.width / 2), self._constant(geometry.height / 2)
            units = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
            return [
                Wall(ufl.as_vector(unit), 1 / (half[i] - abs(x[i]))) for i, unit in enumerate(units)
            ]
        rounding = self._constant((AXIS_ROUNDING * geometry.radius) ** 2)
        radius = ufl.sqrt(x[0] ** 2 + x[1] ** 2 + rounding)
        normal = ufl.as_vector((x[0] / radius, x[1] / radius, 0.0))
        return [Wall(normal, 1 / geometry.wall_distance(x))]

    def boundary_conditions(self) -> list[fem.DirichletBC]:
        """Nothing flows through walls and planes of symmetry, where shear stress vanishes too."""
        tags, bcs = self.mesh.tags, []
        straight = isinstance(self.mesh.section, RectangularSection)
        for tag, component in (("symmetry", 0), ("symmetry_x", 0), ("symmetry_y", 1)):
            if tag in tags:
                facets = self.mesh.facets(tag)
                bcs.append(self._zero("u", component, facets))
                if self.setup.law.transported:
                    # R_xy and the stress between the normal and the axis, and their shear rates
                    bcs += [self._zero("r", c, facets) for c in (3, 4 + component)]
                    bcs += [self._zero("d", c, facets) for c in (3, component)]
        for component in (0, 1):
            facets = self.mesh.facets("wall")
            # a round wall has both components in its normal, and the flow in a pipe no swirl
            facing = self._facing(facets, component) if straight else facets
            bcs.append(self._zero("u", component, facing))
        return bcs

    def _facing(self, facets: np.ndarray, component: int) -> np.ndarray:
        """Those facets of the wall of a duct whose normal is along x (0) or y (1)."""
        geometry = self.mesh.section
        half = geometry.size[component] / 2 - geometry.wall_offset
        middle = compute_midpoints(self.mesh.mesh, 1, facets)
        return facets[np.abs(middle[:, component]) > half * (1 - ROUND_OFF)]

    # -- forms ---------------------------------------------------------------------------------

    def state(self, function: fem.Function) -> GasState:
        """UFL state of a Function of the mixed space."""
        return GasState(**dict(zip(self.names, ufl.split(function), strict=True)))

    def _flux(self) -> Any:
        """Form of the volume flux of the part solved, the strip at the wall included."""
        now = self.state(self.now)
        return now.u[2] * self.dx + self.model.strip_flux(now) * self.domain.ds_wall

    def borders(self) -> list[Border]:
        """G is set by the flux, or by the mean pressure of a station."""
        column, fixed = -self._test().u[2] * self.dx, self._flux()
        if self.develops:
            self._flux_form, fixed = compile_form(fixed), self.state(self.now).p * self.dx
        return [self._border(self.drive, column, fixed, self.targets()[0])]

    def targets(self) -> list[float]:
        """Flux of the part that is solved; 0 for a station."""
        geometry = self.mesh.section
        if self.develops:
            return [0.0]
        return [self.setup.gas_velocity * geometry.area / geometry.area_factor]

    def blocks(self) -> list[Block]:
        """Sizes of the unknowns, from the scales of the problem."""
        speed = self.setup.gas_velocity
        stress = STRESS * speed**2
        scales = {
            "u": SPEED * speed,
            "p": stress,
            "e": 1.0,
            "m": SPEED * speed,
            "r": stress,
            "d": SHEAR * speed / self.mesh.section.hydraulic_diameter,
            "q": 1.0,
        }
        limits, follows = {"e": 1.5, "q": 1.0}, ("p", "m", "d")
        dofs = dict(zip(self.names, self.owned_dofs, strict=True))
        return [Block(n, dofs[n], scales[n], limits.get(n), n in follows) for n in self.names]

    # -- what others read ----------------------------------------------------------------------

    def flux(self) -> float:
        """Volume flux of the part solved, the strip at the wall included [m3/s]."""
        if self._flux_form is not None:
            return self.mesh.mesh.comm.allreduce(fem.assemble_scalar(self._flux_form))
        target = float(self.newton.borders[0].target.value)
        return self.newton.constraint_errors()[0] + target

    def wall_length(self) -> float:
        """Length of the plane of the wall functions [m]."""
        return self.integral("wall", self._constant(1.0), self.domain.ds_wall)

    def wall_force(self) -> float:
        """Axial force of the walls per length over the density [m3/s2]."""
        traction = self.model.traction(self.state(self.now))[2]
        return self.integral("wall force", traction, self.domain.ds_wall)

    def strip_momentum(self) -> float:
        """Axial momentum into the strip at the wall per length over the density [m3/s2]."""
        flow = self.model.strip_momentum(self.state(self.now))
        return self.integral("strip momentum", flow, self.domain.ds_wall)

    def particle_force(self) -> float:
        """Axial force of particles on the gas per length over the density [m3/s2]."""
        if self.exchange is None:
            return 0.0
        return self.integral("particles", self.exchange.push(self.state(self.now).u)[2])

    @property
    def pressure_gradient(self) -> float:
        """G over the density [m/s2]."""
        return float(self.drive.value)

    def fields(self) -> dict[str, fem.Function]:
        """Output at the nodes: u_g, pressure (p/rho), k, eps and reynolds_stress (3 x 3)."""
        fields = {"u_g": self.unknown("u"), "pressure": self.unknown("p")}
        now = self.state(self.now)
        scalar = fem.functionspace(self.mesh.mesh, ("Lagrange", 2))
        matrix = fem.functionspace(self.mesh.mesh, ("Lagrange", 2, (3, 3)))
        expressions = {
            "k": (scalar, self.model.energy(now)),
            "eps": (scalar, self.model.eps(now)),
            "reynolds_stress": (matrix, self.model.stress(now)),
        }
        for name, (space, expression) in expressions.items():
            fields[name] = fem.Function(space)
            points = space.element.interpolation_points
            fields[name].interpolate(compile_expression(expression, points))
        for name, function in fields.items():
            function.name = name
        return fields
