# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains that follow the eddies: one fluid when small, suspended when light, unknown when large."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sections import quantities, solve

from fem_tfm import Case
from fem_tfm.correlations import friction_velocity, terminal_velocity
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.output.fields import snapshot
from fem_tfm.output.pictures import SectionView, vertical_profile
from fem_tfm.scenes import dense
from fem_tfm.scenes.judged import plausible
from fem_tfm.solvers import nested

# 50 mm pipe, 1400 kg/m3; loading 0.88 without gravity
BASE: dict[str, Any] = {
    "geometry": {"diameter": 0.05, "length": 10.0},
    "gas": {"density": 2.4, "viscosity": 1.8e-5},
    "solids": {"density": 1400.0, "diameter": 1e-6},
    "operation": {
        "gas_superficial_velocity": 12.0,
        "solids_mass_flow": 0.05,
        "gravity": 0.0,
    },
    "numerics": {"level": 1},
}
MIXTURE = 2.4 * (1 + 0.05 / (2.4 * 12 * math.pi * 0.025**2))


def case(**changes: Any) -> Case:
    given = {key.replace("__", "."): value for key, value in changes.items()}
    return Case.from_dict(BASE).with_values(given)


@functools.cache
def solved(**changes: Any) -> nested.Solution:
    return solve(case(**changes))


def gradient(**changes: Any) -> float:
    return quantities(solved(**changes))["pressure_gradient"]


REALIZABLE = {"closures__turbulence": "realizable"}
BY_ENERGY = {**REALIZABLE, "walls__gas": "log-law-k"}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        pytest.param(REALIZABLE, marks=pytest.mark.slow),
        pytest.param(BY_ENERGY, marks=pytest.mark.slow),
    ],
)
def test_a_micrometre_makes_a_heavier_gas(changes: dict[str, Any]) -> None:
    alone = gradient(solids=None, operation__solids_mass_flow=None, gas__density=MIXTURE, **changes)
    assert gradient(**changes) == pytest.approx(alone, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [REALIZABLE, BY_ENERGY])
def test_tracers_are_the_mixture(changes: dict[str, Any]) -> None:
    """0.1 um: tau_F u_tau^2/nu = 0.01, and nothing is left of the lag."""
    alone = gradient(solids=None, operation__solids_mass_flow=None, gas__density=MIXTURE, **changes)
    assert gradient(solids__diameter=1e-7, **changes) == pytest.approx(alone, rel=0.002)


