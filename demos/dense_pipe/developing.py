# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of developing.toml in Python: the pipe of case 3 from inlet to outlet."""

import fem_tfm as ft

pipe = ft.Pipe(diameter=0.010, length=2.4)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
model = ft.TwoFluid(
    nitrogen, coal, turbulence="realizable-4eq", gas_wall="log-law-k", wall_distance=3.2e-4
)
feed = ft.Feed(6.43, solids_fraction=0.245, solids_velocity=6.09, outlet_pressure=2.92e6)
scene = ft.Developing(model, pipe, feed, resolution=ft.Resolution(level=1))

if __name__ == "__main__":
    print(scene.run("results/developing", overwrite=True, quiet=False)["pressure_drop"])
