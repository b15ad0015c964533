# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weak forms of the two-fluid model.

Balances (physics of dense gas-solid flow; every solids viscosity is that of the whole phase)::

    d(a_i rho_i)/dt + div(a_i rho_i u_i) = 0,  a_g + a_s = 1
    d(a_i rho_i u_i)/dt + div(a_i rho_i u_i u_i)
        = -a_i grad p + div sigma_i +- beta (u_g - u_s) + a_i rho_i g
    3/2 [d(a rho_s Theta)/dt + div(a rho_s u_s Theta)]
        = sigma_kin : grad u_s + div(kappa grad Theta) - gamma - 3 beta Theta

Unknowns are u_s, u_g (three components), p, q = logit(alpha_s/alpha_max) and the fluctuation speed
c of the grains, Theta = theta_floor + c^2, so that 0 < alpha_s < alpha_max and Theta > 0 hold by
construction. p is the pressure without the
weight of the gas: P = p + rho_g g.x - G z, so the solids feel alpha_s (rho_s - rho_g) g. Momentum
is conservative: tested with a constant it says that the walls carry G times the area to the
accuracy of the solver.

All terms are on the left-hand side. Forms know neither a mesh nor a solver: states and tests are
UFL expressions, which is also how the manufactured solutions are made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import ufl
from ufl.core.expr import Expr

from fem_tfm.closures.turbulence.dispersed import GasEddies, Grains
from fem_tfm.closures.turbulence.gas import Balance, Eddies
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.axis import Axis
from fem_tfm.models.pointwise import (
    ClosureSet,
    GranularEnergy,
    Invariants,
    Pointwise,
    Regularisation,
    SolidsCoefficients,
    tangential,
)


@dataclass(frozen=True, kw_only=True)
class Stabilisation(Regularisation):
    """Regularisation of the laws at a point, and what the finite elements need beside it.

    alpha_diffusion : diffusion of logit(alpha_s) [m2/s], which conserves mass: alpha_s diffuses by
        alpha_diffusion/[alpha_s (1 - alpha_s/alpha_max)], so that voids stay bounded
    capture : C of a further diffusion C h^2 |div(alpha_s u_s)| of logit(alpha_s) [-]; it is there
        where the mesh of cells h fails to carry a front, and vanishes with h^4
    damping : C of a viscosity C h^2 |grad u_perp| of the secondary flow [-]; it bounds the Reynolds
        number of a cell where the phase itself has next to no viscosity, and vanishes with h^2
    smallest_front_rate, smallest_rate : added in quadrature to the rates of both [1/s]
    wall_penalty : factor of the weak condition u.n = 0 [-]
    wall_speed : speed of the inertial share of that condition [m/s]
    pressure_shift : compressibility that fixes the mean of p at zero [m s/kg]
    relaxation : time in which an algebraic Theta follows during pseudo-time [s]
    residual_fraction : solids fraction below which the drag falls no further [-]
    theta_free : largest algebraic Theta of grains that meet the wall before each other [m2/s2]
    smoothing : length over which an algebraic c is smoothed [m]; it stands for the conduction
        that the algebraic balance lacks, without which voids and shear-free lines
        make Theta as rough as the mesh
    """

    alpha_diffusion: Any
    capture: Any
    damping: Any
    smallest_front_rate: Any
    smallest_rate: Any
    wall_penalty: Any
    wall_speed: Any
    pressure_shift: Any
    relaxation: Any
    residual_fraction: Any
    theta_free: Any
    smoothing: Any


@dataclass(frozen=True)
class State:
    """Unknowns as UFL expressions; the gas alone has u_s = q = c = None.

    ln_k, ln_eps of the gas and ln_k_s, ln_eps_s of the solids exist where a law transports them.
    """

    u_g: Expr
    p: Expr
    u_s: Any = None
    q: Any = None
    c: Any = None
    ln_k: Any = None
    ln_eps: Any = None
    ln_k_s: Any = None
    ln_eps_s: Any = None


@dataclass(frozen=True)
class Lag:
    """A state whose rates the terms of the mesh may take in place of those of the unknowns.

    These rates are absolute values, whose kinks stop Newton where a velocity changes its sign from
    node to node. A rate that is held through a step makes the step smooth; the steady state is the
    same.

    share : of the square of each rate that is held, 0 or 1
    state : that is held
    """

    share: Any
    state: State


