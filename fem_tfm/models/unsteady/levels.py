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

from dataclasses import dataclass, fields, replace

import numpy as np

from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.state import SMALLEST_FRACTION, Moment
from fem_tfm.solvers.cells import Array

# share of the way to a bound of the solids fraction that what has passed before may take
MOST_OF_ROOM = 0.5
# largest factor from one step to the next of a fraction and of the granular temperature
LARGEST_RATIO, LARGEST_RISE = 1.5, 2.0
# speed below which a change is not compared with the speed itself, over U
SLOW = 0.1


@dataclass(frozen=True)
class Past:
    """The time before the last step, and the step.

    dt : of the last step [s]
    passed, added : volume fluxes (faces) [m3/s] and sources (cells) [1/s] of the solids in it
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

    @classmethod
    def of(cls, before: Moment, dt: float, passed: Array, added: Array) -> Past:
        """What is kept of a moment when a step has left it behind."""
        names = {f.name for f in fields(cls)} - {"dt", "passed", "added"}
        return cls(dt, passed, added, **{name: getattr(before, name) for name in names})


# names in a Past besides its step; all values on faces have their direction
PAST_OF_CELLS = ("added", "alpha", "theta", "u_s", "u_g")
PAST_OF_FACES = ("passed", "total", "carried", "gained")


@dataclass(frozen=True)
class Levels:
    """What a step starts from.

    now, past : state before the step, and what is known of the one before it
    ratio : of this step and the last one
    start : state from which an implicit Euler step of `span` [s] ends where the method does
    expected : state at the end of the step as far as it is foreseen, for coefficients
    share, kept (faces) : the solids pass `share` times their flux at the end plus `kept` [m3/s]
    given (owned) : likewise, their source is span/dt times that at the end plus `given` [1/s]
    trust (faces) : share of the acceleration of faces that is carried on
    """

    now: Moment
    past: Past | None
    ratio: float
    span: float
    start: Moment
    expected: Moment
    share: Array
    kept: Array
    given: Array
    trust: Array

    def grown(self, now: Array, before: Array) -> Array:
        """A positive quantity at the end of the step from its values now and before."""
        rise = np.clip(now / np.maximum(before, 1e-300), 1 / LARGEST_RISE, LARGEST_RISE)
        return now * rise**self.ratio


def euler(line: Line, now: Moment, dt: float) -> Levels:
    """Levels of an implicit Euler step."""
    zero, one = (np.broadcast_to(value, line.cells.faces) for value in (0.0, 1.0))
    return Levels(now, None, 0.0, dt, now, now, one, zero, np.broadcast_to(0.0, line.cells.owned), zero)


def second_order(line: Line, now: Moment, past: Past, dt: float, limit: float) -> Levels:
    """Levels of a step of second order (collective).

    limit : packing limit of the solids, which what has passed before may not overfill
    """
    r = dt / past.dt
    weight, c = r / (1 + 2 * r), r**2 / (1 + 2 * r)
    kept = _kept(line, now, weight * past.passed, dt, limit)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1 - weight * np.where(past.passed == 0, 1.0, kept / (weight * past.passed))
    rise = np.clip(now.theta / past.theta, 1 / LARGEST_RISE, LARGEST_RISE)
    slow, fluxes = SLOW * line.speed, SLOW * line.speed * line.cells.size
    fractions = ((now.alpha, past.alpha), (1 - now.alpha, 1 - past.alpha))
    solids, gas = (c * _ratio(*pair, c)[:, None] for pair in fractions)
    start = replace(
        now,
        theta=now.theta * rise ** (c * _ratio(*fractions[0], c)),
        u_s=now.u_s + solids * (now.u_s - past.u_s),
        u_g=now.u_g + gas * (now.u_g - past.u_g),
        carried=now.carried + c * (now.carried - past.carried),
    )
    expected = replace(
        now,
        theta=now.theta * rise**r,
        u_s=_carry_on(now.u_s, past.u_s, r, slow),
        u_g=_carry_on(now.u_g, past.u_g, r, slow),
        total=_carry_on(now.total, past.total, r, fluxes),
        carried=_carry_on(now.carried, past.carried, r, fluxes),
    )
    span = dt - weight * dt
    trust = _steadiness(span * now.gained, now.carried, fluxes)
    given = weight * past.added[line.own]
    return Levels(now, past, r, span, start, expected, share, kept, given, trust)


def _kept(line: Line, now: Moment, flux: Array, dt: float, limit: float) -> Array:
    """What has passed before, without what would take a cell too close to a bound."""
    rate = MOST_OF_ROOM * line.volume / dt
    alpha = now.alpha[line.own]
    return line.cells.within(flux, rate * np.maximum(alpha, 0.0), rate * (limit - alpha))


def _ratio(now: Array, before: Array, c: float) -> Array:
    """Fraction before the last step over that of `start`, by which phases weigh their past."""
    before, now = (np.maximum(x, SMALLEST_FRACTION) for x in (before, now))
    start = np.maximum(now + c * (now - before), before / LARGEST_RATIO)
    return before / start


def _steadiness(change: Array, now: Array, small: Array | float) -> Array:
    """1 for changes that are small beside the value or `small`, to fourth order; 0 for jumps."""
    if now.ndim > 1:
        change, now = (np.linalg.norm(x, axis=1)[:, None] for x in (change, now))
    return 1 / (1 + (np.square(change) / (np.square(now) + np.square(small))) ** 2)


def _carry_on(now: Array, before: Array, r: float, small: Array | float) -> Array:
    """Extrapolation by r times the last change, which a jump does not take part in."""
    change = r * (now - before)
    return now + _steadiness(change, now, small) * change
