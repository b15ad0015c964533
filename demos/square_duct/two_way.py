# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of two_way.toml in Python: ash that the air of a square duct accelerates."""

import fem_tfm as ft

PLACES = (-0.08588, -0.06087, -0.02337, 0.0234, 0.0609, 0.0859)
FLOWS = ((0.0685, 0.0884, 0.105), (0.0886, 0.115, 0.136), (0.105, 0.135, 0.161))
points = tuple(
    (x, y, FLOWS[min(i, 5 - i)][min(j, 5 - j)])
    for i, x in enumerate(PLACES)
    for j, y in enumerate(PLACES)
)
ash = ft.Material("ash", 1800, 1.4e-4, velocity=2.8)
scene = ft.Developing(
    ft.ReynoldsStress(ft.Gas(density=1.2, viscosity=1.8e-5)),
    ft.Duct(width=0.2, length=16.0),
    ft.Feed(22.0),
    inlet=ft.Inlet(gas_intensity=0.05, length_scale=0.07),
    particles=ft.Cloud((ash,), coupling="two-way", injection="points", points=points, parcels=2000),
    numerics=ft.MarchNumerics(axial_accuracy=0.1),
    resolution=ft.Resolution(level=2),
)

if __name__ == "__main__":
    print(scene.run("results/two_way", overwrite=True, quiet=False)["pressure_drop"])
