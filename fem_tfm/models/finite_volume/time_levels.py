# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time levels of a step of second order: BDF2 with steps of any size.

With r = dt/dt_before the method reads

    y = y_start + span f(y),  span = (1 + r)/(1 + 2 r) dt,  y_start = y_0 + c (y_0 - y_before),
    c = r^2/(1 + 2 r)

which is a step of the implicit Euler method of the length `span`. In the fluxes that have changed a
fraction it is a mean of the flux at the end of the step and of what passed in the step before,

    passed = (1 + r)/(1 + 2 r) flux + r/(1 + 2 r) passed_before

so that mass stays exact whatever share of its past each face takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from fem_tfm.models.finite_volume.cells.limiter import limit_flux
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, Inflow, State

# solids between these shares of their packing go over to first order: in a bed the pressure of the
# solids changes by its own size in a step
PACKING = 0.8, 0.9
# share of the way to a bound of the solids fraction that what has passed before may take
MOST_OF_ROOM = 0.5
# largest factor from one step to the next of a fraction and of the granular temperature
LARGEST_RATIO, LARGEST_RISE = 1.5, 2.0
# eddies that turn over once in this many steps are carried on by half
TURNS = 3.0
# speed below which a change is not compared with the speed itself, over U
SLOW = 0.1


@dataclass(frozen=True)
class PreviousStep:
    """The time before the last step, and the step.

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
        """What is kept of a moment when a step has left it behind."""
        others = {"dt", "step_flux", "step_source", "gas_step_flux", "gas_step_source"}
        names = {f.name for f in fields(cls)} - others
        return cls(dt, step_flux, step_source, **{name: getattr(before, name) for name in names})


# names in a PreviousStep besides its step; all values on faces have their direction
PREVIOUS_CELL_FIELDS = ("step_source", "alpha", "theta", "u_s", "u_g")
PREVIOUS_FACE_FIELDS = ("step_flux", "total_flux", "solids_flux", "flux_acceleration")
# and those that only a gas needs whose density follows the pressure
PREVIOUS_GAS_CELL_FIELDS, PREVIOUS_GAS_FACE_FIELDS = ("p", "gas_step_source"), ("gas_step_flux",)


@dataclass(frozen=True)
class TimeLevels:
    """What a step starts from.

    now, previous : state before the step, and what is known of the one before it
    ratio (cells) : of this step and the last one, 0 where the method is Euler's
    start : state from which an implicit Euler step of `span` ends where the method does
    span (owned), span_faces (faces) : its length [s]
    predicted : state at the end of the step as far as it is foreseen, for coefficients
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
        """A positive quantity at the end of the step from its values now and before."""
        return now * _rise(now, before) ** self.ratio


def implicit_euler(line: LineMesh, now: State, dt: float, limit: float = 0.0) -> TimeLevels:
    """Levels of an implicit Euler step.

    limit : packing limit of the solids, 0 for an upwind step
    """
    cells = line.cells
    zero, one = (np.broadcast_to(value, cells.face_count) for value in (0.0, 1.0))
    given, loose, linear = (
        np.broadcast_to(0.0, cells.owned),
        np.broadcast_to(0.0, cells.count),
        zero,
    )
    if line.order and limit > 0:
        loose = _loose(now.alpha, limit)
        linear = _on_faces(line, loose)
    return TimeLevels(now, None, 0.0, now, dt, dt, now, one, zero, given, zero, loose, linear)


