// SPDX-License-Identifier: LGPL-3.0-or-later
//
// The step of eight particles and the queue that keeps the lanes full.
//
//     x_m    = x + dt/2 [u_e + (v - u_e) (1 - e^-h)/h],  h = B dt/2,  u_e seen at the end of the last step
//     xi'    = e xi + sqrt(1 - e^2) n + f T (1 - e) d_i L_ij,   e = e^(-dt/T)          T, L, U at x_m
//     u      = U + f L (xi + xi')/2,   f = 1/sqrt(1 + (dt/T)^2/12),   u_e = U + L xi'
//     dv/dt  = a + B (u - v),   B at the slip half-way
//
// The last is integrated exactly for constant u, a and B. Sections are folded about their planes of
// symmetry: the gas is looked up at (|x|, |y|) with S = diag(sign x, sign y, 1), S u' = L S xi. What lies
// beyond a wall at half-way is looked up in the mirrored flow.
#pragma once

#include "impact.h"
#include "meet.h"
#include "space.h"

namespace KERNEL_NAMESPACE {

using kernel::Cloud;
using kernel::Output;

struct Lanes {
    alignas(64) double x[3][8], v[3][8], time[8], radius[8], weight[8], body[3][8];
    alignas(32) float xi[3][8], u[3][8], rate[8], dt[8], stokes[8], reynolds[8], limit[8];
    alignas(32) int32_t cell[8], table[8], index[8], count[8], moves[8];
    alignas(32) uint32_t step[8], low[8], high[8];
    uint32_t bounces[8];
    alignas(64) double omega[3][8], temperature[8], mass[8];
    alignas(32) float ratio[8], light[8], conduct[8], capacity[8], meetings[8];
    unsigned active;
};

INLINE void settle_lane(const Job& job, Lanes& s, int k, int32_t i) {
    const Cloud& c = job.cloud;
    const Options& o = job.options;
    for (int j = 0; j < 3; ++j) {
        s.x[j][k] = c.x[3 * (int64_t)i + j];
        s.v[j][k] = c.v[3 * (int64_t)i + j];
        s.omega[j][k] = c.omega[3 * (int64_t)i + j];
        s.xi[j][k] = c.xi[3 * (int64_t)i + j];
        s.u[j][k] = c.memory[5 * (int64_t)i + j];
    }
    s.rate[k] = c.memory[5 * (int64_t)i + 3];
    s.dt[k] = c.memory[5 * (int64_t)i + 4];
    s.time[k] = c.time[i];
    s.temperature[k] = c.temperature[i];
    const double d = c.diameter[i], rho = c.density[i];
    s.radius[k] = d / 2;
    s.mass[k] = rho * 3.141592653589793 / 6 * d * d * d;
    s.weight[k] = c.rate[i] * s.mass[k];
    const double kappa = job.gas.density / rho, inertia = 1 + o.added_mass * kappa;
    const double stokes = d > 0 ? 18 * job.gas.viscosity / (rho * d * d) / inertia : 1e9;
    s.stokes[k] = (float)(stokes < 1e9 ? stokes : 1e9);
    s.reynolds[k] = (float)(d * job.gas.density / job.gas.viscosity);
    s.limit[k] = d > 0 ? (float)o.relaxation : 1e30f;
    s.ratio[k] = (float)kappa;
    s.light[k] = (float)(1 / inertia);
    for (int j = 0; j < 3; ++j)
        s.body[j][k] = d > 0 ? o.gravity[j] * (o.buoyancy ? 1 - kappa : 1.0) : 0.0;
    if (o.heat) {
        const double capacity = o.heat_capacity[c.material[i]];
        const double conduct = d > 0 ? 6 * job.gas.conductivity / (rho * capacity * d * d) : 1e9;
        s.conduct[k] = (float)(conduct < 1e9 ? conduct : 1e9);
        s.capacity[k] = (float)capacity;
    }
    s.cell[k] = c.cell[i];
    s.table[k] = c.material[i] * kernel::DRAG_ROWS;
    s.step[k] = c.step[i];
    s.bounces[k] = c.bounces[i];
    s.low[k] = (uint32_t)(uint64_t)c.id[i];
    s.high[k] = (uint32_t)((uint64_t)c.id[i] >> 32);
    s.index[k] = i;
    s.moves[k] = c.search[2 * (int64_t)i];
    s.count[k] = c.search[2 * (int64_t)i + 1];
    s.meetings[k] = 0;
}

INLINE void write_lane(const Job& job, const Lanes& s, int k, int8_t status) {
    const Cloud& c = job.cloud;
    const int64_t i = s.index[k];
    for (int j = 0; j < 3; ++j) {
        c.x[3 * i + j] = s.x[j][k];
        c.v[3 * i + j] = s.v[j][k];
        c.omega[3 * i + j] = s.omega[j][k];
        c.xi[3 * i + j] = s.xi[j][k];
        c.memory[5 * i + j] = s.u[j][k];
    }
    c.memory[5 * i + 3] = s.rate[k];
    c.memory[5 * i + 4] = s.dt[k];
    c.time[i] = s.time[k];
    c.temperature[i] = s.temperature[k];
    c.cell[i] = s.cell[k];
    c.step[i] = s.step[k];
    c.bounces[i] = s.bounces[k];
    c.search[2 * i] = 0;
    c.search[2 * i + 1] = s.count[k];
    c.status[i] = status;
}

// drag factor C_D Re/24
INLINE f8 drag_factor(const float* tables, i8 table, f8 re) {
    constexpr int first = kernel::DRAG_FIRST, octaves = kernel::DRAG_OCTAVES;
    const f8 least = as_float(splat_int((127 + first) << 23));
    const f8 most = as_float(splat_int(((127 + first + octaves) << 23) - 1));
    re = smaller(larger(re, least), most);
    const i8 b = as_int(re);
    const i8 row = table + (b >> 19) - ((127 + first) << 4);
    const f8 t = as_float((b & 0x7ffff) | 0x3f800000) - 1.0f;
    alignas(32) int32_t at[8];
    store(at, row);
    const float* p[8];
    for (int k = 0; k < LANES; ++k) p[k] = tables + 4 * (int64_t)at[k];
    f8 c[4];
    load_quarters(p, c);
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]));
}

template <class Kind, bool FULL>
struct Stepper {
    const Job& job;
    Output& out;
    Lanes s;
    Rows rows;
    float z0 = 0, per_z = 0;
    double first = 0;
    int64_t next, stop;
    // bits of lanes that go on with a search, and of those whose particle has left
    unsigned resumed = 0, vacant = 0;

