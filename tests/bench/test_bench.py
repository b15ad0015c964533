# SPDX-License-Identifier: LGPL-3.0-or-later
"""The benchmarks: what the random cases cover, and that neither invents a number."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fem_tfm import bench
from fem_tfm.bench import duct, error, stress, stress_unsteady, unsteady, unsteady_error
from fem_tfm.bench.demo import demo
from fem_tfm.case import Case
from fem_tfm.closures import make, names
from fem_tfm.errors import InputError, SolverError
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.scenes import dense as physics
from fem_tfm.scenes.developed import Developed
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.pseudo_time import History, PseudoTime


def test_every_law_stands_in_several_sets() -> None:
    sets = stress.law_sets()
    assert len(sets) == stress.SETS
    for key, family in stress.FAMILIES.items():
        count = Counter(laws[key] for laws in sets)
        needy = {n for n in names(family) if getattr(make(family, n), "needs_k", False)}
        assert set(count) == set(names(family)) - needy - stress.LEFT_OUT
        assert min(count.values()) >= 2


def test_cases_with_transported_turbulence_differ_in_nothing_else() -> None:
    plain, turbulent = stress.law_sets(), stress.law_sets(turbulent=True)
    changed = {*stress.TURBULENCE, "walls.gas"}
    for laws, others in zip(plain, turbulent, strict=True):
        assert {k: v for k, v in others.items() if k not in changed} == {
            k: v for k, v in laws.items() if k not in changed
        }
        assert make("turbulence", others["closures.turbulence"]).transported
    for key in ("closures.dispersed", "closures.dispersion"):
        assert {laws[key] for laws in turbulent} == set(names(stress.TURBULENCE[key]))


def test_no_set_lets_a_bed_settle_without_end() -> None:
    for seed in range(30):
        for laws in stress.law_sets(seed=seed):
            pair = laws["closures.friction"], laws["closures.radial"]
            assert pair != ("none", "carnahan-starling")


def test_the_cases_fill_their_ranges_and_are_the_same_every_time() -> None:
    cases = stress.cases()
    assert len(cases) == stress.CASES
    assert [c.dump() for c in cases] == [c.dump() for c in stress.cases()]
    for key, (low, high, logarithmic) in stress.RANGES.items():
        found = [case[key] for case in cases]
        assert low <= min(found) and max(found) <= high
        if key != "solids.diameter":
            middle = math.sqrt(low * high) if logarithmic else (low + high) / 2
            assert 0.35 < sum(v < middle for v in found) / len(found) < 0.65
    angles = [case.scene.geometry.inclination_deg for case in cases]
    assert angles.count(0.0) > 20 and angles.count(90.0) > 20
    assert sum(0 < angle < 90 for angle in angles) > 60
    for scene in (case.scene for case in cases):
        solids, width = scene.model.solids, scene.geometry.hydraulic_diameter
        assert solids.diameter <= stress.LARGEST_GRAIN * width
        packed = scene.model.friction.name in stress.PLASTIC
        assert (solids.friction_limit == stress.PACKED_FRACTION) == packed


def test_a_constant_drag_is_of_the_size_of_its_scene() -> None:
    factors = []
    for scene in (case.scene for case in stress.cases()):
        if scene.model.drag.name == "constant":
            alpha, d = scene.feed.solids_fraction, scene.model.solids.diameter
            size = 150 * alpha * 1.8e-5 / ((1 - alpha) * d**2) + 18 * 1.8e-5 / d**2
            factors.append(scene.model.drag.value / size)
    low, high = stress.CONSTANT_DRAG
    assert len(factors) > 10 and low <= min(factors) < 1 < max(factors) <= high


@pytest.mark.slow
def test_where_the_standard_mesh_terms_fail_raised_ones_say_so(
    dense: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case.from_dict({**dense, "numerics": {"level": 1}})
    standard, run, sections = stress.solve(case), PseudoTime.run, {}

    def section(*given: Any) -> TwoFluidSection:
        made = TwoFluidSection(*given)
        sections[made.newton] = made
        return made

    def steady_if_raised(march: PseudoTime, *given: Any) -> History:
        if sections[march.newton].mesh_terms.strength < 4:
            raise SolverError("not steady")
        return run(march, *given)

    monkeypatch.setattr(physics.Dense, "scheme", replace(physics.SCHEME, section=section))
    monkeypatch.setattr(PseudoTime, "run", steady_if_raised)
    raised = stress.solve(case)
    assert (standard.mesh_terms, raised.mesh_terms) == (MeshTerms(), MeshTerms(4.0))
    assert 1e-4 < abs(raised.gradient / standard.gradient - 1)
    assert abs(raised.gradient - standard.gradient) < raised.error
    assert "1 of them with raised terms" in stress.summary([standard, raised])
    result = case.scene.run()
    assert any("4 times numerics.capture" in line for line in result.notes)
    monkeypatch.setattr(physics, "LARGEST_CHANGE", 1e-6)
    refused = stress.solve(case)
    assert not refused.converged and "which decide it" in refused.reason


def test_a_case_that_does_not_converge_has_a_reason_and_no_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = stress.cases(1, 1)[0]
    for failure in (SolverError("not steady after 3 steps"), ArithmeticError("bad matrix")):

        def fail(*given: object, failure: Exception = failure) -> None:
            raise failure

        monkeypatch.setattr(Developed, "solve", fail)
        outcome = stress.solve(case)
        assert not outcome.converged and math.isnan(outcome.gradient)
        assert str(failure) in outcome.reason


def test_an_answer_that_breaks_a_balance_does_not_count(
    dense: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case.from_dict({**dense, "numerics": {"level": 1}})
    good = stress.solve(case)
    assert good.converged and good.gradient > 0 and good.factorisations > 0
    monkeypatch.setattr(physics, "balances", lambda section: {"axial_momentum": 0.1})
    bad = stress.solve(case)
    assert not bad.converged and math.isnan(bad.gradient) and "axial_momentum" in bad.reason


def test_the_summary_counts_causes_without_their_numbers() -> None:
    reasons = ["", "below 1.5e-07 s (x)", "below 4.2e-08 s (x)", "not steady after 200 steps"]
    text = stress.summary([stress.Outcome(i, r, 10, 1.0) for i, r in enumerate(reasons)])
    assert "1 of 4 cases converged (25.0 %)" in text
    assert "   2  below # s (x)" in text


def test_run_time_against_error(tmp_path: Path) -> None:
    text = error.measured(demo(error.DEMO, {}), (1, 2), 3, ("triangle",), tmp_path / "error.png")
    rows = [line.split() for line in text.splitlines() if line.startswith("triangle")]
    assert [row[1] for row in rows] == ["1", "2"]
    assert int(rows[0][2]) < int(rows[1][2])
    assert all(0 < float(row[4]) < 0.05 for row in rows)
    assert (tmp_path / "error.png").stat().st_size > 0


def test_published_errors_are_against_the_finest_mesh() -> None:
    found = error.published_errors(error.PUBLISHED)
    assert list(found) == ["A", "B", "C"]
    assert found["A"] == (216_000, pytest.approx(0.0782, abs=1e-4))
    assert error.published_errors({}) == {}


def test_the_duct_is_measured_like_the_pipe() -> None:
    found = error.measure(duct.case(), "quadrilateral", 1)
    assert found.number > 0 and found.unknowns > found.number
    assert found.gradient > 0 and found.factorisations > 0


def test_without_the_checkout_there_is_nothing_to_measure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("fem_tfm.bench.demo.DEMOS", tmp_path)
    with pytest.raises(InputError, match="from a checkout of the repository"):
        bench.run("error", tmp_path)


def test_an_unknown_benchmark_is_refused() -> None:
    with pytest.raises(InputError, match="stress"):
        bench.run("strss")


@pytest.mark.slow
def test_the_quick_stress_ends_with_a_summary(capsys: pytest.CaptureFixture[str]) -> None:
    text = bench.run("stress-quick")
    assert "of 3 cases converged" in text
    told = capsys.readouterr().out
    assert sum(line.lstrip()[:1].isdigit() and "/3 " in line for line in told.splitlines()) == 3


def test_the_cost_of_the_unsteady_flow_is_measured() -> None:
    cost = unsteady.measure(1, 4, steps=4)
    assert cost.cells > 0 and cost.microseconds > 0
    assert cost.iterations["pressure"] > 0


@pytest.mark.slow
def test_the_unsteady_flow_holds_no_more_memory_with_every_step() -> None:
    assert unsteady.growth(400) < 2000


def test_the_unsteady_flow_is_held_against_the_march(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The first milliseconds of the filling: no grain has come as far as the last part."""
    wanted = unsteady_error.Found(100.0, 0.1)
    monkeypatch.setattr(unsteady_error, "reference", lambda wall, level: wanted)
    text = unsteady_error.run(tmp_path, "log-law", divisions=(1,), end=8e-3)
    first, second = (line.split() for line in text.splitlines()[3:5])
    assert [first[0], second[0]] == ["0", "1"] and first[1] == second[1] == "750"
    gradients = [float(row[4]) for row in (first, second)]
    assert 0 < gradients[0] == pytest.approx(gradients[1], rel=0.1)
    assert float(first[5]) == pytest.approx(abs(gradients[0] / 100 - 1), rel=0.05)
    assert float(first[6]) == pytest.approx(0.0, abs=1e-3)
    assert (tmp_path / "unsteady_error_log-law.png").stat().st_size > 10000


