// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Tetrahedra and hexahedra with fields of degree one.
#pragma once

#include "gas.h"

namespace KERNEL_NAMESPACE {

// origin, offset from it and inverse at the centre; rows 0-15 of the map
template <int WIDTH>
INLINE void space_affine(const Grid& grid, const d8 p[3], Place& place, f8 d[3]) {
    f8 m[16];
    for (int h = 0; h < 2; ++h) {
        for (int k = 0; k < LANES; ++k) m[8 * h + k] = load(grid.map + (int64_t)place.cell[k] * WIDTH + 8 * h);
        transpose(m + 8 * h);
    }
    for (int i = 0; i < 3; ++i)
        d[i] = to_float(p[i] - (to_double(m[2 * i]) + to_double(m[2 * i + 1])));
    for (int i = 0; i < 9; ++i) place.inverse[i] = m[6 + i];
    for (int i = 0; i < 3; ++i)
        place.at[i] = m[6 + 3 * i] * d[0] + m[7 + 3 * i] * d[1] + m[8 + 3 * i] * d[2];
}

// inverse of a Jacobian J[i][j] = d x_i/d xi_j
INLINE void invert_matrix(const f8 J[3][3], f8 inverse[9]) {
    const f8 a = J[1][1] * J[2][2] - J[1][2] * J[2][1];
    const f8 b = J[1][2] * J[2][0] - J[1][0] * J[2][2];
    const f8 c = J[1][0] * J[2][1] - J[1][1] * J[2][0];
    const f8 r = 1.0f / (J[0][0] * a + J[0][1] * b + J[0][2] * c);
    inverse[0] = a * r;
    inverse[3] = b * r;
    inverse[6] = c * r;
    inverse[1] = (J[0][2] * J[2][1] - J[0][1] * J[2][2]) * r;
    inverse[4] = (J[0][0] * J[2][2] - J[0][2] * J[2][0]) * r;
    inverse[7] = (J[0][1] * J[2][0] - J[0][0] * J[2][1]) * r;
    inverse[2] = (J[0][1] * J[1][2] - J[0][2] * J[1][1]) * r;
    inverse[5] = (J[0][2] * J[1][0] - J[0][0] * J[1][2]) * r;
    inverse[8] = (J[0][0] * J[1][1] - J[0][1] * J[1][0]) * r;
}

// Sums of the lanes: fields 0-7 and 8-15; of the slopes in space those that the drift needs, d_x T_L,
// d_x L11, d_y L21, d_y L22, d_z L31, d_z L32, d_z L33, and d_y T_L, d_z T_L; the shear rates.
struct SpaceSums {
    f8 low[8], high[8], slope[8], shear[3][8];
    alignas(32) float time_slope[2][8];
};

template <bool FULL>
INLINE void space_sample(SpaceSums& sums, const Rows& rows, const Place& place, Sample& s) {
    transpose(sums.low);
    transpose(sums.high);
    for (int i = 0; i < 3; ++i) s.u[i] = sums.low[i];
    s.rate = sums.low[3];
    s.time = sums.low[4];
    for (int i = 0; i < 3; ++i) {
        s.factor[i] = sums.low[5 + i];
        s.factor[3 + i] = sums.high[i];
        s.pressure[i] = sums.high[5 + i];
    }
    s.strip = sums.high[3];
    s.temperature = sums.high[4];
    const f8 zero = splat(0.0f);
    for (int i = 0; i < 3; ++i) s.drift[i] = s.time_slope[i] = s.spin[i] = zero;
    if (!rows.slopes) return;
    transpose(sums.slope);
    const f8* d = sums.slope;
    s.time_slope[0] = d[0];
    s.time_slope[1] = load(sums.time_slope[0]);
    s.time_slope[2] = load(sums.time_slope[1]);
    s.drift[0] = d[1] + d[2] + d[4];
    s.drift[1] = d[3] + d[5];
    s.drift[2] = d[6];
    if (!FULL) return;
    for (int j = 0; j < 3; ++j) transpose(sums.shear[j]);
    const f8* m = place.inverse;
    auto rate = [&](int field, int i) {
        return sums.shear[0][field] * m[i] + sums.shear[1][field] * m[3 + i] + sums.shear[2][field] * m[6 + i];
    };
    s.spin[0] = rate(2, 1) - rate(1, 2);
    s.spin[1] = rate(0, 2) - rate(2, 0);
    s.spin[2] = rate(1, 0) - rate(0, 1);
}

// add up the rows of the nodes of every lane: weights w[node][lane], their slopes g[3][node][lane] but for
// tetrahedra, whose slopes are differences
template <bool FULL, int NODES>
INLINE void space_sums(const Grid& grid, const Rows& rows, const Place& place, f8 t,
                       const float (*w)[8], const float (*g)[NODES][8], SpaceSums& sums) {
    const f8 zero = splat(0.0f);
    alignas(32) float m[9][8];
    for (int i = 0; i < 9; ++i) store(m[i], place.inverse[i]);
    for (int k = 0; k < LANES; ++k) {
        const int32_t* node = grid.node + (int64_t)place.cell[k] * NODES;
        const float tk = t[k];
        f8 low = zero, high = zero, slope[3] = {zero, zero, zero}, shear[3] = {zero, zero, zero};
        f8 corner[2][4] = {};
        for (int i = 0; i < NODES; ++i) {
            const int64_t n = node[i];
            const f8 r = rows.eight(n, 0, tk);
            low += splat(w[i][k]) * r;
            high += splat(w[i][k]) * rows.eight(n, 8, tk);
            if (!rows.slopes) continue;
            const f8 q = rows.eight(n, 4, tk);
            if constexpr (NODES == 4) {
                corner[0][i] = q;
                if (FULL) corner[1][i] = r;
            } else {
                for (int j = 0; j < 3; ++j) {
                    slope[j] += splat(g[j][i][k]) * q;
                    if (FULL) shear[j] += splat(g[j][i][k]) * r;
                }
            }
        }
        if constexpr (NODES == 4) {
            for (int j = 0; rows.slopes && j < 3; ++j) {
                slope[j] = corner[0][1 + j] - corner[0][0];
                if (FULL) shear[j] = corner[1][1 + j] - corner[1][0];
            }
        }
        sums.low[k] = low;
        sums.high[k] = high;
        if (!rows.slopes) continue;
        f8 in_space[3];
        for (int i = 0; i < 3; ++i)
            in_space[i] = splat(m[i][k]) * slope[0] + splat(m[3 + i][k]) * slope[1] + splat(m[6 + i][k]) * slope[2];
        const f8 xy = SHUFFLE(in_space[0], in_space[1], 0, 1, 10, 11, 4, 5, 6, 7);
        sums.slope[k] = SHUFFLE(xy, in_space[2], 0, 1, 2, 3, 12, 13, 14, 15);
        sums.time_slope[0][k] = in_space[1][0];
        sums.time_slope[1][k] = in_space[2][0];
        for (int j = 0; FULL && j < 3; ++j) sums.shear[j][k] = shear[j];
    }
}

struct Tetrahedron : Walk<Tetrahedron> {
    static constexpr int FACETS = 4, DIM = 3, MAP = TETRAHEDRON_MAP;

