# SPDX-License-Identifier: LGPL-3.0-or-later
"""What particles give to the gas of a section: sources with one value a cell.

Force on the gas over its mass and heating over its heat capacity follow what they act on::

    F = S - beta (u - u_0),   Q = q - h (T - T_0)

Particles tell the mean over the slab that they crossed; a station of a march has a backward
difference instead. So each cell keeps books: J, what the gas has felt so far, grows by the
difference of the march itself, w_0 J + w_1 J_old + w_2 J_older = F, and S is the one for which J is
what the particles have given so far. Where the last pass over a slab leaves a difference, the next
slab makes up for it, so that nothing is lost whatever the step and the number of passes.

Particles that do not follow the eddies damp them, at a rate gamma that they tell too::

    dR_ij/dt = -2 gamma R_ij,   d eps/dt = C_e3 eps/k dk/dt

In local equilibrium gamma = beta (1 - 1/(1 + St)) with St = tau_p/T_L; sampled on tracks by the
consistent terms of Lain and Sommerfeld, Int. J. Heat Fluid Flow 24 (2003), it is
-(<u_i F_i> - <u_i><F_i>)/(2 k). An isotropic rate keeps the stresses realisable.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from numpy.typing import NDArray
from ufl.core.expr import Expr

from fem_tfm.fenics import compile_form

Array = NDArray[np.float64]
# share of the damping that eps feels, C_e3 of Lain and Sommerfeld
DISSIPATION = 1.8


class Source:
    """S - beta (x - x_0), and its books, for a quantity x of n components.

    active : a factor for each component, 0 for those that are left out and 1 for the others
    given, slope, level : S, beta and x_0
    owed : what the gas has not felt yet of what was given, times length
    last : what it felt from the station before to the one at hand, times length
    """

    def __init__(self, mesh: Any, active: Sequence[float]) -> None:
        self.active, components = np.array(active), len(active)
        space = fem.functionspace(mesh, ("DG", 0, (components,)))
        self.given, self.level, self.owed, self.last = (fem.Function(space) for _ in range(4))
        self.slope = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        self.components, self._comm = components, mesh.comm
        # where the values of the owned cells stand
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        self.cells = np.asarray(space.dofmap.list)[:owned, 0]
        self._weights, self._step, self._mean = (0.0, 0.0, 0.0), 0.0, np.zeros((owned, components))

    def bind(self, quantity: Expr, dx: Any) -> None:
        """Tell what x is, as a UFL vector."""
        test = ufl.TestFunction(self.level.function_space)
        self._total = compile_form(ufl.dot(quantity, test) * dx)
        ones = ufl.as_vector([1.0] * self.components)
        self.volumes = self._assembled(compile_form(ufl.dot(ones, test) * dx))[:, 0]
        self.keep()

    def __call__(self, x: Expr) -> Expr:
        """The source at x, a vector."""
        parts = self.given - self.slope * (x - self.level)
        return ufl.as_vector([parts[i] if on else 0.0 for i, on in enumerate(self.active)])

    def _assembled(self, form: fem.Form) -> Array:
        values = fem.assemble_vector(form).array
        return values.reshape(-1, self.components)[self.cells]

    def _values(self, function: fem.Function) -> Array:
        """Values of the owned cells, shape (cells, n)."""
        return function.x.array.reshape(-1, function.function_space.dofmap.bs)[self.cells]

    def _set(self, function: fem.Function, values: Array) -> None:
        array = function.x.array.reshape(-1, function.function_space.dofmap.bs)
        array[self.cells] = values.reshape(len(self.cells), -1)
        function.x.scatter_forward()

    # -- what others read ----------------------------------------------------------------------

    def means(self) -> Array:
        """Means of x over the owned cells, shape (cells, n)."""
        return self._assembled(self._total) / self.volumes[:, None]

    def felt(self) -> Array:
        """Means of the source over the owned cells, shape (cells, n)."""
        away = self.means() - self._values(self.level)
        return self.active * (self._values(self.given) - self._values(self.slope) * away)

    def total(self, values: Array) -> Array:
        """Integral over the part of the section that is solved (collective), shape (n,)."""
        return self._comm.allreduce(self.volumes @ values, op=MPI.SUM)

    def outstanding(self) -> Array:
        """Integral of what was given and not felt yet, times length (collective)."""
        return self.total(self._values(self.owed))

    def spread(self, sums: Array, share: float) -> Array:
        """Mean over the slab of what sums over cells amount to, over their volume.

        sums : of owned cells over the whole section
        share : of the whole section that is solved; 1/4 where cells hold what four quarters give
        """
        return (share * sums.T / (self.volumes * self._step)).T

    # -- a slab --------------------------------------------------------------------------------

    def begin(self, weights: Sequence[float], step: float) -> None:
        """A station is tried: weights of its backward difference [1/m] and its step [m]."""
        self._weights, self._step = (weights[0], weights[1], weights[2]), step
        self._mean = np.zeros_like(self._mean)

    def renew(self, mean: Array, slope: Array) -> tuple[float, float]:
        """Take over what particles give at the x at hand; returns change and size (collective).

        mean : over the slab, of each owned cell, shape (cells, n)
        slope : how much less they would give for one more of x, shape (cells,)
        """
        felt, here = self.felt(), self.means()
        first, _, last = self._weights
        self._mean = self.active * mean
        due = self._values(self.owed) + self._step * self._mean
        new = first * due - last * self._values(self.last)
        self._set(self.given, new)
        self._set(self.slope, first * self._step * np.asarray(slope))
        self._set(self.level, here)
        return float(self.total(abs(new - felt)).sum()), float(self.total(abs(new)).sum())

    def accept(self) -> None:
        """Enter the slab into the books."""
        first, _, last = self._weights
        gained = (self.felt() + last * self._values(self.last)) / first
        self._set(self.owed, self._values(self.owed) + self._step * self._mean - gained)
        self._set(self.last, gained)
        self.keep()

    def functions(self) -> dict[str, fem.Function]:
        """What a state consists of."""
        names = ("given", "slope", "level", "owed", "last")
        return {name: getattr(self, name) for name in names}

    def keep(self) -> None:
        """The state at hand is that of an accepted station."""
        self._kept = {name: f.x.array.copy() for name, f in self.functions().items()}

    def put_back(self) -> None:
        """Back to the accepted station."""
        for name, function in self.functions().items():
            function.x.array[:] = self._kept[name]


class Exchange:
    """All that particles give to the gas of a section.

    mesh : of the section (dolfinx)
    lateral : whether they push it across the axis too
    heat : whether they warm it
    damping : whether they damp its eddies
    dissipation : C_e3 [-]

    Attributes
    ----------
    force : F [m/s2], three components
    heat : Q [K/s], None without
    damping : gamma [1/s], None without
    """

    def __init__(
        self,
        mesh: Any,
        lateral: bool = False,
        heat: bool = False,
        damping: bool = False,
        dissipation: float = DISSIPATION,
    ) -> None:
        self.force = Source(mesh, (1.0, 1.0, 1.0) if lateral else (0.0, 0.0, 1.0))
        self.heat = Source(mesh, (1.0,)) if heat else None
        self.damping = fem.Function(fem.functionspace(mesh, ("DG", 0))) if damping else None
        self.dissipation = fem.Constant(mesh, dissipation)
        self._calm = np.zeros(0) if self.damping is None else self.damping.x.array.copy()

    @property
    def sources(self) -> dict[str, Source]:
        """Those with books."""
        return {"force": self.force} | ({} if self.heat is None else {"heat": self.heat})

    # -- terms of the equations ----------------------------------------------------------------

    def push(self, u: Expr) -> Expr:
        """Force on the gas over its mass, shape (3,) [m/s2]."""
        return self.force(u)

    def warming(self, t: Expr) -> Expr:
        """Heating of the gas over its heat capacity [K/s]."""
        return 0.0 if self.heat is None else self.heat(ufl.as_vector((t,)))[0]

    # -- what a coupler does -------------------------------------------------------------------

    def renew(
        self,
        force: Array,
        slope: Array,
        drive: float = 0.0,
        heat: Array | None = None,
        heat_slope: Array | None = None,
        damping: Array | None = None,
    ) -> float:
        """Take over what particles give to the owned cells where the gas is as it is now.

        Returns the relative change: of the force, over it or what drives the flow, whichever is
        larger, and of the heat; the larger of the two (collective).

        force, slope : mean over the slab on the gas over its mass, shape (cells, 3) [m/s2], and how
            much less it would be for each m/s of the gas, shape (cells,) [1/s]
        drive : G over the density [m/s2]
        heat, heat_slope : likewise, shape (cells,) [K/s] and [1/s]
        damping : gamma, shape (cells,) [1/s]
        """
        moved, size = self.force.renew(force, slope)
        change = moved / (max(size, abs(drive) * self._area) or 1.0)
        if self.heat is not None and heat is not None and heat_slope is not None:
            moved, size = self.heat.renew(heat[:, None], heat_slope)
            change = max(change, moved / (size or 1.0))
        if self.damping is not None and damping is not None:
            self.damping.x.array[self.force.cells] = damping
            self.damping.x.scatter_forward()
        return change

    @property
    def _area(self) -> float:
        return float(self.force.total(np.ones((len(self.force.cells), 3)))[0])

    # -- a slab --------------------------------------------------------------------------------

    def begin(self, weights: Sequence[float], step: float) -> None:
        """A station is tried."""
        for source in self.sources.values():
            source.begin(weights, step)

    def accept(self) -> None:
        """Enter the slab into the books."""
        for source in self.sources.values():
            source.accept()
        self.keep()

    def functions(self) -> dict[str, fem.Function]:
        """What a state consists of, by name."""
        found = {
            f"exchange.{name}.{part}": function
            for name, source in self.sources.items()
            for part, function in source.functions().items()
        }
        return found if self.damping is None else found | {"exchange.damping": self.damping}

    def keep(self) -> None:
        """The state at hand is that of an accepted station."""
        for source in self.sources.values():
            source.keep()
        if self.damping is not None:
            self._calm = self.damping.x.array.copy()

    def put_back(self) -> None:
        """Back to the accepted station, or to no exchange at all where there was none."""
        for source in self.sources.values():
            source.put_back()
        if self.damping is not None:
            self.damping.x.array[:] = self._calm