@dataclass(frozen=True)
class Domain:
    """What the forms need of the geometry.

    dx, ds_wall : measures of the section and of its wall
    normal : outward normal, three components
    wall_distance : distance to the wall-law plane's origin [m], a UFL expression
    wall_offset : distance y_p at which the gas wall law holds [m]
    diameter : hydraulic diameter [m]
    wall_cell : height of the cell at a wall facet [m]
    cell_area : h^2, twice the area of a triangle and the area of a quadrilateral [m2]
    """

    dx: ufl.Measure
    ds_wall: ufl.Measure
    normal: Expr
    wall_distance: Expr
    wall_offset: Any
    diameter: Any
    wall_cell: Expr
    cell_area: Expr


@dataclass(frozen=True, kw_only=True)
class Solid(SolidsCoefficients):
    """The solids at one state: coefficients, and UFL expressions in SI units.

    alpha, theta : solids fraction [-], granular temperature [m2/s2]
    rate, strain, dilation : L, S and D [1/s]
    square : S:S [1/s2]
    mu_t : eddy viscosity of the phase [Pa s]
    """

    alpha: Expr
    theta: Expr
    rate: Expr
    strain: Expr
    dilation: Expr
    square: Expr
    mu_t: Expr | float = 0.0

    @property
    def viscosity(self) -> Expr:
        """mu_s = mu_kinetic + mu_f + mu_t [Pa s]."""
        return super().viscosity + self.mu_t

    def stress(self) -> Expr:
        """sigma_s = (-p_s + lambda_s D) I + 2 mu_s S [Pa]."""
        bulk = -self.pressure + self.kinetic.bulk_viscosity * self.dilation
        return bulk * ufl.Identity(3) + 2 * self.viscosity * self.strain


# unit vector downstream
AXIAL = ufl.as_vector((0.0, 0.0, 1.0))


def bounded(square: Expr, least: Any) -> Expr:
    """Root of the square of a rate, kept off zero where its slope is infinite [1/s]."""
    return ufl.sqrt(square + least**2)


def over_speed(source: Expr, c: Expr, theta: Expr) -> Expr:
    """A source P of granular energy over the fluctuation speed, [P] s/m.

    P/sqrt(Theta) of a gain, P c/Theta of a loss: what pushes c up, and what pulls it to zero.
    """
    return ufl.conditional(ufl.gt(source, 0), source / ufl.sqrt(theta), source * c / theta)


def deviatoric_strain(rate: Expr) -> Expr:
    """S = dev(sym(grad u)), shape (3, 3) [1/s]."""
    return ufl.sym(rate) - ufl.tr(rate) / 3 * ufl.Identity(3)


