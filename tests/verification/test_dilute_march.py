# SPDX-License-Identifier: LGPL-3.0-or-later
"""Marches of dilute lines and along rough walls start from the default inlet and reach the end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sections import line_of

from fem_tfm import Case

AIR = {"species": "air", "pressure": 1.0e5}
RISER: dict[str, Any] = {
    "solution": "developing",
    "geometry": {"diameter": 0.05, "length": 10.0, "inclination_deg": 90.0},
    "gas": AIR,
    "solids": {"density": 2500.0, "diameter": 2.0e-4},
    "operation": {"gas_superficial_velocity": 12.0, "solids_mass_flow": 0.1},
    "numerics": {"level": 1},
}
LEVEL_LINES: dict[str, dict[str, Any]] = {
    "PE": {
        "geometry": {"diameter": 0.1, "length": 0.1},
        "solids": {"density": 920.0, "diameter": 3.0e-3},
        "operation": {"gas_superficial_velocity": 23.0, "solids_mass_flow": 1.0},
    },
    "coal": {
        "geometry": {"diameter": 0.05, "length": 0.1},
        "solids": {"density": 1400.0, "diameter": 1.0e-3},
        "operation": {"gas_superficial_velocity": 20.0, "solids_mass_flow": 0.233},
    },
    "glass": {"geometry": {"diameter": 0.05, "length": 0.1}},
    "pellets": {
        "geometry": {"diameter": 0.08, "length": 0.1},
        "solids": {"density": 920.0, "diameter": 3.0e-3},
        "operation": {"gas_superficial_velocity": 22.0, "solids_mass_flow": 0.3},
    },
}
ROUGH: dict[str, Any] = {
    "solution": "developing",
    "geometry": {"diameter": 0.010, "length": 0.004},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {
        "density": 1400.0,
        "diameter": 1.0e-4,
        "restitution": 0.95,
        "packing_limit": 0.63,
        "friction_limit": 0.55,
    },
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.2,
        "solids_velocity": 6.5,
        "gravity": 0.0,
    },
    "inlet": {"profile": "uniform"},
    "closures": {
        "drag": "gidaspow",
        "radial": "sinclair-jackson",
        "granular": "gidaspow",
        "friction": "johnson-jackson",
        "turbulence": "mixing-length",
    },
    "walls": {
        "gas": "log-law",
        "distance": 2e-4,
        "solids": {"model": "johnson-jackson", "specularity": 1.0, "restitution": 0.9},
    },
}


@pytest.mark.slow
def test_a_riser_develops_to_its_section() -> None:
    march = Case.from_dict(RISER).scene.run()
    section = Case.from_dict(RISER | {"solution": "developed"}).scene.run()
    assert march["pressure_gradient"] == pytest.approx(section["pressure_gradient"], rel=5e-3)
    assert march["holdup"] == pytest.approx(section["holdup"], rel=5e-3)
    assert march["development_length"] < 8.0


@pytest.mark.parametrize(
    ("name", "level"),
    [("coal", 1), *(pytest.param(name, 2, marks=pytest.mark.slow) for name in LEVEL_LINES)],
)
def test_a_dilute_level_line_starts(name: str, level: int) -> None:
    found = Case.from_dict(RISER | LEVEL_LINES[name] | {"numerics": {"level": level}}).scene.run()
    assert max(found.balances.values()) < 1e-9
    # the profile of the inlet heats the grains by less than its own energy
    table, speed = found.sections["axis"], RISER["operation"]["gas_superficial_velocity"]
    assert np.max(table["max_theta"]) < speed**2 / 3


@pytest.mark.slow
@pytest.mark.parametrize("level", [2, 3])
def test_a_march_along_a_rough_wall_starts(level: int) -> None:
    found = Case.from_dict(ROUGH | {"numerics": {"level": level}}).scene.run()
    assert found.status == "finished"
    assert found["drop_solids_friction"] > 1e3


def test_what_flows_across_upstream_does_not_push_along_the_axis() -> None:
    """A stress with d/dz of the velocities across in the axial balance makes waves grow."""
    line = line_of(Case.from_dict(RISER))
    line.begin()
    station, upstream = line.station, 1e4
    for weight, value in zip(station.weights, (upstream, -upstream, 0.0), strict=True):
        weight.value = value
    station.old.x.array[:] = station.older.x.array[:] = station.now.x.array
    kept, solids = station.old.x.array.copy(), station.space.sub(station.names.index("u_s"))
    across, along = (np.asarray(solids.sub(i).collapse()[1]).ravel() for i in (0, 2))

    def pushed(dofs: np.ndarray) -> float:
        """Largest change of the axial balance by a change upstream of 1e-3 m/s."""
        station.old.x.array[:] = kept
        rest = station.newton.assemble_residual()[along].copy()
        station.old.x.array[dofs] += 1e-3
        return float(np.abs(station.newton.assemble_residual()[along] - rest).max())

    # the laws see the whole motion, so that the viscosity changes a little
    assert pushed(across) < 0.01 * pushed(along)
