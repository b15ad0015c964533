# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of pipe.toml in Python: sand in air through a level pipe, with wear of its wall."""

import fem_tfm as ft

sand = ft.Material("sand", 2600, 2.0e-4, size="lognormal", spread=1.3, loading=0.04, velocity=15.0)
cloud = ft.Cloud(
    (sand,),
    forces=("drag", "gravity"),
    impact=ft.laws.Restitution(e=0.9, mu=0.3, roughness_deg=3.0),
    wear=ft.laws.Oka(),
    parcels=4000,
)
scene = ft.Developed(
    ft.TwoFluid(ft.Gas(density=1.2, viscosity=1.8e-5), turbulence="k-epsilon"),
    ft.Pipe(diameter=0.08, length=8.0),
    ft.Feed(20.0),
    particles=cloud,
    resolution=ft.Resolution(level=2),
)

if __name__ == "__main__":
    print(scene.run("results/sand", overwrite=True, quiet=False)["particle_exit_velocity_sand"])
