# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dense gas-solid flow by the two-fluid model in a section: what only this model tells."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path
from typing import Any

from fem_tfm.errors import SolverError
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.models import transfer
from fem_tfm.models.section import between
from fem_tfm.models.two_fluid import initial
from fem_tfm.models.two_fluid.forms import Stabilisation
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.models.two_fluid.quantities import balances, pressure_gradient, quantities
from fem_tfm.models.two_fluid.section import Setup, TwoFluidSection
from fem_tfm.output.fields import snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.pictures import SectionView, section_picture, vertical_profile
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Result
from fem_tfm.scenes.judged import plausible
from fem_tfm.scenes.judged.gas import loading, y_plus
from fem_tfm.scenes.judged.memory import check_memory, section_cells
from fem_tfm.scenes.judged.plausible import check_flux
from fem_tfm.scenes.physics import (
    SECTION_COLUMNS,
    SECTION_FILES,
    Physics,
    SectionPhysics,
    residence_control,
)
from fem_tfm.solvers import nested

# coarsest mesh of the nested iteration, core cell over the hydraulic diameter
COARSEST = 0.25
# regularisations in units of U_g and D; docs/dense_section.md has their effect on the gradient
ALPHA_DIFFUSION, WALL_SPEED, PRESSURE_SHIFT = 1.5e-7, 0.1, 1e-8
WALL_PENALTY, SMOOTHING, SMALLEST_RATE = 200.0, 0.05, 1e-4
# hold-up below which the diffusion of voids falls: there it would flatten what eddies spread
DILUTE = 1e-2
# residual solids fraction of the drag over the hold-up
RESIDUAL = 1e-3
# a state that breaks a balance by more is no answer
BALANCE_ERROR = 1e-6
# and one whose gradient the raised terms of the mesh change by a larger share is none either
LARGEST_CHANGE = 0.5
# first step of pseudo-time in units of the residence time D/U_g
FIRST_STEP, GROWTH = 0.13, 1.8
COLUMNS = {**SECTION_COLUMNS, "max_alpha_s": "", "max_theta": "m2/s2"}
WARNED = ("update", "pressure_gradient", "max_alpha_s", "max_theta")

PROFILE_UNITS = {
    "y": "m",
    "y/D": "-",
    "alpha_s": "-",
    "u_s": "m/s",
    "u_g": "m/s",
    "Theta": "m2/s2",
    "pressure": "Pa",
    "k": "m2/s2",
    "eps": "m2/s3",
    "k_s": "m2/s2",
    "eps_s": "m2/s3",
}


# measured on the demo: unknowns of P2/P1 triangles, memory and CPU time of a cold run, and how much
# more of it an unknown takes where turbulence is transported (2 to 11 times)
UNKNOWNS_PER_CELL, GAS_UNKNOWNS_PER_CELL, UNKNOWNS_PER_SCALE = 17.5, 6.8, 2.1
BASE_MEMORY, MEMORY_PER_UNKNOWN, TIME_PER_UNKNOWN, TRANSPORT_FACTOR = 170, 0.012, 2.5e-4, 4
COMPILE_TIME, COMPILE_TIME_PER_SCALE = 15, 11
# how much more a level line takes: where grains bounce (polyethylene, coal), where they make a bed,
# or a strand as eddies hold them up in part: it starts several times, and a third mesh follows
# (pulverised coal, flour, the line of the README); and once more where eddies lift the grains of a
# bed (cement): meshes disagree and finer ones follow
BOUNCING_FACTOR, BED_FACTOR, LIFTED_FACTOR = 4, 24, 2
# hold-up up to which that was measured above the saltation velocity: dense flows take no longer
SPARSE = 0.03
# distances of a wall law over the diameter: the largest, and the default, which a slow gas may have
# inside its sublayer; a smaller one was given, and has to have this y+
LARGEST_OFFSET, LEAST_OFFSET, LEAST_Y_PLUS = 0.1, 0.01, 5.0


def with_wall_cell(physics: Physics) -> Resolution:
    """Resolution with the cell at the wall that the wall law of the gas asks for."""
    scene, resolution = physics.scene, physics.resolution
    height = scene.model.wall_cell(scene.feed.gas_velocity, scene.geometry.hydraulic_diameter)
    return resolution.with_wall_cell(physics.section, height) if height else resolution


