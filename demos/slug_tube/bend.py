# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of bend.toml in Python: slugs through a bend upwards, and the wear of its wall."""

import fem_tfm as ft

gas = ft.TubeGas(viscosity=6.73e-5, density=1.2, reference_pressure=101325.0)
grains = ft.Grain(density=937.0, diameter=1.4e-3)
scene = ft.Slug(
    ft.DiscreteElements(gas, grains, wear="finnie"),
    ft.Bend(diameter=0.007, length=0.45, bend_start=0.25, bend_radius=0.035, bend_towards="up"),
    ft.Conveying(gas_velocity=1.0, solids_mass_flow=6.9167e-4, solids_velocity=0.04),
    numerics=ft.TubeNumerics(end_time=16.0),
    averages=ft.Averages(begin=6.0, low=0.12, high=0.24),
)

if __name__ == "__main__":
    print(scene.run("results/slug_bend", overwrite=True, quiet=False)["bend_drop"])