    Stepper(const Job& j, int64_t begin, int64_t end, Output& o) : job(j), out(o), next(begin), stop(end) {
        rows = {j.gas.rows[0], j.gas.rows[1], j.gas.rows[1] != nullptr,
                FULL || j.options.dispersion != kernel::Dispersion::none};
        first = j.gas.z[0];
        per_z = rows.both ? (float)(1.0 / (j.gas.z[1] - j.gas.z[0])) : 0.0f;
    }

    // the next particle of the queue that has a way to go
    bool refill(int k) {
        const Cloud& c = job.cloud;
        const Options& o = job.options;
        while (next < stop) {
            const int64_t i = next++;
            if (c.status[i] != kernel::INSIDE) continue;
            if (o.until_time ? c.time[i] >= o.end : c.x[3 * i + 2] >= o.end) continue;
            settle_lane(job, s, k, (int32_t)i);
            if (o.dispersion == kernel::Dispersion::none) {
                for (int j = 0; j < 3; ++j) s.xi[j][k] = 0.0f;
            } else if (s.dt[k] == 0.0f && s.step[k] == 0) {
                start_eddy(k);
            }
            // a stray that was found afresh begins its walk anew
            if (s.moves[k] % MOST_MOVES) resumed |= 1u << k;
            return true;
        }
        return false;
    }

    __attribute__((noinline)) void start_eddy(int k) {
        f8 n[3], u;
        normals(philox(load(s.low), load(s.high), load(s.step), 1, job.options.seed), n, u);
        for (int j = 0; j < 3; ++j) s.xi[j][k] = n[j][k];
    }

    void run() {
        s.active = 0;
        for (int k = 0; k < LANES; ++k) {
            if (refill(k)) s.active |= 1u << k;
        }
        if (s.active == 0) return;
        const int model = __builtin_ctz(s.active);
        for (int k = 0; k < LANES; ++k) {
            if (!(s.active >> k & 1)) copy_lane(k, model);
        }
        while (s.active) step();
    }

    // an idle lane goes along with a valid place
    void copy_lane(int k, int from) {
        settle_lane(job, s, k, s.index[from]);
        s.cell[k] = s.cell[from];
        s.moves[k] = 0;
        for (int j = 0; j < 3; ++j) s.x[j][k] = s.x[j][from];
    }

    // give back lanes that leave in the middle of their search, as they were before the step
    __attribute__((noinline)) void leave(const Place& place, unsigned left) {
        vacant = left;
        s.active &= ~left;
        for (; left; left &= left - 1) {
            const int k = __builtin_ctz(left);
            write_lane(job, s, k, kernel::AWAY);
            const int64_t i = s.index[k];
            job.cloud.cell[i] = place.ghost[k];
            job.cloud.search[2 * i] = place.moves[k];
            if (place.ghost[k] == -1) ++out.counts.strays;
        }
    }

    INLINE void step() {
        const Options& o = job.options;
        i8 last;
        const f8 dt = step_length(last);
        const d8 dt_d = to_double(dt);
        d8 x[3], v[3];
        f8 vf[3], ue[3];
        for (int i = 0; i < 3; ++i) {
            x[i] = load(s.x[i]);
            v[i] = load(s.v[i]);
            vf[i] = to_float(v[i]);
            ue[i] = load(s.u[i]);
        }
        // half-way
        f8 unused;
        const f8 half = 0.5f * dt;
        const f8 carried = mean_decay(load(s.rate) * half, unused);
        d8 middle[3];
        for (int i = 0; i < 3; ++i)
            middle[i] = x[i] + to_double(half * (ue[i] + (vf[i] - ue[i]) * carried));
        Place place;
        place.cell = load(s.cell);
        place.resumed = resumed;
        store(place.moves, load(s.moves));
        Mirror mirror;
        d8 folded[3];
        fold(middle, folded, mirror);
        Kind::locate(job.grid, folded, place);
        store(s.moves, splat_int(0));
        resumed = 0;
        if (place.left & s.active) leave(place, place.left & s.active);
        store(s.cell, place.cell);
        Sample g;
        f8 share = splat(0.0f);
        if (rows.both) {
            const d8 along = o.until_time ? load(s.time) + to_double(half) : middle[2];
            share = to_float(along - splat_double(first)) * per_z;
            share = smaller(larger(share, splat(0.0f)), splat(1.0f));
        }
        Kind::template sample<FULL>(job.grid, rows, place, share, g);
        if (Kind::DIM == 2) slopes(g, mirror);
        if (job.with_pairs && o.pair_share > 0) {
            meet(g, mirror, place.cell, dt);
            for (int i = 0; i < 3; ++i) v[i] = load(s.v[i]), vf[i] = to_float(v[i]);
        }
        f8 u[3];
        seen(g, mirror, dt, vf, u, ue);
        // drag
        // of body, the weight is no force of the gas
        f8 slip[3], weight[3], body[3], spin[3];
        for (int i = 0; i < 3; ++i) {
            slip[i] = u[i] - vf[i];
            weight[i] = to_float(load(s.body[i]));
            body[i] = weight[i];
        }
        if (FULL) further_forces(g, mirror, slip, body, spin);
        const f8 stokes = load(s.stokes), reynolds = load(s.reynolds);
        const i8 table = load(s.table);
        const f8 re0 = reynolds * root(slip[0] * slip[0] + slip[1] * slip[1] + slip[2] * slip[2]);
        const f8 b0 = stokes * drag_factor(o.drag, table, re0);
        f8 decay;
        const f8 h0 = b0 * half, way0 = mean_decay(h0, decay) * half;
        f8 size = splat(0.0f), middle_slip[3];
        for (int i = 0; i < 3; ++i) {
            middle_slip[i] = slip[i] - way0 * (b0 * slip[i] + body[i]);
            size += middle_slip[i] * middle_slip[i];
        }
        const f8 re = reynolds * root(size);
        const f8 b = stokes * drag_factor(o.drag, table, re);
        const f8 h = b * dt, mean = mean_decay(h, decay), way = mean * dt;
        // int (v - v0) dt = push (1 - mean)/b
        const f8 lag = dt * select(h < 1e-3f, dt * (0.5f - h * (1.0f / 6)), (1.0f - mean) / larger(b, splat(1e-20f)));
        d8 target[3], speed[3], gain[3];
        for (int i = 0; i < 3; ++i) {
            const f8 push = b * slip[i] + body[i];
            const d8 change = to_double(way * push);
            target[i] = x[i] + dt_d * v[i] + to_double(lag * push);
            speed[i] = v[i] + change;
            gain[i] = change - dt_d * to_double(weight[i]);
        }
        store(s.rate, b);
        for (int i = 0; i < 3; ++i) {
            store(s.v[i], speed[i]);
            store(s.u[i], ue[i]);
        }
        store(s.time, load(s.time) + dt_d);
        store(s.step, load(s.step) + 1u);
        if (FULL) heat_and_spin(g, place.cell, re, dt, spin);
        if (job.with_pairs) book_numbers(place.cell, mirror, dt, speed);
        if (job.with_sinks) book(place.cell, mirror, dt, way, gain, v, lag, b, slip, body);
        next_step(g, place, target, middle, speed, mirror, b);
        const i8 hit = outside(target);
        for (int i = 0; i < 3; ++i) store(s.x[i], target[i]);
        finish(g, mirror, bits(hit) & s.active, bits(last), x, target, dt);
    }

