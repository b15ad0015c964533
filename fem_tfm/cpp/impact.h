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
    int32_t cell;
    bool deposited, out, mirrored;
};

INLINE double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// A place in the section of a bent line: c towards the centre of the arc, b across, with their units.
struct Across {
    double c, b, towards[3], aside[3], limit_c, limit_b;
};

// where along a bent line: 0 before the arc, 1 in it, 2 behind it
INLINE int leg_of(const Geometry& g, const double x[3], double& lever, double& ahead) {
    lever = g.radius - (x[0] * g.normal[0] + x[1] * g.normal[1]);
    ahead = x[2] - g.before;
    if (ahead < 0.0 && lever > 0.0) return 0;
    return ahead * __builtin_cos(g.angle) - lever * __builtin_sin(g.angle) > 0.0 ? 2 : 1;
}

INLINE Across across(const Geometry& g, const double x[3]) {
    Across a;
    const bool up = g.normal[1] != 0.0;
    a.b = up ? x[0] : x[1];
    a.aside[0] = up ? 1.0 : 0.0;
    a.aside[1] = up ? 0.0 : 1.0;
    a.aside[2] = 0.0;
    a.limit_c = g.half[up ? 1 : 0];
    a.limit_b = g.half[up ? 0 : 1];
    double lever, ahead, n = 1.0, z = 0.0;
    const int leg = leg_of(g, x, lever, ahead);
    if (leg == 0) {
        a.c = g.radius - lever;
    } else if (leg == 2) {
        n = __builtin_cos(g.angle);
        z = -__builtin_sin(g.angle);
        a.c = g.radius - (lever * n - ahead * z);
    } else {
        const double size = __builtin_sqrt(lever * lever + ahead * ahead);
        n = lever / size;
        z = -ahead / size;
        a.c = g.radius - size;
    }
    a.towards[0] = n * g.normal[0];
    a.towards[1] = n * g.normal[1];
    a.towards[2] = z;
    return a;
}

// how far a place lies beyond the walls of a bent line, below 0 inside
INLINE double beyond_bend(const Geometry& g, const double x[3], double radius) {
    const Across a = across(g, x);
    if (g.wall == kernel::Wall::bent_circle)
        return __builtin_sqrt(a.c * a.c + a.b * a.b) - (g.half[0] - radius);
    const double c = __builtin_fabs(a.c) - (a.limit_c - radius), b = __builtin_fabs(a.b) - (a.limit_b - radius);
    return c > b ? c : b;
}

INLINE void bend_normal(const Geometry& g, const double x[3], double radius, double normal[3]) {
    const Across a = across(g, x);
    double c = a.c, b = a.b;
    if (g.wall == kernel::Wall::bent_circle) {
        const double size = __builtin_sqrt(c * c + b * b);
        c /= size;
        b /= size;
    } else {
        const bool side = __builtin_fabs(c) - (a.limit_c - radius) < __builtin_fabs(b) - (a.limit_b - radius);
        const double sign = (side ? b : c) > 0.0 ? 1.0 : -1.0;
        c = side ? 0.0 : sign;
        b = side ? sign : 0.0;
    }
    for (int i = 0; i < 3; ++i) normal[i] = c * a.towards[i] + b * a.aside[i];
}

// the walls of a bent line by bisection
inline double first_bend(const Geometry& g, const Body& body, double normal[3]) {
    double x[3];
    auto at = [&](double share) {
        for (int i = 0; i < 3; ++i) x[i] = body.x[i] + share * body.path[i];
        return beyond_bend(g, x, body.radius);
    };
    if (!(at(1.0) > 0.0)) return 2.0;
    double low = 0.0, high = 1.0;
    if (at(0.0) >= 0.0) {
        // on the wall: either into it, or away from it to another
        bend_normal(g, x, body.radius, normal);
        if (dot(body.path, normal) > 0.0) return 0.0;
        for (low = 1e-9; low < 1.0 && at(low) >= 0.0; low *= 4.0) {
        }
        if (low >= 1.0) return 2.0;
    }
    for (int pass = 0; pass < 52; ++pass) {
        const double middle = 0.5 * (low + high);
        (at(middle) > 0.0 ? high : low) = middle;
    }
    at(low);
    bend_normal(g, x, body.radius, normal);
    return low;
}

// whether a point of a triangle's plane lies in it, or less than `slack` beside it
INLINE bool covers(const double* face, const double p[3], double slack) {
    const double *n = face, *v = face + 4;
    for (int i = 0; i < 3; ++i) {
        const double *a = v + 3 * i, *b = v + 3 * ((i + 1) % 3);
        const double e[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
        const double q[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
        const double side = n[0] * (e[1] * q[2] - e[2] * q[1]) + n[1] * (e[2] * q[0] - e[0] * q[2]) +
                            n[2] * (e[0] * q[1] - e[1] * q[0]);
        const double size = __builtin_sqrt(dot(e, e));
        if (side < -size * (slack + 1e-7 * size)) return false;
    }
    return true;
}

// the triangles of the boundary near the cell of the step
inline double first_face(const Grid& grid, const Body& body, double normal[3], bool& open) {
    double first = 2.0;
    const double step = __builtin_sqrt(dot(body.path, body.path));
    for (int32_t j = grid.near_start[body.cell]; j < grid.near_start[body.cell + 1]; ++j) {
        const double* face = grid.face + (int64_t)grid.near[j] * kernel::FACE;
        const bool wall = face[13] == 1.0;
        const double r = wall ? body.radius : 0.0, ahead = dot(face, body.path);
        const double beyond = dot(face, body.x) + r - face[3];
        if (ahead <= 0.0 || beyond + ahead <= 0.0 || beyond > r + step) continue;
        double share = -beyond / ahead;
        share = share > 0.0 ? share : 0.0;
        if (share >= first) continue;
        double p[3];
        for (int i = 0; i < 3; ++i) p[i] = body.x[i] + share * body.path[i];
        const double off = face[3] - dot(face, p);
        for (int i = 0; i < 3; ++i) p[i] += off * face[i];
        if (!covers(face, p, r)) continue;
        first = share;
        open = !wall;
        for (int i = 0; i < 3; ++i) normal[i] = face[i];
    }
    return first;
}

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

INLINE double first_hit(const Job& job, const Body& body, double n[3], bool& open) {
    switch (job.geometry.wall) {
        case kernel::Wall::planes:
            return first_face(job.grid, body, n, open);
        case kernel::Wall::bent_rectangle:
        case kernel::Wall::bent_circle:
            return first_bend(job.geometry, body, n);
        default:
            return first_wall(job.geometry, body, n);
    }
}

inline void collide(const Job& job, Body& body, int64_t id, double time, kernel::Output& out) {
    const Options& o = job.options;
    double left = 1.0;
    for (int bounce = 0; bounce < MOST_BOUNCES; ++bounce) {
        double n[3];
        bool open = false;
        const double share = first_hit(job, body, n, open);
        if (share > 1.0) break;
        if (open) {
            body.out = true;
            for (int i = 0; i < 3; ++i) body.x[i] += share * body.path[i], body.path[i] = 0.0;
            break;
        }
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
            r.id = id, r.step = body.step, r.bounce = (uint32_t)bounce;
            for (int i = 0; i < 3; ++i) r.x[i] = body.x[i], r.v[i] = body.v[i], r.normal[i] = n[i];
            if (body.mirrored) r.x[0] = -r.x[0], r.v[0] = -r.v[0], r.normal[0] = -r.normal[0];
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
