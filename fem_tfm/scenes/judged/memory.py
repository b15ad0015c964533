# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory that a mesh would take, told without making it, against that of the machine."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.geometry.mesh import section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section

# cells finer than this, over the hydraulic diameter, are counted on a mesh of this size
COUNTED = 0.02


def section_cells(section: Section, resolution: Resolution) -> float:
    """About how many cells the mesh of a section has; raises InputError for a size out of range."""
    size, largest = resolution.core_size(section), COUNTED * section.hydraulic_diameter
    coarse = replace(resolution, mesh_size=max(size, largest))
    return section_mesh(section, coarse, MPI.COMM_SELF).num_cells * max(largest / size, 1.0) ** 2


def check_memory(megabytes: float, resolution: Any, diameters: float | None = None) -> None:
    """Refuse a mesh that needs more memory than the machine has; raises InputError.

    diameters : length of the line that is meshed over its hydraulic diameter, None for a section
    """
    name = "level" if resolution.mesh_size is None else "mesh_size"
    cure = "a coarser mesh"
    if diameters is not None:
        cure += f", or a line shorter than {diameters:.4g} diameters"
    refuse_beyond(megabytes, f"numerics.{name}", getattr(resolution, name), f"{cure}: it")


def refuse_beyond(megabytes: float, key: str, value: Any, cure: str) -> None:
    """Refuse what needs more memory than the machine has; raises InputError for a key.

    cure : what would need less, and what needs this much
    """
    known = machine_memory()
    if known is not None and megabytes > known:
        words = (
            f"{cure} needs about {megabytes:.0f} MB of memory and the machine has {known:.0f} MB"
        )
        raise InputError(key, value, words)


def machine_memory() -> float | None:
    """Memory of the machine [MB], None where it does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
    except (AttributeError, OSError, ValueError):
        return None
