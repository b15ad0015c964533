# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of developing.toml in Python: the same air from the inlet of the duct on."""

import fem_tfm as ft

duct = ft.Duct(width=0.2, length=16.0)
air = ft.Gas(density=1.2, viscosity=1.8e-5, temperature=293.0)
heat = ft.Heat("temperature", wall_temperature=350.0)
scene = ft.Developing(
    ft.ReynoldsStress(air, heat=heat),
    duct,
    ft.Feed(22.0),
    inlet=ft.Inlet(gas_intensity=0.05, length_scale=0.07),
    resolution=ft.Resolution(level=2),
)

if __name__ == "__main__":
    print(scene.run("results/duct_developing", overwrite=True, quiet=False)["pressure_drop"])
