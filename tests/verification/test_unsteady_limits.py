# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow against closed forms: channels, beds, settling, cooling and shear."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import AIR, GRAINS, box, flow, immovable
from mpi4py import MPI
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq, fsolve

from fem_tfm.closures import make
from fem_tfm.closures.granular import lun_pressure
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, SolidsTransport, StepFailed
from fem_tfm.models.finite_volume.time_levels import Step, implicit_euler
from fem_tfm.models.pointwise import tangential

G = 9.81
UPRIGHT = {"geometry.inclination_deg": 90.0, "operation.gravity": G}
# gas so thin that grains do not feel it
VACUUM = {"gas.density": 1e-10, "gas.viscosity": 1e-18, "closures.drag": "wen-yu"}


def owned(found: UnsteadyFlow, values: np.ndarray) -> np.ndarray:
    """What the cells of all ranks hold, along the first axis."""
    return np.concatenate(MPI.COMM_WORLD.allgather(values[: found.cells.owned]))


def line(found: UnsteadyFlow, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights and values of a column of one cell's width, upwards."""
    z, values = owned(found, found.cells.centre)[:, 2], owned(found, values)
    order = np.argsort(z)
    return z[order], values[order]


def drag_of(found: UnsteadyFlow, alpha: float, slip: float) -> float:
    """beta [kg/m3/s] of the case's law."""
    return found.problem.closures.drag.beta(alpha, slip, found.gas, found.solids)


@pytest.fixture(params=[0, 1], ids=["order0", "order1"])
def order(request: pytest.FixtureRequest) -> int:
    return request.param


def test_gas_between_plates_has_the_profile_of_poiseuille(order: int) -> None:
    viscosity, speed, height = 0.01, 0.1, 0.01
    mesh = box((0.01, height, 0.05), (1, 40, 10), "sswwio")
    found = flow(
        mesh,
        {
            "gas": {"density": 1.0, "viscosity": viscosity},
            "operation.gas_superficial_velocity": speed,
            "walls.gas": "no-slip",
        },
        alone=True,
        order=order,
    )
    found.set_velocities(np.zeros(3), np.array([0.0, 0.0, speed]))
    for _ in range(60):
        found.advance(1e-3, Inflow(speed))
    centre, p = owned(found, found.cells.centre), owned(found, found.now.p)
    layers = [np.isclose(centre[:, 2], (i + 0.5) * mesh.length / 10) for i in (4, 5)]
    gradient = (p[layers[0]].mean() - p[layers[1]].mean()) / (mesh.length / 10)
    assert gradient == pytest.approx(12 * viscosity * speed / height**2, rel=0.01)
    u, y = owned(found, found.now.u_g)[layers[0], 2], centre[layers[0], 1] / height
    assert u == pytest.approx(1.5 * speed * (1 - 4 * y**2), abs=0.01 * speed)


@pytest.mark.parametrize("layers", [8, 16, 32])
def test_turbulent_gas_between_plates_feels_the_wall_alike_on_every_mesh(layers: int) -> None:
    # the log law up to y_p and the mixing length beyond tell the gradient of this mean velocity
    speed, height, length, offset = 100.0, 0.02, 2.0, 5e-4
    gas, law = Gas(1.2, 1.8e-5), make("turbulence", "mixing-length")
    found = flow(
        box((1.0, height, length), (1, layers, 10), "sswwio"),
        {
            "operation.gas_superficial_velocity": speed,
            "closures.turbulence": "mixing-length",
            "walls.gas": "log-law",
            "walls.distance": offset,
        },
        alone=True,
    )
    found.set_velocities(np.zeros(3), np.array([0.0, 0.0, speed]))
    # steps a hundred times as long as the gas takes to even out across the finest layer
    for _ in range(40):
        found.advance(0.02, Inflow(speed))
    centre, p = owned(found, found.cells.centre)[:, 2], owned(found, found.now.p)
    means = [p[np.isclose(centre, (i + 0.5) * length / 10)].mean() for i in (7, 8)]
    gradient = (means[0] - means[1]) / (length / 10)

    y = np.geomspace(offset, height / 2, 500)

    def bulk(gradient: float) -> float:
        def shear(distance: float) -> float:
            def surplus(rate: float) -> float:
                mu_t = law.eddy_viscosity(rate, distance, gas, found.laws.diameter / 2)
                return (gas.viscosity + mu_t) * rate - gradient * (height / 2 - distance)

            return brentq(surplus, 0.0, gradient * height / gas.viscosity)

        friction = math.sqrt(gradient * height / 2 / gas.density)
        start = friction / 0.41 * math.log(9.8 * friction * offset * gas.density / gas.viscosity)
        u = start + cumulative_trapezoid([shear(d) for d in y], y, initial=0.0)
        strip = offset * (start - friction / 0.41)
        return float((np.trapezoid(u, y) + strip) / (height / 2))

    assert gradient == pytest.approx(brentq(lambda g: bulk(g) - speed, 500.0, 1e4), rel=0.015)


@pytest.mark.parametrize("angle", [0.0, 0.6])
@pytest.mark.parametrize("sides", ["s", "w"])
@pytest.mark.parametrize("step", [1e-3, 0.05])
def test_a_vortex_in_a_box_dies_as_its_sides_bear_it(
    step: float, sides: str, angle: float, order: int
) -> None:
    """u = (cos kx sin ky, -sin kx cos ky) exp(-2 nu k^2 t): nothing rubs, du_n/dn is largest."""
    size, viscosity, cells = 0.01, 1e-2, 16
    mesh = box((size, size, size / cells), (cells, cells, 1), f"{4 * sides}ss")
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    points = mesh.mesh.geometry.x
    points[:, :2] = points[:, :2] @ turn.T
    found = flow(mesh, {"gas": {"density": 1.0, "viscosity": viscosity}}, alone=True, order=order)
    k = math.pi / size
    x, y = k * (found.cells.centre[:, :2] @ turn).T
    u = 1e-3 * np.stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y)], axis=1) @ turn.T
    found.set_velocities(np.zeros(3), np.pad(u, ((0, 0), (0, 1))))
    rate, sizes = 2 * viscosity * k**2, []
    for _ in range(15):
        found.advance(step / rate, Inflow(0.0))
        sizes.append(np.linalg.norm(owned(found, found.now.u_g)))
    # Euler's step divides by 1 + rate dt
    wanted = 10 * (step if order else math.log1p(step))
    assert math.log(sizes[4] / sizes[14]) == pytest.approx(wanted, rel=0.02)


