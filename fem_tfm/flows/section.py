# SPDX-License-Identifier: LGPL-3.0-or-later
"""The developed section on one mesh: spaces, forms, constraints and the solver that carries them.

Unknowns on triangles (quadrilaterals likewise): u_g and u_s P2 with three components, p P1,
logit(alpha_s), the fluctuation speed c and the logarithms that a law of turbulence transports P2.
alpha_s lives in the space of the velocity components, so that momentum closes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.la import InsertMode
from mpi4py import MPI
from petsc4py import PETSc

from fem_tfm.closures.base import Closure
from fem_tfm.closures.materials import Gas, Solids
from fem_tfm.fenics import compile_form
from fem_tfm.flows.discretisation import Discretisation
from fem_tfm.mesh import Mesh
from fem_tfm.models.axis import Axis, DevelopedAxis
from fem_tfm.models.two_fluid import ClosureSet, Domain, Stabilisation, State, TwoFluidForms
from fem_tfm.solvers.newton import Block, Border, BorderedNewton


@dataclass(frozen=True)
class Setup:
    """Numbers of one developed problem (SI), free of meshes and forms.

    feed : ("holdup", mean alpha_s) or ("flux", superficial solids velocity [m/s]); None for the
        gas alone
    """

    gas: Gas
    solids: Solids | None
    closures: ClosureSet
    numerics: Stabilisation
    gravity: tuple[float, float, float]
    wall_offset: float
    gas_velocity: float
    feed: tuple[str, float] | None
    quadrature_degree: int = 5

    @property
    def structure(self) -> tuple[Any, ...]:
        """What the forms depend on; setups that agree in it differ in numbers alone."""
        laws = tuple(_structure(getattr(self.closures, f.name)) for f in fields(self.closures))
        return self.solids is None, self.feed and self.feed[0], self.quadrature_degree, laws

    @property
    def names(self) -> tuple[str, ...]:
        """Unknowns of the problem, in their order."""
        scales = self.closures.turbulence.transported
        if self.solids is None:
            return NAMES[:2] + scales
        return NAMES + scales + self.closures.dispersed.transported

    def bound(self, wrap: Callable[[Any], Any]) -> tuple[Any, ...]:
        """Gas, solids, closures, gravity, numerics with all numbers wrapped, in a fixed order."""
        return (
            self.gas.bound(wrap),
            self.solids and self.solids.bound(wrap),
            self.closures.bound(wrap),
            wrap(self.gravity),
            self.numerics.bound(wrap),
        )


def between(a: Any, b: Any, share: float) -> Any:
    """A setup whose numbers lie between those of two of the same structure, b's at a share of 1."""
    if isinstance(a, float):
        return (1 - share) * a + share * b
    if isinstance(a, tuple):
        return tuple(between(x, y, share) for x, y in zip(a, b, strict=True))
    if is_dataclass(a):
        parts = {f.name: between(getattr(a, f.name), getattr(b, f.name), share) for f in fields(a)}
        return replace(b, **parts)
    return b


@dataclass(frozen=True)
class MeshTerms:
    """Factors on the terms that stand in for what the mesh cannot carry, 1 for the standard.

    strength : on capture and damping
    rate : on the smallest rate of both
    """

    strength: float = 1.0
    rate: float = 1.0

    @property
    def raised(self) -> bool:
        """Whether one is not the standard."""
        return self != MeshTerms()


@dataclass(frozen=True)
class Rougher:
    """A state with more of the raised terms of the mesh.

    state : as `Section.stored` gives it
    ratio : of its terms to those of the answer
    """

    state: tuple[np.ndarray, float, float]
    ratio: float


def _structure(law: Any) -> Any:
    """A law without its numbers; a plain switch is itself."""
    if not isinstance(law, Closure):
        return law
    values = ((f.name, getattr(law, f.name)) for f in fields(law))
    return type(law), tuple((k, v) for k, v in values if not isinstance(v, float))


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


