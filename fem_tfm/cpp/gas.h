// SPDX-License-Identifier: LGPL-3.0-or-later
//
// The gas at the places of eight particles: the cell of each, and the fields of its nodes.
//
// All fields of a node are one row; a lane adds up its rows with the weights of its nodes, the vector
// running over fields, and one transposition turns that into fields whose vectors run over lanes.
#pragma once

#include "kernel.h"
#include "lanes.h"

namespace KERNEL_NAMESPACE {

using kernel::Cells;
using kernel::Gas;
using kernel::Grid;
using kernel::ROW;

// floats of the row of a cell
constexpr int PLANE_MAP = kernel::layout_of(Cells::quadrilateral).map;
constexpr int TETRAHEDRON_MAP = kernel::layout_of(Cells::tetrahedron).map;
constexpr int HEXAHEDRON_MAP = kernel::layout_of(Cells::hexahedron).map;
static_assert(PLANE_MAP == kernel::layout_of(Cells::triangle).map, "one map for plane cells");

// places outside a cell by less than this, in reference coordinates, are inside
constexpr float TOLERANCE = 2e-6f;
// moves after which a place counts as astray and its cell is looked for afresh, once
constexpr int MOST_MOVES = 256;

// where the particles are: cell, reference coordinates, inverse Jacobian (d xi_i/d x_j)
struct Place {
    i8 cell;
    f8 at[3];
    f8 inverse[9];
    i8 clamped[3];
    // bits of lanes whose walk was broken off at their cell, and of those that leave the part of this
    // rank or go astray: for the ghost they come to, or -1
    unsigned resumed, left;
    alignas(32) int32_t moves[8], ghost[8];
};

// fields at the places, in the frame of the part that is solved
struct Sample {
    f8 u[3], rate, time, factor[6], strip, temperature, pressure[3];
    f8 slope_x[4], slope_y[4];  // of T_L, L11, L21, L22 in a plane
    f8 time_slope[3];           // grad T_L
    f8 drift[3];                // d_i L_ij
    f8 spin[3];                 // rot U
};

// eight rows of four floats as four vectors
INLINE void load_quarters(const float* const row[8], f8 out[4]) {
    f8 r[4];
    for (int k = 0; k < 4; ++k) {
        const f4 a = load4(row[k]), b = load4(row[k + 4]);
#if defined(__AVX__)
        r[k] = (f8)_mm256_set_m128((__m128)b, (__m128)a);
#else
        for (int j = 0; j < 4; ++j) r[k][j] = a[j], r[k][j + 4] = b[j];
#endif
    }
    const f8 a0 = SHUFFLE(r[0], r[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 a1 = SHUFFLE(r[0], r[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const f8 a2 = SHUFFLE(r[2], r[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 a3 = SHUFFLE(r[2], r[3], 2, 10, 3, 11, 6, 14, 7, 15);
    out[0] = SHUFFLE(a0, a2, 0, 1, 8, 9, 4, 5, 12, 13);
    out[1] = SHUFFLE(a0, a2, 2, 3, 10, 11, 6, 7, 14, 15);
    out[2] = SHUFFLE(a1, a3, 0, 1, 8, 9, 4, 5, 12, 13);
    out[3] = SHUFFLE(a1, a3, 2, 3, 10, 11, 6, 7, 14, 15);
}

// What the kinds of cells share: the walk from the last cell towards the place.
//
// Whether and where it moves on depends on the cell, the place and the number of moves alone, so that
// a walk that is broken off at a cell of another rank goes on there as if it had not been.
template <class Kind>
struct Walk {
    // `p` in the frame of the part that is solved
    static INLINE void locate(const Grid& grid, const d8 p[3], Place& place) {
        place.left = 0;
        for (;;) {
            Kind::invert(grid, p, place);
            f8 worst = Kind::outside(place.at, 0);
            for (int i = 1; i < Kind::FACETS; ++i) worst = larger(worst, Kind::outside(place.at, i));
            const unsigned out = bits(worst > TOLERANCE) | place.resumed;
            if (out == 0 || !step(grid, p, place, out)) break;
        }
        Kind::clamp(place);
    }

    // how far a place lies beyond each facet of a straight cell
    static INLINE void beyond_facets(const Grid& grid, int32_t cell, const double at[3][8], int k, float* beyond) {
        const float* row = grid.map + (int64_t)cell * Kind::MAP;
        const float* inverse = row + (Kind::DIM == 2 ? 4 : 6);
        float d[Kind::DIM], here[Kind::DIM];
        for (int i = 0; i < Kind::DIM; ++i)
            d[i] = (float)(at[i][k] - ((double)row[2 * i] + (double)row[2 * i + 1]));
        for (int i = 0; i < Kind::DIM; ++i) {
            here[i] = 0.0f;
            for (int j = 0; j < Kind::DIM; ++j) here[i] += inverse[Kind::DIM * i + j] * d[j];
        }
        for (int i = 0; i < Kind::FACETS; ++i) beyond[i] = Kind::outside(here, i);
    }

    // move every lane that is outside, through straight cells into the last of them or the first that
    // is not; whether any moved
    static __attribute__((noinline)) bool step(const Grid& grid, const d8 p[3], Place& place, unsigned out) {
        bool moved = false;
        alignas(32) float far[Kind::FACETS][8];
        alignas(32) int32_t cell[8];
        alignas(64) double at[3][8];
        for (int i = 0; i < Kind::FACETS; ++i) store(far[i], Kind::outside(place.at, i));
        for (int i = 0; i < Kind::DIM; ++i) store(at[i], p[i]);
        store(cell, place.cell);
        for (out &= ~place.left; out; out &= out - 1) {
            const int k = __builtin_ctz(out);
            float beyond[Kind::FACETS], most = TOLERANCE;
            if (place.resumed >> k & 1 && !grid.curved[cell[k]]) {
                beyond_facets(grid, cell[k], at, k, beyond);
                most = 0.5f * TOLERANCE;
            } else {
                for (int i = 0; i < Kind::FACETS; ++i) beyond[i] = far[i][k];
            }
            while (place.moves[k] < 2 * MOST_MOVES) {
                const int32_t* neighbour = grid.neighbour + (int64_t)cell[k] * Kind::FACETS;
                int32_t next = -1;
                for (int i = 0; i < Kind::FACETS; ++i) {
                    if (beyond[i] > most && neighbour[i] != -1) most = beyond[i], next = neighbour[i];
                }
                if (next == -1) break;
                const bool stray = ++place.moves[k] == MOST_MOVES;
                if (stray || next < 0) {
                    place.left |= 1u << k;
                    place.ghost[k] = stray ? -1 : next;
                    break;
                }
                cell[k] = next;
                moved = true;
                if (grid.any_curved && grid.curved[next]) break;
                beyond_facets(grid, next, at, k, beyond);
                most = 0.5f * TOLERANCE;
            }
        }
        place.resumed = 0;
        place.cell = load(cell);
        return moved;
    }
};

// origin and inverse at the centre of plane cells, and the offset from the origin
INLINE void plane_affine(const Grid& grid, const d8 p[3], const Place& place, f8 m[8], f8& dx, f8& dy) {
    for (int k = 0; k < LANES; ++k) m[k] = load(grid.map + (int64_t)place.cell[k] * PLANE_MAP);
    transpose(m);
    dx = to_float(p[0] - (to_double(m[0]) + to_double(m[1])));
    dy = to_float(p[1] - (to_double(m[2]) + to_double(m[3])));
}

INLINE i8 curved_lanes(const Grid& grid, i8 cell) {
    i8 mask;
    for (int k = 0; k < LANES; ++k) mask[k] = grid.curved[cell[k]] ? -1 : 0;
    return mask;
}

// Newton on the polynomial map of plane cells of degree two
INLINE void plane_newton(const Grid& grid, i8 curved, f8 dx, f8 dy, Place& place) {
    f8 c[16];
    for (int h = 0; h < 2; ++h) {
        for (int k = 0; k < LANES; ++k)
            c[8 * h + k] = load(grid.map + (int64_t)place.cell[k] * PLANE_MAP + 8 + 8 * h);
        transpose(c + 8 * h);
    }
    // coefficients of xi, eta, xi eta, xi^2, eta^2, xi^2 eta, xi eta^2, xi^2 eta^2
    const f8 *X = c, *Y = c + 8;
    f8 a = place.at[0], b = place.at[1], i00, i01, i10, i11;
    const f8 most = splat(3.0f);
    for (int pass = 0; pass < 5; ++pass) {
        const f8 ab = a * b, aa = a * a, bb = b * b;
        const f8 x = a * (X[0] + a * X[3]) + b * (X[1] + b * X[4]) + ab * (X[2] + a * X[5] + b * X[6] + ab * X[7]);
        const f8 y = a * (Y[0] + a * Y[3]) + b * (Y[1] + b * Y[4]) + ab * (Y[2] + a * Y[5] + b * Y[6] + ab * Y[7]);
        const f8 xa = X[0] + 2.0f * a * X[3] + b * X[2] + 2.0f * ab * X[5] + bb * X[6] + 2.0f * a * bb * X[7];
        const f8 xb = X[1] + 2.0f * b * X[4] + a * X[2] + aa * X[5] + 2.0f * ab * X[6] + 2.0f * aa * b * X[7];
        const f8 ya = Y[0] + 2.0f * a * Y[3] + b * Y[2] + 2.0f * ab * Y[5] + bb * Y[6] + 2.0f * a * bb * Y[7];
        const f8 yb = Y[1] + 2.0f * b * Y[4] + a * Y[2] + aa * Y[5] + 2.0f * ab * Y[6] + 2.0f * aa * b * Y[7];
        const f8 det = xa * yb - xb * ya;
        const f8 inverse = 1.0f / det;
        i00 = yb * inverse;
        i01 = -xb * inverse;
        i10 = -ya * inverse;
        i11 = xa * inverse;
        if (pass == 4) break;
        const f8 rx = dx - x, ry = dy - y;
        a = smaller(larger(a + i00 * rx + i01 * ry, -most), most);
        b = smaller(larger(b + i10 * rx + i11 * ry, -most), most);
    }
    place.at[0] = select(curved, a, place.at[0]);
    place.at[1] = select(curved, b, place.at[1]);
    place.inverse[0] = select(curved, i00, place.inverse[0]);
    place.inverse[1] = select(curved, i01, place.inverse[1]);
    place.inverse[2] = select(curved, i10, place.inverse[2]);
    place.inverse[3] = select(curved, i11, place.inverse[3]);
}

INLINE void plane_invert(const Grid& grid, const d8 p[3], Place& place) {
    f8 m[8], dx, dy;
    plane_affine(grid, p, place, m, dx, dy);
    place.at[0] = m[4] * dx + m[5] * dy;
    place.at[1] = m[6] * dx + m[7] * dy;
    for (int i = 0; i < 4; ++i) place.inverse[i] = m[4 + i];
    if (grid.any_curved) {
        const i8 curved = curved_lanes(grid, place.cell);
        if (bits(curved)) plane_newton(grid, curved, dx, dy, place);
    }
}

// rows of a node at both stations, linear between them
struct Rows {
    const float *first, *second;
    bool both, slopes;
    INLINE f8 eight(int64_t node, int from, float t) const {
        const f8 r = load(first + node * ROW + from);
        if (!both) return r;
        return r + splat(t) * (load(second + node * ROW + from) - r);
    }
    INLINE f4 four(int64_t node, int from, float t) const {
        const f4 r = load4(first + node * ROW + from);
        if (!both) return r;
        const f4 s = {t, t, t, t};
        return r + s * (load4(second + node * ROW + from) - r);
    }
};

INLINE f8 joined(f4 a, f4 b) {
#if defined(__AVX__)
    return (f8)_mm256_set_m128((__m128)b, (__m128)a);
#else
    f8 r;
    for (int j = 0; j < 4; ++j) r[j] = a[j], r[j + 4] = b[j];
    return r;
#endif
}
INLINE f4 four(float x) { return f4{x, x, x, x}; }

// fields of plane cells out of the sums of the lanes
template <bool FULL>
INLINE void plane_sample(f8 low[8], f8 high[8], f8 slopes[16], const Place& place, Sample& s) {
    transpose(low);
    for (int i = 0; i < 3; ++i) s.u[i] = low[i];
    s.rate = low[3];
    s.time = low[4];
    for (int i = 0; i < 3; ++i) s.factor[i] = low[5 + i];
    if (FULL) {
        transpose(high);
        s.temperature = high[4];
        for (int i = 0; i < 3; ++i) s.pressure[i] = high[5 + i];
    } else {
        // lanes 0-7 hold fields 8-11 in their lower halves
        f8 r[4];
        for (int k = 0; k < 4; ++k) r[k] = SHUFFLE(high[k], high[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        const f8 a0 = SHUFFLE(r[0], r[1], 0, 8, 1, 9, 4, 12, 5, 13);
        const f8 a1 = SHUFFLE(r[0], r[1], 2, 10, 3, 11, 6, 14, 7, 15);
        const f8 a2 = SHUFFLE(r[2], r[3], 0, 8, 1, 9, 4, 12, 5, 13);
        const f8 a3 = SHUFFLE(r[2], r[3], 2, 10, 3, 11, 6, 14, 7, 15);
        high[0] = SHUFFLE(a0, a2, 0, 1, 8, 9, 4, 5, 12, 13);
        high[1] = SHUFFLE(a0, a2, 2, 3, 10, 11, 6, 7, 14, 15);
        high[2] = SHUFFLE(a1, a3, 0, 1, 8, 9, 4, 5, 12, 13);
        high[3] = SHUFFLE(a1, a3, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    for (int i = 0; i < 3; ++i) s.factor[3 + i] = high[i];
    s.strip = high[3];
    // slopes along x and y; a clamped coordinate does not change with the place
    transpose(slopes);
    if (FULL) transpose(slopes + 8);
    const f8 zero = splat(0.0f);
    const f8 ax = select(place.clamped[0], zero, place.inverse[0]);
    const f8 ay = select(place.clamped[0], zero, place.inverse[1]);
    const f8 bx = select(place.clamped[1], zero, place.inverse[2]);
    const f8 by = select(place.clamped[1], zero, place.inverse[3]);
    const f8 *a = FULL ? slopes + 4 : slopes, *b = FULL ? slopes + 12 : slopes + 4;
    for (int i = 0; i < 4; ++i) {
        s.slope_x[i] = a[i] * ax + b[i] * bx;
        s.slope_y[i] = a[i] * ay + b[i] * by;
    }
    if (FULL) {
        const f8 *p = slopes, *q = slopes + 8;
        s.spin[0] = p[2] * ay + q[2] * by;
        s.spin[1] = -(p[2] * ax + q[2] * bx);
        s.spin[2] = (p[1] * ax + q[1] * bx) - (p[0] * ay + q[0] * by);
    }
}

struct Quadrilateral : Walk<Quadrilateral> {
    static constexpr int FACETS = 4, DIM = 2, MAP = PLANE_MAP;

    static INLINE void invert(const Grid& grid, const d8 p[3], Place& place) { plane_invert(grid, p, place); }

    template <class F>
    static INLINE F outside(const F* at, int facet) {
        return (facet == 0 ? -at[1] : facet == 1 ? -at[0] : facet == 2 ? at[0] : at[1]) - 1.0f;
    }

    static INLINE void clamp(Place& place) {
        const f8 one = splat(1.0f);
        for (int i = 0; i < 2; ++i) {
            place.clamped[i] = absolute(place.at[i]) > 1.0f + TOLERANCE;
            place.at[i] = smaller(larger(place.at[i], -one), one);
        }
    }

    // crossings of the cell a second at a velocity
    static INLINE f8 crossings(const Place& place, const f8 v[3]) {
        const f8* m = place.inverse;
        return 0.5f * larger(absolute(m[0] * v[0] + m[1] * v[1]), absolute(m[2] * v[0] + m[3] * v[1]));
    }

    template <bool FULL>
    static INLINE void sample(const Grid& grid, const Rows& rows, const Place& place, f8 t, Sample& s) {
        alignas(32) float w[12][8];
        for (int i = 0; i < 2; ++i) {
            const f8 a = place.at[i];
            store(w[6 * i], 0.5f * a * (a - 1.0f));
            store(w[6 * i + 1], 1.0f - a * a);
            store(w[6 * i + 2], 0.5f * a * (a + 1.0f));
            store(w[6 * i + 3], a - 0.5f);
            store(w[6 * i + 4], -2.0f * a);
            store(w[6 * i + 5], a + 0.5f);
        }
        f8 low[8], high[8], slopes[16];
        for (int k = 0; k < LANES; ++k) {
            const int32_t* node = grid.node + (int64_t)place.cell[k] * 9;
            const float tk = t[k];
            f8 l = splat(0.0f), h = splat(0.0f), sa = splat(0.0f), sb = splat(0.0f);
            f4 h4 = four(0.0f), sa4 = four(0.0f), sb4 = four(0.0f);
            for (int q = 0; q < 3; ++q) {
                f8 lq = splat(0.0f), hq = splat(0.0f), dq = splat(0.0f);
                f4 hq4 = four(0.0f), dq4 = four(0.0f);
                for (int p = 0; p < 3; ++p) {
                    const int64_t n = node[3 * q + p];
                    const f8 r = rows.eight(n, 0, tk);
                    const float wp = w[p][k], dp = w[3 + p][k];
                    lq += splat(wp) * r;
                    if (FULL) {
                        hq += splat(wp) * rows.eight(n, 8, tk);
                        dq += splat(dp) * r;
                    } else {
                        hq4 += four(wp) * rows.four(n, 8, tk);
                        if (rows.slopes) dq4 += four(dp) * (rows.both ? upper(r) : rows.four(n, 4, tk));
                    }
                }
                const float wq = w[6 + q][k], eq = w[9 + q][k];
                l += splat(wq) * lq;
                if (FULL) {
                    h += splat(wq) * hq;
                    sa += splat(wq) * dq;
                    sb += splat(eq) * lq;
                } else {
                    h4 += four(wq) * hq4;
                    if (rows.slopes) {
                        sa4 += four(wq) * dq4;
                        sb4 += four(eq) * upper(lq);
                    }
                }
            }
            low[k] = l;
            high[k] = FULL ? h : joined(h4, h4);
            slopes[k] = FULL ? sa : joined(sa4, sb4);
            if (FULL) slopes[8 + k] = sb;
        }
        plane_sample<FULL>(low, high, slopes, place, s);
    }

    static INLINE f4 upper(f8 x) {
#if defined(__AVX__)
        return (f4)_mm256_extractf128_ps((__m256)x, 1);
#else
        return f4{x[4], x[5], x[6], x[7]};
#endif
    }
};

struct Triangle : Walk<Triangle> {
    static constexpr int FACETS = 3, DIM = 2, MAP = PLANE_MAP;

    static INLINE void invert(const Grid& grid, const d8 p[3], Place& place) { plane_invert(grid, p, place); }

    // facet i lies opposite to vertex i
    template <class F>
    static INLINE F outside(const F* at, int facet) {
        return facet == 0 ? at[0] + at[1] - 1.0f : facet == 1 ? -at[0] : -at[1];
    }

    static INLINE void clamp(Place& place) {
        const f8 zero = splat(0.0f);
        f8 a = place.at[0], b = place.at[1];
        place.clamped[0] = a < -TOLERANCE;
        place.clamped[1] = b < -TOLERANCE;
        a = larger(a, zero);
        b = larger(b, zero);
        const f8 sum = a + b;
        const i8 beyond = sum > 1.0f + TOLERANCE;
        const f8 scale = select(beyond, 1.0f / sum, splat(1.0f));
        place.at[0] = a * scale;
        place.at[1] = b * scale;
        // beyond the third side both coordinates are bound to it; slopes across are dropped
        place.clamped[0] |= beyond;
        place.clamped[1] |= beyond;
    }

    static INLINE f8 crossings(const Place& place, const f8 v[3]) {
        const f8* m = place.inverse;
        const f8 a = m[0] * v[0] + m[1] * v[1], b = m[2] * v[0] + m[3] * v[1];
        return larger(larger(absolute(a), absolute(b)), absolute(a + b));
    }

    template <bool FULL>
    static INLINE void sample(const Grid& grid, const Rows& rows, const Place& place, f8 t, Sample& s) {
        alignas(32) float w[18][8];
        const f8 a = place.at[0], b = place.at[1], c = 1.0f - a - b;
        const f8 zero = splat(0.0f);
        // vertices, then the middles of the sides opposite to them
        const f8 weight[18] = {c * (2.0f * c - 1.0f), a * (2.0f * a - 1.0f), b * (2.0f * b - 1.0f),
                               4.0f * a * b, 4.0f * b * c, 4.0f * a * c,
                               1.0f - 4.0f * c, 4.0f * a - 1.0f, zero,
                               4.0f * b, -4.0f * b, 4.0f * (c - a),
                               1.0f - 4.0f * c, zero, 4.0f * b - 1.0f,
                               4.0f * a, 4.0f * (c - b), -4.0f * a};
        for (int i = 0; i < 18; ++i) store(w[i], weight[i]);
        f8 low[8], high[8], slopes[16];
        for (int k = 0; k < LANES; ++k) {
            const int32_t* node = grid.node + (int64_t)place.cell[k] * 6;
            const float tk = t[k];
            f8 l = zero, h = zero, sa = zero, sb = zero, sab = zero;
            f4 h4 = four(0.0f);
            for (int i = 0; i < 6; ++i) {
                const int64_t n = node[i];
                const f8 r = rows.eight(n, 0, tk);
                l += splat(w[i][k]) * r;
                if (FULL) {
                    h += splat(w[i][k]) * rows.eight(n, 8, tk);
                    sa += splat(w[6 + i][k]) * r;
                    sb += splat(w[12 + i][k]) * r;
                } else {
                    h4 += four(w[i][k]) * rows.four(n, 8, tk);
                    const f4 u = Quadrilateral::upper(r);
                    sab += joined(four(w[6 + i][k]), four(w[12 + i][k])) * joined(u, u);
                }
            }
            low[k] = l;
            high[k] = FULL ? h : joined(h4, h4);
            slopes[k] = FULL ? sa : sab;
            if (FULL) slopes[8 + k] = sb;
        }
        plane_sample<FULL>(low, high, slopes, place, s);
    }
};

}  // namespace KERNEL_NAMESPACE
