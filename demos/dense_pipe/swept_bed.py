# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of swept_bed.toml in Python: a bed at rest that the gas sweeps out."""

import fem_tfm as ft

pipe = ft.Pipe(diameter=0.010, length=0.2)
nitrogen = ft.Gas(density=33.5, viscosity=1.8e-5)
coal = ft.Solids(density=1700, diameter=1.6e-4)
opens = [[0.0, 0.1], [0.01, 1.0]]
feed = ft.Feed(4.0, solids_fraction=0.01, solids_velocity=4.0, gas_schedule=opens)
scene = ft.Unsteady(
    ft.TwoFluid(nitrogen, coal, dispersed="none", dispersion="none"),
    pipe,
    feed,
    initial=ft.Initial("bed", bed_fraction=0.5, bed_height=0.005, bed_start=0.02, bed_end=0.15),
    numerics=ft.TimeNumerics(end_time=0.1, courant=2.0),
    resolution=ft.Resolution(level=1, axial_cells=100),
)

if __name__ == "__main__":
    print(scene.run("results/swept_bed", overwrite=True, quiet=False)["holdup"])