    // how a lane's place was mirrored: signs of the folds, and the wall that it lies beyond
    struct Mirror {
        f8 sign[2];
        i8 beyond[2];
        f8 nx, ny;
        i8 strip[2];
        f8 depth;
        unsigned any_beyond, any_strip;
    };

    // The step at hand. The last step ends where the slab does, or at the time given.
    INLINE f8 step_length(i8& last) {
        const Options& o = job.options;
        f8 dt = load(s.dt);
        if (o.until_time) {
            const f8 left = to_float(splat_double(o.end) - load(s.time));
            last = left <= dt;
            return larger(select(last, left, dt), splat(0.0f));
        }
        const f8 left = to_float(splat_double(o.end) - load(s.x[2]));
        f8 rate;
        last = axial_way(dt, rate) >= left;
        if (bits(last) == 0) return dt;
        // Newton for the time at which the plane is met
        f8 cut = dt;
        for (int pass = 0; pass < 3; ++pass) {
            const f8 miss = axial_way(cut, rate) - left;
            cut = smaller(larger(cut - miss / larger(rate, splat(1e-30f)), splat(0.0f)), dt);
        }
        return select(last, cut, dt);
    }

    // predicted way along z in a time, and its rate at the end
    INLINE f8 axial_way(f8 dt, f8& rate) {
        const f8 v = to_float(load(s.v[2])), u = load(s.u[2]), body = to_float(load(s.body[2]));
        f8 decay;
        const f8 mean = mean_decay(load(s.rate) * dt, decay);
        rate = u + (v - u) * decay + body * dt * mean;
        return dt * (u + (v - u) * mean + 0.5f * body * dt * mean);
    }

    INLINE void fold(const d8 middle[3], d8 folded[3], Mirror& m) {
        const Geometry& g = job.geometry;
        const f8 one = splat(1.0f);
        m.sign[0] = m.sign[1] = one;
        for (int i = 0; i < 3; ++i) folded[i] = middle[i];
        for (int i = 0; i < 2; ++i) {
            if (job.grid.folds > i) {
                m.sign[i] = select(less(middle[i], splat_double(0.0)), -one, one);
                folded[i] = absolute(middle[i]);
            }
        }
        m.any_beyond = m.any_strip = 0;
        m.beyond[0] = m.beyond[1] = m.strip[0] = m.strip[1] = splat_int(0);
        if (g.wall == kernel::Wall::rectangle)
            fold_rectangle(folded, m);
        else if (g.wall == kernel::Wall::circle)
            fold_circle(folded, m);
    }

    INLINE void fold_rectangle(d8 folded[3], Mirror& m) {
        const Geometry& g = job.geometry;
        const d8 radius = load(s.radius);
        m.depth = splat(1.0f);
        for (int i = 0; i < 2; ++i) {
            const d8 half = splat_double(g.half[i]) - radius, size = absolute(folded[i]);
            m.beyond[i] = less(half, size);
            m.any_beyond |= bits(m.beyond[i]);
            const d8 twice = half + half;
            const d8 inner = select(m.beyond[i], twice - size, size);
            if (g.strip > 0) {
                const d8 plane = splat_double(g.half[i] - g.strip);
                m.strip[i] = less(plane, inner);
                const f8 depth = to_float(splat_double(g.half[i]) - inner) * (float)(1.0 / g.strip);
                m.depth = smaller(m.depth, depth);
                m.any_strip |= bits(m.strip[i]);
                const d8 kept = select(m.strip[i], plane, inner);
                folded[i] = select(less(folded[i], splat_double(0.0)), splat_double(0.0) - kept, kept);
            } else {
                folded[i] = select(less(folded[i], splat_double(0.0)), splat_double(0.0) - inner, inner);
            }
        }
    }

    INLINE void fold_circle(d8 folded[3], Mirror& m) {
        const Geometry& g = job.geometry;
        const f8 fx = to_float(folded[0]), fy = to_float(folded[1]);
        const f8 r = root(fx * fx + fy * fy), wall = splat((float)g.half[0]);
        const f8 most = wall - to_float(load(s.radius));
        const float plane = (float)(g.half[0] - g.strip);
        m.beyond[0] = r > most;
        m.any_beyond = bits(m.beyond[0]);
        const f8 inner = select(m.beyond[0], 2.0f * most - r, r);
        m.strip[0] = g.strip > 0 ? inner > plane : splat_int(0);
        m.any_strip = bits(m.strip[0]);
        m.depth = splat(1.0f);
        if ((m.any_beyond | m.any_strip) == 0) return;
        const f8 inverse = 1.0f / larger(r, splat(1e-30f));
        m.nx = fx * inverse;
        m.ny = fy * inverse;
        const i8 moved = m.beyond[0] | m.strip[0];
        if (g.strip > 0) m.depth = (wall - inner) * (float)(1.0 / g.strip);
        const f8 kept = select(m.strip[0], splat(plane), inner);
        folded[0] = select(moved, to_double(m.nx * kept), folded[0]);
        folded[1] = select(moved, to_double(m.ny * kept), folded[1]);
    }

    // What follows from slopes in a plane; nothing changes across the strip at a wall, in which the
    // velocity follows the log law.
    INLINE void slopes(Sample& g, const Mirror& m) {
        if (m.any_strip) {
            const f8 zero = splat(0.0f);
            const i8 any = m.strip[0] | m.strip[1];
            const f8 law = 1.0f + g.strip * logarithm(larger(m.depth, splat(1e-12f)));
            g.u[0] = select(any, zero, g.u[0]);
            g.u[1] = select(any, zero, g.u[1]);
            g.u[2] = select(any, g.u[2] * larger(law, zero), g.u[2]);
            if (job.geometry.wall == kernel::Wall::circle) {
                for (int i = 0; i < 4; ++i) {
                    const f8 across = select(any, m.nx * g.slope_x[i] + m.ny * g.slope_y[i], zero);
                    g.slope_x[i] -= m.nx * across;
                    g.slope_y[i] -= m.ny * across;
                }
            } else {
                for (int i = 0; i < 4; ++i) {
                    g.slope_x[i] = select(m.strip[0], zero, g.slope_x[i]);
                    g.slope_y[i] = select(m.strip[1], zero, g.slope_y[i]);
                }
            }
        }
        g.drift[0] = g.slope_x[1] + g.slope_y[2];
        g.drift[1] = g.slope_y[3];
        g.drift[2] = splat(0.0f);
        g.time_slope[0] = g.slope_x[0];
        g.time_slope[1] = g.slope_y[0];
        g.time_slope[2] = splat(0.0f);
    }

