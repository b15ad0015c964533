// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Walls and impacts, one particle at a time: a small part of all steps.
//
// A step's straight path is cut where the surface of the sphere meets a wall; what is left of it goes
// on after the impact, several times where walls meet.
#pragma once

#include "gas.h"

namespace KERNEL_NAMESPACE {

using kernel::Geometry;
using kernel::Impact;
using kernel::Job;
using kernel::Options;

constexpr int MOST_BOUNCES = 32;

struct Body {
    double x[3], path[3], v[3], omega[3];
    double radius, dt;
    float xi[3], u[3];
    // what u' = F xi is at the place of the step, in the frame of the whole line
    float factor[3][3];
    uint64_t id;
    uint32_t step, bounces;
    bool deposited;
};

INLINE double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// share of the path until the first wall, and the wall's normal out of the flow; above 1 for none
INLINE double first_wall(const Geometry& g, const Body& body, double normal[3]) {
    double first = 2.0;
    normal[0] = normal[1] = normal[2] = 0.0;
    if (g.wall == kernel::Wall::rectangle) {
        for (int i = 0; i < 2; ++i) {
            const double half = g.half[i] - body.radius, end = body.x[i] + body.path[i];
            if (end <= half && end >= -half) continue;
            const double side = end > half ? 1.0 : -1.0;
            double share = (side * half - body.x[i]) / body.path[i];
            if (body.path[i] * side <= 0.0) continue;
            share = share > 0.0 ? share : 0.0;
            if (share < first) {
                first = share;
                normal[0] = i == 0 ? side : 0.0;
                normal[1] = i == 1 ? side : 0.0;
            }
        }
    } else if (g.wall == kernel::Wall::circle) {
        const double r = g.half[0] - body.radius;
        const double ex = body.x[0] + body.path[0], ey = body.x[1] + body.path[1];
        if (ex * ex + ey * ey > r * r) {
            const double a = body.path[0] * body.path[0] + body.path[1] * body.path[1];
            const double b = body.x[0] * body.path[0] + body.x[1] * body.path[1];
            const double c = body.x[0] * body.x[0] + body.x[1] * body.x[1] - r * r;
            const double d = b * b - a * c, s = __builtin_sqrt(d > 0.0 ? d : 0.0);
            double share = b > 0.0 ? -c / (b + s) : (s - b) / a;
            share = share > 0.0 ? share : 0.0;
            if (share <= 1.0) {
                first = share;
                const double hx = body.x[0] + share * body.path[0], hy = body.x[1] + share * body.path[1];
                const double h = 1.0 / __builtin_sqrt(hx * hx + hy * hy);
                normal[0] = hx * h;
                normal[1] = hy * h;
            }
        }
    }
    return first;
}

// put a touching particle exactly on the wall
INLINE void settle(const Geometry& g, Body& body, const double normal[3]) {
    if (g.wall == kernel::Wall::rectangle) {
        for (int i = 0; i < 2; ++i)
            if (normal[i] != 0.0) body.x[i] = normal[i] * (g.half[i] - body.radius);
    } else if (g.wall == kernel::Wall::circle) {
        const double r = g.half[0] - body.radius;
        body.x[0] = normal[0] * r;
        body.x[1] = normal[1] * r;
    }
}

// two uniform numbers of an impact, in (0, 1)
inline void impact_numbers(const Body& body, uint64_t seed, uint32_t draw, double u[4]) {
    const u8 low = (u8)splat_int((int32_t)(uint32_t)body.id);
    const u8 high = (u8)splat_int((int32_t)(uint32_t)(body.id >> 32));
    const u8 step = (u8)splat_int((int32_t)body.step);
    const Words w = philox(low, high, step, 0x10000u + 64u * body.bounces + draw, seed);
    for (int i = 0; i < 4; ++i) u[i] = ((double)w.w[i][0] + 0.5) * 2.3283064365386963e-10;
}

// the gas as the particle sees it beyond a wall is that of the mirrored flow
inline void mirror_gas(Body& body, const double n[3]) {
    // row of the normal in the space of xi
    float q[3], size = 0.0f;
    for (int j = 0; j < 3; ++j) {
        q[j] = 0.0f;
        for (int i = 0; i < 3; ++i) q[j] += (float)n[i] * body.factor[i][j];
        size += q[j] * q[j];
    }
    if (size > 0.0f) {
        const float c = 2.0f * (q[0] * body.xi[0] + q[1] * body.xi[1] + q[2] * body.xi[2]) / size;
        for (int j = 0; j < 3; ++j) body.xi[j] -= c * q[j];
    }
    const float un = 2.0f * (float)(n[0] * body.u[0] + n[1] * body.u[1] + n[2] * body.u[2]);
    for (int i = 0; i < 3; ++i) body.u[i] -= un * (float)n[i];
}

// normal of a rough wall as the particle meets it: tilted by a normal angle out of the flanks that
// it can see, a flank in the proportion of sin(angle of approach + tilt)
inline void roughened(const Body& body, const Options& o, const double n[3], double tilted[3]) {
    for (int i = 0; i < 3; ++i) tilted[i] = n[i];
    const double vn = dot(body.v, n);
    double t[3], size = 0.0;
    for (int i = 0; i < 3; ++i) t[i] = body.v[i] - vn * n[i], size += t[i] * t[i];
    if (!(vn > 0.0) || size <= 0.0) return;
    size = __builtin_sqrt(size);
    double b[3];
    for (int i = 0; i < 3; ++i) t[i] /= size;
    b[0] = n[1] * t[2] - n[2] * t[1];
    b[1] = n[2] * t[0] - n[0] * t[2];
    b[2] = n[0] * t[1] - n[1] * t[0];
    for (uint32_t draw = 0; draw < 32; ++draw) {
        double u[4], w[4];
        impact_numbers(body, o.seed, 2 * draw, u);
        impact_numbers(body, o.seed, 2 * draw + 1, w);
        const double r = o.roughness * __builtin_sqrt(-2.0 * __builtin_log(u[0]));
        const double along = r * __builtin_cos(6.283185307179586 * u[1]);
        const double across = r * __builtin_sin(6.283185307179586 * u[1]);
        double m[3], length = 0.0;
        for (int i = 0; i < 3; ++i) {
            m[i] = n[i] + __builtin_tan(along) * t[i] + __builtin_tan(across) * b[i];
            length += m[i] * m[i];
        }
        length = __builtin_sqrt(length);
        for (int i = 0; i < 3; ++i) m[i] /= length;
        const double meets = dot(body.v, m), speed = __builtin_sqrt(dot(body.v, body.v));
        if (meets <= u[2] * speed) continue;
        // the rebound must leave the wall
        const double leaves = vn - (1.0 + o.restitution) * meets * dot(m, n);
        if (leaves >= 0.0) continue;
        for (int i = 0; i < 3; ++i) tilted[i] = m[i];
        return;
    }
}

// velocities after an impact with restitution e and friction: sliding or rolling
INLINE void rebound(Body& body, const Options& o, const double n[3]) {
    const double vn = dot(body.v, n);
    const double e = vn > 0.0 ? o.restitution : 1.0;
    if (o.friction > 0.0 && vn > 0.0 && body.radius > 0.0) {
        // slip of the point that touches: v_t + omega x (r n)
        const double r = body.radius;
        double slip[3] = {body.v[0] - vn * n[0] + r * (body.omega[1] * n[2] - body.omega[2] * n[1]),
                          body.v[1] - vn * n[1] + r * (body.omega[2] * n[0] - body.omega[0] * n[2]),
                          body.v[2] - vn * n[2] + r * (body.omega[0] * n[1] - body.omega[1] * n[0])};
        const double size = __builtin_sqrt(dot(slip, slip));
        double share = 2.0 / 7.0;
        if (size > 0.0) {
            const double sliding = o.friction * (1.0 + e) * vn / size;
            share = sliding < share ? sliding : share;
        }
        double turn[3] = {n[1] * slip[2] - n[2] * slip[1], n[2] * slip[0] - n[0] * slip[2],
                          n[0] * slip[1] - n[1] * slip[0]};
        for (int i = 0; i < 3; ++i) {
            body.v[i] -= share * slip[i];
            body.omega[i] -= 2.5 / r * share * turn[i];
        }
    }
    for (int i = 0; i < 3; ++i) body.v[i] -= (1.0 + e) * vn * n[i];
}

inline void collide(const Job& job, Body& body, int64_t id, int32_t index, double time,
                    kernel::Output& out) {
    const Options& o = job.options;
    double left = 1.0;
    for (int bounce = 0; bounce < MOST_BOUNCES; ++bounce) {
        double n[3];
        const double share = first_wall(job.geometry, body, n);
        if (share > 1.0) break;
        if (bounce == MOST_BOUNCES - 1) {
            for (int i = 0; i < 3; ++i) body.path[i] = 0.0;
            break;
        }
        for (int i = 0; i < 3; ++i) {
            body.x[i] += share * body.path[i];
            body.path[i] *= 1.0 - share;
        }
        settle(job.geometry, body, n);
        left *= 1.0 - share;
        if (job.with_impacts) {
            kernel::ImpactRecord r;
            r.id = id, r.step = body.step, r.bounce = (uint32_t)bounce, r.index = index;
            for (int i = 0; i < 3; ++i) r.x[i] = body.x[i], r.v[i] = body.v[i], r.normal[i] = n[i];
            r.time = time - left * body.dt;
            out.record(out.records, r);
        }
        ++out.counts.bounces;
        ++body.bounces;
        mirror_gas(body, n);
        const double vn = dot(body.v, n);
        if (o.impact == Impact::stick && !(vn >= o.stick_speed)) {
            body.deposited = true;
            for (int i = 0; i < 3; ++i) body.path[i] = 0.0, body.v[i] = 0.0;
            break;
        }
        if (o.impact != Impact::restitution) {
            const double pn = 2.0 * dot(body.path, n);
            for (int i = 0; i < 3; ++i) {
                body.v[i] -= 2.0 * vn * n[i];
                body.path[i] -= pn * n[i];
            }
            continue;
        }
        double m[3] = {n[0], n[1], n[2]};
        if (o.roughness > 0.0) roughened(body, o, n, m);
        const double pn = (1.0 + o.restitution) * dot(body.path, n);
        const bool plain = o.roughness == 0.0 && o.friction == 0.0;
        rebound(body, o, m);
        for (int i = 0; i < 3; ++i)
            body.path[i] = plain ? body.path[i] - pn * n[i] : body.v[i] * left * body.dt;
    }
    for (int i = 0; i < 3; ++i) body.x[i] += body.path[i];
}

}  // namespace KERNEL_NAMESPACE
