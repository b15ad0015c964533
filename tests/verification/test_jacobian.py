# SPDX-License-Identifier: LGPL-3.0-or-later
"""The Jacobian: every block against finite differences, and every parameter seen by Newton."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np
import problems
import pytest
from dolfinx import fem

from fem_tfm.closures import make, names
from fem_tfm.models.two_fluid.section import NAMES
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section
from fem_tfm.scenes.dense import setup_of

CELL = 1 / 4
TOLERANCE = 1e-6
# of a difference, over the scale of a field: round-off of large rows hides in one, kinks in another
STEPS = (1e-6, 1e-4)
# with these every law of a family is met once; the first two are the quick ones
DEFAULT: dict[str, Any] = {}
OTHER = {
    "closures.theta": "algebraic",
    "closures.drag": "syamlal-obrien",
    "closures.radial": "lun-savage",
    "closures.granular": "hrenya-sinclair",
    "closures.friction": "srivastava-sundaresan",
    "closures.turbulence": "laminar",
    "walls.gas": "no-slip",
    "walls.solids": {"model": "johnson-jackson", "friction_angle_deg": 20.0},
}
# what is off by default
OPTIONS = {
    "closures.slip_production": "koch",
    "closures.free_path": "agrawal",
    "closures.pressure_force": "alpha",
}
# plastic pressures at the demo's friction limit: 1e14 Pa would drown the other terms in round-off
MILD = {name: {"model": name, "coefficient": 1e12} for name in ("schaeffer", "syamlal")}
FEEDS = "closures.friction_feeds_theta"
FAMILIES = {
    "friction": "closures.friction",
    "drag": "closures.drag",
    "radial": "closures.radial",
    "granular": "closures.granular",
    "solids-wall": "walls.solids",
    "gas-wall": "walls.gas",
    "slip-production": "closures.slip_production",
    "free-path": "closures.free_path",
}
FORCES = "full", "alpha"


def _every_law() -> list[Any]:
    """Cases that meet every law of every family, number i with law i of each."""
    laws = {key: names(family) for family, key in FAMILIES.items()}
    # wall laws by the turbulent energy are tested with what transports it
    laws["walls.gas"] = [n for n in names("gas-wall") if not make("gas-wall", n).needs_k]
    cases = []
    for i in range(max(map(len, laws.values()))):
        chosen = {key: found[i % len(found)] for key, found in laws.items()}
        label = "+".join(chosen.values())
        friction = MILD.get(chosen["closures.friction"], chosen["closures.friction"])
        changes = {**chosen, "closures.friction": friction, FEEDS: i % 2 == 0}
        changes["closures.pressure_force"] = FORCES[i // 2 % 2]
        cases.append(pytest.param(changes, id=label))
    return cases


@cache
def _solution() -> tuple[Any, np.ndarray, float]:
    """Mesh, unknowns and G of the demo on a coarse mesh."""
    found = problems.solved(problems.demo(), CELL)
    return found.mesh, found.now.x.array.copy(), float(found.drive.value)


def disturbed(changes: dict[str, Any]) -> Section:
    """Closures as given, at the demo's answer with every unknown moved, within a time step."""
    mesh, answer, drive = _solution()
    found = Section(mesh, setup_of(problems.demo(changes).scene))
    random = np.random.default_rng(3)
    found.old.x.array[:] = answer
    found.now.x.array[:] = answer
    # slow enough for collisions at the wall to stick now and then
    found.now.x.array[next(b.dofs for b in found.newton.blocks if b.name == "u_s")] *= 0.1
    for block in found.newton.blocks:
        noise = random.standard_normal(block.dofs.size)
        found.now.x.array[block.dofs] += 0.1 * block.scale * noise
    found.idt.value, found.drive.value, found.source.value = 300.0, drive, 20.0
    # of the size of the other terms, for else the finite difference cannot see it
    found.model.numerics.pressure_shift.value *= 1e7
    return found


@cache
def section(which: str) -> Section:
    """A disturbed section by the name of its closures."""
    return disturbed({"default": DEFAULT, "other": OTHER, "options": OPTIONS}[which])


@dataclass(frozen=True)
class Linear:
    """Residual and Jacobian without Dirichlet conditions, block by block."""

    section: Section

    def residual(self) -> np.ndarray:
        """Assembled residual."""
        return fem.assemble_vector(self.section.newton.residual).array.copy()

    def matrix(self) -> Any:
        """Assembled Jacobian (SciPy, compressed rows)."""
        return fem.assemble_matrix(self.section.newton.jacobian).to_scipy()

    def rows(self, name: str) -> np.ndarray:
        """Unknowns of a field."""
        return next(b.dofs for b in self.section.newton.blocks if b.name == name)

    def direction(self, name: str, seed: int) -> tuple[np.ndarray, float]:
        """A random change of one field and its typical size."""
        block = next(b for b in self.section.newton.blocks if b.name == name)
        found = np.zeros(self.section.now.x.array.size)
        random = np.random.default_rng(seed)
        found[block.dofs] = random.standard_normal(block.dofs.size)
        return found, block.scale

    def difference(self, along: np.ndarray, step: float) -> np.ndarray:
        """Central difference of fourth order of the residual along a direction."""
        x = self.section.now.x.array
        start, total = x.copy(), 0.0
        for k, weight in ((1, 2 / 3), (2, -1 / 12)):
            for sign in (1, -1):
                x[:] = start + sign * k * step * along
                total = total + sign * weight * self.residual()
        x[:] = start
        return total / step