    // mirror xi at the walls that half-way lies beyond, by the rows of their normals; an involution
    INLINE void mirror_xi(const Sample& g, const Mirror& m, f8 xi[3]) {
        const f8 zero = splat(0.0f);
        if (job.geometry.wall == kernel::Wall::circle) {
            const f8 qx = m.nx * g.factor[0] + m.ny * g.factor[1], qy = m.ny * g.factor[2];
            householder(m.beyond[0], qx, qy, xi);
        } else {
            xi[0] = select(m.beyond[0], zero - xi[0], xi[0]);
            householder(m.beyond[1], g.factor[1], g.factor[2], xi);
        }
    }

    INLINE void householder(i8 mask, f8 qx, f8 qy, f8 xi[3]) {
        const f8 size = qx * qx + qy * qy;
        const f8 c = select(mask & (size > 0.0f), 2.0f * (qx * xi[0] + qy * xi[1]) / larger(size, splat(1e-30f)), splat(0.0f));
        xi[0] -= c * qx;
        xi[1] -= c * qy;
    }

    INLINE void mirror_vector(const Mirror& m, f8 u[3]) {
        const f8 zero = splat(0.0f);
        if (job.geometry.wall == kernel::Wall::circle) {
            const f8 c = select(m.beyond[0], 2.0f * (m.nx * u[0] + m.ny * u[1]), zero);
            u[0] -= c * m.nx;
            u[1] -= c * m.ny;
        } else {
            for (int i = 0; i < 2; ++i) u[i] = select(m.beyond[i], zero - u[i], u[i]);
        }
    }

    // gas velocity seen over the step and at its end
    INLINE void seen(const Sample& g, const Mirror& m, f8 dt, const f8 v[3], f8 u[3], f8 ue[3]) {
        const Options& o = job.options;
        for (int i = 0; i < 3; ++i) u[i] = ue[i] = g.u[i];
        if (o.dispersion != kernel::Dispersion::none) {
            f8 xi[3], now[3];
            for (int i = 0; i < 3; ++i) xi[i] = load(s.xi[i]);
            for (int i = 0; i < 2; ++i) xi[i] *= m.sign[i];
            if (m.any_beyond) mirror_xi(g, m, xi);
            turn(g, m, dt, v, xi, now);
            const f8* L = g.factor;
            const f8 h = dt * g.rate, f = 0.5f * inverse_root(1.0f + h * h * (1.0f / 12));
            f8 w[3];
            for (int i = 0; i < 3; ++i) w[i] = f * (xi[i] + now[i]);
            u[0] += L[0] * w[0];
            u[1] += L[1] * w[0] + L[2] * w[1];
            u[2] += L[3] * w[0] + L[4] * w[1] + L[5] * w[2];
            ue[0] += L[0] * now[0];
            ue[1] += L[1] * now[0] + L[2] * now[1];
            ue[2] += L[3] * now[0] + L[4] * now[1] + L[5] * now[2];
            if (m.any_beyond) mirror_xi(g, m, now);
            for (int i = 0; i < 2; ++i) now[i] *= m.sign[i];
            for (int i = 0; i < 3; ++i) store(s.xi[i], now[i]);
        }
        if (m.any_beyond) {
            mirror_vector(m, u);
            mirror_vector(m, ue);
        }
        for (int i = 0; i < 2; ++i) {
            u[i] *= m.sign[i];
            ue[i] *= m.sign[i];
        }
    }

    // xi at the end of the step
    INLINE void turn(const Sample& g, const Mirror& m, f8 dt, const f8 v[3], const f8 xi[3], f8 now[3]) {
        const Options& o = job.options;
        f8 n[3], chance;
        normals(philox(load(s.low), load(s.high), load(s.step), 0, o.seed), n, chance);
        const f8 h = dt * g.rate;
        f8 e;
        f8 drift = mean_decay(h, e) * dt * inverse_root(1.0f + h * h * (1.0f / 12));
        // tau_p/T of the last step; the drift fades with inertia
        if (o.inertia > 0) {
            const f8 rate = load(s.rate);
            drift *= rate / (rate + (float)o.inertia * g.rate + 1e-30f);
        }
        if (o.crossing > 0) {
            crossing(g, m, h, v, xi, n, chance, now);
        } else {
            if (o.dispersion == kernel::Dispersion::langevin) {
                const f8 spread = root(1.0f - e * e);
                for (int i = 0; i < 3; ++i) now[i] = e * xi[i] + spread * n[i];
            } else {
                for (int i = 0; i < 3; ++i) now[i] = select(chance < e, xi[i], n[i]);
            }
        }
        for (int i = 0; i < 3; ++i) now[i] += drift * g.drift[i];
    }

    // Csanady: a particle that crosses eddies at the slip w loses them sooner, along w by
    // sqrt(1 + (beta w/sigma)^2), across by sqrt(1 + (2 beta w/sigma)^2), sigma^2 = 2 k/3
    INLINE void crossing(const Sample& g, const Mirror& m, f8 h, const f8 v[3], const f8 xi[3], const f8 n[3],
                         f8 chance, f8 now[3]) {
        const Options& o = job.options;
        f8 w[3] = {v[0] * m.sign[0], v[1] * m.sign[1], v[2]};
        if (m.any_beyond) mirror_vector(m, w);
        f8 size = splat(1e-30f), energy = splat(1e-30f);
        for (int i = 0; i < 3; ++i) {
            w[i] -= g.u[i];
            size += w[i] * w[i];
        }
        for (int i = 0; i < 6; ++i) energy += g.factor[i] * g.factor[i];
        const f8 beta = splat((float)o.crossing);
        const f8 ratio = beta * beta * size * 3.0f / energy;
        const f8 along = h * root(1.0f + ratio), across = h * root(1.0f + 4.0f * ratio);
        const f8 inverse = inverse_root(size);
        f8 part = splat(0.0f), noise = splat(0.0f);
        for (int i = 0; i < 3; ++i) {
            w[i] *= inverse;
            part += w[i] * xi[i];
            noise += w[i] * n[i];
        }
        const f8 ea = exponential(-along), ec = exponential(-across);
        if (o.dispersion == kernel::Dispersion::langevin) {
            const f8 sa = root(1.0f - ea * ea), sc = root(1.0f - ec * ec);
            const f8 extra = (ea - ec) * part + (sa - sc) * noise;
            for (int i = 0; i < 3; ++i) now[i] = ec * xi[i] + sc * n[i] + extra * w[i];
        } else {
            // one draw for both: what lies along lives on where what lies across does not
            const f8 a = select(chance < ea, part, noise);
            const i8 lives = chance < ec;
            for (int i = 0; i < 3; ++i)
                now[i] = select(lives, xi[i] - part * w[i], n[i] - noise * w[i]) + a * w[i];
        }
    }

