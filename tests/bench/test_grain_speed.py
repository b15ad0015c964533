# SPDX-License-Identifier: LGPL-3.0-or-later
"""The benchmark of grains: its packed state, and LAMMPS on the same state where it is installed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem_tfm.bench import BENCHMARKS, grains
from fem_tfm.closures.contacts import CundallStrack, ViscousCoulomb
from fem_tfm.models.slug.grains import Grains, Walls


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short pieces and stretches."""
    for name, value in {"PIECE": 400, "SETTLING": 4000, "STRETCHES": 1, "WARMING": 50}.items():
        monkeypatch.setattr(grains, name, value)


def test_the_state_is_packed_and_a_long_one_is_made_of_copies(quick: None) -> None:
    made, height = grains.packed(ViscousCoulomb(), 1200)
    assert 1100 < made.count < 1300
    assert made.place[:, 2].min() > 0 and made.place[:, 2].max() < height
    solids = made.mass.sum() / grains.DENSITY / (grains.TUBE.area * height)
    assert 0.5 < solids < 0.65
    low = made.place[:, 2] < height / 3
    assert low.sum() == pytest.approx(made.count / 3, abs=20)


def test_a_speed_is_told_without_lammps(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    found = grains.measure(ViscousCoulomb(), 400, 100)
    assert found.lammps is None and found.speed > 0.1
    assert 1 < found.contacts < found.listed < 12
    assert "grains" in BENCHMARKS


@pytest.mark.skipif(shutil.which("lmp") is None, reason="LAMMPS is not installed")
@pytest.mark.parametrize("law", [ViscousCoulomb(), CundallStrack()], ids=["viscous", "springs"])
def test_lammps_moves_the_grains_as_we_do(law: Any, tmp_path: Path, quick: None) -> None:
    """The input states the same case: places agree as far as the schemes allow."""
    packed, height = grains.packed(law, 400)
    # a fresh start, since LAMMPS has no springs either
    made = Grains(packed.grain, Walls(grains.TUBE, 0.0, height), grains.STEP, grains.GRAVITY)
    made.add(packed.place)
    random = np.random.default_rng(0)
    made.set_velocity(random.normal(size=(made.count, 3)) * 0.02)
    grains.deck(made, height, 10, tmp_path)
    text = (tmp_path / "in.grains").read_text(encoding="utf-8")
    text = text.partition("run ")[0] + "run 100\nwrite_dump all custom end.dump id x y z "
    text += 'modify sort id format float "%.17g"\n'
    (tmp_path / "in.grains").write_text(text, encoding="utf-8")
    command = ["lmp", "-in", "in.grains", "-log", "none"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    told = np.loadtxt(tmp_path / "end.dump", skiprows=9)[:, 1:]
    start = made.place[np.argsort(made.number)]
    # the order of the file is that of the arrays at that time
    order = np.argsort(made.number)
    made.run(100)
    moved = made.place[np.argsort(made.number)]
    assert np.abs(moved - start).max() > 5e-6
    assert np.abs(told[order] - moved).max() < 0.05 * np.abs(moved - start).max()
