# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tables of a gas field beside what DOLFINx assembles of the UFL forms."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from fem_tfm.fenics import compile_forms
from fem_tfm.models.slug.forms import GasForms
from fem_tfm.models.slug.pressure import GasPressure


def relative(a: Any, b: Any) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def check_tables(field: GasPressure) -> None:
    """Assert that matrices by values are those of the forms, with random fields."""
    tube, random = field.tube, np.random.default_rng(0)
    field.porosity, field.velocity = random.random(tube.size), random.random((tube.size, 3))
    field.pressure = 1e4 * random.random(tube.size)
    vector = fem.Function(fem.functionspace(tube.mesh.mesh, ("Lagrange", 1, (3,))))
    vector.x.array.reshape(-1, 3)[tube.order] = field.velocity
    function, ahead = tube.function(field.porosity), tube.function(field.pressure)
    forms = GasForms(tube, field.gas, field.diameter, function, vector, ahead)
    wanted = [forms.storage(), forms.right(), *(forms.force(d) for d in range(3))]
    *vectors, matrix = compile_forms([*wanted, forms.diffusion()])
    storage, right, *forces = (tube.nodal(fem.assemble_vector(f).array) for f in vectors)
    mobility, share, own = field.coefficients(field.pressure)
    field._share = share
    assert relative(tube.integrals(tube.value(field.porosity)), storage) < 1e-12
    assert relative(own, right) < 1e-12
    assert relative(field.nodal_force(), np.stack(forces, axis=-1)) < 1e-12
    full = fem.assemble_matrix(matrix).to_dense()[np.ix_(tube.order, tube.order)]
    n, band = field.band.unknowns, field.band(mobility)
    dense = np.zeros((n, n))
    for k in range(field.band.width + 1):
        dense[np.arange(k, n), np.arange(n - k)] = band[k, : n - k]
    assert relative(dense, np.tril(full[:n, :n])) < 1e-12
