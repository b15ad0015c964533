# SPDX-License-Identifier: LGPL-3.0-or-later
"""The split of the pressure gradient: friction of either phase, lift of both, acceleration.

The axial momentum of both phases, over the area A of the section, reads

    -dP/dz = F_g/A + F_s/A - g_z [rho_g (1 - holdup) + rho_s holdup] + d/dz (momentum flux)/A

F are the forces of the walls per length. Each part is found on its own, so that their sum tells
how well momentum is balanced.
"""

from __future__ import annotations

from fem_tfm.models.two_fluid.section import TwoFluidSection

GAS, SOLIDS = "drop_gas_friction", "drop_solids_friction"
LIFT, ACCELERATION = "drop_lift", "drop_acceleration"
# in an unsteady flow whose solids pressure acts without its share by grad(Theta)
OMITTED = "drop_omitted_pressure"


def split(section: TwoFluidSection) -> dict[str, float]:
    """Friction of the walls and lift at a section, per length [Pa/m]."""
    setup, area, forces = section.setup, section.area, section.wall_forces()
    held = mass = 0.0
    if setup.solids is not None:
        held = section.integral("held", section.model.alpha(section.state(section.now))) / area
        mass = setup.solids.density * held
    found = {GAS: forces["gas"] / area}
    if "solids" in forces:
        found[SOLIDS] = forces["solids"] / area
    return found | {LIFT: -setup.gravity[2] * (mass + setup.gas.density * (1 - held))}
