# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables have heads with units, keep their numbers and survive a kill."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from fem_tfm.output.profiles import Monitor, drop_after, write_profiles

COLUMNS = {"step": "", "time": "s", "max_alpha_s": "-"}


def rows(path: Path) -> list[list[str]]:
    """The cells of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_profiles_carry_units_and_digits(tmp_path: Path) -> None:
    path = tmp_path / "profiles.csv"
    y = np.linspace(-0.005, 0.005, 7)
    columns = {"y": y, "alpha_s": y**2 / 3, "name": ["a, b"] * 7}
    write_profiles(path, columns, {"y": "m", "alpha_s": "-"})
    head, *body = rows(path)
    assert head == ["y [m]", "alpha_s [-]", "name"]
    numbers = np.array([row[:2] for row in body], dtype=float)
    assert numbers == pytest.approx(np.column_stack([y, y**2 / 3]), rel=1e-11)
    assert body[0][2] == "a, b"


def test_columns_of_different_lengths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'alpha_s': 2"):
        write_profiles(tmp_path / "p.csv", {"y": [0.0], "alpha_s": [0.1, 0.2]}, {})
    assert not list(tmp_path.iterdir())


def test_monitor_row_is_on_the_disk_at_once(tmp_path: Path) -> None:
    path = tmp_path / "out" / "monitor.csv"
    monitor = Monitor(path, COLUMNS)
    monitor.write({"step": 1, "time": 0.5, "max_alpha_s": 0.25})
    monitor.write({"time": 1.0, "step": 2})
    expected = [["step", "time [s]", "max_alpha_s [-]"], ["1", "0.5", "0.25"], ["2", "1", ""]]
    assert rows(path) == expected
    with pytest.raises(ValueError, match="no column theta"):
        monitor.write({"theta": 1.0})
    monitor.close()
    assert rows(path) == expected


def test_monitor_goes_on_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "monitor.csv"
    with Monitor(path, COLUMNS, append=True) as monitor:
        monitor.write({"step": 1})
    with path.open("a") as file:
        file.write("2,0.")
    with Monitor(path, COLUMNS, append=True) as monitor:
        monitor.write({"step": 2})
    assert rows(path)[1:] == [["1", "", ""], ["2", "", ""]]
    with pytest.raises(ValueError, match="other columns"):
        Monitor(path, {"step": ""}, append=True)
    with Monitor(path, {"step": ""}) as monitor:
        monitor.write({"step": 9})
    assert rows(path) == [["step"], ["9"]]


def test_rows_behind_a_time_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "monitor.csv"
    path.write_text("step,time [s]\n1,0.5\n2,1\n3,1.5\n4,1", encoding="utf-8")
    drop_after(path, "time", 1.0 - 4e-12)
    assert path.read_text(encoding="utf-8") == "step,time [s]\n1,0.5\n2,1\n"
    drop_after(path, "place", 0.0)
    assert path.read_text(encoding="utf-8") == "step,time [s]\n1,0.5\n2,1\n"
    drop_after(tmp_path / "absent.csv", "time", 1.0)
