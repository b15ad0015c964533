# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of a tube of grains, written on rank 0.

grains.pvd          snapshots of the grains for ParaView, grains_0000.vtu and on
slugs.csv           a row for each slug that was followed
along.csv           numbers of the slugs by their place
profile.csv         the average slug
porosity.png        porosity over place and time
slugs.png           numbers of the slugs along the tube, and the average slug
slug.png            the longest slug of the film from the side
sections.png        sections of a slug that passes the middle of the tube
layers.csv          velocity of its grains over the height
film.gif            the grains of the last second or so
wall.vtu, wear.csv, wear.png   impacts on the walls, where wear is asked for
"""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from fem_tfm.output.files import replaced, write_text

FILES = (
    "result.json", "report.html", "monitor.csv", "run.log", "fields.xdmf", "fields.h5",
    "grains.pvd", "slugs.csv", "along.csv", "profile.csv", "porosity.png", "slugs.png", "film.gif",
    "wall.vtu", "wear.csv", "wear.png",
    "slug.png", "sections.png", "layers.csv",
)  # fmt: skip


class Series:
    """Snapshots of grains as VTU files, and the PVD file that lists them with their times.

    resume : go on with the series of an earlier part of the run, up to a time [s]
    """

    def __init__(self, out: Path, resume: bool, time: float) -> None:
        self.out, self.times = out, list[float]()
        if resume and (out / "grains.pvd").is_file():
            lines = (out / "grains.pvd").read_text(encoding="utf-8").splitlines()
            told = [float(line.split('"')[1]) for line in lines if "timestep" in line]
            self.times = [t for t in told if t < time * (1 - 1e-9)]
        else:
            for old in out.glob("grains_*.vtu"):
                old.unlink()

    def add(
        self,
        time: float,
        place: NDArray[np.float64],
        radius: NDArray[np.float64],
        velocity: NDArray[np.float64],
        number: NDArray[np.int64],
    ) -> None:
        """A snapshot: centres (n, 3) [m], radii [m], velocities (n, 3) [m/s] and numbers."""
        name = f"grains_{len(self.times):04d}.vtu"
        data = {"radius": radius, "velocity": velocity, "number": number}
        cells = [("vertex", np.arange(len(place))[:, None])]
        with replaced(self.out / name) as temporary:
            meshio.write(temporary, meshio.Mesh(place, cells, point_data=data), file_format="vtu")
        self.times.append(time)
        rows = [
            f'    <DataSet timestep="{t!r}" file="grains_{n:04d}.vtu"/>'
            for n, t in enumerate(self.times)
        ]
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>'
        write_text(
            self.out / "grains.pvd", "\n".join([head, *rows, "  </Collection>\n</VTKFile>\n"])
        )
