# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures show the whole section, and draw what they are given without a solve."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.tri import Triangulation

from fem_tfm.output import pictures
from fem_tfm.output.pictures import (
    SectionView,
    axis_picture,
    plane_picture,
    section_picture,
    sweep_picture,
    vertical_profile,
)

CELLS = {
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "triangle6": [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)],
    "quad": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "quad9": [
        (0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5), (0.5, 0.5),
    ],
}  # fmt: skip


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pixels are drawn sooner."""
    monkeypatch.setattr(pictures, "DPI", 60)


def disc(symmetry: str, shift: float = 0.0, radius: float = 0.005) -> SectionView:
    """A pipe section, its half or its quarter; `shift` moves the nodes off the line x = 0."""
    spread = {"none": 2 * math.pi, "half": math.pi, "quarter": math.pi / 2}[symmetry]
    start = 0 if symmetry == "quarter" else -math.pi / 2 + shift
    count = 33 if symmetry != "none" else 32
    angles = start + spread * np.arange(count) / (count - 1 if symmetry != "none" else count)
    r = np.concatenate([[0.0], *(np.full(count, radius * i / 8) for i in range(1, 9))])
    phi = np.concatenate([[0.0], np.tile(angles, 8)])
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi), 0 * r])
    points[np.abs(points) < 1e-15] = 0
    mesh = Triangulation(points[:, 0], points[:, 1])
    corners = points[mesh.triangles, :2]
    area = np.linalg.det(corners[:, 1:] - corners[:, :1])
    return SectionView(points, mesh.triangles[np.abs(area) > 1e-12], symmetry)


def dense_fields(view: SectionView) -> dict[str, np.ndarray]:
    """A bed below, a fast suspension above."""
    y = view.points[:, 1] / view.height
    speed = 8 + 4 * y
    return {
        "alpha_s": 0.1 + 0.4 / (1 + np.exp(20 * (y + 0.2))),
        "u_s": np.column_stack([0 * y, 0 * y, speed]),
        "u_g": np.column_stack([0 * y, 0 * y, 1.2 * speed]),
        "Theta": 10.0 ** (-3 - y),
        "p": 1e5 + y,
    }


@pytest.mark.parametrize("kind", CELLS)
def test_cells_are_split_without_gap_or_overlap(kind: str) -> None:
    view = SectionView.of_cells(CELLS[kind], [range(len(CELLS[kind]))], kind)
    corners = view.points[view.triangles]
    areas = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(0.5 if kind.startswith("triangle") else 1.0)
    assert set(view.triangles.ravel()) == set(range(len(CELLS[kind])))


@pytest.mark.parametrize("symmetry", ["none", "half", "quarter"])
def test_mirror_images_make_up_the_section(symmetry: str) -> None:
    view = disc(symmetry)
    copies = view.copies()
    x = np.concatenate([copy.x for copy in copies])
    y = np.concatenate([copy.y for copy in copies])
    for extent in (x.min(), -x.max(), y.min(), -y.max()):
        assert extent == pytest.approx(-0.005, rel=0.01)
    assert [view.height, view.width] == pytest.approx([0.01, 0.01], rel=0.01)
    wall = np.hypot(*view.points[view.wall(), :2].T)
    assert wall == pytest.approx(0.005)


@pytest.mark.parametrize("symmetry", ["none", "half"])
def test_profile_takes_nodes_on_the_line(symmetry: str) -> None:
    view = disc(symmetry)
    profile = vertical_profile(view, dense_fields(view))
    assert len(profile["y"]) == 17
    assert np.all(np.diff(profile["y"]) > 0)
    assert profile["y/D"][[0, -1]] == pytest.approx([-0.5, 0.5])
    assert profile["u_s"] == pytest.approx(8 + 4 * profile["y/D"])


def test_profile_of_a_quarter_is_mirrored() -> None:
    view = disc("quarter")
    profile = vertical_profile(view, {"u_g": view.points[:, 1] ** 2})
    assert len(profile["y"]) == 17
    assert np.all(np.diff(profile["y"]) > 0)
    assert profile["u_g"] == pytest.approx(profile["y"] ** 2)


def test_profile_is_interpolated_where_no_nodes_lie() -> None:
    view = disc("none", shift=0.05)
    profile = vertical_profile(view, dense_fields(view))
    inside = np.isfinite(profile["u_s"])
    assert inside.sum() > 190
    assert profile["u_s"][inside] == pytest.approx(8 + 4 * profile["y/D"][inside])


def drawn(path: Path) -> np.ndarray:
    """The picture's pixels, with more than a few colours among them."""
    pixels = imread(path)
    levels = (255 * pixels[..., :3]).astype(int) @ [1, 256, 65536]
    assert len(np.unique(levels)) > 100
    return pixels


def test_section_picture_is_symmetric_and_coloured(tmp_path: Path) -> None:
    view = disc("half")
    section_picture(tmp_path / "section.png", view, dense_fields(view), "a title")
    pixels = drawn(tmp_path / "section.png")
    assert pixels.shape[1] > pixels.shape[0] > 400
    assert [p.name for p in tmp_path.iterdir()] == ["section.png"]


def test_mirrored_half_draws_the_same_as_the_whole(tmp_path: Path) -> None:
    pixels = {}
    for symmetry in ("half", "none"):
        view = disc(symmetry)
        fields = {"u_g": 8 + 1e3 * view.points[:, 1]}
        section_picture(tmp_path / f"{symmetry}.png", view, fields)
        pixels[symmetry] = drawn(tmp_path / f"{symmetry}.png")
    # only the smoothing along edges may differ
    assert np.abs(pixels["half"] - pixels["none"]).mean() < 0.01