def test_unsteady_scenes_are_possible_varied_and_the_same_by_number() -> None:
    cases = [stress_unsteady.scene(number) for number in range(1, 101)]
    assert [c.dump() for c in cases[:3]] == [stress_unsteady.scene(n).dump() for n in range(1, 4)]
    for case in cases[:40]:
        case.scene.examine()
    kinds = Counter(type(case.scene.geometry).__name__ for case in cases)
    assert kinds["Pipe"] > 35 and min(kinds["Duct"], kinds["Bend"]) > 15
    least = {"numerics.order": 35, "initial.state": 20, "closures.turbulence.model": 10}
    for key, few in least.items():
        assert min(Counter(case[key] for case in cases).values()) > few
    for key in ("outlet_blocked", "gas_schedule", "solids_schedule"):
        assert sum(bool(case[f"operation.{key}"]) for case in cases) > 10
    courant = [case["numerics.courant"] for case in cases]
    assert min(courant) < 1.2 and max(courant) > 4.8
    for family in ("drag", "friction", "granular", "radial"):
        found = {case[f"closures.{family}.model"] for case in cases}
        assert found == set(names(family)) - stress.LEFT_OUT - {"constant"}


def test_unsteady_scenes_are_chosen_by_number() -> None:
    assert stress_unsteady.numbers("7") == (7, 7) and stress_unsteady.numbers("1-50") == (1, 50)
    for text in ("0", "5-3", "x", "-2"):
        with pytest.raises(InputError, match="--scenes"):
            stress_unsteady.numbers(text)
    with pytest.raises(InputError, match="stress-unsteady"):
        bench.run("stress", scenes="7")


def test_an_unsteady_scene_ends_or_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(stress_unsteady, "_tell", told.append)
    (ended,) = stress_unsteady.solve_all([41])
    assert ended.ended and ended.reached == 1 and 1 < ended.gas < 2 and ended.mass_error < 1e-12
    foreseen = float(stress_unsteady.scene(41).scene.describe()["time"].split()[-2])
    assert foreseen / 3 < ended.steps < 3 * foreseen
    monkeypatch.setattr(stress_unsteady, "MOST_STEPS", 5)
    (stopped,) = stress_unsteady.solve_all([41])
    assert not stopped.ended and stopped.steps == 5 and "have not reached" in stopped.reason
    text = stress_unsteady.summary([ended, stopped])
    assert "1 of 2 scenes ended (50.0 %)" in text and "# steps have not reached the end" in text
    assert "grains" in told[-1]
