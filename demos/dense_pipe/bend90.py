# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of bend90.toml in Python: a dense suspension in a bend upwards."""

import fem_tfm as ft

bend = ft.Bend(diameter=0.010, length=0.147, bend_radius=0.030, bend_start=0.050)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
opens = [[0.0, 0.0], [0.005, 1.0]]
feed = ft.Feed(6.43, solids_fraction=0.1, solids_velocity=6.0, solids_schedule=opens)
scene = ft.Unsteady(
    ft.TwoFluid(nitrogen, coal, dispersed="none", dispersion="none"),
    bend,
    feed,
    numerics=ft.TimeNumerics(end_time=0.06, courant=2.0),
    resolution=ft.Resolution(level=1, axial_cells=74),
)

if __name__ == "__main__":
    print(scene.run("results/bend90", overwrite=True, quiet=False)["pressure_drop"])
