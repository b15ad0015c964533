# SPDX-License-Identifier: LGPL-3.0-or-later
"""The two-fluid section on one mesh: spaces, forms and constraints.

Unknowns on triangles (quadrilaterals likewise): u_g and u_s P2 with three components, p P1,
logit(alpha_s), the fluctuation speed c and the logarithms that a law of turbulence transports P2.
alpha_s lives in the space of the velocity components, so that momentum closes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.la import InsertMode
from mpi4py import MPI

from fem_tfm.closures.walls.gas import GasWall
from fem_tfm.closures.walls.solids import SolidsWall
from fem_tfm.fenics import compile_expression
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.materials import Gas, Solids
from fem_tfm.models import section
from fem_tfm.models.section import structure
from fem_tfm.models.two_fluid.forms import Domain, Lag, Stabilisation, State, TwoFluidForms
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.newton import Block, Border


@dataclass(frozen=True)
class Setup:
    """Numbers of one problem (SI), free of meshes and forms.

    model : materials and laws
    wall_offset : distance y_p at which the gas wall law holds [m]
    gas_velocity : superficial U_g [m/s]
    feed : ("holdup", mean alpha_s) or ("flux", superficial solids velocity [m/s]); None for the
        gas alone
    """

    model: TwoFluid
    numerics: Stabilisation
    gravity: tuple[float, float, float]
    wall_offset: float
    gas_velocity: float
    feed: tuple[str, float] | None
    quadrature_degree: int = 5

    @property
    def gas(self) -> Gas:
        """The gas."""
        return self.model.gas

    @property
    def solids(self) -> Solids | None:
        """The grains; None for the gas alone."""
        return self.model.solids

    @property
    def structure(self) -> tuple[Any, ...]:
        """What the forms depend on; setups that agree in it differ in numbers alone."""
        laws = tuple(
            structure(getattr(self.model, f.name))
            for f in fields(self.model)
            if f.name not in ("gas", "solids", "wall_distance", "grain_gap")
        )
        return self.solids is None, self.feed and self.feed[0], self.quadrature_degree, laws

    @property
    def names(self) -> tuple[str, ...]:
        """Unknowns of the problem, in their order."""
        return (NAMES[:2] if self.solids is None else NAMES) + self.model.scales

    def bound(
        self, wrap: Callable[[Any], Any]
    ) -> tuple[Gas, Solids | None, TwoFluid, Any, Stabilisation]:
        """Gas, solids, laws, gravity, numerics with all numbers wrapped, in a fixed order."""
        return (
            self.gas.bound(wrap),
            self.solids and self.solids.bound(wrap),
            self.model.bound(wrap),
            wrap(self.gravity),
            self.numerics.bound(wrap),
        )


NAMES = ("u_g", "p", "u_s", "q", "c")
# logarithms of the turbulence and the fields they become
SCALES = {"ln_k": "k", "ln_eps": "eps", "ln_k_s": "k_s", "ln_eps_s": "eps_s"}


def _element(mesh: Any, names: tuple[str, ...]) -> Any:
    cell = mesh.basix_cell()
    p1 = basix.ufl.element("Lagrange", cell, 1)
    p2 = basix.ufl.element("Lagrange", cell, 2)
    vector = basix.ufl.blocked_element(p2, shape=(3,))
    special = {"u_g": vector, "u_s": vector, "p": p1}
    return basix.ufl.mixed_element([special.get(name, p2) for name in names])


class TwoFluidSection(section.Section):
    """A two-fluid problem on one mesh, ready for Newton.

    Parameters
    ----------
    mesh : the section with its tags and geometry
    setup : numbers of the problem
    progress : called with a word before each form is compiled
    develops : whether it is a station of a march

    Attributes
    ----------
    source : Constant, uniform relative source of solids [1/s], zero in a steady state
    mesh_terms, rougher : factors on the terms of the mesh, and a Rougher state if they are raised
    """

    setup: Setup

    def __init__(
        self,
        mesh: Mesh,
        setup: Setup,
        progress: Callable[[str], None] = lambda text: None,
        develops: bool = False,
    ) -> None:
        super().__init__(mesh, setup, setup.names, _element(mesh.mesh, setup.names), develops)
        self.source = self._constant(0.0)
        self.domain = self._domain()
        lag = None if develops or not setup.solids else Lag(self.lag, self.state(self.old))
        self.model = TwoFluidForms(*setup.bound(self._number), self._axis(), self.domain, lag)
        self.mesh_terms, self.rougher = MeshTerms(), None
        self.build(progress)

    def residual(self, test: State) -> ufl.Form:
        """Sum of all balances."""
        now, old = self.state(self.now), self.state(self.old)
        return self.model.residual(now, old, test, self.idt, self.drive, self.source)

    def update(self, setup: Setup) -> None:
        """Take over the numbers of a setup of the same structure; nothing is compiled or built."""
        super().update(setup)
        self.domain.wall_offset.value = setup.wall_offset
        self.mesh_terms, self.rougher = MeshTerms(), None

    def ease(self, terms: MeshTerms) -> None:
        """Multiply the terms that stand in for what the mesh cannot carry."""
        held, given = self.model.numerics, self.setup.numerics
        held.capture.value = terms.strength * given.capture
        held.damping.value = terms.strength * given.damping
        held.smallest_rate.value = terms.rate * given.smallest_rate
        held.smallest_front_rate.value = terms.rate * given.smallest_front_rate
        self.mesh_terms = terms

    def _domain(self) -> Domain:
        mesh = self.mesh.mesh
        x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
        inverse = ufl.JacobianInverse(mesh)
        across = ufl.dot(inverse, n)
        geometry = self.mesh.section
        return Domain(
            dx=self.dx,
            ds_wall=self.ds(self.mesh.tags["wall"]),
            normal=ufl.as_vector((n[0], n[1], 0.0)),
            wall_distance=geometry.wall_distance(x),
            wall_offset=self._constant(self.setup.wall_offset),
            diameter=self._constant(geometry.hydraulic_diameter),
            wall_cell=1 / ufl.sqrt(ufl.inner(across, across)),
            cell_area=abs(ufl.JacobianDeterminant(mesh)),
        )

    def state(self, function: fem.Function) -> State:
        """UFL state of a Function of the mixed space."""
        return State(**dict(zip(self.names, ufl.split(function), strict=True)))

    def boundary_conditions(self) -> list[fem.DirichletBC]:
        """u_x = 0 on the symmetry plane and no slip where a wall law asks for it."""
        laws: dict[str, GasWall | SolidsWall] = {
            "u_g": self.setup.model.gas_wall,
            "u_s": self.setup.model.solids_wall,
        }
        bcs = []
        for name in ("u_g", "u_s") if self.setup.solids else ("u_g",):
            components = {"symmetry": [0], "wall": [0, 1, 2] if laws[name].strong else []}
            for tag, which in components.items():
                if tag in self.mesh.tags:
                    facets = self.mesh.facets(tag)
                    bcs += [self._zero(name, component, facets) for component in which]
        return bcs

    def borders(self) -> list[Border]:
        """G is set by the gas flux, or by the mean pressure of a station.

        The uniform source of solids of a developed section is set by their hold-up or flux.
        """
        now, dx, targets = self.state(self.now), self.dx, self.targets()
        alpha = self.model.alpha(now)
        if self.develops:
            return [self._drive_border(now.p * dx, targets[0])]
        borders = [self._drive_border((1 - alpha) * now.u_g[2] * dx, targets[0])]
        if (feed := self.setup.feed) is not None:
            carried = alpha * dx if feed[0] == "holdup" else alpha * now.u_s[2] * dx
            column = -alpha * self._test().q * dx
            borders.append(self._border(self.source, column, carried, targets[1]))
        return borders

    def _drive_border(self, constraint: Any, target: float) -> Border:
        """G, which drives both phases, and what determines it."""
        test, alpha = self._test(), self.model.alpha(self.state(self.now))
        column = -(1 - alpha) * test.u_g[2] * self.dx
        if self.setup.solids is not None:
            column -= alpha * test.u_s[2] * self.dx
        return self._border(self.drive, column, constraint, target)

    def targets(self) -> list[float]:
        """Gas flux, and hold-up or solids flux, of the meshed part of the section; 0 for a station.

        Fluxes are those of the true section: the mesh's misses a sliver along a curved wall.
        """
        if self.develops:
            return [0.0]
        setup, true_area = self.setup, self.mesh.section.meshed_area
        targets = [setup.gas_velocity * true_area]
        if setup.feed:
            kind, value = setup.feed
            targets.append(value * (self.area if kind == "holdup" else true_area))
        return targets

    def blocks(self) -> list[Block]:
        """Sizes of the unknowns, from the scales of the problem."""
        speed = 0.1 * self.setup.gas_velocity
        head = 0.1 * self.setup.gas.density * self.setup.gas_velocity**2
        scales = {"u_g": speed, "p": head, "u_s": speed, "q": 1.0, "c": 0.2 * speed}
        scales |= dict.fromkeys(SCALES, 1.0)
        limits = {"q": 1.0} | dict.fromkeys(SCALES, 1.5)
        dofs = dict(zip(self.names, self.owned_dofs, strict=True))
        return [Block(n, dofs[n], scales[n], limits.get(n), n == "p") for n in self.names]

    # -- what others read ----------------------------------------------------------------------

    def fields(self) -> dict[str, fem.Function]:
        """Fields for output at their nodes.

        alpha_s, u_s, u_g, theta, pressure (above the mean of the section, with the weight of the
        gas), and k, eps, k_s, eps_s where they are transported.
        """
        fields = {"u_g": self.unknown("u_g"), "pressure": self._pressure()}
        if self.setup.solids is not None:
            alpha, theta = self.unknown("q"), self.unknown("c")
            alpha.x.array[:] = self.setup.solids.packing_limit / (1 + np.exp(-alpha.x.array))
            theta.x.array[:] = self.setup.numerics.theta_floor + theta.x.array**2
            fields = {"alpha_s": alpha, "u_s": self.unknown("u_s"), **fields, "theta": theta}
        for scale in (name for name in self.names if name in SCALES):
            fields[SCALES[scale]] = found = self.unknown(scale)
            found.x.array[:] = np.exp(found.x.array)
        for name, function in fields.items():
            function.name = name
        return fields

    def _pressure(self) -> fem.Function:
        """p + rho_g g.x at its nodes [Pa]."""
        found, setup = self.unknown("p"), self.setup
        points = found.function_space.tabulate_dof_coordinates()
        found.x.array[:] += points[:, :2] @ (setup.gas.density * np.array(setup.gravity[:2]))
        return found

    def friction(self) -> dict[str, fem.Function]:
        """Frictional pressure p_f and shear stress tau_f = mu_f sqrt(2 S:S) at the nodes [Pa]."""
        solid = self.model.solid(self.state(self.now))
        shear = solid.mu_f * ufl.sqrt(2 * ufl.inner(solid.strain, solid.strain))
        found = {}
        for name, value in {"p_f": solid.p_f, "tau_f": shear}.items():
            found[name] = fem.Function(self.space.sub(self.names.index("q")).collapse()[0])
            points = found[name].function_space.element.interpolation_points
            found[name].interpolate(compile_expression(value, points))
        return found

    def extremes(self) -> dict[str, float]:
        """Largest alpha_s [-] and Theta [m2/s2]: the early warning of a run."""
        if self.setup.solids is None:
            return {}
        x, comm = self.now.x.array, self.mesh.mesh.comm
        q, c = (x[self.owned_dofs[self.names.index(n)]].max(initial=-np.inf) for n in ("q", "c"))
        q, c = comm.allreduce(q, MPI.MAX), comm.allreduce(c, MPI.MAX)
        floor = self.setup.numerics.theta_floor
        limit = self.setup.solids.packing_limit
        return {"max_alpha_s": float(limit / (1 + np.exp(-q))), "max_theta": float(floor + c**2)}

    def wall_force(self) -> float:
        """Axial force of the walls on both phases per length [N/m], against the flow positive."""
        return sum(self.wall_forces().values())

    def wall_forces(self) -> dict[str, float]:
        """That on "gas" and on "solids" where there are any [N/m].

        Where a wall law gives the traction it is integrated; where a velocity is imposed it is the
        reaction in the discrete balance, the residual of the rows that the condition replaced.
        """
        now, laws = self.state(self.now), self.setup.model
        parts: dict[str, tuple[str, GasWall | SolidsWall, Any]] = {
            "gas": (
                "u_g",
                laws.gas_wall,
                (1 - self.model.alpha(now)) * self.model.gas_wall_traction(now),
            )
        }
        if self.setup.solids is not None:
            parts["solids"] = "u_s", laws.solids_wall, self.model.solids_wall_traction(now)
        return {
            phase: self._reaction(name)
            if law.strong
            else self.integral(f"wall {name}", traction[2], self.domain.ds_wall)
            for phase, (name, law, traction) in parts.items()
        }

    def _reaction(self, name: str) -> float:
        vector = fem.assemble_vector(self.newton.residual)
        vector.scatter_reverse(InsertMode.add)
        sub = self.space.sub(self.names.index(name)).sub(2)
        facets = self.mesh.facets("wall")
        dofs = fem.locate_dofs_topological(sub, 1, facets)
        owned = self.space.dofmap.index_map.size_local * self.space.dofmap.index_map_bs
        value = -float(vector.array[dofs[dofs < owned]].sum())
        return self.mesh.mesh.comm.allreduce(value)