class Section(Discretisation):
    """A developed problem on one mesh, ready for Newton.

    Parameters
    ----------
    mesh : the section with its tags and geometry
    setup : numbers of the problem
    progress : called with a word before each form is compiled
    """

    def __init__(
        self, mesh: Mesh, setup: Setup, progress: Callable[[str], None] = lambda text: None
    ) -> None:
        element = _element(mesh.mesh, setup.names)
        super().__init__(mesh, element, setup.names, setup.quadrature_degree)
        self.setup = setup
        self.idt = self._constant(0.0)
        self.drive = self._constant(0.0)
        self.source = self._constant(0.0)
        self.domain = self._domain()
        self.area = self.integral("area", self._constant(1.0))
        self.model = TwoFluidForms(*setup.bound(self._number), self._axis(), self.domain)
        # terms of the mesh, and a Rougher state where they are raised
        self.mesh_terms, self.rougher = MeshTerms(), None
        self.newton = self._newton(progress)

    def _axis(self) -> Axis:
        """How the flow changes along the axis."""
        return DevelopedAxis()

    def update(self, setup: Setup) -> None:
        """Take over the numbers of a setup of the same structure; nothing is compiled or built.

        Raises
        ------
        ValueError
            the setup has other laws, another kind of feed or another quadrature.
        """
        if setup.structure != self.setup.structure:
            raise ValueError("a section can take over numbers only, and this setup has other laws")
        self._renew(setup.bound)
        self.domain.wall_offset.value = setup.wall_offset
        self.setup, self.mesh_terms, self.rougher = setup, MeshTerms(), None
        for border, target in zip(self.newton.borders, self._targets(), strict=True):
            border.target.value = target
        self.newton.blocks = self._blocks()

    def ease(self, terms: MeshTerms) -> None:
        """Multiply the terms that stand in for what the mesh cannot carry."""
        held, given = self.model.numerics, self.setup.numerics
        held.capture.value = terms.strength * given.capture
        held.damping.value = terms.strength * given.damping
        held.smallest_rate.value = terms.rate * given.smallest_rate
        self.mesh_terms = terms

    def stored(self) -> tuple[np.ndarray, float, float]:
        """The state: a copy of the unknowns, G [Pa/m] and the source [1/s]."""
        return self.now.x.array.copy(), float(self.drive.value), float(self.source.value)

    def restore(self, state: tuple[np.ndarray, float, float]) -> None:
        """Put back what `stored` gave; at rest, or its forces would hold those of a lost step."""
        self.now.x.array[:], self.drive.value, self.source.value = state
        self.old.x.array[:] = self.now.x.array

    def _domain(self) -> Domain:
        mesh = self.mesh.mesh
        x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
        inverse = ufl.JacobianInverse(mesh)
        across = ufl.dot(inverse, n)
        metadata = {"quadrature_degree": self.setup.quadrature_degree}
        ds = ufl.Measure("ds", mesh, subdomain_data=self.mesh.facet_tags, metadata=metadata)
        geometry = self.mesh.geometry
        return Domain(
            dx=self.dx,
            ds_wall=ds(self.mesh.tags["wall"]),
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

    def _test(self) -> State:
        return State(**dict(zip(self.names, ufl.TestFunctions(self.space), strict=True)))

    def boundary_conditions(self) -> list[fem.DirichletBC]:
        """u_x = 0 on the symmetry plane and no slip where a wall law asks for it."""
        mesh, tags = self.mesh.mesh, self.mesh.facet_tags
        mesh.topology.create_connectivity(1, 2)
        zero = fem.Constant(mesh, PETSc.ScalarType(0))
        bcs = []
        for i, name in enumerate(self.names):
            if name not in ("u_g", "u_s"):
                continue
            law = self.setup.closures.gas_wall if name == "u_g" else self.setup.closures.solids_wall
            components = {"symmetry": [0], "wall": [0, 1, 2] if law.strong else []}
            for tag, which in components.items():
                facets = tags.find(self.mesh.tags[tag]) if tag in self.mesh.tags else []
                for component in which:
                    sub = self.space.sub(i).sub(component)
                    dofs = fem.locate_dofs_topological(sub, 1, facets)
                    bcs.append(fem.dirichletbc(zero, dofs, sub))
        return bcs

    def _newton(self, progress: Callable[[str], None]) -> BorderedNewton:
        test, trial = self._test(), ufl.TrialFunction(self.space)
        form = self.model.residual(
            self.state(self.now), self.state(self.old), test, self.idt, self.drive, self.source
        )
        progress("residual")
        residual = compile_form(form)
        progress("Jacobian")
        jacobian = compile_form(ufl.derivative(form, self.now, trial))
        progress("constraints")
        return BorderedNewton(
            residual,
            jacobian,
            self.now,
            self.boundary_conditions(),
            self._borders(),
            self._blocks(),
        )

    def _borders(self) -> list[Border]:
        """G is set by the gas flux, the uniform source of solids by hold-up or flux."""
        now, dx, targets = self.state(self.now), self.domain.dx, self._targets()
        alpha = self.model.alpha(now)
        borders = [self._drive_border((1 - alpha) * now.u_g[2] * dx, targets[0])]
        if self.setup.solids is not None:
            carried = alpha * dx if self.setup.feed[0] == "holdup" else alpha * now.u_s[2] * dx
            column = -alpha * self._test().q * dx
            borders.append(self._border(self.source, column, carried, targets[1]))
        return borders

    def _drive_border(self, constraint: Any, target: float) -> Border:
        """G, which drives both phases, and what determines it."""
        test, alpha = self._test(), self.model.alpha(self.state(self.now))
        column = -(1 - alpha) * test.u_g[2] * self.domain.dx
        if self.setup.solids is not None:
            column -= alpha * test.u_s[2] * self.domain.dx
        return self._border(self.drive, column, constraint, target)

    def _targets(self) -> list[float]:
        """Gas flux, and hold-up or solids flux, of the meshed part of the section.

        Fluxes are those of the true section: the mesh's misses a sliver along a curved wall.
        """
        setup, true_area = self.setup, self.mesh.geometry.meshed_area
        targets = [setup.gas_velocity * true_area]
        if setup.feed:
            kind, value = setup.feed
            targets.append(value * (self.area if kind == "holdup" else true_area))
        return targets

    def _blocks(self) -> list[Block]:
        speed = 0.1 * self.setup.gas_velocity
        head = 0.1 * self.setup.gas.density * self.setup.gas_velocity**2
        scales = {"u_g": (speed,), "p": (head,), "u_s": (speed,)}
        scales |= {"q": (1.0, 1.0), "c": (0.2 * speed,)}
        scales |= dict.fromkeys(SCALES, (1.0, 1.5))
        dofs = dict(zip(self.names, self._dofs, strict=True))
        return [Block(n, dofs[n], *scales[n], follows=n == "p") for n in self.names]

    # -- what others read ----------------------------------------------------------------------

    def fields(self) -> dict[str, fem.Function]:
        """Fields for output at their nodes.

        alpha_s, u_s, u_g, theta, pressure (in the section), and k, eps, k_s, eps_s where they are
        transported.
        """
        fields = {"u_g": self.unknown("u_g"), "pressure": self.unknown("p")}
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

    def friction(self) -> dict[str, fem.Function]:
        """Frictional pressure p_f and shear stress tau_f = mu_f sqrt(2 S:S) at the nodes [Pa]."""
        solid = self.model.solid(self.state(self.now))
        shear = solid.mu_f * ufl.sqrt(2 * ufl.inner(solid.strain, solid.strain))
        found = {}
        for name, value in {"p_f": solid.p_f, "tau_f": shear}.items():
            found[name] = fem.Function(self.space.sub(self.names.index("q")).collapse()[0])
            points = found[name].function_space.element.interpolation_points
            found[name].interpolate(fem.Expression(ufl.as_ufl(value), points))
        return found

    def extremes(self) -> dict[str, float]:
        """Largest alpha_s [-] and Theta [m2/s2]: the early warning of a run."""
        if self.setup.solids is None:
            return {}
        x, comm = self.now.x.array, self.mesh.mesh.comm
        q, c = (x[self._dofs[self.names.index(n)]].max(initial=-np.inf) for n in ("q", "c"))
        q, c = comm.allreduce(q, MPI.MAX), comm.allreduce(c, MPI.MAX)
        floor = self.setup.numerics.theta_floor
        limit = self.setup.solids.packing_limit
        return {"max_alpha_s": float(limit / (1 + np.exp(-q))), "max_theta": float(floor + c**2)}

    def wall_force(self) -> float:
        """Axial force of the walls on both phases per length [N/m], against the flow positive.

        Where a wall law gives the traction it is integrated; where a velocity is imposed it is the
        reaction in the discrete balance, the residual of the rows that the condition replaced.
        """
        now = self.state(self.now)
        laws = self.setup.closures
        force = 0.0
        traction = (1 - self.model.alpha(now)) * self.model.gas_wall_traction(now)
        tractions = {"u_g": (laws.gas_wall, traction)}
        if self.setup.solids is not None:
            tractions["u_s"] = (laws.solids_wall, self.model.solids_wall_traction(now))
        for name, (law, traction) in tractions.items():
            if law.strong:
                force += self._reaction(name)
            else:
                force += self.integral(f"wall {name}", traction[2], self.domain.ds_wall)
        return force

    def _reaction(self, name: str) -> float:
        vector = fem.assemble_vector(self.newton.residual)
        vector.scatter_reverse(InsertMode.add)
        sub = self.space.sub(self.names.index(name)).sub(2)
        self.mesh.mesh.topology.create_connectivity(1, 2)
        facets = self.mesh.facet_tags.find(self.mesh.tags["wall"])
        dofs = fem.locate_dofs_topological(sub, 1, facets)
        owned = self.space.dofmap.index_map.size_local * self.space.dofmap.index_map_bs
        value = -float(vector.array[dofs[dofs < owned]].sum())
        return self.mesh.mesh.comm.allreduce(value)
