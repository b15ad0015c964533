# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings about cases that were probably not meant, and what `check` tells."""

import re
from pathlib import Path
from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.correlations import friction_velocity
from fem_tfm.geometry.resolution import WALL_RATIO


@pytest.fixture
def demo(root: Path) -> Case:
    return Case.load(root / "demos/dense_pipe/algebraic.toml")


def test_the_demo_needs_no_advice(demo: Case) -> None:
    assert demo.scene.warnings() == []


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"closures.friction": "schaeffer"}, "packed fraction"),
        ({"closures.friction": "syamlal"}, "packed fraction"),
        ({"closures.turbulence": "laminar"}, "laminar at a Reynolds number"),
        ({"walls.gas": "no-slip", "numerics.wall_grading": 0.25}, "viscous lengths"),
    ],
)
def test_advice(demo: Case, changes: dict[str, Any], part: str) -> None:
    (sentence,) = demo.with_values(changes).scene.warnings()
    assert part in sentence


def test_a_packed_friction_limit_is_fine(demo: Case) -> None:
    changes = {"closures.friction": "schaeffer", "solids.friction_limit": 0.58}
    assert demo.with_values(changes).scene.warnings() == []


def test_describe_tells_what_is_solved_and_skipped(demo: Case) -> None:
    told = demo.scene.describe()
    assert "hold-up 0.245" in told["given"]
    assert "320 cells" in told["finest_mesh"]
    assert any("mirror" in line for line in told["skipped"])
    assert "friction: berzi" in told["closures"]


def test_transported_turbulence_is_told_to_cost_more(demo: Case) -> None:
    """Four more unknowns take longer to solve for and to compile."""
    laws = {"closures.turbulence": "realizable", "closures.dispersed": "k-epsilon"}
    four = demo.with_values(laws)
    seconds = [
        [int(n) for n in re.findall(r"(\d+) s", c.scene.describe()["time"])] for c in (demo, four)
    ]
    assert [len(s) for s in seconds] == [2, 2]
    assert seconds[1][0] > 2 * seconds[0][0]
    assert seconds[1][1] > 2 * seconds[0][1]


def test_a_resolved_wall_chooses_its_distance_and_cells(demo: Case) -> None:
    """y+ = 2 of the gas alone, by the distance and by the height of the wall cell."""
    scene = demo.with_values({"walls.gas": "low-reynolds"}).scene
    viscosity = scene.model.gas.viscosity / scene.model.gas.density
    unit = viscosity / friction_velocity(6.43, 0.01, viscosity)
    assert scene.wall_offset == pytest.approx(2 * unit)
    resolution = scene.physics.resolution
    core = resolution.core_size(scene.section)
    assert resolution.wall_ratio * core == pytest.approx(2 * unit)
    assert demo.scene.physics.resolution.wall_ratio == WALL_RATIO


def test_a_turbulent_gas_on_a_wall_that_holds_it_gets_cells_in_the_sublayer(demo: Case) -> None:
    """As with `low-reynolds`; a laminar gas needs none."""
    held = demo.with_values({"walls.gas": "no-slip"})
    viscosity = held.scene.model.gas.viscosity / held.scene.model.gas.density
    unit = viscosity / friction_velocity(6.43, 0.01, viscosity)
    resolution = held.scene.physics.resolution
    assert resolution.wall_ratio * resolution.core_size(held.scene.section) == pytest.approx(
        2 * unit
    )
    assert held.scene.warnings() == []
    for changes in (
        {"closures.turbulence": "laminar"},
        {"operation.gas_superficial_velocity": 0.05},
        {"walls.gas": "free-slip"},
    ):
        laminar = held.with_values(changes).scene.physics.resolution
        assert laminar.wall_ratio == WALL_RATIO


def test_the_diffusion_of_voids_goes_with_the_holdup(demo: Case) -> None:
    """h/(h + 0.01) of it, and a residual fraction of 0.001 h; a stated diffusion stays."""
    numerics = {
        h: demo.with_values({"operation.solids_fraction": h}).scene.physics.setup().numerics
        for h in (0.245, 1e-4)
    }
    shares = [n.alpha_diffusion / (1.5e-7 * 6.43 * 0.01) for n in numerics.values()]
    assert shares == pytest.approx([0.245 / 0.255, 1e-4 / 1.01e-2])
    assert [n.residual_fraction for n in numerics.values()] == pytest.approx([2.45e-4, 1e-7])
    stated = demo.with_values({"numerics.alpha_diffusion": 1e-8}).scene.physics.setup()
    assert stated.numerics.alpha_diffusion == 1e-8