@pytest.mark.parametrize("names", [["u_g"], ["alpha_s", "u_s", "u_g"], ["u_g", "Theta"]])
def test_section_picture_leaves_out_what_is_not_there(tmp_path: Path, names: list[str]) -> None:
    view = disc("none")
    fields = dense_fields(view)
    section_picture(tmp_path / "s.png", view, {name: fields[name] for name in names})
    drawn(tmp_path / "s.png")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0.0, 3.0, math.nan])
def test_uniform_and_broken_fields_are_drawn_too(tmp_path: Path, value: float) -> None:
    view = disc("half")
    fields = {"u_g": np.full(len(view.points), value), "alpha_s": 0.1 + view.points[:, 1]}
    fields["u_g"][:4] = 1.0
    section_picture(tmp_path / "s.png", view, fields)
    drawn(tmp_path / "s.png")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("table", "varied"),
    [
        ({"gas.density": [3.0, 1.0, 2.0], "pressure_gradient": [1.0, math.nan, 3.0]}, None),
        ({"closures.drag": ["a", "b"] * 2, "solids.diameter": [1, 1, 2, 2], "holdup": [1, 2, 3, 4],
          "status": ["converged"] * 4}, ["closures.drag", "solids.diameter"]),
        ({"x": [1.0], "a": [1.0], "b": [2.0], "c": [3.0], "d": [4.0]}, ["x"]),
    ],
)  # fmt: skip
def test_sweep_picture(tmp_path: Path, table: dict, varied: list[str] | None) -> None:
    sweep_picture(tmp_path / "s.png", table, varied, {"holdup": "-"}, "a sweep")
    drawn(tmp_path / "s.png")


def test_sweep_lines_are_sorted_and_grouped() -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    table = {"x": [3.0, 1.0, 2.0, 1.0], "drag": ["a", "a", "a", "b"], "y": [9.0, 1.0, 4.0, 7.0]}
    pictures.plot_lines(axes, table, ["x", "drag"], "y")
    first, second = axes.lines
    assert list(first.get_xdata()) == [1.0, 2.0, 3.0]
    assert list(first.get_ydata()) == [1.0, 4.0, 9.0]
    assert (second.get_label(), list(second.get_ydata())) == ("b", [7.0])


@pytest.mark.parametrize("x", [[3.0, 1.0, 2.0], ["level", "uphill", "upright"]])
def test_sweep_lines_carry_the_errors_of_their_points(x: list[Any]) -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    errors = [0.9, None, 0.4]
    pictures.plot_lines(axes, {"x": x, "y": [9.0, 1.0, 4.0]}, ["x"], "y", errors)
    (bars,) = axes.collections
    ends = sorted(tuple(segment[:, 1]) for segment in bars.get_segments())
    assert ends == [(1.0, 1.0), (3.6, 4.4), (8.1, 9.9)]
    bare = Figure().subplots()
    pictures.plot_lines(bare, {"x": x, "y": [9.0, 1.0, 4.0]}, ["x"], "y", [None, None, None])
    assert not bare.collections


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("names", [["pressure", "pressure_gradient"], ["holdup", "bed_height"]])
def test_axis_picture(tmp_path: Path, names: list[str]) -> None:
    """What a line does not have is left out; the gradient at its inlet is not known."""
    columns = {"z": [0.0, 0.1, 0.4], **{name: [math.nan, 2.0, 1.0] for name in names}}
    axis_picture(tmp_path / "a.png", columns, {"pressure": "Pa", "holdup": "-"}, 0.01, "a line")
    drawn(tmp_path / "a.png")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("length", [0.02, 0.5])
@pytest.mark.parametrize("bent", [False, True])
def test_plane_picture(tmp_path: Path, length: float, bent: bool) -> None:
    """What is dense on the left is bright there, in a long plane and in one that turns."""
    y, s = np.meshgrid(np.linspace(-0.005, 0.005, 8), np.linspace(0, length, 50), indexing="ij")
    points = np.stack([s, y], axis=-1)
    if bent:
        phi = s / length * math.pi / 2
        points = (length - y)[..., None] * np.stack([np.sin(phi), -np.cos(phi)], axis=-1)
    dense = np.where(s < length / 2, 0.6, 0.0) + 0.01 * y / 0.005 * (s > length / 2)
    both = {}
    for name, values in (("left", dense), ("right", dense[:, ::-1])):
        path = tmp_path / f"{name}.png"
        plane_picture(path, points, {0.0: values, 0.25: values, 0.5: values}, "a plane")
        both[name] = imread(path)[..., 0]
    left, right = both["left"], both["right"]
    assert left.shape == right.shape
    change, middle = left - right, left.shape[1] // 2
    assert change[:, :middle].sum() > 0 > change[:, middle:].sum()


def test_plane_picture_leaves_out_what_is_nowhere(tmp_path: Path) -> None:
    points = np.stack(np.meshgrid([0.0, 0.1, 0.2], [0.0, 0.1], indexing="xy"), axis=-1)
    plane_picture(tmp_path / "p.png", points, {0.0: np.array([[0.1, math.nan, 0.3], [0.2] * 3])})
    assert (tmp_path / "p.png").stat().st_size > 1000