    // accelerations beside drag, added to the weight, and the rotation of the gas
    INLINE void further_forces(const Sample& g, const Mirror& m, const f8 slip[3], f8 body[3], f8 spin[3]) {
        const Options& o = job.options;
        f8 pressure[3];
        for (int i = 0; i < 3; ++i) pressure[i] = g.pressure[i], spin[i] = g.spin[i];
        f8 hand = m.sign[0] * m.sign[1];
        if (m.any_beyond) {
            mirror_vector(m, pressure);
            mirror_vector(m, spin);
            for (int i = 0; i < 2; ++i) hand = select(m.beyond[i], -hand, hand);
        }
        for (int i = 0; i < 2; ++i) pressure[i] *= m.sign[i], spin[i] *= m.sign[i];
        // a rotation is mirrored the other way round
        for (int i = 0; i < 3; ++i) spin[i] *= hand;
        const f8 ratio = load(s.ratio), light = load(s.light);
        const f8 moved = splat((o.pressure ? 1.0f : 0.0f) + (float)o.added_mass);
        for (int i = 0; i < 3; ++i) body[i] -= ratio * moved * pressure[i];
        if (o.saffman || o.magnus) lift(slip, spin, body);
        for (int i = 0; i < 3; ++i) body[i] *= light;
    }

    static INLINE void cross(const f8 a[3], const f8 b[3], f8 c[3]) {
        c[0] = a[1] * b[2] - a[2] * b[1];
        c[1] = a[2] * b[0] - a[0] * b[2];
        c[2] = a[0] * b[1] - a[1] * b[0];
    }