def test_grains_that_spread_along_a_side_are_not_drawn_to_it() -> None:
    """u_z = s z has the same normal stress (bulk - 2/3 mu) s everywhere across."""
    rate, dt, alpha = 10.0, 1e-5, 0.3
    found = flow(box((0.01, 0.01, 0.05), (4, 4, 10), "swswio"), VACUUM)
    found.initialise(alpha, theta=1.0)
    u_s, u_g = np.zeros((2, found.cells.count, 3))
    u_s[:, 2] = rate * found.cells.centre[:, 2]
    u_g[:, 2] = 1.0 - alpha / (1 - alpha) * u_s[:, 2]
    found.set_velocities(u_s, u_g)
    kinetic = found.laws.kinetic(found.now.alpha, found.now.theta, None)[1]
    stress = rate * (kinetic.bulk_viscosity - 2 / 3 * kinetic.shear_viscosity)
    found.advance(dt, Inflow(1.0, alpha, 1e-6))
    pulled = np.abs(stress).max() * dt / (alpha * GRAINS["density"] * 0.01 / 4)
    middle = np.abs(found.cells.centre[:, 2] - 0.025) < 0.01
    assert np.abs(found.now.u_s[middle, :2]).max() < 0.05 * pulled


@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_gas_through_a_fixed_bed_loses_what_ergun_says(speed: float, order: int) -> None:
    # grains too heavy to be moved within the run
    found = flow(box((0.02, 0.02, 0.1), (1, 1, 10)), {"solids.density": 25000.0}, order=order)
    found.initialise(0.6)
    for _ in range(3):
        found.advance(1e-6, Inflow(speed, blocked=True))
    z, p = line(found, found.now.p)
    beta = drag_of(found, 0.6, speed / 0.4)
    assert -np.polyfit(z, p, 1)[0] == pytest.approx(beta * speed / 0.4**2, rel=1e-3)


