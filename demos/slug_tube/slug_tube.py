# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of slug_tube.toml in Python: slugs of plastic grains in a tube of 7 mm."""

import fem_tfm as ft

gas = ft.TubeGas(viscosity=6.73e-5, density=1.2, reference_pressure=101325.0)
scene = ft.Slug(
    ft.DiscreteElements(gas, ft.Grain(density=937.0, diameter=1.4e-3)),
    ft.Pipe(diameter=0.007, length=0.525),
    ft.Conveying(gas_velocity=1.0, solids_mass_flow=6.9167e-4, solids_velocity=0.04),
    numerics=ft.TubeNumerics(end_time=31.0),
    averages=ft.Averages(begin=9.0, low=0.2, high=0.45),
)

if __name__ == "__main__":
    print(scene.run("results/slug_tube", overwrite=True, quiet=False)["slug_velocity"])
