# SPDX-License-Identifier: LGPL-3.0-or-later
"""The split of the pressure drop of an unsteady line: friction, lift, and what accelerates.

    friction = -sum over the wall of (traction.e) S/A
    lift     = -sum over the cells of (alpha_s rho_s + alpha_g rho_g) (g.e) V/A
    omitted  = -sum over the inner faces of mean(p/Theta) rise(Theta) (S.e)/A

e is the axis of the line and A the area of its section. The third is there where the force of the
solids pressure is (dp/dalpha) grad(alpha): the share by grad(Theta) then acts on the flow from
nowhere, for a pressure of which a part is left out pushes no end of the line. The rest of the drop
accelerates both phases: in time, from the inlet to the outlet, and around a bend.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import State
from fem_tfm.models.pointwise import tangential
from fem_tfm.models.two_fluid.split import ACCELERATION, GAS, LIFT, OMITTED, SOLIDS


class DropSplit:
    """Parts of a pressure drop.

    Parameters
    ----------
    line : mesh
    gravity : acceleration (3,) [m/s2]
    """

    def __init__(self, line: LineMesh, gravity: Array) -> None:
        self.line = line
        cells, mesh = line.cells, line.mesh
        self._along_wall = mesh.axis(cells.face_centre[line.wall])
        along = mesh.axis(cells.face_centre[line.inner])
        self._along_face = np.einsum("ni,ni->n", along, cells.area[line.inner])
        self._lifted = -(mesh.axis(cells.centre[line.own]) @ gravity) * line.volume
        assert mesh.length is not None
        self._area = cells.total(line.volume) / mesh.length

    def parts(
        self,
        state: State,
        wall_friction: Mapping[str, Array],
        thermal_rise: Array | None,
        density: Array,
        drop: float,
    ) -> dict[str, float]:
        """Friction of each phase, lift, acceleration, and what p_s leaves out [Pa] (collective).

        wall_friction : of each phase in the last step, as in `Phase` [kg/s]
        thermal_rise : of the solids, as in `Phase` [Pa], None without
        density : of both phases together in the owned cells [kg/m3]
        drop : of the pressure [Pa]
        """
        cells, wall = self.line.cells, self.line.wall
        edge, normal, found = cells.first[wall], self.line.normal[wall], {}
        velocities = {"gas": (GAS, state.u_g), "solids": (SOLIDS, state.u_s)}
        for phase, friction in wall_friction.items():
            name, velocity = velocities[phase]
            along = tangential(velocity[edge], normal)
            force = friction * np.einsum("ni,ni->n", along, self._along_wall)
            found[name] = cells.total(force) / self._area
        found = {name: found[name] for name in (GAS, SOLIDS) if name in found}
        found[LIFT] = cells.total(density * self._lifted) / self._area
        if thermal_rise is not None:
            found[OMITTED] = -self._omitted(thermal_rise) / self._area
        return found | {ACCELERATION: drop - sum(found.values())}

    def _omitted(self, rise: Array) -> float:
        """Axial force on the solids by the share of p_s that is left out [N] (collective)."""
        cells = self.line.cells
        force = np.zeros(cells.face_count)
        force[self.line.inner] = rise[self.line.inner] * self._along_face
        # every inner face has two cells, each on one rank
        return cells.total(cells.sum_faces(force)) / 2
