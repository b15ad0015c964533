# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady two-fluid flow in three dimensions by cell-centred finite volumes.

One step, without outer iterations:

1. solids fraction (`fraction`): upwind volume fluxes with an implicit, nonlinear solids pressure;
   0 <= alpha_s < packing_limit at any step, and the mass of the solids is exact to round-off;
2. granular temperature (`temperature`): implicit, its sinks in the diagonal, so that Theta > 0;
3. turbulence (`turbulence`) where laws transport it: implicit in ln X, so that X > 0; it also gives
   the eddy viscosities and the dispersion, at the predicted state;
4. momentum (`momentum`) of both phases, coupled by drag, at the present pressure, with the weight
   of the solids balanced on faces (`body_force`);
5. pressure (`pressure`): the projection that balances the volume of both phases, or the mass of a
   gas whose density follows the pressure (`ideal_gas`).

`flow` solves these equations in turn. `problem` states what is solved, `scheme` the order in space
and time with the levels of `time_levels`, `state` the values that the equations pass on. All
coefficients are those of `models.pointwise`; the folder `cells` has the mesh, its operators,
limiters, matrices and linear solvers.

p is the pressure without the weight of the gas at the outlet.
"""

from fem_tfm.models.finite_volume.flow import UnsteadyFlow
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import Inflow, Report, State, StepFailed

__all__ = ["Inflow", "Report", "State", "StepFailed", "UnsteadyFlow", "UnsteadyProblem"]
