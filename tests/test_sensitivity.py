# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives by the adjoint against the answers of neighbouring cases."""

from __future__ import annotations

from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.flows import dense, developed
from fem_tfm.sensitivity import Sensitivity, sensitivities

LIMITS = 1e-11, 200


def solved(case: Case) -> developed.Solution:
    return developed.solve(dense.meshes(case), dense.setup_of(case), *LIMITS, developed.QUIET)


@pytest.fixture
def upward(dense: dict[str, Any]) -> Case:
    """A rising line fed by mass, so that weight and feed depend on the densities too."""
    geometry = {**dense["geometry"], "inclination_deg": 10.0}
    operation = {"gas_superficial_velocity": 6.43, "solids_mass_flow": 0.194}
    walls = {"distance": 1e-4, "solids": {"model": "schneiderbauer", "sliding_heat": 1.0}}
    numerics = {"level": 1}
    return Case.from_dict(
        {**dense, "geometry": geometry, "operation": operation, "walls": walls}
        | {"numerics": numerics, "closures": {"drag": {"model": "three-zone", "C": 1.0}}}
    )


@pytest.mark.mpi
def test_the_adjoint_agrees_with_neighbouring_answers(upward: Case) -> None:
    keys = ("solids.density", "gas.density", "solids.diameter", "closures.drag.C", "walls.distance")
    solution = solved(upward)
    before = solution.section.now.x.array.copy()
    found = sensitivities(upward, solution.section, keys)
    assert (solution.section.now.x.array == before).all()
    for one in found:
        gradients = []
        for factor in (0.998, 1.002):
            case = upward.with_values({one.key: factor * one.value})
            solution = developed.resolve(solution, dense.setup_of(case), *LIMITS)
            gradients.append(dense.pressure_gradient(solution.section))
        measured = (gradients[1] - gradients[0]) / (0.004 * one.gradient)
        assert one.relative == pytest.approx(measured, rel=0.02, abs=1e-4), one.key


def test_a_number_at_the_end_of_its_range_has_a_derivative_too(upward: Case) -> None:
    key = "walls.solids.sliding_heat"
    solution = solved(upward)
    (share,) = sensitivities(upward, solution.section, [key])
    less = upward.with_values({key: 0.99})
    gradient = dense.pressure_gradient(
        developed.resolve(solution, dense.setup_of(less), *LIMITS).section
    )
    assert share.change(1.0, 0.99) == pytest.approx(gradient / share.gradient - 1, rel=0.05)


def test_what_is_no_number_or_moves_the_mesh_is_refused(upward: Case) -> None:
    section = solved(upward).section
    with pytest.raises(InputError, match="has a number"):
        sensitivities(upward, section, ["closures.friction"])
    with pytest.raises(InputError, match="leaves the mesh"):
        sensitivities(upward, section, ["geometry.diameter"])


def test_a_change_is_relative_to_the_gradient() -> None:
    one = Sensitivity("solids.density", 1700.0, -0.3, 2000.0)
    assert one.relative == pytest.approx(-0.255)
    assert one.change(1700.0, 1500.0) == pytest.approx(0.03)
