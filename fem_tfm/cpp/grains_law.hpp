// SPDX-License-Identifier: LGPL-3.0-or-later
// Force of W contacts at once, between grains or between grains and a wall.
//
// Included by grains_step.cpp alone, inside its namespace of one instruction set. The formulas are
// those of fem_tfm/closures/contacts.py, with which a test compares them.
#pragma once

// What a contact does to its first grain: force, its part along the normal, and n x F_t with the
// sign that both grains turn with (torque = radius times this).
struct Push {
    column fx, fy, fz, normal, tx, ty, tz;
};

// A contact: overlap, unit normal towards the first grain, velocity of the first against the second
// at the centres, sum of radius times spin, 1/m of the reduced mass, reduced radius.
struct Touch {
    column overlap, nx, ny, nz, dx, dy, dz, sx, sy, sz, inverse_mass, radius;
};

// Coefficients of W contacts.
struct Stiff {
    column force, gn, kt, gt, cr;
};

template <int KIND>
INLINE Stiff stiffness(const Law& law, const Touch& c) {
    const column zero{}, mass = 1.0 / c.inverse_mass;
    if constexpr (KIND == HERTZ) {
        const column a = root(larger(c.overlap * c.radius, zero));
        const column kt = law.kt * a, damping = root(mass * (1.5 * law.kn) * a);
        return {law.kn * a * c.overlap, law.cn * damping, kt, law.ct * root(mass * kt),
                law.cr * damping};
    } else {
        const column damping = root(mass * law.kn);
        const column gt = KIND == VISCOUS ? law.ct * damping : law.ct * root(mass * law.kt);
        return {law.kn * c.overlap, law.cn * damping, all(law.kt), gt, law.cr * damping};
    }
}

// `stiff` may hold constants that are the same for all contacts of linear laws.
template <int KIND>
INLINE Push push(const Law& law, const Touch& c, Stiff stiff, column* shear, double dt) {
    const column zero{}, tiny = all(1e-300);
    const column vn = c.dx * c.nx + c.dy * c.ny + c.dz * c.nz;
    if constexpr (KIND != HERTZ) stiff.force = law.kn * c.overlap;
    const column fn = larger(stiff.force - stiff.gn * vn, zero);
    // velocity of the two surfaces against each other
    const column vx = c.dx - vn * c.nx - (c.sy * c.nz - c.sz * c.ny);
    const column vy = c.dy - vn * c.ny - (c.sz * c.nx - c.sx * c.nz);
    const column vz = c.dz - vn * c.nz - (c.sx * c.ny - c.sy * c.nx);
    const column limit = law.mu * fn;
    column tx, ty, tz;
    if constexpr (KIND == VISCOUS) {
        const column speed = root(vx * vx + vy * vy + vz * vz + tiny);
        const column g = smaller(stiff.gt, limit / speed);
        tx = -g * vx, ty = -g * vy, tz = -g * vz;
    } else {
        column x = shear[0] + dt * vx, y = shear[1] + dt * vy, z = shear[2] + dt * vz;
        const column along = x * c.nx + y * c.ny + z * c.nz;
        x -= along * c.nx, y -= along * c.ny, z -= along * c.nz;
        tx = -stiff.kt * x - stiff.gt * vx, ty = -stiff.kt * y - stiff.gt * vy;
        tz = -stiff.kt * z - stiff.gt * vz;
        const column size = root(tx * tx + ty * ty + tz * tz + tiny);
        const unsigned slides = below(limit, size);
        const column share = where(slides, limit / size, all(1.0));
        tx *= share, ty *= share, tz *= share;
        const column by = -1.0 / larger(stiff.kt, tiny);
        shear[0] = where(slides, by * (tx + stiff.gt * vx), x);
        shear[1] = where(slides, by * (ty + stiff.gt * vy), y);
        shear[2] = where(slides, by * (tz + stiff.gt * vz), z);
    }
    return {fn * c.nx + tx,          fn * c.ny + ty,          fn * c.nz + tz,         fn,
            c.nz * ty - c.ny * tz,   c.nx * tz - c.nz * tx,   c.ny * tx - c.nx * ty};
}

// Torque of rolling friction on the first grain, against its spin relative to the second.
INLINE void roll(const Law& law, column fn, column radius, column cr, const column* spin, column* out) {
    const column tiny = all(1e-300);
    const column size = root(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2] + tiny);
    const column g = smaller(cr * radius * radius, law.mr * fn * radius / size);
    for (int k = 0; k < 3; ++k) out[k] = -g * spin[k];
}
