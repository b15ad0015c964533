# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flows that other programs have solved: an independent one-dimensional solver, OpenFOAM."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem_tfm import Case

PIPE: dict[str, Any] = {
    "flow": "dense",
    "geometry": {"shape": "pipe", "diameter": 0.010, "length": 1.0},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {
        "density": 1400.0,
        "diameter": 1.0e-4,
        "restitution": 0.95,
        "packing_limit": 0.63,
        "friction_limit": 0.62,
    },
    "operation": {"gas_superficial_velocity": 6.43, "solids_fraction": 0.2, "gravity": 0.0},
    "closures": {
        "drag": "wen-yu",
        "radial": "sinclair-jackson",
        "granular": "gidaspow",
        "friction": "none",
        "turbulence": "laminar",
    },
    "walls": {
        "gas": "no-slip",
        "solids": {"model": "johnson-jackson", "specularity": 0.1, "restitution": 0.7},
    },
    "numerics": {"level": 3},
    "output": {"pictures": False, "xdmf": False},
}


@pytest.mark.slow
def test_a_section_without_weight_is_that_of_a_one_dimensional_solver() -> None:
    """23,690 Pa/m and 0.2229 kg/s; the axis at 12.10 m/s, the wall at Theta 0.5815 m2/s2."""
    found = Case.from_dict(PIPE | {"solution": "developed"}).scene.run()
    gradient = found.quantities["pressure_gradient"]
    assert gradient.value == pytest.approx(23690, rel=0.006)
    assert gradient.error_estimate is not None
    assert abs(gradient.value - 23690) < gradient.error_estimate
    assert found["solids_mass_flow"] == pytest.approx(0.2229, rel=0.01)


HOT_WALL: dict[str, Any] = PIPE | {
    "solution": "developing",
    "geometry": {"shape": "pipe", "diameter": 0.010, "length": 0.3},
    "solids": {
        "density": 1400.0,
        "diameter": 1.0e-4,
        "restitution": 0.7,
        "packing_limit": 0.63,
        "friction_limit": 0.4,
        "friction_angle_deg": 28.5,
    },
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.245,
        "solids_velocity": 6.09,
    },
    "inlet": {"profile": "uniform", "solids_intensity": 0.01642},
    "closures": {
        "drag": "gidaspow",
        "radial": "sinclair-jackson",
        "granular": "gidaspow",
        "friction": "johnson-jackson",
        "turbulence": "k-epsilon",
    },
    "walls": {"gas": "log-law", "solids": PIPE["walls"]["solids"]},
    "numerics": {"level": 2},
}


ALPHA = {"closures.pressure_force": "alpha"}
STILL = {"closures.dispersed": "none", "closures.dispersion": "none"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "thirds", "holdup"),
    [
        (STILL, [57.4, 15.6, 13.3], 0.183),
        (ALPHA, [108.3, 45.4, 43.9], 0.1986),
        (ALPHA | STILL, [107.8, 42.7, 41.2], 0.1968),
    ],
)
def test_a_hot_wall_empties_itself(
    changes: dict[str, str], thirds: list[float], holdup: float, tmp_path: Path
) -> None:
    """Gradient [kPa/m] in the thirds of the line, and hold-up.

    OpenFOAM gives 83.0, 39.3 and 36.4 kPa/m, 0.1967 and gas of 11.5 m/s: its force of the solids
    pressure leaves out the gradient of Theta, as ALPHA does, and its grains know no eddies, as with
    STILL.
    """
    case = Case.from_dict(HOT_WALL).with_values(changes)
    found = case.scene.run(tmp_path)
    rows = np.genfromtxt(tmp_path / "axis.csv", delimiter=",", names=True)
    z, p = rows["z_m"], rows["pressure_Pa"]
    at = np.interp([0.0, 0.1, 0.2, 0.3], z, p)
    assert -np.diff(at) / 0.1 / 1000 == pytest.approx(thirds, rel=0.04)
    assert found["holdup"] == pytest.approx(holdup, rel=0.01)
    if "closures.pressure_force" in changes:
        assert rows["max_gas_velocity_ms"].max() == pytest.approx(11.9, rel=0.02)
    assert found.balances["axial_momentum"] < 1e-6