def bdf2(
    line: LineMesh,
    now: State,
    past: PreviousStep,
    dt: float,
    limit: float,
    inflow: Inflow,
    gas: tuple[Array | float, Array | float] = (1.0, 1.0),
) -> TimeLevels:
    """Levels of a step of second order, of first order where the solids are packed (collective).

    limit : packing limit of the solids
    gas : relative density of the gas now and before the last step [-]
    inflow : through what it closes nothing of the past passes
    """
    loose = _loose(np.maximum(now.alpha, past.alpha), limit)
    linear = _on_faces(line, loose)
    r = dt / past.dt
    weight = r / (1 + 2 * r)
    cells, faces = weight * loose, weight * linear
    if inflow.blocked:
        faces[line.outlet] = 0.0
    if inflow.solids_fraction * inflow.solids_velocity == 0:
        faces[line.inlet] = 0.0
    kept = _kept(line, now, faces * past.step_flux, dt, limit)
    moving = np.where(past.step_flux == 0, 1.0, past.step_flux)
    share = 1 - np.where(past.step_flux == 0, faces, kept / moving)
    slow, fluxes = SLOW * line.velocity_scale, SLOW * line.velocity_scale * line.cells.face_area
    of_solids = _ratio(now.alpha, past.alpha, cells * r)
    of_gas = _ratio((1 - now.alpha) * gas[0], (1 - past.alpha) * gas[1], cells * r)
    rise = _rise(now.theta, past.theta)
    rises = {name: _rise(value, past.scales[name]) for name, value in now.scales.items()}
    weights = {name: of_solids if name.endswith("_s") else of_gas for name in rises}
    start = replace(
        now,
        theta=_start(now.theta, rise, of_solids * cells * r),
        u_s=now.u_s + (of_solids * cells * r)[:, None] * (now.u_s - past.u_s),
        u_g=now.u_g + (of_gas * cells * r)[:, None] * (now.u_g - past.u_g),
        solids_flux=now.solids_flux + faces * r * (now.solids_flux - past.solids_flux),
        scales={
            name: _start(now.scales[name], rises[name], weights[name] * cells * r) for name in rises
        },
    )
    there = (loose * r)[:, None]
    ahead = now.alpha + loose * r * (now.alpha - past.alpha)
    predicted = replace(
        now,
        alpha=np.clip(ahead, now.alpha / 2, (now.alpha + limit) / 2),
        theta=now.theta * rise ** (loose * r),
        u_s=_carry_on(now.u_s, past.u_s, there, slow),
        u_g=_carry_on(now.u_g, past.u_g, there, slow),
        total_flux=_carry_on(now.total_flux, past.total_flux, linear * r, fluxes),
        solids_flux=_carry_on(now.solids_flux, past.solids_flux, linear * r, fluxes),
        scales={
            name: now.scales[name] * rises[name] ** (_slowness(now, name, dt) * loose * r)
            for name in rises
        },
    )
    span, span_faces = dt * (1 - cells[line.own]), dt * (1 - faces)
    return TimeLevels(
        now=now,
        previous=past,
        ratio=loose * r,
        start=start,
        span=span,
        span_faces=span_faces,
        predicted=predicted,
        flux_weight=share,
        previous_flux=kept,
        previous_source=(cells * past.step_source)[line.own],
        acceleration_share=linear
        * _steadiness(span_faces * now.flux_acceleration, now.solids_flux, fluxes),
        second_order=loose,
        second_order_faces=linear,
    )


def _loose(alpha: Array, limit: float) -> Array:
    """1 where grains have room to move, 0 where they are nearly packed."""
    low, high = (share * limit for share in PACKING)
    return np.clip((high - alpha) / (high - low), 0.0, 1.0)


def _on_faces(line: LineMesh, values: Array) -> Array:
    """The smaller value of the two sides of each face."""
    cells = line.cells
    found = values[cells.first]
    found[line.inner] = np.minimum(found[line.inner], values[cells.second])
    return found


def _rise(now: Array, before: Array) -> Array:
    """Factor by which a positive quantity has grown, within limits."""
    return np.clip(now / np.maximum(before, 1e-300), 1 / LARGEST_RISE, LARGEST_RISE)


def _start(now: Array, rise: Array, c: Array) -> Array:
    """y_0 + c (y_0 - y_before) of a positive quantity that has grown by a factor, within limits."""
    return now * np.clip(1 + c * (1 - 1 / rise), 1 / LARGEST_RISE, LARGEST_RISE)


def _slowness(now: State, scale: str, dt: float) -> Array:
    """1 where eddies last longer than a step, to second order; 0 where they turn over within it.

    What follows others at once must not be carried on: it would take turns with them.
    """
    phase = "_s" if scale.endswith("_s") else ""
    turned = TURNS * dt * now.scales[f"eps{phase}"] / now.scales[f"k{phase}"]
    return 1 / (1 + np.square(turned))


def _kept(line: LineMesh, now: State, flux: Array, dt: float, limit: float) -> Array:
    """What has passed before, without what would take a cell too close to a bound."""
    rate = MOST_OF_ROOM * line.volume / dt
    alpha = now.alpha[line.own]
    return limit_flux(line.cells, flux, rate * np.maximum(alpha, 0.0), rate * (limit - alpha))


def _ratio(now: Array, before: Array, c: Array) -> Array:
    """Fraction before the last step over that of `start`, by which phases weigh their past."""
    before, now = (np.maximum(x, SMALLEST_FRACTION) for x in (before, now))
    start = np.maximum(now + c * (now - before), before / LARGEST_RATIO)
    return before / start


def _steadiness(change: Array, now: Array, small: Array | float) -> Array:
    """1 for changes that are small beside the value or `small`, to fourth order; 0 for jumps."""
    if now.ndim > 1:
        change, now = (np.linalg.norm(x, axis=1)[:, None] for x in (change, now))
    return 1 / (1 + (np.square(change) / (np.square(now) + np.square(small))) ** 2)


def _carry_on(now: Array, before: Array, r: Array | float, small: Array | float) -> Array:
    """Extrapolation by r times the last change, which a jump does not take part in."""
    change = r * (now - before)
    return now + _steadiness(change, now, small) * change
