# SPDX-License-Identifier: LGPL-3.0-or-later
"""Balance of the gas in a tube with grains, in UFL: the specification of `pressure`.

The gas is isothermal and ideal, its density proportional to the pressure P = P_0 + P'. With the
porosity f, the velocity u of the grains and the resistance r of the bed, -grad P = r f (v_g - u),
its mass balance reads

    f (dP/dt + u . grad P) + P div u = div(P/r grad P)

The total flux u - grad P/r has no component through the wall and the value q at the inlet; P' is 0
at the outlet. The paper's eq. (5) puts P_0 in the place of P and drops u . grad P.

Tested with w and integrated by parts, with c either P_0 or P:

    int f dP/dt w + int c/r grad P' . grad w - int c u . grad w - int (1 - f) u . grad P' w
        = int_inlet c q w

where the integral of (1 - f) u is there with c = P alone. Fields are continuous and trilinear, and
so are the products m = c/r and c u: each is the function with the product of the nodal values. The
storage is lumped, its matrix diagonal: the integrals of f w. The last integral on the left hand
side is lumped, too: the nodal value of (1 - f) u times int grad P' w.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

from fem_tfm.models.slug.mesh import DEGREE, TubeMesh


@dataclass(frozen=True)
class GasForms:
    """Forms of the balance on given nodal fields.

    porosity : f
    mobility : m = c/r
    flux : c u, a vector
    pressure : P'
    """

    tube: TubeMesh
    porosity: fem.Function
    mobility: fem.Function
    flux: Any
    pressure: fem.Function

    def _test(self) -> Any:
        return ufl.TestFunction(self.tube.space)

    def _dx(self) -> ufl.Measure:
        return ufl.Measure("dx", self.tube.mesh.mesh, metadata={"quadrature_degree": DEGREE})

    def storage(self) -> ufl.Form:
        """Diagonal of the storage: int f w."""
        return self.porosity * self._test() * self._dx()

    def diffusion(self) -> ufl.Form:
        """int m grad P' . grad w, bilinear."""
        trial = ufl.TrialFunction(self.tube.space)
        return self.mobility * ufl.dot(ufl.grad(trial), ufl.grad(self._test())) * self._dx()

    def displacement(self) -> ufl.Form:
        """int c u . grad w."""
        return ufl.dot(self.flux, ufl.grad(self._test())) * self._dx()

    def gradient(self, direction: int) -> ufl.Form:
        """int dP'/dx_d w."""
        return self.pressure.dx(direction) * self._test() * self._dx()

    def inlet(self) -> ufl.Form:
        """int_inlet w, what a flux of one brings in."""
        mesh = self.tube.mesh
        ds = ufl.Measure(
            "ds",
            mesh.mesh,
            subdomain_data=mesh.facet_tags,
            metadata={"quadrature_degree": DEGREE},
        )
        return self._test() * ds(mesh.tags["inlet"])
