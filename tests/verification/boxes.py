# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the tests of the unsteady flow share: tagged boxes and cases on them."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.section import RectangularSection
from fem_tfm.materials import Solids
from fem_tfm.models.finite_volume import UnsteadyFlow

TAGS = {"inlet": 1, "outlet": 2, "wall": 3, "symmetry": 4}
HEX, TET = dmesh.CellType.hexahedron, dmesh.CellType.tetrahedron

AIR = {"density": 1.2, "viscosity": 1.8e-5}
GRAINS = {"density": 2500.0, "diameter": 1e-3, "restitution": 0.9}
FREE = {"gas": "free-slip", "solids": "free-slip"}


def box(
    lengths: tuple[float, float, float],
    cells: tuple[int, int, int],
    parts: str = "ssssio",
    kind: dmesh.CellType = HEX,
    shear_deg: float = 0.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Mesh:
    """A box |x| < W/2, |y| < H/2, 0 < z < L, its upper layers shifted in y by `shear_deg`.

    `parts` are the first letters of the parts at the sides -x, +x, -y, +y, z = 0 and z = L.
    """
    half = np.array([lengths[0] / 2, lengths[1] / 2, 0.0])
    low, high = -half, np.array(lengths) - half
    domain = dmesh.create_box(
        comm, [low, high], cells, kind, ghost_mode=dmesh.GhostMode.shared_facet
    )
    domain.topology.create_connectivity(2, 3)
    names = {name[0]: tag for name, tag in TAGS.items()}
    facets, tags = [], []
    for side, part in enumerate(parts):
        axis, at = side // 2, (low, high)[side % 2][side // 2]
        found = dmesh.locate_entities_boundary(
            domain, 2, lambda x, axis=axis, at=at: np.isclose(x[axis], at, atol=1e-9 * max(lengths))
        )
        facets.append(found)
        tags.append(np.full(found.size, names[part], dtype=np.int32))
    facets, tags = np.concatenate(facets), np.concatenate(tags)
    order = np.argsort(facets)
    facet_tags = dmesh.meshtags(domain, 2, facets[order], tags[order])
    inside = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    cell_tags = dmesh.meshtags(domain, 3, inside, np.ones(inside.size, dtype=np.int32))
    domain.geometry.x[:, 1] += math.tan(math.radians(shear_deg)) * domain.geometry.x[:, 2]
    used = {name: tag for name, tag in TAGS.items() if name[0] in parts}
    section = RectangularSection(lengths[0], lengths[1], "none")
    size = lengths[0] / cells[0]
    return Mesh(domain, cell_tags, facet_tags, used, section, size, lengths[2])


def case(mesh: Mesh, changes: Mapping[str, Any] | None = None, alone: bool = False) -> Case:
    """Air and 1 mm grains, or air alone, in a box without friction at its walls."""
    geometry = mesh.section
    values: dict[str, Any] = {
        "solution": "unsteady",
        "numerics": {"end_time": 1.0},
        "geometry": {
            "shape": "duct",
            "width": geometry.width,
            "height": geometry.height,
            "length": mesh.length,
            "symmetry": "none",
        },
        "gas": AIR,
        "operation": {"gas_superficial_velocity": 1.0, "gravity": 0.0},
        "closures": {"drag": "ergun", "turbulence": "laminar", "friction": "none"},
        "inlet": {"profile": "uniform"},
        "walls": FREE,
    }
    if not alone:
        values["solids"] = GRAINS
        values["operation"] |= {"solids_fraction": 0.3, "solids_velocity": 1.0}
    return Case.from_dict(values).with_values(changes or {})


def flow(
    mesh: Mesh, changes: Mapping[str, Any] | None = None, alone: bool = False, order: int = 0
) -> UnsteadyFlow:
    """The flow of such a case, at rest."""
    given = case(mesh, {"numerics.order": order, **(changes or {})}, alone)
    return UnsteadyFlow(given.scene.problem(), mesh)


def immovable(solids: Solids) -> Solids:
    """Grains so heavy that nothing moves them, beyond what a case may state."""
    found = copy.copy(solids)
    object.__setattr__(found, "density", 1e12)
    return found
