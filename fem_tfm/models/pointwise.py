# SPDX-License-Identifier: LGPL-3.0-or-later
"""Both phases at a point: every coefficient of the balances from invariants and scalars.

The weak forms give UFL expressions and the finite volumes give numpy arrays over cells; both call
the same methods, with the same regularisation. Nothing here knows a mesh, a form or a time step.

Symbols: a = alpha_s, L = grad u [1/s], S = dev(sym(L)), W = skew(L), D = div u [1/s], Theta
granular temperature [m2/s2], beta drag coefficient [kg/m3/s], U mean speed of the gas [m/s].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import ufl

from fem_tfm.closures.drag import Drag
from fem_tfm.closures.free_path import FreePath
from fem_tfm.closures.friction import Friction
from fem_tfm.closures.granular import Granular, Kinetic, algebraic_theta
from fem_tfm.closures.ops import Value, is_expr, maximum, minimum, sqrt
from fem_tfm.closures.radial import Radial
from fem_tfm.closures.slip_production import SlipProduction
from fem_tfm.closures.turbulence.dispersed import Dispersed, GasEddies, Grains
from fem_tfm.closures.turbulence.dispersion import Dispersion
from fem_tfm.closures.turbulence.gas import Balance, Eddies, Turbulence, realizable_slope
from fem_tfm.closures.walls.gas import GasWall, GasWallState, LogLaw
from fem_tfm.closures.walls.mixture import shared_friction
from fem_tfm.closures.walls.solids import SolidsWall, WallState
from fem_tfm.materials import Fluid, Solids

# scales of the regularisation: U, U/D, U^2, rho_s U D
SLIP_FLOOR, SHEAR_FLOOR, K_FLOOR, MAX_VISCOSITY = 1e-4, 1e-3, 2.5e-4, 100.0
# void_fraction of the finite volumes. Below 1e-4 grains in a void conduct and rub so well that beds
# swept by gas need steps below 1e-9 s. The weak forms bound voids by their diffusion of alpha_s and
# take none: 1e-4 changes the gradient of the dense pipe by 5e-9 of it, but a settled bed of the
# random cases, with alpha_s = 3e-5 above it, is not found from a cold start any more
VOID_FRACTION = 1e-4
# packing_pressure of the finite volumes over rho_s U^2: grains that neither friction nor a granular
# temperature holds apart pack to within about 1e-5 of the limit. Without it they pack to where the
# residual of the fraction's equation takes them beyond. The weak forms know the gap to packing with
# all its digits and need none
PACKING_PRESSURE = 1e-10
# uv over k in equilibrium, sqrt(C_mu), and the least k of a law without it over k_floor
STRESS_SHARE, LEAST_K = 0.3, 1e-3
# difference of the slip speed, over itself, for the slope of the drag
SLIP_STEP = 1e-3


class ClosureSet(Protocol):
    """One closure of each family.

    `theta` is "transport" or "algebraic", `pressure_force` "full" or "alpha".
    """

    @property
    def drag(self) -> Drag: ...
    @property
    def radial(self) -> Radial: ...
    @property
    def granular(self) -> Granular: ...
    @property
    def friction(self) -> Friction: ...
    @property
    def turbulence(self) -> Turbulence: ...
    @property
    def gas_wall(self) -> GasWall: ...
    @property
    def solids_wall(self) -> SolidsWall: ...
    @property
    def dispersed(self) -> Dispersed: ...
    @property
    def dispersion(self) -> Dispersion: ...
    @property
    def theta(self) -> str: ...
    @property
    def friction_feeds_theta(self) -> bool: ...
    @property
    def pressure_force(self) -> str: ...
    @property
    def slip_production(self) -> SlipProduction: ...
    @property
    def free_path(self) -> FreePath: ...


@dataclass(frozen=True, kw_only=True)
class Regularisation:
    """Small numbers that keep the laws at a point finite, the same for every way of solving.

    theta_floor : smallest granular temperature [m2/s2]
    slip_floor : added in quadrature to the speed between phases and along walls [m/s]
    shear_floor : added in quadrature to the shear rate sqrt(2 S:S) that eddies see [1/s]
    k_floor : turbulent energy that grains leave to the gas [m2/s2]
    max_frictional_viscosity : cap of mu_f [Pa s]
    void_fraction : a_0 of the factor a^2/(a^2 + a_0^2) on the kinetic viscosity and conductivity,
        which laws keep finite in a void, 0 for none [-]
    grain_gap : height over which the drag fades to the wall [m], 0 for none
    packing_pressure : P of the pressure P [a/(a_max - a)]^2 that all laws have [Pa], 0 for none
    """

    theta_floor: Any
    slip_floor: Any
    shear_floor: Any
    k_floor: Any
    max_frictional_viscosity: Any
    void_fraction: Any = 0.0
    grain_gap: Any = 0.0
    packing_pressure: Any = 0.0

    @classmethod
    def scaled(
        cls,
        speed: float,
        width: float,
        solids: Solids | None,
        theta_floor: float,
        grain_gap: float = 0.0,
        **others: Any,
    ) -> Self:
        """Values by the scales of a problem.

        speed, width : U [m/s] and hydraulic diameter D [m]
        theta_floor : smallest granular temperature [m2/s2]
        grain_gap : height over which the drag fades to the wall [m]
        others : further fields
        """
        density = solids.density if solids else 0.0
        return cls(
            theta_floor=theta_floor,
            slip_floor=SLIP_FLOOR * speed,
            shear_floor=SHEAR_FLOOR * speed / width,
            k_floor=K_FLOOR * speed**2,
            max_frictional_viscosity=MAX_VISCOSITY * density * speed * width,
            grain_gap=grain_gap,
            **others,
        )

    def bound(self, wrap: Callable[[float], Any]) -> Self:
        """The same values wrapped, so that a change recompiles nothing."""
        return replace(self, **{f.name: wrap(getattr(self, f.name)) for f in fields(self)})


# -- kinematics --------------------------------------------------------------------------------


def dot(a: Value, b: Value) -> Value:
    """a.b of UFL vectors, or of arrays (cells, 3)."""
    return ufl.inner(a, b) if is_expr(a, b) else np.einsum("ni,ni->n", a, b)


def tangential(velocity: Value, normal: Value) -> Value:
    """u - (u.n) n, the velocity along a wall at rest [m/s]."""
    across = dot(velocity, normal)
    return velocity - (across if is_expr(across) else across[:, None]) * normal


class Invariants:
    """Invariants of the gradient of a velocity.

    Parameters
    ----------
    gradient : L as a UFL tensor (3, 3), or as an array (cells, 3, 3) [1/s]
    """

    def __init__(self, gradient: Value) -> None:
        if is_expr(gradient):
            self._parts: Any = [gradient[i, j] for i in range(3) for j in range(3)]
        else:
            # one array for each component, which is several times as fast as one of tensors
            self._parts = np.ascontiguousarray(gradient.reshape(-1, 9).T)
        d = self._parts
        third = (d[0] + d[4] + d[8]) / 3
        self._normal = [d[i] - third for i in (0, 4, 8)]
        self._shear = [(d[i] + d[j]) / 2 for i, j in ((1, 3), (2, 6), (5, 7))]

    @property
    def square(self) -> Value:
        """S:S [1/s2]."""
        (xx, yy, zz), (xy, xz, yz) = self._normal, self._shear
        return xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)

    @property
    def cubic(self) -> Value:
        """S_ij S_jk S_ki = 3 det S, since S has no trace [1/s3]."""
        (xx, yy, zz), (xy, xz, yz) = self._normal, self._shear
        det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        return 3 * det

    @property
    def spin(self) -> Value:
        """W:W [1/s2]."""
        d = self._parts
        return ((d[1] - d[3]) ** 2 + (d[2] - d[6]) ** 2 + (d[5] - d[7]) ** 2) / 2


# -- what the laws say at a point --------------------------------------------------------------


@dataclass(frozen=True)
class LocalGas:
    """Gas whose density differs from cell to cell.

    density : [kg/m3]
    viscosity : [Pa s]
    """

    density: Any
    viscosity: Any


@dataclass(frozen=True)
class SolidsCoefficients:
    """Coefficients of the stress and the granular energy of the solids.

    g0 : radial distribution [-]
    kinetic : of the kinetic theory
    p_f, mu_f : frictional pressure [Pa] and viscosity [Pa s]
    """

    g0: Any
    kinetic: Kinetic
    p_f: Any
    mu_f: Any

    @property
    def pressure(self) -> Value:
        """p_s = p_kinetic + p_f [Pa]."""
        return self.kinetic.pressure + self.p_f

    @property
    def viscosity(self) -> Value:
        """mu_kinetic + mu_f [Pa s]."""
        return self.kinetic.shear_viscosity + self.mu_f


class GranularEnergy(NamedTuple):
    """Sources of 3/2 a rho_s Theta: production - compression - decay Theta.

    production : work of the viscous stress, and of the slip but for its fall with Theta [W/m3]
    compression : p D [W/m3]
    decay : gamma/Theta + 3 beta, and the fall of the production by slip with Theta [kg/m3/s]
    """

    production: Any
    compression: Any
    decay: Any


def _filled(value: Value, like: Value) -> Value:
    """A number as an array where `like` is one; a law without a term gives 0."""
    if isinstance(like, np.ndarray) and np.shape(value) != like.shape:
        return np.full_like(like, value)
    return value


@dataclass
class Pointwise:
    """Materials, closures and regularisation of a problem, evaluated at points.

    Parameters
    ----------
    gas, solids : material properties; `solids` is None for the gas alone
    closures : one closure of each family
    regularisation : floors and fades
    diameter : hydraulic diameter [m]
    """

    gas: Fluid
    solids: Solids | None
    closures: ClosureSet
    regularisation: Regularisation
    diameter: Any

    @property
    def grain(self) -> Solids:
        """The solids, for the methods that only a flow with solids calls."""
        assert self.solids is not None
        return self.solids

    def with_density(self, relative: Value) -> Self:
        """The same where the gas has `relative` times its density [-]."""
        return replace(self, gas=LocalGas(relative * self.gas.density, self.gas.viscosity))

    def at(self, which: Any) -> Self:
        """The same in some of the cells."""
        if not isinstance(self.gas, LocalGas):
            return self
        return replace(self, gas=replace(self.gas, density=self.gas.density[which]))

    # -- solids --------------------------------------------------------------------------------

    def kinetic(
        self, alpha: Value, theta: Value, beta: Value, gap: Value | None = None
    ) -> tuple[Value, Kinetic]:
        """g0 and the coefficients of the kinetic theory, faded in voids.

        beta : drag coefficient [kg/m3/s], which limits the mean free path
        gap : 1 - a/a_max [-], where it is known to more digits than a has
        """
        g0 = self.closures.radial.g0(alpha, self.grain, gap)
        theory, law = self.closures.granular, self.closures.free_path
        found = law.coefficients(theory, alpha, theta, g0, beta, self.grain, self.diameter)
        square = alpha * alpha
        # by the square of a: less diffuses through a void than moves there, for fewer iterations
        fade = square / (square + self.regularisation.void_fraction**2)
        return g0, found._replace(
            shear_viscosity=fade * found.shear_viscosity, conductivity=fade * found.conductivity
        )

    def coefficients(
        self,
        alpha: Value,
        theta: Value,
        square: Value,
        dilation: Value,
        beta: Value,
        gap: Value | None = None,
    ) -> SolidsCoefficients:
        """Coefficients of kinetic theory and friction at S:S [1/s2] and D [1/s].

        beta, gap : as for `kinetic`
        """
        g0, kinetic = self.kinetic(alpha, theta, beta, gap)
        friction = self.closures.friction.stress(alpha, theta, square, dilation, self.grain)
        cap = self.regularisation.max_frictional_viscosity
        p_f, mu_f = (_filled(value, alpha) for value in friction)
        return SolidsCoefficients(g0, kinetic, p_f, minimum(mu_f, cap))

    def solids_pressure(self, alpha: Value, theta: Value, square: Value, dilation: Value) -> Value:
        """p_s of kinetic theory, friction and the barrier to packing, and nothing else [Pa]."""
        g0 = self.closures.radial.g0(alpha, self.grain)
        kinetic = self.closures.granular.pressure(alpha, theta, g0, self.grain)
        friction = self.closures.friction.stress(alpha, theta, square, dilation, self.grain)
        odds = alpha / (self.grain.packing_limit - alpha)
        barrier = self.regularisation.packing_pressure * odds * odds
        return kinetic + friction.pressure + barrier

    @property
    def feels_theta(self) -> bool:
        """Whether (dp/dTheta) grad(Theta) of the kinetic pressure exerts a force."""
        return self.closures.pressure_force == "full"

    def pressure_per_theta(self, alpha: Value, theta: Value) -> Value:
        """dp/dTheta = p/Theta of the kinetic pressure, which is linear in Theta [kg/m3]."""
        g0 = self.closures.radial.g0(alpha, self.grain)
        return self.closures.granular.pressure(alpha, theta, g0, self.grain) / theta

    def granular_energy(
        self,
        at: SolidsCoefficients,
        alpha: Value,
        theta: Value,
        square: Value,
        dilation: Value,
        beta: Value,
        slip: Value,
    ) -> GranularEnergy:
        """Sources of the granular energy; frictional work counts if the closures want it.

        slip : u_g - u_s, a UFL vector or an array (cells, 3) [m/s]

        The production by slip is linear in Theta, P - dP/dTheta (Theta_new - Theta): with all of it
        in the source Theta would alternate from step to step.
        """
        k, law = at.kinetic, self.closures.slip_production
        viscosity = at.viscosity if self.closures.friction_feeds_theta else k.shear_viscosity
        found = GranularEnergy(
            production=2 * viscosity * square + k.bulk_viscosity * dilation**2,
            compression=k.pressure * dilation,
            decay=k.dissipation / theta + 3 * beta,
        )
        if law.absent:
            return found
        power, fall = law.production(alpha, theta, beta, dot(slip, slip), self.grain)
        return found._replace(
            production=found.production + power + fall * theta, decay=found.decay + fall
        )

    def algebraic_theta(
        self, alpha: Value, g0: Value, square: Value, beta: Value, expansion: Value = 0.0
    ) -> Value:
        """Theta where production equals dissipation and drag, above the floor [m2/s2].

        It is without -p D of a compression, which voids exaggerate and which would feed Theta
        without bound.

        expansion : max(D, 0) [1/s], whose work p D Theta loses
        """
        granular, solids = self.closures.granular, self.grain
        rates = alpha, g0, square, expansion
        found = algebraic_theta(*rates, granular, solids, self.diameter, beta)
        return found + self.regularisation.theta_floor

    @property
    def free_fraction(self) -> Any:
        """alpha_s of a mean free path d/(6 sqrt(2) alpha_s) as long as D [-].

        Grains that are fewer meet the wall before each other.
        """
        return self.grain.diameter / (6 * math.sqrt(2) * self.diameter)

    # -- drag ----------------------------------------------------------------------------------

    def speed(self, velocity: Value) -> Value:
        """Modulus of a slip velocity, kept off zero [m/s]."""
        return sqrt(dot(velocity, velocity) + self.regularisation.slip_floor**2)

    def specific_drag(self, alpha: Value, speed: Value, height: Value) -> Value:
        """beta/alpha_s at a slip speed [m/s] and a height above the wall [m] [kg/m3/s].

        It fades as y^2/(y^2 + gap^2) next to the wall, which the centres of grains cannot reach.
        """
        found, gap = self.closures.drag.specific(alpha, speed, self.gas, self.grain), self._gap
        return found if gap is None else found * (height**2 / (height**2 + gap**2))

    @property
    def _gap(self) -> Value | None:
        gap = self.regularisation.grain_gap
        return gap if is_expr(gap) or gap else None

    def drag(self, alpha: Value, speed: Value, height: Value) -> Value:
        """beta [kg/m3/s]."""
        return alpha * self.specific_drag(alpha, speed, height)

    def drag_and_growth(self, alpha: Value, speed: Value, height: Value) -> tuple[Value, Value]:
        """beta and its growth with the slip, |u| d(beta)/d|u| >= 0 [kg/m3/s]."""
        beyond = (1 + SLIP_STEP) * speed
        if is_expr(alpha, speed):
            beta, risen = (self.drag(alpha, u, height) for u in (speed, beyond))
        else:
            # at both speeds at once, which share what the fraction makes
            both = self.drag(alpha, np.stack([speed, beyond]), height)
            beta, risen = np.broadcast_to(both, (2, *alpha.shape))
        return beta, maximum((risen - beta) / SLIP_STEP, 0.0)

    # -- turbulence ----------------------------------------------------------------------------

    def eddies(
        self,
        invariants: Invariants,
        height: Value,
        slope: Value = 1.0,
        k: Value | None = None,
        eps: Value | None = None,
    ) -> Eddies:
        """What a law of turbulence sees of a phase by the invariants of its velocity gradient.

        height, slope : y' [m] of the profile that the point carries, and dy'/dy
        k, eps : turbulent energy [m2/s2] and dissipation [m2/s3] where they are transported
        """
        square = invariants.square + self.regularisation.shear_floor**2 / 2
        found = Eddies(sqrt(2 * square) / slope, height, self.gas, self.diameter / 2)
        if k is None:
            return found
        return replace(
            found,
            spin=sqrt(square + invariants.spin) / slope,
            A_s=realizable_slope(math.sqrt(6) * invariants.cubic / square**1.5),
            k=k,
            eps=eps,
        )

    def gas_viscosity(self, eddies: Eddies, slope: Value) -> Value:
        """mu_g + mu_t of the profile over its stretching dy'/dy [Pa s]."""
        return (self.gas.viscosity + self.closures.turbulence.viscosity(eddies)) / slope

    def gas_eddies(self, eddies: Eddies) -> GasEddies:
        """Gas turbulence as the grains meet it.

        A law without k has that of the local equilibrium, k = nu_t S/0.3.
        """
        density, floor = eddies.gas.density, self.regularisation.k_floor
        nu_t, k = self.closures.turbulence.viscosity(eddies) / density, eddies.k
        if k is None:
            k = nu_t * eddies.strain / STRESS_SHARE + LEAST_K * floor
        return GasEddies(k, eddies.eps, nu_t, density, floor)

    def laden(self, eddies: Eddies, alpha: Value, speed: Value, height: Value) -> Eddies:
        """Eddies that carry the mass of the grains which follow them.

            nu_e = mu_g/rho_e in their Reynolds numbers,  rho_e = rho_g (1 + Z s)

        s is that of the eddies without it. speed, height : as for `grains`
        """
        if self.solids is None or not self.closures.dispersed.follows:
            return eddies
        gas, grains = self.gas_eddies(eddies), self._carried(alpha, speed, height)
        density = eddies.gas.density
        heavier = 1 + grains.loading(density) * self.closures.dispersed.share(gas, grains)
        return replace(eddies, gas=LocalGas(density, eddies.gas.viscosity / heavier))

    def _carried(self, alpha: Value, speed: Value, height: Value) -> Grains:
        """Grains as far as a law needs them whose grains follow the eddies."""
        specific = self.specific_drag(alpha, speed, height)
        return Grains(alpha, None, None, specific, speed, None, self.grain)

    def solids_eddy_viscosity(self, gas: GasEddies, grains: Grains, slope: Value) -> Value:
        """nu_s [m2/s]; of the profile over its stretching dy'/dy where the grains share it."""
        law = self.closures.dispersed
        found = law.viscosity(gas, grains)
        return found / slope if law.follows else found

    def grains(
        self,
        alpha: Value,
        theta: Value,
        g0: Value,
        viscosity: Value,
        speed: Value,
        height: Value,
        drift: Value,
        eddies: Eddies | None,
    ) -> Grains:
        """What a law of dispersed turbulence sees of the solids.

        viscosity : kinetic [Pa s]
        speed, height : slip speed [m/s], height above the wall [m]
        drift : (u_s - u_g).grad(alpha_s)/alpha_s [1/s]
        eddies : of the solids where their turbulence is transported
        """
        return Grains(
            alpha=alpha,
            theta=theta,
            g0=g0,
            specific=self.specific_drag(alpha, speed, height),
            slip=speed,
            drift=drift,
            solids=self.grain,
            viscosity=viscosity / (alpha * self.grain.density),
            eddies=eddies,
        )

    def gas_balances(
        self, eddies: Eddies, gas: GasEddies | None = None, grains: Grains | None = None
    ) -> dict[str, Balance]:
        """Transport of the logarithms of the gas's turbulence, with what grains give to it."""
        law = self.closures.dispersed
        gain = 0.0 if gas is None or grains is None or not law.needs_k else law.gain(gas, grains)
        return self.closures.turbulence.balances(eddies, gain)

    def eddy_pressure(self, k: Value) -> Value:
        """Normal stress 2/3 k of the eddies over a rho, times its share [m2/s2]."""
        return self.closures.dispersed.normal_stress * 2 / 3 * k

    def dispersion(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """c of the force c grad(alpha_s) by which eddies spread the solids, on the gas [Pa]."""
        spread = self.closures.dispersion.diffusivity(gas, grains, nu_s)
        return grains.specific * spread / (1 - grains.alpha)

    # -- walls ---------------------------------------------------------------------------------

    def wall_state(
        self, alpha: Value, theta: Value, at: SolidsCoefficients, velocity: Value, cells: Any = ...
    ) -> WallState:
        """What the wall law of the solids sees.

        velocity : along the wall [m/s]
        cells : indices of the cells at the faces of the wall, where the others are arrays
        """
        seen = (alpha, theta, at.g0, at.p_f)
        if isinstance(alpha, np.ndarray):
            seen = tuple(values[cells] for values in seen)
        return WallState(*seen, self.speed(velocity))

    def solids_wall_friction(self, state: WallState) -> Value:
        """c [Pa s/m] of the traction -c u_t of a wall on the solids."""
        return _filled(self.closures.solids_wall.friction(state, self.grain), state.slip)

    def solids_wall_heat(self, state: WallState) -> Value:
        """Flux from a wall into the granular energy [W/m2]."""
        return _filled(self.closures.solids_wall.heat(state, self.grain), state.slip)

    def gas_wall_friction(self, speed: Value, height: Value, k: Value | None = None) -> Value:
        """c [Pa s/m] of the traction -c u_t of a wall on pure gas of a speed at a height [m]."""
        state = GasWallState(speed, height, self.gas, k)
        return _filled(self.closures.gas_wall.coefficient(state), speed)

    def wall_friction(
        self,
        speed: Value,
        height: Value,
        k: Value | None = None,
        beside: tuple[Value, Value] | None = None,
    ) -> tuple[Value, Value]:
        """c [Pa s/m] of a wall on pure gas, and of the eddies on all of the solids.

        beside : solids fraction, and slip speed between the phases [m/s], at that height
        """
        alone, law = self.gas_wall_friction(speed, height, k), self.closures.gas_wall
        if self.solids is None or beside is None or not isinstance(law, LogLaw):
            return alone, 0.0
        grains = self._carried(*beside, height)
        followers = self.closures.dispersed.at_wall(self.gas.density, grains)
        if followers is None:
            return alone, 0.0
        state = GasWallState(speed, height, self.gas, k)
        found, shared = shared_friction(alone, state, law, followers)
        return found, grains.alpha * self.grain.density / self.gas.density * shared
