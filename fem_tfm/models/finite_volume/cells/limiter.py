# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limiters: slopes in cells, and fluxes that keep cells within bounds."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.mesh import Array, Cells


def limited_increments(
    cells: Cells, values: Array, gradient: Array, small: Array | float
) -> tuple[Array, Array]:
    """What values on the inner faces have beyond those of the first and of the second cell.

    Linear in each cell, and limited where differences across and upwind of a face disagree:

        rise = psi g.(x_face - x_cell),  psi = max(0, 2 (a.b + e^2)/(a.a + b.b + 2 e^2))

    with b the difference across the face and a = 2 g.d - b that behind the cell. Smooth values,
    for which a and b agree, keep their slope, also at extrema that are flatter than e.

    values (count, ...) : of a scalar or a vector, which has one psi
    gradient (count, ..., 3) : g
    small (inner) : e, in the unit of the values

    Source: van Albada, van Leer and Roberts (1982), Astron. Astrophys. 108, 76-84.
    """
    first, second = cells.first[: cells.inner_count], cells.second
    # component by component: these arrays are the largest of a step
    parts = values.reshape(cells.count, -1).T
    slopes = np.ascontiguousarray(gradient.reshape(cells.count, -1, 3).transpose(1, 2, 0))
    across = [part[second] - part[first] for part in parts]
    size = sum(b * b for b in across) + 2 * np.square(small)
    (apart, *ways), found = cells.ways, []
    for cell, way in zip((first, second), ways, strict=True):
        slope = [[g[cell] for g in part] for part in slopes]
        behind = [
            2 * sum(g * d for g, d in zip(part, apart, strict=True)) - b
            for part, b in zip(slope, across, strict=True)
        ]
        agree = sum(a * b for a, b in zip(behind, across, strict=True)) + np.square(small)
        size_behind = sum(a * a for a in behind)
        psi = 2 * np.maximum(agree, 0.0) / np.maximum(size + size_behind, 1e-300)
        rise = [psi * sum(g * d for g, d in zip(part, way, strict=True)) for part in slope]
        found.append(np.stack(rise, axis=1).reshape(-1, *values.shape[1:]))
    ahead, back = found
    return ahead, back


def limit_flux(cells: Cells, flux: Array, loss: Array, gain: Array) -> Array:
    """Fluxes that are reduced until no cell loses or gains too much by them (collective).

    Each is taken times the smaller of the shares that its two cells allow, so that what one
    cell loses another gains.

    flux (faces) : what is carried through faces
    loss, gain (owned) : most that the sum over a cell's outgoing and incoming fluxes may be

    Source: Zalesak (1979), J. Comput. Phys. 31, 335-362.
    """
    ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
    shares = []
    for most, carried in (
        (loss, cells.sum_by_side(ahead, back)),
        (gain, cells.sum_by_side(back, ahead)),
    ):
        share = np.minimum(1.0, most / np.maximum(carried, 1e-300))
        shares.append(cells.ghosted(np.maximum(share, 0.0)))
    leave, enter = shares
    first, second, inner = cells.first, cells.second, slice(0, cells.inner_count)
    share = np.where(flux > 0, leave[first], enter[first])
    other = np.where(flux[inner] > 0, enter[second], leave[second])
    share[inner] = np.minimum(share[inner], other)
    return share * flux
