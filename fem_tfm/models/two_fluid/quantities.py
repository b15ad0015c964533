# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers and balances of a two-fluid section, in the units of `output.result.QUANTITIES`."""

from __future__ import annotations

import ufl

from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.models.two_fluid.split import ACCELERATION, split


def pressure_gradient(section: TwoFluidSection) -> float:
    """-dP/dz with the weight of the gas, from P = p + rho_g g.x - G z [Pa/m]."""
    setup = section.setup
    return float(section.drive.value) - setup.gas.density * setup.gravity[2]


def quantities(section: TwoFluidSection, length: float) -> dict[str, float]:
    """Numbers of a developed section, in the units of `QUANTITIES`; whole section."""
    model, state, setup = section.model, section.state(section.now), section.setup
    alpha, whole = model.alpha(state), section.mesh.section.area_factor
    gradient = pressure_gradient(section)
    gas = section.integral("gas flux", (1 - alpha) * state.u_g[2])
    found = {
        "pressure_gradient": gradient,
        "pressure_drop": gradient * length,
        **{name: part * length for name, part in split(section).items()},
        # nothing changes along the axis
        ACCELERATION: 0.0,
        "gas_mass_flow": whole * setup.gas.density * gas,
    }
    if setup.solids is None:
        return found
    solids = section.integral("solids flux", alpha * state.u_s[2])
    held = section.integral("held", alpha)
    in_bed = ufl.conditional(ufl.gt(alpha, model.at_point.grain.friction_limit), 1.0, 0.0)
    return found | {
        "solids_mass_flow": whole * setup.solids.density * solids,
        "holdup": held / section.area,
        "max_solids_fraction": section.extremes()["max_alpha_s"],
        "bed_fraction": section.integral("bed", in_bed) / section.area,
        "slip_velocity": gas / (section.area - held) - solids / held,
    }


def balances(section: TwoFluidSection) -> dict[str, float]:
    """Relative errors of the balances of mass and axial momentum.

    Momentum: G A + axial weight of the solids in the gas = force of the walls. Mass: error of the
    imposed flux or hold-up, and for the solids the source that the steady state must not need.
    """
    setup, model, state = section.setup, section.model, section.state(section.now)
    errors = [
        abs(error / float(border.target.value))
        for error, border in zip(
            section.newton.constraint_errors(), section.newton.borders, strict=True
        )
    ]
    drive = float(section.drive.value) * section.area
    weight = 0.0
    if setup.solids is not None:
        excess = setup.solids.density - setup.gas.density
        weight = excess * setup.gravity[2] * section.integral("held", model.alpha(state))
    force = section.wall_force()
    scale = max(abs(drive), abs(weight), abs(force))
    found = {"gas_mass": errors[0], "axial_momentum": abs(drive + weight - force) / scale}
    if setup.solids is not None:
        turnover = section.mesh.section.hydraulic_diameter / setup.gas_velocity
        found["solids_mass"] = max(errors[1], abs(float(section.source.value)) * turnover)
    return found