def setup_of(scene: Any) -> Setup:
    """Numbers of the section that a scene describes."""
    model, speed, width = scene.model, scene.feed.gas_velocity, scene.geometry.hydraulic_diameter
    given, diffusion = model.section_terms, model.section_terms.alpha_diffusion
    holdup = likely_holdup(scene)
    share = holdup / (holdup + DILUTE)
    numerics = Stabilisation.scaled(
        speed,
        width,
        model.solids,
        given.theta_floor,
        model.grain_gap * (model.solids.diameter if model.solids else 0.0),
        alpha_diffusion=share * ALPHA_DIFFUSION * speed * width if diffusion is None else diffusion,
        capture=given.capture,
        damping=given.damping,
        smallest_front_rate=share * SMALLEST_RATE * speed / width,
        smallest_rate=SMALLEST_RATE * speed / width,
        wall_penalty=WALL_PENALTY,
        wall_speed=WALL_SPEED * speed,
        pressure_shift=PRESSURE_SHIFT / (width * model.gas.density * speed),
        relaxation=width / speed,
        residual_fraction=RESIDUAL * holdup,
        theta_free=speed**2 + scene.feed.gravity * width,
        smoothing=SMOOTHING * width,
    )
    return Setup(
        model=model,
        numerics=numerics,
        gravity=scene.gravity,
        wall_offset=scene.wall_offset,
        gas_velocity=speed,
        feed=scene.solids_feed,
        quadrature_degree=scene.numerics.quadrature_degree,
    )


def likely_holdup(scene: Any) -> float:
    """Hold-up as given, or that of a given flux without slip, j_s/(j_s + U_g) [-]."""
    if scene.solids_feed is None:
        return 0.0
    kind, value = scene.solids_feed
    return float(value if kind == "holdup" else value / (value + scene.feed.gas_velocity))


SCHEME = nested.Scheme(
    section=TwoFluidSection,
    cold=initial.cold,
    warm=transfer.warm,
    follow=transfer.follow,
    control=partial(residence_control, first=FIRST_STEP, growth=GROWTH),
    between=between,
    ease=TwoFluidSection.ease,
    calm=initial.calm,
)


