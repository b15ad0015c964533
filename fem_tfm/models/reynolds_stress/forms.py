# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weak forms of a turbulent gas with a transport equation for each Reynolds stress.

Balances of a gas of constant density, over the density (physics of the square duct)::

    div u = 0
    u.grad u = -grad P/rho + div(nu (grad u + grad u^T) - R)
    u.grad R_ij = d_k (C_s k/eps R_kn d_n R_ij) + P_ij + Phi_ij - 2/3 eps delta_ij
    u.grad e = div(C_eps k/eps R grad eps)/eps + (C_e1 P - C_e2 eps)/k,   e = ln eps

Unknowns are u (three components), p, the six R_ij and e; p is P/rho plus half of R_xx + R_yy, so
that only the anisotropy in the section and R_xy drive the secondary flow; the axial part of the
pressure is the drive G/rho. The viscous stress that R hides is put in and taken out again (EVSS)::

    + nu_s [D(u) - D_h] : grad v,   nu_s = C k^2/eps,   D_h the projection of D(u)

where D are the shear rates in the section. It vanishes with the cells, and without it the velocity
finds no stress to answer its zigzag; div u, which has no projection, is resisted by nu_s likewise.
With an eddy viscosity the stresses and D_h are left out and q = ln k is an unknown instead.

Axial momentum is conserved: m, the axial velocity in the space of the pressure, is an unknown, and

    u.grad u_z = div(u u_z) - m div u

leaves u_z - m alone to meet what is left of div u, so that G A, the force of the walls, the change
of the momentum flux and what flows into the strip at the wall add up to round-off.

The mesh begins at a plane in the log layer; what flows in the strip behind it takes part in
continuity. Derivatives of stresses along the axis are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import ufl
from ufl.core.expr import Expr

from fem_tfm.closures.ops import symmetric, trace
from fem_tfm.closures.turbulence.reynolds_stress import (
    EddyViscosity,
    StressLaw,
    Transported,
    Wall,
    production,
)
from fem_tfm.closures.walls.functions import WallFunction
from fem_tfm.models.axis import Axis
from fem_tfm.models.reynolds_stress.exchange import Exchange

# unit vector downstream, and the projection on the section
AXIAL = ufl.as_vector((0.0, 0.0, 1.0))
SECTION = ufl.as_matrix(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)))
# places of the unknown stresses in R
COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class GasState:
    """Unknowns as UFL expressions.

    u : velocity [m/s];  p : modified pressure over the density [m2/s2];  e : ln(eps/(m2/s3))
    m : u_z projected on the space of p [m/s]
    r : R_xx, R_yy, R_zz, R_xy, R_xz, R_yz [m2/s2];  d : projected shear rates [1/s]
    q : ln(k/(m2/s2)), in place of r and d for an eddy viscosity
    """

    u: Expr
    p: Expr
    e: Expr
    m: Expr
    r: Any = None
    d: Any = None
    q: Any = None


@dataclass(frozen=True)
class GasNumbers:
    """Numbers of the forms.

    viscosity : nu [m2/s]
    stabilisation : C of the EVSS viscosity C k^2/eps [-]
    wall_penalty : factor of the condition on eps at the plane [-]
    pressure_shift : compressibility that fixes the mean of p [s/m2]
    wall_offset : distance of the plane from the wall [m]
    """

    viscosity: Any
    stabilisation: Any
    wall_penalty: Any
    pressure_shift: Any
    wall_offset: Any

    def bound(self, wrap: Callable[[Any], Any]) -> GasNumbers:
        """The same values wrapped, so that a change recompiles nothing."""
        return replace(self, **{f.name: wrap(getattr(self, f.name)) for f in fields(self)})


@dataclass(frozen=True)
class GasDomain:
    """What the forms need of the geometry.

    dx, ds_wall : measures of the section and of the plane of the wall functions
    walls : the walls that reflect pressure
    wall_cell : thickness of a cell at the plane [m]
    """

    dx: Any
    ds_wall: Any
    walls: Sequence[Wall]
    wall_cell: Expr


