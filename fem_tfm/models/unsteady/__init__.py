# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady two-fluid flow in three dimensions, one value a cell.

One step, without outer iterations:

1. solids fraction (`fraction`): upwind with the volume fluxes, the pressure of the solids implicit
   and nonlinear; the matrix is an M-matrix, so 0 <= alpha_s < packing_limit at any step, and
   alpha_s is taken from its own fluxes, so that the mass of the solids is exact to round-off;
2. granular temperature (`agitation`): implicit, its sinks in the diagonal, so Theta > 0;
3. turbulence (`turbulence`), where laws transport it: implicit in ln X, so that X > 0; it also
   gives the eddy viscosities and the dispersion, of the state before the step;
4. momenta (`momenta`) of both phases with their drag in one matrix for each set of components
   that walls and planes of symmetry tie;
5. pressure (`projection`): what the momenta leave of div(alpha_s u_s + alpha_g u_g) = 0, with the
   response of mass and drag alone, R = [[m_s/dt + beta, -beta], [-beta, m_g/dt + beta]]^-1;
   for a gas whose density follows the pressure (`compression`) that of the balance of its mass.

`laws` gives the coefficients of the phases in cells and knows neither faces nor matrices; `line`
is the mesh as all parts see it, `state` what they hand on, `flow` the step that they make up.

Forces act as accelerations of faces and are carried to the cells from there, so that neither
pressure oscillates and fluids at rest stay at rest. p is the pressure without the weight of the gas
at the outlet.
"""

from fem_tfm.models.unsteady.flow import Flow3D
from fem_tfm.models.unsteady.state import Feed, Moment, Report, StepFailed

__all__ = ["Feed", "Flow3D", "Moment", "Report", "StepFailed"]
