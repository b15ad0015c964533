# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of particles.toml in Python: quartz, ash and flour in the air of a square duct."""

import fem_tfm as ft

PLACES = (-0.08588, -0.06087, -0.02337, 0.0234, 0.0609, 0.0859)
FLOWS = ((0.0685, 0.0884, 0.105), (0.0886, 0.115, 0.136), (0.105, 0.135, 0.161))
points = tuple(
    (x, y, FLOWS[min(i, 5 - i)][min(j, 5 - j)])
    for i, x in enumerate(PLACES)
    for j, y in enumerate(PLACES)
)
materials = (
    ft.Material("quartz", 2500, 5.0e-4, velocity=2.8),
    ft.Material("ash", 1800, 1.4e-4, velocity=2.8),
    ft.Material("flour", 1410, 2.0e-4, velocity=2.8),
)
scene = ft.Developed(
    ft.ReynoldsStress(ft.Gas(density=1.2, viscosity=1.8e-5)),
    ft.Duct(width=0.2, length=16.0),
    ft.Feed(22.0),
    particles=ft.Cloud(materials, injection="points", points=points, parcels=200),
    resolution=ft.Resolution(level=4),
)

if __name__ == "__main__":
    answer = scene.run("results/particles", overwrite=True, quiet=False)
    print(answer["particle_exit_velocity_ash"])
