# SPDX-License-Identifier: LGPL-3.0-or-later
"""Averages of the grains over a width that does not depend on the mesh.

Grains give their volume to the nodes by the nodal basis functions, and nodal values become a field
by the same functions; each of the two spreads a grain with the variance h^2/6 in a direction with
cells of a size h. On cells smaller than a grain the field would be one of holes and solid nodes.
Hence what the nodes have got is spread further by diffusion,

    d a/dt = div grad a,   no flux through wall, inlet and outlet,

for a time t that makes the variance of the whole w^2 in each direction:

    2 h^2/6 + 2 t = w^2

On a fine mesh this is a Gaussian kernel of standard deviation w that walls reflect. It keeps the
volume of the grains. Where the mesh alone spreads more than w, nothing is added.

Source: Capecelatro and Desjardins (2013), J. Comput. Phys. 238, 1-31, section 4; Sun and Xiao
(2015), Int. J. Multiphase Flow 77, 142-157.
"""

from __future__ import annotations

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.special import ive

from fem_tfm.models.slug.mesh import DEGREE, TubeMesh

Array = npt.NDArray[np.float64]
# weight below which a node takes no part
NEGLIGIBLE = 1e-16


class Averaging:
    """Diffusion along the tube times diffusion over its section, both exact in time.

    width : w, standard deviation of the average in each direction [m]
    """

    def __init__(self, tube: TubeMesh, width: float) -> None:
        self.shape = (len(tube.planes), tube.per_plane)
        self.width = width
        along = tube.length / (len(tube.planes) - 1)
        area = tube.area
        self._across, mass = _section(tube, _time(width, area / len(tube.cells)))
        # of the nodes in the straight line that a bend stands for
        heights = np.full(len(tube.planes), along)
        heights[[0, -1]] /= 2
        self.volumes = np.outer(heights, mass).ravel()
        # exact solution on evenly spaced nodes; halves of cells at the ends reflect it
        scaled = _time(width, along**2) / along**2
        weights = ive(np.arange(len(tube.planes)), 2 * scaled)
        kept = weights[weights > NEGLIGIBLE * weights[0]]
        kernel = np.concatenate([kept[:0:-1], kept])
        self._along = kernel / kernel.sum()

    def __call__(self, density: Array) -> Array:
        """The average of nodal values (n,) or (n, m)."""
        # imported here, as it takes a tenth of a second, and other flows do without
        from scipy.ndimage import convolve1d

        found = density.reshape(*self.shape, -1)
        if len(self._along) > 1:
            found = convolve1d(found, self._along, axis=0, mode="mirror")
        return np.asarray(np.matmul(self._across, found)).reshape(density.shape)

    def spread(self, amount: Array) -> Array:
        """What the nodes have, (n,) or (n, m), where it goes: their sum stays."""
        volumes = self.volumes if amount.ndim == 1 else self.volumes[:, None]
        return volumes * self(amount / volumes)


def _time(width: float, square: float) -> float:
    """t for cells of a squared size [m2]."""
    return max(width**2 - square / 3, 0.0) / 2


def _section(tube: TubeMesh, time: float) -> tuple[Array, Array]:
    """exp(-t M^-1 K) of the section's stiffness K and lumped mass M, and the masses [m2]."""
    size, number = tube.per_plane, tube.cells[:, 0, :4]
    points, weights = basix.make_quadrature(basix.CellType.quadrilateral, DEGREE)
    table = basix.ufl.element("Lagrange", "quadrilateral", 1).tabulate(1, points)
    jacobian = np.einsum("cad,eqa->cqde", tube.straight[number][:, :, :2], table[1:])
    slope = np.einsum("cqed,eqa->cqad", np.linalg.inv(jacobian), table[1:])
    area = np.abs(np.linalg.det(jacobian)) * weights
    local = np.einsum("cq,cqad,cqbd->cab", area, slope, slope)
    stiffness, mass = np.zeros((size, size)), np.zeros(size)
    np.add.at(stiffness, (number[:, :, None], number[:, None, :]), local)
    np.add.at(mass, number, np.einsum("cq,qa->ca", area, table[0]))
    return np.asarray(expm(-time * stiffness / mass[:, None])), mass
