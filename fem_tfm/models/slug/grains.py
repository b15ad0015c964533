# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains as discrete elements: what they are, where they are held, and their steps.

Coordinates are those of the geometry: z along the tube at the inlet, y up, the section around the
origin. The steps run in the compiled kernel; the same input gives the same bits for any number of
threads.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from fem_tfm._kernel import grains as kernel
from fem_tfm.closures.base import law
from fem_tfm.closures.contacts import Coefficients, Contact
from fem_tfm.errors import InputError, SolverError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.parameters import Parameters, parameter

Array = npt.NDArray[np.float64]
# time steps that a collision takes at least
STEPS_PER_CONTACT = 10
# the shortest step over the longest one: finding the damping for it takes as many steps
SHORTEST = 1e-3
# contacts of a grain for which tangential damping must be stable
CONTACTS = 7
# kinds of walls in the kernel
_OPEN, _ROUND, _RECTANGULAR, _BENT = 0, 1, 2, 3


@dataclass(frozen=True)
class Grain(Parameters):
    """The grains: spheres of a density and a mean diameter, and their contacts.

    Diameters are spread evenly over mean (1 -+ spread).
    """

    density: float = parameter(MISSING, "kg/m3", "density of the particle", ge=1e-3, le=25000)
    diameter: float = parameter(MISSING, "m", "mean diameter of the particle", ge=1e-9, le=0.1)
    spread: float = parameter(0.0, "-", "half width of the diameters over their mean", ge=0, le=0.5)
    contact: Contact = law(
        "contact", "viscous-coulomb", "contact of two grains", "closures.contact"
    )
    wall: Contact | None = parameter(
        None,
        doc="contact with a wall, default that of two grains",
        key="walls.contact",
        convert=lambda spec, key: _wall(spec, key),
    )
    table: ClassVar[str] = "solids"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.wall is not None and self.wall.kind != self.contact.kind:
            words = f"the same law as between grains, {self.contact.name!r}"
            raise InputError("walls.contact", self.wall.name, words)

    @property
    def wall_contact(self) -> Contact:
        """Law of the contact with a wall."""
        return self.contact if self.wall is None else self.wall

    @property
    def mass(self) -> float:
        """Mass of a grain of the mean diameter [kg]."""
        return float(self.masses(np.array([self.diameter / 2]))[0])

    @property
    def mean_mass(self) -> float:
        """Mean mass of all grains [kg]."""
        return self.mass * (1 + self.spread**2)

    @property
    def largest_diameter(self) -> float:
        """Diameter of the largest grain [m]."""
        return self.diameter * (1 + self.spread)

    def masses(self, radius: Array) -> Array:
        """Masses of grains [kg] by their radii [m]."""
        return self.density * 4 / 3 * math.pi * radius**3

    def radii(self, count: int, random: np.random.Generator) -> Array:
        """Radii of some grains [m]."""
        if self.spread == 0:
            return np.full(count, self.diameter / 2)
        return self.diameter / 2 * (1 + self.spread * random.uniform(-1, 1, count))

    def check_step(self, time_step: float) -> None:
        """Raise InputError for a time step that cannot follow a contact."""
        small = self.diameter / 2 * (1 - self.spread)
        mass = float(self.masses(np.array([small]))[0])
        for contact, share in ((self.contact, 0.5), (self.wall_contact, 1.0)):
            limit = contact.contact_time(share * mass, share * small) / STEPS_PER_CONTACT
            if time_step < SHORTEST * limit:
                words = (
                    f"at least {SHORTEST * limit:.2g} s, for a contact takes"
                    f" {limit * STEPS_PER_CONTACT:.2g} s and {limit:.2g} s follow it well"
                )
                raise InputError("numerics.time_step", time_step, words)
            _check(time_step, limit, f"a contact's time of {limit * STEPS_PER_CONTACT:g} s")
        c = self.contact.coefficients(mass / 2, time_step)
        stiffness = c.shear_stiffness or c.stiffness
        if self.contact.kind != 2 and c.shear_damping > 0:
            damping = c.shear_damping * math.sqrt(mass / 2 * stiffness)
            _check(time_step, mass / (CONTACTS * damping), "the tangential damping of a contact")


def _wall(spec: Any, key: str) -> Contact | None:
    from fem_tfm.closures.base import make

    if spec is None:
        return None
    made = make("contact", spec, key)
    assert isinstance(made, Contact)
    return made


def _check(time_step: float, limit: float, reason: str) -> None:
    if time_step > limit:
        words = f"at most {limit:g} s for {reason}, or a softer contact (closures.contact)"
        raise InputError("numerics.time_step", time_step, words)