def test_long_steps_find_the_drop_of_a_fixed_bed(order: int) -> None:
    # with the drag of the slip foreseen alone, flow and drag would take turns at second order
    speed, alpha, length, cells = 2.8, 0.4, 1.0, 40
    found = flow(box((0.02, 0.02, length), (1, 1, cells)), order=order)
    # grains that nothing moves
    found.laws.solids = immovable(found.solids)
    found.initialise(alpha)
    drops = []
    for _ in range(40):
        found.advance(2e-2, Inflow(speed))
        drops.append(found.quantities()["pressure_drop"])
    gradient = drag_of(found, alpha, speed / (1 - alpha)) * speed / (1 - alpha) ** 2
    # from face to face
    assert drops[-10:] == pytest.approx([gradient * length] * 10, rel=1e-3)


def test_a_bed_is_lifted_from_the_minimum_fluidisation_velocity_on(order: int) -> None:
    found = flow(box((0.02, 0.02, 0.1), (1, 1, 10)), UPRIGHT, order=order)
    weight = 0.6 * (GRAINS["density"] - AIR["density"]) * G
    minimum = brentq(lambda u: drag_of(found, 0.6, u / 0.4) * u / 0.4**2 - weight, 1e-3, 10)

    def lift(speed: float) -> float:
        """Acceleration of the middle of a bed that is let go."""
        found.initialise(0.6)
        u = []
        for _ in range(6):
            found.advance(1e-5, Inflow(speed))
            u.append(line(found, found.now.u_s[:, 2])[1][5])
        # the first step sets the gas in motion
        return u[-1] - u[1]

    assert brentq(lift, 0.5 * minimum, 2 * minimum, rtol=1e-4) == pytest.approx(minimum, rel=0.02)


@pytest.mark.parametrize("alpha", [1e-8, 1e-3, 0.1, 0.3])
@pytest.mark.parametrize("step", [0.2, 10.0])
def test_grains_settle_at_their_terminal_velocity(alpha: float, step: float, order: int) -> None:
    speed = 1.0
    changes = {**UPRIGHT, "solids.diameter": 1e-4, "closures.drag": "wen-yu"}
    found = flow(box((1.0, 1.0, 20.0), (1, 1, 10)), changes, order=order)
    found.initialise(alpha)
    # gas and grains share the flux that enters from the start
    found.set_velocities(np.array([0, 0, speed]), np.array([0, 0, speed]))
    weight = alpha * (1 - alpha) * (GRAINS["density"] - AIR["density"]) * G
    slip = brentq(lambda u: drag_of(found, alpha, u) * u - weight, 1e-6, 10)
    settling = speed - (1 - alpha) * slip
    feed = Inflow((speed - alpha * settling), alpha, settling)
    dt = step * alpha * GRAINS["density"] / drag_of(found, alpha, slip)
    for _ in range(40):
        found.advance(dt, feed)
    u_s, u_g = line(found, found.now.u_s[:, 2])[1][5], line(found, found.now.u_g[:, 2])[1][5]
    assert u_g - u_s == pytest.approx(slip, rel=0.01)


