# SPDX-License-Identifier: LGPL-3.0-or-later
"""The report of a run at every stage of its life: one page, whole, with what is there."""

from __future__ import annotations

import base64
import math
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from fem_tfm.cli import main
from fem_tfm.errors import InputError
from fem_tfm.output.profiles import Monitor
from fem_tfm.output.report import read_monitor, write_report
from fem_tfm.output.result import InputRange, Quantity, Reference, Result

CASE = 'title = "line <1> & more"\n[geometry]\ndiameter = 0.01\n'
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Texts and pictures of a page; every element it opens must be closed."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.images: dict[str, np.ndarray] = {}
        self.links: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep track of an element, and decode a picture."""
        given = dict(attrs)
        self.links += [given[key] for key in ("href", "src") if key in given]
        if tag == "img":
            kind, _, data = given["src"].partition(",")
            assert kind == "data:image/png;base64"
            self.images[given["alt"]] = imread(BytesIO(base64.b64decode(data)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """An element ends where it should."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Keep a text."""
        self.texts.append(data)

    @property
    def text(self) -> str:
        """All that is to be read."""
        return " ".join(" ".join(self.texts).split())


def working(directory: Path, rows: int = 3) -> Path:
    """The files of a run that is at work."""
    (directory / "case.toml").write_text(CASE, encoding="utf-8")
    (directory / "run.log").write_text("step <1>\nstep 2\n", encoding="utf-8")
    columns = {"step": "", "dt": "s", "pressure_gradient": "Pa/m", "max_theta": "m2/s2"}
    with Monitor(directory / "monitor.csv", columns) as monitor:
        for i in range(rows):
            monitor.write({"step": i, "dt": 10.0**i, "pressure_gradient": 3e3 - i})
    return directory


def ended(directory: Path, status: str, **changes: object) -> Path:
    """The files of a run that has ended."""
    quantity = Quantity(
        4020.0, "Pa", 12.0, references=(Reference(4260.0, "exp & co"), Reference(4090.0, "mesh D"))
    )
    result = Result(
        status=status,
        flow="dense",
        solution="developed",
        title="line <1> & more",
        cells=1632,
        dofs=9000,
        seconds={"solve": 1.5},
        quantities={"pressure_drop": quantity, "holdup": Quantity(math.nan, "-")},
        balances={"gas_mass": 1e-12},
        skipped=["heat: not asked for"],
        notes=["the meshes agree by chance"],
        inferred=["gas.density: p/(R T)"],
        inputs=[InputRange("solids.diameter", 1e-4, 2e-4, -0.03, 0.005, "a sieve")],
        estimates=["a correlation gives 3 Pa/m"],
        **changes,
    )
    result.write(working(directory))
    figure = Figure(figsize=(1, 1))
    figure.savefig(directory / "section.png", dpi=30)
    figure.savefig(directory / "other.png", dpi=40)
    return directory


def test_a_converged_run(tmp_path: Path) -> None:
    path = write_report(ended(tmp_path, "converged"))
    assert path == tmp_path / "report.html"
    page = Page(path)
    for words in (
        "line <1> & more", "converged : dense flow, developed solution; 1,632 cells",
        "pressure drop 4020 12 Pa", "exp & co 4260 Pa -5.6 %", "mesh D 4090 Pa -1.7 %",
        "gas mass 1.0e-12", "heat: not asked for", "gas.density: p/(R T)", "solve 1.5 s",
        "to +0.5 % (a sieve)", "gives 3 Pa/m", "the meshes agree by chance",
        "diameter = 0.01", "step <1> step 2",
    ):  # fmt: skip
        assert words in page.text, words
    assert list(page.images) == ["section", "other", "monitor"]
    assert page.images["section"].shape[:2] == (30, 30)
    assert page.images["monitor"].std() > 0
    # nothing is fetched from elsewhere
    assert all(link.startswith("data:") for link in page.links)


def test_a_run_at_work_or_killed(tmp_path: Path) -> None:
    """The monitor may end in half a row, and there is no answer yet."""
    with (working(tmp_path) / "monitor.csv").open("a", encoding="utf-8") as file:
        file.write("3,1e")
    page = Page(write_report(tmp_path))
    assert "unfinished : at work, or killed" in page.text
    assert list(page.images) == ["monitor"]
    assert "Quantities" not in page.text
    columns = read_monitor(tmp_path / "monitor.csv")
    assert columns["dt [s]"][:3].tolist() == [1.0, 10.0, 100.0]
    assert math.isnan(columns["dt [s]"][3])


def test_a_run_that_has_only_begun(tmp_path: Path) -> None:
    working(tmp_path, rows=0)
    page = Page(write_report(tmp_path))
    assert not page.images
    assert "diameter = 0.01" in page.text


def test_a_failed_run(tmp_path: Path) -> None:
    """Its reason, its pictures, and no numbers that could be taken for an answer."""
    page = Page(write_report(ended(tmp_path, "failed", reason="the balance is broken")))
    assert "failed" in page.text
    assert "the balance is broken" in page.text
    assert "4020" not in page.text
    assert "section" in page.images


def test_a_new_report_replaces_the_old_one(tmp_path: Path) -> None:
    write_report(working(tmp_path))
    page = Page(write_report(ended(tmp_path, "finished")))
    assert "finished" in page.text
    assert list(page.images) == ["section", "other", "monitor"]


@pytest.mark.parametrize("content", [None, "{", '{"status": "converged"}'])
def test_what_is_no_run_is_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (working(tmp_path) / "result.json").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match="DIR = "):
        write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_the_verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(ended(tmp_path, "converged"))]) == 0
    assert "report.html" in capsys.readouterr().out
    assert main(["report", str(tmp_path / "none")]) == 2
    assert "a directory with the results of a run" in capsys.readouterr().err
