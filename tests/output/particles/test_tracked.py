# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is told of particles: means by mass flow, fates, errors, and files that readers open."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import meshio
import numpy as np
import pytest
from matplotlib.image import imread

from fem_tfm.output.particles import tracked as module
from fem_tfm.output.particles.pictures import (
    GROUPS,
    deposition_picture,
    groups,
    particle_picture,
)
from fem_tfm.output.particles.tracked import FATES, Moment, Tracked

OUT, DEPOSITED = FATES.index("out"), FATES.index("deposited")


@pytest.fixture
def tracked() -> Tracked:
    """Four parcels of two materials from two entries, told at three places; the last one stays."""
    found = Tracked(
        materials=("ash", "sand"),
        area=0.04,
        material=np.array([0, 0, 1, 1], dtype=np.int32),
        entry=np.array([0, 1, 0, 1], dtype=np.int32),
        diameter=np.full(4, 1e-3),
        mass=np.array([1e-6, 1e-6, 2e-6, 2e-6]),
        rate=np.array([1e6, 3e6, 1e6, 1e6]),
        traced=np.array([0, 3]),
    )
    for place in range(3):
        x = np.column_stack([[-0.09, 0.0, 0.02, 0.05], [0.09, 0.0, 0.01, 0.04], np.full(4, place)])
        w = np.array([2.0, 4.0, 5.0, 5.0]) + place
        v = np.column_stack([np.zeros(4), np.zeros(4), w])
        inside = np.array([True, True, True, place < 2])
        status = np.where(inside, OUT if place == 2 else 0, DEPOSITED).astype(np.int8)
        found.take(Moment(float(place), np.full(4, 0.1 * place), x, v, inside), status)
    return found


def test_means_count_parcels_by_their_mass_flow(tracked: Tracked) -> None:
    assert tracked.column("ash", "velocity") == pytest.approx([3.5, 4.5, 5.5])
    assert tracked.column("ash", "velocity_sd")[0] == pytest.approx(math.sqrt(0.75))
    assert tracked.column("sand", "share") == pytest.approx([1, 1, 0.5])
    assert tracked.by_entry["ash"][1] == pytest.approx([3.0, 5.0])
    # rate pi d^3/6 over w and the area, of the two parcels
    volume = math.pi / 6 * 1e-9
    alpha = (1e6 / 2 + 3e6 / 4) * volume / 0.04
    assert tracked.column("ash", "alpha_p")[0] == pytest.approx(alpha)


def test_exit_velocity_has_the_error_of_its_sample(tracked: Tracked) -> None:
    mean, error = tracked.exit_velocity("ash")
    # flows of 1 and 3: 16/10 independent parcels
    assert mean == pytest.approx(5.5)
    assert error == pytest.approx(math.sqrt(0.75) / math.sqrt(1.6))
    assert tracked.errors()["particle_exit_velocity_ash"] == pytest.approx(2 * error)


def test_every_parcel_has_one_fate(tracked: Tracked) -> None:
    assert tracked.counts() == {"inside": 0, "out": 3, "deposited": 1, "lost": 0, "stuck": 0}
    assert sum(tracked.counts("sand").values()) == 2
    assert tracked.deposited("sand")[0] == pytest.approx(0.5)
    assert tracked.quantities()["particle_residence_time_ash"] == pytest.approx(0.2)


def test_nothing_that_arrives_is_told_as_such() -> None:
    found = Tracked(
        ("ash",), 1.0, np.zeros(1, np.int32), np.zeros(1, np.int32), np.ones(1), np.ones(1),
        np.ones(1), np.array([0]),
    )  # fmt: skip
    zero = np.zeros((1, 3))
    found.take(Moment(0.0, np.zeros(1), zero, zero, np.array([False])), np.array([2], np.int8))
    assert math.isnan(found.exit_velocity("ash")[0])
    assert found.column("ash", "share") == pytest.approx([0.0])


def test_files_open_in_their_readers(tracked: Tracked, tmp_path: Path) -> None:
    module.write_tables(tmp_path, tracked)
    module.write_trajectories(tmp_path, tracked)
    module.write_cloud(tmp_path, tracked)
    with (tmp_path / "particles.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[2]["ash velocity [m/s]"]) == pytest.approx(5.5)
    with (tmp_path / "entries.csv").open(encoding="utf-8") as file:
        assert float(next(iter(csv.DictReader(file)))["sand 1 [m/s]"]) == pytest.approx(5.0)
    with (tmp_path / "deposits.csv").open(encoding="utf-8") as file:
        assert float(next(iter(csv.DictReader(file)))["mass_flow [kg/s]"]) == pytest.approx(2.0)
    lines = meshio.read(tmp_path / "trajectories.vtu")
    # three places of the first parcel, two of the one that stays
    assert len(lines.points) == 5
    assert lines.cells_dict["line"].tolist() == [[0, 1], [1, 2], [3, 4]]
    assert lines.point_data["velocity"][2].tolist() == [0, 0, 4.0]
    cloud = meshio.read(tmp_path / "cloud.vtu")
    assert cloud.point_data["status"].tolist() == [1, 1, 1, 2]


def test_entries_are_grouped_by_their_place() -> None:
    at = np.array([[0.0, 0.0], [0.09, 0.0], [-0.09, 0.08]])
    assert [GROUPS[n] for n in groups(at, (0.2, 0.2))] == ["core", "near a wall", "near a corner"]
    assert groups(at, (0.2, 0.2), round_section=True).tolist() == [0, 1, 1]


def test_pictures_show_something(tracked: Tracked, tmp_path: Path) -> None:
    particle_picture(tmp_path / "particles.png", tracked, (0.2, 0.2), "Title")
    deposition_picture(tmp_path / "deposition.png", tracked)
    for name in ("particles.png", "deposition.png"):
        pixels = imread(tmp_path / name)[..., :3].mean(axis=2)
        assert pixels.min() < 0.4 and pixels.std() > 0.02


def test_a_state_that_is_put_back_tells_the_same(tracked: Tracked) -> None:
    other = Tracked(
        tracked.materials, tracked.area, tracked.material, tracked.entry, tracked.diameter,
        tracked.mass, tracked.rate, tracked.traced,
    )  # fmt: skip
    other.restore(tracked.state())
    assert str(other.rows) == str(tracked.rows)
    assert other.quantities() == pytest.approx(tracked.quantities())
    assert other.counts() == tracked.counts()
    assert np.array_equal(np.array(other.lines), np.array(tracked.lines), equal_nan=True)
