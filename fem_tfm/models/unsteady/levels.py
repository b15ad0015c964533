# SPDX-License-Identifier: LGPL-3.0-or-later
"""Levels in time of a step of second order: BDF2 with steps of any size.

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

from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.state import SMALLEST_FRACTION, Feed, Moment
from fem_tfm.solvers.cells import Array

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
class Past:
    """The time before the last step, and the step.

    dt : of the last step [s]
    passed, added : volume fluxes (faces) [m3/s] and sources (cells) [1/s] of the solids in it
    gas, fed : the same of a gas whose density follows the pressure, at the density of the case
    others : as in `Moment`, before it
    """

    dt: float
    passed: Array
    added: Array
    alpha: Array
    theta: Array
    u_s: Array
    u_g: Array
    total: Array
    carried: Array
    gained: Array
    p: Array | None = None
    gas: Array | None = None
    fed: Array | None = None
    scales: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, before: Moment, dt: float, passed: Array, added: Array) -> Past:
        """What is kept of a moment when a step has left it behind."""
        names = {f.name for f in fields(cls)} - {"dt", "passed", "added", "gas", "fed"}
        return cls(dt, passed, added, **{name: getattr(before, name) for name in names})


# names in a Past besides its step; all values on faces have their direction
PAST_OF_CELLS = ("added", "alpha", "theta", "u_s", "u_g")
PAST_OF_FACES = ("passed", "total", "carried", "gained")
# and those that only a gas needs whose density follows the pressure
GAS_OF_CELLS, GAS_OF_FACES = ("p", "fed"), ("gas",)


@dataclass(frozen=True)
class Levels:
    """What a step starts from.

    now, past : state before the step, and what is known of the one before it
    ratio (cells) : of this step and the last one, 0 where the method is Euler's
    start : state from which an implicit Euler step of `span` ends where the method does
    span (owned), span_faces (faces) : its length [s]
    expected : state at the end of the step as far as it is foreseen, for coefficients
    share, kept (faces) : the solids pass `share` times their flux at the end plus `kept` [m3/s]
    given (owned) : likewise, their source is span/dt times that at the end plus `given` [1/s]
    trust (faces) : share of the acceleration of faces that is carried on
    loose (cells), linear (faces) : share of the second order, 0 where solids are nearly packed
    """

    now: Moment
    past: Past | None
    ratio: Array | float
    start: Moment
    span: Array | float
    span_faces: Array | float
    expected: Moment
    share: Array
    kept: Array
    given: Array
    trust: Array
    loose: Array
    linear: Array

    def grown(self, now: Array, before: Array) -> Array:
        """A positive quantity at the end of the step from its values now and before."""
        return now * _rise(now, before) ** self.ratio


def euler(line: Line, now: Moment, dt: float, limit: float = 0.0) -> Levels:
    """Levels of an implicit Euler step.

    limit : packing limit of the solids, 0 for an upwind step
    """
    cells = line.cells
    zero, one = (np.broadcast_to(value, cells.faces) for value in (0.0, 1.0))
    given, loose, linear = (
        np.broadcast_to(0.0, cells.owned),
        np.broadcast_to(0.0, cells.count),
        zero,
    )
    if line.order and limit > 0:
        loose = _loose(now.alpha, limit)
        linear = _on_faces(line, loose)
    return Levels(now, None, 0.0, now, dt, dt, now, one, zero, given, zero, loose, linear)


def second_order(
    line: Line,
    now: Moment,
    past: Past,
    dt: float,
    limit: float,
    feed: Feed,
    gas: tuple[Array | float, Array | float] = (1.0, 1.0),
) -> Levels:
    """Levels of a step of second order, of first order where the solids are packed (collective).

    limit : packing limit of the solids
    gas : relative density of the gas now and before the last step [-]
    feed : through what it closes nothing of the past passes
    """
    loose = _loose(np.maximum(now.alpha, past.alpha), limit)
    linear = _on_faces(line, loose)
    r = dt / past.dt
    weight = r / (1 + 2 * r)
    cells, faces = weight * loose, weight * linear
    if feed.blocked:
        faces[line.outlet] = 0.0
    if feed.solids_fraction * feed.solids_velocity == 0:
        faces[line.inlet] = 0.0
    kept = _kept(line, now, faces * past.passed, dt, limit)
    moving = np.where(past.passed == 0, 1.0, past.passed)
    share = 1 - np.where(past.passed == 0, faces, kept / moving)
    slow, fluxes = SLOW * line.speed, SLOW * line.speed * line.cells.size
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
        carried=now.carried + faces * r * (now.carried - past.carried),
        scales={
            name: _start(now.scales[name], rises[name], weights[name] * cells * r) for name in rises
        },
    )
    there = (loose * r)[:, None]
    ahead = now.alpha + loose * r * (now.alpha - past.alpha)
    expected = replace(
        now,
        alpha=np.clip(ahead, now.alpha / 2, (now.alpha + limit) / 2),
        theta=now.theta * rise ** (loose * r),
        u_s=_carry_on(now.u_s, past.u_s, there, slow),
        u_g=_carry_on(now.u_g, past.u_g, there, slow),
        total=_carry_on(now.total, past.total, linear * r, fluxes),
        carried=_carry_on(now.carried, past.carried, linear * r, fluxes),
        scales={
            name: now.scales[name] * rises[name] ** (_slowness(now, name, dt) * loose * r)
            for name in rises
        },
    )
    span, span_faces = dt * (1 - cells[line.own]), dt * (1 - faces)
    return Levels(
        now=now,
        past=past,
        ratio=loose * r,
        start=start,
        span=span,
        span_faces=span_faces,
        expected=expected,
        share=share,
        kept=kept,
        given=(cells * past.added)[line.own],
        trust=linear * _steadiness(span_faces * now.gained, now.carried, fluxes),
        loose=loose,
        linear=linear,
    )


def _loose(alpha: Array, limit: float) -> Array:
    """1 where grains have room to move, 0 where they are nearly packed."""
    low, high = (share * limit for share in PACKING)
    return np.clip((high - alpha) / (high - low), 0.0, 1.0)


def _on_faces(line: Line, values: Array) -> Array:
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


def _slowness(now: Moment, scale: str, dt: float) -> Array:
    """1 where eddies last longer than a step, to second order; 0 where they turn over within it.

    What follows others at once must not be carried on: it would take turns with them.
    """
    phase = "_s" if scale.endswith("_s") else ""
    turned = TURNS * dt * now.scales[f"eps{phase}"] / now.scales[f"k{phase}"]
    return 1 / (1 + np.square(turned))


def _kept(line: Line, now: Moment, flux: Array, dt: float, limit: float) -> Array:
    """What has passed before, without what would take a cell too close to a bound."""
    rate = MOST_OF_ROOM * line.volume / dt
    alpha = now.alpha[line.own]
    return line.cells.within(flux, rate * np.maximum(alpha, 0.0), rate * (limit - alpha))


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