@pytest.mark.parametrize("diameter", [1.6e-4, pytest.param(3.2e-4, marks=pytest.mark.slow)])
def test_large_grains_do_not_follow(diameter: float) -> None:
    still = gradient(solids__diameter=diameter, closures__dispersed="none")
    assert gradient(solids__diameter=diameter) == pytest.approx(still, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("diameter", [1e-6, 5e-6])
def test_the_wall_distance_does_not_matter(diameter: float) -> None:
    """A factor of six in the distance, y+ from 19 to 115."""
    found = [
        gradient(solids__diameter=diameter, walls__distance=distance)
        for distance in (2.5e-4, 5e-4, 1.5e-3)
    ]
    assert found == pytest.approx([found[1]] * 3, rel=0.02)


# -- suspension --------------------------------------------------------------------------------


AIR = {"gas__density": 1.2, "operation__gas_superficial_velocity": 4.0, "operation__gravity": 9.81}


def rouse_number(diameter: float) -> float:
    scene = case(solids__diameter=diameter, **AIR).scene
    u_tau = friction_velocity(4.0, 0.05, 1.5e-5)
    return terminal_velocity(scene.model.gas, scene.model.solids, 9.81) / (0.41 * u_tau)


@pytest.mark.parametrize(
    ("diameter", "least", "most"),
    [
        pytest.param(1e-5, 0.0, 0.003, marks=pytest.mark.slow),
        (2.5e-5, 0.002, 0.1),
        (8e-5, 0.3, 0.63),
    ],
)
def test_powders_stay_up_and_sand_makes_a_bed(diameter: float, least: float, most: float) -> None:
    """Loading 1, a mean fraction of 9e-4, at Rouse numbers of 0.04, 0.27 and 2.4."""
    found = solved(solids__diameter=diameter, operation__solids_mass_flow=0.00942, **AIR)
    assert rouse_number(1e-5) < 0.1 < rouse_number(2.5e-5) < 0.3 < 1 < rouse_number(8e-5)
    assert least < found.section.extremes()["max_alpha_s"] < most


def test_a_powder_of_40_micrometres_is_carried_in_suspension() -> None:
    """12 m/s, Rouse number 0.26: the gas keeps up what it carries and does not outrun it."""
    found = quantities(solved(solids__diameter=4e-5, operation__gravity=9.81))
    assert found["max_solids_fraction"] < 0.02
    assert abs(found["slip_velocity"]) < 0.3


def slope(section: TwoFluidSection) -> float:
    """-R d(ln alpha_s)/dy over the middle half of the vertical diameter [-]."""
    moment = snapshot(section.mesh.mesh, section.fields())
    view = SectionView.of_cells(
        moment.points, moment.cells, moment.kind, section.mesh.section.symmetry
    )
    profile = vertical_profile(view, dict(moment.nodal))
    height = np.asarray(profile["y"]) / 0.025
    middle = abs(height) < 0.5
    return -np.polyfit(height[middle], np.log(np.asarray(profile["alpha_s"])[middle]), 1)[0]


@pytest.mark.parametrize(
    ("holdup", "error"),
    [
        pytest.param(1e-4, 0.2, marks=pytest.mark.slow),
        pytest.param(1e-6, 0.3, marks=pytest.mark.slow),
    ],
)
def test_a_dilute_suspension_has_the_profile_of_rouse(holdup: float, error: float) -> None:
    """w_t R/D, D = nu_t/0.9 and nu_t = 0.0765 u_tau R of the core, at a Rouse number of 0.27."""
    found = solved(
        solids__diameter=2.5e-5,
        operation__solids_mass_flow=None,
        operation__solids_fraction=holdup,
        closures__turbulence="realizable",
        numerics__level=2,
        **AIR,
    )
    expected = 0.41 * rouse_number(2.5e-5) * 0.9 / 0.0765
    assert slope(found.section) == pytest.approx(expected, rel=error)


@pytest.mark.slow
def test_grains_that_the_gas_brakes_spread_less() -> None:
    """Rouse number 0.83: 12 % above Rouse's slope with drag in the free path, else 16 % below."""
    slopes = {
        law: slope(
            solved(
                solids__diameter=4.5e-5,
                operation__solids_mass_flow=None,
                operation__solids_fraction=1e-4,
                closures__free_path=law,
                numerics__level=2,
                **AIR,
            ).section
        )
        for law in ("none", "agrawal")
    }
    expected = 0.41 * rouse_number(4.5e-5) * 0.9 / 0.0765
    assert slopes["agrawal"] == pytest.approx(expected, rel=0.15)
    assert slopes["none"] < 0.9 * expected


# -- what is told ------------------------------------------------------------------------------


def test_the_default_of_a_gas_without_turbulence_disperses_nothing() -> None:
    model = case(closures__turbulence="laminar").scene.model
    assert model.dispersed.name == model.dispersion.name == "none"
    model = case().scene.model
    assert (model.dispersed.name, model.dispersion.name) == ("tchen", "burns")
    named = case(closures__turbulence="laminar", closures__dispersion="burns").scene.model
    assert named.dispersion.name == "burns"


def test_the_sink_of_simonin_is_warned_of_where_it_makes_the_gas_laminar() -> None:
    laws = {"closures__turbulence": "k-epsilon", "closures__dispersed": "simonin"}
    assert any(
        "laminar" in text for text in dense.advice(case(solids__diameter=5e-6, **laws).scene)
    )
    for diameter, law in ((1.6e-4, "simonin"), (5e-6, "tchen")):
        changes = {**laws, "closures__dispersed": law, "solids__diameter": diameter}
        assert not any("simonin" in text for text in dense.advice(case(**changes).scene))


# -- risers ------------------------------------------------------------------------------------


RISER = Path(__file__).parents[1] / "cases/riser_of_rautiainen.toml"
# gas velocity [m/s], flux of solids [kg/m2/s], gradient [Pa/m] and hold-up measured
MEASURED = [
    pytest.param(8.06, 10.5, 35.3, 0.00058, marks=pytest.mark.slow),
    pytest.param(12.73, 49.1, 95.0, 0.00183, marks=pytest.mark.slow),
    pytest.param(8.22, 49.1, 103.7, 0.00344, marks=pytest.mark.slow),
]


@functools.cache
def riser() -> Case:
    return Case.load(RISER)


@pytest.mark.parametrize(("speed", "flux", "drop", "holdup"), MEASURED)
def test_a_riser_of_fine_grains(speed: float, flux: float, drop: float, holdup: float) -> None:
    """With clusters and a rough wall, within 20 % of Rautiainen et al. (1999)."""
    given = riser().with_values(
        {
            "operation.gas_superficial_velocity": speed,
            "operation.solids_superficial_velocity": flux / 2450.0,
        }
    )
    found = quantities(solve(given))
    assert found["pressure_gradient"] == pytest.approx(drop, rel=0.2)
    assert found["holdup"] == pytest.approx(holdup, rel=0.2)
    assert not any("clusters" in text for text in given.scene.warnings())


def uniform() -> Case:
    return riser().with_values({"closures.drag": "three-zone", "walls.solids": "schneiderbauer"})


def test_a_riser_with_the_drag_of_a_uniform_suspension_is_warned_of() -> None:
    assert any("clusters" in text for text in uniform().scene.warnings())


@pytest.mark.slow
def test_friction_far_below_the_correlations_is_told() -> None:
    found = quantities(solve(uniform()))
    # of 1 m, as the scene's line is
    assert uniform().scene.geometry.length == 1.0
    (told,) = plausible.out_of_range(uniform().scene, found)
    # a rough wall does not mend a riser
    assert "leave their range" in told and "'rough'" not in told