@dataclass(frozen=True)
class Walls:
    """Walls around grains: a section, None for free space, and closed ends at some z.

    surface : triangles (n, 3, 3) that take the place of all other walls; grains touch them from
        either side
    arc : in the axis of a round section, whose wall is then a torus between two cylinders
    """

    section: Section | None = None
    low: float | None = None
    high: float | None = None
    surface: Array | None = None
    arc: Arc | None = None

    def apply(self, core: Any) -> None:
        """Tell the kernel."""
        kind, radius, width, height = _OPEN, 0.0, 0.0, 0.0
        if isinstance(self.section, RoundSection):
            kind = _ROUND if self.arc is None else _BENT
            radius = self.section.diameter / 2
        elif isinstance(self.section, RectangularSection):
            kind = _RECTANGULAR
            width, height = self.section.width / 2, self.section.height / 2
        low, high = self.low or 0.0, self.high or 0.0
        ends = self.low is not None, self.high is not None
        core.set_walls(kind, radius, width, height, low, high, *ends)
        if (arc := self.arc) is not None:
            core.set_arc(arc.normal[:2].tolist(), arc.radius, arc.angle, arc.before)
        triangles = np.empty((0, 3, 3)) if self.surface is None else self.surface
        core.set_surface(np.ascontiguousarray(triangles, dtype=float).ravel())

    def check(self, diameter: float) -> None:
        """Raise InputError where a grain of a diameter [m] does not fit in."""
        if self.section is not None and min(self.section.size) <= diameter:
            words = f"above the largest grain's diameter, {diameter:g} m"
            raise InputError("geometry.diameter", min(self.section.size), words)


