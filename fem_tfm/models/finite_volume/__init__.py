# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady two-fluid flow in three dimensions, one value a cell.

One step, without outer iterations:

1. solids fraction (`fraction`): upwind with the volume fluxes, the pressure of the solids implicit
   and nonlinear; the matrix is an M-matrix, so 0 <= alpha_s < packing_limit at any step, and
   alpha_s is taken from its own fluxes, so that the mass of the solids is exact to round-off;
2. granular temperature (`temperature`): implicit, its sinks in the diagonal, so Theta > 0;
3. turbulence (`turbulence`), where laws transport it: implicit in ln X, so that X > 0; it also
   gives the eddy viscosities and the dispersion, of the state before the step;
4. momentum (`momentum`) of both phases with their drag in one matrix for each set of components
   that walls and planes of symmetry tie;
5. pressure (`pressure`): what the momenta leave of div(alpha_s u_s + alpha_g u_g) = 0, with the
   response of mass and drag alone, R = [[m_s/dt + beta, -beta], [-beta, m_g/dt + beta]]^-1;
   for a gas whose density follows the pressure (`ideal_gas`) that of the balance of its mass.

`flow` puts the step together from these equations, `time_levels` gives its levels in time, `state`
the values that the equations pass on. All coefficients are those of `models.pointwise`; `cells` has
the mesh, its operators, limiters, matrices and solvers.

Forces act as accelerations of faces and are carried to the cells from there, so that neither
pressure oscillates and fluids at rest stay at rest. p is the pressure without the weight of the gas
at the outlet.
"""

from fem_tfm.models.finite_volume.flow import UnsteadyFlow
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import Inflow, Report, State, StepFailed

__all__ = ["Inflow", "Report", "State", "StepFailed", "UnsteadyFlow", "UnsteadyProblem"]
