# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time levels of a step: implicit Euler, and BDF2 on uneven steps.

With r = dt/dt_before, BDF2 reads

    y = y_start + span f(y),  span = (1 + r)/(1 + 2 r) dt,  y_start = y_0 + c (y_0 - y_before),
    c = r^2/(1 + 2 r)

which is an implicit Euler step of length `span` from `y_start`. The mean flux of such a step, by
which a fraction changes, is a mean of the flux at its end and of the mean flux of the last step,

    step_flux = (1 + r)/(1 + 2 r) flux + r/(1 + 2 r) step_flux_before

so that mass is conserved exactly, whatever share of the last step each face takes. That share falls
to zero, and the method to implicit Euler, where the solids are nearly packed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from fem_tfm.models.finite_volume.cells.limiter import limit_flux
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    Density,
    Inflow,
    SolidsDeformation,
    SolidsTransport,
    State,
    TurbulenceCoefficients,
)

# between these shares of the packing limit the method falls to first order: in a bed the solids
# pressure changes by its own size in a step
PACKING = 0.8, 0.9
# largest share of the way to a bound of the solids fraction that the last step's flux may take
MOST_OF_ROOM = 0.5
# largest factor from one step to the next of a fraction, and of other positive quantities
LARGEST_RATIO, LARGEST_GROWTH = 1.5, 2.0
# scales of eddies that turn over once in this many steps are extrapolated by half
TURNS = 3.0
# velocity below which a change counts as small, over U
SLOW = 0.1


@dataclass(frozen=True)
class PreviousStep:
    """State before the last step, and the mean fluxes and sources of that step.

    dt : length of the last step [s]
    step_flux, step_source : mean volume flux (faces) [m3/s] and source (cells) [1/s] of the solids
        in the last step
    gas_step_flux, gas_step_source : those of a compressible gas, at its reference density
    others : as in `State`, before the last step
    """

    dt: float
    step_flux: Array
    step_source: Array
    alpha: Array
    theta: Array
    u_s: Array
    u_g: Array
    total_flux: Array
    solids_flux: Array
    flux_acceleration: Array
    p: Array | None = None
    gas_step_flux: Array | None = None
    gas_step_source: Array | None = None
    scales: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, before: State, dt: float, step_flux: Array, step_source: Array) -> PreviousStep:
        """What is kept of the state before a step of `dt` [s]."""
        others = {"dt", "step_flux", "step_source", "gas_step_flux", "gas_step_source"}
        names = {f.name for f in fields(cls)} - others
        return cls(dt, step_flux, step_source, **{name: getattr(before, name) for name in names})


# names in a PreviousStep besides dt; values on faces change sign with their direction
PREVIOUS_CELL_FIELDS = ("step_source", "alpha", "theta", "u_s", "u_g")
PREVIOUS_FACE_FIELDS = ("step_flux", "total_flux", "solids_flux", "flux_acceleration")
# and those of a compressible gas alone
PREVIOUS_GAS_CELL_FIELDS, PREVIOUS_GAS_FACE_FIELDS = ("p", "gas_step_source"), ("gas_step_flux",)


@dataclass(frozen=True)
class TimeLevels:
    """Levels from which a step starts and at which its coefficients are taken.

    now, previous : present state, and what is kept of the one before it (None: an Euler step)
    ratio (cells) : r times the share of the second order, 0 for an Euler step
    start : state from which an implicit Euler step of length `span` ends where the method does
    span (owned), span_faces (faces) : that length [s]
    predicted : state extrapolated to the end of the step, for the coefficients
    flux_weight, previous_flux (faces) : the mean flux of the solids in the step is `flux_weight`
        times the flux at its end plus `previous_flux` [m3/s]
    previous_source (owned) : their mean source is span/dt times that at the end plus this [1/s]
    acceleration_share (faces) : share of the faces' acceleration that is extrapolated
    second_order (cells), second_order_faces : share of the second order, 0 where the solids are
        nearly packed
    """

    now: State
    previous: PreviousStep | None
    ratio: Array | float
    start: State
    span: Array | float
    span_faces: Array | float
    predicted: State
    flux_weight: Array
    previous_flux: Array
    previous_source: Array
    acceleration_share: Array
    second_order: Array
    second_order_faces: Array

    def extrapolate(self, now: Array, before: Array) -> Array:
        """A positive quantity at the end of the step, from its present and previous values."""
        return now * _growth(now, before) ** self.ratio


