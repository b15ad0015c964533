# SPDX-License-Identifier: LGPL-3.0-or-later
"""Speed of grains in a packed tube, and of LAMMPS on the same state where it is installed.

A standing tube is filled with layers, which settle under gravity. Then both programs take the same
steps from there with the same law, walls and skin of the neighbour list, in turn; CPU seconds
count, and of several stretches the fastest, since other processes only make them slower. With
springs, each program loads its own from zero.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fem_tfm.bench.error import tell
from fem_tfm.closures.contacts import Contact, CundallStrack, ViscousCoulomb
from fem_tfm.geometry.section import RoundSection
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.grains import Grain, Grains, Walls

TUBE, DIAMETER, DENSITY, STEP, SKIN = RoundSection(7e-3, "none"), 1.4e-3, 937.0, 1e-5, 0.2
# weak, so that grains at the bottom overlap by some per cent at most
GRAVITY = (0.0, 0.0, -2.5)
# numbers of grains, and the steps of one stretch
SIZES = ((3200, 2000), (50000, 120))
STRETCHES, PIECE, SETTLING, WARMING = 3, 3200, 18000, 300
LAWS: tuple[Contact, ...] = (ViscousCoulomb(), CundallStrack())

DECK = """\
units si
atom_style sphere
boundary f f f
newton off
comm_modify vel yes
read_data state.data
pair_style {pair} {normal}
pair_coeff * *
neighbor {skin} bin
neigh_modify delay 0 every 1 check yes
fix move all nve/sphere
fix pull all gravity 2.5 vector 0 0 -1
fix tube all wall/gran {wall} zcylinder {radius}
fix ends all wall/gran {wall} zplane 0.0 {length}
timestep {step}
thermo 1000000
run {warm}
"""


@dataclass(frozen=True)
class Speed:
    """Million grain steps in a CPU second, and what they did.

    lammps : the same of LAMMPS, None where it is not installed
    contacts, listed : a grain, both counted from either side
    """

    law: str
    count: int
    speed: float
    lammps: float | None
    contacts: float
    listed: float


def packed(law: Contact, count: int, threads: int = 1) -> tuple[Grains, float]:
    """Grains that have settled in a standing tube closed at both ends, and its height [m].

    A long tube is made of copies of one piece.
    """
    grain = Grain(DENSITY, DIAMETER, contact=law)
    layer = len(filled(TUBE, grain, 1.5 * DIAMETER)[0])
    made = Grains(grain, Walls(TUBE, 0.0), STEP, GRAVITY, skin=SKIN)
    made.add(filled(TUBE, grain, (min(count, PIECE) // layer + 0.5) * DIAMETER)[0])
    made.run(SETTLING)
    place, velocity = made.place, made.velocity
    piece, copies = place[:, 2].max() + DIAMETER / 2, max(round(count / made.count), 1)
    height = piece * copies
    many = Grains(grain, Walls(TUBE, 0.0, height), STEP, GRAVITY, skin=SKIN, threads=threads)
    shifts = piece * np.arange(copies)[:, None, None] * np.array([0.0, 0.0, 1.0])
    many.add((place + shifts).reshape(-1, 3))
    many.set_velocity(np.tile(velocity, (copies, 1)))
    many.run(WARMING)
    return many, height


def stretch(made: Grains, steps: int) -> float:
    """CPU seconds of some steps."""
    began = time.process_time()
    made.run(steps)
    return time.process_time() - began


def deck(made: Grains, length: float, steps: int, folder: Path) -> None:
    """Write the state and the input of LAMMPS: warm up, then stretches of steps."""
    law, mass = made.grain.contact, made.grain.mass
    lines = []
    for share in (0.5, 1.0):
        c = law.coefficients(share * mass, STEP)
        rate = (c.stiffness / (share * mass)) ** 0.5
        shear = c.shear_stiffness or c.stiffness
        slide = (shear / (share * mass)) ** 0.5 * c.shear_damping
        stiff = f"{c.stiffness:.17g} {c.shear_stiffness or 'NULL'}"
        lines.append(f"{stiff} {c.damping * rate:.17g} {slide:.17g} {c.friction} 1")
    pair = "gran/hooke/history" if law.kind == 1 else "gran/hooke"
    words = {
        "pair": pair,
        "normal": lines[0],
        "wall": f"{pair.removeprefix('gran/')} {lines[1]}",
        "skin": SKIN * DIAMETER,
        "radius": TUBE.diameter / 2,
        "length": length,
        "step": STEP,
        "warm": max(steps // 10, 20),
    }
    runs = f"run {steps}\n" * STRETCHES
    (folder / "in.grains").write_text(DECK.format(**words) + runs, encoding="utf-8")
    x, v, w = made.place, made.velocity, made.spin
    head = f"grains\n\n{made.count} atoms\n1 atom types\n\n-0.004 0.004 xlo xhi\n"
    head += f"-0.004 0.004 ylo yhi\n-0.001 {length + 0.001:.6f} zlo zhi\n"
    rows = [
        f"{n + 1} 1 {DIAMETER} {DENSITY} " + " ".join(f"{a:.17g}" for a in x[n])
        for n in range(made.count)
    ]
    speeds = [
        f"{n + 1} " + " ".join(f"{a:.17g}" for a in (*v[n], *w[n])) for n in range(made.count)
    ]
    body = "\nAtoms # sphere\n\n" + "\n".join(rows) + "\n\nVelocities\n\n" + "\n".join(speeds)
    (folder / "state.data").write_text(head + body + "\n", encoding="utf-8")


def lammps(made: Grains, length: float, steps: int) -> float | None:
    """CPU seconds of LAMMPS for some steps, of its fastest stretch; None where it is missing."""
    program = shutil.which("lmp")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as name:
        deck(made, length, steps, Path(name))
        command = [program, "-in", "in.grains", "-log", "none"]
        told = subprocess.run(command, cwd=name, capture_output=True, text=True, check=False)
    if told.returncode:
        tell(f"LAMMPS does not take the benchmark:\n{told.stdout[-500:]}{told.stderr[-500:]}")
        return None
    loops = re.findall(rf"Loop time of (\S+) on .* for {steps} steps", told.stdout)
    shares = re.findall(r"([\d.]+)% CPU use", told.stdout)
    pairs = zip(loops[-STRETCHES:], shares[-STRETCHES:], strict=True)
    return min(float(loop) * float(share) / 100 for loop, share in pairs)


def measure(law: Contact, count: int, steps: int, beside: bool = True) -> Speed:
    """Run one state."""
    made, length = packed(law, count)
    other = lammps(made, length, steps) if beside else None
    stretch(made, max(steps // 10, 20))
    contacts, done = made.core.contacts, made.core.steps
    spent = min(stretch(made, steps) for _ in range(STRETCHES))
    contacts = (made.core.contacts - contacts) / (made.core.steps - done)
    made.run(1)
    work = 1e-6 * made.count * steps
    listed = 2 * made.core.listed / made.count
    found = None if other is None else work / other
    return Speed(law.name, made.count, work / spent, found, 2 * contacts / made.count, listed)


def gain(count: int, steps: int, threads: int = 2) -> float:
    """Time of one thread over that of several; it needs as many idle cores."""
    times = []
    for number in (1, threads):
        made, _ = packed(LAWS[0], count, number)
        best = np.inf
        for _ in range(STRETCHES):
            began = time.perf_counter()
            made.run(steps)
            best = min(best, time.perf_counter() - began)
        times.append(best)
    return float(times[0] / times[1])


def run() -> str:
    """Both laws at both sizes, then two threads."""
    lines = ["law  grains  million grain steps a CPU second  LAMMPS  ratio  contacts  listed"]
    tell(lines[0])
    for law in LAWS:
        for count, steps in SIZES:
            s = measure(law, count, steps)
            beside = "-  -" if s.lammps is None else f"{s.lammps:.1f}  {s.speed / s.lammps:.2f}"
            lines.append(
                f"{s.law}  {s.count}  {s.speed:.1f}  {beside}  {s.contacts:.2f}  {s.listed:.2f}"
            )
            tell(lines[-1])
    for count, steps in SIZES:
        lines.append(f"two threads, {count} grains: {gain(count, steps):.2f} times as fast")
        tell(lines[-1])
    return "\n".join(lines)