def tensor(r: Expr) -> Expr:
    """Symmetric tensor of its six components, shape (3, 3)."""
    return ufl.as_matrix([[r[0], r[3], r[4]], [r[3], r[1], r[5]], [r[4], r[5], r[2]]])


def components(t: Expr) -> Expr:
    """The six components of a symmetric tensor."""
    return ufl.as_vector([t[i, j] for i, j in COMPONENTS])


@dataclass(eq=False)
class ReynoldsStressForms:
    """A turbulent gas in a straight duct.

    Parameters
    ----------
    law : Reynolds stresses
    function : wall function
    numbers : viscosity and regularisations
    axis : the axial derivative
    domain : measures and walls
    exchange : what particles give to the gas, None without particles
    """

    law: StressLaw
    function: WallFunction
    numbers: GasNumbers
    axis: Axis
    domain: GasDomain
    exchange: Exchange | None = None

    @property
    def eddy_law(self) -> EddyViscosity:
        """The law where its stresses are those of an eddy viscosity."""
        assert isinstance(self.law, EddyViscosity)
        return self.law

    @property
    def transport_law(self) -> Transported:
        """The law where it transports the stresses."""
        assert isinstance(self.law, Transported)
        return self.law

    @property
    def damping(self) -> Expr | None:
        """Rate at which particles damp the eddies, None where they do not [1/s]."""
        return None if self.exchange is None else self.exchange.damping

    # -- pointwise quantities ------------------------------------------------------------------

    def velocity_gradient(self, state: GasState) -> Expr:
        """L_ij = d_j u_i [1/s]."""
        along = self.axis.change(lambda s: s.u, state)
        return self.axis.jacobian(state.u) + ufl.outer(along, AXIAL)

    def eps(self, state: GasState) -> Expr:
        """Dissipation [m2/s3]."""
        return ufl.exp(state.e)

    def energy(self, state: GasState) -> Expr:
        """k [m2/s2]."""
        return ufl.exp(state.q) if state.r is None else (state.r[0] + state.r[1] + state.r[2]) / 2

    def stress(self, state: GasState) -> Expr:
        """R, shape (3, 3) [m2/s2]."""
        if state.r is not None:
            return tensor(state.r)
        return self.eddy_law.stress(
            self.velocity_gradient(state), self.energy(state), self.eps(state)
        )

    def reflections(self, state: GasState) -> list[tuple[Wall, Expr]]:
        """Walls with their f_z [-]; none where the law has no reflection."""
        if state.r is None:
            return []
        k, eps = self.energy(state), self.eps(state)
        return [(wall, self.transport_law.reflection(k, eps, wall)) for wall in self.domain.walls]

    def advected(self, quantity: Callable[[GasState], Expr], state: GasState) -> Expr:
        """u.grad of a scalar quantity of the state."""
        across = ufl.dot(state.u, self.axis.gradient(quantity(state)))
        return across + state.u[2] * self.axis.change(quantity, state)

    def traction(self, state: GasState) -> Expr:
        """Force of the gas on the wall along it, over the density [m2/s2]."""
        n = self.numbers
        return self.function.friction(self.energy(state), n.wall_offset, n.viscosity) * state.u

    def strip_flux(self, state: GasState) -> Expr:
        """Axial volume flux of the strip at the wall per width [m2/s]."""
        n = self.numbers
        width = self.function.strip(self.energy(state), n.wall_offset, n.viscosity)
        return width * state.u[2]

    def shear_rates(self, u: Expr) -> Expr:
        """w_x, w_y, u_x - v_y, u_y + v_x: what shears in the section [1/s]."""
        return ufl.as_vector(
            (u[2].dx(0), u[2].dx(1), u[0].dx(0) - u[1].dx(1), u[0].dx(1) + u[1].dx(0))
        )

    def swelling(self, state: GasState) -> Expr:
        """div u [1/s]."""
        across = state.u[0].dx(0) + state.u[1].dx(1)
        return across + self.axis.change(lambda s: s.u[2], state)

    # -- balances ------------------------------------------------------------------------------

    def mass(self, now: GasState, w: Expr) -> ufl.Form:
        """Continuity; the strip takes what leaves the section through the plane of the wall."""
        along = self.axis.change(lambda s: s.u[2], now)
        strip = self.axis.change(self.strip_flux, now)
        shift = self.numbers.pressure_shift * now.p
        inside = ((along + shift) * w - ufl.dot(now.u, self.axis.gradient(w))) * self.domain.dx
        return inside + strip * w * self.domain.ds_wall

    def momentum(self, now: GasState, old: GasState, v: Expr, idt: Any, drive: Any) -> ufl.Form:
        """Momentum with the wall function; `drive` = G/rho [m/s2]."""
        rate, spread = self.velocity_gradient(now), self.axis.jacobian(v)
        stress = self.stress(now)
        isotropic = (stress[0, 0] + stress[1, 1]) / 2
        viscous = 2 * self.numbers.viscosity * symmetric(rate)
        flux = stress - (isotropic - now.p) * SECTION - viscous
        along = ufl.dot(rate, now.u)
        change = idt * (now.u - old.u) - drive * AXIAL
        change = change + ufl.as_vector((along[0], along[1], self.axial(now)))
        if self.exchange is not None:
            change = change - self.exchange.push(now.u)
        form = (ufl.dot(change, v) - ufl.inner(flux, spread)) * self.domain.dx
        if now.d is not None:
            hidden = self.shear_rates(now.u) - now.d
            viscosity = self.numbers.stabilisation * self.energy(now) ** 2 / self.eps(now)
            form += viscosity * ufl.inner(hidden, self.shear_rates(v)) * self.domain.dx
            form += viscosity * self.swelling(now) * (v[0].dx(0) + v[1].dx(1)) * self.domain.dx
        return form + ufl.dot(self.traction(now), v) * self.domain.ds_wall

    def axial(self, now: GasState) -> Expr:
        """Axial acceleration, u.grad u_z in a form that conserves momentum [m/s2].

        Continuity makes div u vanish in the mean only, and u_z div u would exceed the drive; so the
        divergence of u u_z loses m div u, whose integral continuity tells: what flows into the
        strip at the wall.
        """
        speed, swelling = now.u[2], self.swelling(now)
        across = ufl.dot(now.u, self.axis.gradient(speed))
        across += speed * (swelling - self.axis.change(lambda s: s.u[2], now))
        along = self.axis.change(lambda s: s.u[2] ** 2, now)
        return across + along - now.m * (swelling + self.numbers.pressure_shift * now.p)

    def strip_momentum(self, now: GasState) -> Expr:
        """Axial momentum that flows into the strip at the wall, per area, over the density [m2/s2].

        It goes with the velocity that continuity is tested with.
        """
        return self.axis.change(self.strip_flux, now) * now.m

    def carrier(self, now: GasState, h: Expr) -> ufl.Form:
        """m, the axial velocity in the space of the pressure."""
        return (now.m - now.u[2]) * h * self.domain.dx

    def projection(self, now: GasState, h: Expr) -> ufl.Form:
        """D_h, the shear rates in the space of the unknowns."""
        return ufl.dot(now.d - self.shear_rates(now.u), h) * self.domain.dx

    def stresses(self, now: GasState, old: GasState, s: Expr, idt: Any) -> ufl.Form:
        """Transport of the Reynolds stresses; nothing diffuses through the plane."""
        k, eps, stress = self.energy(now), self.eps(now), self.stress(now)
        rate = self.velocity_gradient(now)
        source = production(stress, rate) - 2 / 3 * eps * ufl.Identity(3)
        source = source + self.transport_law.redistribution(stress, rate, k, eps, self.domain.walls)
        across = ufl.dot(ufl.grad(now.r), ufl.as_vector((now.u[0], now.u[1])))
        change = across + now.u[2] * self.axis.change(lambda state: state.r, now)
        change = change + idt * (now.r - old.r) - components(source)
        if (damping := self.damping) is not None:
            change = change + 2 * damping * now.r
        spread = self._across(self.transport_law.stress_diffusivity(stress, k, eps))
        diffusion = ufl.inner(ufl.dot(ufl.grad(now.r), spread), ufl.grad(s))
        return (ufl.dot(change, s) + diffusion) * self.domain.dx

    def dissipation(self, now: GasState, old: GasState, w: Expr, idt: Any) -> ufl.Form:
        """Transport of e = ln eps, fixed at the plane by the wall function."""
        k, eps, law = self.energy(now), self.eps(now), self.law
        work = trace(production(self.stress(now), self.velocity_gradient(now))) / 2
        source = (law.C_e1 * work - law.C_e2 * eps) / k
        change = idt * (now.e - old.e) + self.advected(lambda s: s.e, now) - source
        if self.exchange is not None and (damping := self.damping) is not None:
            change = change + 2 * self.exchange.dissipation * damping
        spread = self._eps_diffusivity(now)
        gradient = ufl.grad(now.e)
        diffusion = ufl.dot(ufl.dot(spread, gradient), ufl.grad(w) - w * gradient)
        fixed = ufl.ln(self.function.dissipation(k, self.numbers.wall_offset))
        stiff = self.numbers.wall_penalty * self.numbers.stabilisation * k**2 / eps
        wall = stiff / self.domain.wall_cell * (now.e - fixed) * w
        return (change * w + diffusion) * self.domain.dx + wall * self.domain.ds_wall

    def _eps_diffusivity(self, now: GasState) -> Expr:
        """Diffusivity of eps within the section, shape (2, 2) [m2/s]."""
        k, eps = self.energy(now), self.eps(now)
        if now.r is not None:
            return self._across(self.transport_law.eps_diffusivity(self.stress(now), k, eps))
        spread = (
            self.numbers.viscosity + self.eddy_law.eddy_viscosity(k, eps) / self.eddy_law.sigma_eps
        )
        return spread * ufl.Identity(2)

    def turbulent_energy(self, now: GasState, old: GasState, w: Expr, idt: Any) -> ufl.Form:
        """Transport of q = ln k; nothing diffuses through the plane."""
        k, eps = self.energy(now), self.eps(now)
        work = trace(production(self.stress(now), self.velocity_gradient(now))) / 2
        change = idt * (now.q - old.q) + self.advected(lambda s: s.q, now) - (work - eps) / k
        if (damping := self.damping) is not None:
            change = change + 2 * damping
        spread = (
            self.numbers.viscosity + self.eddy_law.eddy_viscosity(k, eps) / self.eddy_law.sigma_k
        )
        gradient = ufl.grad(now.q)
        diffusion = spread * ufl.dot(gradient, ufl.grad(w) - w * gradient)
        return (change * w + diffusion) * self.domain.dx

    def residual(
        self, now: GasState, old: GasState, test: GasState, idt: Any, drive: Any
    ) -> ufl.Form:
        """Sum of all balances; `idt` = 1/dt [1/s], `drive` = G/rho [m/s2]."""
        form = self.mass(now, test.p) + self.momentum(now, old, test.u, idt, drive)
        form += self.carrier(now, test.m)
        form += self.dissipation(now, old, test.e, idt)
        if now.r is None:
            return form + self.turbulent_energy(now, old, test.q, idt)
        return form + self.stresses(now, old, test.r, idt) + self.projection(now, test.d)

    @staticmethod
    def _across(t: Expr) -> Expr:
        """The part of a tensor within the section, shape (2, 2)."""
        return ufl.as_matrix([[t[0, 0], t[0, 1]], [t[1, 0], t[1, 1]]])