def implicit_euler(
    line: LineMesh, now: State, dt: float, packing_limit: float | None = None
) -> TimeLevels:
    """Levels of an implicit Euler step.

    packing_limit : of the solids, below which values in space are of second order; None for
        upwind values
    """
    cells = line.cells
    zero, one = (np.broadcast_to(value, cells.face_count) for value in (0.0, 1.0))
    share, share_faces = np.broadcast_to(0.0, cells.count), zero
    if packing_limit is not None:
        share = _second_order_share(now.alpha, packing_limit)
        share_faces = _smaller_of_sides(line, share)
    return TimeLevels(
        now=now,
        previous=None,
        ratio=0.0,
        start=now,
        span=dt,
        span_faces=dt,
        predicted=now,
        flux_weight=one,
        previous_flux=zero,
        previous_source=np.broadcast_to(0.0, cells.owned),
        acceleration_share=zero,
        second_order=share,
        second_order_faces=share_faces,
    )


def bdf2(
    line: LineMesh,
    now: State,
    previous: PreviousStep,
    dt: float,
    packing_limit: float,
    inflow: Inflow,
    gas_density: tuple[Array | float, Array | float] = (1.0, 1.0),
) -> TimeLevels:
    """Levels of a BDF2 step, which is one of Euler where the solids are packed (collective).

    packing_limit : of the solids
    inflow : boundaries that it closes take no share of the last step
    gas_density : relative density of the gas in the present and in the previous state [-]
    """
    r = dt / previous.dt
    share = _second_order_share(np.maximum(now.alpha, previous.alpha), packing_limit)
    share_faces = _smaller_of_sides(line, share)
    weight, weight_faces = (r / (1 + 2 * r) * part for part in (share, share_faces))
    if inflow.blocked:
        weight_faces[line.outlet] = 0.0
    if inflow.solids_fraction * inflow.solids_velocity == 0:
        weight_faces[line.inlet] = 0.0
    flux_weight, previous_flux = _flux_weights(line, now, previous, weight_faces, dt, packing_limit)
    span_faces = dt * (1 - weight_faces)
    small = SLOW * line.velocity_scale * line.cells.face_area
    steady = _steadiness(span_faces * now.flux_acceleration, now.solids_flux, small)
    return TimeLevels(
        now=now,
        previous=previous,
        ratio=share * r,
        start=_start_level(now, previous, r, weight, weight_faces, gas_density),
        span=dt * (1 - weight[line.own]),
        span_faces=span_faces,
        predicted=_predicted(line, now, previous, share, share_faces, dt, packing_limit),
        flux_weight=flux_weight,
        previous_flux=previous_flux,
        previous_source=(weight * previous.step_source)[line.own],
        acceleration_share=share_faces * steady,
        second_order=share,
        second_order_faces=share_faces,
    )


def _start_level(
    now: State,
    previous: PreviousStep,
    r: float,
    weight: Array,
    weight_faces: Array,
    gas_density: tuple[Array | float, Array | float],
) -> State:
    """y_0 + c (y_0 - y_before), c = r weight; what a phase carries is weighted by its mass."""
    solids = _mass_ratio(now.alpha, previous.alpha, weight * r) * weight * r
    before, after = (1 - previous.alpha) * gas_density[1], (1 - now.alpha) * gas_density[0]
    gas = _mass_ratio(after, before, weight * r) * weight * r
    scales = {
        name: _start_of_positive(
            value, _growth(value, previous.scales[name]), solids if name.endswith("_s") else gas
        )
        for name, value in now.scales.items()
    }
    return replace(
        now,
        theta=_start_of_positive(now.theta, _growth(now.theta, previous.theta), solids),
        u_s=now.u_s + solids[:, None] * (now.u_s - previous.u_s),
        u_g=now.u_g + gas[:, None] * (now.u_g - previous.u_g),
        solids_flux=now.solids_flux + weight_faces * r * (now.solids_flux - previous.solids_flux),
        scales=scales,
    )


