# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of startup.toml in Python: the first 0.3 m of case 3, filled from rest."""

import fem_tfm as ft

pipe = ft.Pipe(diameter=0.010, length=0.3)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
model = ft.TwoFluid(
    nitrogen, coal, turbulence="realizable-4eq", gas_wall="log-law-k", wall_distance=3.2e-4
)
opens = [[0.0, 0.0], [0.005, 1.0]]
feed = ft.Feed(6.43, solids_fraction=0.245, solids_velocity=6.09, solids_schedule=opens)
scene = ft.Unsteady(
    model,
    pipe,
    feed,
    numerics=ft.TimeNumerics(end_time=0.1, courant=2.0),
    resolution=ft.Resolution(level=1, axial_cells=150),
)

if __name__ == "__main__":
    print(scene.run("results/startup", overwrite=True, quiet=False)["pressure_drop"])