@pytest.mark.parametrize(
    ("dt", "steps"), [pytest.param(3e-4, 1000, marks=pytest.mark.slow), (1e-3, 500)]
)
def test_a_settled_column_rests_on_its_own_pressure(dt: float, steps: int, order: int) -> None:
    changes = {**UPRIGHT, "closures.friction": "berzi", "operation.gas_superficial_velocity": 0.1}
    found = flow(box((0.01, 0.01, 0.1), (1, 1, 20), "sssswo"), changes, order=order)
    found.initialise(np.where(found.cells.centre[:, 2] < 0.05, 0.55, 0.0))
    for _ in range(steps):
        found.advance(dt, Inflow(0.0))
    alpha = line(found, found.now.alpha)[1]
    rates = found.deformation(found.now).rates
    p_s = found.laws.solids_pressure(found.now.alpha, found.now.theta, *rates)
    p_s, u = line(found, p_s)[1], line(found, found.now.u_s[:, 2])[1]
    above = np.cumsum(alpha[::-1])[::-1] - alpha / 2
    weight = (GRAINS["density"] - AIR["density"]) * G * 0.005 * above
    assert p_s[:6] == pytest.approx(weight[:6], rel=0.01)
    # larger steps ring at the bottom if a flux is carried on that alternates
    assert np.abs(u[:5]).max() < 1e-3


def column(cells: int, order: int = 0, friction: str = "berzi") -> UnsteadyFlow:
    """An empty column, closed below, of twice the cells that are to be filled."""
    changes = {**UPRIGHT, "closures.friction": friction}
    changes["operation.gas_superficial_velocity"] = 0.1
    mesh = box((0.01, 0.01, 0.00625 * 2 * cells), (1, 1, 2 * cells), "sssswo")
    return flow(mesh, changes, order=order)


def hydrostatic(found: UnsteadyFlow, cells: int, surface: float) -> np.ndarray:
    """Solids fractions whose pressure bears what lies above the centre of each cell."""
    heavy = (GRAINS["density"] - AIR["density"]) * G * found.mesh.length / (2 * cells)
    theta = found.laws.regularisation.theta_floor

    def pressure(alpha: float) -> float:
        return found.laws.solids_pressure(alpha, theta, 0.0, 0.0)

    # the uppermost cell lays on its upper half what it can bear
    fractions, above = [surface], heavy * surface - min(pressure(surface), heavy * surface / 2)
    for _ in range(cells - 1):
        above += pressure(fractions[0])
        limit = found.solids.packing_limit - 1e-9
        alpha = brentq(lambda a, w=above: pressure(a) - w - heavy * a / 2, 0.3, limit, xtol=1e-15)
        fractions.insert(0, alpha)
        above = heavy * alpha / 2
    layer = (found.cells.centre[:, 2] / found.mesh.length * 2 * cells).astype(int)
    return np.concatenate([fractions, np.zeros(cells)])[layer]


def fastest(found: UnsteadyFlow, dt: float, time: float) -> float:
    """Largest speed of either phase in any cell while `time` passes [m/s]."""
    speed = 0.0
    for _ in range(round(time / dt)):
        found.advance(dt, Inflow(0.0))
        # what a void lacks of the smallest fraction is not there to move
        solids = found.now.u_s[found.now.alpha > SMALLEST_FRACTION]
        speed = max(speed, *(found.cells.largest(abs(u)) for u in (solids, found.now.u_g)))
    return speed


@pytest.mark.parametrize(("dt", "surface"), [(3e-4, 0.59), (2e-3, 0.3)])
@pytest.mark.parametrize("cells", [8, 24])
def test_a_column_at_rest_stays_at_rest(cells: int, dt: float, surface: float, order: int) -> None:
    found = column(cells, order)
    found.initialise(hydrostatic(found, cells, surface))
    assert fastest(found, dt, 0.15) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("dt", [3e-4, 1e-3])
@pytest.mark.parametrize("cells", [8, 24])
def test_a_column_at_rest_stays_so_for_a_second(cells: int, dt: float, order: int) -> None:
    found = column(cells, order)
    found.initialise(hydrostatic(found, cells, 0.3))
    assert fastest(found, dt, 1.0) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("dt", [3e-4, 1e-3])
def test_a_column_comes_to_rest(dt: float) -> None:
    found = column(8)
    height = found.cells.centre[:, 2] / found.mesh.length
    found.initialise(np.where(height < 0.5, 0.55, 0.0))
    fastest(found, dt, 6.0)
    assert fastest(found, dt, 1.0) < 1e-6


