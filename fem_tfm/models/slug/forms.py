# SPDX-License-Identifier: LGPL-3.0-or-later
"""Balance of the gas in a tube with grains, in UFL: the specification of `pressure`.

The gas is isothermal and ideal, its density proportional to the pressure P = P_0 + P'. With the
porosity f, the velocity u of the grains and the resistance r of bed and wall,
-grad P = r f (v_g - u), its mass balance reads

    f (dP/dt + u . grad P) + P div u = div(P/r grad P)

The total flux u - grad P/r has no component through the wall and the value q at the inlet; P' is 0
at the outlet. The paper's eq. (5) puts P_0 in the place of P and drops u . grad P.

Tested with w and integrated by parts, with c either P_0 or P:

    int f dP/dt w + int c/r grad P' . grad w
        = int c u . grad w + int (1 - f) u . grad P' w + int_inlet c q w

where the integral of (1 - f) u is there with c = P alone. Unknown, porosity and velocity are
continuous and trilinear. The storage is lumped: its matrix is diagonal, with the integrals of f w.
On the right hand side and in coefficients P' is that of the steps before, extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

from fem_tfm.models.slug.gas import TubeGas, resistance
from fem_tfm.models.slug.mesh import DEGREE, TubeMesh


@dataclass(frozen=True)
class GasForms:
    """Forms of the balance on given fields.

    porosity, velocity : f and u
    ahead : P' in the coefficients
    """

    tube: TubeMesh
    gas: TubeGas
    diameter: float
    porosity: fem.Function
    velocity: fem.Function
    ahead: fem.Function

    @property
    def _test(self) -> Any:
        return ufl.TestFunction(self.tube.space)

    @property
    def _dx(self) -> ufl.Measure:
        return ufl.Measure("dx", self.tube.mesh.mesh, metadata={"quadrature_degree": DEGREE})

    @property
    def _level(self) -> Any:
        """c."""
        base = ufl.as_ufl(self.gas.reference_pressure)
        return base + self.ahead if self.gas.balance == "full" else base

    def _resistance(self) -> tuple[Any, Any]:
        """r, and the bed's share of it."""
        slope = ufl.grad(self.ahead)
        size = ufl.sqrt(ufl.dot(slope, slope))
        radius = self.tube.mesh.section.radius
        open_share = ufl.max_value(self.porosity, self.gas.porosity_floor)
        return resistance(self.gas, self.diameter, radius, open_share, size, ufl.sqrt)

    def storage(self) -> ufl.Form:
        """Diagonal of the storage: int f w."""
        return self.porosity * self._test * self._dx

    def diffusion(self) -> ufl.Form:
        """int c/r grad P' . grad w, bilinear."""
        trial, r = ufl.TrialFunction(self.tube.space), self._resistance()[0]
        return self._level / r * ufl.dot(ufl.grad(trial), ufl.grad(self._test)) * self._dx

    def right(self) -> ufl.Form:
        """int c u . grad w + int (1 - f) u . grad P' w."""
        u, w = self.velocity, self._test
        form = self._level * ufl.dot(u, ufl.grad(w)) * self._dx
        if self.gas.balance == "full":
            form += (1 - self.porosity) * ufl.dot(u, ufl.grad(self.ahead)) * w * self._dx
        return form

    def force(self, direction: int) -> ufl.Form:
        """-int s dP'/dx_d w with the bed's share s: what the nodes give to their grains."""
        return -self._resistance()[1] * self.ahead.dx(direction) * self._test * self._dx

    def inlet(self) -> ufl.Form:
        """int_inlet w, what a flux of one brings in."""
        mesh = self.tube.mesh
        metadata = {"quadrature_degree": DEGREE}
        ds = ufl.Measure("ds", mesh.mesh, subdomain_data=mesh.facet_tags, metadata=metadata)
        return self._test * ds(mesh.tags["inlet"])