class Dense(SectionPhysics):
    """What a scene of the two-fluid model tells of its section."""

    headline = "pressure_gradient"
    scheme = SCHEME
    columns = COLUMNS
    warned = WARNED
    files = SECTION_FILES
    first_step, coarsest = FIRST_STEP, COARSEST
    balance_error = BALANCE_ERROR
    solved_words = "developed section by the two-fluid model: steady, d/dz = 0"

    def __init__(self, scene: Any) -> None:
        super().__init__(scene)
        self.resolution = with_wall_cell(self)

    def setup(self) -> Setup:
        """Numbers of the section."""
        return setup_of(self.scene)

    def signs(self, section: TwoFluidSection) -> dict[str, float]:
        """The early warning: gradient [Pa/m] and extremes of the solids."""
        return {"pressure_gradient": pressure_gradient(section), **section.extremes()}

    def told(self, solution: nested.Solution) -> dict[str, Any]:
        """What an answer is made of: quantities, errors, balances and notes.

        Raises
        ------
        SolverError
            a balance is broken, or the terms of the mesh decide the answer.
        """
        section = solution.section
        balances = checked_balances(section)
        found, errors = estimated(solution, self.scene.geometry.length)
        alone, notes = len(solution.levels) == 1, []
        if section.mesh_terms.raised:
            notes.append(raised_terms(section, alone))
        return {"quantities": found, "errors": errors, "balances": balances, "notes": notes}

    def write(self, section: TwoFluidSection, result: Result, out: Path | None, told: Any) -> None:
        """Profiles along the vertical diameter, for the result and the files, and the picture."""
        write_section(self.scene, section, result, out)

    # -- words ---------------------------------------------------------------------------------

    def skipped(self) -> list[str]:
        """Parts of the section and laws that the scene does without."""
        left_out = []
        if self.section.symmetry == "half":
            left_out.append("left half: mirror image of the right one")
        return left_out + skipped_laws(self.scene.model)

    def skipped_of_axis(self) -> list[str]:
        """What a gas of one density leaves out along the axis."""
        if self.scene.feed.outlet_pressure is None:
            return []
        return ["compressibility: the gas has one density along the line"]

    def advice(self) -> list[str]:
        """What a user probably did not mean, one sentence each."""
        return advice(self.scene)

    def given(self) -> str:
        """What is given and what is found, in words."""
        gas = f"gas {self.scene.feed.gas_velocity:g} m/s superficial"
        if self.scene.model.solids is None:
            return gas
        kind, value = self.scene.solids_feed
        if kind == "holdup":
            return f"{gas}, hold-up {value:g}; found: pressure gradient and solids flux"
        return f"{gas}, solids {value:.4g} m/s superficial; found: pressure gradient and hold-up"

    def entering(self) -> str:
        """What enters a line, in words."""
        return entering(self.scene)

    @cached_property
    def size(self) -> tuple[int, int]:
        """Cells of the finest mesh, and about how many unknowns."""
        cells = self.meshes()[-1]().num_cells
        return cells, self.unknowns(cells)

    def examine(self) -> None:
        """Refuse a feed that cannot be, and a mesh beyond the machine; raises InputError."""
        check_flux(self.scene)
        unknowns = self.unknowns(section_cells(self.section, self.resolution))
        check_memory(self.cost(unknowns)["memory"], self.scene.resolution)

    def unknowns(self, cells: float) -> int:
        """About how many unknowns a mesh has."""
        per_cell = UNKNOWNS_PER_CELL if self.scene.model.solids else GAS_UNKNOWNS_PER_CELL
        scales = len(self.scene.model.scales) * UNKNOWNS_PER_SCALE
        return round(cells * (per_cell + scales))

    def cost(self, unknowns: int) -> dict[str, float]:
        """About the memory [MB] and the CPU time [s] of solving and of compiling the forms."""
        scales = len(self.scene.model.scales)
        factor = TRANSPORT_FACTOR if scales else 1
        factor *= settling_factor(self.scene)
        return {
            "memory": BASE_MEMORY + MEMORY_PER_UNKNOWN * unknowns,
            "solve": factor * TIME_PER_UNKNOWN * unknowns + 1,
            "compile": COMPILE_TIME + COMPILE_TIME_PER_SCALE * scales,
        }


def settling_factor(scene: Any) -> int:
    """How much more a section takes where its grains settle [-]."""
    solids, rouse = scene.model.solids, plausible.level_rouse(scene)
    if plausible.expects_bed(scene):
        return BED_FACTOR * (LIFTED_FACTOR if plausible.lifts(scene, solids) else 1)
    if likely_holdup(scene) > SPARSE:
        return 1
    if rouse > plausible.SETTLED:
        return BOUNCING_FACTOR
    return BED_FACTOR if rouse > plausible.SUSPENDED else 1


def estimated(
    solution: nested.Solution, length: float
) -> tuple[dict[str, float], dict[str, float | None]]:
    """Quantities on the finest mesh, and the change of each since the mesh before.

    Where the terms of the mesh had to be raised, the change by as much again of them is added.

    Raises
    ------
    SolverError
        it changes the gradient so much that they decide it.
    """
    found, errors = nested.with_changes(
        [quantities(level.section, length) for level in solution.levels[-2:]]
    )
    section = solution.section
    if section.rougher is None:
        return found, errors
    state, share = section.stored(), 1 / (section.rougher.ratio - 1)
    section.restore(section.rougher.state)
    rougher = quantities(section, length)
    section.restore(state)
    changes = {name: share * abs(rougher[name] - found[name]) for name in found}
    change, gradient = changes["pressure_gradient"], abs(found["pressure_gradient"])
    if change > LARGEST_CHANGE * gradient:
        raise SolverError(
            f"a steady state was found only with {terms_of_mesh(section)}, which decide it:"
            f" as much again of them changes {gradient:.3g} Pa/m by {change:.3g}"
        )
    return found, {name: (errors[name] or 0.0) + changes[name] for name in found}