def _predicted(
    line: LineMesh,
    now: State,
    previous: PreviousStep,
    share: Array,
    share_faces: Array,
    dt: float,
    packing_limit: float,
) -> State:
    """The state extrapolated to the end of the step, fractions and positive values within bounds.

    share (cells), share_faces (faces) : of the second order
    """
    r = dt / previous.dt
    there, there_faces = share * r, share_faces * r
    slow = SLOW * line.velocity_scale
    small_flux = slow * line.cells.face_area
    alpha = now.alpha + there * (now.alpha - previous.alpha)
    scales = {
        name: value
        * _growth(value, previous.scales[name]) ** (_slowness(now, name, dt) * share * r)
        for name, value in now.scales.items()
    }
    return replace(
        now,
        alpha=np.clip(alpha, now.alpha / 2, (now.alpha + packing_limit) / 2),
        theta=now.theta * _growth(now.theta, previous.theta) ** there,
        u_s=_extrapolated(now.u_s, previous.u_s, there[:, None], slow),
        u_g=_extrapolated(now.u_g, previous.u_g, there[:, None], slow),
        total_flux=_extrapolated(now.total_flux, previous.total_flux, there_faces, small_flux),
        solids_flux=_extrapolated(now.solids_flux, previous.solids_flux, there_faces, small_flux),
        scales=scales,
    )


def _flux_weights(
    line: LineMesh,
    now: State,
    previous: PreviousStep,
    weight: Array,
    dt: float,
    packing_limit: float,
) -> tuple[Array, Array]:
    """Weight of the flux at the end of the step, and the share of the last step's flux [m3/s].

    The latter is limited so that no cell comes too close to a bound by it.
    """
    rate, alpha = MOST_OF_ROOM * line.volume / dt, now.alpha[line.own]
    loss, gain = rate * np.maximum(alpha, 0.0), rate * (packing_limit - alpha)
    kept = limit_flux(line.cells, weight * previous.step_flux, loss, gain)
    still = previous.step_flux == 0
    moving = np.where(still, 1.0, previous.step_flux)
    return 1 - np.where(still, weight, kept / moving), kept


def _second_order_share(alpha: Array, packing_limit: float) -> Array:
    """1 where the solids have room to move, 0 where they are nearly packed."""
    low, high = (share * packing_limit for share in PACKING)
    return np.clip((high - alpha) / (high - low), 0.0, 1.0)


def _smaller_of_sides(line: LineMesh, values: Array) -> Array:
    """The smaller of the values in the two cells of each face."""
    cells = line.cells
    found = values[cells.first]
    found[line.inner] = np.minimum(found[line.inner], values[cells.second])
    return found


def _growth(now: Array, before: Array) -> Array:
    """Factor by which a positive quantity has grown, within limits."""
    with np.errstate(over="ignore"):
        grown = now / np.maximum(before, 1e-300)
    return np.clip(grown, 1 / LARGEST_GROWTH, LARGEST_GROWTH)


def _start_of_positive(now: Array, growth: Array, c: Array) -> Array:
    """y_0 + c (y_0 - y_before) of a positive quantity from its growth, within limits."""
    return now * np.clip(1 + c * (1 - 1 / growth), 1 / LARGEST_GROWTH, LARGEST_GROWTH)


def _slowness(now: State, scale: str, dt: float) -> Array:
    """1 where eddies outlive the step, to second order; 0 where they turn over within it.

    Scales of fast eddies follow the flow at once. Extrapolated, the two would alternate.
    """
    phase = "_s" if scale.endswith("_s") else ""
    turned = TURNS * dt * now.scales[f"eps{phase}"] / now.scales[f"k{phase}"]
    return 1 / (1 + np.square(turned))


def _mass_ratio(now: Array, before: Array, c: Array) -> Array:
    """Fraction in the previous state over that of the start level, within limits."""
    before, now = (np.maximum(x, SMALLEST_FRACTION) for x in (before, now))
    start = np.maximum(now + c * (now - before), before / LARGEST_RATIO)
    return before / start