def cooled(e: float, alpha: float, steps: int, order: int = 0) -> float:
    """Theta over Haff's law, Theta_0/(1 + t/t_0)^2, after twice the time of cooling t_0."""
    changes = {**VACUUM, "solids.restitution": e, "closures.radial": "carnahan-starling"}
    found = flow(box((0.01, 0.01, 0.01), (2, 2, 2), "ssssss"), changes, order=order)
    theta = 0.01
    found.initialise(alpha, theta)
    g0 = (1 - alpha / 2) / (1 - alpha) ** 3
    rate = 8 * (1 - e**2) * g0 * alpha / (GRAINS["diameter"] * math.sqrt(math.pi))
    time = 2 / (rate * math.sqrt(theta))
    for _ in range(steps):
        found.advance(2 * time / steps, Inflow(0.0))
    assert np.ptp(found.now.theta) < 1e-9 * theta
    return float(found.now.theta[0]) * (1 + 2.0) ** 2 / theta


@pytest.mark.parametrize(("e", "alpha"), [(0.8, 0.3), (0.9, 0.1)])
def test_a_granular_gas_cools_as_haff_says(e: float, alpha: float) -> None:
    assert cooled(e, alpha, 200) == pytest.approx(1, rel=0.01)


def test_cooling_is_of_second_order_in_time() -> None:
    coarse, fine = (abs(cooled(0.8, 0.3, steps, order=1) - 1) for steps in (20, 40))
    assert np.log2(coarse / fine) > 1.8
    assert fine < 0.003


@pytest.mark.parametrize("force", ["full", "alpha"])
def test_a_hot_end_drives_grains_by_the_whole_pressure_alone(force: str, order: int) -> None:
    """du_s/dt = -(p/Theta)/(alpha rho_s) dTheta/dz in a uniform fraction, or nothing."""
    alpha, slope, dt = 0.3, 5.0, 1e-6
    changes = {**VACUUM, "closures.pressure_force": force}
    found = flow(box((0.01, 0.01, 0.1), (1, 1, 10), "ssssss"), changes, order=order)
    z = found.cells.centre[:, 2]
    found.initialise(alpha, 0.5 + slope * z)
    for _ in range(3):
        found.advance(dt, Inflow(0.0))
    per_theta = found.laws.pressure_per_theta(found.now.alpha, found.now.theta)
    wanted = -per_theta / (alpha * GRAINS["density"]) * slope * 3 * dt
    inside = abs(z - 0.05) < 0.03
    if force == "alpha":
        assert np.abs(found.now.u_s).max() < 1e-3 * np.abs(wanted).max()
    else:
        assert found.now.u_s[inside, 2] == pytest.approx(wanted[inside], rel=0.01)


