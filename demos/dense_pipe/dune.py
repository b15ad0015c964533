# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of dune.toml in Python: a heap of solids that travels as a dune."""

import fem_tfm as ft

pipe = ft.Pipe(diameter=0.010, length=0.2)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
feed = ft.Feed(1.0, solids_fraction=0.01, solids_velocity=0.8)
scene = ft.Unsteady(
    ft.TwoFluid(nitrogen, coal, dispersed="none", dispersion="none"),
    pipe,
    feed,
    initial=ft.Initial("bed", bed_fraction=0.5, bed_height=0.004, bed_start=0.03, bed_end=0.08),
    numerics=ft.TimeNumerics(end_time=0.5, courant=2.0),
    resolution=ft.Resolution(level=1, axial_cells=100),
)

if __name__ == "__main__":
    print(scene.run("results/dune", overwrite=True, quiet=False)["holdup"])