def checked_balances(section: TwoFluidSection) -> dict[str, float]:
    """The balances of an answer.

    Raises
    ------
    SolverError
        one of them is broken, so that the state is no answer.
    """
    kept = balances(section)
    worst = max(kept, key=lambda name: kept[name])
    if not kept[worst] <= BALANCE_ERROR:
        raise SolverError(f"the balance of {worst} is broken by {kept[worst]:.1e}")
    return kept


def skipped_laws(model: TwoFluid) -> list[str]:
    """Laws that the model does without."""
    laws, left_out = model, []
    if model.solids is None:
        left_out.append("solids, granular temperature, drag: no table [solids]")
    else:
        if laws.theta == "algebraic":
            left_out.append("transport of granular temperature: closures.theta = algebraic")
            if laws.solids_wall.heats:
                left_out.append(
                    f"heat of the wall, walls.solids = {laws.solids_wall.name}: closures.theta ="
                    " algebraic"
                )
        if laws.friction.name == "none":
            left_out.append("frictional stress: closures.friction = none")
        if laws.pressure_force == "alpha":
            left_out.append(
                "force of the solids pressure by grad(Theta): closures.pressure_force = alpha"
            )
        if laws.dispersed.name == "none":
            left_out.append("turbulence of the solids: closures.dispersed = none")
        if laws.dispersion.name == "none":
            left_out.append("turbulent dispersion of the solids: closures.dispersion = none")
    if laws.turbulence.name == "laminar":
        left_out.append("gas turbulence: closures.turbulence = laminar")
    elif not laws.turbulence.transported:
        left_out.append(f"transport of k and eps: closures.turbulence = {laws.turbulence.name}")
    return left_out


def terms_of_mesh(section: TwoFluidSection) -> str:
    """The raised terms of the mesh in words."""
    terms, said = section.mesh_terms, []
    if terms.strength > 1:
        said.append(f"{terms.strength:g} times numerics.capture and numerics.damping")
    if terms.rate > 1:
        rate = terms.rate * SMALLEST_RATE
        said.append(f"a least rate of {rate:.2g} U_g/D in the mesh's diffusion and damping")
    return " and ".join(said)


def raised_terms(section: TwoFluidSection, alone: bool) -> str:
    """What an answer with raised terms of the mesh must say.

    alone : on one mesh, whose own error is not known
    """
    told = (
        f"standard terms of the mesh: a steady state was found with {terms_of_mesh(section)} and"
        " not with less; error_estimate holds the effect"
    )
    return f"{told} and not the error of the one mesh" if alone else told


# eddies of a pipe live this share of D/U, and the sink of Simonin's law for tracers over Z eps
EDDY_SHARE, SIMONIN_SINK = 0.11, 15.0
# a plastic law with a friction limit below this was hardly meant; a gas with Re above is turbulent
PACKED, TURBULENT = 0.5, 4000.0
# a cell at the wall higher than what the gas asks for by more than this is told
COARSE = 2.0


def entering(scene: Any) -> str:
    """What enters a line, in words."""
    gas = f"gas {scene.feed.gas_velocity:g} m/s superficial"
    if scene.model.solids is None:
        return gas
    alpha, speed = scene.solids_inlet
    by = ""
    if scene.feed.solids_velocity is None:
        spent = scene.model.solids.density * alpha * speed**2
        by = (
            " (the feeder's correlation of Ding et al.; the drop lacks what speeds them up to that,"
            f" about {spent:.3g} Pa)"
        )
    return f"{gas}, solids enter with fraction {alpha:.4g} at {speed:.4g} m/s{by}"


