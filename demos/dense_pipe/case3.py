# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of case3.toml in Python: pulverised coal in nitrogen, developed."""

import fem_tfm as ft

pipe = ft.Pipe(diameter=0.010, length=2.4)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
model = ft.TwoFluid(
    nitrogen,
    coal,
    turbulence="realizable",
    dispersed=ft.laws.DispersedKEpsilon(normal_stress=1.0),
    gas_wall="log-law-k",
    wall_distance=3.2e-4,
)
feed = ft.Feed(gas_velocity=6.43, solids_mass_flow=0.194, outlet_pressure=2.92e6)
scene = ft.Developed(model, pipe, feed)

if __name__ == "__main__":
    print(scene.run("results/case3", overwrite=True, quiet=False)["pressure_drop"])