@pytest.mark.parametrize("theory", ["lun", "syamlal-obrien"])
@pytest.mark.parametrize("friction", ["none", "schaeffer", "johnson-jackson"])
@pytest.mark.parametrize("force", ["full", "alpha"])
def test_the_matrix_of_the_fraction_is_an_m_matrix(
    force: str, friction: str, theory: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However steep Theta is: off-diagonals <= 0, and a diagonal above the sum of its column."""
    changes = {"pressure_force": force, "friction": friction, "granular": theory}
    closures = {f"closures.{name}": law for name, law in changes.items()}
    found = flow(box((0.01, 0.01, 0.02), (3, 3, 6), "ssssss"), VACUUM | closures)
    rng, count, cells = np.random.default_rng(4), found.cells.count, found.cells
    theta = 10 ** rng.uniform(-8, 1, count)
    found.initialise(rng.uniform(1e-4, 0.62, count), theta)
    entries, kept = [], CellMatrix.set

    def spied(matrix: CellMatrix, diagonal: Any, across: Any, *more: Any) -> None:
        entries.append((diagonal[0], *across[0]))
        kept(matrix, diagonal, across, *more)

    monkeypatch.setattr(CellMatrix, "set", spied)
    with contextlib.suppress(StepFailed):
        found.advance(1e-3, Inflow(0.0))
    diagonal, of_first, of_second = entries[0]
    assert diagonal.shape == (count,)
    assert of_first.max() <= 0 and of_second.max() <= 0
    assert min(of_first.min(), of_second.min()) < 0
    inner = found.line.inner
    column = np.bincount(cells.second, of_first, count)
    column += np.bincount(cells.first[inner], of_second, count)
    assert (diagonal + column > -1e-9 * diagonal).all()


@pytest.mark.parametrize("start", [1e-12, 1.0])
@pytest.mark.parametrize(("e", "alpha"), [(1.0, 0.01), (0.8, 0.3)])
def test_slip_agitates_grains_to_the_balance_at_a_point(
    e: float, alpha: float, start: float
) -> None:
    """Production = dissipation after a few steps longer than Theta lives, from either side."""
    slip, changes = 3.0, {"solids.restitution": e, "closures.slip_production": "koch"}
    found = flow(box((0.01, 0.01, 0.01), (2, 2, 2), "ssssss"), changes)
    found.initialise(alpha, start)
    u_s = np.zeros_like(found.now.u_s)
    u_g = u_s + np.array([0.0, 0.0, slip])
    still, rest = np.zeros(found.cells.face_count), np.zeros(found.cells.count)
    beta = rest + drag_of(found, alpha, slip)
    for _ in range(30):
        moving = replace(found.now, u_s=u_s, u_g=u_g)
        solids = SolidsTransport(moving.alpha, still, still, rest, rest, np.ones(0), rest)
        step = Step(implicit_euler(found.line, moving, 1.0), 1.0, Inflow(0.0), moving, beta, beta)
        step = replace(step, solids=solids, deformation=found.deformation(moving))
        theta, _ = found.temperature.solve(step)
        found.now = replace(found.now, theta=theta)
    laws, at = found.laws, (found.now.alpha, found.now.theta)
    energy = laws.granular_energy(
        laws.coefficients(*at, rest, rest, beta), *at, rest, rest, beta, u_g - u_s
    )
    assert energy.production == pytest.approx(energy.decay * found.now.theta, rel=1e-5)
    gamma = laws.kinetic(*at, beta)[1].dissipation
    power = laws.closures.slip_production.production(*at, beta, slip**2, found.solids).power
    assert power == pytest.approx(gamma + 3 * beta * found.now.theta, rel=1e-5)
    assert found.now.theta.min() > 1e-4


@pytest.mark.parametrize(
    ("e", "alpha", "wanted"), [(0.8, 0.3, 0.6598), (0.9, 0.5, 0.9261), (0.95, 0.1, 13.56)]
)
def test_sheared_grains_reach_the_temperature_of_the_closed_form(
    e: float, alpha: float, wanted: float
) -> None:
    shear = 40.0
    changes = {**VACUUM, "solids.restitution": e, "closures.radial": "carnahan-starling"}
    found = flow(box((0.01, 0.01, 0.01), (3, 3, 3), "ssssss"), changes)
    scale = (GRAINS["diameter"] * shear) ** 2
    found.initialise(alpha, scale)
    u_s = np.zeros_like(found.now.u_s)
    u_s[:, 2] = shear * found.cells.centre[:, 1]
    still, rest = np.zeros(found.cells.face_count), np.zeros(found.cells.count)
    for _ in range(300):
        moving = replace(found.now, u_s=u_s, u_g=u_s)
        solids = SolidsTransport(moving.alpha, still, still, rest, rest, np.ones(0), rest)
        levels = implicit_euler(found.line, moving, 5e-3)
        step = Step(levels, 5e-3, Inflow(0.0), moving, beta=rest, drag=rest, solids=solids)
        step = replace(step, deformation=found.deformation(moving))
        theta, _ = found.temperature.solve(step)
        found.now = replace(found.now, theta=theta)
    assert found.now.theta == pytest.approx(wanted * scale, rel=0.01)


def test_gas_without_grains_flows_as_gas_alone(order: int) -> None:
    mesh = box((0.02, 0.02, 0.1), (3, 4, 8), "wwwwio")
    changes = {"walls.gas": "no-slip", "closures.turbulence": "mixing-length"}
    both, alone = (flow(mesh, changes, alone, order) for alone in (False, True))
    for _ in range(20):
        for found in (both, alone):
            found.advance(2e-3, Inflow(1.0))
    assert both.now.u_g == pytest.approx(alone.now.u_g, abs=1e-5)
    assert both.now.p == pytest.approx(alone.now.p, abs=1e-5 * np.abs(alone.now.p).max())


def wall_friction(
    law: str, centre: WallState, solids: Solids, stiffness: float, conductance: float
) -> float:
    """Friction over the velocity at a centre, half a cell from the wall where the law holds."""
    one = replace(centre, **{name: np.ravel(v)[0] for name, v in vars(centre).items()})
    wall, radial = make("solids-wall", law), make("radial", "savage")

    def touching(at: np.ndarray) -> WallState:
        alpha, slip, theta = at[2] * one.alpha_s, at[0] * one.slip, at[1] * one.theta
        g0 = radial.g0(alpha, solids)
        return replace(one, alpha_s=alpha, slip=slip, theta=theta, g0=g0)

    def pressure(state: WallState) -> float:
        return float(lun_pressure(state.alpha_s, state.theta, state.g0, solids))

    def missing(at: np.ndarray) -> list[float]:
        state = touching(at)
        pull = stiffness * (one.slip - state.slip) - wall.friction(state, solids) * state.slip
        heat = conductance * (state.theta - one.theta) - wall.heat(state, solids)
        push = pressure(state) / pressure(one) - 1
        return [pull / (stiffness * one.slip), heat / (conductance * one.theta), push]

    found = fsolve(missing, [0.9, 1.1, 0.9], xtol=1e-13)
    return found[0] * float(wall.friction(touching(found), solids))


@pytest.mark.parametrize(
    "law", ["free-slip", "coulomb", "johnson-jackson", "rough", "schneiderbauer"]
)
def test_walls_slow_grains_as_their_law_says(law: str) -> None:
    # a slice of grains without gas between four walls: the drop of its momentum is the traction
    size, dt, alpha, speed = 0.01, 1e-5, 0.3, 1.0
    found = flow(box((size, size, size), (1, 1, 2), "wwwwoo"), {**VACUUM, "walls.solids": law})
    found.initialise(alpha, 0.01)
    u = np.array([0.0, 0.0, speed])
    found.now = replace(found.now, u_s=np.broadcast_to(u, found.now.u_s.shape).copy())
    now, laws, edge = found.now, found.laws, found.cells.first[found.line.wall]
    rates, rest = found.deformation(now), np.zeros(found.cells.count)
    slip = tangential(now.u_s[edge], found.line.normal[found.line.wall])
    grains = laws.coefficients(now.alpha, now.theta, *rates.rates, None)
    state = laws.wall_state(now.alpha, now.theta, grains, slip, edge)
    assert state.slip == pytest.approx(speed)
    near = 2 / size
    stiffness, conductance = grains.viscosity[0] * near, grains.kinetic.conductivity[0] * near
    friction = wall_friction(law, state, found.solids, stiffness, conductance)
    rate = 4 * friction / (GRAINS["density"] * alpha * size)
    still = np.zeros(found.cells.face_count)
    solids = SolidsTransport(now.alpha, still, still, rest, now.p, np.ones(edge.size), rest)
    levels = implicit_euler(found.line, now, dt)
    step = Step(
        levels, dt, Inflow(0.0), now, beta=rest, drag=rest, solids=solids, deformation=rates
    )
    accelerations = [np.zeros_like(now.u_s)] * 2
    velocities, _ = found.momentum.solve(step, found.momentum.phases(step), accelerations)
    assert velocities[0][:, 2] == pytest.approx(speed / (1 + rate * dt), rel=1e-6)
