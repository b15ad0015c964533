# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limiters: of linear values in cells, and of fluxes, by which cells keep their bounds."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.mesh import Array, Cells


def limited_increments(
    cells: Cells, values: Array, gradient: Array, small: Array | float
) -> tuple[Array, Array]:
    """Increments from the first and from the second cell to the inner faces, limited linear.

        increment = psi g.(x_face - x_cell),  psi = max(0, 2 (a.b + e^2)/(a.a + b.b + 2 e^2))

    with b the difference across the face and a = 2 g.d - b the one behind the cell. Where a and b
    agree, the values are smooth and the increments linear, also at extrema flatter than e.

    values (count, ...) : a scalar, or a vector with one psi for its components
    gradient (count, ..., 3) : g
    small (inner) : e, in the unit of the values

    Source: van Albada, van Leer and Roberts (1982), Astron. Astrophys. 108, 76-84.
    """
    first, second = cells.first[: cells.inner_count], cells.second
    # one array for each component, which is several times as fast as one of vectors
    parts = values.reshape(cells.count, -1).T
    slopes = np.ascontiguousarray(gradient.reshape(cells.count, -1, 3).transpose(1, 2, 0))
    across = [part[second] - part[first] for part in parts]
    size = sum(b * b for b in across) + 2 * np.square(small)
    (delta, *to_face), found = cells.inner_vectors, []
    for cell, vector in zip((first, second), to_face, strict=True):
        slope = [[g[cell] for g in part] for part in slopes]
        behind = [
            2 * sum(g * d for g, d in zip(part, delta, strict=True)) - b
            for part, b in zip(slope, across, strict=True)
        ]
        agree = sum(a * b for a, b in zip(behind, across, strict=True)) + np.square(small)
        size_behind = sum(a * a for a in behind)
        psi = 2 * np.maximum(agree, 0.0) / np.maximum(size + size_behind, 1e-300)
        rise = [psi * sum(g * d for g, d in zip(part, vector, strict=True)) for part in slope]
        found.append(np.stack(rise, axis=1).reshape(-1, *values.shape[1:]))
    from_first, from_second = found
    return from_first, from_second


def limit_flux(cells: Cells, flux: Array, loss: Array, gain: Array | float) -> Array:
    """Fluxes reduced so that no cell loses or gains too much by them (collective).

    Each flux is multiplied by the smaller of the shares that its two cells allow, which conserves.

    flux (faces) : fluxes to be limited
    loss, gain (owned) : largest sums of the outgoing and of the incoming fluxes of a cell

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
