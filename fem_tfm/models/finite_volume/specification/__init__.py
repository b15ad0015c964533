# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of one unsteady step as DG0 forms in UFL: the specification of the arrays.

The solver evaluates a step on flat arrays. These modules, which have the names of the solver's,
state the same equations in UFL; the tests assemble them with DOLFINx and compare both. Nothing here
runs in a simulation.

`on` is the mesh in UFL (`facets`), w a test function of one value a cell, or of one vector. `point`
are the laws at a point. The other arguments are the data that the parts of a step exchange, with
UFL in place of their arrays (`FacetForms.fields` and the functions `..._fields` of `data`). Fluxes
are densities, per area of a face. `rise` is the difference q(-) - q(+) across a face.
"""