    static INLINE void invert(const Grid& grid, const d8 p[3], Place& place) {
        f8 d[3];
        space_affine<TETRAHEDRON_MAP>(grid, p, place, d);
    }

    // facet i lies opposite to vertex i
    template <class F>
    static INLINE F outside(const F* at, int facet) {
        return facet == 0 ? at[0] + at[1] + at[2] - 1.0f : -at[facet - 1];
    }

    static INLINE void clamp(Place& place) {
        const f8 zero = splat(0.0f);
        f8 sum = zero;
        for (int i = 0; i < 3; ++i) {
            place.at[i] = larger(place.at[i], zero);
            sum += place.at[i];
        }
        const f8 scale = 1.0f / larger(sum, splat(1.0f));
        for (int i = 0; i < 3; ++i) place.at[i] *= scale;
    }

    static INLINE f8 crossings(const Place& place, const f8 v[3]) {
        const f8* m = place.inverse;
        f8 sum = splat(0.0f), most = sum;
        for (int i = 0; i < 3; ++i) {
            const f8 rate = m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2];
            sum += rate;
            most = larger(most, absolute(rate));
        }
        return larger(most, absolute(sum));
    }

    template <bool FULL>
    static INLINE void sample(const Grid& grid, const Rows& rows, const Place& place, f8 t, Sample& s) {
        alignas(32) float w[4][8];
        const f8* a = place.at;
        store(w[0], 1.0f - a[0] - a[1] - a[2]);
        for (int i = 0; i < 3; ++i) store(w[1 + i], a[i]);
        SpaceSums sums;
        space_sums<FULL, 4>(grid, rows, place, t, w, nullptr, sums);
        space_sample<FULL>(sums, rows, place, s);
    }
};

