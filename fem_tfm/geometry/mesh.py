from fem_tfm import mesh as old
from fem_tfm.mesh import Mesh


def _res(r):
    return old.Resolution(r.level, r.mesh_size, r.wall_ratio, r.cell_shape)


def section_mesh(section, resolution, comm):
    return old._build(old._Request(section, _res(resolution)), comm)


def line_mesh(*a): ...


def axial_layers(*a): ...


def line_cells(*a): ...
