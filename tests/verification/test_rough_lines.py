# SPDX-License-Identifier: LGPL-3.0-or-later
"""Level lines in air with the rough wall beside the friction of Prandtl, Konno and Saito."""

from __future__ import annotations

from typing import Any

import pytest
from sections import quantities, solve

from fem_tfm import Case
from fem_tfm.scenes.judged.plausible import friction_estimate

# diameter [m], grains [kg/m3] and [m], gas [m/s], flow of solids [kg/s]
PELLETS = (0.1, 920.0, 3e-3, 23.0, 1.0)
COAL = (0.05, 1400.0, 1e-3, 20.0, 0.2365)
FLOUR = (0.08, 1470.0, 7e-5, 18.0, 0.545)


def line(of: tuple[float, ...], walls: str) -> Case:
    width, density, diameter, speed, flow = of
    given: dict[str, Any] = {
        "geometry": {"diameter": width, "length": 50.0},
        "gas": {"species": "air", "pressure": 1.013e5},
        "solids": {"density": density, "diameter": diameter},
        "operation": {"gas_superficial_velocity": speed, "solids_mass_flow": flow},
        "walls": {"solids": walls},
        "numerics": {"level": 1},
    }
    return Case.from_dict(given)


@pytest.mark.slow
@pytest.mark.parametrize("of", [PELLETS, COAL, FLOUR], ids=["3 mm", "1 mm", "70 um"])
def test_lines_with_a_rough_wall(of: tuple[float, ...]) -> None:
    """Within 20 %, where the flat wall misses a quarter at least."""
    rough, flat = (quantities(solve(line(of, law))) for law in ("rough", "schneiderbauer"))
    scene = line(of, "rough").scene
    expected = sum(friction_estimate(scene, of[-1] / scene.geometry.area))
    assert rough["pressure_gradient"] == pytest.approx(expected, rel=0.2)
    assert flat["pressure_gradient"] < 0.75 * expected
    # above Rizk's velocity there is no bed
    assert rough["max_solids_fraction"] < 0.1
