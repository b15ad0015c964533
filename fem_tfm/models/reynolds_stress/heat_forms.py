# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weak forms of the temperature and the turbulent heat fluxes of a given turbulent flow.

    u.grad T = div(a grad T - q)
    u.grad q_i = d_k (C_T k/eps R_kj d_j q_i) + P_i + Phi_i,   q_i = <theta u_i>

The equations are linear in T and q. T is relative to the wall. As with the velocity, the conduction
that q hides is put in and taken out again with the projected gradient m of T (EVSS)::

    + a_s (grad T - m).grad w,   a_s = C k^2/eps

The section carries heat with a velocity whose divergence is exactly that of the axial flow, and the
strip at the wall takes part, so that what walls give is what the gas takes, to round-off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import ufl
from ufl.core.expr import Expr

from fem_tfm.closures.turbulence.heat_flux import Gradient, HeatFlux, Launder
from fem_tfm.closures.walls.functions import ThermalWall
from fem_tfm.models.reynolds_stress.forms import GasState, ReynoldsStressForms


@dataclass(frozen=True)
class HeatState:
    """T above a reference [K], its fluxes q [K m/s] and its projected gradient m [K/m].

    q and m are None where the fluxes follow the gradient; wall is the temperature of the wall above
    the same reference [K].
    """

    wall: Any
    t: Expr
    q: Any = None
    m: Any = None


class Proportional:
    """Temperature that changes along the axis as a given one: d/dz of T and q are given fields."""

    def __init__(self, given: HeatState) -> None:
        self.given = given

    def change(self, quantity: Callable[[Any], Expr], state: tuple[GasState, HeatState]) -> Expr:
        """d/dz of a quantity of flow and heat that is linear in the heat."""
        return quantity((state[0], self.given))


@dataclass(eq=False)
class HeatModel:
    """Heat in a given flow.

    Parameters
    ----------
    law : turbulent heat fluxes
    wall : wall function of the temperature
    prandtl : of the gas [-]
    gas : model of the flow
    flow : its state
    across : velocity in the section that carries heat, shape (2,) [m/s]
    axis : d/dz of quantities of flow and heat
    """

    law: HeatFlux
    wall: ThermalWall
    prandtl: Any
    gas: ReynoldsStressForms
    flow: GasState
    across: Expr
    axis: Any

    @property
    def diffusivity(self) -> Expr:
        """a = nu/Pr [m2/s]."""
        return self.gas.numbers.viscosity / self.prandtl

    def _wall(self, quantity: Callable[..., Expr], flow: GasState) -> Expr:
        numbers, k = self.gas.numbers, self.gas.energy(flow)
        place = numbers.wall_offset, numbers.viscosity
        return quantity(self.gas.function, k, *place, self.prandtl)

    def loss(self, state: HeatState) -> Expr:
        """Flux into the wall over rho c_p [K m/s]."""
        return self._wall(self.wall.conductance, self.flow) * (state.t - state.wall)

    def strip_heat(self, state: tuple[GasState, HeatState]) -> Expr:
        """Heat flow of the strip at the wall per width over rho c_p [K m2/s]."""
        flow, heat = state
        share = self._wall(self.wall.strip, flow) * flow.u[2]
        return share * (heat.t - heat.wall) + self._strip(flow) * heat.wall

    def _strip(self, flow: GasState) -> Expr:
        return self.gas.strip_flux(flow)

    def residual(self, now: HeatState, test: HeatState) -> ufl.Form:
        """All balances."""
        gas, flow, state = self.gas, self.flow, (self.flow, now)
        gradient = ufl.grad(now.t)
        # u.grad T = div(u T) - T div u, with the axial part of both differenced as it is
        along = self.axis.change(lambda s: s[0].u[2] * s[1].t, state)
        along -= now.t * gas.axis.change(lambda s: s.u[2], flow)
        strip = self.axis.change(self.strip_heat, state)
        strip -= now.t * gas.axis.change(self._strip, flow)
        flux = self.diffusivity * gradient - self._turbulent(now)
        change = ufl.dot(self.across, gradient) + along
        if gas.exchange is not None and gas.exchange.heat is not None:
            change -= gas.exchange.warming(now.t)
        form = (change * test.t + ufl.dot(flux, ufl.grad(test.t))) * gas.domain.dx
        form += (self.loss(now) + strip) * test.t * gas.domain.ds_wall
        return form if now.q is None else form + self._fluxes(now, test)

    def _turbulent(self, now: HeatState) -> Expr:
        """The turbulent flux in the section [K m/s]."""
        if now.q is not None:
            return ufl.as_vector((now.q[0], now.q[1]))
        assert isinstance(self.law, Gradient)
        return -self.law.diffusivity(self._eddy_viscosity()) * ufl.grad(now.t)

    def _eddy_viscosity(self) -> Expr:
        """nu_t [m2/s] of the flow, by its law's or by the stabilisation's constant."""
        k, eps = self.gas.energy(self.flow), self.gas.eps(self.flow)
        if self.flow.r is None:
            return self.gas.eddy_law.eddy_viscosity(k, eps)
        return self.gas.numbers.stabilisation * k**2 / eps

    def _fluxes(self, now: HeatState, test: HeatState) -> ufl.Form:
        """Transport of q, and the conduction that is put in and taken out again."""
        gas, flow, law, state = self.gas, self.flow, self.law, (self.flow, now)
        assert isinstance(law, Launder)
        k, eps, stress = gas.energy(flow), gas.eps(flow), gas.stress(flow)
        rates, gradient = gas.velocity_gradient(flow), ufl.grad(now.t)
        along = self.axis.change(lambda s: s[1].t, state)
        full = ufl.as_vector((gradient[0], gradient[1], along))
        source = law.production(now.q, stress, rates, full)
        source += law.redistribution(now.q, rates, k, eps, gas.reflections(flow))
        change = ufl.dot(ufl.grad(now.q), self.across)
        change += flow.u[2] * self.axis.change(lambda s: s[1].q, state) - source
        spread = law.diffusivity(stress, k, eps)
        spread = ufl.as_matrix([[spread[i, j] for j in (0, 1)] for i in (0, 1)])
        diffusion = ufl.inner(ufl.dot(ufl.grad(now.q), spread), ufl.grad(test.q))
        hidden = self._eddy_viscosity() * ufl.dot(gradient - now.m, ufl.grad(test.t))
        projection = ufl.dot(now.m - gradient, test.m)
        return (ufl.dot(change, test.q) + diffusion + hidden + projection) * gas.domain.dx

    def carried(self, state: HeatState) -> Any:
        """Form of the heat flow of the part solved over rho c_p, with the strip [K m3/s]."""
        domain = self.gas.domain
        inside = self.flow.u[2] * state.t * domain.dx
        return inside + self.strip_heat((self.flow, state)) * domain.ds_wall

    def lost(self, state: HeatState) -> Any:
        """Form of the heat into the wall per length over rho c_p [K m2/s]."""
        return self.loss(state) * self.gas.domain.ds_wall