class Grains:
    """Many grains within walls.

    time_step : of the grains [s]
    gravity : vector [m/s2]
    skin : of the neighbour list over the mean diameter; it has no influence on the result
    release : height z beyond which held grains become free [m]
    threads : that share the work

    Raises InputError for a time step that cannot follow a contact and a tube narrower than a grain.
    """

    def __init__(
        self,
        grain: Grain,
        walls: Walls,
        time_step: float,
        gravity: tuple[float, float, float] = (0.0, -9.81, 0.0),
        *,
        skin: float = 0.2,
        release: float = math.inf,
        threads: int = 1,
    ) -> None:
        grain.check_step(time_step)
        walls.check(grain.largest_diameter)
        if not 0 < skin <= 2:
            raise InputError("numerics.skin", skin, "above 0 and at most 2 grain diameters")
        if threads < 1:
            raise InputError("numerics.threads", threads, "a whole number from 1")
        self.grain, self.time_step = grain, time_step
        self._core = kernel.Grains()
        mass = grain.mean_mass
        pair = grain.contact.coefficients(mass / 2, time_step)
        wall = grain.wall_contact.coefficients(mass, time_step)
        self._core.set_law(grain.contact.kind, list(pair), list(wall))
        walls.apply(self._core)
        self._core.set_motion(time_step, list(gravity), skin * grain.diameter, release)
        self._core.threads = threads
        self._next = 0

    @property
    def core(self) -> Any:
        """The kernel's object."""
        return self._core

    @property
    def coefficients(self) -> Coefficients:
        """Coefficients of the contacts between grains."""
        return self.grain.contact.coefficients(self.grain.mean_mass / 2, self.time_step)

    # -- impacts on walls --------------------------------------------------------------------------

    @property
    def watched(self) -> bool:
        """Whether impacts on the walls around are kept until `impacts` reads them."""
        return bool(self._core.watching)

    @watched.setter
    def watched(self, on: bool) -> None:
        self._core.watching = on

    def impacts(self) -> Array:
        """Impacts since the last call, rows (n, 8).

        A grain makes one when it comes to touch the wall: place of the contact (3) [m], speed and
        speed along the normal [m/s], mass [kg] and radius [m] of the grain, and its number. A grain
        that slides or rolls on the wall makes none.
        """
        return np.asarray(self._core.impacts())

    # -- coming and going --------------------------------------------------------------------------

    def add(
        self,
        place: npt.ArrayLike,
        velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        radius: npt.ArrayLike | None = None,
        *,
        held: bool = False,
    ) -> None:
        """Add grains at places (n, 3); held ones keep their velocity and push all others.

        Raises InputError where grains overlap each other by more than a tenth of a radius.
        """
        x = np.ascontiguousarray(np.atleast_2d(np.asarray(place, dtype=float)))
        n = len(x)
        v = np.ascontiguousarray(np.broadcast_to(np.asarray(velocity, dtype=float), x.shape))
        given = self.grain.diameter / 2 if radius is None else radius
        r = np.ascontiguousarray(np.broadcast_to(np.asarray(given, dtype=float), n))
        check_overlap(x, r)
        number = np.arange(self._next, self._next + n)
        held_all = np.full(n, held, dtype=np.uint8)
        self._core.add(x, v, r, self.grain.masses(r), held_all, number)
        self._next += n

    def remove_beyond(self, z: float) -> int:
        """Take out the grains whose centres are beyond a place along the axis [m]; how many."""
        return len(self._core.remove_beyond(z))

    # -- steps -------------------------------------------------------------------------------------

    def run(self, steps: int) -> None:
        """Take time steps.

        Raises
        ------
        SolverError
            grains fly apart: a place is no longer finite.
        """
        if not self._core.run(steps):
            raise SolverError("grains fly apart: take a smaller numerics.time_step")

    def record(self) -> None:
        """Take one step and keep the forces on every grain for `wall_force` and `grain_force`."""
        self._core.recording = True
        self.run(1)
        self._core.recording = False

    # -- what is known of every grain, in the order of `number` ------------------------------------

    @property
    def count(self) -> int:
        """Grains inside."""
        return int(self._core.count)

    @property
    def number(self) -> npt.NDArray[np.int64]:
        """Numbers of the grains; they keep them for ever."""
        return self._core.number.copy()

    @property
    def place(self) -> Array:
        """Centres (n, 3) [m]."""
        return self._core.place[:, :3].copy()

    @property
    def straight(self) -> Array:
        """Centres in the straight line, (x, y, s) with s along the axis, (n, 3) [m]."""
        return np.asarray(self._core.straight())

    @property
    def radius(self) -> Array:
        """Radii [m]."""
        return self._core.place[:, 3].copy()

    @property
    def velocity(self) -> Array:
        """Velocities (n, 3), half a step behind the places [m/s]."""
        return self._core.motion[:, :3].copy()

    @property
    def spin(self) -> Array:
        """Angular velocities (n, 3) [1/s]."""
        return np.asarray(self._core.motion[:, 4:7] / self._core.place[:, 3:])

    @property
    def mass(self) -> Array:
        """Masses [kg]."""
        return np.asarray(1 / self._core.motion[:, 3])

    @property
    def free(self) -> npt.NDArray[np.bool_]:
        """Whether a grain moves by its forces."""
        return np.asarray(self._core.motion[:, 7] > 0)

    @property
    def gas_force(self) -> Array:
        """Force from outside on every grain (n, 3) [N], which may be written to."""
        return self._core.force[:, :3]

    @property
    def wall_force(self) -> Array:
        """Force of the walls (n, 3) in the step that `record` took [N]."""
        return self._core.record[:, :3].copy()

    @property
    def wall_pressing(self) -> Array:
        """Sum of the normal forces of the walls in that step [N]."""
        return self._core.record[:, 3].copy()

    @property
    def grain_force(self) -> Array:
        """Force of other grains (n, 3) in that step [N]."""
        return self._core.record[:, 4:7].copy()

    def set_velocity(self, velocity: npt.ArrayLike, spin: npt.ArrayLike | None = None) -> None:
        """Give all grains velocities and, where given, spins."""
        self._core.motion[:, :3] = velocity
        if spin is not None:
            self._core.motion[:, 4:7] = np.asarray(spin) * self._core.place[:, 3:]

    def inside(self) -> int:
        """Grains inside; of all processes, where several share them."""
        return self.count

    def everything(self) -> Any:
        """The grains, of all processes where several share them."""
        return self

    def total(self, *values: Array) -> tuple[Array, ...]:
        """Sums of arrays over the processes that share the grains."""
        return values

    def kinetic_energy(self) -> float:
        """Of motion and spin [J]."""
        motion = self._core.motion
        square = (motion[:, :3] ** 2).sum(axis=1) + 0.4 * (motion[:, 4:7] ** 2).sum(axis=1)
        return float((square / motion[:, 3]).sum() / 2)

    # -- restart -----------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that the next step depends on, as arrays."""
        return self._core.save() | {"next": np.array([self._next])}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave; the steps that follow have the same bits."""
        given = {name: np.ascontiguousarray(value) for name, value in state.items()}
        self._next = int(given.pop("next")[0])
        # several processes leave rows without a list of neighbours
        if "origin" in given:
            self._core.load(given)
        else:
            self._core.set_rows(given)


def check_overlap(x: Array, r: Array) -> None:
    """Raise InputError for spheres that overlap by more than a tenth of a radius."""
    from scipy.spatial import cKDTree

    if len(x) < 2:
        return
    pairs = cKDTree(x).query_pairs(2 * float(r.max()), output_type="ndarray")
    gap = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1) - r[pairs].sum(axis=1)
    worst = float(-gap.min(initial=0.0) / r.max())
    if worst > 0.1:
        words = "grains that overlap by at most a tenth of a radius: leave more room between them"
        raise InputError("place", f"an overlap of {worst:.2g} radii", words)