@dataclass(eq=False)
class TwoFluidForms:
    """Weak forms of gas and solids, or of the gas alone when `solids` is None.

    Parameters
    ----------
    gas, solids : material properties (SI); `solids` None leaves the solids out of every form
    closures : one closure of each family
    gravity : vector of length 3 [m/s2]
    numerics : regularisation and stabilisation
    axis : the axial derivative
    domain : measures, normal and distances
    lag : where the rates of the mesh's terms may come from a state that is held
    """

    gas: Gas
    solids: Solids | None
    closures: ClosureSet
    gravity: Any
    numerics: Stabilisation
    axis: Axis
    domain: Domain
    lag: Lag | None = None

    def __post_init__(self) -> None:
        width = self.domain.diameter
        self.at_point = Pointwise(self.gas, self.solids, self.closures, self.numerics, width)

    # -- pointwise quantities ------------------------------------------------------------------

    def alpha(self, state: State) -> Expr:
        """alpha_s = alpha_max/(1 + exp(-q)) [-]."""
        if self.solids is None:
            return ufl.as_ufl(0.0)
        return self.solids.packing_limit / (1 + ufl.exp(-state.q))

    def gap(self, state: State) -> Expr:
        """1 - alpha_s/alpha_max = 1/(1 + exp(q)), with all its digits at packing [-]."""
        return 1 / (1 + ufl.exp(state.q))

    def theta(self, state: State) -> Expr:
        """Theta = theta_floor + c^2 [m2/s2]."""
        return self.numerics.theta_floor + state.c**2

    def rate(self, state: State, phase: str) -> Expr:
        """L = grad u of "u_g" or "u_s" with its axial column, shape (3, 3) [1/s]."""
        along = self.axis.change(lambda s: getattr(s, phase), state)
        return self.axis.jacobian(getattr(state, phase)) + ufl.outer(along, AXIAL)

    def strain(self, state: State, phase: str) -> Expr:
        """S of the viscous stress of a phase, without the axial change of what flows across [1/s].

        A march differentiates no stress along the axis. With half of the terms that hold d/dz it
        is ill-posed: mu d/dx (du_x/dz) in the axial balance and -2/3 mu d/dx (du_z/dz) across feed
        each other, and waves shorter than about 5 mu/(a rho u) grow downstream. In dilute solids
        these are as long as the pipe is wide. One of the two is left out, as in any boundary layer.
        """
        along = self.axis.change(lambda s: getattr(s, phase)[2], state)
        rate = self.axis.jacobian(getattr(state, phase)) + along * ufl.outer(AXIAL, AXIAL)
        return deviatoric_strain(rate)

    def shear(self, state: State, phase: str) -> Invariants:
        """Gradients of a phase within the section, which feed its fluctuations.

        No stress along the axis takes work from the momentum of a march, so what changes there must
        not feed eddies and grains: over a step dz it would do so by the square of a change over dz,
        without bound as dz falls.
        """
        return Invariants(self.axis.jacobian(getattr(state, phase)))

    def solid(self, state: State) -> Solid:
        """The solids at a state."""
        alpha, gap, theta = self.alpha(state), self.gap(state), self.theta(state)
        rate = self.rate(state, "u_s")
        square, dilation = Invariants(rate).square, ufl.tr(rate)
        beta = self.drag(state)
        found = Solid(
            **vars(self.at_point.coefficients(alpha, theta, square, dilation, beta, gap)),
            alpha=alpha,
            theta=theta,
            rate=rate,
            strain=self.strain(state, "u_s"),
            dilation=dilation,
            square=square,
        )
        if self.closures.dispersed.still:
            return found
        gas, grains = self.gas_eddies(state), self.grains(state, found)
        nu_t = self.at_point.solids_eddy_viscosity(gas, grains, self.stretch()[1])
        return replace(found, mu_t=alpha * self.at_point.grain.density * nu_t)

    def slip_speed(self, state: State) -> Expr:
        """|u_g - u_s|, kept off zero [m/s]."""
        return self.at_point.speed(state.u_g - state.u_s)

    def drag(self, state: State) -> Expr:
        """Drag coefficient beta [kg/m3/s]."""
        height = self.stretch()[0]
        return self.at_point.drag(self.alpha(state), self.slip_speed(state), height)

    def exchange(self, state: State) -> Expr:
        """Drag coefficient of the balances, beta sqrt(1 + (residual_fraction/alpha_s)^2) [kg/m3/s].

        What a void lacks of the residual fraction is dragged as if it were there. The test
        functions of a void reach into the bed beside it, and what the bed leaves there drives
        grains of next to no mass to any speed.
        """
        lack = self.numerics.residual_fraction / self.alpha(state)
        return ufl.sqrt(1 + lack**2) * self.drag(state)

    def stretch(self) -> tuple[Expr, Expr]:
        """Height y' of the gas profile that a point carries [m], and dy'/dy."""
        law = self.closures.gas_wall
        return law.stretched(self.domain.wall_distance, self.domain.wall_offset)

    def eddies(self, state: State) -> Eddies:
        """What the gas's law of turbulence sees, in the coordinates of the stretched profile."""
        scales = () if state.ln_k is None else (ufl.exp(state.ln_k), ufl.exp(state.ln_eps))
        found = self.at_point.eddies(self.shear(state, "u_g"), *self.stretch(), *scales)
        if self.solids is None:
            return found
        height = self.stretch()[0]
        return self.at_point.laden(found, self.alpha(state), self.slip_speed(state), height)

    def gas_eddies(self, state: State) -> GasEddies:
        """Gas turbulence as the grains meet it."""
        return self.at_point.gas_eddies(self.eddies(state))

    def grains(self, state: State, solid: Solid) -> Grains:
        """What the laws of dispersed turbulence see of the solids."""
        # grad(alpha)/alpha of the logit
        along = self.axis.change(lambda s: s.q, state)
        logit = self.axis.gradient(state.q) + along * AXIAL
        crowding = self.gap(state) * logit
        eddies = None
        if state.ln_k_s is not None:
            scales = ufl.exp(state.ln_k_s), ufl.exp(state.ln_eps_s)
            distance = self.domain.wall_distance
            eddies = self.at_point.eddies(self.shear(state, "u_s"), distance, 1.0, *scales)
        return self.at_point.grains(
            solid.alpha,
            solid.theta,
            solid.g0,
            solid.kinetic.shear_viscosity,
            self.slip_speed(state),
            self.stretch()[0],
            -ufl.inner(state.u_g - state.u_s, crowding),
            eddies,
        )

    def gas_viscosity(self, state: State) -> Expr:
        """mu_g,eff = mu_g + mu_t [Pa s], of the stretched profile where a wall law stretches it."""
        return self.at_point.gas_viscosity(self.eddies(state), self.stretch()[1])

    def numerical_flux(self, state: State) -> Expr:
        """Volume flux of the solids by the diffusion of q [m/s].

        -(alpha_diffusion + capture h^2 |div(alpha_s u_s)|) grad q
        """
        speed = self._mesh_rate(self._gathering, state, self.numerics.smallest_front_rate)
        capture = self.numerics.capture * self.domain.cell_area * speed
        return -(self.numerics.alpha_diffusion + capture) * self.axis.gradient(state.q)

    def grid_viscosity(self, state: State, phase: str) -> Expr:
        """Kinematic viscosity damping h^2 |grad u_perp| of the mesh for a velocity [m2/s]."""

        def square(state: State) -> Expr:
            rate = self.axis.jacobian(getattr(state, phase))
            return sum(rate[i, j] ** 2 for i in range(2) for j in range(2))

        speed = self._mesh_rate(square, state, self.numerics.smallest_rate)
        return self.numerics.damping * self.domain.cell_area * speed

    def _gathering(self, state: State) -> Expr:
        """div(alpha_s u_s)^2 [1/s2]."""
        alpha = self.alpha(state)
        rate = ufl.inner(self.axis.gradient(alpha), state.u_s)
        rate += alpha * ufl.tr(self.axis.jacobian(state.u_s))
        rate += self.axis.change(lambda s: self.alpha(s) * s.u_s[2], state)
        return rate**2

    def _mesh_rate(self, square: Callable[[State], Expr], state: State, least: Any) -> Expr:
        """Rate of a term of the mesh [1/s], whose square may come from the state that is held."""
        found = square(state)
        if self.lag is not None:
            found = (1 - self.lag.share) * found + self.lag.share * square(self.lag.state)
        return bounded(found, least)

    # -- balances ------------------------------------------------------------------------------

    def solids_mass(self, now: State, old: State, w: Expr, idt: Any, source: Any) -> ufl.Form:
        """Continuity of the solids over rho_s, with a uniform relative source [1/s]."""
        alpha = self.alpha(now)
        flux = alpha * now.u_s + self.numerical_flux(now)
        rate = idt * (alpha - self.alpha(old)) - source * alpha
        rate += self.axis.change(lambda s: self.alpha(s) * s.u_s[2], now)
        return (rate * w - ufl.inner(flux, self.axis.gradient(w))) * self.domain.dx

    def mixture_mass(self, now: State, w: Expr) -> ufl.Form:
        """div(alpha_s u_s + alpha_g u_g) = 0, with nothing through the walls."""
        flux, along = self.volume_flux(now), self.axis.change(lambda s: self.volume_flux(s)[2], now)
        shift = self.numerics.pressure_shift * now.p * w
        return -(ufl.inner(flux, self.axis.gradient(w)) - along * w + shift) * self.domain.dx

    def volume_flux(self, state: State) -> Expr:
        """alpha_s u_s + alpha_g u_g, the flux of both phases [m/s]."""
        alpha = self.alpha(state)
        gas = (1 - alpha) * state.u_g
        return gas if self.solids is None else gas + alpha * state.u_s

    def solids_momentum(self, now: State, old: State, v: Expr, idt: Any, drive: Any) -> ufl.Form:
        """Momentum of the solids, with wall friction and the weak condition u_s.n = 0."""
        rho, solid = self.at_point.grain.density, self.solid(now)
        a, a0 = solid.alpha, self.alpha(old)
        eddy = rho * a * self.grid_viscosity(now, "u_s")
        stress = solid.stress() + 2 * eddy * solid.strain
        stress -= self.eddy_pressure(now.ln_k_s, now) * rho * a * ufl.Identity(3)
        flux = a * now.u_s + self.numerical_flux(now)
        body = a * (self.axis.gradient(now.p) - (rho - self.gas.density) * self.gravity)
        along = self.axis.change(lambda s: self.alpha(s) * s.u_s[2] * s.u_s, now)
        form = (
            rho * idt * ufl.inner(a * now.u_s - a0 * old.u_s, v)
            + ufl.inner(body + rho * along, v)
            - a * drive * v[2]
            - self.exchange(now) * ufl.inner(now.u_g - now.u_s, v)
            + ufl.inner(stress - rho * ufl.outer(now.u_s, flux), self.axis.jacobian(v))
        ) * self.domain.dx
        if not self.at_point.feels_theta:
            form -= self.thermal_force(now, solid, v)
        stiffness = solid.viscosity + solid.kinetic.bulk_viscosity + eddy
        traction = self.solids_wall_traction(now)
        return form + self.wall_terms(now.u_s, v, traction, stress, stiffness, rho * a)

    def thermal_force(self, state: State, solid: Solid, v: Expr) -> ufl.Form:
        """(dp/dTheta) grad(Theta) of the kinetic pressure, tested with v.

        It acts within the section alone, as the pressure does: the axial balance still closes.
        """
        warming = solid.kinetic.pressure / solid.theta * self.axis.gradient(solid.theta)
        return ufl.inner(warming, v) * self.domain.dx

    def gas_momentum(self, now: State, old: State, v: Expr, idt: Any, drive: Any) -> ufl.Form:
        """Momentum of the gas, with its wall law and the weak condition u_g.n = 0."""
        rho, mu = self.gas.density, self.gas_viscosity(now)
        a, a0 = 1 - self.alpha(now), 1 - self.alpha(old)
        flux = a * now.u_g
        if self.solids is not None:
            flux = flux - self.numerical_flux(now)
            mu += rho * self.grid_viscosity(now, "u_g")
        stress = 2 * a * mu * self.strain(now, "u_g")
        stress -= self.eddy_pressure(now.ln_k, now) * rho * a * ufl.Identity(3)
        along = self.axis.change(lambda s: (1 - self.alpha(s)) * s.u_g[2] * s.u_g, now)
        form = (
            rho * idt * ufl.inner(a * now.u_g - a0 * old.u_g, v)
            + ufl.inner(a * self.axis.gradient(now.p) + rho * along, v)
            - a * drive * v[2]
            + ufl.inner(stress - rho * ufl.outer(now.u_g, flux), self.axis.jacobian(v))
        ) * self.domain.dx
        if self.solids is not None:
            slip = now.u_g - now.u_s
            form += self.exchange(now) * ufl.inner(slip, v) * self.domain.dx
        return form + self.wall_terms(
            now.u_g, v, a * self.gas_wall_traction(now), stress, a * mu, rho * a
        )

    def eddy_pressure(self, ln_k: Expr | None, state: State) -> Expr:
        """Share of the normal stress 2/3 k of the eddies over a rho [m2/s2]."""
        if state.ln_k_s is None:
            return ufl.as_ufl(0.0)
        return self.at_point.eddy_pressure(ufl.exp(ln_k))

    def granular_energy(self, now: State, old: State, w: Expr, idt: Any) -> ufl.Form:
        """Granular energy in c, or production = dissipation with `theta = "algebraic"`.

        With Theta = c^2, mu = mu_1 c, gamma = gamma_1 c^3 and so on the balance over c is::

            3 a rho_s (dc/dt + u_s.grad c) = (sigma_kin : grad u_s)/c - gamma/c - 3 beta c
                + 2 div(kappa grad c) + 2 (kappa/c) |grad c|^2

        Production by shear is proportional to c, so that nothing of it is singular at c = 0, where
        it pushes c up. That by slip is not: it tends to beta u^2, and to beta u^2/c here, which
        `theta_floor` alone bounds. Where Theta falls by decades within a cell the discrete c may
        dip below zero. There a gain still pushes c up, and a loss towards zero: a loss proportional
        to Theta over |c| would drive a negative c away from it without bound.
        """
        solid, c = self.solid(now), now.c
        slope, speed = self.axis.gradient(c), ufl.sqrt(solid.theta)
        if self.closures.theta == "algebraic":
            wanted = ufl.sqrt(self.algebraic_theta(now, solid))
            delay = idt * self.numerics.relaxation * (c - old.c)
            smooth = self.numerics.smoothing**2 * slope
            return (
                (c - wanted + delay) * w + ufl.inner(smooth, self.axis.gradient(w))
            ) * self.domain.dx
        energy = self.energy(now, solid)
        flux = solid.alpha * now.u_s + self.numerical_flux(now)
        carried = idt * solid.alpha * (c - old.c) + ufl.inner(flux, slope)
        carried += solid.alpha * now.u_s[2] * self.axis.change(lambda s: s.c, now)
        spread = 2 * solid.kinetic.conductivity
        gain = (energy.production + spread * ufl.inner(slope, slope)) / speed
        gain += over_speed(-energy.compression, c, solid.theta)
        heat = self.at_point.solids_wall_heat(self.wall_state(now, solid))
        return (
            (3 * self.at_point.grain.density * carried + energy.decay * c - gain) * w
            + ufl.inner(spread * slope, self.axis.gradient(w))
        ) * self.domain.dx - over_speed(heat, c, solid.theta) * w * self.domain.ds_wall

    def energy(self, state: State, solid: Solid) -> GranularEnergy:
        """Sources of the granular energy."""
        beta = self.exchange(state)
        square = self.shear(state, "u_s").square
        slip = state.u_g - state.u_s
        return self.at_point.granular_energy(
            solid, solid.alpha, solid.theta, square, solid.dilation, beta, slip
        )

    def algebraic_theta(self, state: State, solid: Solid) -> Expr:
        """Theta where production equals dissipation and drag [m2/s2].

            Theta Theta_w/(Theta + Theta_w),  Theta_w = theta_free [1 + (alpha_s/free_fraction)^2]

        The balance, which knows no wall, would make grains that meet it before each other hotter
        than any flow.
        """
        beta, square = self.exchange(state), self.shear(state, "u_s").square
        found = self.at_point.algebraic_theta(solid.alpha, solid.g0, square, beta)
        crowding = solid.alpha / self.at_point.free_fraction
        most = self.numerics.theta_free * (1 + crowding**2)
        return found * most / (found + most)

    def gas_turbulence(self, now: State, old: State, test: State, idt: Any) -> ufl.Form:
        """Transport of the logarithms of the gas's turbulence, each balance over its scale X.

        ::

            a rho (dx/dt + u.grad x) = div(a rho D grad x) + a rho D |grad x|^2 + a rho rate

        with x = ln X.
        """
        eddies = self.eddies(now)
        mass, slope = (1 - self.alpha(now)) * self.gas.density, self.stretch()[1]
        gas: GasEddies | None = None
        grains: Grains | None = None
        if self.solids is not None and self.closures.dispersed.needs_k:
            gas, grains = self.gas_eddies(now), self.grains(now, self.solid(now))
        held, form = self.closures.turbulence.wall_values(eddies), ufl.Form([])
        for name, balance in self.at_point.gas_balances(eddies, gas, grains).items():
            form += self.logarithm(name, "u_g", now, old, test, mass, balance, slope, idt)
            if name in held:
                x, w = getattr(now, name), getattr(test, name)
                stiff = mass * balance.diffusivity / (slope * self.domain.wall_cell)
                penalty = self.numerics.wall_penalty * stiff
                form += penalty * (x - held[name]) * w * self.domain.ds_wall
        return form

    def solids_turbulence(self, now: State, old: State, test: State, idt: Any) -> ufl.Form:
        """Transport of the logarithms of the solids' turbulence, in the manner of the gas's."""
        law, solid = self.closures.dispersed, self.solid(now)
        mass, form = solid.alpha * self.at_point.grain.density, ufl.Form([])
        balances = law.balances(self.gas_eddies(now), self.grains(now, solid))
        for name, balance in balances.items():
            form += self.logarithm(name, "u_s", now, old, test, mass, balance, 1.0, idt)
        return form

    def dispersion(self, now: State, v: Expr) -> Expr:
        """Turbulent dispersion tested with v, beta D (grad a/a - grad a_g/a_g).v, on the left."""
        solid = self.solid(now)
        gas, grains = self.gas_eddies(now), self.grains(now, solid)
        nu_s = self.closures.dispersed.viscosity(gas, grains)
        # alpha_s grad(alpha_s)/alpha_s of the logit
        rise = solid.alpha * self.gap(now) * self.axis.gradient(now.q)
        return self.at_point.dispersion(gas, grains, nu_s) * ufl.inner(rise, v) * self.domain.dx

    def logarithm(
        self,
        name: str,
        phase: str,
        now: State,
        old: State,
        test: State,
        mass: Expr,
        balance: Balance,
        slope: Expr,
        idt: Any,
    ) -> ufl.Form:
        """Transport of x = ln X by "u_g" or "u_s", `mass` = a rho, in stretched coordinates."""
        x, x0, w = (getattr(state, name) for state in (now, old, test))
        u, along = getattr(now, phase), self.axis.change(lambda s: getattr(s, name), now)
        grad, spread = self.axis.gradient(x), balance.diffusivity / slope
        change = idt * (x - x0) + ufl.inner(u, grad) + u[2] * along
        growth = spread * ufl.inner(grad, grad) + slope * balance.rate
        flux = mass * spread * grad
        return (
            mass * (change - growth) * w + ufl.inner(flux, self.axis.gradient(w))
        ) * self.domain.dx

    def residual(
        self, now: State, old: State, test: State, idt: Any, drive: Any, source: Any
    ) -> ufl.Form:
        """Sum of all balances; `idt` = 1/dt [1/s], `drive` = G [Pa/m], `source` [1/s]."""
        form = self.gas_momentum(now, old, test.u_g, idt, drive) + self.mixture_mass(now, test.p)
        if self.closures.turbulence.transported:
            form += self.gas_turbulence(now, old, test, idt)
        if self.solids is None:
            return form
        if self.closures.dispersion.name != "none":
            form += self.dispersion(now, test.u_s - test.u_g)
        return (
            form
            + self.solids_momentum(now, old, test.u_s, idt, drive)
            + self.solids_mass(now, old, test.q, idt, source)
            + self.granular_energy(now, old, test.c, idt)
            + self.solids_turbulence(now, old, test, idt)
        )

    # -- walls ---------------------------------------------------------------------------------

    def wall_state(self, state: State, solid: Solid) -> WallState:
        """What the solids' wall law sees."""
        slip = tangential(state.u_s, self.domain.normal)
        return self.at_point.wall_state(solid.alpha, solid.theta, solid, slip)

    def solids_wall_traction(self, state: State) -> Expr:
        """c u_t, minus the traction of the wall and of the eddies there on the solids [Pa]."""
        at_wall = self.wall_state(state, self.solid(state))
        friction = self.at_point.solids_wall_friction(at_wall)
        friction += self._eddies_at_wall(state)[1]
        return friction * tangential(state.u_s, self.domain.normal)

    def gas_wall_traction(self, state: State) -> Expr:
        """c u_t per unit of gas fraction, minus the traction of the wall on the gas [Pa]."""
        return self._eddies_at_wall(state)[0] * tangential(state.u_g, self.domain.normal)

    def _eddies_at_wall(self, state: State) -> tuple[Expr, Expr | float]:
        """c [Pa s/m] of the wall on pure gas, and of its eddies on the solids."""
        speed = self.at_point.speed(tangential(state.u_g, self.domain.normal))
        height = self.closures.gas_wall.height(self.domain.wall_offset, self.domain.diameter)
        k = None if state.ln_k is None else ufl.exp(state.ln_k)
        beside = None
        if self.solids is not None:
            beside = self.alpha(state), self.slip_speed(state)
        return self.at_point.wall_friction(speed, height, k, beside)

    def wall_terms(
        self, u: Expr, v: Expr, traction: Expr, stress: Expr, viscosity: Expr, density: Expr
    ) -> ufl.Form:
        """Traction along the wall, and u.n = 0 by an incomplete Nitsche condition."""
        n, k = self.domain.normal, self.numerics.wall_penalty
        u_n, v_n = ufl.inner(u, n), ufl.inner(v, n)
        stiff = k * (viscosity / self.domain.wall_cell + density * self.numerics.wall_speed)
        normal_stress = ufl.inner(n, stress * n)
        return (
            ufl.inner(traction, tangential(v, n)) - normal_stress * v_n + stiff * u_n * v_n
        ) * self.domain.ds_wall