def _steadiness(change: Array, now: Array, small: Array | float) -> Array:
    """1 for changes small beside the value or `small`, to fourth order; 0 for jumps."""
    if now.ndim > 1:
        change, now = (np.linalg.norm(x, axis=1)[:, None] for x in (change, now))
    return 1 / (1 + (np.square(change) / (np.square(now) + np.square(small))) ** 2)


def _extrapolated(now: Array, before: Array, r: Array | float, small: Array | float) -> Array:
    """Extrapolation by r times the last change, which leaves jumps out."""
    change = r * (now - before)
    return now + _steadiness(change, now, small) * change


@dataclass(frozen=True)
class GasBalance:
    """Mass balance of the gas in a step, as volumes at the reference density.

    density : for the momentum equation
    relative_density : predicted for the end of the step, in all cells [-]
    solids_flux (faces) : volume flux of the solids that makes their mean flux in the step [m3/s]
    flux_weight, previous_flux (faces) : the mean flux of the gas in the step is `flux_weight` times
        its volume flux plus `previous_flux` [m3/s]
    compressibility (owned) : growth of the mass in the step per change of pressure [m3/s/Pa]
    mass_growth (owned) : growth at the present pressure [m3/s]
    source (owned) : mean source in the step [1/s]
    """

    line: LineMesh
    density: Density
    relative_density: Array
    solids_flux: Array
    flux_weight: Array
    previous_flux: Array
    compressibility: Array
    mass_growth: Array
    source: Array

    def step_flux(self, total_flux: Array) -> Array:
        """Mean flux of the gas in the step at a total flux of both phases [m3/s]."""
        return self.flux_weight * (total_flux - self.solids_flux) + self.previous_flux

    def residual(self, total_flux: Array, change: Array | float = 0.0) -> Array:
        """Imbalance of the owned cells [m3/s].

        change (owned) : of the pressure [Pa]
        """
        growth = self.mass_growth + self.compressibility * change
        outflow = self.line.cells.net_flux(self.step_flux(total_flux))
        return growth + outflow - self.source * self.line.volume

    def close(self, total_flux: Array, change: Array) -> tuple[Array, Array]:
        """Flux and pressure change that conserve the mass of the line exactly (collective).

        The remainder of the linear solver leaves through the outlet; without an outlet it raises
        the pressure.
        """
        cells, outlet = self.line.cells, self.line.outlet
        left = cells.total(self.residual(total_flux, change[self.line.own]))
        if not self.line.has_outlet:
            return total_flux, change - left / cells.total(self.compressibility)
        size = cells.face_area[outlet]
        total_flux[outlet] -= left * size / (cells.total(size) * self.flux_weight[outlet])
        return total_flux, change


@dataclass(frozen=True)
class Step:
    """A time step as far as its equations are solved; each equation adds its result.

    levels, dt, inflow : levels in time, length [s], boundary values and sources
    state : state at which coefficients are taken: predicted, then solved, equation by equation
    beta : drag coefficient of the state, in all cells, zero without solids [kg/m3/s]
    drag : that of the momentum equations, with its growth; zero before Theta is solved [kg/m3/s]
    explicit_drag : force on the gas in excess of -beta (u_g - u_s) (cells, 3), opposite on the
        solids [N/m3]; None without
    deformation, solids : of the solids, and the result of their fraction; None without solids
    turbulence : its coefficients, None where the gas has an algebraic law alone
    gas : mass balance of a compressible gas, else None
    iterations : of each equation solved
    """

    levels: TimeLevels
    dt: float
    inflow: Inflow
    state: State
    beta: Array
    drag: Array
    explicit_drag: Array | None = None
    deformation: SolidsDeformation | None = None
    solids: SolidsTransport | None = None
    turbulence: TurbulenceCoefficients | None = None
    gas: GasBalance | None = None
    iterations: Mapping[str, int] = field(default_factory=dict)

    def after(self, equation: str, iterations: int, **found: Any) -> Self:
        """The step with the result of an equation and the iterations that it took."""
        return replace(self, iterations={**self.iterations, equation: iterations}, **found)