def compare(found: Section, name: str) -> dict[str, float]:
    """Relative difference of each block in the columns of one field; no entry where it is zero."""
    linear, errors = Linear(found), {}
    along, scale = linear.direction(name, 7)
    exact = linear.matrix() @ along
    differences = [linear.difference(along, step * scale) for step in STEPS]
    for row in found.names:
        here = linear.rows(row)
        size = np.linalg.norm(exact[here])
        if size == 0:
            assert not any(seen[here].any() for seen in differences), f"d{row}/d{name} is missing"
        else:
            errors[row] = min(
                float(np.linalg.norm((seen - exact)[here]) / size) for seen in differences
            )
    return errors


# blocks that physics leaves empty: row, column
EMPTY = {"u_g": {"q"}, "p": {"q", "c"}, "u_s": set(), "q": set(), "c": {"u_g", "p", "q"}}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("which", ["default", "other", "options"])
def test_every_block(which: str, name: str) -> None:
    """Columns of one field: right to 1e-6 in every row, and empty only where they must be."""
    errors = compare(section(which), name)
    assert max(errors.values()) < TOLERANCE, errors
    assert set(NAMES) - set(errors) == EMPTY[name]


def test_rates_of_the_mesh_that_are_held() -> None:
    """Held at the state itself they change no residual, at another one they do; Newton sees it."""
    found = section("default")
    linear, before = Linear(found), found.old.x.array.copy()
    found.idt.value = 0.0
    try:
        free = linear.residual()
        found.lag.value = 1.0
        held = linear.residual()
        errors = compare(found, "u_s")
        found.old.x.array[:] = found.now.x.array
        same = linear.residual()
    finally:
        found.lag.value, found.idt.value = 0.0, 300.0
        found.old.x.array[:] = before
    size = np.linalg.norm(free)
    assert np.linalg.norm(same - free) < 1e-12 * size < 1e-6 * np.linalg.norm(held - free)
    assert max(errors.values()) < TOLERANCE, errors


@pytest.mark.slow
@pytest.mark.parametrize("changes", _every_law())
def test_every_block_of_every_law(changes: dict[str, Any]) -> None:
    """The same with every law of every family."""
    found = disturbed(changes)
    for name in NAMES:
        errors = compare(found, name)
        assert max(errors.values()) < TOLERANCE, (name, errors)


def test_borders() -> None:
    """Columns of the multipliers and rows of the constraints, against finite differences."""
    found = section("default")
    linear, x = Linear(found), found.now.x.array
    start = x.copy()
    for border in found.newton.borders:
        column, row = (fem.assemble_vector(f).array for f in (border.column, border.row))
        value = float(border.multiplier.value)
        border.multiplier.value = 2 * value
        change = linear.residual()
        border.multiplier.value = value
        # linear in the multiplier, so that one difference is exact
        change -= linear.residual()
        assert change == pytest.approx(value * column, abs=1e-9 * abs(change).max())
        for block in found.newton.blocks:
            along, scale = linear.direction(block.name, 5)
            x[:] = start + 1e-4 * scale * along
            above = fem.assemble_scalar(border.constraint)
            x[:] = start - 1e-4 * scale * along
            below = fem.assemble_scalar(border.constraint)
            x[:] = start
            size = np.linalg.norm(row[block.dofs]) * 1e-4 * scale
            slope = 2e-4 * scale * (row @ along)
            assert above - below == pytest.approx(slope, abs=1e-6 * size)


def parameters(found: Section) -> dict[str, fem.Constant]:
    """Every constant of the forms by a readable name."""
    model = found.model
    groups = {"gas": model.gas, "solids": model.solids, "numerics": model.numerics}
    groups |= {"domain": model.domain}
    laws = {f.name: getattr(model.closures, f.name) for f in fields(model.closures)}
    groups |= {name: law for name, law in laws.items() if hasattr(law, "__dataclass_fields__")}
    known = {"gravity": model.gravity, "idt": found.idt, "drive": found.drive}
    known["source"] = found.source
    for group, values in groups.items():
        numbers = {f.name: getattr(values, f.name) for f in fields(values)}
        constants = {n: c for n, c in numbers.items() if isinstance(c, fem.Constant)}
        known |= {f"{group}.{name}": constant for name, constant in constants.items()}
    return known


def unseen(found: Section) -> set[str]:
    """Names of the constants that leave the Jacobian as it is when they grow by a tenth."""
    linear, inert = Linear(found), set()
    before = linear.matrix().data.copy()
    for name, constant in parameters(found).items():
        value = constant.value.copy()
        constant.value = 1.1 * value
        after = linear.matrix().data
        constant.value = value
        # entry by entry, so that a small term among large ones counts as well
        changed = np.abs(after - before) > 1e-9 * np.abs(before)
        if not changed.any():
            inert.add(name)
    return inert


# lag, smoothing and bound are those of an algebraic Theta; that has no flux through walls, hence no
# restitution there, and a laminar gas held by the wall knows neither eddies nor their length;
# grains that take no turbulence leave none, neither a gap nor a fade in voids nor a barrier to
# packing is asked for, and no bed is as stiff as the cap
OFF = {
    "numerics.k_floor",
    "numerics.grain_gap",
    "numerics.void_fraction",
    "numerics.packing_pressure",
    "numerics.max_frictional_viscosity",
}
INERT = {
    "default": {"numerics.relaxation", "numerics.smoothing", "numerics.theta_free", *OFF},
    "other": {
        "domain.wall_offset",
        *OFF,
        "numerics.shear_floor",
        "solids_wall.restitution",
    },
}


@pytest.mark.parametrize("which", INERT)
def test_every_parameter_is_seen(which: str) -> None:
    """A term that Newton cannot see is inert: each parameter changes the Jacobian."""
    assert unseen(section(which)) == INERT[which]