def advice(scene: Any) -> list[str]:
    """What a user probably did not mean, one sentence each."""
    said, laws, solids = [], scene.model, scene.model.solids
    if solids and laws.friction.name in ("schaeffer", "syamlal") and solids.friction_limit < PACKED:
        said.append(
            f"friction {laws.friction.name!r} makes the bed incompressible above"
            f" solids.friction_limit = {solids.friction_limit:g}; set it to the packed fraction,"
            " such as 0.58"
        )
    reynolds = scene.reynolds
    if laws.turbulence.name == "laminar" and reynolds > TURBULENT:
        said.append(f"the gas is taken as laminar at a Reynolds number of {reynolds:.3g}")
    wanted = laws.wall_cell(scene.feed.gas_velocity, scene.geometry.hydraulic_diameter)
    resolution = scene.physics.resolution
    height = resolution.wall_ratio * resolution.core_size(scene.physics.section)
    if wanted and laws.gas_wall.strong and height > COARSE * wanted:
        said.append(
            "a turbulent gas with walls.gas = 'no-slip' needs cells of a few viscous lengths at the"
            f" wall, {1e3 * wanted:.2g} mm, and these have {1e3 * height:.2g} mm: leave"
            " numerics.wall_grading out, or take 'log-law', which does without"
        )
    said += _of_the_wall_distance(scene, wanted is not None)
    if solids and laws.theta == "algebraic" and laws.solids_wall.name == "rough":
        said.append(
            "walls.solids = 'rough' throws grains off by the heat of the wall, which closures.theta"
            " = 'algebraic' leaves out: its friction alone counts"
        )
    if solids and laws.dispersed.name == "simonin":
        said += laminarised(scene)
    if solids:
        said += plausible.crowded(laws.solids_wall, scene.feed.solids_fraction)
    return said


def _of_the_wall_distance(scene: Any, resolved: bool) -> list[str]:
    """Whether a wall law holds at the distance that is given.

    resolved : whether the law wants cells in the sublayer
    """
    offset, width, said = scene.wall_offset, scene.geometry.hydraulic_diameter, []
    if offset > LARGEST_OFFSET * width:
        said.append(
            f"walls.distance = {offset:.3g} m is above a tenth of the hydraulic diameter"
            f" {width:g} m, and a wall law is made for the layer at the wall"
        )
    if scene.reynolds > TURBULENT and 0 < offset < LEAST_OFFSET * width and not resolved:
        if (height := y_plus(scene)) < LEAST_Y_PLUS:
            said.append(
                f"walls.distance = {offset:.3g} m is y+ = {height:.2g}, inside the sublayer, which"
                f" needs cells as thin; a wall law holds from y+ = {LEAST_Y_PLUS:g}"
            )
    return said


def laminarised(scene: Any) -> list[str]:
    """Whether the sink of Simonin's law would kill the turbulence of a gas with small grains.

    For grains that follow the eddies, tau_F << tau_t, its sink is 15 Z eps; tracers take none.
    tau_t = 0.11 D/U is that of the mean dissipation of a pipe.
    """
    gas, solids, law = scene.model.gas, scene.model.solids, scene.model.dispersed
    width = scene.geometry.hydraulic_diameter
    time = (solids.density + law.C_A * gas.density) * solids.diameter**2 / (18 * gas.viscosity)
    eta = EDDY_SHARE * width / (scene.feed.gas_velocity * time)
    sink = law.damping * SIMONIN_SINK * loading(scene) * eta / (1 + eta)
    if eta < 1 or sink < 1:
        return []
    return [
        f"closures.dispersed = 'simonin' takes {sink:.2g} times the dissipation from a gas whose"
        f" grains follow its eddies (tau_t/tau_F = {eta:.2g}), where tracers take nothing: it makes"
        " the gas laminar; 'tchen' has the limit of small grains"
    ]


def write_section(scene: Any, section: TwoFluidSection, result: Result, out: Path | None) -> None:
    """Profiles along the vertical diameter, for the result and the files, and the picture."""
    mesh = section.mesh.mesh
    moment = snapshot(mesh, section.fields())

    def draw() -> None:
        view = SectionView.of_cells(
            moment.points, moment.cells, moment.kind, section.mesh.section.symmetry
        )
        values = dict(moment.nodal)
        if "theta" in values:
            values["Theta"] = values.pop("theta")
        result.sections["vertical"] = profile = vertical_profile(view, values)
        if out is None:
            return
        write_profiles(out / "profiles.csv", profile, PROFILE_UNITS)
        if scene.output.pictures:
            section_picture(out / "section.png", view, values, scene.title)

    on_root(mesh.comm, draw)