struct Hexahedron : Walk<Hexahedron> {
    static constexpr int FACETS = 6, DIM = 3, MAP = HEXAHEDRON_MAP;

    static INLINE void invert(const Grid& grid, const d8 p[3], Place& place) {
        f8 d[3];
        space_affine<HEXAHEDRON_MAP>(grid, p, place, d);
        if (grid.any_curved) {
            const i8 curved = curved_lanes(grid, place.cell);
            if (bits(curved)) newton(grid, curved, d, place);
        }
    }

    static INLINE void newton(const Grid& grid, i8 curved, const f8 d[3], Place& place) {
        f8 c[24];
        for (int h = 0; h < 3; ++h) {
            for (int k = 0; k < LANES; ++k)
                c[8 * h + k] = load(grid.map + (int64_t)place.cell[k] * HEXAHEDRON_MAP + 16 + 8 * h);
            transpose(c + 8 * h);
        }
        f8 a = place.at[0], b = place.at[1], e = place.at[2], inverse[9];
        const f8 most = splat(3.0f);
        for (int pass = 0; pass < 5; ++pass) {
            f8 r[3], J[3][3];
            for (int i = 0; i < 3; ++i) {
                // coefficients of a, b, e, ab, ae, be, abe
                const f8* q = c + 7 * i;
                const f8 ab = q[3] + e * q[6];
                J[i][0] = q[0] + e * q[4] + b * ab;
                J[i][1] = q[1] + e * q[5] + a * ab;
                J[i][2] = q[2] + a * q[4] + b * (q[5] + a * q[6]);
                r[i] = d[i] - (a * J[i][0] + b * (q[1] + e * q[5]) + e * q[2]);
            }
            invert_matrix(J, inverse);
            if (pass == 4) break;
            a = smaller(larger(a + inverse[0] * r[0] + inverse[1] * r[1] + inverse[2] * r[2], -most), most);
            b = smaller(larger(b + inverse[3] * r[0] + inverse[4] * r[1] + inverse[5] * r[2], -most), most);
            e = smaller(larger(e + inverse[6] * r[0] + inverse[7] * r[1] + inverse[8] * r[2], -most), most);
        }
        place.at[0] = select(curved, a, place.at[0]);
        place.at[1] = select(curved, b, place.at[1]);
        place.at[2] = select(curved, e, place.at[2]);
        for (int i = 0; i < 9; ++i) place.inverse[i] = select(curved, inverse[i], place.inverse[i]);
    }

    template <class F>
    static INLINE F outside(const F* at, int facet) {
        return (facet < 3 ? -at[2 - facet] : at[facet - 3]) - 1.0f;
    }

    static INLINE void clamp(Place& place) {
        const f8 one = splat(1.0f);
        for (int i = 0; i < 3; ++i) place.at[i] = smaller(larger(place.at[i], -one), one);
    }

    static INLINE f8 crossings(const Place& place, const f8 v[3]) {
        const f8* m = place.inverse;
        f8 most = splat(0.0f);
        for (int i = 0; i < 3; ++i)
            most = larger(most, absolute(m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2]));
        return 0.5f * most;
    }

    template <bool FULL>
    static INLINE void sample(const Grid& grid, const Rows& rows, const Place& place, f8 t, Sample& s) {
        alignas(32) float w[8][8];
        alignas(32) float g[3][8][8];
        f8 part[3][2];
        for (int i = 0; i < 3; ++i) {
            part[i][0] = 0.5f - 0.5f * place.at[i];
            part[i][1] = 0.5f + 0.5f * place.at[i];
        }
        for (int n = 0; n < 8; ++n) {
            const int p = n & 1, q = n >> 1 & 1, r = n >> 2;
            const f8 a = part[0][p], b = part[1][q], c = part[2][r];
            store(w[n], a * b * c);
            store(g[0][n], (p ? 0.5f : -0.5f) * (b * c));
            store(g[1][n], (q ? 0.5f : -0.5f) * (a * c));
            store(g[2][n], (r ? 0.5f : -0.5f) * (a * b));
        }
        SpaceSums sums;
        space_sums<FULL, 8>(grid, rows, place, t, w, g, sums);
        space_sample<FULL>(sums, rows, place, s);
    }
};

}  // namespace KERNEL_NAMESPACE
