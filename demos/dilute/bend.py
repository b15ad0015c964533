# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of bend.toml in Python: dust of three sizes that stays on the wall of a bend."""

import fem_tfm as ft

sizes = {"fine": 5.0e-6, "middle": 2.0e-5, "coarse": 6.0e-5}
dust = tuple(ft.Material(name, 2000, size, loading=0.01) for name, size in sizes.items())
scene = ft.Unsteady(
    ft.TwoFluid(ft.Gas(density=1.2, viscosity=1.8e-5), turbulence="k-epsilon", gas_wall="log-law"),
    ft.Bend(diameter=0.05, length=0.6, bend_radius=0.1, bend_towards="up"),
    ft.Feed(10.0),
    numerics=ft.TimeNumerics(end_time=0.15, courant=5.0),
    initial=ft.Initial(state="inlet"),
    particles=ft.Cloud(dust, impact="stick", dispersion="none", parcels=2000),
    resolution=ft.Resolution(level=1),
)

if __name__ == "__main__":
    print(scene.run("results/dust", overwrite=True, quiet=False)["particle_deposition_middle"])
