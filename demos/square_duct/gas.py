# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of gas.toml in Python: turbulent air with heat in a square duct, developed."""

import fem_tfm as ft

duct = ft.Duct(width=0.2, length=16.0)
air = ft.Gas(density=1.2, viscosity=1.8e-5)
model = ft.ReynoldsStress(air, heat=ft.Heat("flux", wall_flux=1000.0))
scene = ft.Developed(model, duct, ft.Feed(22.0), resolution=ft.Resolution(level=4))

if __name__ == "__main__":
    print(scene.run("results/gas", overwrite=True, quiet=False)["friction_factor"])