    static INLINE f8 norm(const f8 a[3]) { return root(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

    // Saffman's force with Mei's correction, and that of Magnus after Oesterle and Bui Dinh
    INLINE void lift(const f8 slip[3], const f8 spin[3], f8 body[3]) {
        const Options& o = job.options;
        const f8 tiny = splat(1e-12f), ratio = load(s.ratio), reynolds = load(s.reynolds);
        const float nu = (float)(job.gas.viscosity / job.gas.density);
        const f8 d = larger(reynolds * nu, splat(1e-12f)), speed = larger(norm(slip), tiny);
        const f8 re = larger(reynolds * speed, splat(1e-9f));
        const i8 solid = reynolds > 0.0f;
        f8 c[3];
        if (o.saffman) {
            const f8 turn = larger(norm(spin), tiny);
            const f8 beta = 0.5f * turn * d / speed, half = root(beta);
            const f8 low = (1.0f - 0.3314f * half) * exponential(-0.1f * re) + 0.3314f * half;
            const f8 mei = select(re < 40.0f, low, 0.0524f * root(beta * re));
            // 1.615 x 6/pi
            const f8 a = 3.084423f * ratio * root(nu / turn) / d * mei;
            cross(slip, spin, c);
            for (int i = 0; i < 3; ++i) body[i] += select(solid, a * c[i], splat(0.0f));
        }
        if (o.magnus) {
            f8 turn[3];
            for (int i = 0; i < 3; ++i) turn[i] = 0.5f * spin[i] - to_float(load(s.omega[i]));
            const f8 size = larger(norm(turn), tiny), quick = d * size / speed;
            const f8 rotation = larger(reynolds * d * size, splat(1e-9f));
            const f8 fade = exponential(-0.05684f * exponential_any(0.4f * logarithm(rotation) + 0.3f * logarithm(re)));
            const f8 lift = 0.45f + (quick - 0.45f) * fade;
            const f8 a = 0.75f * ratio * lift * speed / (size * d);
            cross(turn, slip, c);
            for (int i = 0; i < 3; ++i) body[i] += select(solid, a * c[i], splat(0.0f));
        }
    }

    // e^x, |x| < 87
    static INLINE f8 exponential_any(f8 x) {
        const f8 e = exponential(-absolute(x));
        return select(x > 0.0f, 1.0f / e, e);
    }

    // temperature and rotation at the end of the step
    INLINE void heat_and_spin(const Sample& g, i8 cell, f8 re, f8 dt, const f8 spin[3]) {
        const Options& o = job.options;
        f8 decay;
        if (o.magnus) {
            const float nu = (float)(job.gas.viscosity / job.gas.density);
            const f8 reynolds = load(s.reynolds), d = larger(reynolds * nu, splat(1e-12f));
            f8 turn[3];
            for (int i = 0; i < 3; ++i) turn[i] = 0.5f * spin[i] - to_float(load(s.omega[i]));
            const f8 size = norm(turn), rotation = larger(reynolds * d * size, splat(1e-9f));
            // C_R Re_R: 64 pi, then 12.9 Re_R^(1/2) + 128.4
            const f8 torque = select(rotation < 32.0f, splat(201.06193f), 12.9f * root(rotation) + 128.4f);
            const f8 rate = 0.29841552f * load(s.ratio) * torque * nu / (d * d);
            const f8 h = smaller(rate * dt, splat(80.0f)), share = h * mean_decay(h, decay);
            for (int i = 0; i < 3; ++i)
                store(s.omega[i], load(s.omega[i]) + to_double(share * turn[i]));
        }
        if (o.heat) {
            const double prandtl = job.gas.viscosity * job.gas.heat_capacity / job.gas.conductivity;
            const f8 nusselt = 2.0f + 0.6f * root(re) * (float)__builtin_cbrt(prandtl);
            const f8 h = load(s.conduct) * nusselt * dt, share = h * mean_decay(h, decay);
            const d8 before = load(s.temperature);
            const f8 change = share * (g.temperature - to_float(before));
            store(s.temperature, before + to_double(change));
            if (job.with_heat_sinks) book_heat(cell, change, share);
        }
    }

    INLINE void book_heat(i8 cell, f8 change, f8 share) {
        const d8 flow = load(s.weight) * to_double(load(s.capacity));
        alignas(64) double given[8], slope[8];
        store(given, flow * to_double(change) * splat_double(job.scales.heat_scale));
        store(slope, flow * to_double(share) * splat_double(job.scales.heat_slope));
        for (unsigned left = s.active; left; left &= left - 1) {
            const int k = __builtin_ctz(left);
            int64_t* sum = out.sinks.heat + 2 * (int64_t)cell[k];
            sum[0] += whole(given[k]);
            sum[1] += whole(slope[k]);
        }
    }

    // the nearest whole number, below 2^51
    static INLINE int64_t whole(double x) {
        const double magic = 6755399441055744.0, sum = x + magic;
        int64_t value, zero;
        __builtin_memcpy(&value, &sum, 8);
        __builtin_memcpy(&zero, &magic, 8);
        return value - zero;
    }

    // sums of a step, in units so that they add up without round-off
    INLINE void book(i8 cell, const Mirror& m, f8 dt, f8 way, const d8 gain[3], const d8 v[3], f8 lag,
                     f8 b, const f8 slip[3], const f8 body[3]) {
        const kernel::Sinks& scale = job.scales;
        const double magic = 6755399441055744.0;
        alignas(64) double parts[kernel::SUMS][8];
        const d8 weight = load(s.weight), one = splat_double(magic);
        const d8 impulse = weight * splat_double(scale.impulse);
        const d8 stay = weight * to_double(dt) * splat_double(scale.residence);
        const d8 moment = weight * splat_double(scale.moment);
        for (int i = 0; i < 3; ++i) {
            // folded: what acts on a mirrored place is mirrored
            const d8 sign = i < 2 ? to_double(m.sign[i]) : splat_double(1.0);
            store(parts[i], impulse * gain[i] * sign + one);
            const d8 path = to_double(dt) * v[i] + to_double(lag * (b * slip[i] + body[i]));
            store(parts[5 + i], moment * path * sign + one);
        }
        store(parts[3], weight * to_double(way * b) * splat_double(scale.slope) + one);
        store(parts[4], stay + one);
        int64_t zero;
        __builtin_memcpy(&zero, &magic, 8);
        for (unsigned left = s.active; left; left &= left - 1) {
            const int k = __builtin_ctz(left);
            int64_t* sum = out.sinks.sums + (int64_t)cell[k] * kernel::SUMS;
            for (int i = 0; i < kernel::SUMS; ++i) {
                int64_t value;
                __builtin_memcpy(&value, &parts[i][k], 8);
                sum[i] += value - zero;
            }
        }
    }

    // Collisions half-way. What lies beyond a wall meets the mirrored cloud there.
    __attribute__((noinline)) void meet(const Sample& g, const Mirror& m, i8 cell, f8 dt) {
        const Options& o = job.options;
        Meeting now;
        f8 w[3], spin[3], hand = m.sign[0] * m.sign[1];
        for (int i = 0; i < 3; ++i) w[i] = to_float(load(s.v[i])), spin[i] = to_float(load(s.omega[i]));
        unfold(m, w, spin, hand);
        for (int i = 0; i < 3; ++i) {
            store(now.w[i], w[i]);
            store(now.omega[i], spin[i]);
        }
        f8 noise[3], chance;
        normals(philox(load(s.low), load(s.high), load(s.step), 2, o.seed), noise, chance);
        const Words more = philox(load(s.low), load(s.high), load(s.step), 3, o.seed);
        for (int i = 0; i < 3; ++i) store(now.noise[i], noise[i]);
        for (int i = 0; i < 4; ++i) store(now.pick[i], uniform(more.w[i]));
        store(now.chance, chance);
        f8 shared = splat(0.0f);
        if (o.dispersion != kernel::Dispersion::none && o.pair_correlation > 0) {
            const f8 stokes = smaller(larger(g.rate / larger(load(s.rate), splat(1e-12f)), splat(1e-8f)), splat(1e8f));
            shared = exponential(-(float)o.pair_correlation * exponential_any(0.4f * logarithm(stokes)));
        }
        store(now.shared, shared);
        unsigned hit = 0;
        for (unsigned left = s.active; left; left &= left - 1) {
            const int k = __builtin_ctz(left);
            const int material = s.table[k] / kernel::DRAG_ROWS;
            const double d = 2 * s.radius[k], rho = s.mass[k] / (0.5235987755982989 * d * d * d);
            if (!meet_lane(job, now, k, cell[k], material, d, rho, dt[k])) continue;
            hit |= 1u << k;
            const int64_t row = (int64_t)material * job.grid.count + cell[k];
            out.sinks.pairs[row * kernel::PAIRS + 7] += whole(s.weight[k] / s.mass[k] * job.scales.events);
        }
        store(s.meetings, load(now.frequency));
        out.counts.collisions += __builtin_popcount(hit);
        if (hit) change(m, now, hit);
    }

    // velocity and rotation into the frame of the part that is solved and back
    INLINE void unfold(const Mirror& m, f8 w[3], f8 spin[3], f8 hand) {
        for (int i = 0; i < 2; ++i) w[i] *= m.sign[i], spin[i] *= m.sign[i];
        if (m.any_beyond) {
            mirror_vector(m, w);
            mirror_vector(m, spin);
            for (int i = 0; i < 2; ++i) hand = select(m.beyond[i], -hand, hand);
        }
        for (int i = 0; i < 3; ++i) spin[i] *= hand;
    }

    void change(const Mirror& m, Meeting& now, unsigned hit) {
        for (int k = 0; k < LANES; ++k) {
            if (hit >> k & 1) continue;
            for (int i = 0; i < 3; ++i) now.change[i][k] = now.turn[i][k] = 0.0f;
        }
        f8 w[3], spin[3], hand = m.sign[0] * m.sign[1];
        for (int i = 0; i < 3; ++i) w[i] = load(now.change[i]), spin[i] = load(now.turn[i]);
        // mirrored first, folded after
        if (m.any_beyond) {
            mirror_vector(m, w);
            mirror_vector(m, spin);
            for (int i = 0; i < 2; ++i) hand = select(m.beyond[i], -hand, hand);
        }
        for (int i = 0; i < 2; ++i) w[i] *= m.sign[i], spin[i] *= m.sign[i];
        for (int i = 0; i < 3; ++i) {
            store(s.v[i], load(s.v[i]) + to_double(w[i]));
            store(s.omega[i], load(s.omega[i]) + to_double(spin[i] * hand));
        }
    }

    // numbers of a step by material and cell
    INLINE void book_numbers(i8 cell, const Mirror& m, f8 dt, const d8 speed[3]) {
        const kernel::Sinks& scale = job.scales;
        f8 w[3];
        for (int i = 0; i < 3; ++i) w[i] = to_float(speed[i]);
        for (int i = 0; i < 2; ++i) w[i] *= m.sign[i];
        if (m.any_beyond) mirror_vector(m, w);
        alignas(32) float v[3][8];
        for (int i = 0; i < 3; ++i) store(v[i], w[i]);
        for (unsigned left = s.active; left; left &= left - 1) {
            const int k = __builtin_ctz(left);
            if (!(s.mass[k] > 0)) continue;
            const double time = s.weight[k] / s.mass[k] * dt[k];
            const int64_t row = (int64_t)(s.table[k] / kernel::DRAG_ROWS) * job.grid.count + cell[k];
            int64_t* sum = out.sinks.pairs + row * kernel::PAIRS;
            sum[0] += whole(time * scale.number);
            sum[8] += whole(time * s.mass[k] * scale.pair_mass);
            for (int i = 0; i < 3; ++i) {
                sum[1 + i] += whole(time * v[i][k] * scale.pair_moment);
                sum[4 + i] += whole(time * (double)v[i][k] * v[i][k] * scale.pair_square);
            }
        }
    }

    // (12): crossing of the cell, relaxation, eddies and a cap, with T_L predicted for the next half-way
    INLINE void next_step(const Sample& g, const Place& place, const d8 target[3], const d8 middle[3],
                          const d8 speed[3], const Mirror& m, f8 b) {
        const Options& o = job.options;
        const f8 zero = splat(0.0f);
        f8 v[3], ue[3];
        for (int i = 0; i < 3; ++i) v[i] = to_float(speed[i]), ue[i] = load(s.u[i]);
        f8 dt = smaller(splat((float)o.largest), load(s.limit) / larger(b, splat(1e-20f)));
        // in the frame of the part that is solved
        f8 ahead[3];
        const i8 light = b > 1e6f;
        for (int i = 0; i < 3; ++i) ahead[i] = select(light, ue[i], v[i]);
        for (int i = 0; i < 2; ++i) ahead[i] *= m.sign[i];
        if (m.any_beyond) mirror_vector(m, ahead);
        // points that follow the gas take its standard deviation: a step that is shorter for faster
        // points would not keep a mixed cloud mixed
        const f8* L = g.factor;
        const f8 spread[3] = {absolute(L[0]), root(L[1] * L[1] + L[2] * L[2]),
                              root(L[3] * L[3] + L[4] * L[4] + L[5] * L[5])};
        f8 across[3];
        for (int i = 0; i < 3; ++i) across[i] = select(light, absolute(g.u[i]) + spread[i], ahead[i]);
        const f8 crossings = Kind::crossings(place, across) * (float)o.cells;
        dt = smaller(dt, 1.0f / larger(crossings, splat(1e-20f)));
        if (o.dispersion != kernel::Dispersion::none) {
            const float c = (float)o.eddies;
            f8 moved[3];
            for (int i = 0; i < 3; ++i) moved[i] = to_float(target[i] - middle[i]);
            for (int i = 0; i < 2; ++i) moved[i] *= m.sign[i];
            if (m.any_beyond) mirror_vector(m, moved);
            f8 change = zero, slope = zero;
            for (int i = 0; i < Kind::DIM; ++i) {
                change += g.time_slope[i] * moved[i];
                slope += g.time_slope[i] * ahead[i];
            }
            const f8 time = larger(g.time + change, 0.25f * g.time);
            const f8 factor = larger(1.0f - 0.5f * c * slope, splat(0.5f));
            dt = smaller(dt, c * time / factor);
        }
        if (job.with_pairs && o.pair_share > 0)
            dt = smaller(dt, (float)o.pair_share / larger(load(s.meetings), splat(1e-20f)));
        store(s.dt, larger(dt, splat((float)o.smallest)));
    }

    // lanes whose path ends outside the walls
    INLINE i8 outside(const d8 target[3]) {
        const Geometry& g = job.geometry;
        const d8 radius = load(s.radius);
        if (g.wall == kernel::Wall::rectangle) {
            const i8 x = less(splat_double(g.half[0]) - radius, absolute(target[0]));
            return x | less(splat_double(g.half[1]) - radius, absolute(target[1]));
        }
        if (g.wall == kernel::Wall::circle) {
            const d8 r = splat_double(g.half[0]) - radius;
            return less(r * r, target[0] * target[0] + target[1] * target[1]);
        }
        if (Kind::DIM == 3 && g.wall == kernel::Wall::planes) {
            i8 near;
            for (int k = 0; k < LANES; ++k)
                near[k] = job.grid.near_start[s.cell[k]] < job.grid.near_start[s.cell[k] + 1] ? -1 : 0;
            return near;
        }
        if (Kind::DIM == 3 && g.wall != kernel::Wall::none) return outside_bend(target, to_float(radius));
        return splat_int(0);
    }

    // the same of a bent line, with a margin for round-off
    INLINE i8 outside_bend(const d8 target[3], f8 radius) {
        const Geometry& g = job.geometry;
        const double co = __builtin_cos(g.angle), si = __builtin_sin(g.angle);
        const bool up = g.normal[1] != 0.0;
        const d8 lever = splat_double(g.radius) - (target[0] * splat_double(g.normal[0]) + target[1] * splat_double(g.normal[1]));
        const d8 ahead = target[2] - splat_double(g.before), zero = splat_double(0.0);
        const f8 behind = to_float(lever * splat_double(co) + ahead * splat_double(si));
        const f8 l = to_float(lever), a = to_float(ahead), size = root(l * l + a * a);
        const i8 first = less(ahead, zero) & less(zero, lever);
        const i8 last = less(zero, ahead * splat_double(co) - lever * splat_double(si));
        const f8 c = (float)g.radius - select(first, l, select(last, behind, size));
        const f8 b = to_float(up ? target[0] : target[1]);
        const f8 margin = radius + splat((float)(2e-6 * g.radius));
        if (g.wall == kernel::Wall::bent_circle) return root(c * c + b * b) > (float)g.half[0] - margin;
        const f8 wide = splat((float)g.half[up ? 1 : 0]), high = splat((float)g.half[up ? 0 : 1]);
        return (absolute(c) > wide - margin) | (absolute(b) > high - margin);
    }

    // lanes beyond the ends of a line
    INLINE unsigned gone() {
        const Geometry& g = job.geometry;
        const d8 z = load(s.x[2]), zero = splat_double(0.0);
        if (g.wall != kernel::Wall::bent_circle && g.wall != kernel::Wall::bent_rectangle)
            return bits(less(z, zero) | less(splat_double(g.length), z));
        const double co = __builtin_cos(g.angle), si = __builtin_sin(g.angle);
        const double rest = g.length - g.before - g.radius * g.angle;
        const d8 lever = splat_double(g.radius) - (load(s.x[0]) * splat_double(g.normal[0]) + load(s.x[1]) * splat_double(g.normal[1]));
        const d8 ahead = z - splat_double(g.before);
        const i8 first = less(ahead, zero) & less(zero, lever);
        const i8 beyond = less(splat_double(rest), ahead * splat_double(co) - lever * splat_double(si));
        return bits((first & less(z, zero)) | (~first & beyond));
    }

    // impacts, and lanes that are done
    INLINE void finish(const Sample& g, const Mirror& m, unsigned hit, unsigned last, const d8 x[3],
                       const d8 target[3], f8 dt) {
        const Options& o = job.options;
        out.counts.steps += __builtin_popcount(s.active);
        unsigned deposited = 0, out_now = 0;
        if (hit) deposited = impacts(g, m, hit, x, target, dt, out_now);
        if (job.geometry.length > 0) out_now |= gone();
        store(s.count, load(s.count) + 1);
        i8 ends;
        if (o.until_time) {
            ends = splat_int(0);
        } else {
            // one that was thrown back at the end of the slab goes on
            ends = less(splat_double(o.end), load(s.x[2]));
        }
        const i8 long_way = load(s.count) >= splat_int((int32_t)(o.max_steps < 2147483647 ? o.max_steps : 2147483647));
        const d8 sum = load(s.x[0]) + load(s.x[1]) + load(s.x[2]) + load(s.v[0]) + load(s.v[1]) + load(s.v[2]);
        const i8 fine = less(absolute(sum), splat_double(1e300));
        const unsigned lost = ~bits(fine) & 255u, stuck = bits(long_way);
        unsigned done = (last | bits(ends) | deposited | out_now | lost | stuck) & s.active;
        for (; done; done &= done - 1) {
            const int k = __builtin_ctz(done);
            const unsigned bit = 1u << k;
            const int8_t status = lost & bit        ? kernel::LOST
                                  : deposited & bit ? kernel::DEPOSITED
                                  : out_now & bit   ? kernel::OUT
                                  : (last | bits(ends)) & bit ? kernel::INSIDE
                                                              : kernel::STUCK;
            if (o.until_time && status == kernel::INSIDE) s.time[k] = o.end;
            write_lane(job, s, k, status);
            vacant |= bit;
        }
        for (; vacant; vacant &= vacant - 1) {
            const int k = __builtin_ctz(vacant);
            const unsigned bit = 1u << k;
            s.active = refill(k) ? s.active | bit : s.active & ~bit;
            if (!(s.active & bit) && s.active) copy_lane(k, __builtin_ctz(s.active));
        }
        // idle lanes stand still
        for (unsigned idle = ~s.active & 255u; idle; idle &= idle - 1) s.dt[__builtin_ctz(idle)] = 0.0f;
    }

    __attribute__((noinline)) unsigned impacts(const Sample& g, const Mirror& m, unsigned hit, const d8 x[3],
                                               const d8 target[3], f8 dt, unsigned& out_now) {
        unsigned deposited = 0;
        alignas(64) double from[3][8], to[3][8];
        for (int i = 0; i < 3; ++i) store(from[i], x[i]), store(to[i], target[i]);
        for (; hit; hit &= hit - 1) {
            const int k = __builtin_ctz(hit);
            Body body;
            for (int i = 0; i < 3; ++i) {
                body.x[i] = from[i][k];
                body.path[i] = to[i][k] - from[i][k];
                body.v[i] = s.v[i][k];
                body.omega[i] = s.omega[i][k];
                body.xi[i] = s.xi[i][k];
                body.u[i] = s.u[i][k];
            }
            body.radius = s.radius[k];
            body.dt = dt[k];
            body.id = (uint64_t)s.low[k] | (uint64_t)s.high[k] << 32;
            body.step = s.step[k];
            body.bounces = s.bounces[k];
            body.cell = s.cell[k];
            body.deposited = body.out = false;
            const float sign[3] = {m.sign[0][k], m.sign[1][k], 1.0f};
            const float L[3][3] = {{g.factor[0][k], 0, 0},
                                   {g.factor[1][k], g.factor[2][k], 0},
                                   {g.factor[3][k], g.factor[4][k], g.factor[5][k]}};
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) body.factor[i][j] = sign[i] * L[i][j] * sign[j];
            body.mirrored = job.geometry.wall == kernel::Wall::planes && sign[0] < 0.0f;
            if (body.mirrored) mirror_body(body);
            collide(job, body, (int64_t)body.id, s.index[k], s.time[k], out);
            if (body.mirrored) mirror_body(body);
            for (int i = 0; i < 3; ++i) {
                s.x[i][k] = body.x[i];
                s.v[i][k] = body.v[i];
                s.omega[i][k] = body.omega[i];
                s.xi[i][k] = body.xi[i];
                s.u[i][k] = body.u[i];
            }
            s.bounces[k] = body.bounces;
            if (body.deposited) deposited |= 1u << k;
            if (body.out) out_now |= 1u << k;
        }
        return deposited;
    }

    // the image of a body in the plane x = 0
    static void mirror_body(Body& body) {
        body.x[0] = -body.x[0];
        body.path[0] = -body.path[0];
        body.v[0] = -body.v[0];
        body.u[0] = -body.u[0];
        body.xi[0] = -body.xi[0];
        for (int i = 1; i < 3; ++i) body.omega[i] = -body.omega[i];
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                if ((i == 0) != (j == 0)) body.factor[i][j] = -body.factor[i][j];
    }
};

template <class Kind, bool FULL>
__attribute__((noinline)) void run(const Job& job, int64_t begin, int64_t end, Output& out) {
    Stepper<Kind, FULL>(job, begin, end, out).run();
}

// advance the particles of a chunk to the end
void advance(const Job& job, int64_t begin, int64_t end, Output& out) {
    const Options& o = job.options;
    const bool full = o.pressure || o.saffman || o.magnus || o.heat || o.added_mass > 0;
    switch (job.grid.cells) {
        case Cells::quadrilateral:
            return full ? run<Quadrilateral, true>(job, begin, end, out)
                        : run<Quadrilateral, false>(job, begin, end, out);
        case Cells::triangle:
            return full ? run<Triangle, true>(job, begin, end, out) : run<Triangle, false>(job, begin, end, out);
        case Cells::tetrahedron:
            return full ? run<Tetrahedron, true>(job, begin, end, out)
                        : run<Tetrahedron, false>(job, begin, end, out);
        case Cells::hexahedron:
            return full ? run<Hexahedron, true>(job, begin, end, out)
                        : run<Hexahedron, false>(job, begin, end, out);
    }
}

}  // namespace KERNEL_NAMESPACE
